"""Messages of a link: MAVLink's of the system that is watched, or lines of a table, and why none can be believed.

Of a table, a header comes first, then a row a line, with the names and units of logs. A line that is no row is passed
over and counted, and one that never ends is dropped, so memory stays bounded.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.formats.tlog import SINCE_1970_S, SYSTEM_TIME, boot_s
from gtmbench.intake.mapping import ChosenColumn, choose, choose_of, split_mapping
from gtmbench.intake.times import time_column
from gtmbench.link.packets import (
    HEARTBEAT,
    MOTION,
    LinkSample,
    Packet,
    Packets,
    channels_of,
    chosen,
    is_finite,
    sample_of,
    stamp_s,
)
from gtmbench.link.rows import Numbering

_NO_AUTOPILOT = 8  # MAV_AUTOPILOT_INVALID
_HELD_S = 0.5  # of messages that count since 1970, until all are taken to do so


@dataclass(frozen=True, kw_only=True, slots=True)
class Message:
    """A message of the watched system, or a line of a table, by the sender's clock."""

    topic: str
    time_s: float
    content: Any = field(repr=False)


class Telemetry:
    """The messages of the system that is watched: the only one that flies, or the one whose number is given."""

    unit = "message"

    def __init__(self, system: int | None = None, key: bytes | None = None) -> None:
        self._wanted, self._key = system, key
        self._by_peer: dict[object, Packets] = {}
        self._numbers: dict[int, Numbering] = {}
        self._flying: set[int] = set()
        self._boot_s: float | None = None  # when the sender was switched on, in seconds since 1970, as it told
        self._counts = ""  # from when the sender's messages count their time; "" until that is known
        self._held: list[Message] = []  # those that count since 1970, until it is known whether others don't
        self._unplaced: set[str] = set()  # the names of those that can't be put beside the others
        self.system = system
        self.answered = system
        """The system that is answered: one with an autopilot, which may send nothing else until it is asked."""
        self.autopilot: int | None = None
        self.taken: list[bytes] = []
        """The packets of the last bytes, as they arrived, whoever sent them."""

    def read(self, data: bytes, peer: object = None, *, is_whole: bool = False) -> list[Message]:
        """Return the messages that some bytes of a sender complete."""
        packets = self._by_peer.get(peer)
        if packets is None:
            if len(self._by_peer) >= 64:  # a port that anybody may send to
                self._by_peer.pop(next(iter(self._by_peer)))
            packets = self._by_peer[peer] = Packets(self._key)
        found = packets.push(data, is_whole=is_whole)
        self.taken = [packet.content for packet in found]
        return [message for packet in found for message in self._placed(self._message(packet))]

    def _message(self, packet: Packet) -> Message | None:
        if packet.topic in MOTION:
            self._flying.add(packet.system)
            if self.system is None:
                self.system = packet.system
        if packet.topic == HEARTBEAT and packet.message.autopilot != _NO_AUTOPILOT and self.answered is None:
            self.answered = packet.system
        if packet.system != self.system:
            return None
        self._numbers.setdefault(packet.component, Numbering()).push(packet.sequence)
        if packet.topic == HEARTBEAT:
            if packet.message.autopilot != _NO_AUTOPILOT:
                self.autopilot = packet.message.autopilot
            return None
        if packet.topic == SYSTEM_TIME:
            if self._boot_s is None:
                self._boot_s = boot_s(packet.message.time_unix_usec, packet.message.time_boot_ms)
            return None
        return Message(topic=packet.topic, time_s=stamp_s(packet.topic, packet.message), content=packet.message)

    def _placed(self, message: Message | None) -> list[Message]:
        """Return the messages that another one lets be put on one clock: some count since boot, some since 1970."""
        if message is None:
            return []
        if message.time_s < SINCE_1970_S:
            held, self._held, self._counts = self._held, [], "since boot"
            return [*(placed for each in held for placed in self._placed(each)), message]
        if self._counts == "since 1970":
            return [message]
        if self._counts and self._boot_s is not None:
            return [replace(message, time_s=message.time_s - self._boot_s)]
        if self._counts:
            self._unplaced.add(message.topic)
            return []
        self._held.append(message)
        if message.time_s - self._held[0].time_s < _HELD_S:
            return []
        held, self._held, self._counts = self._held, [], "since 1970"
        return held

    @property
    def broken(self) -> int:
        """Packets that were passed over because their checksum is wrong."""
        return sum(packets.broken for packets in self._by_peer.values())

    @property
    def refused(self) -> int:
        """Packets that were passed over because they aren't signed as they should be."""
        return sum(packets.refused for packets in self._by_peer.values())

    @property
    def others(self) -> tuple[int, ...]:
        """The other systems that fly on this link."""
        return tuple(sorted(self._flying - {self.system}))

    @property
    def is_open(self) -> str:
        """Why nobody knows which system is meant; "" where it is clear."""
        if self._wanted is not None or not self.others:
            return ""
        systems = sorted(self._flying)
        return f"systems {listed(map(str, systems))} fly on this link; say which is watched: --system {min(systems)}"

    @property
    def is_mixed(self) -> bool:
        """Whether two senders use the watched system's number."""
        return any(numbers.is_mixed for numbers in self._numbers.values())

    def routes(self, rates_hz: dict[str, float], needs: Sequence[str], least_hz: float) -> dict[str, str]:
        """Return the message that each channel is read from."""
        return chosen(rates_hz, needs, self.autopilot, least_hz)

    def sample(self, message: Message, channels: Sequence[str]) -> LinkSample | None:
        """Return what a message reads of some channels; None where its stamp is no time."""
        sample = sample_of(message.topic, message.time_s, channels, message.content)
        return sample if is_finite(sample) else None

    def told(self) -> str:
        """Say what tells of motion on this link, or why a message of it can't be read."""
        if self._unplaced:
            names, count = listed(sorted(self._unplaced)), "counts" if len(self._unplaced) == 1 else "count"
            return f"{names} {count} time since 1970 and others since boot, and no SYSTEM_TIME tells when that was"
        topics = {topic for topic in MOTION if channels_of(topic, self.autopilot)}
        return f"messages that do are {listed(sorted(topics))}"


_LONGEST = 1 << 16  # bytes of a line
_SINCE_S = 1e8  # stamps beyond count from 1970
_NONE = np.zeros(0)


class TableRows:
    """The rows of a table's lines.

    >>> table = TableRows(["p"])
    >>> end = bytes([10])
    >>> [message.time_s for message in table.read(b"time_s,p_deg_s" + end + b"0.0,1.5" + end + b"0.1,")], table.broken
    ([0.0], 0)
    >>> [message.content for message in table.read(b"2.5" + end + b"no row" + end)], table.broken
    ([(2.5,)], 1)
    """

    unit = "row"
    is_open, is_mixed, refused, others = "", False, 0, ()

    def __init__(self, needs: Sequence[str], wants: Sequence[str] = (), mapping: Sequence[str] = ()) -> None:
        self._needs, self._wants, self._mapping = needs, wants, mapping
        self._rest = b""
        self._skips = False  # the rest of a line that is too long
        self._separator: bytes | None = b","
        self._width = self._time = 0
        self._per_second, self._origin_s = 1.0, math.nan
        self._columns: list[tuple[int, float]] = []  # of each channel: its place, and what its values are multiplied by
        self.channels: tuple[str, ...] = ()
        self.broken = 0
        """Lines that were passed over because they are no rows."""
        self.taken: list[bytes] = []
        """The lines of the last bytes."""

    def read(self, data: bytes, _peer: object = None, *, is_whole: bool = False) -> list[Message]:
        """Return the rows that some bytes complete; with the last of them where they are whole."""
        *lines, self._rest = (self._rest + data + (b"\n" if is_whole else b"")).split(b"\n")
        if self._skips and lines:
            self._skips = False
            lines.pop(0)
        if len(self._rest) > _LONGEST:
            self.broken += not self._skips
            self._rest, self._skips = b"", True
        self.taken = [line.rstrip(b"\r") for line in lines if line.strip()]
        rows = list(self.taken)
        if not self.channels and rows:
            self._open(rows.pop(0))
        return [message for line in rows if (message := self._row(line)) is not None]

    def _open(self, line: bytes) -> None:
        header = line.decode("utf-8-sig", errors="replace").strip().lstrip("#% ")
        separator = max(";\t|,", key=header.count)
        self._separator = separator.encode() if separator in header else None
        names = [name.strip().strip('"') for name in header.split(separator if separator in header else None)]
        if not any(name[:1].isalpha() for name in names):
            raise InputError(
                "the first line that came holds no names; send a header first, such as "
                "time_s,p_deg_s,q_deg_s,r_deg_s,phi_deg,theta_deg,psi_deg"
            )
        raw = RawLog(kind="table", series=tuple(RawSeries(name=name, load=lambda: _NONE) for name in names if name))
        columns = split_mapping(self._mapping)
        series, _, self._per_second = time_column(raw, columns.pop("time", None))
        chosen = choose(raw, columns, self._needs)
        chosen += choose_of([name for name in self._wants if name not in self._needs], raw, columns)
        self._time, self._width = names.index(series.name), len(names)
        self.channels = tuple(choice.channel for choice in chosen)
        self._columns = [(names.index(choice.series.name), _factor(choice)) for choice in chosen]

    def _row(self, line: bytes) -> Message | None:
        cells = line.split(self._separator)
        try:
            if len(cells) < self._width:
                raise ValueError
            time_s = float(cells[self._time]) / self._per_second
            values = tuple(_number(cells[place]) * factor for place, factor in self._columns)
        except ValueError:
            self.broken += 1
            return None
        if not abs(time_s) < 1e11:
            self.broken += 1
            return None
        if math.isnan(self._origin_s):
            self._origin_s = time_s if time_s > _SINCE_S else 0.0
        return Message(topic="", time_s=time_s - self._origin_s, content=values)

    def routes(self, _rates_hz: dict[str, float], needs: Sequence[str], _least_hz: float) -> dict[str, str]:
        """Return the "message" that each channel is read from: the only one."""
        return {name: "" for name in needs if name in self.channels}

    def sample(self, message: Message, channels: Sequence[str]) -> LinkSample | None:
        """Return what a row reads of some channels."""
        values = message.content
        if tuple(channels) != self.channels:
            values = tuple(values[self.channels.index(name)] for name in channels)
        return LinkSample(topic="", time_s=message.time_s, values=values)

    def told(self) -> str:
        """Say what the table holds."""
        return f"it holds {', '.join(self.channels)}"


def _factor(choice: ChosenColumn) -> float:
    """Return what a column's values are multiplied by to be the channel's."""
    if choice.late_s:
        raise InputError(f"--map {choice.channel}: a column that is stamped late (@) isn't read row by row")
    return choice.factor


def _number(cell: bytes) -> float:
    """Return a cell's number; NaN where it is empty."""
    try:
        value = float(cell)
    except ValueError:
        if cell.strip():
            raise
        return math.nan
    return value if abs(value) < 1e100 else math.nan

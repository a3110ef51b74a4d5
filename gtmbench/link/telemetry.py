"""MAVLink from a link: which system is watched, what its messages tell, and why none can be believed, if so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from gtmbench.checks import listed
from gtmbench.intake.formats.tlog import SINCE_1970_S, SYSTEM_TIME, boot_s
from gtmbench.link.order import Numbering
from gtmbench.link.packets import HEARTBEAT, Packet, Packets
from gtmbench.link.readings import MOTION, LinkSample, channels_of, chosen, is_finite, sample_of, stamp_s

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

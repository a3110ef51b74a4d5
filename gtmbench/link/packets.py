"""MAVLink packets in whatever bytes arrive: found, decoded and checked; what they read, and how they are kept.

Bytes that aren't a packet, half of one, or one whose checksum or signature is wrong are passed over and counted. No
more than one packet's bytes ever wait for the rest of it, whatever arrives. Integers have each autopilot's scale: of
RAW_IMU only ArduPilot's is documented, so others' is left out.
"""

from __future__ import annotations

import errno
import hashlib
import math
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any, Self

import numpy as np

from gtmbench.errors import InputError
from gtmbench.imports import load_extra
from gtmbench.intake.formats.dialects import MAVLINK
from gtmbench.intake.formats.limits import quiet
from gtmbench.intake.formats.raw import ANGLES, euler_deg
from gtmbench.intake.formats.tlog import SYSTEM_TIME, packet_at
from gtmbench.intake.units import unit
from gtmbench.values.channels import ATTITUDE, GYROS

_QUATERNION = "ATTITUDE_QUATERNION"
_PER_SECOND = {"time_boot_ms": 1e3, "time_usec": 1e6}  # by the units of MAVLink's fields
_STAMPED = {
    "HIGHRES_IMU": "time_usec",
    "RAW_IMU": "time_usec",
    "SCALED_IMU": "time_boot_ms",
    "ATTITUDE": "time_boot_ms",
    _QUATERNION: "time_boot_ms",
    "GLOBAL_POSITION_INT": "time_boot_ms",
}
TOPICS = tuple(_STAMPED)
"""The messages that are read: those that tell when they were measured."""
MOTION = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "ATTITUDE", _QUATERNION)
"""Those among them that only something sends that turns."""
_ARDUPILOT = 3  # MAV_AUTOPILOT

Get = Callable[[Any], float]


@dataclass(frozen=True, kw_only=True)
class LinkSample:
    """What one message, or one line, read at a time."""

    topic: str  # the message's name; "" of a line
    time_s: float  # by the sender's clock
    values: tuple[float, ...]  # in the units of the channel table; NaN where there is none


def _getters() -> dict[str, dict[str, Get]]:
    """Return what gets each channel of each message, in the channel's unit."""
    getters: dict[str, dict[str, Get]] = {topic: {} for topic in _STAMPED}
    for (topic, name), meaning in MAVLINK.items():
        known = unit(meaning.unit)
        if topic in getters and known is not None:
            getters[topic][meaning.channel] = partial(_field, name, meaning.sign * known.factor)
    getters[_QUATERNION] |= dict(zip(ATTITUDE, (partial(_turned, angle) for angle in ANGLES), strict=True))
    return getters


def _field(name: str, factor: float, message: Any) -> float:
    return factor * float(getattr(message, name))


def _turned(angle: str, message: Any) -> float:
    parts = [np.array([part]) for part in (message.q1, message.q2, message.q3, message.q4)]
    return float(euler_deg(parts, angle)[0])


_GETTERS = _getters()


def stamp_s(topic: str, message: Any) -> float:
    """Return when a message was measured, in seconds of its sender's clock."""
    field = _STAMPED[topic]
    return float(getattr(message, field)) / _PER_SECOND[field]


def channels_of(topic: str, autopilot: int | None) -> tuple[str, ...]:
    """Return the channels that a message tells, of an autopilot as its heartbeat names it.

    >>> channels_of("ATTITUDE", None), channels_of("RAW_IMU", 12)
    (('p', 'q', 'r', 'phi', 'theta', 'psi'), ())
    """
    return () if topic == "RAW_IMU" and autopilot != _ARDUPILOT else tuple(_GETTERS[topic])


def sample_of(topic: str, time_s: float, channels: Sequence[str], message: Any) -> LinkSample:
    """Return what a message of a time reads of some channels."""
    getters = _GETTERS[topic]
    values = tuple(getters[name](message) for name in channels)
    return LinkSample(topic=topic, time_s=time_s, values=values)


def chosen(rates_hz: dict[str, float], needs: Iterable[str], autopilot: int | None, least_hz: float) -> dict[str, str]:
    """Return the message that each needed channel is read from, of those that come; none for one that none tells.

    >>> chosen({"ATTITUDE": 100.0, "HIGHRES_IMU": 4.0}, ["p", "phi"], None, 45.0)
    {'p': 'ATTITUDE', 'phi': 'ATTITUDE'}
    """
    told = {topic: channels_of(topic, autopilot) for topic in _STAMPED if topic in rates_hz}
    by_channel = {}
    for name in needs:
        group = [each for each in needs if each in GYROS] if name in GYROS else [name]
        telling = [topic for topic, channels in told.items() if {*group} <= {*channels}]
        fast = [topic for topic in telling if rates_hz[topic] >= least_hz]
        best = fast or sorted(telling, key=lambda topic: -rates_hz[topic])
        if best:
            by_channel[name] = best[0]
    return by_channel


def is_finite(sample: LinkSample) -> bool:
    """Tell whether a sample's stamp is a time at all."""
    return math.isfinite(sample.time_s) and abs(sample.time_s) < 1e11


_LONGEST = 280  # bytes of a packet: header, 255 of its content, checksum, signature
_MARKERS = (0xFE, 0xFD)  # of MAVLink 1 and 2: a packet begins so
HEARTBEAT = "HEARTBEAT"


@dataclass(frozen=True, kw_only=True, slots=True)
class Packet:
    """A message that is used, and whose it is."""

    system: int
    component: int
    sequence: int
    topic: str  # the message's name
    message: Any = field(repr=False)  # as pymavlink decodes it
    content: bytes = field(repr=False)  # the packet as it arrived


def dialect() -> ModuleType:
    """Import pymavlink's messages, or say in one line how to get them."""
    with quiet():
        return load_extra("pymavlink.dialects.v20.ardupilotmega", "logs", "a MAVLink link needs")


def key_of(path: Path) -> bytes:
    """Return the 32 bytes of a signing key: a file of them, of 64 hexadecimal digits, or of a passphrase."""
    try:
        if path.exists() and not path.is_file():
            raise OSError(errno.EINVAL, "not a file")
        content = path.read_bytes()[:4096]
    except OSError as error:
        raise InputError(f"--key-file {path}: {error.strerror}; give the file that holds the signing key") from error
    if len(content) == 32:
        return content
    text = content.strip()
    if not text:
        raise InputError(f"--key-file {path} is empty; it holds 32 bytes, 64 hexadecimal digits or a passphrase")
    try:
        key = bytes.fromhex(text.decode("ascii"))
    except ValueError:
        key = b""
    return key if len(key) == 32 else hashlib.sha256(text).digest()


class Packets:
    """The packets of one sender's bytes.

    >>> mavlink = dialect()
    >>> sender = mavlink.MAVLink(None, srcSystem=1)
    >>> packet = mavlink.MAVLink_attitude_message(5000, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0).pack(sender)
    >>> packets = Packets()
    >>> [each.topic for part in (b"junk" + packet[:9], packet[9:]) for each in packets.push(part)], packets.broken
    (['ATTITUDE'], 0)
    """

    def __init__(self, key: bytes | None = None) -> None:
        self._mavlink = dialect()
        self._decoder = self._mavlink.MAVLink(None)
        self._decoder.signing.secret_key = key
        used = {*TOPICS, HEARTBEAT, SYSTEM_TIME}
        self._used = {kind.id: kind.msgname for kind in self._mavlink.mavlink_map.values() if kind.msgname in used}
        self._rest = b""
        self.broken = 0
        """Packets whose checksum is wrong."""
        self.refused = 0
        """Packets that aren't signed as they should be."""

    def push(self, data: bytes, *, is_whole: bool = False) -> list[Packet]:
        """Return the packets that some bytes complete; none waits for the next of them where they are whole."""
        data, place = self._rest + data, 0
        found = []
        while (begin := _marked(data, place)) >= 0:
            header = packet_at(data, begin)
            if header is None or header[1] > len(data):
                if header is None or not is_whole:
                    place = begin
                    break
                place = begin + 1
                continue
            number, place = header
            topic = self._used.get(number)
            if topic is None:  # another message: passed over, where behind it stands another packet
                place = place if place == len(data) or data[place] in _MARKERS else begin + 1
                continue
            packet = self._decoded(topic, data[begin:place])
            if packet is None:
                place = begin + 1
            else:
                found.append(packet)
        else:
            place = len(data)
        self._rest = b"" if is_whole else data[place:][-_LONGEST:]
        return found

    def _decoded(self, topic: str, content: bytes) -> Packet | None:
        try:
            message = self._decoder.decode(bytearray(content))
        except (self._mavlink.MAVError, IndexError) as error:
            if "ignature" in str(error):
                self.refused += 1
            else:
                self.broken += 1
            return None
        return Packet(
            system=message.get_srcSystem(),
            component=message.get_srcComponent(),
            sequence=message.get_seq(),
            topic=topic,
            message=message,
            content=content,
        )


def _marked(data: bytes, place: int) -> int:
    """Return where the next packet may begin; -1 where none does."""
    places = [found for marker in _MARKERS if (found := data.find(marker, place)) >= 0]
    return min(places, default=-1)


def in_tlog(content: bytes) -> Iterator[tuple[float, bytes]]:
    """Give the parts of a telemetry log's content: when each packet arrived, in seconds since 1970, and its bytes.

    >>> [(at, part.hex()) for at, part in in_tlog((1_500_000).to_bytes(8, "big") + bytes.fromhex("fe0000000000abcd"))]
    [(1.5, 'fe0000000000abcd')]
    """
    place = 0
    while (begin := _marked(content, place + 8)) >= 0:
        header = packet_at(content, begin)
        if header is None or header[1] > len(content):
            return
        _, place = header
        if place + 8 < len(content) and content[place + 8] not in _MARKERS:
            place = begin - 7
            continue
        yield int.from_bytes(content[begin - 8 : begin], "big") / 1e6, content[begin:place]


class SavedLink:
    """A log of what arrives; what can't be written any more is told once, and the watch goes on."""

    def __init__(self, path: Path, *, is_table: bool = False) -> None:
        self.path = path
        self._file = path.open("wb")
        self._written: Callable[[float, bytes], bytes] = _line if is_table else _packet
        self._flushed_s = 0.0
        self.failure = ""

    def put(self, arrived_s: float, part: bytes) -> None:
        """Write a packet, or a line."""
        if self.failure:
            return
        try:
            self._file.write(self._written(arrived_s, part))
            if time.monotonic() - self._flushed_s > 1.0:  # what has arrived outlives a crash
                self._flushed_s = time.monotonic()
                self._file.flush()
        except OSError as error:
            self.failure = f"{self.path}: {error.strerror}; what arrives isn't saved any more, only watched"

    def close(self) -> None:
        """Finish the file."""
        try:
            self._file.close()
        except OSError as error:
            self.failure = self.failure or f"{self.path}: {error.strerror}"

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _packet(arrived_s: float, packet: bytes) -> bytes:
    return round(arrived_s * 1e6).to_bytes(8, "big") + packet


def _line(_arrived_s: float, line: bytes) -> bytes:
    return line + b"\n"

"""Telemetry as a ground station kept it: MAVLink's logs (.tlog), and texts with a message a line.

The texts are Mission Planner's CSV of a telemetry log, and Paparazzi's ``.data``. In a .tlog each packet, decoded by
pymavlink, stands behind the time at which it was received. Times are the sender's own, since it was switched on, where
its messages tell them; what came late, twice or in another order is left to the clean-up of all logs.
"""

from __future__ import annotations

import itertools
import re
import zlib
from array import array
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from operator import attrgetter
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from gtmbench.checks import listed
from gtmbench.errors import InputError
from gtmbench.intake.formats.clock_texts import clock_texts
from gtmbench.intake.formats.dialects import MAVLINK, Documented, topics_of
from gtmbench.intake.formats.limits import MOST_MESSAGES, library, quiet, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries, documented_first
from gtmbench.values.clock import FloatArray

_KIND = "MAVLink telemetry log"
_STAMP_BYTES = 8  # microseconds before a packet
_MARKERS = {0xFE: (6, 5), 0xFD: (10, 7)}  # bytes of the header, and where the message's number is
_SIGNED, _SIGNATURE_BYTES = 0x01, 13  # MAVLink 2: a flag of the header, and what stands behind the packet then
RECEIVED = "received"
"""Of a message's columns: when it was received, in s."""
_CLOCKS = {"time_boot_ms": 1e3, "time_usec": 1e6}  # stamps, and how many are a second
_ARDUPILOT = 3  # MAV_AUTOPILOT
SYSTEM_TIME = "SYSTEM_TIME"
SINCE_1970_S = 1e9  # a stamp above counts since 1970: nothing has been switched on for 30 years
_HARDWARE = "AUTOPILOT_VERSION"
_OTHERS = (
    "HEARTBEAT",
    _HARDWARE,
    SYSTEM_TIME,
    "SCALED_IMU2",
    "SCALED_IMU3",
    "AHRS2",
    "SERVO_OUTPUT_RAW",
    "RC_CHANNELS",
    "SCALED_PRESSURE",
)
USED = {topic for topic, _ in MAVLINK} | {*_OTHERS}
"""Of the hundreds of messages: what tells of motion."""

_TURNS = ("ATTITUDE", "HIGHRES_IMU", "RAW_IMU", "SCALED_IMU")  # what a system sends that flies
_PACKET = re.compile(rb"[\xfe\xfd]")
_MOST_BROKEN, _SHARE_BROKEN = 1000, 2  # packets, and for each whole one: beyond, it is no telemetry
Columns = dict[str, "array[float]"]
Messages = dict[str, Columns]  # of a system, by message and field; when received among them


def read_tlog(path: Path, part: str = "") -> RawLog:
    """Read what one system sent: the only one that flies, or the one whose number is given."""
    mavlink = library("pymavlink.dialects.v20.ardupilotmega", path, _KIND)
    with reading(path, _KIND), quiet():
        systems, broken = _decoded(path.read_bytes(), mavlink)
        number = system_of(systems, part)
    notes = [f"{broken} packets are broken and were passed over"] if broken else []
    return log_of_messages(_KIND, systems, number, notes)


def log_of_messages(
    kind: str, systems: dict[int, Messages], number: int, notes: Sequence[str], documented: Documented = MAVLINK
) -> RawLog:
    """Return the log of what one of several systems sent."""
    topics = dict(sorted(systems[number].items(), key=lambda topic: -len(topic[1][RECEIVED])))  # the fastest first
    autopilot = topics.pop("HEARTBEAT", {}).get("autopilot", ())
    numbers = [int(each) for each in topics.pop(_HARDWARE, {}).get("uid", ()) if each > 0.0]
    unplaced = _on_one_clock(topics)
    clocks = _clocks(topics)
    scaled = _ARDUPILOT in autopilot
    series = [
        RawSeries(
            name=f"{name}.{field}",
            load=partial(np.asarray, column),
            clock=name,
            meaning=documented.get((name, field)) if scaled or name != "RAW_IMU" else None,
        )
        for name, columns in topics.items()
        for field, column in columns.items()
        if field != RECEIVED and field not in _CLOCKS
    ]
    others = ", ".join(str(each) for each in systems if each != number)
    if others:
        notes = [f"system {number}; not read: system {others}", *notes]
    if unplaced:
        notes = [f"not read: {listed(unplaced)}, by a clock since 1970; no SYSTEM_TIME says when it booted", *notes]
    return RawLog(
        kind=kind,
        series=documented_first(series, [key for name in topics for key in documented if key[0] == name]),
        clocks=clocks,
        notes=("units and axes are documented; times: the sender's, since it was switched on, where it tells", *notes),
        by_name=False,
        attitude_from_gyros=True,
        hardware=f"{numbers[0]:x}" if numbers else "",
        is_received=True,
    )


def boot_s(since_1970_us: float, since_boot_ms: float) -> float | None:
    """Return when a sender was switched on, in seconds since 1970, by what its SYSTEM_TIME says; None where it doesn't.

    >>> boot_s(1_700_000_000_000_000, 5000), boot_s(0, 5000)
    (1699999995.0, None)
    """
    if since_1970_us / 1e6 < SINCE_1970_S or since_boot_ms <= 0.0:
        return None
    return since_1970_us / 1e6 - since_boot_ms / 1e3


def _on_one_clock(topics: Messages) -> list[str]:
    """Put messages that count since 1970 beside those that count since boot; take those out that can't be, by name."""
    told = topics.pop(SYSTEM_TIME, {})
    stamps = {name: columns["time_usec"] for name, columns in topics.items() if "time_usec" in columns}
    late = [name for name, at in stamps.items() if at[0] / 1e6 > SINCE_1970_S]
    if len(late) == sum(bool({*_CLOCKS} & {*columns}) for columns in topics.values()):
        return []
    pairs = zip(told.get("time_unix_usec", ()), told.get("time_boot_ms", ()), strict=True)
    known = [began_s for pair in pairs if (began_s := boot_s(*pair)) is not None]
    for name in late:
        if known:
            topics[name]["time_usec"] = array("d", [at - 1e6 * known[0] for at in stamps[name]])
        else:
            topics.pop(name)
    return [] if known else late


def _clocks(topics: Messages) -> dict[str, FloatArray]:
    """Return when messages were sent; those that don't tell were received as long after as others were."""
    clocks = {
        name: np.asarray(columns[field]) / per_second
        for name, columns in topics.items()
        for field, per_second in _CLOCKS.items()
        if field in columns
    }
    late = [float(np.nanmedian(np.asarray(topics[name][RECEIVED]) - time_s)) for name, time_s in clocks.items()]
    after_s = float(np.median(late)) if late else 0.0
    return {name: clocks.get(name, np.asarray(columns[RECEIVED]) - after_s) for name, columns in topics.items()}


def system_of(systems: dict[int, Messages], part: str, turns: Sequence[str] = _TURNS) -> int:
    """Return the number of the system that is meant."""
    flying = [number for number, messages in systems.items() if set(turns) & set(messages)]
    if part:
        if part.isdigit() and int(part) in systems:
            return int(part)
        raise InputError(f"no system {part} sent anything; there is {listed(map(str, sorted(systems)), 'or')}")
    if len(flying) == 1:
        return flying[0]
    if not flying:
        raise InputError(f"no message of it tells how anything turns ({listed(turns, 'or')})")
    raise InputError(f"systems {listed(map(str, sorted(flying)))} sent; say which is meant: --system {min(flying)}")


def packet_at(content: bytes, begin: int) -> tuple[int, int] | None:
    """Return which message a packet holds, by number, and where it ends; None where the content ends in its header.

    >>> packet_at(bytes.fromhex("fe020000001eaabbccdd"), 0)
    (30, 10)
    """
    header, own = _MARKERS[content[begin]]
    if begin + header > len(content):
        return None
    signed = _SIGNATURE_BYTES * (header == 10 and content[begin + 2] & _SIGNED)
    end = begin + header + content[begin + 1] + 2 + signed
    number = content[begin + own] if header == 6 else int.from_bytes(content[begin + own : begin + own + 3], "little")
    return number, end


def _decoded(content: bytes, mavlink: ModuleType) -> tuple[dict[int, Messages], int]:
    """Return what each system sent, and how many packets are broken."""
    decoder = mavlink.MAVLink(None)
    kinds = {kind.id: kind for kind in mavlink.mavlink_map.values() if kind.msgname in USED}
    getters = {number: _numbers(kind) for number, kind in kinds.items()}
    systems: dict[int, Messages] = {}
    place, whole, broken = 0, 0, 0
    while (found := _PACKET.search(content, place + _STAMP_BYTES)) is not None and found.start() + 12 <= len(content):
        begin, place = found.start(), found.start() - _STAMP_BYTES
        header = packet_at(content, begin)
        assert header is not None  # twelve bytes are there
        number, end = header
        if number not in kinds:
            is_next = end + _STAMP_BYTES >= len(content) or content[end + _STAMP_BYTES] in _MARKERS
            place = end if is_next else place + 1
            continue
        try:
            message = decoder.decode(bytearray(content[begin:end]))
        except (mavlink.MAVError, IndexError):
            broken, place = broken + 1, place + 1
            if broken > _MOST_BROKEN + _SHARE_BROKEN * whole:
                raise InputError(f"{broken} of {broken + whole} packets are broken") from None
            continue
        whole, place = whole + 1, end
        if whole > MOST_MESSAGES:
            raise InputError(f"it has more than {MOST_MESSAGES} messages; cut the log")
        fields, values_of = getters[number]
        of = systems.setdefault(message.get_srcSystem(), {})
        columns = of.get(kinds[number].msgname)
        if columns is None:
            columns = of[kinds[number].msgname] = {field: array("d") for field in (RECEIVED, *fields)}
        received_us = int.from_bytes(content[begin - _STAMP_BYTES : begin], "big")
        for column, value in zip(columns.values(), (received_us / 1e6, *values_of(message)), strict=False):
            column.append(value)
    if not systems:
        raise InputError("it holds no message with motion")
    return systems, broken


def _numbers(kind: Any) -> tuple[list[str], Callable[[Any], Any]]:
    """Return a message's fields that are one number, and what gets them; of two it is always a tuple."""
    if kind.msgname == _HARDWARE:  # the longer identifier where there is one, as one number
        return ["uid"], lambda message: (float(zlib.crc32(bytes(message.uid2)) if any(message.uid2) else message.uid),)
    fields = [name for name, code in zip(kind.fieldnames, kind.fieldtypes, strict=True) if code != "char"]
    return fields, attrgetter(*fields, fields[0])


FORMAT = Format(
    name="MAVLink telemetry (.tlog)",
    magic=(),
    pattern=rb"\x00[\x03-\x07].{6}[\xfe\xfd]",
    suffixes=(".tlog",),
    read=read_tlog,
    has_parts=True,
)


_PLANNER = "Mission Planner's CSV of a telemetry log"
_PAPARAZZI = "Paparazzi's .data"
_FIRST_NAME = 8  # cells before a message's own names and values
Rows = Iterator[tuple[int, str, float, dict[str, float]]]  # a system, a message, when it was received, its fields


def read_planner(path: Path, part: str = "") -> RawLog:
    """Read lines of a time, a header's bytes, a message's name, and names and values by turns."""
    with reading(path, _PLANNER):
        systems = _systems(_rows_of_planner(path))
        return log_of_messages(_PLANNER, systems, system_of(systems, part), ())


def read_paparazzi(path: Path, part: str = "") -> RawLog:
    """Read lines of a time, an aircraft's number, a message's name, and its values by their places."""
    documented = topics_of("Paparazzi")
    with reading(path, _PAPARAZZI):
        topics = list(dict.fromkeys(topic for topic, _ in documented))
        systems = _systems(_rows_of_paparazzi(path, topics))
        return log_of_messages(_PAPARAZZI, systems, system_of(systems, part, topics), (), documented)


def _rows_of_planner(path: Path) -> Rows:
    received = clock_texts([cells[0] for cells in _used_by_planner(path)])  # in any language's way to write dates
    if received is None:
        raise InputError("no message with motion in it begins with a date")
    for cells, received_s in zip(_used_by_planner(path), received.seconds.tolist(), strict=True):
        pairs = zip(cells[_FIRST_NAME::2], cells[_FIRST_NAME + 1 :: 2], strict=False)
        numbers = {name: value for name, text in pairs if name and (value := _number(text)) is not None}
        numbers.pop("Len", None)
        yield int(cells[4], 16), _planners_topic(cells), received_s, numbers  # 255, a ground station, is FF


def _used_by_planner(path: Path) -> Iterator[list[str]]:
    return (cells for cells in _split(path, ",") if len(cells) > _FIRST_NAME and _planners_topic(cells) in USED)


def _planners_topic(cells: Sequence[str]) -> str:
    return cells[7][8:-2].upper() if cells[7].startswith("mavlink_") else ""


def _rows_of_paparazzi(path: Path, topics: Sequence[str]) -> Rows:
    firsts: dict[tuple[str, str], str] = {}
    for received_s, system, topic, *cells in (cells for cells in _split(path, None) if len(cells) > 3):
        if topic not in topics:
            continue
        if topic.startswith("IMU_") and len(cells) == 4:  # since 2022 the sensor's number stands before its axes
            sensor, *cells = cells
            if firsts.setdefault((system, topic), sensor) != sensor:
                topic = f"{topic}#{sensor}"  # another one, which nothing takes for the first
        numbers = {str(place): value for place, text in enumerate(cells, 1) if (value := _number(text)) is not None}
        yield int(system), topic, float(received_s), numbers


def _split(path: Path, separator: str | None) -> Iterator[list[str]]:
    with path.open(encoding="utf-8", errors="replace") as file:
        for count, line in enumerate(file):
            if count > MOST_MESSAGES:
                raise InputError(f"it has more than {MOST_MESSAGES} messages; cut the log")
            yield line.rstrip("\n").split(separator)


def _number(text: str) -> float | None:
    try:
        return float(text)
    except ValueError:
        return None


def _systems(rows: Rows) -> dict[int, Messages]:
    """Return what each system sent, a column a field: those of a message's first row."""
    systems: dict[int, Messages] = {}
    for system, topic, received_s, fields in rows:
        columns = systems.setdefault(system, {}).setdefault(
            topic, {name: array("d") for name in itertools.chain((RECEIVED,), fields)}
        )
        for name, column in columns.items():
            column.append(received_s if name == RECEIVED else fields.get(name, np.nan))
    return systems


PLANNER = Format(
    name=_PLANNER,
    magic=(),
    pattern=rb"(\xef\xbb\xbf)?\d[^\n,]{7,30},F[DE],[^\n]{1,40},mavlink_\w+_t,",  # dates as the computer writes them
    suffixes=(),
    read=read_planner,
    has_parts=True,
)
PAPARAZZI = Format(
    name=_PAPARAZZI,
    magic=(),
    pattern=rb"\d+\.\d+ \d+ [A-Z][A-Z0-9_]+ [^\n]*\n\d+\.\d+ \d+ [A-Z]",
    suffixes=(),
    read=read_paparazzi,
    has_parts=True,
)

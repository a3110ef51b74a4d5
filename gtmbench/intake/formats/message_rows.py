"""Texts with a message a line: Mission Planner's CSV of a telemetry log, and Paparazzi's ``.data``."""

from __future__ import annotations

import itertools
from array import array
from collections.abc import Iterator, Sequence
from pathlib import Path

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.formats.clock_texts import clock_texts
from gtmbench.intake.formats.dialects import topics_of
from gtmbench.intake.formats.limits import MOST_MESSAGES, reading
from gtmbench.intake.formats.raw import Format, RawLog
from gtmbench.intake.formats.tlog import RECEIVED, USED, Messages, log_of_messages, system_of

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

"""A folder of tables of one flight, as ulog2csv and mavlogdump write it: a file a topic, each with its own time."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.events import Event
from gtmbench.intake.formats.csv import layout_of, read_csv
from gtmbench.intake.formats.dialects import ALL, PX4, angles_of
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES, reading
from gtmbench.intake.formats.raw import ANGLES, Format, Meaning, RawLog, RawSeries, documented_first
from gtmbench.intake.formats.ulog_events import TOLD_BY, ulog_events
from gtmbench.values.channels import ATTITUDE, GYROS

_PX4_TOPICS = {topic for topic, _ in PX4} | {
    "vehicle_gps_position",
    "sensor_gps",
    "vehicle_magnetometer",
    "sensor_mag",
    "sensor_gyro",
}
# those of gyros and attitude, and sensors beside them
_TOPICS = {topic for topic, _ in ALL} | _PX4_TOPICS | {"MAG", "MAG2", "MAG3", "IMU2", "IMU3", "BARO", "ARSP"}
_PX4_PER_SECOND = 1e6
_PX4_TIME = Meaning(channel="time", unit="us")  # since boot: after ten minutes of it a table can't tell
TABLES = "folder of tables"  # anybody's: their contents have to show that they are one flight's
_QUATERNION = tuple(f"q[{part}]" for part in range(4))
_MAV, _DATA = "mav0", "data"  # ASL's folder, and what a table is called whose folder has the sensor's name
_ASL = "_RS_"  # in its columns: from the reference to the sensor
MOST_TABLES, _MOST_INSTANCES = 300, 6
_TURNING = {topic for (topic, _), meaning in ALL.items() if meaning.channel in (*GYROS, *ATTITUDE)} | {"IMU2", "IMU3"}
_MESSAGE = re.compile(r"[A-Z][A-Z0-9_]*(\[\d+\])?")  # as ArduPilot and MAVLink call theirs
_ROTATION = re.compile(r"(?i)gyr|roll|pitch|yaw|^(phi|theta|psi|[pqr]|[wg][xyz])([^a-z]|$)|omega|quat|angular")
_SENSOR = re.compile(r"imu|gyr|att|orient|euler")
_NUMBERED = re.compile(r"(?P<topic>.*?)(?:_|\[)(?P<number>\d{1,2})\]?")


def read_folder(path: Path) -> RawLog:
    """Read a folder's tables; an autopilot's topics are known by their files' names, ``log_vehicle_attitude_0``."""
    tables = tables_in(path)
    if sum(table.stat().st_size for table in tables) > LARGEST_FILE_BYTES:
        raise InputError(f"{path}: its tables have more than {LARGEST_FILE_BYTES} bytes; at most so many are read")
    topics = {table: _topic(_name(table)) for table in tables}
    known = _of_autopilot(tables)
    series: list[RawSeries] = []
    left_out = []
    for table in known or tables:
        try:
            read = read_csv(table)
        except InputError:
            left_out.append(table.name)
            continue
        for topic, own in _by_instance(topics[table], {each.name: each for each in read.series}):
            columns = {
                name: replace(each, name=f"{topic}.{each.name}", clock=topic, meaning=ALL.get((topic, each.name)))
                for name, each in own.items()
            }
            series += columns.values()
            parts = [columns[name] for name in _QUATERNION if name in columns]
            if len(parts) == len(_QUATERNION) and topic in {name for name, _ in PX4}:
                series += angles_of(parts, f"{topic}.q", [ALL.get((topic, f"q({angle})")) for angle in ANGLES])
    if not series:
        raise InputError(f"{path}: none of its tables can be read")
    notes = [f"tables: {', '.join(sorted({each.clock for each in series})[:20])}"]
    if left_out:
        notes.append(f"not read: {', '.join(left_out[:12])}")
    if not known:
        is_asl = tables[0].stem == _DATA and any(_ASL in each.name for each in series)  # one flight's by its layout
        return RawLog(kind="folder of an ASL data set" if is_asl else TABLES, series=tuple(series), notes=tuple(notes))
    return RawLog(
        kind="folder of an autopilot's tables",
        series=tuple(map(_with_px4_time, documented_first(series, ALL))),
        notes=(*notes, "units and axes are those of the autopilot's documentation"),
        by_name=False,
        attitude_from_gyros=True,
        events=partial(_px4_events, tables),
    )


def _px4_events(tables: Sequence[Path]) -> list[Event]:
    """Return what PX4's tables tell beside the sensors: resets, take-off and touchdown, arming, failures."""
    topics: dict[str, dict[str, NDArray[Any]]] = {}
    for table in tables:
        topic = next((name for name in TOLD_BY if re.fullmatch(rf"(.*_)?{name}(_0)?", table.stem)), "")
        if topic:
            with suppress(InputError):
                topics[topic] = {each.name: each.load() for each in read_csv(table).series}
    timed = {topic: fields for topic, fields in topics.items() if "timestamp" in fields}
    return ulog_events(timed, {topic: fields["timestamp"] / _PX4_PER_SECOND for topic, fields in timed.items()})


def _by_instance(topic: str, own: dict[str, RawSeries]) -> Iterator[tuple[str, dict[str, RawSeries]]]:
    """Give a table's columns: of each sensor by itself where a column ``I`` says which of several a row is of."""
    number = own["I"].values() if "I" in own and topic in _TOPICS else np.zeros(0)
    which = np.unique(number[np.isfinite(number)])
    if len(which) < 2 or len(which) > _MOST_INSTANCES or np.any(which != np.rint(which)):
        yield topic, own
        return
    for each in which.tolist():
        rows = np.flatnonzero(number == each)
        name = f"{topic}#{int(each)}" if each else topic
        yield (
            name,
            {
                column: replace(series, load=partial(lambda of, at: of.load()[at], series, rows))
                for column, series in own.items()
            },
        )


def _with_px4_time(column: RawSeries) -> RawSeries:
    is_time = _of(column.clock) in _PX4_TOPICS and column.name == f"{column.clock}.timestamp"
    return replace(column, meaning=_PX4_TIME) if is_time else column


def _topic(stem: str) -> str:
    """Return what a table tells of: a topic that is known, a second instance as ``IMU#1``, else its own name.

    >>> _topic("09_26_30_sensor_combined_0"), _topic("IMU"), _topic("IMU_1"), _topic("baro")
    ('sensor_combined', 'IMU', 'IMU#1', 'baro')
    """
    return _split(stem)[1]


def _split(stem: str) -> tuple[str, str]:
    """Return what stands before a table's topic, by which an exporter names a log, and the topic.

    >>> _split("09_26_30_sensor_combined_0"), _split("IMU_1"), _split("baro")
    (('09_26_30_', 'sensor_combined'), ('', 'IMU#1'), ('', 'baro'))
    """
    numbered = _NUMBERED.fullmatch(stem)
    bare, number = (numbered["topic"], int(numbered["number"])) if numbered else (stem, 0)
    for name in sorted(_TOPICS, key=len, reverse=True):
        if bare == name or bare.endswith(f"_{name}"):
            return bare.removesuffix(name), f"{name}#{number}" if number else name
    return "", stem


def _of(topic: str) -> str:
    return topic.partition("#")[0]


def tables_in(path: Path) -> list[Path]:
    """Return a folder's tables: its CSVs, or texts where it has none, or a ``data.csv`` a sensor as ASL has them."""
    root = path / _MAV if (path / _MAV).is_dir() else path
    found: list[Path] = []
    for pattern in ("*.csv", "*.txt", f"*/{_DATA}.csv"):
        found = found or [table for table in root.glob(pattern) if table.is_file() and not table.name.startswith(".")]
    return sorted(found)


def _name(table: Path) -> str:
    return table.parent.name if table.stem == _DATA else table.stem


def is_folder_of_tables(path: Path) -> bool:
    """Tell whether tables are by their names one flight's: an autopilot's, or called by sensors, each once."""
    tables = tables_in(path)[: MOST_TABLES + 1]
    if not 2 <= len(tables) <= MOST_TABLES:
        return False
    known = _of_autopilot(tables)
    if known:
        return _is_one_export(known) and not any(_is_foreign(table, known) for table in tables if table not in known)
    bare = [re.sub(r"\d", "", _name(table).lower()) for table in tables]
    return len(set(bare)) == len(bare) and any(map(_SENSOR.search, bare))


def _of_autopilot(tables: Sequence[Path]) -> list[Path]:
    """Return the tables of topics that are known; none where they are of one topic, which anybody may use as a name."""
    known = [table for table in tables if _of(_topic(table.stem)) in _TOPICS]
    return known if len({_of(_topic(table.stem)) for table in known}) > 1 else []


def _is_one_export(known: Sequence[Path]) -> bool:
    """Tell whether an exporter wrote these tables of one log: it puts the log's name before every topic.

    Several topics may hold the same channel, and several numbers of a topic are several sensors. A longer beginning is
    a longer topic's, such as ``log_sim_airspeed`` or ``SCALED_IMU2``, unless the same gyros or angles are there without
    it.
    """
    named = [_split(table.stem) for table in known]
    log = min((before for before, _ in named), key=len)
    turning = [
        topic for before, topic in named if _of(topic) in _TURNING and (before == log or not _MESSAGE.fullmatch(before))
    ]
    return all(before.startswith(log) for before, _ in named) and len(set(turning)) == len(turning)


def _is_foreign(table: Path, known: Sequence[Path]) -> bool:
    """Tell whether a table beside an export is another log: it isn't named as the export's are, and tells rotation."""
    log = min((_split(each.stem)[0] for each in known), key=len)
    if table.stem.startswith(log) if log else _MESSAGE.fullmatch(table.stem):
        return False
    columns = _columns_of(table)
    is_alike = not log and columns[:1] in [_columns_of(each)[:1] for each in known]
    return not is_alike and any(map(_ROTATION.search, columns))


def _columns_of(table: Path) -> tuple[str, ...]:
    try:
        with reading(table, "CSV table"):
            return layout_of(table).names
    except InputError:
        return ()


FORMAT = Format(name=TABLES, magic=(), suffixes=(), read=read_folder, is_folder=is_folder_of_tables)

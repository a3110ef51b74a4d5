"""Folders that are one log: tables of a flight, as exporters write them, and what published data sets have.

Exporters (ulog2csv, mavlogdump) write a file a topic, each with its own time. ALFA (Keipour, Mousaei and Scherer 2021,
a dataset for UAV fault and anomaly detection): a file is a topic, ``SEQUENCE-mavros-imu-data.csv``, whose columns are
those of the ROS message; ``SEQUENCE-failure_status-engines.csv`` and others say when engine or surfaces had failed.
KITTI's oxts: a file a sample, thirty numbers by their places, and the times of all in another file.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.events import Event
from gtmbench.intake.formats.clock_texts import clock_texts
from gtmbench.intake.formats.csv import layout_of, read_csv
from gtmbench.intake.formats.dialects import ALL, PX4, angles_of, dialects
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES, check_values, reading
from gtmbench.intake.formats.raw import ANGLES, Format, Meaning, RawLog, RawSeries, documented_first, in_seconds
from gtmbench.intake.formats.rosbag import NOTE, topic_series
from gtmbench.intake.formats.ulog import TOLD_BY, ulog_events
from gtmbench.intake.published_failures import Injection, injected, spells
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray

_PX4_TOPICS = {topic for topic, _ in PX4} | {
    "vehicle_gps_position",
    "sensor_gps",
    "vehicle_magnetometer",
    "sensor_mag",
    "sensor_gyro",
}
# those of gyros and attitude, and sensors beside them
_TOPICS = {topic for topic, _ in ALL} | _PX4_TOPICS | {"MAG", "MAG2", "MAG3", "IMU2", "IMU3", "BARO", "ARSP"}
_PX4_TIME = Meaning(channel="time", unit="us")  # since boot: after ten minutes of it a table can't tell
TABLES = "folder of tables"  # anybody's: their contents have to show that they are one flight's
_QUATERNION = tuple(f"q[{part}]" for part in range(4))  # PX4's names
_MAV, _DATA = "mav0", "data"  # ASL's folder, and what a table is called whose folder has the sensor's name
_ASL = "_RS_"  # in its columns: from the reference to the sensor
MOST_TABLES, _MOST_INSTANCES = 300, 6  # of a flight; and sensors of a kind in one table
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
    return ulog_events(timed, {topic: fields["timestamp"] / 1e6 for topic, fields in timed.items()})


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


_ALFA = "sequence of ALFA"
_IMU, _FAILED = "mavros-imu-data", "failure_status-"
_FIELD = ("field.", ".")  # what stands before a message's own names, by the tool that wrote it
_KINDS = {"engine": "off", "engines": "off"}  # of a surface it is stuck
_MOST_MESSAGES = 100_000  # that are looked at of a failure


def read_alfa(path: Path) -> RawLog:
    """Read the tables of a sequence; those that hold no numbers by time are left out."""
    sequence, tables = _sequence(path)
    if sum(table.stat().st_size for table in tables.values()) > LARGEST_FILE_BYTES:
        raise InputError(f"{path}: its tables have more than {LARGEST_FILE_BYTES} bytes; at most so many are read")
    stamps: dict[str, NDArray[np.int64]] = {}
    columns: dict[str, dict[str, FloatArray]] = {}
    for topic, table in tables.items():
        told = _read(table)
        if told is not None:
            stamps[topic], columns[topic] = told
    if _IMU not in stamps:
        raise InputError(f"{path}: {sequence}-{_IMU}.csv holds no stamped numbers; it should be ALFA's table")
    check_values(sum(map(len, stamps.values())), "its stamps")
    clocks, since = in_seconds(stamps, 1e9)
    failed = {topic: columns.pop(topic) for topic in list(columns) if topic.startswith(_FAILED)}
    series = [
        column
        for topic, fields in columns.items()
        for column in topic_series(
            topic, {name: partial(np.asarray, values) for name, values in fields.items()}, is_imu=topic == _IMU
        )
    ]
    left_out = sorted(set(tables) - set(stamps))
    notes = [NOTE, *since, *([f"left out: {', '.join(left_out[:12])}"] if left_out else [])]
    return RawLog(
        kind=_ALFA,
        series=tuple(series),
        clocks={topic: clock for topic, clock in clocks.items() if topic in columns},
        notes=tuple(notes),
        by_name=False,
        attitude_from_gyros=True,
        injections=partial(_injections, failed, clocks),
    )


def _sequence(path: Path) -> tuple[str, dict[str, Path]]:
    """Return a folder's sequence and its tables by topic; empty where it isn't one."""
    found = sorted(path.glob(f"*-{_IMU}.csv"))
    if len(found) != 1:
        return "", {}
    sequence = found[0].name.removesuffix(f"-{_IMU}.csv")
    return sequence, {
        table.stem.removeprefix(f"{sequence}-"): table for table in sorted(path.glob(f"{sequence}-*.csv"))[:200]
    }


def _read(table: Path) -> tuple[NDArray[np.int64], dict[str, FloatArray]] | None:
    """Return a table's stamps in nanoseconds, and its columns of numbers; None where no column tells the time."""
    fields: dict[str, RawSeries] = {}
    with suppress(InputError):  # without rows
        fields = {_bare(each.name): each for each in read_csv(table).series}
    stamps = _stamps(fields)
    if stamps is None:
        return None
    return stamps, {
        name: each.values() for name, each in fields.items() if not (each.told or name.startswith(("header.", "time")))
    }


def _bare(name: str) -> str:
    """Return a message's own name of a field.

    >>> _bare("field.angular_velocity.x"), _bare(".angular_velocity.x"), _bare("time")
    ('angular_velocity.x', 'angular_velocity.x', 'time')
    """
    return next((name.removeprefix(before) for before in _FIELD if name.startswith(before)), name)


def _stamps(fields: Mapping[str, RawSeries]) -> NDArray[np.int64] | None:
    """Return when messages were made, or recorded where that isn't said, in whole nanoseconds."""
    told = {name: each.load() for name, each in fields.items() if name.startswith(("header.stamp", "time"))}
    if "header.stamp.secs" in told and (told["header.stamp.secs"] > 0).all():
        return np.asarray(told["header.stamp.secs"] * 10**9 + told["header.stamp.nsecs"], dtype=np.int64)
    if "header.stamp" in told and (told["header.stamp"] > 0).all():
        return np.asarray(told["header.stamp"], dtype=np.int64)
    if "time" not in told:
        return None
    since_ns = round(1e6 * fields["time"].since_s) * 1000
    return np.asarray(since_ns + np.rint(1e9 * told["time"]) if fields["time"].told else told["time"], dtype=np.int64)


def _injections(failed: Mapping[str, Mapping[str, Any]], clocks: Mapping[str, FloatArray]) -> list[Injection]:
    """Return what had failed, from the first message that says so; a table that ends so lasts."""
    found = []
    for topic, fields in failed.items():
        what = topic.removeprefix(_FAILED)
        values = fields.get("data", np.zeros(0))[:_MOST_MESSAGES]
        changes = list(zip(clocks[topic][: len(values)].tolist(), values.tolist(), strict=True))
        for onset_s, end_s, value in spells(changes, 0.0):
            kind = _KINDS.get(what, "stuck")
            said = f"failure_status-{what} {value:g}"
            found.append(injected(what, None, kind, (onset_s, end_s), said))
    return found


def is_alfa(path: Path) -> bool:
    """Tell whether a folder is a sequence of ALFA: the table of its IMU, and others of the same sequence."""
    return len(_sequence(path)[1]) > 1


_KITTI = "KITTI's oxts"
_FIRST = "0000000000.txt"


def read_kitti(path: Path) -> RawLog:
    """Read a drive's samples."""
    root = _drive(path)
    assert root is not None  # it was asked for
    with reading(path, _KITTI):
        names = sorted((root / "data").glob("*.txt"))
        rows = [name.read_text(encoding="ascii").split() for name in names]
        check_values(sum(map(len, rows)), "its samples")
        values = np.array(rows, dtype=np.float64)
        told = clock_texts((root / "timestamps.txt").read_text(encoding="ascii").splitlines())
        if told is None or values.ndim != 2 or len(told.seconds) != len(values):
            raise InputError(f"{len(values)} samples and {0 if told is None else len(told.seconds)} times don't match")
    series = tuple(
        RawSeries(name=str(place), load=partial(np.asarray, column)) for place, column in enumerate(values.T, 1)
    )
    raw = RawLog(
        kind=_KITTI, series=series, clocks={"": np.asarray(told.seconds)}, notes=(told.note,), is_nameless=True
    )
    known = [dialect for dialect in dialects() if dialect.name == _KITTI and dialect.found_in(raw)]
    return known[0].told_of(raw) if known else raw


def _drive(path: Path) -> Path | None:
    """Return the folder with the samples and their times; None where there is none."""
    return next((root for root in (path, path / "oxts") if (root / "data" / _FIRST).is_file()), None)


def is_kitti(path: Path) -> bool:
    """Tell whether a folder is a drive's oxts, or holds one."""
    root = _drive(path)
    return root is not None and (root / "timestamps.txt").is_file()


KITTI = Format(name=_KITTI, magic=(), suffixes=(), read=read_kitti, is_folder=is_kitti)
ALFA = Format(name=_ALFA, magic=(), suffixes=(), read=read_alfa, is_folder=is_alfa)

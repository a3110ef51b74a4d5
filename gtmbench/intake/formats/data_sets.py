"""Published data sets whose logs are folders: ALFA's sequences of topics, and KITTI's drives.

ALFA (Keipour, Mousaei and Scherer 2021, a dataset for UAV fault and anomaly detection): a file is a topic,
``SEQUENCE-mavros-imu-data.csv``, whose columns are those of the ROS message; ``SEQUENCE-failure_status-engines.csv``
and others say when engine or surfaces had failed. KITTI's oxts: a file a sample, thirty numbers by their places, and
the times of all in another file.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.formats.clock_texts import clock_texts
from gtmbench.intake.formats.csv import read_csv
from gtmbench.intake.formats.dialects import dialects
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES, check_values, reading
from gtmbench.intake.formats.raw import Format, RawLog, RawSeries, in_seconds
from gtmbench.intake.formats.rosbag import NOTE, topic_series
from gtmbench.intake.injections import Injection, injected, spells
from gtmbench.values.clock import FloatArray

_KIND = "sequence of ALFA"
_IMU, _FAILED = "mavros-imu-data", "failure_status-"
_MOST_TABLES = 200
_FIELD = ("field.", ".")  # what stands before a message's own names, by the tool that wrote it
_KINDS = {"engine": "off", "engines": "off"}  # of a surface it is stuck
_MOST_MESSAGES = 100_000


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
        kind=_KIND,
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
        table.stem.removeprefix(f"{sequence}-"): table
        for table in sorted(path.glob(f"{sequence}-*.csv"))[:_MOST_TABLES]
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
ALFA = Format(name=_KIND, magic=(), suffixes=(), read=read_alfa, is_folder=is_alfa)

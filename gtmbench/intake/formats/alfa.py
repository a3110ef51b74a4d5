"""ALFA: a folder of a sequence's topics as tables, with the failures of engine and control surfaces.

Keipour, Mousaei and Scherer 2021 (ALFA: a dataset for UAV fault and anomaly detection). A file is a topic:
``SEQUENCE-mavros-imu-data.csv``, whose columns are those of the ROS message; ``SEQUENCE-failure_status-engines.csv``
and others say when something had failed.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import LARGEST_FILE_BYTES, check_columns, check_values, reading
from gtmbench.intake.formats.raw import Format, RawLog, in_seconds
from gtmbench.intake.formats.ros import NOTE, topic_series
from gtmbench.intake.injections import Injection, spells
from gtmbench.values.clock import FloatArray

if TYPE_CHECKING:
    import pandas as pd

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
        with reading(table, "table of ALFA"):
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
            topic,
            {name: partial(np.asarray, values) for name, values in fields.items()},
            is_imu=topic == _IMU,
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
    import pandas as pd

    frame = pd.read_csv(table, index_col=False)
    check_columns([str(name) for name in frame.columns])
    check_values(frame.size, "the table")
    fields = {_bare(str(name)): column for name, column in frame.items()}
    stamps = _stamps(fields)
    if stamps is None or not len(stamps):
        return None
    numbers = {
        name: column.to_numpy(dtype=np.float64)
        for name, column in fields.items()
        if column.dtype.kind in "bif" and not name.startswith(("header.", "%", "time"))
    }
    return stamps, numbers


def _bare(name: str) -> str:
    """Return a message's own name of a field.

    >>> _bare("field.angular_velocity.x"), _bare(".angular_velocity.x"), _bare("%time")
    ('angular_velocity.x', 'angular_velocity.x', '%time')
    """
    return next((name.removeprefix(before) for before in _FIELD if name.startswith(before)), name)


def _stamps(fields: Mapping[str, pd.Series]) -> NDArray[np.int64] | None:
    """Return when messages were made, or recorded where that isn't said, in whole nanoseconds."""
    whole, seconds = fields.get("header.stamp"), fields.get("header.stamp.secs")
    if seconds is not None and seconds.dtype.kind == "i" and (seconds > 0).all():
        return np.asarray(seconds.to_numpy() * 10**9 + fields["header.stamp.nsecs"].to_numpy())
    if whole is not None and whole.dtype.kind == "i" and (whole > 0).all():
        return np.asarray(whole.to_numpy(dtype=np.int64))
    recorded = fields.get("%time", fields.get("time"))
    if recorded is None:
        return None
    if recorded.dtype.kind == "i":
        return np.asarray(recorded.to_numpy(dtype=np.int64))
    return _dates(recorded)


def _dates(recorded: pd.Series) -> NDArray[np.int64]:
    """Return dates as nanoseconds since 1970: ``2018/07/18/15:56:50.963310``."""
    import pandas as pd

    texts = recorded.astype(str).str.replace(r"^(\d+)[/-](\d+)[/-](\d+)[/ T]", r"\1-\2-\3 ", regex=True)
    dates = pd.to_datetime(texts, format="ISO8601")
    return np.asarray(dates.to_numpy(dtype="datetime64[ns]").astype(np.int64))


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
            found.append(
                Injection(sensor=what, number=None, channels=(), kind=kind, onset_s=onset_s, end_s=end_s, text=said)
            )
    return found


def is_alfa(path: Path) -> bool:
    """Tell whether a folder is a sequence of ALFA: the table of its IMU, and others of the same sequence."""
    return len(_sequence(path)[1]) > 1


FORMAT = Format(name=_KIND, magic=(), suffixes=(), read=read_alfa, is_folder=is_alfa)

"""A log's file as it was read: once, for whoever opens it, for whatever channels and at whatever rate.

Attitudes as quaternions have angles beside them. Tables that are called by sensors are one flight's, unless the same
sensor is in two of them, or their times don't overlap: one recorder holds a sensor once, and begins and ends all of its
tables together. An autopilot's are judged by their names, which its exporter gives them (`formats.folder`).
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations
from pathlib import Path

import numpy as np

from gtmbench.checks import one_line
from gtmbench.errors import InputError
from gtmbench.intake.formats import registry
from gtmbench.intake.formats.dialects import angles_of, dialects, indexed
from gtmbench.intake.formats.raw import Meaning, RawLog, RawSeries
from gtmbench.intake.formats.registry import read_raw, split_part
from gtmbench.intake.formats.table_folder import TABLES, is_folder_of_tables, tables_in
from gtmbench.intake.mapping import judged
from gtmbench.intake.names import guess, stated_unit, triples
from gtmbench.intake.open_columns import tells_of_one_motion
from gtmbench.intake.times import main_span, with_time
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS, SENSORS
from gtmbench.values.record import Span


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadLog:
    """What was read of a log's file."""

    path: Path
    # Its columns, attitudes of quaternions among them. What a format loads column by column is loaded when it is
    # asked for.
    raw: RawLog = field(repr=False)


def read_log(log: str | Path | ReadLog) -> ReadLog:
    """Read a log's file; what was read before is returned as it is.

    Raises an InputError where it isn't a file, is too large, isn't of a known format, or is broken; or holds tables of
    several logs.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "log.csv").write_text("time_s,p_deg_s" + chr(10) + "0,1.0" + chr(10) + "1,2.0")
    ...     read = read_log(Path(folder, "log.csv"))
    >>> [series.name for series in read.raw.series], read_log(read) is read
    (['time_s', 'p_deg_s'], True)
    """
    if isinstance(log, ReadLog):
        return log
    path, part = split_part(log)
    raw = read_raw(path, part)
    if why := why_several(raw):
        raise InputError(f"{path} holds the tables of several logs, for {why}; give its tables one by one")
    return ReadLog(path=path, raw=with_quaternions(_by_its_width(raw)))


def _by_its_width(raw: RawLog) -> RawLog:
    """Return a table without a header as a known source writes one as wide, where gyros and attitude agree."""
    for dialect in dialects():
        if raw.is_nameless and dialect.found_in(raw):
            told = dialect.told_of(raw)
            with suppress(InputError), np.errstate(all="ignore"):
                if tells_of_one_motion(with_time(told, None)):
                    return told
    return raw


_TOGETHER = 0.5  # of the shorter of two tables; chosen: those of one recorder begin and end together
_OTHER_SENSOR = re.compile(r"gps|gnss|mag|compass")  # its heading isn't the attitude's
_SENSOR_NAMED = re.compile(r"gyr|linear|acc|mag|imu|ahrs|att|orient|euler|baro|press|gps|gnss|air|pitot")
_AXES = {"rate": GYROS, "angle": ATTITUDE, "acceleration": ACCELEROMETERS}


@dataclass(frozen=True, kw_only=True)
class _Table:
    """What a table holds."""

    name: str
    channels: frozenset[str]  # the sensors that its columns look like, whether or not their units are known
    columns: frozenset[str]  # the bare names of its columns, the time's left out
    span_s: Span | None  # when it runs, on a clock that its log's tables share; None where no column tells the time

    @property
    def kind(self) -> str:
        """The sensor by which it is called, "" where its name says none."""
        named = _SENSOR_NAMED.search(self.name.lower())
        return named[0] if named else ""


def is_log_folder(path: Path) -> bool:
    """Tell whether a folder is one log: by its names, and by what its tables hold.

    >>> import tempfile
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     _ = Path(folder, "failed.csv").write_text("time_s,p_deg_s" + chr(10) + "0,1.0" + chr(10) + "1,2.0")
    ...     _ = Path(folder, "gyros.csv").write_text("time_s,gx_rad_s" + chr(10) + "0,1.0" + chr(10) + "1,2.0")
    ...     is_log_folder(Path(folder)), why_several_in(Path(folder))
    (False, 'failed and gyros both hold p')
    """
    return registry.is_log_folder(path) and not why_several_in(path)


def why_several_in(path: Path) -> str:
    """Return what shows that a folder's tables are several logs; "" where nothing does, or it can't be read."""
    try:
        if not is_folder_of_tables(path):
            return ""
        files = [(str(each), each.stat().st_size, each.stat().st_mtime_ns) for each in tables_in(path)]
    except OSError:
        return ""
    return _why_several_of(path, tuple(sorted(files)))


@lru_cache(maxsize=512)  # folders
def _why_several_of(path: Path, _files: tuple[tuple[str, int, int], ...]) -> str:
    """Read a folder's tables once, for as long as its files stay as they are."""
    try:
        return why_several(registry.read_raw(path))
    except InputError:  # whoever opens it is told
        return ""


def why_several(raw: RawLog) -> str:
    """Return what shows that the tables of a log are several logs, in a few words; "" where nothing does."""
    if not raw.kind.endswith(TABLES):
        return ""
    with np.errstate(all="ignore"):
        tables = _tables_of(with_quaternions(raw))
    reasons = (_why_apart(one, other) for one, other in combinations(tables, 2))
    return next((one_line(reason) for reason in reasons if reason), "")


def _tables_of(raw: RawLog) -> list[_Table]:
    timed = raw
    with suppress(InputError):  # no table tells its time
        timed = with_time(raw, None)
    channels: dict[str, set[str]] = {series.clock: set() for series in raw.series}
    columns: dict[str, set[str]] = {name: set() for name in channels}
    unknown = []
    for series in raw.series:
        channel = judged(series, raw).channel
        own = {channel} & _measured_once(series.clock)
        channels[series.clock] |= {f"{each} (quaternion)" for each in own} if series.made_of else own
        unknown += [] if channel else [series]
        if channel != "time":
            columns[series.clock].add(stated_unit(series.name.removeprefix(f"{series.clock}."))[0].lower())
    for triple in triples([series for series in unknown if not series.made_of]):
        channels[triple.clock] |= {*_AXES[triple.kind]} & _measured_once(triple.clock)
    return [
        _Table(
            name=name, channels=frozenset(channels[name]), columns=frozenset(columns[name]), span_s=_span_s(timed, name)
        )
        for name in channels
    ]


def _measured_once(name: str) -> set[str]:
    """Return the channels that show which log a table is of: a flight has one sensor of each."""
    others = ["psi"] if _OTHER_SENSOR.search(name.lower()) else []
    others += ACCELEROMETERS if "linear" in name.lower() else ()  # a phone's, worked out: without gravity
    return {*SENSORS} - {"altitude", *others}


def _span_s(timed: RawLog, name: str) -> Span | None:
    stamps = timed.clocks.get(name, np.zeros(0))
    known = stamps[np.isfinite(stamps)]
    return main_span(known) if len(known) else None


def _why_apart(one: _Table, other: _Table) -> str:
    """Return what shows that two tables are of two logs, "" where nothing does."""
    both = one.channels & other.channels
    if both:
        return f"{one.name} and {other.name} both hold {_listed(both)}"
    is_part = one.columns and other.columns and (one.columns <= other.columns or other.columns <= one.columns)
    if one.kind and one.kind == other.kind and is_part:
        return f"{one.name} and {other.name} are both called {one.kind} and have the same columns"
    if not (one.channels and other.channels and one.span_s and other.span_s):
        return ""
    together_s = min(one.span_s[1], other.span_s[1]) - max(one.span_s[0], other.span_s[0])
    shorter_s = min(end_s - start_s for start_s, end_s in (one.span_s, other.span_s))
    if 0.0 <= together_s >= _TOGETHER * shorter_s:
        return ""
    told = [
        f"{table.name} runs from {table.span_s[0]:.10g} to {table.span_s[1]:.10g} s"
        for table in (one, other)
        if table.span_s
    ]
    return f"{' and '.join(told)}: their clocks don't agree, or they were recorded one after the other"


def _listed(channels: frozenset[str]) -> str:
    return ", ".join(sorted(channels, key=lambda name: SENSORS.index(name.split()[0])))


_QUATERNION = re.compile(
    r"(?i)(?P<stem>.{0,200}?(?:(?<![a-z])q|quat|quaternion|orientation|attitude)[_.]?)(?P<part>[wxyz0-3]|\[[0-3]\])"
)
_OF_ROS = re.compile(r"(?i)orientation|pose")  # where axes point forward, left and up


def with_quaternions(raw: RawLog) -> RawLog:
    """Return a table with roll, pitch and yaw of every quaternion that it has, as columns ``q(roll)`` in deg.

    Named ``qw, qx, qy, qz``, ``q0`` to ``q3`` or ``q[0]`` to ``q[3]``, w first, from the body (forward, right, down) to
    the world, they are channels where no other column is; what is named as ROS names it may point left and up, and has
    to be mapped.
    """
    if not raw.by_name:
        return raw
    told = {(series.meaning or guess(series.name, series.unit)).channel for series in raw.series}
    names = {series.name for series in raw.series}
    added, notes = [], []
    found = list(_quaternions(raw))
    only = len([stem for stem, _ in found if not _OF_ROS.search(stem)]) == 1  # of several none is preferred
    for stem, parts in found:
        if f"{stem.rstrip('_.')}(roll)" in names:  # its format has made them already
            continue
        known = only and not _OF_ROS.search(stem) and not told & set(ATTITUDE)
        meanings = [Meaning(channel=channel, unit="deg") if known else None for channel in ATTITUDE]
        made = angles_of(parts, stem.rstrip("_."), meanings)
        added += made
        if known:
            first, *_, last = made[0].made_of
            notes.append(
                f"{first} ... {last}: taken as a quaternion from body (forward, right, down) to world, w first"
            )
            told |= set(ATTITUDE)
    return replace(raw, series=(*raw.series, *added), notes=(*raw.notes, *notes)) if added else raw


def _quaternions(raw: RawLog) -> Iterator[tuple[str, list[RawSeries]]]:
    """Yield the quaternions of a log: what their columns' names begin with, and w, x, y, z."""
    by_stem: dict[tuple[str, str], dict[str, RawSeries]] = {}
    for series in raw.series:
        named = _QUATERNION.fullmatch(indexed(series.name))
        if named:
            by_stem.setdefault((named["stem"], series.clock), {})[named["part"].strip("[]").lower()] = series
    for (stem, _), parts in by_stem.items():
        for names in ("wxyz", "0123"):
            if set(names) <= set(parts):
                yield stem, [parts[name] for name in names]
                break


# of ArduPilot's LogStructure.h (IMU), PX4's SensorGyro.msg and SensorAccel.msg, MAVLink's RAW_IMU and HIGHRES_IMU
_WARM = re.compile(
    r"IMU(?:1|[_\[]0\]?)?\.(?:T|Temp)|sensor_gyro\.temperature|sensor_accel\.temperature|(?P<hundredths>(?:RAW|SCALED)_IMU)"
    r"\.temperature|HIGHRES_IMU\.temperature"
)
_LONGEST = 100  # characters of a name


def airframe_of(read: ReadLog) -> str:
    """Return whose log it is: by the hardware's identifier in it, else the name of its folder.

    >>> from gtmbench.intake.formats.raw import RawLog
    >>> airframe_of(ReadLog(path=Path("T2/7.bin"), raw=RawLog(kind="", series=(), hardware="0034 3235")))
    '0034 3235'
    >>> airframe_of(ReadLog(path=Path("T2/7.bin"), raw=RawLog(kind="", series=())))
    'T2'
    """
    found = read.raw.hardware or Path(read.path).resolve().parent.name or "aircraft"
    return one_line(found)[:_LONGEST]


def temperature_c(read: ReadLog) -> float:
    """Return how warm the IMU of a log was, the median in deg C; NaN where that isn't logged."""
    for series in read.raw.series:
        found = _WARM.fullmatch(series.name)
        if found is None:
            continue
        values = series.values()
        values = values[np.isfinite(values) & (values != 0.0)]  # 0: none is built in
        middle = float(np.median(values)) if len(values) else float("nan")
        middle = 0.01 * middle if found["hundredths"] else middle
        if -60.0 < middle < 125.0:  # electronics work there
            return middle
    return float("nan")

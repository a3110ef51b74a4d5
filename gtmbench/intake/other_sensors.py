"""The sensors of a log that no gyro enters, each with stamps of its own, beside any record of the log.

Magnetometers, GPS velocity, accelerometers, airspeed and pressure altitude, as sensors read them: where an autopilot
also logs what its estimator made of them (`vehicle_global_position`, ``POS``), that isn't taken. Readings are kept as
they are, also those that repeat themselves because the sensor is stuck. A GPS loses its fix at once where its receiver
restarts or is cut off: a hidden sky takes satellite after satellite, and not five or more between two messages.

No channel of a bank is made of magnetometers. They are asked which is wrong, the yaw gyro or the heading, and whoever
asks learns their scale and their iron on what is healthy: so their unit doesn't matter. Axes are taken for the gyros';
one that has others knows the yaw rate badly there, and then says so.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.formats.dialects import lines_of
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.mapping import NONE, choose_of, mapped_axes, split_mapping
from gtmbench.intake.names import stated_unit
from gtmbench.intake.read import ReadLog
from gtmbench.intake.stamps import cleaned_alone
from gtmbench.intake.times import with_time
from gtmbench.intake.units import unit
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY, MAGNETOMETER, limit_of
from gtmbench.values.ranges import OutOfRange, out_of_range
from gtmbench.values.record import BoolArray, FloatArray, Record, runs, with_columns

_ENOUGH = 5  # satellites: fewer may be hidden between two messages


class LostFix(NamedTuple):
    """A fix that was lost at once: since the last message with one, until the next with one, or the last message."""

    start_s: float
    end_s: float
    satellites: int


def lost_fixes(time_s: FloatArray, has_fix: BoolArray, satellites: FloatArray) -> tuple[LostFix, ...]:
    """Return when a GPS lost all of its satellites between two messages.

    >>> time_s = np.arange(8.0)
    >>> at_once = np.array([9, 9, 9, 0, 0, 0, 9, 9])
    >>> lost_fixes(time_s, at_once > 4, at_once)
    (LostFix(start_s=2.0, end_s=6.0, satellites=9),)
    >>> one_by_one = np.array([9, 7, 5, 3, 2, 0, 0, 0])
    >>> lost_fixes(time_s, one_by_one > 4, one_by_one)
    ()
    """
    known = np.isfinite(time_s)
    time_s, has_fix, satellites = time_s[known], has_fix[known], satellites[known]
    starts, stops = runs(np.asarray(~has_fix))
    return tuple(
        LostFix(float(time_s[start - 1]), float(time_s[min(stop, len(time_s) - 1)]), int(satellites[start - 1]))
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True)
        if start > 0 and satellites[start - 1] >= _ENOUGH and satellites[start] == 0
    )


_FIX_3D = 3  # PX4's fix_type and ArduPilot's Status alike
_FEWEST = 20  # readings
_MOST = 3  # magnetometers
_FASTER = 0.75  # of a row between readings: a row is the mean of its readings
_STANDS = 1.5  # times the usual step: so long the same is read again
_GAP = 5.0  # times the usual step: nothing is known in between
_PX4_GPS = re.compile(r"(vehicle_gps_position|sensor_gps)(#0)?")
_ARDUPILOT_GPS = re.compile(r"GPS([#_\[]0\]?)?")


@dataclass(frozen=True, kw_only=True, eq=False)
class SensorReadings:
    """What a sensor of a log read."""

    name: str  # the log's topic, ``GPS`` or ``vehicle_air_data``; of a table its columns
    channels: tuple[str, ...]  # which channels it is
    columns: tuple[str, ...]  # the log's, one a channel, or those that they are worked out of
    # On the log's clock, increasing, shape (readings,). Readings that only repeat the one before until the next one
    # comes are left out.
    time_s: FloatArray = field(repr=False)
    values: FloatArray = field(repr=False)  # in the channels' units, shape (readings, channels)
    # whether it is slow and late by itself, as a GPS is: its readings stay in their rows and aren't interpolated
    is_late: bool = False
    # of a GPS that tells its place: how far north and east of its first it is, in m, shape (readings, 2)
    places: FloatArray | None = field(default=None, repr=False)
    lost: tuple[LostFix, ...] = ()  # when it lost its fix at once, of a GPS
    # what was left out, because no sensor reads it
    out_of_range: tuple[OutOfRange, ...] = field(default=(), repr=False)

    @property
    def is_read(self) -> bool:
        """Whether it read anything, beside what is out of range."""
        return len(self.time_s) >= _FEWEST

    def beside(self, record: Record) -> Record:
        """Return a record with the sensor's channels behind its own, NaN in rows without a reading.

        >>> time_s = np.arange(10) * 0.1
        >>> readings = SensorReadings(
        ...     name="BARO",
        ...     channels=("altitude",),
        ...     columns=("BARO.Alt",),
        ...     time_s=time_s,
        ...     values=time_s[:, np.newaxis],
        ... )
        >>> record = Record(np.zeros((2, 1)), channels=["p"], sample_period_s=0.4, start_s=0.2)
        >>> readings.beside(record)["altitude"].round(6).tolist()
        [0.2, 0.6]
        """
        return with_columns(record, self.channels, [self._laid(record)])

    def _laid(self, record: Record) -> FloatArray:
        usual_s = float(np.median(np.diff(self.time_s)))
        if usual_s < _FASTER * record.sample_period_s:
            return self._means(record)
        # readings are interpolated over so many rows; beyond, each stands in its nearest row
        if self.is_late or usual_s > 2.5 * record.sample_period_s:
            return self._nearest(record)
        at_s = record.time_s
        laid = np.column_stack([np.interp(at_s, self.time_s, each) for each in self.values.T])
        behind = np.clip(np.searchsorted(self.time_s, at_s), 1, len(self.time_s) - 1)
        is_gap = self.time_s[behind] - self.time_s[behind - 1] > _GAP * usual_s
        laid[is_gap | (at_s < self.time_s[0]) | (at_s > self.time_s[-1])] = np.nan
        return laid

    def _rows(self, record: Record) -> tuple[BoolArray, NDArray[np.int64]]:
        """Return which readings lie in a record, and their nearest rows."""
        rows = np.rint((self.time_s - record.start_s) / record.sample_period_s)
        within = (rows >= 0) & (rows < len(record))
        return within, rows[within].astype(np.int64)

    def _nearest(self, record: Record) -> FloatArray:
        laid = np.full((len(record), len(self.channels)), np.nan)
        within, rows = self._rows(record)
        laid[rows] = self.values[within]
        return laid

    def _means(self, record: Record) -> FloatArray:
        within, rows = self._rows(record)
        counts = np.bincount(rows, minlength=len(record))
        sums = [np.bincount(rows, each, minlength=len(record)) for each in self.values[within].T]
        return np.where(counts > 0, np.array(sums) / np.maximum(counts, 1), np.nan).T


def other_sensors_of(log: ReadLog, mapping: Sequence[str] = ()) -> tuple[SensorReadings, ...]:
    """Return the sensors of a log that read anything, be it out of range.

    GPS velocity (of PX4 and ArduPilot with a 3-D fix only; of a table gps_north, gps_east and gps_down in m/s),
    accelerometers, airspeed, pressure altitude, and up to three magnetometers.

    `mapping`: as `open_log` takes it: a mapped channel is taken as mapped, and one that is ``none`` isn't.

    >>> import tempfile
    >>> from pathlib import Path
    >>> from gtmbench.intake.read import read_log
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "log.csv")
    ...     rows = (f"{0.1 * k:.1f},{k % 7},{k % 5},1.0,{100 + k}" for k in range(40))
    ...     _ = path.write_text(chr(10).join(["time_s,gps_north,gps_east,gps_down,altitude_ft", *rows]))
    ...     found = other_sensors_of(read_log(path))
    >>> [each.channels for each in found]
    [('gps_north', 'gps_east', 'gps_down'), ('altitude',)]
    """
    mapped = split_mapping(mapping)
    of_time, raw = mapped.pop("time", None), log.raw
    with contextlib.suppress(InputError):  # whoever opens the log says why its time isn't known
        raw = with_time(raw, of_time)
    with np.errstate(all="ignore"):  # broken logs hold signalling NaNs and numbers that overflow
        sensors, fields = (
            [read for each in told if (read := _readings(each, raw))]
            for told in (_sensors(raw, mapped), _magnetometers(raw, mapped))
        )
        return (*sensors, *fields[:_MOST])


class _Columns(NamedTuple):
    """A sensor's channels, the columns on one clock that they are made of, and their values, a column a channel."""

    channels: tuple[str, ...]
    columns: tuple[str, ...]
    clock: str
    values: FloatArray
    name: str = ""
    stamps_s: FloatArray | None = None  # instead of the clock's
    places: FloatArray | None = None
    lost: tuple[LostFix, ...] = ()


def _sensors(raw: RawLog, mapped: Mapping[str, str]) -> Iterator[_Columns]:
    by_name = {series.name: series for series in raw.series}
    gps = _gps(raw, by_name, mapped)
    if gps is not None:
        yield gps
    for channels in (ACCELEROMETERS, ("tas",), ("altitude",)):
        if NONE in (mapped.get(name) for name in channels):
            continue
        documented = None if set(channels) & set(mapped) else _documented(channels[0], by_name)
        if documented is not None:
            yield documented
            continue
        if channels == ("altitude",) and not raw.by_name and "altitude" not in mapped:
            continue  # an autopilot's own altitude, which isn't a sensor's
        chosen = choose_of(channels, raw, mapped)
        if len(chosen) == len(channels) and len({each.series.clock for each in chosen}) == 1:
            read = [each.readings() for each in chosen]
            for values, rows, beyond in read:
                values[rows] = beyond
            columns = np.column_stack([values for values, _, _ in read])
            yield _Columns(channels, tuple(each.series.name for each in chosen), chosen[0].series.clock, columns)


def _documented(channel: str, by_name: Mapping[str, RawSeries]) -> _Columns | None:
    """Return the airspeed or the pressure altitude that an autopilot's sensor reads."""
    for line in lines_of("sensors"):
        (column,), (meaning,) = line.columns, line.meanings
        series, known = by_name.get(column) or by_name.get(column.replace(".", "#0.", 1)), unit(meaning.unit)
        if series is not None and known is not None and meaning.channel == channel:
            return _Columns((channel,), (series.name,), series.clock, series.stored()[:, np.newaxis] * known.factor)
    return None


def _gps(raw: RawLog, by_name: Mapping[str, RawSeries], mapped: Mapping[str, str]) -> _Columns | None:
    """Return the velocity over ground that the first GPS reads."""
    pairs = mapped_axes(raw, GPS_VELOCITY, mapped, "a GPS velocity has three axes, in m/s")
    if pairs is None:
        return None
    if pairs:
        return _of_columns(GPS_VELOCITY, [series for series, _ in pairs], [meaning.sign for _, meaning in pairs])
    if set(GPS_VELOCITY) <= by_name.keys():
        return _of_columns(GPS_VELOCITY, [by_name[name] for name in GPS_VELOCITY], [1.0, 1.0, 1.0])
    for topic in sorted(raw.clocks, key=lambda name: (not name.startswith("vehicle"), name)):
        own = {name: by_name[f"{topic}.{name}"] for name in _GPS_FIELDS if f"{topic}.{name}" in by_name}
        names, stamps_s = _PX4_VELOCITY, None
        if _PX4_GPS.fullmatch(topic) and set(names) <= own.keys():
            read = [own[name].stored() for name in names]
            fix = own["fix_type"].values() >= _FIX_3D if "fix_type" in own else np.isfinite(read[0])
        elif _ARDUPILOT_GPS.fullmatch(topic) and {"Spd", "GCrs", "VZ", "Status"} <= own.keys():
            names = ("Spd", "GCrs", "VZ")
            speed, course = own["Spd"].values(), np.deg2rad(own["GCrs"].values())
            read = [speed * np.cos(course), speed * np.sin(course), own["VZ"].values()]
            fix = own["Status"].values() >= _FIX_3D
            # in logs of 2014 stamps are the GPS's time of week, and T is the time since the start that all others have
            stamps_s = 0.001 * own["T"].values() if "T" in own else None
        else:
            continue
        clock = own[names[0]].clock
        time_s = raw.clocks.get(clock) if stamps_s is None else stamps_s
        counted = next((own[name].values() for name in _SATELLITES if name in own), None)
        return _Columns(
            channels=GPS_VELOCITY,
            columns=tuple(f"{topic}.{name}" for name in names),
            clock=clock,
            values=np.where(fix[:, np.newaxis], np.column_stack(read), np.nan),
            stamps_s=stamps_s,
            places=_places(own, fix),
            lost=() if counted is None or time_s is None else lost_fixes(time_s, fix, counted),
        )
    return None


_PX4_VELOCITY = ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")
_SATELLITES = ("satellites_used", "NSats")
# latitude and longitude, and the factor by which they are deg
_PLACES = {("latitude_deg", "longitude_deg"): 1.0, ("lat", "lon"): 1e-7, ("Lat", "Lng"): 1.0}
_GPS_FIELDS = (*_PX4_VELOCITY, "fix_type", "Spd", "GCrs", "VZ", "Status", "T", *_SATELLITES, *chain(*_PLACES))
_EQUATOR_M, _SQUARED_ECCENTRICITY = 6_378_137.0, 0.00669438  # of the earth (WGS 84)


def _places(own: Mapping[str, RawSeries], fix: BoolArray) -> FloatArray | None:
    """Return how far north and east of its first place a GPS is, in m, NaN without a fix; None if it isn't logged."""
    names = next((names for names in _PLACES if own.keys() >= {*names}), None)
    if names is None or not fix.any():
        return None
    north, east = (np.radians(_PLACES[names] * own[name].values()) for name in names)
    first = int(np.argmax(fix))
    flat = 1.0 - _SQUARED_ECCENTRICITY * np.sin(north[first]) ** 2
    radii_m = _EQUATOR_M / np.sqrt(flat) * np.array([(1.0 - _SQUARED_ECCENTRICITY) / flat, np.cos(north[first])])
    moved = np.column_stack([north - north[first], east - east[first]]) * radii_m
    return np.where(fix[:, np.newaxis], moved, np.nan)


def _of_columns(channels: tuple[str, ...], series: Sequence[RawSeries], signs: Sequence[float]) -> _Columns | None:
    if len({each.clock for each in series}) != 1:
        return None
    values = np.column_stack([each.stored() * sign for each, sign in zip(series, signs, strict=True)])
    return _Columns(channels, tuple(each.name for each in series), series[0].clock, values)


def _readings(told: _Columns, raw: RawLog) -> SensorReadings | None:
    """Return what a sensor read, each reading once; None where it read hardly anything, or when isn't known.

    Readings are whole; those that only repeat the one before are left out.
    """
    if told.clock not in raw.clocks:
        return None
    own = cleaned_alone(raw.clocks[told.clock] if told.stamps_s is None else told.stamps_s)
    if own is None:
        return None
    read = ~np.isnan(told.values[own.rows]).all(axis=1) & np.isfinite(own.time_s)
    time_s, values = own.time_s[read], told.values[own.rows][read]
    places = None if told.places is None else told.places[own.rows][read]
    outside = np.abs(values) > np.array(list(map(limit_of, told.channels)))
    beyond = tuple(
        out_of_range(name, time_s, rows, float(column[rows][0]))
        for name, rows, column in zip(told.channels, outside.T, values.T, strict=True)
        if rows.any()
    )
    whole = np.isfinite(values).all(axis=1) & ~outside.any(axis=1)
    if not whole.all():
        time_s, values = time_s[whole], values[whole]
        places = None if places is None else places[whole]
    is_read = readings_at(time_s, values)
    if np.count_nonzero(is_read) < _FEWEST and not beyond:
        return None
    topics = {column.rpartition(".")[0] for column in told.columns}
    of = topics.pop() if len(topics) == 1 and "" not in topics else ", ".join(told.columns)
    return SensorReadings(
        name=told.name or of,
        channels=told.channels,
        columns=told.columns,
        time_s=time_s[is_read],
        values=values[is_read],
        is_late=told.channels == GPS_VELOCITY,
        places=None if places is None else places[is_read],
        lost=told.lost,
        out_of_range=beyond,
    )


def readings_at(time_s: FloatArray, values: FloatArray) -> BoolArray:
    """Tell which rows hold a reading: a new one, or the same for longer than readings usually stand.

    A logger that is faster than a sensor repeats each reading until the next. A sensor that is stuck repeats one
    for longer, and that is what it reads.

    >>> time_s = np.arange(12.0)
    >>> values = np.array([1.0, 1.0, 2.0, 2.0, 3.0, 3.0, 4.0, 4.0, 4.0, 4.0, 4.0, 4.0])[:, np.newaxis]
    >>> np.flatnonzero(readings_at(time_s, values)).tolist()
    [0, 2, 4, 6, 10]
    """
    steps = np.diff(time_s)
    is_read = np.ones(len(values), dtype=bool)
    is_read[1:] = (np.diff(values, axis=0) != 0.0).any(axis=1) & (steps > 0.0)
    fresh = np.flatnonzero(is_read)
    if len(fresh) < 3:
        return is_read
    usual_s = float(np.median(np.diff(time_s[fresh])))
    for first, stop in zip(fresh, [*fresh[1:], len(time_s)], strict=True):
        last_s = time_s[first]
        for row in range(first + 1, stop) if time_s[stop - 1] - last_s > _STANDS * usual_s else ():
            if time_s[row] - last_s > _STANDS * usual_s:
                is_read[row], last_s = True, time_s[row]
    return is_read


# topics and fields of PX4's messages, ArduPilot's and MAVLink's; of PX4's, the first that a log has
_PX4 = (
    (re.compile(r"vehicle_magnetometer(#\d+)?"), tuple(f"magnetometer_ga[{axis}]" for axis in range(3))),
    (re.compile(r"sensor_combined"), tuple(f"magnetometer_ga[{axis}]" for axis in range(3))),
    (re.compile(r"sensor_mag(#\d+)?"), ("x", "y", "z")),
)
_LAYOUTS = (
    (re.compile(r"MAG\d?(#\d+)?"), ("MagX", "MagY", "MagZ")),
    (re.compile(r"HIGHRES_IMU|(SCALED|RAW)_IMU\d?"), ("xmag", "ymag", "zmag")),
)
_NAMED = re.compile(r"(?P<stem>.*?)(?:(?:mag|magnetometer|magneticfield|magfield)(?P<axis>[xyz])|(?P<first>[xyz])mag)")
_SHORT = re.compile(r"m([xyz])")


def _magnetometers(raw: RawLog, mapped: Mapping[str, str]) -> Iterator[_Columns]:
    """Give each magnetometer; rows in which it says 0 along all axes are no readings."""
    for name, axes, signs in _fields(raw, mapped):
        told = _of_columns(MAGNETOMETER, axes, signs)
        if told is not None:
            told.values[(np.nan_to_num(told.values) == 0.0).all(axis=1)] = np.nan
            yield told._replace(name=name)


_Triple = tuple[str, Sequence[RawSeries], Sequence[float]]  # a name, columns along x, y, z, and their signs


def _fields(raw: RawLog, mapped: Mapping[str, str]) -> Iterator[_Triple]:
    """Give the columns of each magnetometer along x, y and z, with their signs."""
    pairs = mapped_axes(raw, MAGNETOMETER, mapped, "a magnetometer has three axes")
    if pairs is None:
        return
    if pairs:
        yield "the mapped magnetometer", [series for series, _ in pairs], [meaning.sign for _, meaning in pairs]
        return
    by_name = {series.name: series for series in raw.series}
    px4 = next((own for layout in _PX4 if (own := list(_of_topics(raw, by_name, (layout,))))), [])
    documented = [*px4, *_of_topics(raw, by_name, _LAYOUTS)]
    yield from documented or (_of_names(raw) if raw.by_name else ())


def _of_topics(
    raw: RawLog, by_name: Mapping[str, RawSeries], layouts: Sequence[tuple[re.Pattern[str], Sequence[str]]]
) -> Iterator[_Triple]:
    for topic in sorted(raw.clocks):
        for layout, fields in layouts:
            names = [f"{topic}.{field}" for field in fields]
            if layout.fullmatch(topic) and set(names) <= by_name.keys():
                yield topic, [by_name[name] for name in names], (1.0, 1.0, 1.0)


def _of_names(raw: RawLog) -> Iterator[_Triple]:
    """Give the columns of a table that are named as the axes of a magnetometer."""
    found: dict[tuple[str, str], dict[str, RawSeries]] = {}
    for series in raw.series:
        base = stated_unit(series.name, series.unit)[0]
        key = re.sub(r"[^a-z0-9]", "", base.lower())
        named = _NAMED.fullmatch(key)
        short = _SHORT.fullmatch(key)
        if named:
            axis, stem = named["axis"] or named["first"], f"{named['stem']}mag"
        elif short:
            axis, stem = short[1], "m"
        else:
            continue
        found.setdefault((series.clock, stem), {}).setdefault(axis, series)
    for axes in found.values():
        if set(axes) == set("xyz"):
            base = stated_unit(axes["x"].name, axes["x"].unit)[0]
            name = re.sub(r"[\s_.]*x$", "", base, flags=re.IGNORECASE)
            yield name or base, [axes[axis] for axis in "xyz"], (1.0, 1.0, 1.0)

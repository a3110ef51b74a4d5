"""The magnetometers of a log: the field about three axes, with stamps of its own, beside any record of the log.

No channel of a bank is made of them. They are asked which is wrong, the yaw gyro or the heading, and whoever asks
learns their scale and their iron on what is healthy: so their unit doesn't matter. Axes are taken for the gyros'; one
that has others knows the yaw rate badly there, and then says so.
"""

from __future__ import annotations

import contextlib
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.mapping import NONE, mapped_column, split_mapping
from gtmbench.intake.names import stated_unit
from gtmbench.intake.read import ReadLog
from gtmbench.intake.stamps import cleaned
from gtmbench.intake.times import with_time
from gtmbench.values.channels import MAGNETOMETER
from gtmbench.values.pieces import beside
from gtmbench.values.record import FloatArray, Record

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
_MOST = 3  # magnetometers that are asked
_FEWEST = 20  # readings
_INTERPOLATED = 2.5  # rows between readings, up to which they are interpolated; beyond, each stands in its nearest row
_GAP = 5.0  # times the usual step: nothing is known in between


@dataclass(frozen=True, kw_only=True, eq=False)
class FieldReadings:
    """What a magnetometer read.

    Attributes
    ----------
    name : str
        The log's topic, ``MAG2`` or ``vehicle_magnetometer``; of a table what its columns' names begin with.
    columns : tuple of str
        Along x, y and z.
    time_s : FloatArray
        On the log's clock, increasing, shape (readings,). Readings that only repeat the one before are left out.
    field : FloatArray
        In the log's unit, shape (readings, 3).
    """

    name: str
    columns: tuple[str, str, str]
    time_s: FloatArray = field(repr=False)
    field: FloatArray = field(repr=False)

    def beside(self, record: Record) -> Record:
        """Return a record with mag_x, mag_y and mag_z behind its channels, NaN in rows without a reading.

        Examples
        --------
        >>> time_s = np.arange(10) * 0.1
        >>> readings = FieldReadings(
        ...     name="MAG", columns=("MagX", "MagY", "MagZ"), time_s=time_s, field=np.outer(time_s, [1.0, 2.0, 3.0])
        ... )
        >>> record = Record(np.zeros((4, 1)), channels=["p"], sample_period_s=0.1, start_s=0.25)
        >>> readings.beside(record)["mag_y"].round(6).tolist()
        [0.5, 0.7, 0.9, 1.1]
        """
        laid = self._laid(record)
        there = beside([record.there, np.isfinite(laid)]) if record.is_in_part_unknown else None
        return Record(
            beside([record.values, laid]),
            channels=[*record.channels, *MAGNETOMETER],
            sample_period_s=record.sample_period_s,
            start_s=record.start_s,
            there=there,
        )

    def _laid(self, record: Record) -> FloatArray:
        at_s, usual_s = record.time_s, float(np.median(np.diff(self.time_s)))
        if usual_s > _INTERPOLATED * record.sample_period_s:
            laid = np.full((len(record), 3), np.nan)
            rows = np.rint((self.time_s - record.start_s) / record.sample_period_s).astype(int)
            within = (rows >= 0) & (rows < len(record))
            laid[rows[within]] = self.field[within]
            return laid
        laid = np.column_stack([np.interp(at_s, self.time_s, axis) for axis in self.field.T])
        behind = np.clip(np.searchsorted(self.time_s, at_s), 1, len(self.time_s) - 1)
        is_gap = self.time_s[behind] - self.time_s[behind - 1] > _GAP * usual_s
        laid[is_gap | (at_s < self.time_s[0]) | (at_s > self.time_s[-1])] = np.nan
        return np.asarray(laid)


def magnetometers_of(log: ReadLog, mapping: Sequence[str] = ()) -> tuple[FieldReadings, ...]:
    """Return the magnetometers of a log that read anything; none where it has none.

    Parameters
    ----------
    log : ReadLog
    mapping : sequence of str
        As `open_log` takes it: ``mag_x=COLUMN``, ``mag_y=...`` and ``mag_z=...`` state which columns are one, in any
        unit; then no other is taken. ``mag_x=none``: the log counts as without.

    Raises
    ------
    InputError
        If a mapping names a column that isn't there, or only one or two of the three axes.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from gtmbench.intake.read import read_log
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "log.csv")
    ...     rows = (f"{0.1 * k:.1f},{k % 7},{k % 5},1.0" for k in range(40))
    ...     _ = path.write_text(chr(10).join(["time_s,imu_mag_x,imu_mag_y,imu_mag_z", *rows]))
    ...     found = magnetometers_of(read_log(path))
    >>> [(each.name, len(each.time_s)) for each in found]
    [('imu_mag', 40)]
    """
    mapped = split_mapping(mapping)
    raw = log.raw
    with contextlib.suppress(InputError):  # whoever opens the log says why its time isn't known
        raw = with_time(raw, mapped.get("time"))
    found = (_readings(name, axes, signs, raw) for name, axes, signs in magnetometer_columns(raw, mapped))
    return tuple(each for each in found if each is not None)[:_MOST]


_Triple = tuple[str, Sequence[RawSeries], Sequence[float]]  # a name, columns along x, y, z, and their signs


def magnetometer_columns(raw: RawLog, mapped: Mapping[str, str]) -> Iterator[_Triple]:
    """Give the columns of each magnetometer along x, y and z, with their signs."""
    told = [name for name in MAGNETOMETER if name in mapped]
    if NONE in (mapped[name] for name in told):
        return
    if told:
        if len(told) < len(MAGNETOMETER):
            lacking = next(name for name in MAGNETOMETER if name not in mapped)
            raise InputError(f"--map gives {', '.join(told)} and no {lacking}; a magnetometer has three axes")
        pairs = [mapped_column(raw, name, mapped[name]) for name in MAGNETOMETER]
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


def _readings(name: str, axes: Sequence[RawSeries], signs: Sequence[float], raw: RawLog) -> FieldReadings | None:
    """Return what a magnetometer read, each reading once; None where it read nothing, or when isn't known."""
    logged = field_rows(axes, signs, raw)
    if logged is None:
        return None
    time_s, values = logged
    is_fresh = np.ones(len(values), dtype=bool)
    is_fresh[1:] = (np.diff(values, axis=0) != 0.0).any(axis=1) & (np.diff(time_s) > 0.0)
    if np.count_nonzero(is_fresh) < _FEWEST:
        return None
    first, second, third = (series.name for series in axes)
    return FieldReadings(name=name, columns=(first, second, third), time_s=time_s[is_fresh], field=values[is_fresh])


def field_rows(axes: Sequence[RawSeries], signs: Sequence[float], raw: RawLog) -> tuple[FloatArray, FloatArray] | None:
    """Return when a magnetometer was logged, and the field then, repeats among it; None where when isn't known."""
    clocks = {series.clock for series in axes}
    if len(clocks) != 1 or not clocks <= raw.clocks.keys():
        return None
    clock = clocks.pop()
    try:
        cleared, breaks_s, _ = cleaned({clock: raw.clocks[clock]})
    except InputError:
        return None
    if breaks_s:  # what follows is dated later than the log says
        return None
    own = cleared[clock]
    values = np.column_stack([series.values() * sign for series, sign in zip(axes, signs, strict=True)])[own.rows]
    known = np.isfinite(values).all(axis=1) & np.isfinite(own.time_s) & (np.abs(values).max(axis=1) > 0.0)
    return own.time_s[known], values[known]

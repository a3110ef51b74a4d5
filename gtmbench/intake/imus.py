"""The IMUs of a log, gyros of three axes, of which autopilots log up to five; and what gyros read that state no unit.

By how fast aircraft turn. The bounds come from the gyros of 172 recorded flights of multirotors and small aircraft, in
units that their formats document. 99.9 % of the readings of the fastest axis lie below 880 deg/s. In 40 of the logs,
which stand or hover, they lie below 3 deg/s, and none of those shows gyros and attitude that tell of one motion about
all three axes. The noise at rest settles nothing: from simulators to vibrating frames it spans a factor of a thousand.
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.units import dimension_of, unit

_SLOWEST_HZ = 5.0  # what comes more rarely can't be held against an attitude
_MOST = 5  # that are compared
# a topic with its number, the fields of its axes: of ArduPilot's LogStructure.h and PX4's SensorGyro.msg
_LAYOUTS = (
    (re.compile(r"IMU(?:[#_\[]?(\d+)\]?)?"), ("GyrX", "GyrY", "GyrZ")),  # IMU_0 and IMU[0] are converters' names
    (re.compile(r"sensor_gyro(?:#(\d+))?"), ("x", "y", "z")),
)


@dataclass(frozen=True, kw_only=True)
class Imu:
    """A gyro of three axes.

    Attributes
    ----------
    name : str
        The log's topic: ``IMU2``, ``IMU#1``, ``sensor_gyro#1``.
    number : int
        Which one, from 1.
    columns : tuple of str
        Of p, q and r, as `open_log` maps them.
    unit : str
    rate_hz : float

    Examples
    --------
    >>> import gtmbench as gb
    >>> second = gb.Imu(
    ...     name="IMU2", number=2, columns=("IMU2.GyrX", "IMU2.GyrY", "IMU2.GyrZ"), unit="rad/s", rate_hz=50.0
    ... )
    >>> second.mapping[0]
    'p=IMU2.GyrX:rad/s'
    """

    name: str
    number: int
    columns: tuple[str, str, str]
    unit: str
    rate_hz: float

    @property
    def mapping(self) -> tuple[str, ...]:
        """The mapping that reads p, q and r from it, for `open_log`."""
        pairs = zip("pqr", self.columns, strict=True)
        return tuple(f"{channel}={column}:{self.unit}" for channel, column in pairs)


def imus_of(raw: RawLog) -> tuple[Imu, ...]:
    """Return the IMUs of a log, by number; none of a table, where names don't tell."""
    units = {series.name: series.meaning.unit if series.meaning else series.unit for series in raw.series}
    found = [
        Imu(name=topic, number=_number(topic, matched[1]), columns=columns, unit=stated, rate_hz=_rate_hz(raw, topic))
        for topic in raw.clocks
        for layout, (x, y, z) in _LAYOUTS
        if (matched := layout.fullmatch(topic))
        and set(columns := (f"{topic}.{x}", f"{topic}.{y}", f"{topic}.{z}")) <= set(units)
        for stated in [_unit(units[columns[0]])]
    ]
    often = [imu for imu in found if imu.rate_hz >= _SLOWEST_HZ]
    return tuple(sorted(often, key=lambda imu: (imu.number, imu.name))[:_MOST])


def _number(topic: str, digits: str | None) -> int:
    """Return which one it is: behind a mark they count from 0, else from 1."""
    return int(digits) + any(mark in topic for mark in "#_[") if digits else 1


def _unit(stated: str) -> str:
    known = unit(stated)
    return stated if known is not None and known.dimension == dimension_of("p") else "rad/s"


def _rate_hz(raw: RawLog, topic: str) -> float:
    stamps = raw.clocks[topic]
    steps = np.diff(stamps[np.isfinite(stamps)])
    forward = steps[steps > 0.0]
    return 1.0 / float(np.median(forward)) if len(forward) else 0.0


_USUALLY = 99.9  # %
_FASTEST_RAD_S, _RANGE_DEG_S = math.radians(920.0), 2500.0  # of aircraft; of gyros
_FEWEST = 200  # readings: a few seconds, or the fastest thousandth is one of them


def only_deg_s(gyros: Sequence[RawSeries]) -> str:
    """Return what shows that gyros read in deg/s, as no aircraft turns so fast in rad/s; "" where nothing does.

    >>> turns = 40.0 * np.sin(np.arange(0.0, 60.0, 0.02))
    >>> def gyros(factor):
    ...     return [RawSeries(name=name, load=lambda: factor * turns) for name in "xyz"]
    >>> only_deg_s(gyros(1.0)), only_deg_s(gyros(1 / 57.3)), only_deg_s(gyros(0.2))
    ('readings up to 40, which are no rad/s', '', '')
    """
    most = _fastest(gyros)
    is_shown = _FASTEST_RAD_S < most <= _RANGE_DEG_S
    return f"readings up to {most:.3g}, which are no rad/s" if is_shown else ""


def hardly_moves_in_deg_s(gyros: Sequence[RawSeries]) -> str:
    """Return what shows that gyros which tell of one motion with an attitude read in rad/s; "" where nothing does."""
    most = _fastest(gyros)
    # below 3 deg/s no log's gyros and attitude tell of one motion
    return f"readings up to {most:.3g}, which in deg/s are too calm to fit an attitude" if most < 3.0 else ""


def _fastest(gyros: Sequence[RawSeries]) -> float:
    """Return the readings of the fastest axis, but for a few; NaN where there are too few to tell."""
    values = np.column_stack([each.values() for each in gyros])
    values = values[np.isfinite(values).all(axis=1)]
    return float(np.percentile(np.abs(values), _USUALLY, axis=0).max()) if len(values) >= _FEWEST else math.nan

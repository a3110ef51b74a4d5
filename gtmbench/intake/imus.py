"""The IMUs of a log: gyros of three axes, of which ArduPilot and PX4 log up to five side by side."""

from __future__ import annotations

import re
from dataclasses import dataclass

import numpy as np

from gtmbench.intake.formats.raw import RawLog
from gtmbench.intake.units import dimension_of, unit

_SLOWEST_HZ = 5.0  # what comes more rarely can't be held against an attitude
_MOST = 5
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

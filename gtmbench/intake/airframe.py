"""Which airframe a log is of, as it says itself, and how warm its IMU was."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from gtmbench.checks import one_line
from gtmbench.intake.read import ReadLog

# of ArduPilot's LogStructure.h (IMU), PX4's SensorGyro.msg and SensorAccel.msg, MAVLink's RAW_IMU and HIGHRES_IMU
_WARM = re.compile(
    r"IMU(?:1|[_\[]0\]?)?\.(?:T|Temp)|sensor_gyro\.temperature|sensor_accel\.temperature|(?P<hundredths>(?:RAW|SCALED)_IMU)"
    r"\.temperature|HIGHRES_IMU\.temperature"
)
_COLDEST_C, _WARMEST_C = -60.0, 125.0  # of electronics that work
_LONGEST = 100


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
        if _COLDEST_C < middle < _WARMEST_C:
            return middle
    return float("nan")

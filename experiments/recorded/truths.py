"""True failures among public logs: what a reader of the plot sees, and where the truth comes from.

Accelerometers are no part of what drives a verdict on gyros, so what they tell is a truth of its own.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Truth:
    """What failed in a log.

    Attributes
    ----------
    what : str
    sensors : tuple of str
        Whose accusation is right; none where no gyro or angle is to be named.
    source : str
    """

    what: str
    sensors: tuple[str, ...]
    source: str


_PLOT = "the plot: at rest, 1 g stays along one axis while the attitude tumbles"
_WARM = "the plot: gyro less attitude rate, at rest and in flight"
_FIX = "the plot: the GPS's satellites, 5 to 11 and from one message to the next none, while the aircraft flies"
_LOST = "the GPS loses its fix at {} s{}"
_OFFSET = "p and q read {} deg/s at rest: gyros that nobody calibrated drive the attitude"

TRUTHS: dict[str, Truth] = {
    "pxf_copter_23-9-2014_51.BIN": Truth(_OFFSET.format("-24"), ("p", "q"), _PLOT),
    "pxf_copter_23-9-2014_52.BIN": Truth(_OFFSET.format("-23"), ("p", "q"), _PLOT),
    "pxf_copter_7-9-2014_3.BIN": Truth(_OFFSET.format("-8"), ("p", "q"), _PLOT),
    "pxf_copter_7-9-2014_6.BIN": Truth(_OFFSET.format("-9"), ("p", "q"), _PLOT),
    "pxf_copter_7-9-2014_7.BIN": Truth(_OFFSET.format("-9"), ("p", "q"), _PLOT),
    "pxf_copter_7-9-2014_9.BIN": Truth(_OFFSET.format("-12"), ("p", "q"), _PLOT),
    "pxf_rover_25-8-2014_61.BIN": Truth(_OFFSET.format("-24"), ("p", "q"), _PLOT),
    "pxf_copter_09-10-2014_30.BIN": Truth("p drifts by 1 deg/s within a minute; the GPS restarts", ("p", "gps"), _WARM),
    "pxf_copter_09-10-2014_31.BIN": Truth("p drifts to -3 deg/s at 371 s; the GPS restarts", ("p", "gps"), _WARM),
    "pxf_copter_8-10-2014_18.BIN": Truth("p drifts to -2.3 deg/s within a minute, and the bank along", ("p",), _WARM),
    "pxf_copter_8-10-2014_10.BIN": Truth(
        "p reads 0.9 deg/s at rest before the flight and -1.9 after it; the GPS loses its fix at 281.1 s",
        ("p", "gps"),
        "the plot: gyros at rest, and the GPS's satellites",
    ),
    "pxf_copter_15-10-2014_42.BIN": Truth("p drifts to -1.5 deg/s within half a minute", ("p",), _WARM),
    "ekf_failure.ulg": Truth(
        "an estimator fails in flight", (), "its name in PX4/flight-review-rs, and its own messages"
    ),
    "hw_log_log_2_UnknownDate.bin": Truth(
        "the estimator's bias of r diverges", ("r", "psi"), "ArduPilot/ardupilot, issue 8931"
    ),
    "pxf_copter_6-11-2014_GPS_issues1.BIN": Truth(_LOST.format("96.5", " for good"), ("gps",), _FIX),
    "pxf_copter_6-11-2014_GPS_issues2.BIN": Truth(_LOST.format("57.3", " for a minute"), ("gps",), _FIX),
    "pxf_copter_6-11-2014_GPS_issues3.BIN": Truth(_LOST.format("215.6", " for 7 s"), ("gps",), _FIX),
    "pxf_copter_6-11-2014_Loiter_RTL.bin": Truth(_LOST.format("97.0", " for 7 s"), ("gps",), _FIX),
    "pxf_copter_09-10-2014_25.BIN": Truth(_LOST.format("166.2", ", and seven times more"), ("gps",), _FIX),
    "pxf_copter_26-11-2014_181.BIN": Truth(
        "from 91.9 s on the GPS tells of up to 78 m/s, 300 m up and down", ("gps",), "the plot, beside accelerometers"
    ),
}

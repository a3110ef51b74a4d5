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
_COMPASS = "the flight-test report beside it, Arrow-air/project-quiver flight-test/PT1/{}.md, and the plot"
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
    "pxf_copter_8-10-2014_11.BIN": Truth(
        "from 103 s on the GPS's place creeps back by 20 m within half a minute, while its velocity reads none",
        ("gps",),
        "the plot: places, beside the velocity's integral",
    ),
    "pxf_copter_22-12-2014_41.BIN": Truth(
        "q drifts to 1.7 deg/s more than the attitude turns and IMU2 reads", ("q",), "the plot, and the other IMU"
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
    "pb_1.BIN": Truth(
        "p reads -1.4 to -1.7 deg/s at rest from 375 to 520 s, when IMU2 reads 0.3",
        ("p",),
        "the plot, and the other IMU",
    ),
    "pb_3.BIN": Truth("a motor fails, and the aircraft crashes at 246 s", (), "3.xml beside it in its repository"),
    "quiver_00000077.BIN": Truth("the heading leaps in flight: compasses", ("psi", "mag"), _COMPASS.format("001")),
    "quiver_00000080.BIN": Truth("the heading leaps in flight: compasses", ("psi", "mag"), _COMPASS.format("001")),
    "quiver_00000081.BIN": Truth("the heading leaps in flight: compasses", ("psi", "mag"), _COMPASS.format("001")),
    "quiver_00000088.BIN": Truth("the heading wanders: compasses; it tips over at 386 s", ("psi", "mag"), "the plot"),
    "quiver_00000090.BIN": Truth(
        "until 725 s the heading leaps and wanders: compasses", ("psi", "mag"), _COMPASS.format("002")
    ),
    "quiver_00000096.BIN": Truth("the heading leaps and wanders until 842 s: compasses", ("psi", "mag"), "the plot"),
    "dawn_flight1.zip": Truth("on the ground, the estimator resets the heading every 15 s", ("psi",), "the plot"),
    "wsk.tlog": Truth("on a bench the heading creeps by 50 deg, at rest", ("psi",), "the plot"),
    "attas_qst01.csv": Truth("psi turns by 180 deg within 0.12 s at 40.3 and 74.0 s", ("psi",), "the table"),
    "attas_qst02.csv": Truth("psi turns by 180 deg within 0.12 s at 45.8 s", ("psi",), "the table"),
}

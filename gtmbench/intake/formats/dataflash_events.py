"""What an ArduPilot log says beside its sensors: events, complaints of sensors, and what a simulation broke.

Events are its EV, ERR and MSG, which estimator is in use, and whether a plane flies. It complains of gyros that aren't
healthy or count errors, and of what its estimators reject. Its simulation is told by parameters what to break of gyros,
SIM_GYR and the drift, in the meaning of SITL.cpp and AP_InertialSensor_SITL.cpp; by the first a log begins.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from math import degrees
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event, EventKind, complaints, onsets, touchdowns
from gtmbench.intake.published_failures import GYRO, Injection, injected, spells
from gtmbench.values.channels import GYROS
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray

_IN_USE = ("NKF4", "XKF4")  # PI is the number of the estimator in use
# LogStructure.h of AP_InertialSensor, AP_NavEKF2 and AP_NavEKF3; with instances the second is IMU#1
_IMUS, _ESTIMATORS = ("IMU", "IMU2", "IMU3"), ("EKF4", "NKF4", "XKF4")
EVENTS_OF = ("EV", "ERR", "MSG", "STAT", *_IMUS, *_ESTIMATORS)  # messages
INJECTIONS_OF = ("PARM",)
Told = Mapping[str, "MessageTable"]  # messages by their types' names
# AP_Logger.h, enum LogEvent
_ARMED, _DISARMED, _EKF_YAW_RESET = 10, 11, 62
_LAND_COMPLETE_MAYBE, _LAND_COMPLETE, _NOT_LANDED = 17, 18, 28  # of the same enum
_CODES = {
    _ARMED: (EventKind.ARM, "EV ARMED"),
    _DISARMED: (EventKind.DISARM, "EV DISARMED"),
    _EKF_YAW_RESET: (EventKind.RESET, "EV EKF_YAW_RESET"),
    _NOT_LANDED: (EventKind.TAKEOFF, "EV NOT_LANDED"),
}
# AP_Logger.h, enum LogErrorSubsystem; the code 0 says that it is over, but of EKF_PRIMARY it numbers the estimator
_EKF_PRIMARY = 24
_FAILURES = {  # of that enum
    12: "CRASH_CHECK",
    16: "EKFCHECK",
    17: "FAILSAFE_EKFINAV",
    25: "THRUST_LOSS_CHECK",
    29: "FAILSAFE_VIBE",
    30: "INTERNAL_ERROR",
}
_OF_ESTIMATOR = (16, 17)  # EKFCHECK, FAILSAFE_EKFINAV
# what NavEKF2, NavEKF3 and the start-up say where attitude or heading are set
_SAID = re.compile(r"(?:yaw|tilt) (?:re-?)?align|yaw reset|lane switch|ground start|initiali[sz]ing", re.IGNORECASE)
_OF_IMU = re.compile(r"IMU(\d+)")


@dataclass(frozen=True, kw_only=True, eq=False)
class MessageTable:
    """All messages of one type."""

    time_s: FloatArray
    names: tuple[str, ...]  # of the columns
    column: Callable[[str], NDArray[Any]]  # gives one


def dataflash_events(told: Told) -> list[Event]:
    """Return what some messages tell; what a log begins with is no complaint."""
    events = [event for find in (_codes, _errors, _resets, _plane) for event in find(told)]
    return [*events, *_sensors(told), *_estimators(told), *_complaining_texts(told)]


def rows_of(told: Told, kind: str, *columns: str, texts: Collection[str] = ()) -> list[tuple[Any, ...]]:
    """Return (time, value, ...) message by message; nothing where a column isn't there, or isn't what it should be."""
    messages = told.get(kind)
    if messages is None or not set(columns) <= set(messages.names):
        return []
    values = [messages.column(name) for name in columns]
    if any((values[place].dtype.kind == "S") != (name in texts) for place, name in enumerate(columns)):
        return []
    numbers = [column for column in values if column.dtype.kind != "S"]
    whole = np.logical_and.reduce([np.isfinite(column) for column in (messages.time_s, *numbers)])
    return list(zip(messages.time_s[whole].tolist(), *(column[whole].tolist() for column in values), strict=True))


def _codes(told: Told) -> Iterator[Event]:
    rows = rows_of(told, "EV", "Id")
    for time_s, code in rows:
        if code in _CODES:
            kind, text = _CODES[code]
            yield Event(kind=kind, time_s=time_s, text=text)
    contacts = [(time_s, code != _NOT_LANDED) for time_s, code in rows if code in (_LAND_COMPLETE_MAYBE, _NOT_LANDED)]
    landings = [(time_s, code != _NOT_LANDED) for time_s, code in rows if code in (_LAND_COMPLETE, _NOT_LANDED)]
    for time_s in touchdowns(contacts, landings):
        yield Event(kind=EventKind.TOUCHDOWN, time_s=time_s, text="EV LAND_COMPLETE")


def _errors(told: Told) -> Iterator[Event]:
    for time_s, subsystem, code in rows_of(told, "ERR", "Subsys", "ECode"):
        if subsystem == _EKF_PRIMARY:
            text = f"ERR EKF_PRIMARY: estimator {code:g} took over"
            yield Event(kind=EventKind.RESET, time_s=time_s, text=text, about="estimator")
        elif subsystem in _FAILURES and code:
            about = "estimator" if subsystem in _OF_ESTIMATOR else ""
            text = f"ERR {_FAILURES[subsystem]} {code:g}"
            yield Event(kind=EventKind.FAILURE, time_s=time_s, text=text, about=about)


def _resets(told: Told) -> Iterator[Event]:
    in_use = _in_use(told)
    for time_s, number in in_use[1:]:
        yield Event(kind=EventKind.RESET, time_s=time_s, text=f"estimator {number:g} took over", about="estimator")
    for time_s, text in messages_of(told):
        of_imu = _OF_IMU.search(text)
        number = next((number for since_s, number in reversed(in_use) if since_s <= time_s), in_use[0][1])
        if _SAID.search(text) and (of_imu is None or int(of_imu[1]) == number):
            yield Event(kind=EventKind.RESET, time_s=time_s, text=text)


def messages_of(told: Told) -> Iterator[tuple[float, str]]:
    """Give the texts that the autopilot logged, with their times."""
    for time_s, message in rows_of(told, "MSG", "Message", texts=["Message"]):
        yield time_s, message.split(b"\0")[0].decode("latin-1")


def _in_use(told: Told) -> list[tuple[float, float]]:
    """Return the number of the estimator in use, and from when on; the first where nothing is said of it."""
    rows = next((rows for kind in reversed(_IN_USE) if (rows := rows_of(told, kind, "PI"))), [(-np.inf, 0.0)])
    return [row for place, row in enumerate(rows) if not place or row[1] != rows[place - 1][1]]


def _plane(told: Told) -> Iterator[Event]:
    """Tell when a plane took off and touched down: it has no EV for that."""
    rows = [(time_s, bool(flies)) for time_s, flies in rows_of(told, "STAT", "isFlying")]
    for (_, flew), (time_s, flies) in pairwise(rows):
        if flies != flew:
            kind = EventKind.TAKEOFF if flies else EventKind.TOUCHDOWN
            yield Event(kind=kind, time_s=time_s, text="STAT isFlying")


_MOST_INSTANCES = 5  # of a message
_HEALTH_OF_IMU = {"gyro": ("GH", ("EG", "ErrG")), "accelerometer": ("AH", ("EA", "ErrA"))}
# squared ratios of innovations to their limits: rejected above 1
_RATIOS = {"SV": "velocity", "SP": "position", "SH": "height"}
_RATIOS |= dict.fromkeys(("SM", "SMX", "SMY", "SMZ"), "magnetometer") | {"SVT": "airspeed"}
_COMPLAINTS = re.compile(
    r"(?P<gyro>gyros? (?:inconsistent|not healthy|unhealthy))|(?P<accelerometer>accels? (?:inconsistent|not healthy))"
    r"|(?P<estimator>EKF\d? (?:variance|failsafe))",
    re.IGNORECASE,
)


def _instances(told: Told, names: tuple[str, ...]) -> Iterator[tuple[str, str, int]]:
    """Give the messages that are there: as they are called in `told`, without instance, and the instance."""
    for name in names:
        for instance in range(_MOST_INSTANCES):
            called = f"{name}#{instance}" if instance else name
            if called in told:
                yield called, name, instance


def _sensors(told: Told) -> Iterator[Event]:
    for called, name, instance in _instances(told, _IMUS):
        number = _IMUS.index(name) + 1 + instance
        for about, (health, counts) in _HEALTH_OF_IMU.items():
            sick = _raised(told, called, health, lambda values: values == 0.0)
            yield from complaints(sick, f"{about} {number} isn't healthy ({called}.{health})", about, number)
            for field in counts:
                more = _raised(told, called, field, lambda values: np.diff(values, prepend=values[:1]) > 0.0)
                yield from complaints(more, f"{about} {number} counts errors ({called}.{field})", about, number)


def _estimators(told: Told) -> Iterator[Event]:
    for called, _, instance in _instances(told, _ESTIMATORS):
        for field, what in _RATIOS.items():
            rejected = _raised(told, called, field, lambda values: values > 1.0)
            text = f"estimator {instance} rejects {what} ({called}.{field} above 1)"
            yield from complaints(rejected, text, "estimator")
        faults = _raised(told, called, "FS", lambda values: values != 0.0)
        yield from complaints(faults, f"estimator {instance} has a fault ({called}.FS)", "estimator")


def _raised(told: Told, kind: str, name: str, when: Callable[[FloatArray], BoolArray]) -> list[float]:
    """Return when a column's values begin to be so; never where there is none of numbers."""
    messages = told.get(kind)
    if messages is None or name not in messages.names or (values := messages.column(name)).dtype.kind == "S":
        return []
    whole = np.isfinite(messages.time_s) & np.isfinite(values)
    time_s = messages.time_s[whole]
    return time_s[onsets(time_s, when(values[whole].astype(np.float64)))].tolist() if len(time_s) else []


def _complaining_texts(told: Told) -> Iterator[Event]:
    for time_s, text in messages_of(told):
        said = _COMPLAINTS.search(text)
        if said and said.lastgroup:
            yield from complaints([time_s], text, said.lastgroup)


_OF_AXIS = re.compile(r"SIM_GYR(\d?)_(BIAS|SCALE)_([XYZ])")
_NOISE = re.compile(r"SIM_GYR(\d?)_RND")
_STOPPED, _DRIFT = "SIM_GYR_FAIL_MSK", "SIM_DRIFT_SPEED"  # a bit a gyro; deg/s a minute, of all gyros and axes
_MOST_GYROS = 5  # bits of the mask that are looked at
Changes = list[tuple[float, float]]


def dataflash_injections(told: Told) -> list[Injection]:
    """Return the faults that a simulation was told to put into its gyros."""
    settings: dict[str, Changes] = {}
    for time_s, name, value in rows_of(told, "PARM", "Name", "Value", texts=["Name"]):
        settings.setdefault(name.split(b"\0")[0].decode("latin-1"), []).append((time_s, float(value)))
    return [each for name, changes in settings.items() for each in _injections_of(name, changes)]


def _injections_of(name: str, changes: Changes) -> Iterator[Injection]:
    of_axis, noise = _OF_AXIS.fullmatch(name), _NOISE.fullmatch(name)
    usual = changes[0][1] if name == _DRIFT else 0.0
    for onset_s, end_s, value in spells(changes, usual) if of_axis or noise or name == _DRIFT else ():
        kind, number, size, unit = "drift", None, value / 60.0, "deg/s per s"  # from a minute
        if noise:
            kind, number, size, unit = "noise", int(noise[1] or 1), value, "deg/s, times throttle"
        elif of_axis and of_axis[2] == "BIAS":
            kind, number, size, unit = "bias", int(of_axis[1] or 1), degrees(value), "deg/s"
        elif of_axis:
            kind, number, size, unit = "scale factor", int(of_axis[1] or 1), value / 100.0, ""
        injection = injected(GYRO, number, kind, (onset_s, end_s), f"{name} = {value:g}")
        channels = (GYROS["XYZ".index(of_axis[3])],) if of_axis else GYROS
        yield replace(injection, channels=channels, size=size, unit=unit)
    if name == _STOPPED:
        yield from _stopped(changes)


def _stopped(changes: Changes) -> Iterator[Injection]:
    """Give the gyros that are no longer read: their last reading stands."""
    for bit in range(_MOST_GYROS):
        bits = [(time_s, float(int(mask) >> bit & 1)) for time_s, mask in changes if abs(mask) < 2**_MOST_GYROS]
        for onset_s, end_s, _ in spells(bits, 0.0):
            yield injected(GYRO, bit + 1, "stuck", (onset_s, end_s), f"{_STOPPED} has bit {bit}")

"""Events of an ArduPilot log: its EV, ERR and MSG, which estimator is in use, and whether a plane flies."""

from __future__ import annotations

import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event, EventKind, touchdowns
from gtmbench.values.clock import FloatArray

_IN_USE = ("NKF4", "XKF4")  # PI is the number of the estimator in use
TOLD_BY = ("EV", "ERR", "MSG", "STAT", *_IN_USE)
# AP_Logger.h, enum LogEvent
_ARMED, _DISARMED, _EKF_YAW_RESET = 10, 11, 62
_LAND_COMPLETE_MAYBE, _LAND_COMPLETE, _NOT_LANDED = 17, 18, 28
_CODES = {
    _ARMED: (EventKind.ARM, "EV ARMED"),
    _DISARMED: (EventKind.DISARM, "EV DISARMED"),
    _EKF_YAW_RESET: (EventKind.RESET, "EV EKF_YAW_RESET"),
    _NOT_LANDED: (EventKind.TAKEOFF, "EV NOT_LANDED"),
}
# AP_Logger.h, enum LogErrorSubsystem; the code 0 says that it is over, but of EKF_PRIMARY it numbers the estimator
_EKF_PRIMARY = 24
_FAILURES = {
    12: "CRASH_CHECK",
    16: "EKFCHECK",
    17: "FAILSAFE_EKFINAV",
    25: "THRUST_LOSS_CHECK",
    29: "FAILSAFE_VIBE",
    30: "INTERNAL_ERROR",
}
_OF_ESTIMATOR = (16, 17)
# what NavEKF2, NavEKF3 and the start-up say where attitude or heading are set
_SAID = re.compile(r"(?:yaw|tilt) (?:re-?)?align|yaw reset|lane switch|ground start|initiali[sz]ing", re.IGNORECASE)
_OF_IMU = re.compile(r"IMU(\d+)")


@dataclass(frozen=True, kw_only=True, eq=False)
class MessageTable:
    """All messages of one type."""

    time_s: FloatArray
    names: tuple[str, ...]  # of the columns
    column: Callable[[str], NDArray[Any]]  # gives one


def dataflash_events(told: Mapping[str, MessageTable]) -> list[Event]:
    """Return what some messages tell, by their types' names."""
    return [event for find in (_codes, _errors, _texts, _changes_of_estimator, _plane) for event in find(told)]


def rows_of(
    told: Mapping[str, MessageTable], kind: str, *columns: str, texts: Collection[str] = ()
) -> list[tuple[Any, ...]]:
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


def column_of(told: Mapping[str, MessageTable], kind: str, name: str) -> tuple[FloatArray, FloatArray] | None:
    """Return the times and values of a column of numbers; None where there is none."""
    messages = told.get(kind)
    if messages is None or name not in messages.names:
        return None
    values = messages.column(name)
    if values.dtype.kind == "S":
        return None
    whole = np.isfinite(messages.time_s) & np.isfinite(values)
    return messages.time_s[whole], values[whole].astype(np.float64)


def _codes(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    rows = rows_of(told, "EV", "Id")
    for time_s, code in rows:
        if code in _CODES:
            kind, text = _CODES[code]
            yield Event(kind=kind, time_s=time_s, text=text)
    contacts = [(time_s, code != _NOT_LANDED) for time_s, code in rows if code in (_LAND_COMPLETE_MAYBE, _NOT_LANDED)]
    landings = [(time_s, code != _NOT_LANDED) for time_s, code in rows if code in (_LAND_COMPLETE, _NOT_LANDED)]
    for time_s in touchdowns(contacts, landings):
        yield Event(kind=EventKind.TOUCHDOWN, time_s=time_s, text="EV LAND_COMPLETE")


def _errors(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    for time_s, subsystem, code in rows_of(told, "ERR", "Subsys", "ECode"):
        if subsystem == _EKF_PRIMARY:
            text = f"ERR EKF_PRIMARY: estimator {code:g} took over"
            yield Event(kind=EventKind.RESET, time_s=time_s, text=text, about="estimator")
        elif subsystem in _FAILURES and code:
            about = "estimator" if subsystem in _OF_ESTIMATOR else ""
            text = f"ERR {_FAILURES[subsystem]} {code:g}"
            yield Event(kind=EventKind.FAILURE, time_s=time_s, text=text, about=about)


def _texts(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    in_use = _in_use(told)
    for time_s, text in messages_of(told):
        of_imu = _OF_IMU.search(text)
        number = next((number for since_s, number in reversed(in_use) if since_s <= time_s), in_use[0][1])
        if _SAID.search(text) and (of_imu is None or int(of_imu[1]) == number):
            yield Event(kind=EventKind.RESET, time_s=time_s, text=text)


def messages_of(told: Mapping[str, MessageTable]) -> Iterator[tuple[float, str]]:
    """Give the texts that the autopilot logged, with their times."""
    for time_s, message in rows_of(told, "MSG", "Message", texts=["Message"]):
        yield time_s, message.split(b"\0")[0].decode("latin-1")


def _changes_of_estimator(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    for time_s, number in _in_use(told)[1:]:
        yield Event(kind=EventKind.RESET, time_s=time_s, text=f"estimator {number:g} took over", about="estimator")


def _in_use(told: Mapping[str, MessageTable]) -> list[tuple[float, float]]:
    """Return the number of the estimator in use, and from when on; the first where nothing is said of it."""
    rows = next((rows for kind in reversed(_IN_USE) if (rows := rows_of(told, kind, "PI"))), [(-np.inf, 0.0)])
    return [row for place, row in enumerate(rows) if not place or row[1] != rows[place - 1][1]]


def _plane(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    """Tell when a plane took off and touched down: it has no EV for that."""
    rows = [(time_s, bool(flies)) for time_s, flies in rows_of(told, "STAT", "isFlying")]
    for (_, flew), (time_s, flies) in pairwise(rows):
        if flies != flew:
            kind = EventKind.TAKEOFF if flies else EventKind.TOUCHDOWN
            yield Event(kind=kind, time_s=time_s, text="STAT isFlying")

"""What ArduPilot says of its sensors: gyros that aren't healthy or count errors, what its estimators reject, texts."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

import numpy as np

from gtmbench.intake.events import Event, complaint, onsets
from gtmbench.intake.formats.dataflash_events import MessageTable, column_of, messages_of
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray

# LogStructure.h of AP_InertialSensor, AP_NavEKF2 and AP_NavEKF3; with instances the second is IMU#1
_IMUS, _ESTIMATORS = ("IMU", "IMU2", "IMU3"), ("EKF4", "NKF4", "XKF4")
TOLD_BY = (*_IMUS, *_ESTIMATORS, "MSG")
MOST_INSTANCES = 5
_OF_IMU = {"gyro": ("GH", ("EG", "ErrG")), "accelerometer": ("AH", ("EA", "ErrA"))}
# squared ratios of innovations to their limits: rejected above 1
_RATIOS = {
    "SV": "velocity",
    "SP": "position",
    "SH": "height",
    "SM": "magnetometer",
    "SMX": "magnetometer",
    "SMY": "magnetometer",
    "SMZ": "magnetometer",
    "SVT": "airspeed",
}
_SAID = re.compile(
    r"(?P<gyro>gyros? (?:inconsistent|not healthy|unhealthy))|(?P<accelerometer>accels? (?:inconsistent|not healthy))"
    r"|(?P<estimator>EKF\d? (?:variance|failsafe))",
    re.IGNORECASE,
)


def dataflash_complaints(told: Mapping[str, MessageTable]) -> list[Event]:
    """Return what a log says of sensors, by its messages' names; what it begins with is no event."""
    return [*_sensors(told), *_estimators(told), *_texts(told)]


def _instances(told: Mapping[str, MessageTable], names: tuple[str, ...]) -> Iterator[tuple[str, str, int]]:
    """Give the messages that are there: as they are called in `told`, without instance, and the instance."""
    for name in names:
        for instance in range(MOST_INSTANCES):
            called = f"{name}#{instance}" if instance else name
            if called in told:
                yield called, name, instance


def _sensors(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    for called, name, instance in _instances(told, _IMUS):
        number = _IMUS.index(name) + 1 + instance
        for about, (health, counts) in _OF_IMU.items():
            for time_s in _raised(told, called, health, lambda values: values == 0.0):
                yield complaint(time_s, f"{about} {number} isn't healthy ({called}.{health})", about, number)
            for field in counts:
                for time_s in _raised(told, called, field, _grows):
                    yield complaint(time_s, f"{about} {number} counts errors ({called}.{field})", about, number)


def _estimators(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    for called, _, instance in _instances(told, _ESTIMATORS):
        for field, what in _RATIOS.items():
            for time_s in _raised(told, called, field, lambda values: values > 1.0):
                text = f"estimator {instance} rejects {what} ({called}.{field} above 1)"
                yield complaint(time_s, text, "estimator")
        for time_s in _raised(told, called, "FS", lambda values: values != 0.0):
            yield complaint(time_s, f"estimator {instance} has a fault ({called}.FS)", "estimator")


def _grows(counts: FloatArray) -> BoolArray:
    return np.diff(counts, prepend=counts[:1]) > 0.0


def _raised(
    told: Mapping[str, MessageTable], kind: str, name: str, when: Callable[[FloatArray], BoolArray]
) -> Iterator[float]:
    """Give when a column's values begin to be so."""
    column = column_of(told, kind, name)
    if column is not None and len(column[0]):
        for row in onsets(column[0], when(column[1])):
            yield float(column[0][row])


def _texts(told: Mapping[str, MessageTable]) -> Iterator[Event]:
    for time_s, text in messages_of(told):
        said = _SAID.search(text)
        if said and said.lastgroup:
            yield complaint(time_s, text, said.lastgroup)

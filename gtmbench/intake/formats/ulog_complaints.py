"""What PX4 says of its sensors: which gyros are healthy, what its estimators reject, which failed and was replaced."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event, complaint, onsets
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray

Topics = Mapping[str, Mapping[str, NDArray[Any]]]
_SENSORS = {"gyro": "gyro", "accel": "accelerometer"}
_SLOTS = 4  # of sensors_status_imu
_LANES = 9  # of estimator_selector_status
_INSTANCES = 9  # of estimator_status
# EstimatorStatus.msg: ratios of innovations to their test limits; the first is mag_test_ratio in older logs
_RATIOS = {
    "hdg_test_ratio": "heading",
    "mag_test_ratio": "magnetometer",
    "vel_test_ratio": "velocity",
    "pos_test_ratio": "position",
    "hgt_test_ratio": "height",
    "tas_test_ratio": "airspeed",
}
_FAILED = re.compile(r"(Gyro|Accel) #(\d+) fail")  # voted_sensors_update.cpp


def ulog_complaints(
    topics: Topics, clocks: Mapping[str, FloatArray], messages: Iterable[tuple[float, str]]
) -> list[Event]:
    """Return what a log says of sensors; what it begins with is no event.

    `topics`, `clocks`: fields by topic, and their times. `messages`: that the autopilot logged.
    """
    return [*_sensors(topics, clocks), *_estimators(topics, clocks), *_lanes(topics, clocks), *_texts(messages)]


def _raised(clocks: Mapping[str, FloatArray], topic: str, flags: BoolArray) -> list[float]:
    """Return when flags rise, on their topic's clock."""
    time_s = clocks[topic]
    return [float(time_s[row]) for row in onsets(time_s, flags)]


def _sensors(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    topic = "sensors_status_imu"
    fields = topics.get(topic, {})
    for short, about in _SENSORS.items():
        for slot in range(_SLOTS):
            healthy, known = fields.get(f"{short}_healthy[{slot}]"), fields.get(f"{short}_device_ids[{slot}]")
            if healthy is not None and known is not None:
                for time_s in _raised(clocks, topic, (healthy == 0) & (known != 0)):
                    yield complaint(time_s, f"{about} {slot + 1} isn't healthy ({topic})", about, slot + 1)


def _estimators(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    names = ["estimator_status", *(f"estimator_status#{number}" for number in range(1, _INSTANCES))]
    for number, topic in enumerate(names):
        fields = topics.get(topic, {})
        for field, what in _RATIOS.items():
            if field in fields:
                with np.errstate(invalid="ignore"):
                    rejected = fields[field] > 1.0
                for time_s in _raised(clocks, topic, rejected):
                    yield complaint(time_s, f"estimator {number} rejects {what} ({field} above 1)", "estimator")
        if "filter_fault_flags" in fields:
            for time_s in _raised(clocks, topic, fields["filter_fault_flags"] != 0):
                yield complaint(time_s, f"estimator {number} has a fault (filter_fault_flags)", "estimator")


def _lanes(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    topic = "estimator_selector_status"
    fields = topics.get(topic, {})
    for short, about in _SENSORS.items():
        field = f"{short}_fault_detected"
        if field in fields:
            for time_s in _raised(clocks, topic, fields[field] != 0):
                yield complaint(time_s, f"{about} fault detected ({topic})", about)
    for lane in range(_LANES):
        healthy = fields.get(f"healthy[{lane}]")
        if healthy is not None:
            for time_s in _raised(clocks, topic, healthy == 0):
                yield complaint(time_s, f"estimator {lane} isn't healthy ({topic})", "estimator")


def _texts(messages: Iterable[tuple[float, str]]) -> Iterator[Event]:
    for time_s, text in messages:
        failed = _FAILED.search(text)
        if failed:
            yield complaint(time_s, text.strip(), _SENSORS[failed[1].lower()], int(failed[2]) + 1)

"""What a PX4 log says beside its sensors: of resets, landings, arming and failures, and against its sensors.

Estimators, land detector, commander and failure detector publish the events. Complaints are which gyros aren't healthy,
what the estimators reject, which sensor failed and was replaced.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event, EventKind, complaints, onsets, touchdowns
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray

Topics = Mapping[str, Mapping[str, NDArray[Any]]]
_ARMED = 2  # vehicle_status.msg: ARMING_STATE_ARMED
# of the message definitions estimator_status_flags and estimator_event_flags, what turns the attitude or its heading
_ALIGNED = {
    "estimator_status_flags": {"cs_tilt_align": "tilt aligned", "cs_yaw_align": "heading aligned"},
    "estimator_event_flags": {
        "yaw_aligned_to_imu_gps": "heading aligned to IMU and GPS",
        "emergency_yaw_reset_mag_stopped": "emergency reset of heading, magnetometer stopped",
        "emergency_yaw_reset_gps_yaw_stopped": "emergency reset of heading, GPS heading stopped",
    },
}
TOLD_BY = (  # topics that events are read from
    "vehicle_attitude",
    "estimator_status",
    "estimator_selector_status",
    *_ALIGNED,
    "vehicle_land_detected",
    "vehicle_status",
    "failure_detector_status",
)


def ulog_events(topics: Topics, clocks: Mapping[str, FloatArray]) -> list[Event]:
    """Return what a log tells, message by message; a flag that a log begins with is no event."""
    return [
        *_attitude_resets(topics, clocks),
        *_alignments(topics, clocks),
        *_landings(topics, clocks),
        *_arming(topics, clocks),
        *_failures(topics, clocks),
    ]


def _changes(topics: Topics, clocks: Mapping[str, FloatArray], topic: str, field: str) -> list[tuple[int, float, int]]:
    """Return (row, time, value) wherever a field takes another value."""
    values = topics.get(topic, {}).get(field)
    if values is None:
        return []
    with np.errstate(invalid="ignore"):  # a broken file
        whole = values.astype(np.int64)
    rows = np.flatnonzero(np.diff(whole)) + 1
    return [(int(row), float(clocks[topic][row]), int(whole[row])) for row in rows]


def _attitude_resets(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    counted = _changes(topics, clocks, "vehicle_attitude", "quat_reset_counter")
    turned = topics.get("vehicle_attitude", {}).get("delta_q_reset[0]")
    for row, time_s, _ in counted:
        angle_deg = np.nan if turned is None else 2 * np.degrees(np.arccos(np.clip(abs(float(turned[row])), 0.0, 1.0)))
        text = f"attitude by {angle_deg:.2g} deg" if np.isfinite(angle_deg) else "attitude"
        yield Event(kind=EventKind.RESET, time_s=time_s, text=text)
    if "quat_reset_counter" not in topics.get("vehicle_attitude", {}):  # older logs
        for _, time_s, _ in _changes(topics, clocks, "estimator_status", "reset_count_quat"):
            yield Event(kind=EventKind.RESET, time_s=time_s, text="attitude")
    for _, time_s, number in _changes(topics, clocks, "estimator_selector_status", "primary_instance"):
        yield Event(kind=EventKind.RESET, time_s=time_s, text=f"estimator {number} took over", about="estimator")


def _alignments(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    for topic, fields in _ALIGNED.items():
        for field, text in fields.items():
            for _, time_s, value in _changes(topics, clocks, topic, field):
                if value:
                    yield Event(kind=EventKind.RESET, time_s=time_s, text=text)


def _landings(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    def changes_of(*fields: str) -> list[tuple[float, bool]]:
        changes = [_changes(topics, clocks, "vehicle_land_detected", field) for field in fields]
        return sorted((time_s, bool(value)) for each in changes for _, time_s, value in each)

    landings = changes_of("landed")
    for time_s, landed in landings:
        if not landed:
            yield Event(kind=EventKind.TAKEOFF, time_s=time_s, text="land detector")
    for time_s in touchdowns(changes_of("ground_contact") or changes_of("maybe_landed"), landings):
        yield Event(kind=EventKind.TOUCHDOWN, time_s=time_s, text="land detector")


def _arming(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    states = topics.get("vehicle_status", {}).get("arming_state", np.zeros(0))
    was_armed = bool(len(states)) and states[0] == _ARMED
    for _, time_s, state in _changes(topics, clocks, "vehicle_status", "arming_state"):
        if (state == _ARMED) != was_armed:
            was_armed = not was_armed
            yield Event(kind=EventKind.ARM if was_armed else EventKind.DISARM, time_s=time_s, text="commander")


def _failures(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    topic = "failure_detector_status"
    for field in topics.get(topic, {}):
        text = f"failure detector: {field.removeprefix('fd_').replace('_', ' ')}"
        for _, time_s, value in _changes(topics, clocks, topic, field) if field.startswith("fd_") else ():
            if value:
                yield Event(kind=EventKind.FAILURE, time_s=time_s, text=text)


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
    """Return what a log says of sensors, by fields, and by texts of the autopilot; what it begins with is no event."""
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
                sick = _raised(clocks, topic, (healthy == 0) & (known != 0))
                yield from complaints(sick, f"{about} {slot + 1} isn't healthy ({topic})", about, slot + 1)


def _estimators(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    for number in range(_INSTANCES):
        topic = f"estimator_status#{number}" if number else "estimator_status"
        fields = topics.get(topic, {})
        for field, what in _RATIOS.items():
            if field in fields:
                with np.errstate(invalid="ignore"):
                    rejected = _raised(clocks, topic, fields[field] > 1.0)
                yield from complaints(rejected, f"estimator {number} rejects {what} ({field} above 1)", "estimator")
        if "filter_fault_flags" in fields:
            faults = _raised(clocks, topic, fields["filter_fault_flags"] != 0)
            yield from complaints(faults, f"estimator {number} has a fault (filter_fault_flags)", "estimator")


def _lanes(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    topic = "estimator_selector_status"
    fields = topics.get(topic, {})
    for short, about in _SENSORS.items():
        if (found := fields.get(f"{short}_fault_detected")) is not None:
            yield from complaints(_raised(clocks, topic, found != 0), f"{about} fault detected ({topic})", about)
    for lane in range(_LANES):
        if (healthy := fields.get(f"healthy[{lane}]")) is not None:
            sick = _raised(clocks, topic, healthy == 0)
            yield from complaints(sick, f"estimator {lane} isn't healthy ({topic})", "estimator")


def _texts(messages: Iterable[tuple[float, str]]) -> Iterator[Event]:
    for time_s, text in messages:
        if failed := _FAILED.search(text):
            yield from complaints([time_s], text.strip(), _SENSORS[failed[1].lower()], int(failed[2]) + 1)

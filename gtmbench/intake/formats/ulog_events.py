"""Events of a PX4 log: what its estimators, its land detector, commander and failure detector publish."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event, EventKind, touchdowns
from gtmbench.values.clock import FloatArray

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
    was_armed = _first(topics, "vehicle_status", "arming_state") == _ARMED
    for _, time_s, state in _changes(topics, clocks, "vehicle_status", "arming_state"):
        if (state == _ARMED) != was_armed:
            was_armed = not was_armed
            yield Event(kind=EventKind.ARM if was_armed else EventKind.DISARM, time_s=time_s, text="commander")


def _first(topics: Topics, topic: str, field: str) -> float:
    values: Sequence[Any] | NDArray[Any] = topics.get(topic, {}).get(field, ())
    return float(values[0]) if len(values) else np.nan


def _failures(topics: Topics, clocks: Mapping[str, FloatArray]) -> Iterator[Event]:
    found = {
        ("failure_detector_status", field): f"failure detector: {field.removeprefix('fd_').replace('_', ' ')}"
        for field in topics.get("failure_detector_status", {})
        if field.startswith("fd_")
    }
    for (topic, field), text in found.items():
        for _, time_s, value in _changes(topics, clocks, topic, field):
            if value:
                yield Event(kind=EventKind.FAILURE, time_s=time_s, text=text)

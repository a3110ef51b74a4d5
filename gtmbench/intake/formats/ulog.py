"""PX4's ULog, read by pyulog under a limit on the work that a file can make; and what it says beside its sensors.

Estimators, land detector, commander and failure detector publish the events. Complaints are which gyros aren't healthy,
what the estimators reject, which sensor failed and was replaced. Injections: PX4's own, by the command that asks for it
and the topic that says what is in force (units, types and instances of MAVLink's MAV_CMD_INJECT_FAILURE); and RflyMAD's
(Le and others 2024, a dataset for multicopter fault detection and health assessment): its topic `rfly_ctrl_lxl` has the
kind of fault as `id`, how it acts as `mode`, its parameters as `controls`, in force until it says something else.
"""

from __future__ import annotations

import functools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event, EventKind, complaints, onsets, touchdowns
from gtmbench.intake.formats.dialects import PX4
from gtmbench.intake.formats.limits import MOST_COLUMNS, MOST_MESSAGES, check_values, library, quiet, reading
from gtmbench.intake.formats.raw import ANGLES, Format, RawLog, RawSeries, documented_first, euler_deg, in_seconds
from gtmbench.intake.published_failures import GYRO, Injection, injected, spells
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray


class _TooMuchWork(Exception):  # noqa: N818 - no ValueError: pyulog goes on after those
    """A broken file would be read again and again, or declares more than any log has."""


class _Counted:
    """A file that may be read a few times over, and no more: on garbage pyulog steps back for ever."""

    def __init__(self, file: IO[bytes], size: int) -> None:
        self._file = file
        self._bytes_left = 10 * size + (1 << 22)
        self._reads_left = min(2 * MOST_MESSAGES, self._bytes_left)

    def read(self, count: int) -> bytes:
        self._bytes_left -= count
        self._reads_left -= 1
        if min(self._bytes_left, self._reads_left) < 0:
            raise _TooMuchWork("it is broken, or has more messages than any log")
        return self._file.read(count)

    def seek(self, offset: int, whence: int = 0) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def close(self) -> None:
        """Leave the file to who opened it."""


def _bounded(pyulog: ModuleType) -> Any:
    """Return pyulog's reader, but with a limit on the fields that a file can declare."""
    left = 20 * MOST_COLUMNS

    class Subscription(pyulog.ULog._MessageAddLogged):  # type: ignore[name-defined,misc]
        def _parse_nested_type(self, *arguments: Any) -> None:
            nonlocal left
            before = len(self.field_data)
            super()._parse_nested_type(*arguments)
            left -= 1 + len(self.field_data) - before
            if left < 0:
                raise _TooMuchWork("it declares more fields than any log has")

    class Reader(pyulog.ULog):  # type: ignore[name-defined,misc]
        _MessageAddLogged = Subscription

    return Reader


def read_ulog(path: Path) -> RawLog:
    """Read a PX4 log: every topic with its own stamps; a second instance of a topic is ``topic#1``."""
    kind = "PX4 ULog"
    core = library("pyulog.core", path, kind)
    with reading(path, kind), quiet(), path.open("rb") as file:
        log = _bounded(core)(_Counted(file, path.stat().st_size))
    topics = {}
    for topic in log.data_list:
        name = f"{topic.name}#{topic.multi_id}" if topic.multi_id else str(topic.name)
        fields = {field: values for field, values in topic.data.items() if not field.startswith("_padding")}
        if "timestamp" in fields and len(fields["timestamp"]):
            topics[name] = fields
    check_values(sum(len(fields["timestamp"]) for fields in topics.values()), "its stamps")
    clocks, notes = in_seconds({name: _stamps(fields) for name, fields in topics.items()}, 1e6)
    series = [column for name, fields in topics.items() for column in _columns(name, fields)]
    if log.file_corruption:
        notes = (*notes, "parts of the file are broken and were passed over")
    return RawLog(
        kind=kind,
        series=documented_first(series, PX4),
        clocks=clocks,
        notes=("units and axes are those of PX4's message definitions", *notes),
        by_name=False,
        attitude_from_gyros=True,
        hardware=str(log.msg_info_dict.get("sys_uuid", "")),
        events=functools.partial(
            _events, topics, clocks, [(said.timestamp, said.message) for said in log.logged_messages]
        ),
        injections=functools.partial(ulog_injections, topics, clocks),
    )


def _events(topics: Topics, clocks: Clocks, said: Sequence[tuple[int, str]]) -> list[Event]:
    """Return what the autopilot logged of itself; texts' stamps are on the topics' clock, unless that is an epoch's."""
    messages = [(stamp / 1e6, text) for stamp, text in said]
    return [*ulog_events(topics, clocks), *ulog_complaints(topics, clocks, messages)]


def _stamps(fields: dict[str, NDArray[Any]]) -> NDArray[Any]:
    """Return when a topic was sampled, or published where that isn't logged."""
    sampled = fields.get("timestamp_sample")
    chosen = fields["timestamp"] if sampled is None or not np.all(sampled) else sampled
    return chosen.astype(np.int64) if chosen.max() < 2**63 else chosen.astype(np.float64)


def _columns(topic: str, fields: dict[str, NDArray[Any]]) -> list[RawSeries]:
    columns = {
        name: functools.partial(np.asarray, values) for name, values in fields.items() if "timestamp" not in name
    }
    if all(f"q[{part}]" in fields for part in range(4)):
        parts = [fields[f"q[{part}]"] for part in range(4)]
        columns |= {f"q({angle})": functools.partial(euler_deg, parts, angle) for angle in ANGLES}
    return [
        RawSeries(name=f"{topic}.{name}", load=load, clock=topic, meaning=PX4.get((topic, name)))
        for name, load in columns.items()
    ]


FORMAT = Format(name="PX4 ULog", magic=(b"ULog\x01\x12\x35",), suffixes=(".ulg", ".ulog"), read=read_ulog)


Topics = Mapping[str, Mapping[str, NDArray[Any]]]
Clocks = Mapping[str, FloatArray]
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


def ulog_events(topics: Topics, clocks: Clocks) -> list[Event]:
    """Return what a log tells, message by message; a flag that a log begins with is no event."""
    return [
        *_attitude_resets(topics, clocks),
        *_alignments(topics, clocks),
        *_landings(topics, clocks),
        *_arming(topics, clocks),
        *_failures(topics, clocks),
    ]


def _changes(topics: Topics, clocks: Clocks, topic: str, field: str) -> list[tuple[int, float, int]]:
    """Return (row, time, value) wherever a field takes another value."""
    values = topics.get(topic, {}).get(field)
    if values is None:
        return []
    with np.errstate(invalid="ignore"):  # a broken file
        whole = values.astype(np.int64)
    rows = np.flatnonzero(np.diff(whole)) + 1
    return [(int(row), float(clocks[topic][row]), int(whole[row])) for row in rows]


def _attitude_resets(topics: Topics, clocks: Clocks) -> Iterator[Event]:
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


def _alignments(topics: Topics, clocks: Clocks) -> Iterator[Event]:
    for topic, fields in _ALIGNED.items():
        for field, text in fields.items():
            for _, time_s, value in _changes(topics, clocks, topic, field):
                if value:
                    yield Event(kind=EventKind.RESET, time_s=time_s, text=text)


def _landings(topics: Topics, clocks: Clocks) -> Iterator[Event]:
    def changes_of(*fields: str) -> list[tuple[float, bool]]:
        changes = [_changes(topics, clocks, "vehicle_land_detected", field) for field in fields]
        return sorted((time_s, bool(value)) for each in changes for _, time_s, value in each)

    landings = changes_of("landed")
    for time_s, landed in landings:
        if not landed:
            yield Event(kind=EventKind.TAKEOFF, time_s=time_s, text="land detector")
    for time_s in touchdowns(changes_of("ground_contact") or changes_of("maybe_landed"), landings):
        yield Event(kind=EventKind.TOUCHDOWN, time_s=time_s, text="land detector")


def _arming(topics: Topics, clocks: Clocks) -> Iterator[Event]:
    states = topics.get("vehicle_status", {}).get("arming_state", np.zeros(0))
    was_armed = bool(len(states)) and states[0] == _ARMED
    for _, time_s, state in _changes(topics, clocks, "vehicle_status", "arming_state"):
        if (state == _ARMED) != was_armed:
            was_armed = not was_armed
            yield Event(kind=EventKind.ARM if was_armed else EventKind.DISARM, time_s=time_s, text="commander")


def _failures(topics: Topics, clocks: Clocks) -> Iterator[Event]:
    topic = "failure_detector_status"
    for field in topics.get(topic, {}):
        text = f"failure detector: {field.removeprefix('fd_').replace('_', ' ')}"
        for _, time_s, value in _changes(topics, clocks, topic, field) if field.startswith("fd_") else ():
            if value:
                yield Event(kind=EventKind.FAILURE, time_s=time_s, text=text)


_SENSORS = {"gyro": "gyro", "accel": "accelerometer"}
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


def ulog_complaints(topics: Topics, clocks: Clocks, messages: Iterable[tuple[float, str]]) -> list[Event]:
    """Return what a log says of sensors, by fields, and by texts of the autopilot; what it begins with is no event."""
    return [*_sensors(topics, clocks), *_estimators(topics, clocks), *_lanes(topics, clocks), *_texts(messages)]


def _raised(clocks: Clocks, topic: str, flags: BoolArray) -> list[float]:
    """Return when flags rise, on their topic's clock."""
    time_s = clocks[topic]
    return [float(time_s[row]) for row in onsets(time_s, flags)]


def _sensors(topics: Topics, clocks: Clocks) -> Iterator[Event]:
    topic = "sensors_status_imu"
    fields = topics.get(topic, {})
    for short, about in _SENSORS.items():
        for slot in range(4):  # of sensors_status_imu
            healthy, known = fields.get(f"{short}_healthy[{slot}]"), fields.get(f"{short}_device_ids[{slot}]")
            if healthy is not None and known is not None:
                sick = _raised(clocks, topic, (healthy == 0) & (known != 0))
                yield from complaints(sick, f"{about} {slot + 1} isn't healthy ({topic})", about, slot + 1)


def _estimators(topics: Topics, clocks: Clocks) -> Iterator[Event]:
    for number in range(9):  # of estimator_status
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


def _lanes(topics: Topics, clocks: Clocks) -> Iterator[Event]:
    topic = "estimator_selector_status"
    fields = topics.get(topic, {})
    for short, about in _SENSORS.items():
        if (found := fields.get(f"{short}_fault_detected")) is not None:
            yield from complaints(_raised(clocks, topic, found != 0), f"{about} fault detected ({topic})", about)
    for lane in range(9):  # of estimator_selector_status
        if (healthy := fields.get(f"healthy[{lane}]")) is not None:
            sick = _raised(clocks, topic, healthy == 0)
            yield from complaints(sick, f"estimator {lane} isn't healthy ({topic})", "estimator")


def _texts(messages: Iterable[tuple[float, str]]) -> Iterator[Event]:
    for time_s, text in messages:
        if failed := _FAILED.search(text):
            yield from complaints([time_s], text.strip(), _SENSORS[failed[1].lower()], int(failed[2]) + 1)


_COMMAND = 420  # MAV_CMD_INJECT_FAILURE: param1 the unit, param2 the type, param3 the instance from 1, or 0 for all
_INJECTED_SENSORS = (GYRO, "accelerometer", "magnetometer", "barometer", "GPS", "optical flow", "visual odometry")
_INJECTED_OTHERS = ("battery", "motor", "servo", "avoidance", "RC signal", "MAVLink signal", "ESC")
# of MAVLink's FAILURE_UNIT, by number
_UNITS = dict(enumerate((*_INJECTED_SENSORS, "distance sensor", "airspeed"))) | dict(enumerate(_INJECTED_OTHERS, 100))
_TYPES = ("ok", "off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
_OK = 0
_ACCEPTED = 0  # VehicleCommandAck.msg
_MOST_MESSAGES = 1000  # that are looked at: nobody injects more in a flight
Key = tuple[int, int]  # a unit, an instance (0 for all)
Changes = dict[Key, list[tuple[float, float]]]  # each's times and values


def ulog_injections(topics: Topics, clocks: Clocks) -> list[Injection]:
    """Return the failures that a log says were injected: by the topic that says what is in force, else by commands."""
    in_force = _in_force(topics, clocks)
    changes = _commanded(topics, clocks) if in_force is None else in_force
    found = [
        _injection(key, int(kind), onset_s, end_s)
        for key, each in changes.items()
        for onset_s, end_s, kind in spells(each, _OK)
    ]
    return found + _of_rflymad(topics, clocks)


def _injection(key: Key, kind: int, onset_s: float, end_s: float | None) -> Injection:
    unit, instance = key
    sensor = _UNITS.get(unit, f"unit {unit}")
    said = _TYPES[kind] if 0 <= kind < len(_TYPES) else f"type {kind}"
    text = f"{sensor}{f' {instance}' if instance else ''} {said}"
    return injected(sensor, instance or None, said, (onset_s, end_s), text)


def _in_force(topics: Topics, clocks: Clocks) -> Changes | None:
    """Return every failure's changes by the topic `failure_injection`; None where it isn't logged."""
    fields = topics.get("failure_injection", {})
    counts = fields.get("count")
    if counts is None:
        return None
    changes: Changes = {}
    for row, (time_s, count) in enumerate(
        zip(clocks["failure_injection"][:_MOST_MESSAGES].tolist(), counts[:_MOST_MESSAGES].tolist(), strict=True)
    ):
        now = dict(_entries(fields, row, int(min(count, 4))))  # entries of failure_injection
        for key in {*now, *changes}:
            changes.setdefault(key, []).append((time_s, now.get(key, _OK)))
    return changes


def _entries(fields: Mapping[str, NDArray[Any]], row: int, count: int) -> Iterator[tuple[Key, int]]:
    for entry in range(count):
        columns = [fields.get(f"{name}[{entry}]") for name in ("unit", "instance_mask", "failure_type")]
        if any(column is None for column in columns):
            return
        unit, mask, kind = (int(column[row]) for column in columns if column is not None)
        numbers = [0] if mask == 0xFFFF else [bit + 1 for bit in range(16) if mask >> bit & 1]  # all of them
        for number in numbers:
            yield (unit, number), kind


def _commanded(topics: Topics, clocks: Clocks) -> Changes:
    """Return every failure's changes by the commands, but for those that were answered with a refusal."""
    fields = topics.get("vehicle_command", {})
    names = ("command", "param1", "param2", "param3")
    if not set(names) <= set(fields):
        return {}
    changes: Changes = {}
    refused_s = _refused_s(topics, clocks)
    asked = np.flatnonzero(fields["command"] == _COMMAND)[:_MOST_MESSAGES]
    for row in asked.tolist():
        time_s = float(clocks["vehicle_command"][row])
        values = [float(fields[name][row]) for name in names[1:]]
        if not np.isfinite(values[:2]).all() or any(0.0 <= at_s - time_s <= 2.0 for at_s in refused_s):
            continue
        unit, kind, instance = (int(value) if np.isfinite(value) else 0 for value in values)
        stopped = [key for key in changes if key[0] == unit and kind == _OK and instance == 0]
        for key in {(unit, instance), *stopped}:
            changes.setdefault(key, []).append((time_s, kind))
    return changes


def _refused_s(topics: Topics, clocks: Clocks) -> list[float]:
    fields = topics.get("vehicle_command_ack", {})
    if not {"command", "result"} <= set(fields):
        return []
    refused = (fields["command"] == _COMMAND) & (fields["result"] != _ACCEPTED)
    return [float(time_s) for time_s in clocks["vehicle_command_ack"][refused][:_MOST_MESSAGES]]


_RFLYMAD = "rfly_ctrl_lxl"
_NOT_COMMANDED = 0
# ids that are no fault: nothing commanded yet, "without", a waiting time
_RFLYMAD_HEALTHY = (_NOT_COMMANDED, 123549, 123540)
# of rfly_ctrl_lxl, by the id
_RFLYMAD_UNITS = {123450: "motor", 123451: "propeller", 123452: "accelerometer", 123453: GYRO, 123454: "barometer"}
_RFLYMAD_UNITS |= {123455: "magnetometer", 123456: "GPS"} | dict.fromkeys(range(123457, 123460), "payload")
_RFLYMAD_UNITS |= dict.fromkeys(range(123541, 123544), "battery") | dict.fromkeys(range(123544, 123549), "wind")
_RFLYMAD_MODES = {3.0: "noise", 4.0: "scale factor"}  # of sensors; motors have others


def _of_rflymad(topics: Topics, clocks: Clocks) -> list[Injection]:
    """Return the faults that a log of RflyMAD says were injected; nothing of other logs."""
    fields = topics.get(_RFLYMAD, {})
    if not {"id", "mode"} <= set(fields):
        return []
    ids, times_s = fields["id"].astype(np.int64), clocks[_RFLYMAD]
    # nobody injects more in a flight
    begins = np.flatnonzero(np.diff(ids, prepend=_NOT_COMMANDED))[:1000].tolist()
    ends_s = [*(float(times_s[row]) for row in begins[1:]), None][: len(begins)]
    return [
        _rflymad_injection(int(ids[row]), fields, row, float(times_s[row]), end_s)
        for row, end_s in zip(begins, ends_s, strict=True)
        if ids[row] not in _RFLYMAD_HEALTHY
    ]


def _rflymad_injection(
    kind: int, fields: Mapping[str, NDArray[Any]], row: int, onset_s: float, end_s: float | None
) -> Injection:
    """Return a fault by the first message that commands it; its parameters in the log's words, for none has a unit."""
    mode = float(fields["mode"][row])
    controls = [fields.get(f"controls[{place}]") for place in range(16)]
    values = [float(column[row]) for column in controls if column is not None]
    while values and values[-1] == 0.0:
        values.pop()
    sensor = _RFLYMAD_UNITS.get(kind, f"unit {kind}")
    said = _RFLYMAD_MODES.get(mode, f"mode {mode:g}") if kind in range(123452, 123457) else f"mode {mode:g}"
    text = f"{sensor} {said}: {', '.join(f'{value:g}' for value in values)}"
    return injected(sensor, None, said, (onset_s, end_s), text)

"""Failures that PX4's logs say were injected: by PX4 itself, and in the data set RflyMAD.

PX4: the command that asks for it, and the topic that says what is in force; units, types and instances are those of
MAVLink's MAV_CMD_INJECT_FAILURE, FAILURE_UNIT and FAILURE_TYPE. RflyMAD (Le and others 2024, a dataset for multicopter
fault detection and health assessment): of the topic `rfly_ctrl_lxl`, `id` is the kind of fault, `mode` how it acts,
`controls` its parameters. In force is what the topic says until it says something else.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.formats.ulog_events import Topics
from gtmbench.intake.injections import GYRO, Injection, injected, spells
from gtmbench.values.clock import FloatArray

_COMMAND = 420  # MAV_CMD_INJECT_FAILURE: param1 the unit, param2 the type, param3 the instance from 1, or 0 for all
_SENSORS = (GYRO, "accelerometer", "magnetometer", "barometer", "GPS", "optical flow", "visual odometry")
_OTHERS = ("battery", "motor", "servo", "avoidance", "RC signal", "MAVLink signal", "ESC")
_UNITS = dict(enumerate((*_SENSORS, "distance sensor", "airspeed"))) | dict(enumerate(_OTHERS, 100))
_TYPES = ("ok", "off", "stuck", "garbage", "wrong", "slow", "delayed", "intermittent")
_OK = 0
_ACCEPTED = 0  # VehicleCommandAck.msg
_ANSWERED_S = 2.0
_MOST_ENTRIES, _MOST_NUMBERS = 4, 16  # of failure_injection, of its instance_mask
_ALL = 0xFFFF
_MOST_MESSAGES = 1000  # that are looked at: nobody injects more in a flight
Key = tuple[int, int]  # a unit, an instance (0 for all)


def ulog_injections(topics: Topics, clocks: Mapping[str, FloatArray]) -> list[Injection]:
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


def _in_force(topics: Topics, clocks: Mapping[str, FloatArray]) -> dict[Key, list[tuple[float, float]]] | None:
    """Return every failure's changes by the topic `failure_injection`; None where it isn't logged."""
    fields = topics.get("failure_injection", {})
    counts = fields.get("count")
    if counts is None:
        return None
    changes: dict[Key, list[tuple[float, float]]] = {}
    for row, (time_s, count) in enumerate(
        zip(clocks["failure_injection"][:_MOST_MESSAGES].tolist(), counts[:_MOST_MESSAGES].tolist(), strict=True)
    ):
        now = dict(_entries(fields, row, int(min(count, _MOST_ENTRIES))))
        for key in {*now, *changes}:
            changes.setdefault(key, []).append((time_s, now.get(key, _OK)))
    return changes


def _entries(fields: Mapping[str, NDArray[Any]], row: int, count: int) -> Iterator[tuple[Key, int]]:
    for entry in range(count):
        columns = [fields.get(f"{name}[{entry}]") for name in ("unit", "instance_mask", "failure_type")]
        if any(column is None for column in columns):
            return
        unit, mask, kind = (int(column[row]) for column in columns if column is not None)
        numbers = [0] if mask == _ALL else [bit + 1 for bit in range(_MOST_NUMBERS) if mask >> bit & 1]
        for number in numbers:
            yield (unit, number), kind


def _commanded(topics: Topics, clocks: Mapping[str, FloatArray]) -> dict[Key, list[tuple[float, float]]]:
    """Return every failure's changes by the commands, but for those that were answered with a refusal."""
    fields = topics.get("vehicle_command", {})
    names = ("command", "param1", "param2", "param3")
    if not set(names) <= set(fields):
        return {}
    changes: dict[Key, list[tuple[float, float]]] = {}
    refused_s = _refused_s(topics, clocks)
    asked = np.flatnonzero(fields["command"] == _COMMAND)[:_MOST_MESSAGES]
    for row in asked.tolist():
        time_s = float(clocks["vehicle_command"][row])
        values = [float(fields[name][row]) for name in names[1:]]
        if not np.isfinite(values[:2]).all() or any(0.0 <= at_s - time_s <= _ANSWERED_S for at_s in refused_s):
            continue
        unit, kind, instance = (int(value) if np.isfinite(value) else 0 for value in values)
        stopped = [key for key in changes if key[0] == unit and kind == _OK and instance == 0]
        for key in {(unit, instance), *stopped}:
            changes.setdefault(key, []).append((time_s, kind))
    return changes


def _refused_s(topics: Topics, clocks: Mapping[str, FloatArray]) -> list[float]:
    fields = topics.get("vehicle_command_ack", {})
    if not {"command", "result"} <= set(fields):
        return []
    refused = (fields["command"] == _COMMAND) & (fields["result"] != _ACCEPTED)
    return [float(time_s) for time_s in clocks["vehicle_command_ack"][refused][:_MOST_MESSAGES]]


_RFLYMAD = "rfly_ctrl_lxl"
_NOT_COMMANDED = 0
_RFLYMAD_HEALTHY = (
    _NOT_COMMANDED,
    123549,
    123540,
)  # ids that are no fault: nothing commanded yet, "without", a waiting time
_RFLYMAD_UNITS = {123450: "motor", 123451: "propeller", 123452: "accelerometer", 123453: GYRO, 123454: "barometer"}
_RFLYMAD_UNITS |= {123455: "magnetometer", 123456: "GPS"} | dict.fromkeys(range(123457, 123460), "payload")
_RFLYMAD_UNITS |= dict.fromkeys(range(123541, 123544), "battery") | dict.fromkeys(range(123544, 123549), "wind")
_RFLYMAD_SENSORS = range(123452, 123457)
_RFLYMAD_MODES = {3.0: "noise", 4.0: "scale factor"}  # of sensors; motors have others
_MOST_CHANGES = 1000  # that are looked at: nobody injects more in a flight
_MOST_CONTROLS = 16


def _of_rflymad(topics: Topics, clocks: Mapping[str, FloatArray]) -> list[Injection]:
    """Return the faults that a log of RflyMAD says were injected; nothing of other logs."""
    fields = topics.get(_RFLYMAD, {})
    if not {"id", "mode"} <= set(fields):
        return []
    ids, times_s = fields["id"].astype(np.int64), clocks[_RFLYMAD]
    begins = np.flatnonzero(np.diff(ids, prepend=_NOT_COMMANDED))[:_MOST_CHANGES].tolist()
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
    controls = [fields.get(f"controls[{place}]") for place in range(_MOST_CONTROLS)]
    values = [float(column[row]) for column in controls if column is not None]
    while values and values[-1] == 0.0:
        values.pop()
    sensor = _RFLYMAD_UNITS.get(kind, f"unit {kind}")
    said = _RFLYMAD_MODES.get(mode, f"mode {mode:g}") if kind in _RFLYMAD_SENSORS else f"mode {mode:g}"
    text = f"{sensor} {said}: {', '.join(f'{value:g}' for value in values)}"
    return injected(sensor, None, said, (onset_s, end_s), text)

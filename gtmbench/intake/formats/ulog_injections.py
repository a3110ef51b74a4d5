"""PX4's failure injection, as its logs have it: the command that asks for it, and the topic that says what is in force.

Units, types and instances are those of MAVLink's MAV_CMD_INJECT_FAILURE, FAILURE_UNIT and FAILURE_TYPE.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.injections import GYRO, Injection, injected, spells
from gtmbench.values.clock import FloatArray

Topics = Mapping[str, Mapping[str, NDArray[Any]]]
_COMMAND = 420  # MAV_CMD_INJECT_FAILURE: param1 the unit, param2 the type, param3 the instance from 1, or 0 for all
_UNITS = {
    0: GYRO,
    1: "accelerometer",
    2: "magnetometer",
    3: "barometer",
    4: "GPS",
    5: "optical flow",
    6: "visual odometry",
    7: "distance sensor",
    8: "airspeed",
    100: "battery",
    101: "motor",
    102: "servo",
    103: "avoidance",
    104: "RC signal",
    105: "MAVLink signal",
    106: "ESC",
}
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
    return [
        _injection(key, int(kind), onset_s, end_s)
        for key, each in changes.items()
        for onset_s, end_s, kind in spells(each, _OK)
    ]


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

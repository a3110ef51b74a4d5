"""The sensors of a log that no gyro enters, in words: which failed, and what each is compared with."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gtmbench.checks import listed
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.crosscheck.relations import ACCEL, ALPHA, ALTITUDE, ATT, BETA, GPS, MAG, TAS, WIND
from gtmbench.intake.estimator_words import BIAS, RATIO, EstimatorWord
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.study.log.gps_itself import FIX, JUMP
from gtmbench.study.log.other_sensors import Limit, WatchedSensor, kind_of, not_told_apart, possible

NAMES = {
    MAG: "magnetometer",
    GPS: "GPS",
    ACCEL: "accelerometers",
    TAS: "airspeed",
    ALTITUDE: "pressure altitude",
    ALPHA: "angle-of-attack vane",
    BETA: "sideslip vane",
    ATT: "attitude",
    WIND: "wind",
}
_MOST = 4  # alarms of a sensor that are told one by one


def _how(sensor: WatchedSensor, alarm: Alarm) -> str:
    if alarm.test == FIX:
        return f"lost its fix at {alarm.onset_s:.1f} s"
    name = alarm.last.axis.rpartition("_")[2] if alarm.last is not None else ""  # mag_y, gps_down
    axis = "" if not name else f", its {name} axis" if sensor.kind == MAG else f", its velocity {name}"
    said = f"is disturbed from {alarm.time_s:.1f} s on" if sensor.kind == MAG else f"failed at {alarm.time_s:.1f} s"
    return said + axis


def sensor_why(sensor: WatchedSensor) -> str:
    """Say by what a sensor was found, and when it was named."""
    alarm = sensor.failed
    assert alarm is not None  # whoever asks has looked
    named = "" if alarm.isolated_s is None else f", named at {alarm.isolated_s:.2f} s"
    reason = "" if alarm.last is None or not alarm.last.reason else f": {alarm.last.reason}"
    if alarm.test == FIX:
        return f"From {alarm.onset_s:.1f} s on the {NAMES[GPS]} tells no place{reason}."
    if alarm.test == JUMP and alarm.last is not None:
        return f"Alarm at {alarm.onset_s:.1f} s by the {NAMES[GPS]} itself: {alarm.last.reason}."
    return f"Alarm at {alarm.time_s:.2f} s by {alarm.source}{named}{reason}."


def sensor_lines(sensors: Sequence[WatchedSensor]) -> list[str]:
    """Return a line a sensor that no gyro enters, and what was seen of it; nothing without any."""
    if not sensors:
        return []
    lines = ["other sensors, and the error over 2 s from which on each contradicts the rest:"]
    for each in sensors:
        lines.append(f"  {_named(each)}: {_compared(each)}")
        if each.alike:
            lines.append(f"    its errors look like those of {listed([NAMES[other] for other in each.alike], 'or')}")
        lines += [f"    reads nothing from {start_s:.1f} to {end_s:.1f} s" for start_s, end_s in each.silent_s]
        lines += [f"    {_alarm_text(each, alarm)}" for alarm in each.alarms[:_MOST]]
        if len(each.alarms) > _MOST:
            lines.append(f"    {len(each.alarms) - _MOST} alarms more, the last at {each.alarms[-1].time_s:.1f} s")
    return lines


def possible_lines(sensors: Sequence[SensorReadings]) -> list[str]:
    """Say what of some sensors can be compared, and what by that can't be told apart; nothing without any."""
    if not sensors:
        return []
    kinds = dict.fromkeys(map(kind_of, sensors))
    relations = possible(kinds)
    lines = []
    for each in sensors:
        kind = kind_of(each)
        against = dict.fromkeys(
            other for own in relations.values() if kind in own for other in own if other not in (kind, WIND)
        )
        alike = [NAMES[other] for other in not_told_apart(relations, kind)]
        if not any(kind in own for own in relations.values()):
            said = "not watched: the log has nothing to compare it with"
        else:
            itself = ["its own strength"] * (kind == MAG)
            said = f"against {listed([*itself, *(NAMES[other] for other in against)], 'and')}"
        hardly = f"; its errors look like those of {listed(alike, 'or')}" if alike else ""
        lines.append(f"  {NAMES[kind]} ({each.name}): {said}{hardly}")
    return ["other sensors, and what each can be compared with:", *lines]


def estimator_lines(words: Sequence[EstimatorWord]) -> list[str]:
    """Say what a log's estimator thinks of gyros and sensors, in two lines; nothing without any.

    >>> time_s = np.array([0.0, 1.0, 2.0])
    >>> ratios = EstimatorWord(
    ...     quantity=RATIO, of="magnetometer", columns=(), time_s=time_s, values=np.array([0.2, 1.5, 0.4])
    ... )
    >>> estimator_lines([ratios])
    ["the estimator's tests, which reject above 1: magnetometer 1.5 at most, above 1 from 1.0 s"]
    """
    biases = [
        f"{each.of} {each.values.min():.2f} to {each.values.max():.2f}" for each in words if each.quantity == BIAS
    ]
    ratios = [f"{each.of} {_ratio_text(each)}" for each in words if each.quantity == RATIO]
    lines = [f"gyro biases by the estimator: {', '.join(biases)} deg/s"] if biases else []
    return [*lines, *([f"the estimator's tests, which reject above 1: {', '.join(ratios)}"] if ratios else [])]


def _ratio_text(word: EstimatorWord) -> str:
    rejected = np.flatnonzero(word.values > 1.0)
    since = f", above 1 from {word.time_s[rejected[0]]:.1f} s" if len(rejected) else ""
    return f"{word.values.max():.2g} at most{since}"


def sensor_table(sensor: WatchedSensor) -> Mapping[str, Any]:
    """Return a sensor as plain values; what it may be told from stands beside."""
    return {
        "sensor": sensor.kind,
        "name": sensor.name,
        "columns": sensor.columns,
        "why_not": sensor.why_not,
        "limits": [{"against": each.against, "size": each.size, "unit": each.unit} for each in sensor.limits],
        "hardly_told_from": sensor.alike,
        "silent_s": sensor.silent_s,
        "failed_s": None if sensor.failed is None else sensor.failed.time_s,
        "alarms": [
            {
                "time_s": alarm.time_s,
                "ended_s": alarm.ended_s,
                "source": alarm.source,
                "sensor": alarm.sensor,
                "axis": alarm.last.axis if alarm.last is not None and alarm.last.axis else None,
                "candidates": alarm.candidates,
                "doubt": alarm.doubt,
            }
            for alarm in sensor.alarms
        ],
    }


def _named(sensor: WatchedSensor) -> str:
    return f"{NAMES[sensor.kind]} ({sensor.name})"


def _compared(sensor: WatchedSensor) -> str:
    if sensor.why_not:
        return f"not watched: {sensor.why_not}"
    return "; ".join(map(_limit_text, sensor.limits))


def _limit_text(limit: Limit) -> str:
    size = f"{limit.size:.2g} {limit.unit}"
    if not limit.against:
        return f"{size} of the field's strength"
    return f"{size} against {listed([NAMES[other] for other in limit.against], 'and')}"


def _alarm_text(sensor: WatchedSensor, alarm: Alarm) -> str:
    """Say when something was seen, and whether it is this sensor's."""
    end = "" if alarm.ended_s is None else f" to {alarm.ended_s:.1f} s"
    if alarm.test == FIX and alarm.last is not None:
        lost = f"no fix from {alarm.onset_s:.1f} s{end}: {alarm.last.reason}"
        return f"{lost}; may be no fault: {alarm.doubt}" if alarm.doubt else f"failed: {lost}"
    if alarm.test == JUMP and alarm.last is not None:
        told = f"may be no fault ({alarm.doubt})" if alarm.doubt else "failed"
        return f"{told} at {alarm.onset_s:.1f} s: {alarm.last.reason}"
    span = f"from {alarm.time_s:.1f} s{end}, {alarm.source}"
    if alarm.sensor == sensor.kind and not alarm.doubt:
        return f"{'disturbed' if sensor.kind == MAG else 'failed'} {span}"
    if alarm.sensor == sensor.kind:
        return f"may be no fault {span}: {alarm.doubt}"
    others = [NAMES[other] for other in alarm.candidates if other != sensor.kind]
    return f"cannot tell {span}: it or {listed(others, 'or')}" if others else f"cannot tell {span}: not named in time"

"""The sensors of a log that no gyro enters, in words: what each is compared with, and what a GPS shows by itself."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gtmbench.checks import listed
from gtmbench.detectors.alarm import Alarm
from gtmbench.engine.course.relations.registry import compared
from gtmbench.files.plain import attributes
from gtmbench.intake.estimator_words import BIAS, RATIO, EstimatorWord
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.log.judging.gps_itself import FIX
from gtmbench.values.channels import names_of

_GPS, _MAG, _ATTITUDE = "gps", "magnetometer", "attitude"
NAMES = {
    _MAG: "magnetometer",
    _GPS: "GPS",
    "accelerometers": "accelerometers",
    "tas": "airspeed",
    "altitude": "pressure altitude",
    "alpha": "angle-of-attack vane",
    "beta": "sideslip vane",
    _ATTITUDE: "attitude",
}
_WITNESSES = 2  # comparisons that have to show an error of who is named
_MOST = 4  # alarms that are told one by one


def gps_why(alarm: Alarm) -> str:
    """Say by what a GPS was found that failed by itself."""
    reason = "" if alarm.last is None else alarm.last.reason
    if alarm.test == FIX:
        return f"From {alarm.onset_s:.1f} s on the {NAMES[_GPS]} tells no place: {reason}."
    return f"Alarm at {alarm.onset_s:.1f} s by the {NAMES[_GPS]} itself: {reason}."


def gps_lines(alarms: Sequence[Alarm]) -> list[str]:
    """Return what a GPS shows by itself, a line each; nothing without any."""
    lines = [f"  {_alarm_text(alarm)}" for alarm in alarms[:_MOST]]
    if len(alarms) > _MOST:
        lines.append(f"  {len(alarms) - _MOST} more, the last at {alarms[-1].time_s:.1f} s")
    return ["what the GPS shows by itself:", *lines] if lines else []


def sensor_lines(sensors: Sequence[SensorReadings]) -> list[str]:
    """Say what of some sensors is compared with what; nothing without any."""
    if not sensors:
        return []
    relations = compared([channel for each in sensors for channel in each.channels])
    return [
        "other sensors, and what each is compared with:",
        *(f"  {NAMES[kind_of(each)]} ({each.name}): {_against_text(kind_of(each), relations)}" for each in sensors),
    ]


def sensor_table(sensor: SensorReadings, sensors: Sequence[SensorReadings]) -> Mapping[str, Any]:
    """Return a sensor of some as plain values."""
    kind = kind_of(sensor)
    relations = compared([channel for each in sensors for channel in each.channels])
    return {
        "sensor": kind,
        "name": sensor.name,
        "columns": sensor.columns,
        "against": _against(kind, [own for own in relations if kind in own]),
    }


def alarm_table(alarm: Alarm) -> Mapping[str, Any]:
    """Return what a GPS shows by itself as plain values."""
    return {
        **attributes(alarm, "onset_s", "ended_s", "test"),
        "text": "" if alarm.last is None else alarm.last.reason,
        "doubt": alarm.doubt,
    }


def kind_of(sensor: SensorReadings) -> str:
    """Return which sensor some readings are, those of several channels as one."""
    return names_of(sensor.channels[0])[-1]


def _against(kind: str, relations: Sequence[Sequence[str]]) -> list[str]:
    """Return the sensors that are compared with one; all relations but that of altitude and GPS need the attitude."""
    others = dict.fromkeys(other for own in relations for other in own if other != kind)
    return [*others, *[_ATTITUDE] * any({*own} != {_GPS, "altitude"} for own in relations)]


def _against_text(kind: str, relations: Sequence[Sequence[str]]) -> str:
    own = [each for each in relations if kind in each]
    if not own:
        return "with nothing that the log has"
    said = f"with {listed([NAMES[other] for other in _against(kind, own)], 'and')}"
    if kind == _MAG:
        return f"{said}; only one value names it, for iron and currents do all else"
    return said if len(own) >= _WITNESSES else f"{said}; by one comparison, which names nobody alone"


def estimator_lines(words: Sequence[EstimatorWord]) -> list[str]:
    """Say what a log's estimator thinks of gyros and sensors, in two lines; nothing without any."""
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


def _alarm_text(alarm: Alarm) -> str:
    """Say what was seen, and why it may be no fault."""
    reason = "" if alarm.last is None else alarm.last.reason
    end = "" if alarm.ended_s is None else f" to {alarm.ended_s:.1f} s"
    said = f"no fix from {alarm.onset_s:.1f} s{end}: {reason}" if alarm.test == FIX else reason
    return f"{said}; may be no fault: {alarm.doubt}" if alarm.doubt else f"failed: {said}"

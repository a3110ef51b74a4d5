"""What a log tells beside the gyros, in words: other sensors, IMUs, the estimator, the autopilot, injected failures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gtmbench.checks import listed
from gtmbench.detectors.alarm import Alarm
from gtmbench.engine.course.relations.registry import compared
from gtmbench.files.plain import attributes
from gtmbench.intake.estimator_words import BIAS, RATIO, EstimatorWord
from gtmbench.intake.events import Event
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.intake.published_failures import Injection
from gtmbench.log.judging.gps_itself import FIX
from gtmbench.log.truth.autopilot_messages import SENSORS, Beside, beside, of_sensors, words_of
from gtmbench.log.truth.score import NAMED, Scored, ScoredLog, scored
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.words.timeline import NAMES
from gtmbench.report.words.units import counted
from gtmbench.values.channels import names_of

_GPS, _MAG, _ATTITUDE = "gps", "magnetometer", "attitude"
_WITNESSES = 2  # comparisons that have to show an error of who is named
_MOST = 4  # alarms that are told one by one


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


_MOST_WORDS = 6  # of the autopilot, and failures, that are told one by one


def autopilot_lines(watched: WatchedLog) -> list[str]:
    """Return what the autopilot said, each of our alarms with its word; nothing of a log that tells no events."""
    words = words_of(watched.log.events)
    if not watched.log.events:
        return []
    sensors, rest = of_sensors(words), ", nor of its estimator"
    if words:
        rest = f"; {counted(len(words), 'word')} of its estimator or the flight, first {word_text(words[0])}"
    lines = [f"autopilot: {word_text(word)}" for word in sensors[:_MOST_WORDS]]
    lines = lines or [f"autopilot: nothing of {' or '.join(SENSORS)}{rest}"]
    if sensors[_MOST_WORDS:]:
        lines.append(f"autopilot: {len(sensors) - _MOST_WORDS} words more of {' or '.join(SENSORS)}")
    alarms = [alarm for alarm in watched.alarms if not alarm.has_passed]
    return [*lines, *(f"autopilot: {beside_text(each)}" for each in beside(alarms[:_MOST_WORDS], words))]


def word_text(word: Event) -> str:
    """Write what the autopilot said, and when."""
    return f"'{word.text}' at {word.time_s:.2f} s"


def beside_text(each: Beside) -> str:
    """Write an alarm of ours with the autopilot's word."""
    what = f"beside our alarm at {each.alarm.time_s:.2f} s"
    if each.word is None or each.ahead_s is None:
        return f"{what}: nothing"
    when = "later" if each.ahead_s >= 0.0 else "before"
    return f"{what}: {word_text(each.word)}, {abs(each.ahead_s):.2f} s {when}"


def injection_text(injection: Injection) -> str:
    """Write a failure that was injected: of what, how much, from when to when."""
    which = injection.sensor if injection.number is None else f"{injection.sensor} {injection.number}"
    who = f"{', '.join(injection.channels)} of {which}" if injection.channels else which
    size = "" if injection.size is None else f" {injection.size:.3g} {injection.unit}".rstrip()
    until = "on" if injection.end_s is None else f"to {injection.end_s:.2f} s"
    since = f"{injection.onset_s:.2f} s {until}" if injection.end_s is None else f"{injection.onset_s:.2f} {until}"
    return f"{who}: {injection.kind}{size} from {since}"


def injection_lines(watched: WatchedLog) -> list[str]:
    """Return the failures that the log says were injected, each with both delays."""
    rows = scored(watched).rows if watched.log.injections else ()
    lines = [f"injected: {injection_text(row.injection)}; {_answer_text(row)}" for row in rows[:_MOST_WORDS]]
    return [*lines, f"injected: {len(rows) - _MOST_WORDS} failures more"] if rows[_MOST_WORDS:] else lines


def _answer_text(row: Scored) -> str:
    ours = "we: nothing" if row.alarm is None else f"we {row.delay_s:.2f} s later: {row.alarm.verdict}"
    theirs = "nothing" if row.word is None else f"{row.word_delay_s:.2f} s later, '{row.word.text}'"
    return f"{f'{row.why_not}; ' if row.why_not else ''}{ours}; the autopilot: {theirs}"


def imu_lines(watched: WatchedLog) -> list[str]:
    """Return what the IMUs say of each other; nothing of a log that has one."""
    if len(watched.log.imus) < 2 or not (watched.watches or watched.judged):
        return []
    if not watched.further_imus:
        names = listed([imu.name for imu in watched.log.imus])
        return [f"IMUs: {names} can't be compared: no attitude, no common time, or too long"]
    names = listed(watched.compared_imus)
    lines = []
    for each in watched.judged.found if watched.judged else ():
        if each.parts_imus:
            told = "" if each.accuses else f"; {each.doubt or 'no failure is needed for that'}"
            who = f"{listed(each.suspects, 'or')} does with {each.best.kind}"
            lines.append(f"IMUs: they part from {each.onset_s:.1f} s on, as {who}{told}")
    return lines or [f"IMUs: {names} agree in what their means tell"]


def score_verdict(scores: ScoredLog) -> str:
    """Say in a sentence how many of the failures that a log says were injected were found."""
    trials = scores.trials
    if not trials:
        return "Cannot score: no injected failure lies in what was watched."
    found = [row for row in trials if row.alarm is not None]
    named = sum(row.said == NAMED for row in found)
    return (
        f"{len(found)} of {counted(len(trials), 'injected failure')} found, {named} with the right sensor named; "
        f"{_false_text(len(scores.false_alarms), 'alarm')}."
    )


def score_report(scores: ScoredLog) -> list[str]:
    """Return the lines below the table of a scored log."""
    trials = scores.trials
    found = [row for row in trials if row.alarm is not None]
    told = [row for row in trials if row.word is not None and row.word.about in SENSORS]
    said = {row.said: sum(each.said == row.said for each in found) for row in found}
    of = counted(len(trials), "failure")
    ours = ", ".join(f"{count} {what}" for what, count in said.items())
    what = f" ({ours})" if ours else ""
    wrong = [alarm for row in trials for alarm in row.others]
    also = f"; {counted(len(wrong), 'further alarm')} named wrong" if wrong else ""
    return [
        f"we: {len(found)} of {of} found{what}{also}; {_false_text(len(scores.false_alarms), 'alarm')}",
        f"the autopilot: {len(told)} of {of} reported as a sensor's; {_false_text(len(scores.false_words), 'word')}",
    ]


def _false_text(count: int, what: str) -> str:
    return f"{counted(count, f'false {what}')} outside of them"

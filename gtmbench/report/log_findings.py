"""What a watched log shows: faults and where to look, alarms, sizes of residuals, and what became of each stretch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.excursion import rows_of
from gtmbench.detectors.protocol import Watch
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.report.style import colours
from gtmbench.study.log.records import whole_s
from gtmbench.study.log.watched import WatchedLog
from gtmbench.values.record import Record, Span

_BEFORE_S, _AFTER_S, _LONGEST_S = 5.0, 15.0, 90.0  # about a fault, shown large
_MOST_SIGNALS = 6


def faults_of(watched: WatchedLog) -> dict[str, list[Alarm]]:
    """Return the alarms that tell of a fault, by their verdict: one that lasts is told of in every segment."""
    faults: dict[str, list[Alarm]] = {}
    for alarm in watched.alarms:
        if not alarm.has_passed:
            faults.setdefault(alarm.verdict, []).append(alarm)
    return faults


def began_s(alarm: Alarm) -> float:
    """Return when a fault began: as its kind's fit tells, or else the alarm's test."""
    return alarm.onset_s if alarm.last is None else alarm.last.parameters.get("onset_s", alarm.onset_s)


def disarmed_by(alarm: Alarm, watch: Watch) -> list[str]:
    """Return the scores that can't alarm any more since an alarm: its judgement is that the fault lasts."""
    return [name for name, time_s in watch.disarmed.items() if _disarming(time_s, watch) is alarm]


def _disarming(time_s: float, watch: Watch) -> Alarm | None:
    """Return the alarm that was judged at a time, or else the last one before it."""
    told = [alarm for alarm in watch.faults if alarm.time_s <= time_s + 1e-9 and alarm.test != MISSING]
    at_it = [alarm for alarm in told if any(abs(judged.time_s - time_s) < 1e-9 for judged in alarm.judgements)]
    return next(reversed(at_it or told), None)


def about(fault: Alarm, whole: Span) -> Span:
    """Return the span about a fault: from before it began until after it was told."""
    first_s = max(min(began_s(fault), fault.time_s) - _BEFORE_S, fault.time_s - _LONGEST_S)
    last_s = min(max(fault.time_s, fault.isolated_s or fault.time_s) + _AFTER_S, fault.time_s + _LONGEST_S)
    return max(first_s, whole[0]), min(last_s, whole[1])


def whole_of(watched: WatchedLog) -> Span:
    """Return the log's span."""
    return whole_s(watched.log)


def scores_of(watched: WatchedLog) -> list[str]:
    """Return the names of the scores; none where the monitor shows none, or nothing was watched."""
    return list(dict.fromkeys(name for watch in watched.watches for name in watch.scores))


def residuals_of(watched: WatchedLog) -> list[str]:
    """Return the outputs with residuals; none where the monitor has none, or nothing was watched."""
    return list(dict.fromkeys(name for watch in watched.watches for name in watch.residuals))


def tints_of(watched: WatchedLog) -> dict[str, str]:
    """Return every score's and channel's colour, in figure and recording."""
    return colours([*scores_of(watched), *residuals_of(watched), *watched.log.channels])


def signals_of(watched: WatchedLog) -> list[str]:
    """Return the sensors worth looking at: those that are predicted, and those that failed; or else those used."""
    failed = [alarm.sensor for alarm in watched.alarms if alarm.sensor is not None]
    predicted = [name for watch in watched.watches for name in watch.predictions]
    used = [name for name in watched.monitor.channels or watched.log.channels if name in watched.log.channels]
    return list(dict.fromkeys([*predicted, *failed] or used[:_MOST_SIGNALS]))


def passed_alarms(watched: WatchedLog) -> int:
    """Return how many alarms had nothing left to explain: false ones."""
    return sum(alarm.has_passed for alarm in watched.alarms)


def alarm_bound(watched: WatchedLog) -> float | None:
    """Return the upper 95 % bound of false alarms an hour that the log shows; None where nothing was watched."""
    return rate_bound(passed_alarms(watched), watched.armed_hours)


class State(StrEnum):
    """What a stretch of a log was to the monitor."""

    WATCHED = "watched"
    IDENTIFIED = "learnt from"
    ARMING = "the test is arming"
    DISARMED = "after an alarm, no sensor left to watch"
    LOST = "samples missing"
    ENDS = "the record's end: residuals need later samples"
    OUTSIDE = "motion beyond what was learnt"
    LEFT_OUT = "left out"
    GAP = "gap"


TINTS = {
    State.WATCHED: "#a8d8a0",
    State.IDENTIFIED: "#8fbfe8",
    State.ARMING: "#dadada",
    State.DISARMED: "#f4c28a",
    State.LOST: "#b5b5b5",
    State.ENDS: "#cfcfcf",
    State.OUTSIDE: "#e8b7d4",
    State.LEFT_OUT: "#8c8c8c",
    State.GAP: "#ffffff",
}
_STATES = tuple(State)


@dataclass(frozen=True, kw_only=True)
class Stretch:
    """A stretch of a log in one state; within a segment, one ends where the next begins."""

    start_s: float
    end_s: float
    state: State

    @property
    def duration_s(self) -> float:
        """How long it lasts."""
        return self.end_s - self.start_s


def stretches(watched: WatchedLog) -> list[Stretch]:
    """Return what became of the log, from its first sample to its last, in time."""
    parts: list[Stretch] = []
    for segment in watched.log.segments:
        if parts:
            parts.append(Stretch(start_s=parts[-1].end_s, end_s=segment.start_s, state=State.GAP))
        parts += _of_segment(watched, segment)
    return parts


def seconds_by_state(parts: Sequence[Stretch]) -> dict[State, float]:
    """Return how long a log was in each state that it was in, in the order of the states."""
    own = {part.state for part in parts}
    return {state: sum(part.duration_s for part in parts if part.state is state) for state in State if state in own}


def _of_segment(watched: WatchedLog, segment: Record) -> list[Stretch]:
    states = np.full(len(segment), _STATES.index(State.LEFT_OUT), dtype=np.int8)
    for span in watched.identified_s:
        states[_rows(segment, span)] = _STATES.index(State.IDENTIFIED)
    for each in watched.left_out:
        if each.log == watched.log.path:
            states[_rows(segment, each.span)] = _STATES.index(State.LEFT_OUT)
    for watch in watched.watches:
        rows = _rows(segment, (watch.record.start_s, watch.record.end_s))
        if rows.start < rows.stop:
            states[rows] = _of_watch(watch, [name for name in watched.monitor.channels if name in segment.channels])
    edges = [0, *(np.flatnonzero(np.diff(states)) + 1).tolist(), len(segment)]
    return [
        Stretch(
            start_s=segment.time_at(first),
            end_s=segment.time_at(min(last, len(segment) - 1)),
            state=_STATES[states[first]],
        )
        for first, last in pairwise(edges)
    ]


def _rows(segment: Record, span: Span) -> slice:
    """Return the rows of a segment within a span; none where they don't meet."""
    first, last = (round((time_s - segment.start_s) / segment.sample_period_s) for time_s in span)
    return slice(min(max(first, 0), len(segment)), min(max(last + 1, 0), len(segment)))


def _of_watch(watch: Watch, channels: Sequence[str]) -> NDArray[np.int8]:
    """Return the states of a watch's rows, by their numbers; its monitor hears the channels."""
    armed, count = watch.armed, len(watch.record)
    first, last = (int(armed.argmax()), count - 1 - int(armed[::-1].argmax())) if armed.any() else (count, count)
    states = np.full(count, _STATES.index(State.LOST), dtype=np.int8)
    states[:first] = _STATES.index(State.ARMING)
    states[armed] = _STATES.index(State.WATCHED)
    if watch.scores and set(watch.disarmed) == set(watch.scores):
        states[last + 1 :] = _STATES.index(State.DISARMED)
    elif np.isfinite(watch.record.matrix(channels)[last + 1 :]).all():
        states[last + 1 :] = _STATES.index(State.ENDS)
    for excursion in watch.outside:
        if not excursion.is_judged:
            rows = rows_of(excursion, watch.record)
            states[rows.start : rows.stop] = _STATES.index(State.OUTSIDE)
    return states

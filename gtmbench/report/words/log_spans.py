"""What became of every stretch of a log: watched, or why not."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.protocol import Watch
from gtmbench.record import Record, Span
from gtmbench.study.log.watched import WatchedLog


class State(StrEnum):
    """What a stretch of a log was to the monitor."""

    WATCHED = "watched"
    IDENTIFIED = "identified and calibrated on"
    ARMING = "before the test is armed"
    DISARMED = "after an alarm that left nothing to watch"
    LOST = "without a residual (samples missing, look-ahead)"
    LEFT_OUT = "left out"
    GAP = "gap"


TINTS = {
    State.WATCHED: "#a8d8a0",
    State.IDENTIFIED: "#8fbfe8",
    State.ARMING: "#dadada",
    State.DISARMED: "#f4c28a",
    State.LOST: "#b5b5b5",
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
    found: list[Stretch] = []
    for segment in watched.log.segments:
        if found:
            found.append(Stretch(start_s=found[-1].end_s, end_s=segment.start_s, state=State.GAP))
        found += _of_segment(watched, segment)
    return found


def _of_segment(watched: WatchedLog, segment: Record) -> list[Stretch]:
    states = np.full(len(segment), _STATES.index(State.LEFT_OUT), dtype=np.int8)
    for span in watched.identified_s:
        states[_rows(segment, span)] = _STATES.index(State.IDENTIFIED)
    for watch in watched.watches:
        rows = _rows(segment, (watch.record.start_s, watch.record.end_s))
        if rows.start < rows.stop:
            states[rows] = _of_watch(watch)
    edges = [0, *(np.flatnonzero(np.diff(states)) + 1).tolist(), len(segment)]
    time_s = segment.time_s
    return [
        Stretch(
            start_s=float(time_s[first]), end_s=float(time_s[min(last, len(segment) - 1)]), state=_STATES[states[first]]
        )
        for first, last in pairwise(edges)
    ]


def _rows(segment: Record, span: Span) -> slice:
    """Return the rows of a segment within a span; none where they don't meet."""
    first, last = (round((time_s - segment.start_s) / segment.sample_period_s) for time_s in span)
    return slice(min(max(first, 0), len(segment)), min(max(last + 1, 0), len(segment)))


def _of_watch(watch: Watch) -> NDArray[np.int8]:
    """Return the states of a watch's rows, by their numbers."""
    armed = np.flatnonzero(watch.armed)
    first, last = (armed[0], armed[-1]) if len(armed) else (len(watch.record), len(watch.record))
    states = np.full(len(watch.record), _STATES.index(State.LOST), dtype=np.int8)
    states[:first] = _STATES.index(State.ARMING)
    states[armed] = _STATES.index(State.WATCHED)
    if watch.scores and set(watch.disarmed) == set(watch.scores):
        states[last + 1 :] = _STATES.index(State.DISARMED)
    return states

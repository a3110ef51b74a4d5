"""The last two minutes of a link, judged by the engine that judges a log: for what comes too slowly to raise an alarm.

A longer past is worse, and dearer: with five minutes two healthy real logs of 48 are accused on the way, with two none.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.engine.judged import judged
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Record

_NEEDS = frozenset((*GYROS, *ATTITUDE))
_PAST_S = 120.0  # that is judged
_LEAST_S = 30.0  # less tells no constants
_WORKS_S = 5.0  # of the sender's clock, for half a second of work, seldom three; and as long until the next


class Recent:
    """What arrived last, judged every ten seconds of the sender's clock: the work is bounded, however long it flies.

    It is done beside the watch, so that no alarm of a monitor comes later by it, and told a fixed time later, so that a
    saved link tells the same.

    `is_driven`, `is_assumed`: whether the gyros drive the attitude, and whether that is only assumed.
    """

    def __init__(self, *, is_driven: bool, is_assumed: bool) -> None:
        self._is_driven, self._is_assumed = is_driven, is_assumed
        self._rows: deque[Record] = deque()
        self._works = ThreadPoolExecutor(max_workers=1, thread_name_prefix="recent")
        self._asked: Future[tuple[Alarm, ...]] | None = None
        self._due_s: float | None = None
        self._accused_s: dict[str, float] = {}  # when each was accused last: what began before is the same failure
        self._told = 0

    def push(self, rows: Record) -> tuple[Alarm, ...]:
        """Return the alarms of whom the engine accuses and hasn't accused before, as known with these rows."""
        if not _NEEDS.issubset(rows.channels):
            return ()
        if self._due_s is None:
            self._due_s = rows.start_s + _LEAST_S
        told: list[Alarm] = []
        while rows.end_s >= self._due_s:
            count = int(np.searchsorted(rows.time_s, self._due_s)) + 1
            self._rows.append(rows.part(range(count)))
            told += self._turned(float(rows.time_s[count - 1]))
            self._due_s = float(rows.time_s[count - 1]) + _WORKS_S
            if count == len(rows):
                return tuple(told)
            rows = rows.part(range(count, len(rows)))
        self._rows.append(rows)
        return tuple(told)

    def _turned(self, now_s: float) -> list[Alarm]:
        """Ask for what the engine says, or return what it says."""
        if self._asked is None:
            self._ask(now_s)
            return []
        alarms, self._asked = self._asked.result(), None
        return [alarm for each in alarms if (alarm := self._new(each, now_s)) is not None]

    def _ask(self, now_s: float) -> None:
        while self._rows[0].end_s < now_s - _PAST_S:
            self._rows.popleft()
        past = list(self._rows)
        if all(any(np.isfinite(each[name]).any() for each in past) for name in _NEEDS):
            self._asked = self._works.submit(self._judged, past)

    def _judged(self, past: Sequence[Record]) -> tuple[Alarm, ...]:
        return judged(flight_of_records(past, is_driven=self._is_driven, is_assumed=self._is_assumed)).alarms

    def _new(self, alarm: Alarm, now_s: float) -> Alarm | None:
        """Return an alarm as it is known now; None where it names nobody, or tells of what was told before."""
        if alarm.sensor is None:
            return None
        is_new = alarm.onset_s > self._accused_s.get(alarm.sensor, -np.inf)
        self._accused_s[alarm.sensor] = now_s
        if not is_new:
            return None
        known = tuple(replace(each, time_s=now_s) for each in alarm.judgements)
        self._told += 1
        return replace(alarm, number=self._told - 1, fault=-1, time_s=now_s, judgements=known, ended_s=None)

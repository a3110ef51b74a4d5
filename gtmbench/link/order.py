"""Samples of one kind put in order as they come: one that is late is waited for within a bound, and no longer.

The bound is in the sender's time, so what is put in order doesn't depend on when anything arrived, only on the order
in which it did: a link, and the file that was saved of it, give the same samples.
"""

from __future__ import annotations

import bisect
from collections import deque

from gtmbench.link.readings import LinkSample

BOUND_S = 0.1
"""How long a missing sample is waited for, in the sender's time."""
_NEXT = 1.5  # periods: a sample that is no further behind the last is the next one
_SAME = 0.05  # of a period: stamps that are closer are one sample's
_REMEMBERED = 256  # stamps, by which doubles are known from what is late
LONGEST_S = 10.0
"""A longer step is no loss but a silence."""


class InOrder:
    """The samples of one message, each once, in order of their stamps.

    >>> order = InOrder(0.01)
    >>> arrived = [0.00, 0.01, 0.03, 0.02, 0.02, 0.04]
    >>> [[each.time_s for each in order.push(LinkSample(topic="", time_s=at, values=()))] for at in arrived]
    [[0.0], [0.01], [], [0.02, 0.03], [], [0.04]]
    >>> order.doubled, order.late, order.lost
    (1, 0, 0)
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._waiting: list[LinkSample] = []
        self._given: deque[float] = deque(maxlen=_REMEMBERED)
        self.last_s: float | None = None
        self.doubled = self.late = self.lost = 0

    def push(self, sample: LinkSample) -> list[LinkSample]:
        """Return the samples whose turn has come with this one."""
        near_s = _SAME * self._period_s
        if self.last_s is not None and sample.time_s <= self.last_s + near_s:
            is_double = any(abs(sample.time_s - given_s) <= near_s for given_s in self._given)
            self.doubled, self.late = self.doubled + is_double, self.late + (not is_double)
            return []
        place = bisect.bisect_left(self._waiting, sample.time_s, key=_time_s)
        beside = self._waiting[max(place - 1, 0) : place + 1]
        if any(abs(sample.time_s - other.time_s) <= near_s for other in beside):
            self.doubled += 1
            return []
        self._waiting.insert(place, sample)
        return self._due(self._waiting[-1].time_s)

    def rest(self) -> list[LinkSample]:
        """Return what still waits, now that nothing follows."""
        return self._due(float("inf"))

    def _due(self, newest_s: float) -> list[LinkSample]:
        due: list[LinkSample] = []
        while self._waiting:
            first = self._waiting[0]
            if self.last_s is not None:
                step_s = first.time_s - self.last_s
                if step_s > _NEXT * self._period_s and newest_s < first.time_s - self._period_s + BOUND_S:
                    break  # those before it may still come
                if step_s <= LONGEST_S:
                    self.lost += max(round(step_s / self._period_s) - 1, 0)
            due.append(self._waiting.pop(0))
            self.last_s = first.time_s
            self._given.append(first.time_s)
        return due


def _time_s(sample: LinkSample) -> float:
    return sample.time_s

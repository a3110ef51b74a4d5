"""A sender's samples in order, and whose clock and numbers they carry: a reboot is a new clock, two are nobody's.

A sample that is late is waited for within a bound, in the sender's time. So what is put in order doesn't depend on when
anything arrived, only on the order in which it did: a link, and the file that was saved of it, give the same samples.
"""

from __future__ import annotations

import bisect
from collections import deque
from operator import attrgetter

from gtmbench.link.packets import LinkSample

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
        place = bisect.bisect_left(self._waiting, sample.time_s, key=attrgetter("time_s"))
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


BACK_S, ON_S = 2.0, 10.0
"""A stamp that is further behind the newest, or ahead of it, is of another clock or after a silence."""
_SURE = 5  # stamps of another clock, one after the other, until it is taken for the sender's
_MIXED = 5  # times that two clocks took turns within `_WITHIN_S`
_WITHIN_S = 5.0
_BACK, _HALF = 8, 128  # steps of a number, which counts to 255: those back within the first are disorder
_WINDOW, _ODD = 60, 12  # messages; of them such that step further back


class SenderClock:
    """The newest stamp of a sender, and whether its clock was set anew.

    >>> clock = SenderClock()
    >>> [clock.push(at) for at in (100.0, 100.1, 0.1, 0.2, 0.3, 0.4, 0.5)]
    [True, True, False, False, False, False, False]
    >>> clock.has_jumped
    True
    """

    def __init__(self) -> None:
        self.newest_s: float | None = None
        self._strays = 0
        self._turns: deque[float] = deque(maxlen=_MIXED)

    def push(self, time_s: float) -> bool:
        """Tell whether a stamp continues the clock."""
        newest_s = self.newest_s
        if newest_s is not None and not -BACK_S <= time_s - newest_s <= ON_S:
            self._strays += 1
            return False
        if self._strays and newest_s is not None:
            self._turns.append(newest_s)
        self._strays = 0
        self.newest_s = time_s if newest_s is None else max(newest_s, time_s)
        return True

    @property
    def has_jumped(self) -> bool:
        """Whether the last few stamps are all of another clock, or after a silence."""
        return self._strays >= _SURE

    @property
    def is_mixed(self) -> bool:
        """Whether two clocks take turns."""
        if len(self._turns) < _MIXED or self.newest_s is None:
            return False
        return self._turns[-1] - self._turns[0] <= _WITHIN_S and self.newest_s - self._turns[-1] <= _WITHIN_S


class Numbering:
    """The sequence numbers of one sender: those of two, mixed, don't continue each other.

    >>> one, two = Numbering(), Numbering()
    >>> for number in range(100):
    ...     one.push(number)
    ...     two.push(number if number % 2 else (number + 100) % 256)
    >>> one.is_mixed, two.is_mixed
    (False, True)
    """

    def __init__(self) -> None:
        self._last: int | None = None
        self._odd: deque[bool] = deque(maxlen=_WINDOW)

    def push(self, number: int) -> None:
        """Take the next message's number."""
        if self._last is not None:
            self._odd.append(_HALF <= (number - self._last) % 256 < 2 * _HALF - _BACK)
        self._last = number

    @property
    def is_mixed(self) -> bool:
        """Whether the last messages are those of two senders."""
        return sum(self._odd) >= _ODD

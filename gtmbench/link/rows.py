"""Rows on a monitor's clock, made of messages that come each at a rate of its own, in order, by their senders' clocks.

Every message is a lane: its samples are put in order, and laid on the clock as a log's are (`intake.live`). A row is
given when all lanes know it. What a link loses is no sensor's fault: a row for which a whole message is missing is
left out for all sensors alike, so no monitor takes it for a sensor that dropped out.

A sample that is late is waited for within a bound, in the sender's time. So what is put in order doesn't depend on when
anything arrived, only on the order in which it did: a link, and the file that was saved of it, give the same samples.
"""

from __future__ import annotations

import bisect
import math
from collections import deque
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

import numpy as np

from gtmbench.intake.lattice import typical_period
from gtmbench.intake.mapping import Turns
from gtmbench.intake.resampling import HALF, nominal, oversampling
from gtmbench.intake.row_by_row import EvenStamps, Laying, Rows
from gtmbench.link.packets import LinkSample
from gtmbench.values.clock import FloatArray, same_period
from gtmbench.values.record import BoolArray, Record

BOUND_S = 0.1  # how long a missing sample is waited for, in the sender's time
_SAME = 0.05  # of a period: stamps that are closer are one sample's
_REMEMBERED = 256  # stamps, by which doubles are known from what is late
LONGEST_S = 10.0  # a longer step is no loss but a silence


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
                # a sample that is no further behind the last is the next one
                if step_s > 1.5 * self._period_s and newest_s < first.time_s - self._period_s + BOUND_S:
                    break  # those before it may still come
                if step_s <= LONGEST_S:
                    self.lost += max(round(step_s / self._period_s) - 1, 0)
            due.append(self._waiting.pop(0))
            self.last_s = first.time_s
            self._given.append(first.time_s)
        return due


# a stamp that is further behind the newest, or ahead of it, is of another clock or after a silence
BACK_S, ON_S = 2.0, 10.0
_SURE = 5  # stamps of another clock, one after the other, until it is taken for the sender's
_MIXED = 5  # times that two clocks took turns within `_WITHIN_S`
_WITHIN_S = 5.0  # of each other
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


@dataclass(frozen=True, kw_only=True)
class Route:
    """What is read of one message: its channels, and how often it comes."""

    topic: str
    channels: tuple[str, ...]
    period_s: float


def measured_period(stamps_s: Sequence[float]) -> float:
    """Return the period of some samples by their stamps, in whatever order they came; infinity of too few.

    >>> measured_period([0.0, 0.1, 0.3, 0.2, 0.2, 0.4])
    0.1
    """
    own = np.unique(np.round(stamps_s, 6))
    period_s = typical_period(np.diff(own)) if len(own) > 2 else None
    return math.inf if period_s is None else float(round(period_s, 6))


class _Lane:
    """One message's samples, and the rows that they make."""

    def __init__(self, route: Route, start_s: float, period_s: float, *, filtered: bool) -> None:
        self._route, self._start_s, self._period_s, self._filtered = route, start_s, period_s, filtered
        self._typical_s = nominal(route.period_s, period_s)
        self.order = InOrder(self._typical_s)
        self._due: list[LinkSample] = []
        self._turns = Turns()
        self._stamps = EvenStamps(period_s) if same_period(self._typical_s, period_s) else None
        self._laying: Laying | None = None
        self.count = HALF if filtered else 0
        self._values: list[FloatArray] = []
        self._there: list[BoolArray] = []

    def put(self, sample: LinkSample) -> None:
        """Put a sample in order, to be laid."""
        self._due += self.order.push(sample)

    def lay(self) -> None:
        """Lay the samples whose turn has come."""
        samples, self._due = self._due, []
        if not samples:
            return
        time_s = np.array([sample.time_s for sample in samples])
        values = np.array([sample.values for sample in samples])
        if "psi" in self._route.channels:
            self._turns.undo(values[:, self._route.channels.index("psi")])
        if self._laying is None:
            self._laying = self._begun(float(time_s[0]), values.shape[1])
        if self._stamps is not None:
            time_s = self._stamps.even(time_s)
        self._add(self._laying.push(time_s, values))

    def end(self) -> None:
        """Give what still waits: nothing follows, for a while or at all."""
        self._due += self.order.rest()
        self.lay()
        if self._laying is not None:
            self._add(self._laying.end())
            self._laying = None

    def pass_over(self, count: int) -> None:
        """Leave rows out up to a number: nothing is known of them."""
        missing = count - self.count
        if missing > 0:
            width = len(self._route.channels)
            self._add((np.full((missing, width), np.nan), np.zeros((missing, width), dtype=bool)))

    def take(self, count: int) -> tuple[FloatArray, BoolArray]:
        """Return the next rows."""
        if len(self._values) == 1 and len(self._values[0]) == count:  # as nearly always
            values, there = self._values.pop(), self._there.pop()
            return values, there
        values, there = np.concatenate(self._values), np.concatenate(self._there)
        self._values, self._there = [values[count:]], [there[count:]]
        return values[:count], there[:count]

    def _begun(self, first_s: float, width: int) -> Laying:
        margin = HALF if self._filtered else 0
        first = max(math.ceil((first_s - self._start_s) / self._period_s - 1e-3), self.count - margin, 0)
        self.pass_over(first + margin)
        begin_s = self._start_s + first * self._period_s
        if self._stamps is not None:
            self._stamps.begin(begin_s)
        return Laying(begin_s, self._period_s, self._typical_s, width, filtered=self._filtered)

    def _add(self, rows: Rows) -> None:
        if len(rows[0]):
            self._values.append(rows[0])
            self._there.append(rows[1])
            self.count += len(rows[0])


class LinkRows:
    """The rows of one stretch of a link, on an even clock.

    >>> rows = LinkRows([Route(topic="", channels=("p",), period_s=0.1)], 5.0, 0.1)
    >>> [rows.push([LinkSample(topic="", time_s=at, values=(at,))]) for at in (5.0, 5.1)]
    [Record(1 samples, 5..5 s, every 0.1 s: p), Record(1 samples, 5.1..5.1 s, every 0.1 s: p)]
    """

    def __init__(self, routes: Sequence[Route], start_s: float, period_s: float) -> None:
        filtered = any(oversampling(nominal(route.period_s, period_s), period_s) > 1 for route in routes)
        self._start_s, self._period_s = start_s, period_s
        self._lanes = {route.topic: _Lane(route, start_s, period_s, filtered=filtered) for route in routes}
        self.channels = tuple(name for route in routes for name in route.channels)
        self._silent: set[int] = set()
        self._given = HALF if filtered else 0
        self.left_out = 0
        """Rows so far for which a message is missing."""

    @property
    def counts(self) -> Mapping[str, InOrder]:
        """What was counted of each message."""
        return {topic: lane.order for topic, lane in self._lanes.items()}

    def push(self, samples: Sequence[LinkSample]) -> Record | None:
        """Return the rows that some samples complete, None where they complete none; the same in whatever pieces."""
        for sample in samples:
            lane = self._lanes.get(sample.topic)
            if lane is not None:
                lane.put(sample)
                if len(self._lanes) > 1:
                    self._leave_out(lane)
        self._lay()
        return self._taken()

    def _lay(self) -> None:
        for lane in self._lanes.values():
            lane.lay()

    def _leave_out(self, lane: _Lane) -> None:
        """Wait no longer for a message that is missing while another comes."""
        newest_s = lane.order.last_s
        if newest_s is None:
            return
        for other in self._lanes.values():
            last_s = self._start_s if other.order.last_s is None else other.order.last_s
            # a message that is missing for so long while others come isn't waited for any more
            if newest_s - last_s > 1.0:
                self._lay()
                other.end()
                other.pass_over(lane.count)
                self._silent.add(id(other))
            elif id(other) in self._silent and other is lane:  # it is back: laid at once, behind what was left out
                self._silent.discard(id(other))
                self._lay()

    def end(self) -> Record | None:
        """Return the rows that are left."""
        for lane in self._lanes.values():
            lane.end()
        return self._taken()

    def _taken(self) -> Record | None:
        count = min(lane.count for lane in self._lanes.values()) - self._given
        if count <= 0:
            return None
        taken = [lane.take(count) for lane in self._lanes.values()]
        values, there = (np.hstack(parts) for parts in zip(*taken, strict=True))
        lost = np.zeros(count, dtype=bool)
        for part, _ in taken:
            lost |= np.isnan(part).all(axis=1)
        is_plain = not lost.any() and bool(there.all())
        if not is_plain:
            values, there = np.where(lost[:, np.newaxis], np.nan, values), there & ~lost[:, np.newaxis]
            self.left_out += int(np.count_nonzero(lost))
        start_s = self._start_s + round(self._given * self._period_s, 9)
        self._given += count
        return Record(
            values,
            channels=self.channels,
            sample_period_s=self._period_s,
            start_s=start_s,
            there=None if is_plain else there,
        )

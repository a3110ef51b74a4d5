"""Whose clock and whose numbers a link's messages carry: a reboot is a new clock, two senders are nobody's."""

from __future__ import annotations

from collections import deque

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

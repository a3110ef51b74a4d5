"""Channels whose samples go missing while others of the bank live: a finding of its own, a dropout.

Without a channel's samples the residuals that it enters don't exist, so no score can tell of it: the monitor would be
blind and silent. A channel has dropped out when more than half a second of the samples of its last two seconds (and
more than five) are missing: at once, or here and there. It is back when no more than a tenth of a second of them is.

Half a second is far more than what logs lack while all is well, single samples and packets that a radio lost. The two
seconds are for contacts that come and go: a loss of every third sample leaves hardly a window of a residual complete.
As long a wait until it is back keeps those from being a finding each time, and the tenth lets single samples be lost
after as before.

At a row at which every channel is missing nothing was recorded. Such a common gap says nothing of any sensor, so it is
passed over: for this count no time goes by. A channel that hasn't been there yet is missing since the first row. What
is there and only isn't known (`Record.there`: beside a pause, a low-pass knows nothing; a log may leave single samples
out) isn't missing.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm, Judgement
from gtmbench.detectors.monitor.scores import IntArray
from gtmbench.faults.kinds.replacing import Dropout
from gtmbench.values.record import BoolArray

NEVER = np.iinfo(np.int64).max
_TOLERATED_S, _TOLERATED_ROWS = 0.5, 5  # see the module's text
_WINDOW = 4  # times what is tolerated: what is looked at
_BACK = 5  # part of it: what may be missing of a channel that is back

_Change = tuple[int, str, int]  # known with which row, whose, since which row: out or back, by turns


class MissingSamples:
    """Which channels drop out, and when they are back, in rows as they come: the same in whatever chunks.

    `channels`: the bank's, as the columns of what is taken.
    """

    def __init__(self, channels: tuple[str, ...], period_s: float) -> None:
        self._channels = channels
        self._tolerated = max(round(_TOLERATED_S / period_s), _TOLERATED_ROWS)
        self._next = 0  # row
        self._rows: IntArray = np.zeros(0, dtype=int)  # the window's; none while nothing of it is missing
        self._lost: BoolArray = np.zeros((0, len(channels)), dtype=bool)
        self._out = [False] * len(channels)
        self._changes: deque[_Change] = deque()
        self._open: dict[str, Alarm] = {}

    @property
    def due(self) -> int:
        """The row with which the next change is known that hasn't been told."""
        return self._changes[0][0] if self._changes else NEVER

    @property
    def out(self) -> tuple[str, ...]:
        """The channels that are missing, as has been told."""
        return tuple(self._open)

    def take_one(self, row: list[float]) -> None:
        """Take the next row."""
        if len(self._rows) or not math.isfinite(sum(row)):
            self.take(np.isfinite([row]))
        else:
            self._next += 1

    def take(self, there: BoolArray) -> None:
        """Take which samples of the next rows are there, shape (rows, channels)."""
        first, lost = self._next, ~there
        self._next += len(there)
        if not len(self._rows) and not lost.any():
            return
        live = np.flatnonzero(~lost.all(axis=1))
        carried, window = len(self._rows), _WINDOW * self._tolerated
        rows, lost = np.concatenate([self._rows, first + live]), np.concatenate([self._lost, lost[live]])
        changes = [
            change
            for i in np.flatnonzero(lost.any(axis=0)).tolist()
            for change in self._of(i, rows, lost[:, i], carried)
        ]
        self._changes.extend(sorted(changes, key=lambda change: change[0]))
        kept = slice(-window if lost[-window:].any() else len(rows), None)
        self._rows, self._lost = rows[kept], lost[kept]

    def _of(self, channel: int, rows: IntArray, lost: BoolArray, carried: int) -> list[_Change]:
        """Return a channel's changes; at the first `carried` rows they have been told."""
        window, at = _WINDOW * self._tolerated, carried
        changes: list[_Change] = []
        total = np.concatenate([[0], np.cumsum(lost)])
        counts = total[1:].copy()
        counts[window:] -= total[1:-window]
        turns = {
            False: np.flatnonzero(counts > self._tolerated),
            True: np.flatnonzero(counts <= self._tolerated // _BACK),
        }
        while True:
            is_out = self._out[channel]
            place = int(np.searchsorted(turns[is_out], at))
            if place == len(turns[is_out]):
                return changes
            at = int(turns[is_out][place])
            begin = max(at + 1 - window, 0)
            since = begin + int(np.argmax(lost[begin:] != is_out))  # the first that is missing, or is there
            changes.append((int(rows[at]), self._channels[channel], int(rows[since])))
            self._out[channel] = not is_out

    def tell(self, row: int, time_s: Callable[[int], float], number: int) -> list[Alarm]:
        """Return the alarms that a row raises, numbered from `number` on, and those that end with it."""
        told = []
        while self.due <= row:
            known, channel, since = self._changes.popleft()
            now_s, since_s = time_s(known), time_s(since)
            if channel in self._open:
                told.append(replace(self._open.pop(channel), ended_s=since_s, end_known_s=now_s))
                continue
            judged = Judgement(time_s=now_s, sensor=channel, candidates=(channel,), kind=Dropout.kind)
            alarm = Alarm(
                number=number, time_s=now_s, onset_s=since_s, source=channel, test=MISSING, judgements=(judged,)
            )
            self._open[channel] = alarm
            told.append(alarm)
            number += 1
        return told

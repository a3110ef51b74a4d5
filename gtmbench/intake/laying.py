"""Samples laid on an even clock as they come in: each row as soon as the samples are there that it depends on."""

from __future__ import annotations

import numpy as np

from gtmbench.intake.resampling import AFTER, HALF, Places, laid, low_passed, oversampling
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray

Rows = tuple[FloatArray, BoolArray]  # values, and where a sample is there, if not known


class Laying:
    """A stretch without a gap, laid on an even clock from its first sample on.

    Rows are those that `resampled` makes of the whole stretch. One on which a sample stands is given with that sample,
    one between samples with the `AFTER`-th sample behind it, of a source that is filtered `HALF` rows later than that.

    `start_s`: the first sample's time. `period_s`, `typical_s`: the rows' period, and the samples'. `filtered`: whether
    a low-pass follows; by default only where the samples come faster than the rows. A track beside one that is filtered
    has to be filtered alike.

    >>> laying = Laying(5.0, 0.1, 0.1, 1)
    >>> laying.push(np.array([5.0, 5.1]), np.array([[1.0], [2.0]]))[0].ravel()
    array([1., 2.])
    >>> laying.push(np.array([5.25, 5.35]), np.array([[3.5], [4.5]]))[0].ravel()
    array([], dtype=float64)
    >>> laying.end()[0].ravel(), laying.count
    (array([3., 4.]), 4)
    """

    def __init__(
        self, start_s: float, period_s: float, typical_s: float, channels: int, *, filtered: bool | None = None
    ) -> None:
        finer = oversampling(typical_s, period_s)
        self._filtered = finer > 1 if filtered is None else filtered
        self._places = Places(start_s=start_s, period_s=period_s, typical_s=typical_s, finer=finer)
        self._near = self._places.near_s / self._places.step_s
        self._time_s, self._values = np.zeros(0), np.zeros((0, channels))
        self._next = 0  # place
        self._laid: Rows = np.zeros((0, channels)), np.zeros((0, channels), dtype=bool)  # that a filter still needs
        self.count = HALF if self._filtered else 0
        """The next row: so many periods after the start."""

    def push(self, time_s: FloatArray, values: FloatArray) -> Rows:
        """Return the rows that some samples complete."""
        self._time_s = np.concatenate([self._time_s, time_s])
        self._values = np.concatenate([self._values, values])
        if self._are_next(time_s, values):
            self._next += len(time_s)
            self.count += len(time_s)
            rows = values, np.ones(values.shape, dtype=bool)
        else:
            rows = self._laid_to(self._final())
        if len(self._time_s) > 2 * self._places.before:
            first = int(np.searchsorted(self._time_s, self._places.start_s + self._next * self._places.step_s))
            first = max(first - self._places.before, 0)
            self._time_s, self._values = self._time_s[first:], self._values[first:]
        return rows

    def end(self) -> Rows:
        """Return the rows up to the last sample."""
        stop = int(np.floor(self._place(self._time_s[-1:])[0] + 1e-6)) + 1 if len(self._time_s) else 0
        return self._laid_to(max(stop, self._next))

    def _place(self, time_s: FloatArray) -> FloatArray:
        return (time_s - self._places.start_s) / self._places.step_s

    def _are_next(self, time_s: FloatArray, values: FloatArray) -> bool:
        """Tell whether samples are the next rows, one by one."""
        places = self._place(time_s) - np.arange(self._next, self._next + len(time_s))
        return not self._filtered and bool(np.all(np.abs(places) <= self._near)) and bool(np.isfinite(values).all())

    def _final(self) -> int:
        """Return the place before which no later sample changes anything."""
        latest = self._values[-AFTER:]
        if len(latest) == AFTER and np.isfinite(latest).all():
            final_s = float(self._time_s[-AFTER])
        else:
            final_s = min(self._known_s(self._time_s[known]) for known in np.isfinite(self._values).T)
        stop = int(np.floor(self._place(np.array([final_s]))[0])) + 1 if np.isfinite(final_s) else 0
        stop = max(stop, self._next)
        first = int(np.searchsorted(self._time_s, self._places.start_s + (stop - 0.5) * self._places.step_s))
        off = self._place(self._time_s[first:]) - np.arange(stop, stop + len(self._time_s) - first)
        stands = (np.abs(off) <= self._near) & np.isfinite(self._values[first:]).all(axis=1)
        return stop + (len(stands) if stands.all() else int(np.argmin(stands)))

    def _known_s(self, own_s: FloatArray) -> float:
        """Return until when a channel whose samples are at some times is known: while it pauses, until now."""
        now_s = float(self._time_s[-1])
        if not len(own_s) or now_s - own_s[-1] > self._places.longest_s:
            return now_s
        return float(own_s[-AFTER]) if len(own_s) >= AFTER else -np.inf

    def _laid_to(self, stop: int) -> Rows:
        """Return the rows that the places before one complete, and go on to it."""
        finer = self._places.finer
        if self._filtered:  # no further than to the last place that a row's filter needs
            stop = max((stop - 1) // finer * finer + 1, self._next)
        if stop - self._next < (1 if not self._filtered else (self.count + HALF) * finer + 1 - self._next):
            return self._values[:0], np.zeros((0, self._values.shape[1]), dtype=bool)
        first = int(np.searchsorted(self._time_s, self._places.start_s + self._next * self._places.step_s))
        used = slice(max(first - self._places.before, 0), None)
        rows = laid(self._places, self._time_s[used], self._values[used], self._next, stop)
        self._next = stop
        if self._filtered:
            values, there = (np.concatenate(both) for both in zip(self._laid, rows, strict=True))
            count = (len(values) - 1) // finer + 1 - 2 * HALF
            self._laid = values[count * finer :], there[count * finer :]
            rows = low_passed(values, finer), there[HALF * finer :: finer][:count]
        self.count += len(rows[0])
        return rows

"""Levels of a log, chunk by chunk, and what a change of a level could be from each onset on.

A level is what stays the same while nothing breaks: a gyro's error against the attitude, its gain, its noise. A fault
that stays shifts the level of every chunk behind its onset, so it shifts the median of those chunks by its own size.
What the medians behind and before an onset differ by, plus what chance makes of such a difference, is therefore a size
that no fault which begins there has: a larger one would show, whatever else is known. No part of the log is taken for
healthy, and nothing is learnt but how restless the level is, from neighbouring chunks, which a fault parts but once.
"""

from __future__ import annotations

from bisect import insort
from dataclasses import dataclass, field

import numpy as np

from gtmbench.values.record import BoolArray, FloatArray, IntArray

CHUNK_S = 2.0  # as closely as an onset is dated
PROMISED_S = 60.0  # behind an onset, in which what is promised shows
# behind an onset; the late ones for what shows late
WINDOWS_S = ((0.0, 8.0), (0.0, 20.0), (0.0, PROMISED_S), (20.0, PROMISED_S), (30.0, PROMISED_S))
_TELLING, _SETTLED = 10, 20  # chunks that tell their own scatter; the last ones, that tell it of fewer
_FEWEST = 3  # chunks: a median of fewer is none
_DEVIATIONS = 5.0  # of a difference that chance makes in some thousand looks, of noise that is known to a tenth
_OF_SPREAD = 5.0  # times what chunks scatter by: a smaller change is no other constant, and counts in what is promised
_QUANTILE, _OF_NORMAL = 0.6, 0.8416  # of absolute differences: a fault parts few neighbours; the normal law's
_LAGS = (2, 4, 8, 16, 32, 64, 128)  # chunks, over which a level wanders
_UNSURE = 2.4  # twice the relative deviation of a quantile's square, times the root of the number
_PAIRS = 8  # times a lag: chunks of a log, or a step counts as wander
_MEDIAN = 0.5 * np.pi  # variance of a median over that of a mean, of normal values
SPARE = 1.1  # times what is significant: what is promised, for noise changes a little with a fault


@dataclass(frozen=True, kw_only=True, eq=False)
class ChunkLevel:
    """A level, chunk by chunk."""

    values: FloatArray  # shape (chunks,): NaN where it isn't known
    # shape (chunks,): how much each wanders by chance, up to a factor that is the same for all
    deviations: FloatArray = field(repr=False)
    floor: float  # no smaller change is significant: sensors differ by as much in health
    wanders: float = 0.0  # no smaller change says that something broke: it counts in what is promised


@dataclass(frozen=True, kw_only=True, eq=False)
class Shift:
    """What a level's changes could be, by the chunk in which they begin."""

    # shape (chunks,): the smallest change that begins there and would have shown; infinite where none would
    bounds: FloatArray = field(repr=False)
    # rises, falls: the largest change upwards and downwards that shows from any onset, 0 where none does
    rises: float
    falls: float
    onset: int | None  # the chunk from which on the level is another; None where it never changes
    stays: bool = True  # whether it stays another: not where the change is larger from an earlier onset, and is over

    @property
    def size(self) -> float:
        """The larger of both changes; 0 where none shows."""
        return self.rises if self.rises > -self.falls else self.falls


def shift_of(level: ChunkLevel, shown: FloatArray | None = None) -> Shift:
    """Return what changes of a level could be.

    d(j) = median(y(j + l), ..., y(j + L - 1)) - median(y(0), ..., y(j - 1)) for every onset j and window l to L; a
    change of S that stays adds S to it. What is significant is k s(j), by the medians'
    variance and the level's own wander.

    `shown`, shape (windows,): which share of a fault shows in a window; 1 each by default.

    >>> random = np.random.default_rng(1)
    >>> values = 0.1 * random.standard_normal(60)
    >>> healthy = shift_of(ChunkLevel(values=values, deviations=np.full(60, 0.1), floor=0.0))
    >>> healthy.size, bool(0.1 < healthy.bounds[30] < 0.8), bool(np.isinf(healthy.bounds[1]))
    (0.0, True, True)
    >>> stepped = values + np.where(np.arange(60) < 40, 0.0, 1.0)
    >>> broken = shift_of(ChunkLevel(values=stepped, deviations=np.full(60, 0.1), floor=0.0))
    >>> broken.onset, round(broken.size, 1), bool(broken.bounds[40] > 1.0)
    (40, 1.0, True)
    """
    values, deviations = level.values, np.where(np.isfinite(level.values), level.deviations, np.inf)
    # s(j)^2 = var(median before) + var(median behind) + wander^2; a chunk that is unknown has no rate in either
    scale, wander = _restless(values, deviations)
    spread = _OF_SPREAD * scale * float(np.median(deviations[np.isfinite(deviations)])) if np.isfinite(scale) else 0.0
    rates = np.where(np.isfinite(deviations), 1.0 / np.maximum(scale * deviations, 1e-12), 0.0)
    before, before_var, enough = _before(values, rates)
    bounds, most = np.full(len(values), np.inf), np.zeros(len(values))
    for place, (from_s, to_s) in enumerate(WINDOWS_S):
        share = 1.0 if shown is None else float(shown[place])
        behind, behind_var, known = _behind(values, rates, round(from_s / CHUNK_S), round(to_s / CHUNK_S))
        difference = behind - before
        deviation = np.sqrt(before_var + behind_var + wander**2)
        # a fault of size S shows |d| of at least S less what chance takes: so |d| + spare k s bounds it, over its share
        # here; of all windows the closest bound counts
        significant = np.maximum(_DEVIATIONS * deviation, level.floor if level.wanders else max(level.floor, spread))
        there = enough & known
        size = np.where(there, np.abs(difference) + SPARE * significant, np.inf) / share
        bounds = np.minimum(bounds, size)
        # and what is larger than chance and the level's own wander is a change
        shows = there & (np.abs(difference) > np.maximum(significant, max(spread, level.wanders)))
        larger = shows & (np.abs(difference) > np.abs(most))
        most[larger] = difference[larger]
    rises, falls = float(most.max(initial=0.0)), float(most.min(initial=0.0))
    if not most.any():
        return Shift(bounds=bounds, rises=0.0, falls=0.0, onset=None)
    # it stays, from where one step explains the level best, if that step is about as large as the largest change
    onset, largest = stepped_at(values), int(np.argmax(np.abs(most)))
    left = float(np.nanmedian(values[onset:]) - np.nanmedian(values[:onset])) if onset else 0.0
    first = min(onset, largest)
    # with it taken away the level has to be quieter than the change is large: else it is restless, not changed
    without = np.where(np.arange(len(values)) < first, values, values - most[largest])
    count = len(values) - first
    near = without[first if count >= _TELLING else max(len(values) - _SETTLED, 0) :]
    if np.abs(most[largest]) < _by_own_scatter(near, count):  # it is restless there
        return Shift(bounds=bounds, rises=0.0, falls=0.0, onset=None)
    stays = bool(np.abs(left - most[largest]) < 0.5 * np.abs(most[largest]))
    return Shift(bounds=bounds, rises=rises, falls=falls, onset=onset if stays else largest, stays=stays)


def deviation_of(errors: FloatArray) -> float:
    """Return the standard deviation of normal errors by the median of their sizes: 1.4826 times it.

    >>> round(deviation_of(np.random.default_rng(1).standard_normal(10_000)), 2)
    1.0
    """
    return 1.4826 * float(np.median(np.abs(errors)))


def _by_own_scatter(values: FloatArray, count: int) -> float:
    """Return what is significant of a median of so many, by how these values scatter themselves."""
    own = values[np.isfinite(values)]
    if not len(own):
        return np.inf
    scatter = deviation_of(own - np.median(own))
    return float(_DEVIATIONS * scatter * np.sqrt(_MEDIAN / count))


def both_shift(first: Shift, second: Shift) -> Shift:
    """Return what shows only where two levels shift alike: a change of both, up to the larger bound."""
    return Shift(
        bounds=np.maximum(first.bounds, second.bounds),
        rises=min(first.rises, second.rises),
        falls=max(first.falls, second.falls),
        onset=second.onset if first.onset is not None else None,
        stays=second.stays,
    )


def stepped_at(values: FloatArray) -> int:
    """Return the place from which on values are others: where two means part most, by n1 n2 / n (m2 - m1)^2.

    >>> stepped_at(np.array([0.0, 0.1, np.nan, 0.0, 2.0, 2.1, 2.0]))
    4
    """
    known = np.flatnonzero(np.isfinite(values))
    own = np.clip(values[known], *np.quantile(values[known], [0.02, 0.98]))
    count = np.arange(1, len(own))
    sums = np.cumsum(own)[:-1]
    apart = (own.sum() - sums) / (len(own) - count) - sums / count
    return int(known[1 + int(np.argmax(count * (len(own) - count) * np.square(apart)))])


def _restless(values: FloatArray, deviations: FloatArray) -> tuple[float, float]:
    """Return the factor of the deviations by neighbouring chunks, and by how much the level wanders beyond that."""
    apart = _parted(values, deviations, 1)
    if len(apart) < _FEWEST:
        return np.inf, 0.0
    scale = float(np.quantile(apart, _QUANTILE)) / _OF_NORMAL
    usual = float(np.median(deviations[np.isfinite(deviations)]))
    wander = 0.0
    for lag in _LAGS:
        far = _parted(values, deviations, lag)
        if len(values) >= _PAIRS * lag and len(far) >= _FEWEST:
            sure = 1.0 - _UNSURE / np.sqrt(len(far))  # the quantile's square is known to so much of itself
            grown = sure * (float(np.quantile(far, _QUANTILE)) / _OF_NORMAL) ** 2 - scale**2
            wander = max(wander, usual * float(np.sqrt(max(grown, 0.0))))
    return max(scale, 1e-9), wander


def _parted(values: FloatArray, deviations: FloatArray, lag: int) -> FloatArray:
    """Return by how many deviations chunks so far apart differ."""
    own = np.abs(values[lag:] - values[:-lag]) / np.hypot(deviations[lag:], deviations[:-lag])
    return own[np.isfinite(own)]


def _before(values: FloatArray, rates: FloatArray) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the median of all that lies before each chunk, its variance, and where enough is known."""
    medians, known = np.full(len(values), np.nan), np.zeros(len(values), dtype=int)
    ordered: list[float] = []
    for place, value in enumerate(values.tolist()):
        known[place] = count = len(ordered)
        if count:
            medians[place] = 0.5 * (ordered[(count - 1) // 2] + ordered[count // 2])
        if value == value:  # it is known
            insort(ordered, value)
    total = np.concatenate([[0.0], np.cumsum(rates)[:-1]])
    return medians, _variance(known, total), known >= _FEWEST


def _behind(values: FloatArray, rates: FloatArray, first: int, stop: int) -> tuple[FloatArray, FloatArray, BoolArray]:
    """Return the same of the chunks behind each, from the first to the last of a window."""
    window = stop - first
    views = np.lib.stride_tricks.sliding_window_view(np.append(values, np.full(stop - 1, np.nan))[first:], window)
    there = np.isfinite(views)
    known = there.sum(axis=1)
    ordered = np.sort(np.where(there, views, np.inf), axis=1)
    rows = np.arange(len(values))
    low, high = ordered[rows, np.maximum(known - 1, 0) // 2], ordered[rows, np.minimum(known // 2, window - 1)]
    both = known > 0
    medians = np.full(len(values), np.nan)
    medians[both] = 0.5 * (low[both] + high[both])
    ahead = np.append(rates, np.zeros(stop - 1))[first:]
    total = np.lib.stride_tricks.sliding_window_view(ahead, window).sum(axis=1)
    return medians, _variance(known, total), known >= _FEWEST


def _variance(known: IntArray, rates: FloatArray) -> FloatArray:
    """Return the variance of medians of so many values: pi / 2 n / (sum of 1 / s)^2, of normal ones."""
    return np.asarray(_MEDIAN * known / np.maximum(rates, 1e-12) ** 2)

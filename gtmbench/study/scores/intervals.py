"""Figures with what they are uncertain by: shares, rates, quantiles and means of trials that come in flights.

Trials of one flight share its gusts and manoeuvres, so they aren't independent, and whatever is counted is counted in
*blocks*: every interval says what other flights would have given. With one flight it says next to nothing.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtmbench.values.record import BoolArray, FloatArray

IntArray = NDArray[np.int_]

CONFIDENCE = 0.95  # of every interval and test
_BEYOND = (1.0 - CONFIDENCE) / 2.0  # either end
FEWEST_BLOCKS = 6  # that bound a median at 95 %: all on one side of it has the chance 2 / 2^6
_RESAMPLES = 1000  # of which 25 lie beyond each end
_LARGEST = 4_000_000  # weights at a time


@dataclass(frozen=True, kw_only=True)
class Estimate:
    """A figure with its 95 % interval; without bounds where nothing can be said of them."""

    value: float
    low: float | None = None
    high: float | None = None


@dataclass(frozen=True, kw_only=True)
class Share:
    """How many of how many, with the 95 % interval of the share."""

    hits: int
    of: int
    low: float  # low, high: 0 to 1 where nothing was tried
    high: float

    @property
    def value(self) -> float | None:
        """The share; None where nothing was tried."""
        return self.hits / self.of if self.of else None


@dataclass(frozen=True, kw_only=True)
class Rate:
    """Events an hour, with the 95 % interval."""

    events: int
    hours: float
    low: float  # low, high: high is infinite where nothing was watched
    high: float

    @property
    def value(self) -> float | None:
        """Events an hour; None where nothing was watched."""
        return self.events / self.hours if self.hours > 0.0 else None


def exact_interval(hits: float, trials: float) -> tuple[float, float]:
    """Return the interval of a share of independent trials (Clopper and Pearson 1934): at least so confident.

    >>> [round(bound, 4) for bound in exact_interval(324, 324)]
    [0.9887, 1.0]
    """
    from scipy.special import betaincinv

    low = float(betaincinv(hits, trials - hits + 1, _BEYOND)) if hits else 0.0
    high = float(betaincinv(hits + 1, trials - hits, 1.0 - _BEYOND)) if hits < trials else 1.0
    return low, high


def share(hits: BoolArray, blocks: IntArray) -> Share:
    """Return how many are hits, with the interval of as many independent trials as the blocks' scatter amounts to.

    The exact interval of an effective number of trials (Korn and Graubard 1998), as many as would scatter like the
    blocks do, never more than there are trials nor fewer than one. How blocks scatter is known from the trials that
    differ from most: to so many one is added whose whole block goes with it, so that few of them don't pass for
    independence; where all agree it stands beside one.

    `blocks`: shape (trials,); of which block each trial is: 0, 1, ...

    >>> flights = np.repeat(np.arange(12), 10)
    >>> alike, mixed = flights < 6, np.arange(120) % 2 == 0  # 60 of 120, by flights, or evenly within each
    >>> [round(share(hits, flights).high - share(hits, flights).low, 2) for hits in (alike, mixed)]
    [0.66, 0.22]
    """
    trials, count = len(hits), int(np.count_nonzero(hits))
    if not trials:
        return Share(hits=0, of=0, low=0.0, high=1.0)
    effective = _effective_trials(np.asarray(hits, dtype=float), blocks)
    low, high = exact_interval(count / trials * effective, effective)
    return Share(hits=count, of=trials, low=low, high=high)


def _effective_trials(hits: FloatArray, blocks: IntArray) -> float:
    from scipy.stats import t as student

    trials, p = len(hits), float(hits.mean())
    among = len(np.unique(blocks))
    if among < 2:
        return 1.0
    differ = round(min(p, 1.0 - p) * trials)
    effect = 1.0
    if differ:
        deviation = np.bincount(blocks, weights=hits - p)
        variance = among / (among - 1) * float(np.sum(deviation**2))
        effect = max(variance / (trials * p * (1.0 - p)), 1.0)
    differ = max(differ, 1)
    effect = (differ * effect + trials / among) / (differ + 1)
    fewer = student.ppf(1.0 - _BEYOND, trials - 1) / student.ppf(1.0 - _BEYOND, among - 1)
    return max(trials / effect * float(fewer) ** 2, 1.0)


def rate(events: IntArray, hours: FloatArray, blocks: IntArray) -> Rate:
    """Return how many events an hour there are, with the exact interval of a Poisson process.

    Where events come in some blocks more than in others, and more so than chance has it, events and hours count for as
    much less as they scatter more.

    >>> quiet = rate(np.zeros(30, dtype=int), np.full(30, 0.1), np.arange(30))
    >>> quiet.value, quiet.low, round(quiet.high, 2)  # 3.7 / 3 h; one-sided it would be 3.0 / 3 h
    (0.0, 0.0, 1.23)
    """
    from scipy.stats import chi2

    count, total = int(np.sum(events)), float(np.sum(hours))
    if total <= 0.0:
        return Rate(events=count, hours=0.0, low=0.0, high=math.inf)
    scatter = _scatter(np.asarray(events, dtype=float), hours, blocks)
    counted, watched = count / scatter, total / scatter
    low = float(chi2.ppf(_BEYOND, 2.0 * counted)) / (2.0 * watched) if count else 0.0
    high = float(chi2.ppf(1.0 - _BEYOND, 2.0 * counted + 2.0)) / (2.0 * watched)
    return Rate(events=count, hours=total, low=low, high=high)


def _scatter(events: FloatArray, hours: FloatArray, blocks: IntArray) -> float:
    """Return by how much more than chance the blocks' events scatter; 1 where they don't."""
    among, count = len(np.unique(blocks)), float(np.sum(events))
    if among < 2 or not count:
        return 1.0
    deviation = np.bincount(blocks, weights=events - count * hours / np.sum(hours))
    return max(among / (among - 1) * float(np.sum(deviation**2)) / count, 1.0)


def mean(values: FloatArray, blocks: IntArray) -> Estimate:
    """Return a mean, with the interval of a bootstrap over blocks."""

    def weighted(weights: FloatArray) -> FloatArray:
        return np.asarray(weights @ values / weights.sum(axis=1))

    return _bootstrapped(float(np.mean(values)), weighted, blocks)


def quantile(values: FloatArray, q: float, blocks: IntArray) -> Estimate:
    """Return a quantile, one of the values, with the interval of a bootstrap over blocks.

    `values`: shape (trials,); may be infinite.

    >>> quantile(np.arange(100.0), 0.5, np.arange(100)).value
    49.0
    """
    order = np.argsort(values, kind="stable")
    ordered, own = values[order], blocks[order]

    def weighted(weights: FloatArray) -> FloatArray:
        reached = np.cumsum(weights[:, order], axis=1)
        rows = np.argmax(reached >= q * reached[:, -1:] - 1e-9, axis=1)
        return np.asarray(ordered[rows])

    value = float(np.quantile(ordered, q, method="inverted_cdf"))
    return _bootstrapped(value, weighted, blocks) if len(own) else Estimate(value=math.nan)


def _bootstrapped(value: float, weighted: Callable[[FloatArray], FloatArray], blocks: IntArray) -> Estimate:
    """Return a figure with the percentile interval of blocks drawn anew, expanded for few of them (Hesterberg 2015)."""
    from scipy.special import ndtr
    from scipy.stats import t as student

    among, own = np.unique(blocks, return_inverse=True)
    count = len(among)
    if count < FEWEST_BLOCKS:
        return Estimate(value=value)
    rng = np.random.default_rng(count)
    drawn = rng.multinomial(count, np.full(count, 1.0 / count), size=_RESAMPLES).astype(float)
    at_once = max(_LARGEST // len(own), 1)
    found = np.concatenate([weighted(drawn[i : i + at_once][:, own]) for i in range(0, _RESAMPLES, at_once)])
    beyond = float(ndtr(math.sqrt(count / (count - 1)) * student.ppf(_BEYOND, count - 1)))
    low, high = np.quantile(found, [beyond, 1.0 - beyond], method="inverted_cdf")
    return Estimate(value=value, low=float(low), high=float(high))

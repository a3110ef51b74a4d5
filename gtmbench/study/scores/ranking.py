"""Which of two detectors is sooner, on the very same trials; and ranks that claim no more than that shows.

Of every trial that both watched it is asked which alarmed first; one that missed it comes last, and equal delays are a
tie. A flight's trials make one figure, the share of sooner less that of later, and flights are what the test draws:
under the null hypothesis the sign of each flight's figure is as likely turned (a permutation test of paired samples).
Of all pairs, the errors of the first kind are kept to 5 % in all by Holm's (1979) steps.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.study.scores.intervals import CONFIDENCE, Estimate, IntArray, mean
from gtmbench.values.record import FloatArray

LEVEL = 1.0 - CONFIDENCE  # of all comparisons together
_DRAWS = 9999  # of a permutation test: with the flights as they are 10,000
TIE_S = 1e-6  # times are rounded to less


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two detectors on the same trials."""

    first: str
    second: str
    trials: int
    flights: int
    sooner: int  # sooner, later, tied: trials in which the first was
    later: int
    tied: int
    advantage: Estimate  # share of sooner less share of later, -1 to 1
    p: float  # of no difference, by Holm's steps corrected for all pairs

    @property
    def better(self) -> str | None:
        """The one that is significantly sooner; None of a tie."""
        if self.p > LEVEL or self.advantage.value == 0.0:
            return None
        return self.first if self.advantage.value > 0.0 else self.second


@dataclass(frozen=True, kw_only=True)
class Rank:
    """The places that a detector may have: from one more than are better, to before those that are worse."""

    detector: str
    best: int
    worst: int


def compared(delays_s: Mapping[str, FloatArray], flights: IntArray) -> tuple[Comparison, ...]:
    """Return a comparison of every pair of detectors.

    `delays_s`: mapping of detector to array of shape (trials,); of the same trials in the same order; infinite where
    one was missed. `flights`: shape (trials,); of which flight each trial is.

    >>> flights = np.repeat(np.arange(12), 5)
    >>> delays_s = {"quick": np.full(60, 0.2), "slow": np.full(60, 3.0), "quick, too": np.full(60, 0.2)}
    >>> pairs = compared(delays_s, flights)
    >>> [pair.better for pair in pairs]
    ['quick', None, 'quick, too']
    >>> [(rank.detector, rank.best, rank.worst) for rank in ranks(list(delays_s), pairs)]
    [('quick', 1, 2), ('slow', 3, 3), ('quick, too', 1, 2)]
    """
    pairs = list(itertools.combinations(delays_s, 2))
    signs = [_signs(delays_s[first], delays_s[second]) for first, second in pairs]
    corrected = holm([_p(sign, flights) for sign in signs])
    return tuple(
        Comparison(
            first=first,
            second=second,
            trials=len(sign),
            flights=len(np.unique(flights)),
            sooner=int(np.sum(sign > 0)),
            later=int(np.sum(sign < 0)),
            tied=int(np.sum(sign == 0)),
            advantage=mean(sign, flights),
            p=p,
        )
        for (first, second), sign, p in zip(pairs, signs, corrected, strict=True)
    )


def _signs(first_s: FloatArray, second_s: FloatArray) -> FloatArray:
    """Return 1 where the first is sooner, -1 where the second is, 0 of a tie."""
    sooner, later = first_s < second_s - TIE_S, second_s < first_s - TIE_S  # infinite less something stays so
    return np.asarray(sooner.astype(float) - later)


def _p(signs: FloatArray, flights: IntArray) -> float:
    """Return how likely so much of a difference is where there is none."""
    from scipy.stats import permutation_test

    _, of_flight = np.unique(flights, return_inverse=True)
    trials = np.bincount(of_flight)
    figures = np.bincount(of_flight, weights=signs) / trials.mean()  # a flight weighs as its trials
    if len(figures) < 2 or not figures.any():
        return 1.0

    def difference(x: FloatArray, y: FloatArray, axis: int) -> FloatArray:
        return np.asarray(np.mean(x - y, axis=axis))

    found = permutation_test(
        (figures / 2.0, -figures / 2.0),
        difference,
        permutation_type="samples",
        vectorized=True,
        n_resamples=_DRAWS,
        rng=np.random.default_rng(len(figures)),
    )
    return float(found.pvalue)


def holm(p: ArrayLike) -> list[float]:
    """Return the values of several tests, corrected so that all of them together err as rarely as one (Holm 1979).

    >>> holm([0.01, 0.04, 0.03])
    [0.03, 0.06, 0.06]
    """
    values = np.asarray(p, dtype=float)
    order = np.argsort(values, kind="stable")
    stepped = np.maximum.accumulate(values[order] * np.arange(len(values), 0, -1))
    corrected = np.empty(len(values))
    corrected[order] = np.minimum(stepped, 1.0)
    return [float(round(value, 12)) for value in corrected]


def ranks(detectors: Sequence[str], comparisons: Sequence[Comparison]) -> tuple[Rank, ...]:
    """Return the places that each detector may have; those that no test tells apart share theirs."""
    better = [pair.better for pair in comparisons]
    found = []
    for name in detectors:
        own = [won for pair, won in zip(comparisons, better, strict=True) if name in (pair.first, pair.second)]
        won, lost = own.count(name), sum(other not in (name, None) for other in own)
        found.append(Rank(detector=name, best=1 + lost, worst=len(detectors) - won))
    return tuple(found)


def moved_rank(detector: str, delays_s: Mapping[str, FloatArray], flights: IntArray, comparisons: int) -> Rank:
    """Return the places that one detector may have, by tests against the others alone, as strict as so many ask for.

    >>> flights = np.repeat(np.arange(12), 5)
    >>> moved_rank("quick", {"quick": np.full(60, 0.2), "slow": np.full(60, 3.0)}, flights, 3)
    Rank(detector='quick', best=1, worst=1)
    """
    won = lost = 0
    for other in delays_s:
        signs = _signs(delays_s[detector], delays_s[other])
        if other != detector and _p(signs, flights) * comparisons <= LEVEL:
            sooner = mean(signs, flights).value > 0.0
            won, lost = won + sooner, lost + (not sooner)
    return Rank(detector=detector, best=1 + lost, worst=len(delays_s) - won)

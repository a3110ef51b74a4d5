"""Thresholds: from healthy residuals to values that a score passes as rarely as wanted.

A statistic is correlated from sample to sample and its tail isn't Gaussian, so neither its samples nor a table of the
normal distribution give a false-alarm rate. The greatest values of long blocks do: blocks are nearly independent
whatever happens inside them, and their upper tail is extrapolated by a generalised Pareto distribution.

All tests of a detector share one tail model. A test alone has some tens of tail values, from which neither a shape nor
a scale can be told well enough to extrapolate thirteen times the scale; fifty tests together can. So the shape is one
for all, and the scale of a test leans on that of the others.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gtmbench.detectors.statistics.statistic import Allowance, Spread, Statistic
from gtmbench.detectors.statistics.whitening import White
from gtmbench.errors import InputError
from gtmbench.files.plain import finite_or_none
from gtmbench.values.record import FloatArray

BLOCK_S = 60.0  # longer than any correlation; shorter where there is little data
_BLOCKS = 40  # wanted for a tail
_TAIL = 0.25  # share of the blocks' maxima that the tail is fitted to
_FEWEST = 5.0  # of the tail's values, independent ones: with fewer a window isn't judged, for it has hardly been seen
RATE = 0.002  # false alarms an hour, wanted where nobody says
_LEAST_TAIL = 10  # values, for a shape or a scale that others lean on
_MOST_SHAPE = 0.3  # from 0, exponential, the theory for likelihood ratios, to heavy
_FAR_SHAPE = 0.5  # of a test by itself: one that is bounded doesn't outvote the others
_OF_THEORY = 500.0  # tail values that the exponential shape counts for, as if 500 had been seen to have it
_OF_OTHERS = 20.0  # tail values that the other tests' scale counts for, as if tests' scales differed by 22 %
_MANY_RECORDS = 5  # to draw from; of fewer, blocks are drawn
_REDRAWS = 10  # calibrations that luck is told by: 45 pairs
_MOST_LUCK = 3.0  # times, in the median, that thresholds of two calibrations may differ

Residual = tuple[FloatArray, White, Spread | None]  # raw and whitened
Healthy = Mapping[str, Sequence[Residual]]  # of an output: one a record
Thresholds = dict[str, dict[str, float]]  # of an output, of a score's label


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoreMaxima:
    """What one test did on healthy records."""

    maxima: list[FloatArray] = field(default_factory=list)  # of every record the greatest values of its blocks
    # of every record the greatest value, also of blocks that aren't complete
    greatest: list[float] = field(default_factory=list)
    reach: float  # rows of a window
    least: Callable[[float], float]  # the threshold that theory asks for at least, of the crossings a row
    in_nats: bool  # whether the test is a log-likelihood ratio, whose tail has a scale of about 1 in theory
    most: float = np.inf  # which nothing passes

    def tail(self) -> FloatArray:
        """Return its maxima on a scale without an end, on which its tail is taken to be exponential.

        What has a greatest value s comes close to it as a power: the negative logarithm of s - m is exponential. That
        is the generalised Pareto distribution of a negative shape, its end known.
        """
        maxima = np.concatenate(self.maxima)
        return maxima if self.most == np.inf else -np.log(np.maximum(self.most - maxima, 1e-300))

    def threshold(self, in_tail: float, least: float) -> float:
        """Return the threshold from that of `tail`, not below the least nor what was seen; none that nothing passes."""
        own = in_tail if self.most == np.inf else self.most - float(np.exp(-in_tail))
        highest = max(own, *self.greatest, least)
        return highest if highest < self.most else np.inf


@dataclass(frozen=True, kw_only=True, eq=False)
class HealthyMaxima:
    """What all tests of a detector did on healthy records: thresholds for any rate are drawn from it, and redrawn."""

    tests: Mapping[tuple[str, str], ScoreMaxima]  # by (output, label)
    rows: int  # of a block
    sample_period_s: float

    @property
    def block_s(self) -> float:
        """How long a block is."""
        return self.rows * self.sample_period_s

    def thresholds(self, rate: float) -> Thresholds:
        """Return the thresholds of all tests for a false-alarm rate an hour, which they share evenly."""
        share = rate / len(self.tests) * self.block_s / 3600.0
        maxima = {key: test.tail() for key, test in self.tests.items()}
        shape = common_shape(list(maxima.values()))
        scale = common_scale([maxima[key] for key, test in self.tests.items() if test.in_nats])
        shortest: dict[str, float] = {}
        for (output, _), test in self.tests.items():
            shortest[output] = min(test.reach, shortest.get(output, np.inf))
        thresholds: Thresholds = {}
        for (output, label), test in self.tests.items():
            # of a block, the share that isn't in the window of the block before; the shortest window is judged anyway
            fresh = 1.0 if test.reach == shortest[output] else min(self.rows / test.reach, 1.0)
            own = tail_threshold(
                maxima[output, label],
                crossings_per_block=share,
                independent=fresh,
                shape=shape,
                scale=scale if test.in_nats else None,
            )
            thresholds.setdefault(output, {})[label] = test.threshold(own, test.least(share / self.rows))
        return thresholds

    def redrawn(self, rate: float, count: int = _REDRAWS) -> list[Thresholds]:
        """Return the thresholds that other flights like these would have given: flights are drawn with replacement.

        Of fewer than five records their blocks are drawn, the same ones of every test.
        """
        return [self._drawn(np.random.default_rng(seed)).thresholds(rate) for seed in range(count)]

    def _drawn(self, draw: np.random.Generator) -> HealthyMaxima:
        records = len(next(iter(self.tests.values())).maxima)
        if records >= _MANY_RECORDS:
            picked = draw.integers(0, records, records).tolist()
            tests = {
                key: replace(test, maxima=[test.maxima[i] for i in picked], greatest=[test.greatest[i] for i in picked])
                for key, test in self.tests.items()
            }
        else:
            seconds = [max(len(test.maxima[i]) for test in self.tests.values()) for i in range(records)]
            where = [draw.uniform(size=blocks) for blocks in seconds]
            tests = {key: _blocks_drawn(test, where) for key, test in self.tests.items()}
        return replace(self, tests=tests)

    def luck(self, rate: float) -> Luck:
        """Return by how much thresholds depend on which flights these happened to be."""
        drawn = [
            np.array([value for of in thresholds.values() for value in of.values()])
            for thresholds in self.redrawn(rate)
        ]
        return Luck.of(np.array(drawn))


def _blocks_drawn(test: ScoreMaxima, where: Sequence[FloatArray]) -> ScoreMaxima:
    """Return blocks of a test at some places, 0 to 1, of each record."""
    maxima = [
        part[(places[: len(part)] * len(part)).astype(int)] for part, places in zip(test.maxima, where, strict=True)
    ]
    return replace(test, maxima=maxima, greatest=[float(np.max(part, initial=-np.inf)) for part in maxima])


@dataclass(frozen=True, kw_only=True)
class Luck:
    """By how much thresholds depend on which flights they happened to be set on."""

    # how many times as high as the other one of two calibrations sets a threshold, in the median of all tests
    median: float
    within: float  # 95 % of the thresholds are within so many times of their median over calibrations

    @classmethod
    def from_provenance(cls, provenance: Mapping[str, Any]) -> Luck | None:
        """Return that of a monitor's provenance, which may hold anything; None where it doesn't say."""
        spread = provenance.get("threshold_spread")
        if not isinstance(spread, Mapping) or not {"median", "within"} <= set(spread):
            return None
        given = [np.inf if spread[key] is None else spread[key] for key in ("median", "within")]
        if not all(isinstance(value, (int, float)) and value >= 1.0 for value in given):
            return None
        return cls(median=float(given[0]), within=float(given[1]))

    def enough(self, records: int) -> int:
        """Return how many records would do, where so many aren't: logarithms differ as one over the root of them."""
        return int(np.ceil(records * (np.log(min(self.median, 1e6)) / np.log(_MOST_LUCK)) ** 2)) + 1

    def check(self, records: int, what: str = "records") -> None:
        """Refuse thresholds that two calibrations on such records set more than three times apart, in the median.

        InputError saying how many records would do.
        """
        if self.median > _MOST_LUCK:
            raise InputError(
                f"the thresholds are chance: {records} other {what} like these would set them {self.median:.2g} times "
                f"as high or low, in the median; give about {self.enough(records)} {what} of this length"
            )

    def table(self) -> dict[str, float | None]:
        """Return it as plain values; None is infinite, where some calibrations judge by a test and others don't."""
        return {"median": finite_or_none(self.median), "within": finite_or_none(self.within)}

    @classmethod
    def of(cls, thresholds: FloatArray) -> Luck:
        """Return that of several calibrations' thresholds, shape (calibrations, tests).

        Thresholds that aren't positive, or that no calibration has, are left out.

        >>> Luck.of(np.array([[10.0], [20.0]]))
        Luck(median=2.0, within=1.414)
        """
        told = thresholds[:, np.isfinite(thresholds).any(axis=0) & (thresholds > 0.0).all(axis=0)]
        if not told.size:
            return cls(median=1.0, within=1.0)
        with np.errstate(invalid="ignore"):
            logs = np.log(told)
            apart = np.abs(logs[:, np.newaxis] - logs)[np.triu_indices(len(logs), 1)]
            off = np.abs(logs - np.median(logs, axis=0))
        # infinite less infinite: a window that neither judges
        median, within = (
            np.median(np.nan_to_num(apart, posinf=np.inf)),
            np.quantile(np.nan_to_num(off, posinf=np.inf), 0.95, method="higher"),
        )
        return cls(median=round(float(np.exp(median)), 3), within=round(float(np.exp(within)), 3))


def healthy_maxima(
    test: Statistic, healthy: Healthy, tolerances: Mapping[str, Allowance], sample_period_s: float
) -> HealthyMaxima:
    """Return the greatest values of all tests in blocks of healthy residuals.

    A block lasts 60 s; less where there are fewer than 40.

    `healthy`, by output: residuals. `tolerances`, by output.
    """
    seconds = sum(len(raw) for raw, *_ in next(iter(healthy.values()))) * sample_period_s
    rows = max(round(float(np.clip(seconds / _BLOCKS, 1.0, BLOCK_S)) / sample_period_s), 1)
    tests: dict[tuple[str, str], ScoreMaxima] = {}
    for output, residuals in healthy.items():
        for raw, white, spread in residuals:
            for score in test.scores(raw, white, sample_period_s, tolerances[output], spread):
                reach = max(float(np.median(score.reach)), 1.0)
                in_nats = score.looks_per_row > 0.0
                new = ScoreMaxima(reach=reach, least=score.least_threshold, in_nats=in_nats, most=score.most)
                seen = tests.setdefault((output, score.label), new)
                seen.maxima.append(block_maxima(score.values, rows))
                seen.greatest.append(float(np.fmax.reduce(score.values, initial=-np.inf)))
    return HealthyMaxima(tests=tests, rows=rows, sample_period_s=sample_period_s)


def block_maxima(values: FloatArray, rows: int) -> FloatArray:
    """Return the greatest value of every complete block of `rows` rows; of the whole, if there is less than one.

    >>> block_maxima(np.array([1.0, 3.0, np.nan, 2.0, 9.0]), 2)
    array([3., 2.])
    """
    if len(values) < rows:
        there = values[np.isfinite(values)]
        return there.max(keepdims=True) if len(there) else there
    blocks = values[: len(values) // rows * rows].reshape(-1, rows)
    filled = np.isfinite(blocks).mean(axis=1) >= 0.5
    return np.asarray(np.nanmax(blocks[filled], axis=1)) if filled.any() else np.zeros(0)


def tail_threshold(
    maxima: FloatArray,
    *,
    crossings_per_block: float,
    independent: float = 1.0,
    shape: float = 0.0,
    scale: float | None = None,
) -> float:
    """Return the value that a block's maximum passes with the probability wanted.

    Above u, the upper quartile of the maxima, P(M > u + y) = 1/4 (1 + xi y / sigma)^(-1/xi), the generalised Pareto
    distribution (Pickands 1975). Never below the greatest of them. Its scale is an estimate that stands on k values
    above u: of an exponential tail the next maximum passes u + sigma s with the probability 1/4 (1 + s/k)^-k, which is
    what is asked for here. With many values that is exp(-s); few can't bound what is rare, and the threshold grows
    beyond all measure. A scale that is known from elsewhere, as that of other tests of the same kind, counts for
    20 values: with the gamma distribution as prior, k + 20 stands in place of k.

    `maxima`, shape (blocks,): infinity is returned where there are none: the records are shorter than this test's
    window, so it can't be judged and doesn't alarm. `crossings_per_block`: for rare crossings, their rate times the
    length of a block. `independent`: what share of the maxima tells of samples that no other does: those of a window
    longer than a block share most. Infinity is returned where too few are left. `shape`: xi: `common_shape` of all
    tests; exponential unless told. `scale`: mean excess over u to be expected: `common_scale` of tests of the same
    kind.

    >>> maxima = np.random.default_rng(1).exponential(size=(400, 1000)).max(axis=1)
    >>> bool(abs(tail_threshold(maxima, crossings_per_block=1e-4) - np.log(1000 / 1e-4)) < 2.0)
    True
    """
    if not len(maxima):
        return float("inf")
    u, excess = _tail(maxima)
    greatest = float(maxima.max())
    share = len(excess) / len(maxima) / max(crossings_per_block, 1e-300)
    if share <= 1.0:
        return greatest
    if independent < 1.0 and independent * len(excess) < _FEWEST:
        return float("inf")
    known, of_others = (0.0, 0.0) if scale is None else (_OF_OTHERS, _OF_OTHERS * scale)
    count = len(excess) + known
    mean = max((float(excess.sum()) + of_others) / count, 1e-12)
    with np.errstate(over="ignore"):
        far = count * np.expm1(np.log(share) / count)
        beyond = mean * far if shape < 1e-6 else mean * (1.0 - shape) * np.expm1(shape * far) / shape
    return float(max(u + beyond, greatest))


def common_shape(tests: Sequence[FloatArray]) -> float:
    """Return the one Pareto shape of several tests' maxima, 0 (exponential) to 0.3.

    The mean of the tests' own, from probability-weighted moments (Hosking and Wallis 1987), each weighted by how many
    tail values it stands on; tests that hardly ever leave their lowest value have no tail to tell of. Theory says 0
    for likelihood ratios, and that counts as if 500 values more had shown it: what few values say isn't believed.

    `tests`, shape (blocks,).

    >>> draw = np.random.default_rng(1)
    >>> common_shape([draw.exponential(size=400) for _ in range(50)]) < 0.05
    True
    >>> common_shape([draw.pareto(5.0, size=400) for _ in range(50)]) > 0.1
    True
    """
    total, values = 0.0, _OF_THEORY
    for _, excess in _tails(tests):
        count = len(excess)
        weights = 1.0 - (np.arange(1, count + 1) - 0.35) / count
        mean, moment = float(excess.mean()), float(np.mean(weights * excess))
        total += count * float(np.clip(2.0 - mean / (mean - 2.0 * moment), -_FAR_SHAPE, _FAR_SHAPE))
        values += count
    return float(np.clip(total / values, 0.0, _MOST_SHAPE))


def common_scale(tests: Sequence[FloatArray]) -> float:
    """Return the mean excess of likelihood ratios' maxima over their upper quartile, in nats; at least theory's 1.

    >>> draw = np.random.default_rng(1)
    >>> round(common_scale([draw.exponential(scale=3.0, size=400) for _ in range(50)]), 1)
    3.0
    """
    means = [float(excess.mean()) for _, excess in _tails(tests)]
    return max(float(np.mean(means)) if means else 1.0, 1.0)


def _tail(maxima: FloatArray) -> tuple[float, FloatArray]:
    """Return the upper quartile of maxima, and by how much those above exceed it, in rising order."""
    ordered = np.sort(maxima)
    first = max(len(ordered) - int(_TAIL * len(ordered)), 1)
    u = float(ordered[first - 1])
    return u, ordered[first:] - u


def _tails(tests: Sequence[FloatArray]) -> Iterator[tuple[float, FloatArray]]:
    """Yield the tails of those tests that have one: ten values, above an upper quartile that isn't the lowest value."""
    for maxima in tests:
        if len(maxima):
            u, excess = _tail(maxima)
            if len(excess) >= _LEAST_TAIL and u > maxima.min() and excess[-1] > 0.0:
                yield u, excess


def rate_bound(events: int, hours: float, *, confidence: float = 0.95) -> float | None:
    """Return the upper confidence bound of a Poisson rate per hour; None where nothing was watched.

    No event in T hours: at most 3.0 / T per hour at 95 %.

    >>> round(rate_bound(0, 1.0), 2)
    3.0
    """
    from scipy.special import gammaincinv  # chi2.ppf of scipy.stats is twice that; importing it takes half a second

    return float(gammaincinv(events + 1, confidence)) / hours if hours > 0 else None

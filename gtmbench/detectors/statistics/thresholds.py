"""Thresholds: from healthy residuals to values that a score passes as rarely as wanted.

A statistic is correlated from sample to sample and its tail isn't Gaussian, so neither its samples nor a table of the
normal distribution give a false-alarm rate. The greatest values of long blocks do: blocks are nearly independent
whatever happens inside them, and their upper tail is extrapolated by a generalised Pareto distribution.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gtmbench.detectors.statistics.statistic import Spread, Statistic, Tolerance
from gtmbench.record import FloatArray

_BLOCK_S = 60.0  # longer than any correlation; shorter where there is little data
_BLOCKS = 40  # wanted for a tail
_TAIL = 0.25  # share of the blocks' maxima that the tail is fitted to
_FEWEST = 5.0  # of the tail's values, independent ones: with fewer a window isn't judged, for it has hardly been seen
_SHAPES = (0.0, 0.3)  # from exponential, the theory for likelihood ratios, to heavy

Residual = tuple[FloatArray, FloatArray, Spread | None]  # raw and whitened
Healthy = Mapping[str, Sequence[Residual]]  # of an output: one a record


def thresholds_of(
    test: Statistic, healthy: Healthy, tolerances: Mapping[str, Tolerance], sample_period_s: float, rate: float
) -> tuple[dict[str, dict[str, float]], float]:
    """Return the thresholds of all scores for a false-alarm rate an hour, shared evenly, and the blocks' length in s.

    Parameters
    ----------
    test : Statistic
    healthy : mapping of output to list of (raw, whitened, spread)
        Residuals.
    tolerances : mapping of output to Tolerance
    sample_period_s, rate : float
    """
    hours = sum(len(raw) for raw, *_ in next(iter(healthy.values()))) * sample_period_s / 3600.0
    rows = max(round(float(np.clip(hours * 3600.0 / _BLOCKS, 1.0, _BLOCK_S)) / sample_period_s), 1)
    maxima: dict[tuple[str, str], list[FloatArray]] = {}
    reach: dict[tuple[str, str], float] = {}  # rows of a window
    greatest: dict[tuple[str, str], float] = {}
    least: dict[tuple[str, str], Callable[[float], float]] = {}
    for output, residuals in healthy.items():
        for raw, white, spread in residuals:
            for score in test.scores(raw, white, sample_period_s, tolerances[output], spread):
                key = output, score.label
                maxima.setdefault(key, []).append(block_maxima(score.values, rows))
                # also of blocks that aren't complete
                greatest[key] = float(np.fmax.reduce(score.values, initial=greatest.get(key, -np.inf)))
                least[key] = score.least_threshold
                reach[key] = max(float(np.median(score.reach)), 1.0)
    share = rate / len(maxima) * rows * sample_period_s / 3600.0
    thresholds: dict[str, dict[str, float]] = {output: {} for output in healthy}
    for key, parts in maxima.items():
        output, label = key
        shortest = min(far for (other, _), far in reach.items() if other == output)
        # of a block, the share that isn't in the window of the block before; the shortest window is judged anyway
        fresh = 1.0 if reach[key] == shortest else min(rows / reach[key], 1.0)
        thresholds[output][label] = max(_threshold(parts, share, fresh), greatest[key], least[key](share / rows))
    return thresholds, rows * sample_period_s


def _threshold(parts: list[FloatArray], share: float, independent: float) -> float:
    maxima = np.concatenate(parts)
    if not len(maxima):
        return float("inf")  # the records are shorter than this window: it can't be judged, so it doesn't alarm
    return tail_threshold(maxima, crossings_per_block=share, independent=independent)


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


def tail_threshold(maxima: FloatArray, *, crossings_per_block: float, independent: float = 1.0) -> float:
    """Return the value that a block's maximum passes with the probability wanted.

    Above u, the upper quartile of the maxima, P(M > u + y) = 1/4 (1 + xi y / sigma)^(-1/xi), the generalised Pareto
    distribution (Pickands 1975), fitted by probability-weighted moments (Hosking and Wallis 1987), xi held to 0..0.3.
    Never below the greatest of them. Its scale is an estimate that stands on k values above u: of an exponential tail
    the next maximum passes u + sigma s with the probability 1/4 (1 + s/k)^-k, which is what is asked for here. With
    many values that is exp(-s); few can't bound what is rare, and the threshold grows beyond all measure.

    Parameters
    ----------
    maxima : shape (blocks,)
    crossings_per_block : float
        For rare crossings, their rate times the length of a block.
    independent : float
        What share of the maxima tells of samples that no other does: those of a window longer than a block share most.
        Infinite is returned where too few are left.

    Examples
    --------
    >>> maxima = np.random.default_rng(1).exponential(size=(400, 1000)).max(axis=1)
    >>> bool(abs(tail_threshold(maxima, crossings_per_block=1e-4) - np.log(1000 / 1e-4)) < 2.0)
    True
    """
    ordered = np.sort(maxima)
    u, *above = ordered[-1 - int(_TAIL * len(ordered)) :].tolist()
    share = len(above) / len(ordered) / max(crossings_per_block, 1e-300)
    if share <= 1.0:
        return float(ordered[-1])
    scale, shape = _pareto(np.asarray(above) - u)
    count = len(above)
    if independent < 1.0 and independent * count < _FEWEST:
        return float("inf")
    with np.errstate(over="ignore"):
        far = count * np.expm1(np.log(share) / count)
        beyond = scale * far if shape < 1e-6 else scale * np.expm1(shape * far) / shape
    return float(max(u + beyond, ordered[-1]))


def _pareto(excess: FloatArray) -> tuple[float, float]:
    """Return scale and shape from probability-weighted moments; with few values exponential."""
    count = len(excess)
    mean = float(excess.mean())
    if count < 10 or mean <= 0.0:
        return max(mean, 1e-12), 0.0
    weights = 1.0 - (np.arange(1, count + 1) - 0.35) / count
    moment = float(np.mean(weights * np.sort(excess)))
    shape = float(np.clip(2.0 - mean / (mean - 2.0 * moment), *_SHAPES))
    return mean * (1.0 - shape), shape


def rate_bound(events: int, hours: float, *, confidence: float = 0.95) -> float | None:
    """Return the upper confidence bound of a Poisson rate per hour; None where nothing was watched.

    No event in T hours: at most 3.0 / T per hour at 95 %.

    >>> round(rate_bound(0, 1.0), 2)
    3.0
    """
    from scipy.special import gammaincinv  # chi2.ppf of scipy.stats is twice that; importing it takes half a second

    return float(gammaincinv(events + 1, confidence)) / hours if hours > 0 else None

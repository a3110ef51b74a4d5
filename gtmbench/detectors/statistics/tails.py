"""From the greatest values on healthy flights to a threshold that is crossed as rarely as wanted.

A statistic is correlated from sample to sample and its tail isn't Gaussian, so neither its samples nor a table of the
normal distribution give a false-alarm rate. The greatest values of long blocks do: blocks are nearly independent
whatever happens inside them, and their upper tail is extrapolated by a generalised Pareto distribution.
"""

from __future__ import annotations

import numpy as np

from gtmbench.record import FloatArray

_TAIL = 0.25  # share of the blocks' maxima that the tail is fitted to
_SHAPES = (0.0, 0.3)  # from exponential, the theory for likelihood ratios, to heavy


def block_maxima(values: FloatArray, rows: int) -> FloatArray:
    """Return the greatest value of every complete block of `rows` rows; of the whole, if there is less than one.

    >>> block_maxima(np.array([1.0, 3.0, np.nan, 2.0, 9.0]), 2)
    array([3., 2.])
    """
    if len(values) < rows:
        there = values[np.isfinite(values)]
        return there.max(keepdims=True) if len(there) else there
    blocks = values[: len(values) // rows * rows].reshape(-1, rows)
    seen = np.isfinite(blocks).mean(axis=1) >= 0.5
    return np.asarray(np.nanmax(blocks[seen], axis=1)) if seen.any() else np.zeros(0)


def tail_threshold(maxima: FloatArray, *, crossings_per_block: float) -> float:
    """Return the level that a block's maximum passes with the probability wanted.

    Above u, the upper quartile of the maxima, P(M > u + y) = 1/4 (1 + xi y / sigma)^(-1/xi), the generalised Pareto
    distribution (Pickands 1975), fitted by probability-weighted moments (Hosking and Wallis 1987), xi held to 0..0.3.
    Never below the greatest value seen. The scale is an estimate, so that the probability in the mean is greater: of
    an exponential tail and k values above u, at most 1/4 (1 + s/k)^-k, s = log(1/4 / wanted).

    Parameters
    ----------
    maxima : shape (blocks,)
    crossings_per_block : float
        For rare crossings, their rate times the length of a block.

    Examples
    --------
    >>> maxima = np.random.default_rng(1).exponential(size=(400, 1000)).max(axis=1)
    >>> bool(abs(tail_threshold(maxima, crossings_per_block=1e-4) - np.log(1000 / 1e-4)) < 2.0)
    True
    """
    ordered = np.sort(maxima)
    level, *above = ordered[-1 - int(_TAIL * len(ordered)) :].tolist()
    share = len(above) / len(ordered) / max(crossings_per_block, 1e-300)
    if share <= 1.0:
        return float(ordered[-1])
    scale, shape = _pareto(np.asarray(above) - level)
    beyond = scale * np.log(share) if shape < 1e-6 else scale * (share**shape - 1.0) / shape
    return float(max(level + beyond, ordered[-1]))


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
    from scipy.stats import chi2

    return float(chi2.ppf(confidence, 2 * events + 2)) / (2.0 * hours) if hours > 0 else None

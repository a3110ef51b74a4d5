"""The noise of a relation: how loud at which motion, how it goes on, how far means wander; from the whole log."""

from __future__ import annotations

import numpy as np

from gtmbench.values.record import BoolArray, FloatArray

ORDER = 5  # of the autoregression; as many blocks as a second has, and half or twice as many change little
_BINS, _FEWEST = 6, 60  # of liveliness; blocks of one
CLIPPED = 5.0  # deviations: what is beyond is no noise
_RIDGE = 1e-2  # of the autocorrelation, or a tone makes the filter ring
_OF_NORMAL = 1.4826  # a deviation over the median of absolute values
# known blocks; tails as heavy as gusts make; the most by which a level differs, in its logarithm
_SURFACE_FROM, _SURFACE_NU, _SURFACE_MOST = 120, 4.0, 1.5
_SURFACE_RIDGE = np.diag([5e-3, 5.0, 5.0, 20.0, 20.0, 20.0])  # a surface that is told by few blocks stays flat
_LAGS, _QUANTILE = (1, 2, 4, 8), 0.6  # chunks; of squared differences: the edges of a fault part few pairs
_OF_CHI = 0.708  # that quantile of chi-square with one degree of freedom
_FEWEST_PAIRS, _PAIRS_A_LAG = 6, 10  # of chunks; chunks of a log for each chunk of a lag, or a step is wander


def level_of(errors: FloatArray, known: BoolArray, lively: FloatArray) -> FloatArray:
    """Return the standard deviation of errors at each block, by how lively the motion is; livelier is never quieter.

    Beyond the liveliest that is known it grows in proportion.

    >>> random = np.random.default_rng(1)
    >>> lively = np.repeat([1.0, 4.0], 500)
    >>> level_of(lively * random.standard_normal(1000), np.ones(1000, dtype=bool), lively)[[0, -1]].round(0).tolist()
    [1.0, 4.0]
    """
    # bins of as many blocks each, from the calmest to the liveliest; between their medians the logarithm runs straight
    order = np.flatnonzero(known)[np.argsort(lively[known], kind="stable")]
    parts = np.array_split(order, max(2, min(_BINS, len(order) // _FEWEST)))
    at = np.array([np.median(lively[part]) for part in parts])
    levels = np.maximum.accumulate([_clipped_deviation(errors[part]) for part in parts])
    found = np.exp(np.interp(np.log(lively), np.log(at), np.log(levels)))
    return np.asarray(found * np.maximum(1.0, lively / float(lively[known].max())))


def _clipped_deviation(values: FloatArray) -> float:
    usual = float(np.median(np.abs(values))) * _OF_NORMAL + 1e-9
    return float(np.sqrt(np.mean(np.square(np.clip(values, -CLIPPED * usual, CLIPPED * usual)))) + 1e-9)


def regime_of(errors: FloatArray, known: BoolArray, lively: FloatArray, regime: FloatArray) -> FloatArray:
    """Return by which factor the level differs with liveliness and regime, shape (blocks,).

    The log variance is a quadratic surface of both, by a Student likelihood of 4 degrees of freedom: Fisher scoring
    with a ridge, within e^+-1.5.
    """
    if np.count_nonzero(known) < _SURFACE_FROM:
        return np.ones(len(errors))
    first, second = _standardised(np.log(lively), known), _standardised(regime, known)
    one = np.ones(len(errors))
    columns = np.column_stack([one, first, second, 0.5 * first**2, 0.5 * second**2, 0.5 * first * second])
    own, power = columns[known], np.square(errors[known])
    surface = np.zeros(columns.shape[1])
    surface[0] = np.log(np.median(power) / 0.55 + 1e-9)
    information = own.T @ own * (0.5 * _SURFACE_NU / (_SURFACE_NU + 3.0)) + _SURFACE_RIDGE
    for _ in range(12):
        score = (_SURFACE_NU + 1.0) * power / (_SURFACE_NU * np.exp(own @ surface) + power) - 1.0
        step = np.linalg.solve(information, 0.5 * own.T @ score - _SURFACE_RIDGE @ surface)
        surface = surface + np.clip(step, -0.7, 0.7)
    most = 2.0 * _SURFACE_MOST
    return np.asarray(np.exp(0.5 * np.clip(columns @ surface, -most, most)))


def _standardised(values: FloatArray, known: BoolArray) -> FloatArray:
    low, amid, high = np.nanquantile(values[known], [0.02, 0.5, 0.98])
    return np.asarray(np.nan_to_num((np.clip(values, low, high) - amid) / (0.25 * (high - low) + 1e-6)))


def taps_of(errors: FloatArray) -> FloatArray:
    """Return the filter 1 - a_1 z^-1 - ... that makes errors white, by Yule and Walker, shape (ORDER + 1,).

    >>> random = np.random.default_rng(1)
    >>> walk = np.zeros(4000)
    >>> for k, step in enumerate(random.standard_normal(3999)):
    ...     walk[k + 1] = 0.8 * walk[k] + step
    >>> taps_of(walk)[:2].round(1).tolist()
    [1.0, -0.8]
    """
    lags = np.array([errors[lag:] @ errors[: len(errors) - lag] for lag in range(ORDER + 1)])
    lags = lags / (lags[0] + 1e-12)
    apart = np.abs(np.subtract.outer(np.arange(ORDER), np.arange(ORDER)))
    return np.concatenate([[1.0], -np.linalg.solve(lags[apart] + _RIDGE * np.eye(ORDER), lags[1:])])


def filtered(taps: FloatArray, values: FloatArray) -> FloatArray:
    """Return what of values their own past doesn't tell; nothing is before the first."""
    found = np.asarray(taps[0] * values)
    for lag in range(1, min(len(taps), len(values))):
        found[lag:] += taps[lag] * values[:-lag]
    return found


def unit_of(white: FloatArray) -> float:
    """Return the standard deviation of white errors, whatever is beyond four of them."""
    if not len(white):
        return 1.0
    power = max(float(np.mean(np.square(np.clip(white, -4.0, 4.0)))), float(np.median(np.square(white))) / 0.455)
    return float(np.sqrt(power)) + 1e-12


def wander_of(means: FloatArray, precisions: FloatArray, least: float) -> float:
    """Return how far the means of chunks wander beside what noise makes of them; no step or drift makes that.

    `means`, shape (chunks,): NaN where too little is known. `precisions`, shape (chunks,): one over a mean's variance
    by noise alone. `least`: what it is a priori, worth four chunks.
    """
    known = np.isfinite(means)
    count = int(np.count_nonzero(known))
    power = 0.0
    for lag in _LAGS:
        apart = np.square(means[lag:] - means[:-lag])
        apart = apart[np.isfinite(apart)]
        if len(apart) >= _FEWEST_PAIRS and lag <= max(1, count // _PAIRS_A_LAG):
            by_noise = float(np.median(1.0 / precisions[known]))
            power = max(power, 0.5 * float(np.quantile(apart, _QUANTILE)) / _OF_CHI - by_noise)
    return float(np.sqrt((count * power + 4.0 * least**2) / (count + 4.0)))

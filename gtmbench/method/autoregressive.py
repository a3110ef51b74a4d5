"""Autoregressive models of a residual: what colours it, and the innovations that are left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray

_REFLECTED = 0.9999  # at most: 1/A stays stable
_BLOCK = 8192  # rows at a time: what is worked out of them stays in the cache


def innovations(residual: FloatArray, taps: FloatArray) -> FloatArray:
    """Return epsilon(k) = sum over i = 0..n of a_i e(k-i), row for row; NaN where a residual it needs is missing.

    >>> innovations(np.array([2.0, 3.0, np.nan, 1.0, 2.0]), np.array([1.0, -0.5]))
    array([nan, 2. , nan, nan, 1.5])
    """
    order = len(taps) - 1
    left = np.full(len(residual), np.nan)
    for row in range(order, len(residual), _BLOCK):
        part = residual[row - order : row + _BLOCK]
        # a sum with a NaN in it is NaN, and no other: each is worked out by itself
        left[row : row + _BLOCK] = np.convolve(np.where(np.isfinite(part), part, np.nan), taps, mode="valid")
    return left


def yule_walker(covariance: FloatArray) -> tuple[FloatArray, float]:
    """Return 1, a_1, ..., a_n and the innovations' variance, from the autocovariance at lags 0..n; always stable.

    (`PredictionError` minimises (3.88) instead, by least squares over weighted samples, which promises no stable 1/A.)

    >>> yule_walker(np.array([2.0, 1.0]))
    (array([ 1. , -0.5]), 1.5)
    """
    from scipy.linalg import solve_toeplitz

    taps = solve_toeplitz(covariance[:-1], covariance[1:]) if len(covariance) > 1 else np.zeros(0)
    return np.concatenate([[1.0], -taps]), float(covariance[0] - taps @ covariance[1:])


def levinson(covariance: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return 1, a_1, ..., a_n and the innovations' variance of many autocovariances at once, by Levinson's recursion.

    `covariance`, shape (models, n + 1): at lags 0..n. Where one isn't positive definite (missing samples), reflections
    stop short of 1.

    >>> levinson(np.array([[2.0, 1.0], [1.0, 0.0]]))
    (array([[ 1. , -0.5],
           [ 1. ,  0. ]]), array([1.5, 1. ]))
    """
    taps = np.zeros_like(covariance)
    taps[:, 0] = 1.0
    variance = covariance[:, 0].copy()
    for order in range(1, covariance.shape[1]):
        reflection = -np.einsum("ij,ij->i", taps[:, :order], covariance[:, order:0:-1]) / variance
        reflection = np.minimum(np.maximum(reflection, -_REFLECTED), _REFLECTED)
        taps[:, 1 : order + 1] += reflection[:, np.newaxis] * taps[:, order - 1 :: -1][:, :order]
        variance *= 1.0 - reflection * reflection
    return taps, variance


def autocovariance(stretches: Sequence[FloatArray], order: int) -> FloatArray:
    """Return the sums of e(k) e(k-i), i = 0..order, over stretches without missing samples."""
    return sum((_products(values, order) for values in stretches), np.zeros(order + 1))


def _products(values: FloatArray, order: int) -> FloatArray:
    from scipy.fft import irfft, next_fast_len, rfft

    size = next_fast_len(len(values) + order, real=True)
    sums = np.asarray(irfft(np.abs(rfft(values, size)) ** 2, size))
    return sums[: order + 1]


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseModel:
    """A(q) e(k) = epsilon(k): an autoregressive inverse of G_w in equation (3.64), one an output.

    Attributes
    ----------
    autoregressive : shape (outputs, order + 1)
        1, a_1, ..., a_n: epsilon(k) = e(k) + a_1 e(k-1) + ... + a_n e(k-n).
    innovation_std : shape (outputs,)
        Standard deviation of epsilon, in the outputs' units.
    converged : bool
        Whether the criterion (3.88) converged within the iterations.
    criterion : shape (iterations, outputs)
        Mean square of the innovations after each iteration, in the outputs' units squared.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> rng = np.random.default_rng(1)
    >>> u, w = rng.standard_normal(2000), np.cumsum(rng.standard_normal(2000))
    >>> record = gb.Record(np.column_stack([u, u + w]), channels=["u", "y"], sample_period_s=0.01)
    >>> walk = gb.PredictionError(noise_order=1)
    >>> operator = gb.identify(
    ...     record, inputs=["u"], outputs=["y"], causal_order=0, noncausal_order=0, estimator=walk
    ... )
    >>> operator.noise_model.autoregressive.round(2).tolist(), operator.noise_model.converged
    ([[1.0, -1.0]], True)
    """

    autoregressive: FloatArray
    innovation_std: FloatArray
    converged: bool
    criterion: FloatArray

    def innovations(self, residuals: FloatArray) -> FloatArray:
        """Return epsilon, equation (3.67), shape as the one-step residuals (samples, outputs); NaN where unknown."""
        if np.shape(residuals)[1:] != (len(self.autoregressive),):
            raise InputError(
                f"residuals of shape {np.shape(residuals)} for {len(self.autoregressive)} outputs; give (samples, "
                "outputs)"
            )
        columns = zip(residuals.T, self.autoregressive, strict=True)
        return np.column_stack([innovations(column, taps) for column, taps in columns])

"""Equations y(k) = phi(k)' theta of stretches that may have gaps: their products, and the residual's autocovariance.

And slow motion: what of channels lies below a tenth of the sample rate, and its windows, which equations are made of.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import cache

import numpy as np

from gtmbench.method.regression.stretches import Stretch
from gtmbench.values.record import FloatArray

HALF = 5  # samples to either side that `slow` takes
_CUTOFF = 0.1  # of the sample rate
_KAISER = 5.0  # beta of the window


def slow(values: FloatArray) -> FloatArray:
    """Return columns without gaps freed of what lies above a tenth of the sample rate."""
    if len(values) <= HALF:
        return values
    return smoothed(np.concatenate([reflected(values[: HALF + 1][::-1])[::-1], values, reflected(values)]))


def held(values: FloatArray) -> FloatArray:
    """Return columns with missing samples as the last before them; those before the first as it, and 0 without any.

    >>> held(np.array([[np.nan], [1.0], [np.nan], [3.0]])).T
    array([[1., 1., 1., 3.]])
    """
    there = np.isfinite(values)
    if there.all():
        return values
    rows = np.where(there, np.arange(len(values))[:, np.newaxis], np.argmax(there, axis=0))
    filled = np.take_along_axis(values, np.maximum.accumulate(rows, axis=0), axis=0)
    return np.where(there.any(axis=0), filled, 0.0)


def interpolated(values: FloatArray) -> FloatArray:
    """Return columns with missing samples on a line across their gap; held at the ends, and 0 without any.

    >>> interpolated(np.array([[np.nan], [1.0], [np.nan], [3.0]])).T
    array([[1., 1., 2., 3.]])
    """
    columns = []
    for column in values.T:
        there = np.flatnonzero(np.isfinite(column))
        columns.append(np.interp(np.arange(len(column)), there, column[there]) if len(there) else np.zeros(len(column)))
    return np.column_stack(columns)


def reflected(values: FloatArray) -> FloatArray:
    """Return the `HALF` rows that go on after the last by odd reflection: 2 x(n) - x(n - i)."""
    return np.asarray(2.0 * values[-1] - values[-2 : -HALF - 2 : -1])


def smoothed(values: FloatArray) -> FloatArray:
    """Return slow motion of every row but the first and last `HALF`; of columns without a gap."""
    return fir(values, _taps())


def fir(values: FloatArray, coefficients: FloatArray) -> FloatArray:
    """Return columns through a filter, of the rows that have all rows it needs before them."""
    if len(values) < len(coefficients):
        return np.zeros((0, values.shape[1]))
    return np.array([np.convolve(column, coefficients, mode="valid") for column in values.T]).T


def regressors(motion: FloatArray, lags: int) -> FloatArray:
    """Return phi(k), one row a complete window of `lags` samples: lag -d (the newest sample) to r, input by input.

    >>> regressors(np.array([[1.0, 10.0], [2.0, 20.0], [3.0, 30.0]]), 2)
    array([[ 2., 20.,  1., 10.],
           [ 3., 30.,  2., 20.]])
    >>> regressors(np.ones((1, 2)), 2).shape
    (0, 4)
    """
    rows, inputs = motion.shape
    if rows < lags:
        return np.zeros((0, lags * inputs))
    # the newest sample first, a window of lags is a window of numbers that follow each other
    windows = np.lib.stride_tricks.sliding_window_view(motion[::-1].ravel(), lags * inputs)
    return np.ascontiguousarray(windows[::inputs][::-1])


@cache
def _taps() -> FloatArray:
    """Return what `firwin` of scipy.signal does, to the last bit: importing that costs a second and 45 MB."""
    from scipy.special import i0

    n = np.arange(-HALF, HALF + 1)
    taps = 2.0 * _CUTOFF * np.sinc(2.0 * _CUTOFF * n) * (i0(_KAISER * np.sqrt(1.0 - (n / HALF) ** 2)) / i0(_KAISER))
    return np.asarray(taps / taps.sum())


ALIKE = 5.0  # so many equations in a row say what one does: slow motion has a tenth of the band
_CHUNK = 4096  # rows at a time: they stay in the cache


@dataclass(frozen=True, kw_only=True, eq=False)
class Equations:
    """Inputs u of a stretch; y(k) and the weight of every window of u, 0 where a sample is missing."""

    u: FloatArray = field(repr=False)  # shape (samples, inputs)
    # y, weights, shape (windows,)
    y: FloatArray = field(repr=False)
    weights: FloatArray = field(repr=False)
    # shape (lags inputs,): what phi(k) is freed of (`about_means`)
    means: FloatArray | float = field(default=0.0, repr=False)

    def windows(self, lags: int) -> Iterator[tuple[slice, FloatArray]]:
        """Yield phi(k), some rows at a time."""
        for start in range(0, len(self.y), _CHUNK):
            phi = regressors(self.u[start : start + _CHUNK + lags - 1], lags)
            yield slice(start, start + _CHUNK), phi - self.means

    def residual(self, theta: FloatArray, lags: int) -> FloatArray:
        """Return y(k) - phi(k)' theta."""
        return np.concatenate([self.y[rows] - phi @ theta for rows, phi in self.windows(lags)])

    def products(self, theta: FloatArray, lags: int) -> FloatArray:
        """Return [Phi e]'[Phi e], e the residual of theta, over the windows that are whole."""
        total = np.zeros((len(theta) + 1,) * 2)
        for rows, phi in self.windows(lags):
            whole = self.weights[rows] > 0.0
            both = np.column_stack([phi, self.y[rows] - phi @ theta])[whole]
            total += both.T @ (both * self.weights[rows][whole, np.newaxis]) / ALIKE
        return total


def about_means(pieces: Sequence[Equations], lags: int) -> tuple[list[Equations], FloatArray, float]:
    """Return equations freed of their weighted means over all pieces, and these means, of phi and of y."""
    total = sum(float(piece.weights.sum()) for piece in pieces)
    phi, y = np.zeros((lags, pieces[0].u.shape[1])), 0.0
    for piece in pieces:
        # position j of all windows together, the newest sample first
        phi += np.array([np.correlate(column, piece.weights) for column in piece.u.T]).T[::-1] / total
        y += float(piece.weights @ piece.y) / total
    means = phi.ravel()
    return [replace(piece, y=piece.y - y, means=means) for piece in pieces], means, y


def weights_of(stretch: Stretch, causal_order: int, lags: int) -> FloatArray:
    """Return the weight of each window's equation: that of its sample k, 0 where any of its samples has 0."""
    complete = len(stretch) - lags + 1
    if stretch.weights is None:
        return np.ones(complete)
    there = np.lib.stride_tricks.sliding_window_view(stretch.weights > 0.0, lags).all(axis=1)
    return np.where(there, stretch.weights[causal_order:][:complete], 0.0)


def autocovariance(pieces: Sequence[Equations], theta: FloatArray, lags: int) -> FloatArray:
    """Return the residual's autocovariance, shape (lags, lags), from what isn't missing."""
    from scipy.linalg import toeplitz

    sums, counts = np.zeros(lags), np.zeros(lags)
    for piece in pieces:
        there = (piece.weights > 0.0).astype(np.float64)
        residual = there * piece.residual(theta, lags)
        for lag in range(min(lags, len(residual))):
            sums[lag] += residual[lag:] @ residual[: len(residual) - lag]
            counts[lag] += there[lag:] @ there[: len(there) - lag]
    return np.asarray(toeplitz(sums / np.maximum(counts, 1.0)))


def signal_of(gram: FloatArray, noise: FloatArray) -> FloatArray:
    """Return S: what of the equations is motion rather than noise, whatever the units; none is less than none."""
    from scipy.linalg import eigh

    size = _size(gram)
    left = (gram - noise) / np.outer(size, size)
    values, vectors = eigh(left, subset_by_value=(-np.inf, 0.0))
    return np.asarray((left - (vectors * values) @ vectors.T) * np.outer(size, size))


def solved(gram: FloatArray, right: FloatArray) -> FloatArray:
    """Return G^-1 of the right side, whatever the units; where G has no inverse, all but."""
    size = _size(gram)
    unit = gram / np.outer(size, size)
    return np.asarray(np.linalg.solve(unit + 1e-9 * len(unit) * np.eye(len(unit)), right / size) / size)


def _size(gram: FloatArray) -> FloatArray:
    size = np.sqrt(np.diag(gram))
    return np.where(size > 0.0, size, 1.0)

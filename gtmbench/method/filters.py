"""FIR operators: their products with inputs, as matrix products over blocks on one core; what colours a residual."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray

_ALONE = 250_000  # multiplications: OpenBLAS (0.3) shares products of more than 262,144 among threads


def product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return left @ right, worked out in parts that are too small for several threads.

    Threads wait for each other, on busy cores twenty times as long as the product takes; parts cost a tenth more.

    `left`, shape (m, k). `right`, shape (k, n).

    >>> product(np.ones((1, 2)), np.array([[1.0, 2.0], [3.0, 4.0]]))
    array([[4., 6.]])
    """
    rows, columns = len(left), right.shape[1]
    found = np.empty((rows, columns))
    if rows < columns:
        for part in _parts(columns, left.size):
            np.matmul(left, right[:, part], out=found[:, part])
    else:
        for part in _parts(rows, right.size):
            np.matmul(left[part], right, out=found[part])
    return found


def gram(rows: FloatArray) -> FloatArray:
    """Return rows @ rows.T, likewise.

    >>> gram(np.array([[1.0, 2.0], [0.0, 3.0]]))
    array([[5., 6.],
           [6., 9.]])
    """
    parts = (rows[:, part] for part in _parts(rows.shape[1], len(rows) ** 2))
    return np.asarray(sum((part @ part.T for part in parts), start=np.zeros((len(rows), len(rows)))))


def _parts(count: int, each: int) -> Iterator[slice]:
    """Give parts of so many rows or columns, each of which is multiplied so often."""
    step = max(_ALONE // max(each, 1), 1)
    return (slice(first, first + step) for first in range(0, count, step))


_BLOCK = 32  # outputs a row of the product: more multiply more zeros, fewer starve BLAS (measured)
_STRETCH = 240 * _BLOCK  # outputs a product: their windows, 0.6 MB for 3 inputs and 101 lags, stay in the cache


@np.errstate(all="ignore")  # a sensor that reads 1e308 overflows in its own windows: a value like others
def filtered(
    channels: Sequence[FloatArray] | FloatArray, markov: FloatArray, means: FloatArray, *, out: FloatArray | None = None
) -> FloatArray:
    """Return x(n) = sum over j = 0..lags-1 of H_j u(n + lags - 1 - j), the sum of (4.4), wherever it is complete.

    A block of outputs is one banded Toeplitz matrix times one window of inputs, and many blocks are one product. A
    spike meets an exact zero wherever it doesn't belong (a Fourier transform would spread its rounding errors); so that
    this holds for NaN and inf too, 0 takes their place, and the outputs that need them become NaN.

    `channels`, shape (samples,): views will do: they are read a stretch at a time, so that temporary memory doesn't
    grow with the samples. `markov`, shape (lags, outputs, inputs): H_0 acts on the newest sample. `means`, shape
    (inputs,): subtracted from the channels: u(k) is what is left. `out`, shape (samples - lags + 1, outputs): where to
    put the result, if not into an array of its own. Returns shape (samples - lags + 1, outputs), no rows where that is
    negative.

    >>> H = np.array([[[1.0]], [[10.0]]])  # x(n) = u(n + 1) + 10 u(n)
    >>> filtered([np.array([1.0, 2.0, 3.0, np.nan])], H, np.zeros(1)).T
    array([[12., 23., nan]])
    """
    lags, outputs, inputs = markov.shape
    count = max(len(channels[0]) - lags + 1, 0)
    result = np.empty((count, outputs)) if out is None else out
    if count == 0:
        return result
    block = min(_BLOCK, count)
    toeplitz = _toeplitz(markov, block)
    stretch = np.zeros((-(-min(_STRETCH, count) // block) * block + lags - 1, inputs))
    windows = sliding_window_view(stretch.ravel(), (block + lags - 1) * inputs)[:: block * inputs]
    for first in range(0, count, _STRETCH):
        part = result[first : first + _STRETCH]
        needed = len(part) + lags - 1  # what stands behind them reaches no output that is kept
        for i, channel in enumerate(channels):
            np.subtract(channel[first : first + needed], means[i], out=stretch[:needed, i])
        missing = ~np.isfinite(stretch)
        stretch[missing] = 0.0
        rows = np.ascontiguousarray(windows[: -(-len(part) // block)])  # BLAS takes none that overlap
        part[:] = product(rows, toeplitz).reshape(-1, outputs)[: len(part)]
        if missing.any():
            part[_spoilt(missing[:needed], lags)] = np.nan
    return result


def _toeplitz(markov: FloatArray, block: int) -> FloatArray:
    """Return the matrix from a window's inputs to a block of outputs.

    Shape ((block + lags - 1) inputs, block outputs): sample t enters output b through H_j, j = lags - 1 + b - t.
    """
    lags, outputs, inputs = markov.shape
    band = np.zeros((lags + 2 * block - 2, outputs, inputs))
    band[block - 1 : block - 1 + lags] = markov
    by_sample = sliding_window_view(band, block, axis=0)[::-1]  # (samples, outputs, inputs, block)
    return by_sample.transpose(0, 2, 3, 1).reshape((block + lags - 1) * inputs, block * outputs)


def _spoilt(missing: NDArray[np.bool_], lags: int) -> NDArray[np.bool_]:
    """Return which windows of `lags` samples hold a missing value."""
    before = np.concatenate([[0], np.cumsum(missing.any(axis=1))])
    return before[lags:] > before[:-lags]


_REFLECTED = 0.9999  # at most: 1/A stays stable
_ROWS = 8192  # rows at a time: what is worked out of them stays in the cache


def innovations(residual: FloatArray, taps: FloatArray) -> FloatArray:
    """Return epsilon(k) = sum over i = 0..n of a_i e(k-i), row for row; NaN where a residual it needs is missing.

    >>> innovations(np.array([2.0, 3.0, np.nan, 1.0, 2.0]), np.array([1.0, -0.5]))
    array([nan, 2. , nan, nan, 1.5])
    """
    order = len(taps) - 1
    left = np.full(len(residual), np.nan)
    for row in range(order, len(residual), _ROWS):
        part = residual[row - order : row + _ROWS]
        # a sum with a NaN in it is NaN, and no other: each is worked out by itself
        left[row : row + _ROWS] = np.convolve(np.where(np.isfinite(part), part, np.nan), taps, mode="valid")
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

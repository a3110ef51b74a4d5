"""The product of an FIR operator with its inputs, as matrix products over blocks of the signal; on one core."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

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

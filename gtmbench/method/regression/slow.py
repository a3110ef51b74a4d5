"""Slow motion: what of channels lies below a tenth of the sample rate, and its windows, which equations are made of."""

from __future__ import annotations

from functools import cache

import numpy as np

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

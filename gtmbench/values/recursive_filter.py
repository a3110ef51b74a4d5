"""Recursive filters as a triangular solve: scipy.signal, which has them, takes half a second to import."""

from collections.abc import Sequence

import numpy as np

from gtmbench.values.record import FloatArray


def filtered(
    over: Sequence[float] | FloatArray,
    under: Sequence[float] | FloatArray,
    signal: FloatArray,
    before: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return a signal behind a recursive filter along its first axis, as `scipy.signal.lfilter` does.

    y(k) = sum_i b_i u(k - i) - sum_{j >= 1} a_j y(k - j), all k; with T the banded lower triangle of ones and a_j, T y
    is the first sum.

    `over`, `under`: b and a; a begins with 1. `signal`, shape (rows, ...): finite. `before`: u and y of the row before
    the first; before that all is zero. Returns the same shape.

    >>> filtered([1.0], [1.0, -0.5], np.array([1.0, 0.0, 0.0]))
    array([1.  , 0.5 , 0.25])
    """
    from scipy.linalg import blas

    rows = len(signal) + 1
    columns = np.concatenate([np.full((1, *signal.shape[1:]), before[0]), signal]).reshape(rows, -1).T
    driven = np.zeros(columns.shape)
    for late, weight in enumerate(over):
        driven[:, late:] += weight * columns[:, : rows - late]
    driven[:, 0] = before[1]
    order = min(len(under), rows) - 1
    if order > 0:
        bands = np.empty((order + 1, rows), order="F")
        bands[:] = np.asarray(under, dtype=float)[: order + 1, np.newaxis]
        for each in driven:
            blas.dtbsv(order, bands, each, lower=1, diag=1, overwrite_x=1)
    return driven[:, 1:].T.reshape(signal.shape)

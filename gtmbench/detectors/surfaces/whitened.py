"""Least squares in coloured noise, over any stretch of blocks, by sums that are kept.

What gusts leave of an equation is alike from block to block, and a controller answers it, so that commands follow it.
Least squares would then be too sure of what they find, and off: they would take the gust for the command's effect.
So every variable x goes through the filter that makes the noise white,

    x'(t) = x(t) - phi_1 x(t-1) - ... - phi_P x(t-P),

phi by the Yule-Walker equations of what least squares leave (L. Ljung, System Identification, 2nd ed., chapter 10). The
products of filtered variables over a stretch need no filtering: they are sums of products at lags 0 to P,

    sum x'(t) x'(t)' = sum_ij a_i a_j sum x(t-i) x(t-j)',   a = (1, -phi),

which are kept as running sums. A block that is missing counts as zero in all variables, the constant 1 among them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from gtmbench.values.record import BoolArray, FloatArray

Counts = NDArray[np.int_]  # of blocks

ORDER = 4  # P
_RIDGE = 1e-4  # of the noise's power, added to it: two blocks that are equal would leave nothing to solve


class BlockSums:
    """Running sums of products, as blocks come in.

    `series`, `variables`: a block holds `variables` values of every series. `horizon`: blocks that anybody looks back
    at; older ones are forgotten.
    """

    def __init__(self, series: int, variables: int, horizon: int) -> None:
        shape = (series, variables)
        self._horizon = horizon + ORDER + 1
        self._first, self.count = 0, 0  # blocks before the first sum, and in all
        self._products = [np.zeros((1, *shape, variables)) for _ in range(ORDER + 1)]
        self._held = np.zeros(1)
        self._before = np.zeros((ORDER, *shape))

    def push(self, values: FloatArray, used: BoolArray) -> None:
        """Take blocks, of shape (blocks, series, variables), of which only some are used."""
        if self.count - self._first > 2 * self._horizon:
            self._forget()
        kept = np.where(used[:, np.newaxis, np.newaxis], values, 0.0)
        joined = np.concatenate([self._before, kept])
        for lag, running in enumerate(self._products):
            earlier = joined[ORDER - lag : len(joined) - lag]
            new = kept[..., :, np.newaxis] * earlier[..., np.newaxis, :]
            self._products[lag] = np.concatenate([running, running[-1] + np.cumsum(new, axis=0)])
        self._held = np.concatenate([self._held, self._held[-1] + np.cumsum(used)])
        self._before = joined[len(joined) - ORDER :]
        self.count += len(kept)

    def _forget(self) -> None:
        """Begin the sums anew where nobody looks any more: they stay small, so that they stay exact."""
        past = self.count - self._first - self._horizon
        self._products = [running[past:] - running[past] for running in self._products]
        self._held = self._held[past:] - self._held[past]
        self._first += past

    def held(self, begins: Counts, ends: Counts) -> FloatArray:
        """Return how many blocks are used in stretches [begin, end), counted since the start."""
        return np.asarray(self._held[self._at(ends)] - self._held[self._at(begins)])

    def lagged(self, begins: Counts, ends: Counts, fit: FloatArray) -> FloatArray:
        """Return what a fit leaves, times itself at lags 0 to P, over stretches; shape (stretches, series, P + 1).

        `begins`, `ends`, shape (stretches,). `fit`, shape (stretches, series, variables - 1): the last variable is the
        one that is explained.
        """
        weights = _weights(fit)
        first, last = self._at(begins), self._at(ends)
        sums = [running[last] - running[first] for running in self._products]
        return np.stack([np.einsum("...i,...ij,...j->...", weights, of, weights) for of in sums], axis=-1)

    def whitened(self, begins: Counts, ends: Counts, taps: FloatArray) -> FloatArray:
        """Return the products of filtered variables over stretches, shape (stretches, series, variables, variables).

        `begins`, `ends`, shape (stretches,). `taps`, shape (stretches, series, P + 1): the filters: 1, -phi_1, ...
        -phi_P.
        """
        total = np.zeros(())
        for i in range(ORDER + 1):
            first, last = self._at(begins - i), self._at(ends - i)
            for j in range(i, ORDER + 1):
                product = self._products[j - i][last] - self._products[j - i][first]
                both = product if i == j else product + np.swapaxes(product, -1, -2)
                total = total + (taps[..., i] * taps[..., j])[..., np.newaxis, np.newaxis] * both
        return np.asarray(total)

    def _at(self, blocks: Counts) -> Counts:
        return np.maximum(blocks - self._first, 0)


def _weights(fit: FloatArray) -> FloatArray:
    return np.concatenate([-fit, np.ones((*fit.shape[:-1], 1))], axis=-1)


def left(products: FloatArray, fit: FloatArray) -> FloatArray:
    """Return the squares that a fit leaves of the last variable.

    >>> products = np.array([[2.0, 3.0], [3.0, 5.0]])  # of x and y
    >>> round(float(left(products, np.array([1.5]))), 3)
    0.5
    """
    weights = _weights(fit)
    return np.asarray(np.maximum(np.einsum("...i,...ij,...j->...", weights, products, weights), 0.0))


def whitening(lagged: FloatArray) -> FloatArray:
    """Return the filters that make noise white, by its products at lags 0 to P; shapes (..., P + 1).

    >>> np.round(whitening(np.array([1.0, 0.5, 0.25, 0.125, 0.0625])), 2) + 0.0  # noise that halves from block to block
    array([ 1. , -0.5,  0. ,  0. ,  0. ])
    """
    at = np.abs(np.subtract.outer(np.arange(ORDER), np.arange(ORDER)))
    power = lagged[..., :1, np.newaxis] * _RIDGE + 1e-12
    phi = np.linalg.solve(lagged[..., at] + power * np.eye(ORDER), lagged[..., 1:, np.newaxis])[..., 0]
    return np.concatenate([np.ones((*phi.shape[:-1], 1)), -phi], axis=-1)

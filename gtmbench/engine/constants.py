"""Constants of a relation from a whole log, whatever is broken in it: no part is taken for healthy."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gtmbench.values.record import BoolArray, FloatArray, IntArray

CHUNK_S = 4.0  # over which a mean may wander by itself
_SHARES = (1.0, 0.5, 0.25, 0.12)  # of the chunks, to begin from: one of these stretches is healthy
_ROUNDS = 6  # of reweighting
_FLOOR, _LEAST = 0.1, 1e-4  # of the usual misfit: chunks that fit better count no more
_BEGINNING = 0.05  # of the mean square without constants: the noise that is assumed at first
_FEWEST = 3  # rows of a chunk that counts


class _Chunks(NamedTuple):
    """Normal equations of each chunk: X'X, X'y, y'y and the number of rows."""

    squares: FloatArray
    products: FloatArray
    power: FloatArray
    counts: FloatArray

    def mean_square(self, constants: FloatArray) -> FloatArray:
        """Return the mean square misfit of each chunk."""
        quadratic = np.einsum("i,mij,j->m", constants, self.squares, constants)
        misfit = self.power - 2.0 * self.products @ constants + quadratic
        return np.asarray(np.maximum(misfit, 0.0) / np.maximum(self.counts, 1.0))


def constants_of(
    values: FloatArray, regressors: FloatArray, known: BoolArray, prior: FloatArray, per_chunk: int
) -> FloatArray:
    """Return theta, the least of sum_c n_c log(m_c + floor^2) + sum_i (theta_i / prior_i)^2 over chunks c.

    m_c is a chunk's mean square misfit, n_c the part of it that is known. The loss is concave in m_c, so that a part
    with other constants costs about the same whatever they are: most of the log decides, not the sum of all.

    `values`, shape (rows,). `regressors`, shape (rows, constants). `known`, shape (rows,). `prior`, shape (constants,):
    standard deviations about zero. `per_chunk`: rows of a chunk.

    >>> random = np.random.default_rng(1)
    >>> turns = 10.0 * random.standard_normal(1000)
    >>> read = 0.5 + 0.02 * turns + 0.1 * random.standard_normal(1000)
    >>> read[600:] += 3.0  # two fifths of the log are broken
    >>> columns, known = np.column_stack([np.ones(1000), turns]), np.ones(1000, dtype=bool)
    >>> constants_of(read, columns, known, np.array([3.0, 0.1]), 20).round(2).tolist()
    [0.5, 0.02]
    """
    chunks = _chunks(values, regressors, known, per_chunk)
    full = np.flatnonzero(chunks.counts >= per_chunk // 2)
    ridge = np.diag(prior**-2.0)
    if not len(full):
        return np.zeros(len(prior))
    # below this a chunk fits as well as any: log(m + floor^2) would reward one that fits by luck
    usual = np.sqrt(np.median(chunks.power[full] / chunks.counts[full]))
    floor = (_FLOOR * usual) ** 2 + _LEAST

    def loss(constants: FloatArray) -> float:
        fit = chunks.counts[full] / per_chunk * np.log(chunks.mean_square(constants)[full] + floor)
        return float(fit.sum() + np.square(constants / prior).sum())

    # the loss has several minima: begin with the least squares of every stretch, and take the best of these
    best = min((_of_stretch(chunks, stretch, ridge) for stretch in _stretches(full)), key=loss)
    for _ in range(_ROUNDS):  # the loss' own weights: a chunk counts by how well it fits
        weights = (chunks.counts >= _FEWEST) / (chunks.mean_square(best) + floor)
        best = np.linalg.solve(np.einsum("m,mij->ij", weights, chunks.squares) + ridge, weights @ chunks.products)
    return best


def by_chunks(values: FloatArray, per_chunk: int) -> FloatArray:
    """Return rows by chunks, shape (chunks, rows, ...); the last one is filled with zeros."""
    count = -(-len(values) // per_chunk)
    filled = np.zeros((count * per_chunk, *values.shape[1:]))
    filled[: len(values)] = values
    return filled.reshape(count, per_chunk, *values.shape[1:])


def _chunks(values: FloatArray, regressors: FloatArray, known: BoolArray, per_chunk: int) -> _Chunks:
    columns = by_chunks(np.where(known[:, np.newaxis], regressors, 0.0), per_chunk)
    own = by_chunks(np.where(known, values, 0.0), per_chunk)
    return _Chunks(
        squares=np.einsum("mki,mkj->mij", columns, columns),
        products=np.einsum("mki,mk->mi", columns, own),
        power=np.square(own).sum(axis=1),
        counts=by_chunks(known.astype(float), per_chunk).sum(axis=1),
    )


def _stretches(full: IntArray) -> list[IntArray]:
    """Return stretches of chunks of every length, to begin from."""
    found = []
    for share in _SHARES:
        width = max(_FEWEST, round(share * len(full)))
        found += [full[first : first + width] for first in range(0, max(1, len(full) - width + 1), max(1, width // 2))]
    return found


def _of_stretch(chunks: _Chunks, stretch: IntArray, ridge: FloatArray) -> FloatArray:
    """Return the constants that fit a stretch of chunks best."""
    alone = chunks.power[stretch] / np.maximum(chunks.counts[stretch], 1.0)
    noise = max(float(np.median(alone)) * _BEGINNING, 1e-3)
    squares, products = chunks.squares[stretch].sum(axis=0), chunks.products[stretch].sum(axis=0)
    return np.asarray(np.linalg.solve(squares / noise + ridge, products / noise))

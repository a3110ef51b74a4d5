"""One triangular array that stands for all equations: R with R'R = [Phi y]'[Phi y]; the regressor is never formed.

Where a constant is estimated with theta, R is that of the columns about their (weighted) means over the equations:
so Householder's or Cholesky's first step leaves it when a column of ones stands before Phi, and what it takes away is
the constant, y's mean less Phi's times theta.

Every estimate that is linear in squares of the data follows from blocks of R; the records aren't needed any more.

The Gram matrix of lagged channels comes from their correlations. A window of L = r + d + 1 samples begins at every
sample t = 0..n-1 of a stretch. With z(t) the channels' values,

    G[i, j] = sum over t = 0..n-1 of z(t+i) z(t+j)',    i, j = 0..L-1: position i is lag r - i.

The first block row is a correlation, by FFT. The others follow along the block diagonals, where a window's first sample
leaves and the sample after its last one enters:

    G[i+1, j+1] = G[i, j] + z(n+i) z(n+j)' - z(i) z(j)'.

So do the sums over t of z(t+i), the products with a column of ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from itertools import pairwise

import numpy as np

from gtmbench.method.regression.stretches import CHUNK, Run, Stretch, runs
from gtmbench.values.record import FloatArray, frozen

_CONDITION_TRUSTED = 3e4  # of Phi: its square, 1e9 of double precision's 1e16, is what Cholesky may lose
_RESIDUAL_TRUSTED = 1e-5  # of the target: below, its square is lost in the rounding of the Gram matrix
_STEPS = 3  # of inverse iteration
_PANEL = 32  # columns that LAPACK reflects at a time

Columns = np.ndarray[tuple[int], np.dtype[np.intp]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Triangle:
    """The equations [Phi | y], rotated to upper triangular form."""

    root: FloatArray = field(repr=False)  # shape (columns, columns): R, upper triangular (more rows do no harm)
    targets: int  # how many of its last columns are y
    equations: int
    weight: float  # sum of the equations' weights
    solver: str  # "cholesky" of the Gram matrix, or "householder": orthogonal, on the equations themselves
    # shape (columns,): what the columns of [Phi y] are freed of; 0 where no constant is estimated
    means: FloatArray = field(repr=False)

    @property
    def size(self) -> int:
        """Columns of Phi."""
        return int(self.root.shape[1]) - self.targets

    @property
    def regressor(self) -> FloatArray:
        """R's columns of Phi, without the zeros below."""
        return self.root[: self.size, : self.size]

    @property
    def target(self) -> FloatArray:
        """R's columns of y, all rows."""
        return self.root[:, self.size :]

    @property
    def tolerance(self) -> float:
        """What rounding leaves of a singular value that is nil, as a share of the greatest."""
        return rounding(self.equations, self.size)

    @property
    def full_rank(self) -> bool:
        """Whether Phi's columns, and so any of them, are independent beyond rounding."""
        if self.solver == "cholesky":
            return True
        singular = np.linalg.svd(self.regressor, compute_uv=False)
        return bool(singular[-1] > self.tolerance * singular[0])

    @property
    def floor(self) -> float:
        """`tolerance` times R's norm: columns, and what is left of them, are nil below it."""
        return self.tolerance * float(np.linalg.norm(self.root))

    def drop(self, count: int) -> Triangle:
        """Return the triangle without Phi's first columns: their rows are absorbed into those below."""
        below = np.array(self.root[count:, count:], order="F")  # absorbing writes into it
        root = np.ascontiguousarray(absorb(below, self.root[:count, count:]))
        return replace(self, root=root, means=self.means[count:])

    def about(self, means: FloatArray) -> Triangle:
        """Return the equations freed of other means: those of the records that a constant was estimated on."""
        off = np.sqrt(self.weight) * (self.means - means)
        return replace(self, root=np.vstack([self.root, off]), means=means)

    def seen_by(self, count: int) -> Triangle:
        """Return the equations that Phi's first columns, instruments, see of the others: projected onto their run."""
        if self.solver == "cholesky":
            rows = self.root[:count, count:]
        else:  # directions that the instruments lack are made of rounding
            left, singular, _ = np.linalg.svd(self.root[:count, :count])
            rows = left[:, singular > self.tolerance * singular[0]].T @ self.root[:count, count:]
        short = max(self.root.shape[1] - count - len(rows), 0)
        root = np.linalg.qr(np.pad(rows, ((0, short), (0, 0))), mode="r")
        return replace(self, root=np.asarray(root), solver="householder", means=self.means[count:])


def triangle(
    stretches: Sequence[Stretch],
    lagged: int,
    causal_order: int,
    noncausal_order: int,
    columns: Columns | None = None,
    *,
    constant: bool,
) -> Triangle:
    """Reduce all equations of the stretches: by Cholesky where that can be trusted, else by reflections.

    `stretches`: channels: first the `lagged` ones, then the targets. `columns`, shape (columns,): which columns of Phi
    to take, numbered as by `gram`, and in which order; None: all. `constant`: whether a constant is estimated with
    theta.
    """
    from scipy.linalg import blas, lapack

    run_list = list(runs(stretches, causal_order, noncausal_order))
    weight = sum(run.total(causal_order) for run in run_list)
    targets = stretches[0].channels - lagged
    products, sums = gram(stretches, lagged, causal_order, noncausal_order)
    taken = None if columns is None else np.concatenate([columns, np.arange(len(products) - targets, len(products))])
    if taken is not None:
        products, sums = (np.triu(products) + np.triu(products, 1).T)[np.ix_(taken, taken)], sums[taken]
    squares, means = products.diagonal().copy(), np.zeros(len(sums))
    if constant:  # the first step of Cholesky, for the column of ones
        means = sums / weight
        products = blas.dsyr(-weight, means, a=products.T, lower=1, overwrite_a=1).T
    # C order and upper is Fortran order and lower: LAPACK works in place
    factor, info = lapack.dpotrf(products.T, lower=1, clean=1, overwrite_a=1)
    root, solver = factor.T, "cholesky"
    if info != 0 or not _trusted(root, targets, squares):
        root = _reflected(stretches, lagged, causal_order, noncausal_order, taken, constant)
        if constant:
            means, root = root[0, 1:] / root[0, 0], np.ascontiguousarray(root[1:, 1:])
        solver = "householder"
    equations = sum(run.equations for run in run_list)
    return Triangle(root=root, targets=targets, equations=equations, weight=weight, solver=solver, means=means)


def rounding(equations: int, columns: int) -> float:
    """Return what rounding leaves of a singular value that is nil, as a share of the greatest."""
    return float(np.finfo(float).eps) * max(equations, columns)


def _trusted(root: FloatArray, targets: int, squares: FloatArray) -> bool:
    """Tell whether a Cholesky factor has kept enough digits, both of the regressor and of what it leaves over.

    squares : shape (columns,)
        Of the equations' columns, summed, before the means were taken away: that costs digits, too.
    """
    size = len(root) - targets
    left = np.sum(root[size:, size:] ** 2, axis=0)
    if not np.all(left > _RESIDUAL_TRUSTED**2 * squares[size:]):
        return False
    return bool(np.sqrt(squares[:size].sum()) * _inverse_norm(root, size) < _CONDITION_TRUSTED)


def _inverse_norm(root: FloatArray, size: int) -> float:
    """Return about the norm of the inverse of R's first columns: inverse iteration from a random vector.

    By Dixon's theorem (1983) too small by more than a factor of 10 less than once in 10,000.
    """
    from scipy.linalg import lapack

    vector, growth = _random_direction(size, len(root)), 1.0
    for _ in range(_STEPS):
        vector, _ = lapack.dtrtrs(root.T, vector, lower=1)
        vector[size:] = 0.0  # the last columns take no part
        vector, _ = lapack.dtrtrs(root.T, vector, lower=1, trans=1)
        norm = float(np.linalg.norm(vector))
        growth *= norm ** (0.5 / _STEPS)
        vector /= norm
    return growth


@cache
def _random_direction(size: int, length: int) -> FloatArray:
    """Return a vector of norm 1: `size` random components, then zeros."""
    vector = np.random.default_rng(0).standard_normal(size)
    return frozen(np.pad(vector / np.linalg.norm(vector), (0, length - size)))


def _reflected(
    stretches: Sequence[Stretch],
    lagged: int,
    causal_order: int,
    noncausal_order: int,
    taken: Columns | None,
    constant: bool,
) -> FloatArray:
    """Return R by Householder reflections, a block of equations after the other: memory doesn't grow with them.

    The column of ones, if there is to be one, comes first.
    """
    lags = causal_order + noncausal_order + 1
    ones = lags * lagged + stretches[0].channels - lagged
    taken = np.arange(ones) if taken is None else taken
    taken = np.concatenate([[ones], taken]) if constant else taken
    root = np.zeros((len(taken), len(taken)), order="F")
    step = max(len(taken), ROWS)
    for run in runs(stretches, causal_order, noncausal_order):
        for start in range(0, run.equations, step):
            block = rows(run, start, min(start + step, run.equations), lagged, lags, causal_order)
            root = absorb(root, block[:, taken])
    return np.ascontiguousarray(root)


def absorb(root: FloatArray, block: FloatArray) -> FloatArray:
    """Return R of the equations behind `root` and those of `block` together, shape as `root`, in Fortran order."""
    from scipy.linalg import lapack

    combined, _, _, _ = lapack.dtpqrt(0, min(_PANEL, len(root)), root, block, overwrite_a=1)
    return np.asarray(combined)


def without(columns: FloatArray, count: int, floor: float) -> FloatArray:
    """Return what is left of the other columns once the run of the first `count` is projected out of them."""
    import scipy.linalg

    basis, kept, _ = scipy.linalg.qr(columns[:, :count], mode="economic", pivoting=True)
    basis = basis[:, : int(np.sum(np.abs(np.diag(kept)) > floor))]
    others = columns[:, count:]
    return np.asarray(others - basis @ (basis.T @ others))


ROWS = 1 << 11  # equations that are written out at a time


def gram(
    stretches: Sequence[Stretch], lagged: int, causal_order: int, noncausal_order: int
) -> tuple[FloatArray, FloatArray]:
    """Return the Gram matrix of ``[z at positions 0..L-1 | targets at position r]``, and its products with ones.

    Both are sums over all equations.

    `stretches`: channels: first the `lagged` ones, then the targets. `causal_order`, `noncausal_order`: r and d.
    Returns shape (L lagged + targets,) twice, shape (L lagged + targets,): columns of z: position by position, channel
    by channel within. Only the upper triangle counts.
    """
    lags = causal_order + noncausal_order + 1
    alike: list[Run] = []
    others: list[Run] = []
    for run in runs(stretches, causal_order, noncausal_order):
        (others if run.weight is None else alike).append(run)
    total, sums = _from_correlations(alike, lagged, stretches[0].channels - lagged, lags, causal_order)
    for run in others:
        for start in range(0, run.equations, ROWS):
            block = rows(run, start, min(start + ROWS, run.equations), lagged, lags, causal_order)
            total += block[:, :-1].T @ block[:, :-1]
            sums += block[:, -1] @ block[:, :-1]
    return total, sums


def rows(run: Run, start: int, stop: int, lagged: int, lags: int, causal_order: int) -> FloatArray:
    """Return equations start..stop-1, times the root of their weight: ``[z(t)' ... z(t+L-1)' | targets | 1]``."""
    block = run.stretch.read(run.first + start, run.first + stop + lags - 1)
    regressor, targets = written_out(block, lagged, lags, causal_order)
    return (
        np.hstack([regressor, targets, np.ones((stop - start, 1))])
        * np.sqrt(run.weights(start, stop, causal_order))[:, np.newaxis]
    )


def written_out(block: FloatArray, lagged: int, lags: int, causal_order: int) -> tuple[FloatArray, FloatArray]:
    """Return ``z(t)' ... z(t+L-1)'`` and the targets at t+r, for every complete window of a block of channels."""
    windows = np.lib.stride_tricks.sliding_window_view(block[:lagged], lags, axis=1)
    count = windows.shape[1]
    return windows.transpose(1, 2, 0).reshape(count, -1), block[lagged:, causal_order : causal_order + count].T


def _from_correlations(
    parts: Sequence[Run], lagged: int, targets: int, lags: int, causal_order: int
) -> tuple[FloatArray, FloatArray]:
    """Return the Gram matrix and the sums of runs of 2 L equations and more, each of one weight."""
    size, width = lags * lagged, lags * lagged + max(targets, 1)  # the recursion needs a column behind z
    row, power = np.zeros((lagged + targets, lagged, lags)), np.zeros((targets, targets))
    first_sums = np.zeros(lagged + targets)
    entering, leaving = np.zeros((2, len(parts), width))  # each sample at the position that it steps to
    # the first block row of Phi'Phi: correlations of the first lag with all, and of targets with all
    for number, run in enumerate(parts):
        weight = run.weight or 0.0
        for start in range(0, run.equations, CHUNK):
            stop = min(start + CHUNK, run.equations)
            block = run.stretch.read(run.first + start, run.first + stop + lags - 1)
            now = block[lagged:, causal_order : causal_order + stop - start]
            row += weight * _correlations(block[:lagged], now, lags)
            power += weight * (now @ now.T)
            first_sums += weight * np.concatenate([block[:lagged, : stop - start].sum(axis=1), now.sum(axis=1)])
        for edge, first in ((entering, run.first + run.equations), (leaving, run.first)):
            edge[number, lagged:size] = np.sqrt(weight) * run.stretch.read(first, first + lags - 1)[:lagged].T.ravel()
    # a lag later the sums gain the sample that enters, and lose the one that leaves: G(i+1, j+1) = G(i, j) + in - out
    steps = np.array([np.sqrt(run.weight or 0.0) for run in parts]) @ (entering - leaving)[:, :size]
    steps[:lagged] = first_sums[:lagged]
    sums = np.concatenate([np.cumsum(steps.reshape(lags, lagged), axis=0).ravel(), first_sums[lagged:]])
    total = np.vstack([entering, -leaving]).T @ np.vstack([entering, leaving])
    products = row.transpose(0, 2, 1).reshape(len(row), size)
    total[:lagged, :size] = products[:lagged]
    # A block down and to the right is equally far from everywhere; past a row's end begins the next one's lower part.
    for before, after in pairwise(total.reshape(-1)[: size * (width + 1)].reshape(lags, -1)):
        after += before
    total = np.ascontiguousarray(total[: size + targets, : size + targets])  # no copy unless there is no target
    total[:size, size:] = products[lagged:].T
    total[size:, size:] = power
    return total, sums


def _correlations(signals: FloatArray, targets: FloatArray, lags: int) -> FloatArray:
    """Return sum over t of h[a, t] signals[b, t+s], s = 0..lags-1, shape (signals + targets, signals, lags).

    h: signals, then targets, at as many t as there are targets' samples. Segment by segment: a head of
    ``length - lags + 1`` samples, reversed, is convolved with the `length` samples that it meets.
    """
    length = max(1 << 10, 1 << (8 * lags - 1).bit_length())
    hop, count = length - lags + 1, targets.shape[1]
    segments = -(-count // hop)
    padded = np.zeros((len(signals) + len(targets), segments * hop + lags - 1))
    padded[: len(signals), : signals.shape[1]] = signals
    padded[len(signals) :, :count] = targets
    channel, sample = padded.strides
    windows = np.ndarray((len(padded), segments, length), buffer=padded, strides=(channel, hop * sample, sample))
    heads = np.zeros(windows.shape)
    heads[:, :, :hop] = windows[:, :, hop - 1 :: -1]
    heads[:, -1, : segments * hop - count] = 0.0
    met = np.fft.rfft(windows[: len(signals)])
    products = [[np.add.reduce(head * signal) for signal in met] for head in np.fft.rfft(heads)]
    return np.asarray(np.fft.irfft(products, length)[..., hop - 1 :])

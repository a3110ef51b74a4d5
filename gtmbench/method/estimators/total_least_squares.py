"""Total least squares: noise on every channel, pseudo inputs too (errors in variables)."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.method.estimators.least_squares import Noise, check_noise, noise_levels, summary
from gtmbench.method.problem import Estimate, Problem
from gtmbench.method.regression.stretches import Stretch
from gtmbench.values.record import FloatArray

_FLOOR_SEGMENT = 256  # samples a spectrum is taken over


@dataclass(frozen=True, kw_only=True, eq=False)
class TotalLeastSquares:
    """The operator that fits after the smallest change of all samples, measured by the sensors' noise.

    White noise on the pseudo inputs pulls least squares towards zero. Here the singular directions of
    ``[Phi, y_o] C^-1/2`` with the smallest values, those of noise, are taken for relations that hold exactly, w with
    ``[Phi, y_o] w = 0``; theta is the smallest (measured by C) that follows. C is the noise covariance of a row
    ``[phi(k)', y_o(k)]``: every lag of a channel has the channel's. At least one direction is left out: that is total
    least squares. Data that excite fewer (sinusoids) leave more to noise: of all counts of directions that may stand
    out of it, with singular values above about ``sqrt(n) + sqrt(columns)``, the one is taken whose operator leaves the
    least residual.

    Not in the dissertation; see S. Van Huffel and J. Vandewalle, The Total Least Squares Problem, SIAM, 1991.
    Its theory holds for rows of independent noise; lagged rows share their samples, so no covariance is given.

    Attributes
    ----------
    noise : float, mapping from channel to float, or array_like, optional
        Standard deviation of each channel's noise (one number: of every one), or their covariance matrix, pseudo inputs
        first, then pseudo outputs; in the channels' units. None: estimated as the mean level of each channel's spectrum
        above half the Nyquist frequency, so any signal there must be noise.
    rank : int, optional
        The number of directions to keep; by default it is determined.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.TotalLeastSquares(noise={"p": 0.1, "q": 0.1, "beta": 0.05, "r": 0.1}).rank is None
    True
    """

    instruments: ClassVar[tuple[str, ...]] = ()

    noise: Noise | ArrayLike | None = None
    rank: int | None = None

    def __post_init__(self) -> None:
        if self.rank is not None:
            object.__setattr__(self, "rank", whole("rank", self.rank, 1))
        if isinstance(self.noise, Mapping | Real):
            check_noise("noise", self.noise)

    def estimate(self, problem: Problem) -> Estimate:
        """Return the total-least-squares estimate, output by output."""
        equations = problem.triangle()
        covariance = self._covariance(problem)
        size, count = problem.parameters, len(problem.inputs)
        if self.rank is not None:
            whole("rank", self.rank, 1, size)
        theta, ranks = np.empty((size, equations.targets)), []
        for o in range(equations.targets):
            both = covariance[np.ix_([*range(count), count + o], [*range(count), count + o])]
            root = np.asarray(np.linalg.cholesky(_row_covariance(both, problem)))
            rows = np.column_stack([equations.root[:, :size], equations.target[:, o]])
            edge = np.sqrt(equations.weight) * (1.0 + np.sqrt((size + 1) / equations.equations))
            theta[:, o], rank = _solve(rows, root, self.rank, edge)
            ranks.append(rank)
        least = summary(problem, equations, theta, size)
        return replace(
            least,
            noise_variance=np.full(equations.targets, np.nan),
            rank=min(ranks),
            rank_chosen=True,
            sensor_noise=np.sqrt(np.diag(covariance)) * problem.scale,
        )

    def _covariance(self, problem: Problem) -> FloatArray:
        """Return the noise covariance of the channels, in the problem's units."""
        if self.noise is None:
            levels = _floor(problem.stretches)
            if not np.all(levels > 0):
                name = problem.channels[int(np.argmin(levels))]
                raise InputError(f"channel '{name}' shows no noise above half the Nyquist frequency; state its noise")
            if np.any(levels**2 > 0.5):
                name = problem.channels[int(np.argmax(levels))]
                raise InputError(
                    f"channel '{name}' moves as much above half the Nyquist frequency as below, so its noise can't be "
                    "told from its motion; state its noise"
                )
            return np.diag(levels**2)
        if isinstance(self.noise, Mapping | Real):
            return np.diag(noise_levels("noise", self.noise, problem, problem.channels) ** 2)
        try:
            given = np.asarray(self.noise, dtype=float)
        except (TypeError, ValueError):
            given = np.zeros(0)
        if given.shape != (len(problem.channels),) * 2:
            raise InputError(
                f"noise has shape {given.shape}; give a standard deviation a channel by name, or the covariance "
                f"matrix of {', '.join(problem.channels)}"
            )
        if not np.all(np.isfinite(given)):
            raise InputError("noise holds values that aren't finite; a covariance matrix has none")
        scaled = given / np.outer(problem.scale, problem.scale)
        if np.any(np.abs(scaled - scaled.T) > 1e-9 * np.abs(scaled).max()) or np.linalg.eigvalsh(scaled)[0] <= 0:
            raise InputError("noise isn't a covariance matrix: it must be symmetric and positive definite")
        return scaled


def _row_covariance(both: FloatArray, problem: Problem) -> FloatArray:
    """Return C of a row [phi(k)', y(k)] from that of the inputs and the output: lags don't correlate."""
    size, count = problem.parameters, len(problem.inputs)
    covariance = np.zeros((size + 1, size + 1))
    covariance[:size, :size] = np.kron(np.eye(problem.lags), both[:count, :count])
    now = slice(problem.causal_order * count, (problem.causal_order + 1) * count)  # lag 0
    covariance[now, size] = covariance[size, now] = both[:count, count]
    covariance[size, size] = both[count, count]
    return covariance


def _solve(rows: FloatArray, root: FloatArray, rank: int | None, edge: float) -> tuple[FloatArray, int]:
    """Return theta and how many directions v were kept, of values above `edge` if not told.

    w = C^-T/2 v of the others make theta.
    """
    whitened = np.linalg.solve(root, rows.T).T
    _, singular, right = np.linalg.svd(whitened)
    directions = np.linalg.solve(root.T, right.T)
    # column k: theta when directions k, k+1, ... are left out
    products = np.cumsum((directions[:-1] * directions[-1])[:, ::-1], axis=1)[:, ::-1]
    candidates = -products / np.cumsum(directions[-1, ::-1] ** 2)[::-1]
    if rank is None:
        most = int(np.clip(np.sum(singular > edge), 1, len(singular) - 1))
        left = rows[:, -1:] - rows[:, :-1] @ candidates[:, 1 : most + 1]
        rank = 1 + int(np.argmin(np.sum(left**2, axis=0)))
    return candidates[:, rank], rank


def _floor(stretches: Sequence[Stretch]) -> FloatArray:
    """Return each channel's standard deviation if its spectrum were, everywhere, what it is above Nyquist / 2."""
    import scipy.signal

    powers, weights = [], []
    for part in stretches:
        length = min(_FLOOR_SEGMENT, len(part))
        if length >= 8:
            frequency, power = scipy.signal.welch(part.read(0, len(part)), nperseg=length, axis=1)
            powers.append(power[:, (frequency > 0.25) & (frequency < 0.5)].mean(axis=1) / 2.0)
            weights.append(len(part) if part.weights is None else part.weights.sum())
    if not powers:
        raise InputError("the stretches are too short to estimate noise from; state it")
    return np.asarray(np.sqrt(np.average(powers, axis=0, weights=weights)))

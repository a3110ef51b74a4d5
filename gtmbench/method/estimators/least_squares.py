"""Least squares, equations (3.43) and (4.9); on request with a ridge or truncated."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.method.problem import Estimate, Problem
from gtmbench.method.regression.triangle import Triangle, absorb
from gtmbench.values.record import FloatArray

Noise = float | Mapping[str, float]


@dataclass(frozen=True, kw_only=True)
class LeastSquares:
    """theta = argmin of the sum over k = r..l-d of ||y_o(k) - sum over i = -d..r of H_i y_i(k-i)||^2, (4.8) and (4.9).

    Section 4.3 calls this a prediction-error method; with a noise model it is `PredictionError`.
    A regressor that lacks rank gives the smallest solution (inputs scaled to an RMS of 1), with a RankWarning.

    Attributes
    ----------
    ridge : float or mapping from input to float, optional
        Standard deviation of white noise on the pseudo inputs, in their units: adds n sigma_i^2 ||H_.i||^2 (n
        equations, all lags of input i), the mean contribution of such noise. One number applies to every input, in its
        unit.
    truncate : float or mapping from input to float, optional
        Likewise a noise level: directions of the regressor that such noise would hide are left out.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.LeastSquares(ridge={"p": 0.1, "q": 0.1, "beta": 0.05})
    LeastSquares(ridge={'p': 0.1, 'q': 0.1, 'beta': 0.05}, truncate=None)
    """

    instruments: ClassVar[tuple[str, ...]] = ()

    ridge: Noise | None = None
    truncate: Noise | None = None

    def __post_init__(self) -> None:
        if self.ridge is not None and self.truncate is not None:
            raise InputError("ridge and truncate are two ways of holding the same back; choose one")
        check_noise("ridge", self.ridge)
        check_noise("truncate", self.truncate)

    def estimate(self, problem: Problem) -> Estimate:
        """Return the least-squares estimate."""
        return self.reduced(problem, problem.triangle())

    def reduced(self, problem: Problem, equations: Triangle) -> Estimate:
        """Return the estimate from reduced equations."""
        if self.truncate is not None:
            levels = np.tile(noise_levels("truncate", self.truncate, problem), problem.lags)
            floor = np.sqrt(equations.weight)
            theta, rank = smallest(equations.regressor / levels, equations.target[: problem.parameters], floor)
            if rank == 0:
                raise InputError("truncate: no direction of the pseudo inputs stands out of this noise; lower it")
            return replace(summary(problem, equations, theta / levels[:, np.newaxis], rank), rank_chosen=True)
        if self.ridge is not None:
            levels = np.tile(noise_levels("ridge", self.ridge, problem), problem.lags)
            rows = np.sqrt(equations.weight) * np.eye(len(levels), len(equations.root)) * levels[:, np.newaxis]
            held = replace(equations, root=absorb(np.asfortranarray(equations.root), rows), solver="householder")
            theta, rank = solve(held)
            return replace(summary(problem, equations, theta, rank), root=held.regressor[np.newaxis])
        theta, rank = solve(equations)
        return summary(problem, equations, theta, rank)


def check_noise(what: str, noise: Noise | None) -> None:
    """Refuse what can't be standard deviations."""
    if isinstance(noise, Mapping):
        for name, value in noise.items():
            number(f"{what} of '{name}'", value, 0.0, above=True)
    elif noise is not None:
        number(what, noise, 0.0, above=True)


def noise_levels(what: str, noise: Noise, problem: Problem, channels: tuple[str, ...] | None = None) -> FloatArray:
    """Return noise levels in the problem's units, one a channel (the inputs unless told)."""
    names = problem.inputs if channels is None else channels
    if isinstance(noise, Mapping) and set(noise) != set(names):
        raise InputError(
            f"{what} is given for {', '.join(noise) or 'nothing'}; it needs a standard deviation for each of "
            f"{', '.join(names)}"
        )
    given = noise if isinstance(noise, Mapping) else dict.fromkeys(names, noise)
    scale = dict(zip(problem.channels, problem.scale, strict=True))
    return np.array([float(given[name]) / scale[name] for name in names])


def solve(equations: Triangle) -> tuple[FloatArray, int]:
    """Return the coefficients and the rank; without full rank the smallest coefficients that fit."""
    from scipy.linalg import lapack

    size = len(equations.regressor)
    if equations.solver == "cholesky":
        # of the whole triangle, in place: LAPACK would copy a part of it
        right = np.where(np.arange(len(equations.root))[:, np.newaxis] < size, equations.target, 0.0)
        return np.asarray(lapack.dtrtrs(equations.root.T, right, lower=1, trans=1)[0])[:size], size
    return smallest(equations.regressor, equations.target[:size], tolerance=equations.tolerance)


def smallest(
    regressor: FloatArray, target: FloatArray, floor: float = 0.0, tolerance: float = 0.0
) -> tuple[FloatArray, int]:
    """Return the smallest solution over singular values above `floor` and above `tolerance` of the greatest."""
    left, singular, right = np.linalg.svd(regressor)
    rank = int(np.sum(singular > max(floor, tolerance * singular[0])))
    return right[:rank].T @ ((left[:, :rank].T @ target) / singular[:rank, np.newaxis]), rank


def summary(problem: Problem, equations: Triangle, theta: FloatArray, rank: int) -> Estimate:
    """Return the estimate with what its residual tells; `equations` may have more rows than columns."""
    size = problem.parameters
    squares = np.sum((equations.target - equations.root[:, :size] @ theta) ** 2, axis=0)
    free = equations.weight - problem.unknowns
    return Estimate(
        coefficients=theta,
        root=equations.regressor[np.newaxis],
        noise_variance=squares / free if free > 0 else np.full(len(squares), np.nan),
        rms_residual=np.sqrt(squares / equations.weight),
        equations=equations.equations,
        rank=rank,
        solver=equations.solver,
        constant=equations.means[size:] - equations.means[:size] @ theta,
    )

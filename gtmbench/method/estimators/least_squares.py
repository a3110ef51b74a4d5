"""Least squares, (3.43) and (4.9), with a ridge or truncated; and instrumental variables, sections 3.6.2 and 3.6.3.

Instruments keep an estimate consistent where noise is fed back into the pseudo inputs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from gtmbench.checks import names, number, whole
from gtmbench.errors import InputError
from gtmbench.method.problem import Estimate, Problem, columns_of, require_equations
from gtmbench.method.regression.stretches import Stretch
from gtmbench.method.regression.triangle import Triangle, absorb, triangle
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


@dataclass(frozen=True, kw_only=True)
class InstrumentalVariables:
    """Basic and extended instrumental variables, equations (3.55) and (3.63).

    With Z the lagged instruments, solves ``min || P_Z (y - Phi theta) ||``, P_Z the projection onto Z's columns: as
    many instruments as parameters make that ``Z'y = Z'Phi theta``, equation (3.55); more are solved over-determined.
    A constant is its own instrument.
    Equations run over k = r+delay+past..l-d (less where `future` reaches further ahead). The instruments must move with
    the pseudo inputs and not with the noise: samples of the excitation do.

    Attributes
    ----------
    instruments : tuple of str
        Channels of the record. (3.55) takes the lags -d..r of each.
    delay : int
        Shifts these lags to ``-d + delay .. r + delay``. With an unstable plant the lags of (3.55) are nearly useless
        at the noncausal end: delay by exactly the number of unstable poles, or better, give `past`.
    past, future : int
        The number of further lags on either side: over-determined. A `past` of 5 or more needs no knowledge of the
        poles, and on example 3.2 it errs by 15 to 30 % less than the right delay.
    prefilter : pair of sequences of float, optional
        Numerator and denominator of L(q^-1) in (3.63), by falling powers of q; asymptotically stable.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.InstrumentalVariables(instruments=("c",), delay=3)
    InstrumentalVariables(instruments=('c',), delay=3, past=0, future=0, prefilter=None)
    """

    instruments: tuple[str, ...]
    delay: int = 0
    past: int = 0
    future: int = 0
    prefilter: tuple[Sequence[float], Sequence[float]] | None = None

    def __post_init__(self) -> None:
        given = names("instruments", self.instruments)
        if not given:
            raise InputError("instruments are missing; name one channel or more")
        object.__setattr__(self, "instruments", given)
        for name in ("delay", "past", "future"):
            object.__setattr__(self, name, whole(name, getattr(self, name)))
        if self.prefilter is not None:
            _check_prefilter(self.prefilter)

    def estimate(self, problem: Problem) -> Estimate:
        """Return the instrumental-variables estimate."""
        r, d = problem.causal_order, problem.noncausal_order
        causal, noncausal = r + self.delay + self.past, max(d, d - self.delay + self.future)
        kept = range(causal, -(d - self.delay + self.future) - 1, -1)
        own = set(problem.instruments) & set(problem.outputs)
        if own and kept[-1] <= 0:
            raise InputError(
                f"'{min(own)}' is instrument and pseudo output, with lag {kept[-1]}, so it carries the noise that it "
                "should be free of; choose another instrument, or a delay beyond the noise's memory"
            )
        instruments, count = len(problem.instruments), len(problem.instruments) + len(problem.inputs)
        if len(kept) * instruments < problem.parameters:
            raise InputError(
                f"{len(kept)} lags of {instruments} instruments ({', '.join(problem.instruments)}) can't determine "
                f"{problem.parameters} Markov parameters; add instruments, or lags by past and future"
            )
        z = columns_of(range(instruments), kept, count=count, causal_order=causal)
        phi = columns_of(range(instruments, count), range(r, -d - 1, -1), count=count, causal_order=causal)
        what = f"{len(z)} lags of the instruments{' and a constant' if problem.with_constant else ''}"
        require_equations(problem, causal + noncausal + 1, len(z) + problem.with_constant, what)
        stretches = self._prefiltered(problem)
        equations = triangle(
            stretches, count, causal, noncausal, np.concatenate([z, phi]), constant=problem.with_constant
        )
        return _estimate(problem, equations, len(z))

    def _prefiltered(self, problem: Problem) -> tuple[Stretch, ...]:
        if self.prefilter is None:
            return problem.stretches
        import scipy.signal

        count = len(problem.instruments)
        parts = []
        for part in problem.stretches:
            values = part.read(0, len(part)).copy()
            values[:count] = scipy.signal.lfilter(*self.prefilter, values[:count], axis=1)
            parts.append(part.replace(values))
        return tuple(parts)


def _check_prefilter(prefilter: tuple[Sequence[float], Sequence[float]]) -> None:
    try:
        numerator, denominator = (list(part) for part in prefilter)
    except (TypeError, ValueError):
        raise InputError(
            f"prefilter is {prefilter!r}; give two sequences, the coefficients of numerator and denominator"
        ) from None
    for value in (*numerator, *denominator):
        number("prefilter's coefficient", value)
    if not any(numerator) or not denominator or denominator[0] == 0:
        raise InputError("prefilter needs a numerator that isn't 0 and a denominator whose first coefficient isn't 0")
    greatest = float(np.abs(np.roots(denominator)).max(initial=0.0))
    if greatest >= 1.0:
        raise InputError(
            f"prefilter has a pole of magnitude {greatest:.4g}; instruments need an asymptotically stable filter, with "
            "all poles inside the unit circle"
        )


def _estimate(problem: Problem, equations: Triangle, instruments: int) -> Estimate:
    """Solve on what the instruments see of the equations: the rows of R that belong to them."""
    projected = equations.seen_by(instruments)
    theta, rank = solve(projected)
    own = replace(
        equations, root=equations.root[:, instruments:], means=projected.means
    )  # all rows: what is left of y counts them
    return replace(summary(problem, own, theta, rank), root=projected.regressor[np.newaxis])

"""Prediction-error method with a noise model, section 3.6.4."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from gtmbench.checks import number, whole
from gtmbench.method.estimators.least_squares import solve, summary
from gtmbench.method.filters import NoiseModel, filtered
from gtmbench.method.problem import Estimate, Problem, require_equations
from gtmbench.method.regression.stretches import Stretch
from gtmbench.method.regression.triangle import triangle
from gtmbench.values.record import FloatArray


@dataclass(frozen=True, kw_only=True)
class PredictionError:
    """Minimise the mean square over k = r+n..l-d of the innovations, (3.88), over the H_i and A.

    epsilon(k) = A(q) (y_o(k) - sum over i = -d..r of H_i y_i(k-i)), equation (3.67), where A(q) stands for the inverse
    of G_w in (3.64): A(q) = 1 + a_1 q^-1 + ... + a_n q^-n. Long enough, it fits any noise spectrum; the inverse in the
    source, (3.79), is noncausal and a full matrix, this one is causal and diagonal, each output on its own. The H_i, by
    least squares on data filtered by A, and A, on the residual, are estimated in turn; except for rounding the
    criterion never rises. Noise that is fed back from y_o to y_i (a closed loop) still biases it: use instruments
    there.

    It minimises the innovations. The residual (4.11) may be larger than that of least squares, and drifts if A comes
    near 1 - q^-1. Watch `innovations` of the operator, not its residual.

    All samples are filtered anew in each turn, so memory grows with the record.

    Attributes
    ----------
    noise_order : int
        n; with 0 it is least squares.
    tolerance : float
        The iteration ends when the criterion falls by less than this share.
    most_iterations : int

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.PredictionError(noise_order=20)
    PredictionError(noise_order=20, tolerance=1e-08, most_iterations=100)
    """

    instruments: ClassVar[tuple[str, ...]] = ()

    noise_order: int = 10
    tolerance: float = 1e-8
    most_iterations: int = 100

    def __post_init__(self) -> None:
        object.__setattr__(self, "noise_order", whole("noise_order", self.noise_order))
        object.__setattr__(self, "most_iterations", whole("most_iterations", self.most_iterations, 1))
        number("tolerance", self.tolerance, 0.0)

    def estimate(self, problem: Problem) -> Estimate:
        """Return the estimate with its noise model; outputs have one each."""
        first = len(problem.channels) - len(problem.outputs)
        alone = [self._of_one_output(_with_output(problem, first + o)) for o in range(len(problem.outputs))]
        models = [model for _, model in alone]
        length = max(len(model.criterion) for model in models)
        paths = [np.pad(model.criterion, ((0, length - len(model.criterion)), (0, 0)), mode="edge") for model in models]
        return Estimate(
            coefficients=np.hstack([estimate.coefficients for estimate, _ in alone]),
            root=np.concatenate([estimate.root for estimate, _ in alone]),
            noise_variance=np.concatenate([estimate.noise_variance for estimate, _ in alone]),
            rms_residual=np.concatenate([estimate.rms_residual for estimate, _ in alone]),
            equations=alone[0][0].equations,
            rank=min(estimate.rank for estimate, _ in alone),
            constant=np.concatenate([np.atleast_1d(estimate.constant) for estimate, _ in alone]),
            solver=next((e.solver for e, _ in alone if e.solver != "cholesky"), "cholesky"),
            noise_model=NoiseModel(
                autoregressive=np.vstack([model.autoregressive for model in models]),
                innovation_std=np.concatenate([model.innovation_std for model in models]),
                converged=all(model.converged for model in models),
                criterion=np.hstack(paths),
            ),
        )

    def _of_one_output(self, problem: Problem) -> tuple[Estimate, NoiseModel]:
        unknowns = problem.unknowns + self.noise_order
        what = f"{unknowns} parameters with those of the noise"
        require_equations(problem, problem.lags + self.noise_order, unknowns, what)
        equations = problem.triangle()
        theta, rank = solve(equations)
        path: list[float] = []
        converged = False
        while not converged and len(path) < self.most_iterations:
            taps = _autoregressive(_residuals(problem, theta), self.noise_order, problem.with_constant)
            whitened = replace(problem, stretches=_filtered(problem.stretches, taps)).triangle()
            theta, rank = solve(whitened)
            path.append(float(np.mean(summary(problem, whitened, theta, rank).rms_residual ** 2)))
            converged = len(path) > 1 and path[-2] - path[-1] <= self.tolerance * path[-2]
        last = summary(problem, whitened, theta, rank)
        scale = problem.scale[-1]
        model = NoiseModel(
            autoregressive=taps[np.newaxis],
            innovation_std=last.rms_residual * scale,
            converged=converged,
            criterion=np.array(path)[:, np.newaxis] * scale**2,
        )
        # (4.11) has no mean then; the whitened equations' own constant over A(1) is the same but for the ends
        one_step = summary(problem, equations, theta, rank)
        free = whitened.weight - unknowns
        return replace(
            last,
            noise_variance=last.rms_residual**2 * whitened.weight / free if free > 0 else np.full(1, np.nan),
            rms_residual=one_step.rms_residual,
            constant=one_step.constant,
        ), model


def _with_output(problem: Problem, channel: int) -> Problem:
    """Return the problem of one of the outputs, given by the number of its channel."""
    channels = [*range(len(problem.inputs)), channel]
    return replace(
        problem,
        stretches=tuple(part.replace(part.read(0, len(part))[channels]) for part in problem.stretches),
        outputs=(problem.channels[channel],),
        centre=problem.centre[channels],
        scale=problem.scale[channels],
    )


def _residuals(problem: Problem, theta: FloatArray) -> tuple[Stretch, ...]:
    """Return the one-step residual as stretches of one channel, twice: to be lagged, and as the target."""
    r, d = problem.causal_order, problem.noncausal_order
    markov = theta.reshape(problem.lags, 1, len(problem.inputs))[::-1]
    no_means = np.zeros(len(problem.inputs))
    parts = []
    for part in problem.stretches:
        if len(part) > r + d:
            block = part.read(0, len(part))
            left = block[-1, r : len(part) - d] - filtered(block[:-1], markov, no_means)[:, 0]
            parts.append(part.replace(np.vstack([left, left]), skipped=r))
    return tuple(parts)


def _autoregressive(residuals: tuple[Stretch, ...], order: int, constant: bool) -> FloatArray:
    """Return 1, a_1, ..., a_n by least squares of e(k) on e(k-1)..e(k-n)."""
    if order == 0:
        return np.ones(1)
    past = np.arange(order, dtype=np.intp)  # lags n..1
    coefficients, _ = solve(triangle(residuals, 1, order, 0, past, constant=constant))
    return np.concatenate([[1.0], -coefficients[::-1, 0]])


def _filtered(stretches: tuple[Stretch, ...], taps: FloatArray) -> tuple[Stretch, ...]:
    """Return A(q) of every channel, from the first sample on whose past is known."""
    import scipy.signal

    order = len(taps) - 1
    parts = []
    for part in stretches:
        if len(part) > order:
            values = scipy.signal.lfilter(taps, 1.0, part.read(0, len(part)), axis=1)
            parts.append(part.replace(values[:, order:], skipped=order))
    return tuple(parts)

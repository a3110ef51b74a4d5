"""What every estimator is given, and what it gives back."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from gtmbench.errors import InputError
from gtmbench.method.noise_model import NoiseModel
from gtmbench.method.regression.stretches import Stretch
from gtmbench.method.regression.triangle import Columns, Triangle, triangle
from gtmbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Centred, scaled samples and the operator that is looked for.

    Attributes
    ----------
    stretches : tuple of Stretch
        Channels: instruments, inputs, outputs, in this order.
    instruments, inputs, outputs : tuple of str
    causal_order, noncausal_order : int
        r and d.
    centre, scale : shape (channels,)
        Mean of every channel and RMS about it, in its unit; estimates are in units of `scale`.
    sample_period_s : float
        Ts, in seconds.
    """

    stretches: tuple[Stretch, ...] = field(repr=False)
    instruments: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    causal_order: int
    noncausal_order: int
    centre: FloatArray
    scale: FloatArray
    sample_period_s: float

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the stretches' channels."""
        return (*self.instruments, *self.inputs, *self.outputs)

    @property
    def lags(self) -> int:
        """How many lags: r + d + 1."""
        return self.causal_order + self.noncausal_order + 1

    @property
    def parameters(self) -> int:
        """Markov parameters of one output."""
        return self.lags * len(self.inputs)

    @property
    def equations(self) -> int:
        """How many equations the stretches give."""
        return self.windows(self.lags)

    def windows(self, length: int) -> int:
        """Return how many windows of `length` samples in a row the stretches hold."""
        return sum(max(len(part) - length + 1, 0) for part in self.stretches)

    def triangle(self) -> Triangle:
        """Reduce ``[Phi | y]`` (no instruments); columns of Phi: lag r to -d, input by input within."""
        return triangle(self.stretches, len(self.inputs), self.causal_order, self.noncausal_order)


def require_equations(problem: Problem, lags: int, unknowns: int, what: str) -> None:
    """Refuse stretches that give fewer equations, with windows of `lags` samples, than there are unknowns."""
    equations = problem.windows(lags)
    if equations < unknowns:
        samples, pieces = sum(map(len, problem.stretches)), len(problem.stretches)
        longest = max(map(len, problem.stretches)) if pieces > 1 else None
        raise too_few(samples, problem.inputs, equations, unknowns, what, lags, longest)


def too_few(
    samples: int, inputs: Sequence[str], equations: int, unknowns: int, what: str, lags: int, longest: int | None = None
) -> InputError:
    """Return the error that says how many samples would do; `longest` is the longest of several stretches."""
    given = f"{samples} samples of {', '.join(inputs)}"
    pieces = (
        "" if longest is None else f" between gaps (an equation takes {lags} in a row, the longest run is {longest})"
    )
    return InputError(
        f"{given}{pieces} give {equations} equations for {unknowns} {what}; record at least {unknowns + lags - 1} "
        + ("samples" if longest is None else "samples in a row")
        + " or lower the orders"
    )


def columns_of(channels: Sequence[int], lags: Sequence[int], *, count: int, causal_order: int) -> Columns:
    """Return where `lags` of some of `count` lagged channels stand, lag by lag, with lag `causal_order` first."""
    positions = causal_order - np.array(lags, dtype=np.intp)
    return (positions[:, np.newaxis] * count + np.array(channels, dtype=np.intp)).ravel()


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What an estimator found, every channel scaled to an RMS of 1.

    Attributes
    ----------
    coefficients : shape (parameters, outputs)
        Lag r to -d, input by input within.
    root : shape (outputs, parameters, parameters), or (1, parameters, parameters) for all outputs
        S: with white noise the covariance of an output's coefficients is its noise variance times (S'S)^-1.
    noise_variance : shape (outputs,)
        Of that noise; NaN where the theory gives no covariance.
    rms_residual : shape (outputs,)
        Of the one-step residual over the equations.
    equations : int
        How many the estimator used.
    rank : int
    solver : str
    rank_chosen : bool
        The rank was chosen, so that less than full is no surprise.
    noise_model : NoiseModel, optional
        Of an estimator that finds one, in the outputs' units.
    sensor_noise : shape (inputs + outputs,), optional
        Standard deviations that an estimator took or found, in the channels' units.
    """

    coefficients: FloatArray
    root: FloatArray
    noise_variance: FloatArray
    rms_residual: FloatArray
    equations: int
    rank: int
    solver: str
    rank_chosen: bool = False
    noise_model: NoiseModel | None = None
    sensor_noise: FloatArray | None = None


class Estimator(Protocol):
    """Anything that turns a problem into an estimate."""

    @property
    def instruments(self) -> tuple[str, ...]:
        """Channels it needs beside pseudo inputs and outputs; a class without any has the class variable ()."""

    def estimate(self, problem: Problem) -> Estimate:
        """Return the Markov parameters and what is known of them."""

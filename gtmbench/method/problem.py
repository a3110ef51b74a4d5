"""The problem that every estimator is given, posed and checked once for all of them, and what it gives back."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import names, shown, whole
from gtmbench.errors import InputError, NoteWarning
from gtmbench.method.filters import NoiseModel
from gtmbench.method.regression.stretches import Stretch, check_constant, stretches
from gtmbench.method.regression.triangle import Columns, Triangle, triangle
from gtmbench.values.clock import same_period
from gtmbench.values.ranges import within_range
from gtmbench.values.record import FloatArray, Record, check_record

_MOST_PARAMETERS = 10_000  # 0.8 GB for their Gram matrix

Records = Record | Sequence[Record]
Weights = ArrayLike | Sequence[ArrayLike | None] | None
Constant = Literal["estimated", "records", "none"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Problem:
    """Centred, scaled samples and the operator that is looked for."""

    stretches: tuple[Stretch, ...] = field(repr=False)  # channels: instruments, inputs, outputs, in this order
    instruments: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    # causal_order, noncausal_order: r and d
    causal_order: int
    noncausal_order: int
    # centre, scale, shape (channels,): mean of every channel (0 if there is to be no constant) and RMS about it, in its
    # unit; estimates are in units of `scale`
    centre: FloatArray
    scale: FloatArray
    sample_period_s: float  # Ts, in seconds
    constant: Constant = "estimated"  # as `identify` takes it

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
    def with_constant(self) -> bool:
        """Whether a constant is estimated with the Markov parameters."""
        return self.constant == "estimated"

    @property
    def unknowns(self) -> int:
        """Markov parameters of one output, and its constant."""
        return self.parameters + self.with_constant

    @property
    def equations(self) -> int:
        """How many equations the stretches give."""
        return self.windows(self.lags)

    def windows(self, length: int) -> int:
        """Return how many windows of `length` samples in a row the stretches hold."""
        return sum(max(len(part) - length + 1, 0) for part in self.stretches)

    def triangle(self) -> Triangle:
        """Reduce ``[Phi | y]`` (no instruments); columns of Phi: lag r to -d, input by input within."""
        return triangle(
            self.stretches, len(self.inputs), self.causal_order, self.noncausal_order, constant=self.with_constant
        )


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
        f"{given}{pieces} give {equations} equations for {what}; record at least {unknowns + lags - 1} "
        + ("samples" if longest is None else "samples in a row")
        + " or lower the orders"
    )


def columns_of(channels: Sequence[int], lags: Sequence[int], *, count: int, causal_order: int) -> Columns:
    """Return where `lags` of some of `count` lagged channels stand, lag by lag, with lag `causal_order` first."""
    positions = causal_order - np.array(lags, dtype=np.intp)
    return (positions[:, np.newaxis] * count + np.array(channels, dtype=np.intp)).ravel()


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """What an estimator found, every channel scaled to an RMS of 1."""

    coefficients: FloatArray  # shape (parameters, outputs): lag r to -d, input by input within
    # shape (outputs, parameters, parameters): S: with white noise the covariance of an output's coefficients is its
    # noise variance times (S'S)^-1
    root: FloatArray
    noise_variance: FloatArray  # shape (outputs,): of that noise; NaN where the theory gives no covariance
    rms_residual: FloatArray  # shape (outputs,): of the one-step residual over the equations
    equations: int  # how many the estimator used
    rank: int
    solver: str
    constant: FloatArray | float = 0.0  # shape (outputs,): what the operator adds; 0 unless it was estimated
    rank_chosen: bool = False  # the rank was chosen, so that less than full is no surprise
    noise_model: NoiseModel | None = None  # of an estimator that finds one, in the outputs' units
    # shape (inputs + outputs,): standard deviations that an estimator took or found, in the channels' units
    sensor_noise: FloatArray | None = None


class Estimator(Protocol):
    """Anything that turns a problem into an estimate."""

    @property
    def instruments(self) -> tuple[str, ...]:
        """Channels it needs beside pseudo inputs and outputs; a class without any has the class variable ()."""

    def estimate(self, problem: Problem) -> Estimate:
        """Return the Markov parameters and what is known of them."""


def operator_names(inputs: Sequence[str], outputs: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return pseudo inputs and pseudo outputs: at least one of each, every one named once."""
    u, y = names("inputs", inputs), names("outputs", outputs)
    if not u or not y:
        raise InputError("an operator needs at least one pseudo input and one pseudo output")
    both = [name for name in y if name in u]
    if both:
        raise InputError(f"'{both[0]}' is both pseudo input and pseudo output; it would predict itself")
    return u, y


def as_records(given: Records) -> tuple[Record, ...]:
    """Return one record or several as a tuple: at least one, all of one sample period."""
    records = (given,) if isinstance(given, Record) or not isinstance(given, Iterable) else tuple(given)
    for record in records:
        check_record(record)
    if not records:
        raise InputError("no record given; give one Record or several")
    periods = {record.sample_period_s for record in records}
    if not same_period(max(periods), min(periods)):
        raise InputError(
            f"the records are sampled every {', '.join(f'{period:g}' for period in sorted(periods))} s; one operator "
            "has one sample period, so resample them"
        )
    return records


def taught_records(given: Records) -> tuple[Record, ...]:
    """Return what a detector learns from: `as_records`, readings that no sensor reads missing, with a word of them."""
    inside = [within_range(record) for record in as_records(given)]
    for _, found in inside:
        for each in found:
            warnings.warn(NoteWarning(each.text), stacklevel=3)
    return tuple(record for record, _ in inside)


def pose_problem(
    records: Records,
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    causal_order: int,
    noncausal_order: int,
    *,
    instruments: tuple[str, ...] = (),
    weights: Weights = None,
    constant: Constant = "estimated",
) -> Problem:
    """Check everything that names don't tell and return what an estimator works on."""
    flights = as_records(records)
    check_constant_kind(constant)
    given = [weights] if isinstance(records, Record) else weights
    parts, centre, rms = stretches(flights, (*instruments, *inputs, *outputs), _weights(flights, given))
    problem = Problem(
        stretches=parts,
        instruments=instruments,
        inputs=inputs,
        outputs=outputs,
        causal_order=whole("causal_order", causal_order),
        noncausal_order=whole("noncausal_order", noncausal_order),
        centre=centre,
        scale=rms,
        sample_period_s=flights[0].sample_period_s,
        constant=constant,
    )
    check_parameters(problem.lags, len(inputs))
    require_equations(problem, problem.lags, problem.unknowns, unknowns_of(problem))
    check_constant(problem.channels, centre, rms)
    if constant != "none":
        return problem
    centre, rms = about_zero(centre, rms)
    return replace(problem, stretches=tuple(part.freed(centre, rms) for part in parts), centre=centre, scale=rms)


def about_zero(centre: FloatArray, rms: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means of 0, and the RMS values about them."""
    return np.zeros_like(centre), np.hypot(centre, rms)


def unknowns_of(problem: Problem) -> str:
    """Say what the equations have to determine."""
    target = f" of '{problem.outputs[0]}'" if problem.outputs else ""
    return f"{problem.parameters} Markov parameters{' and a constant' if problem.with_constant else ''}{target}"


def check_constant_kind(constant: Any) -> None:
    """Refuse what isn't a way of treating the constant."""
    if constant not in get_args(Constant):
        raise InputError(f"constant is {shown(constant)}; it is 'estimated', 'records' or 'none'")


def check_parameters(lags: int, inputs: int) -> None:
    """Refuse more Markov parameters than can be solved for."""
    if lags * inputs > _MOST_PARAMETERS:
        raise InputError(
            f"{lags} lags of {inputs} inputs are {lags * inputs} Markov parameters an output; at most "
            f"{_MOST_PARAMETERS} are solved for, so lower the orders"
        )


def _weights(records: tuple[Record, ...], given: Any) -> list[FloatArray | None]:
    """Return one array of weights a record, or None for all 1."""
    each = [None] * len(records) if given is None else list(given) if isinstance(given, Iterable) else [given]
    if len(each) != len(records):
        raise InputError(f"{len(each)} arrays of weights were given for {len(records)} records; give one a record")
    arrays: list[FloatArray | None] = []
    for record, weights in zip(records, each, strict=True):
        if weights is None:
            arrays.append(None)
            continue
        try:
            if np.iscomplexobj(weights):
                raise TypeError
            array = np.asarray(weights, dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"weights hold a {type(weights).__name__}; give numbers, one a sample") from None
        if array.shape != (len(record),):
            raise InputError(f"weights of shape {array.shape} for {len(record)} samples; give one a sample")
        if not np.all((array == 0) | ((array >= 1e-100) & (array <= 1e100))):
            raise InputError("weights must be 0 or numbers from 1e-100 to 1e100")
        arrays.append(array)
    return arrays

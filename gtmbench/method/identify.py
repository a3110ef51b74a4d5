"""Identification: records in, a transmissibility operator out, by any estimator (sections 3.6 and 4.3)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import whole
from gtmbench.errors import InputError, RankWarning
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.estimators.problem import Estimate, Estimator, Problem
from gtmbench.method.rank import cause
from gtmbench.method.regression.stretches import stretches
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import FloatArray, Record, frozen

_MOST_PARAMETERS = 10_000  # 0.8 GB for their Gram matrix

Weights = ArrayLike | Sequence[ArrayLike | None] | None


def identify(
    records: Record | Sequence[Record],
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    causal_order: int,
    noncausal_order: int,
    estimator: Estimator | None = None,
    weights: Weights = None,
) -> Transmissibility:
    """Identify the operator from inputs to outputs, equations (4.8) and (4.9), or as another estimator defines it.

    theta = argmin of the sum over k = r..l-d of ||y_o(k) - sum over i = -d..r of H_i y_i(k-i)||^2, the means of the
    records removed. (Means over k = 0..l, not over the equations: the ends cost a bias that falls with the length.)

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements, for example ``record.between(25, 200)``; several flights, or what lies between gaps.
    inputs, outputs : sequence of str
        Pseudo inputs and pseudo outputs.
    causal_order, noncausal_order : int
        r and d, samples into the past and into the future; 0 is allowed.
    estimator : Estimator, optional
        `LeastSquares` unless told; `InstrumentalVariables`, `PredictionError`, `TotalLeastSquares`.
    weights : array_like, shape (samples,), optional
        Factors of the squares in the sum, one a sample, 0 or more (with several records a list, one array each, None
        for all 1). A sample of weight 0 isn't used at all, so it may be missing; 2 counts as if it stood there twice.

    Raises
    ------
    InputError
        Where channels are missing, constant, hold NaN, or the records are too short.

    Warns
    -----
    RankWarning
        Where the data don't determine the Markov parameters (noise-free sinusoids don't), naming the channels.

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> y = 2.0 * u + np.roll(u, -1)  # y(k) = 2 u(k) + u(k+1)
    >>> record = Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=0.01)
    >>> identify(record, inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=1).markov[:, 0, 0].round(9) + 0.0
    array([1., 2., 0.])
    """
    method = LeastSquares() if estimator is None else estimator
    if not callable(getattr(method, "estimate", None)):
        raise InputError(f"estimator is {method!r}; give an object such as gtmbench.LeastSquares(), not its name")
    found = (records,) if isinstance(records, Record) else tuple(records)
    problem = _problem(found, names_of(inputs), names_of(outputs), causal_order, noncausal_order, method, weights)
    return operator_of(
        problem,
        method.estimate(problem),
        samples=problem.equations,
        sample_period_s=found[0].sample_period_s,
        estimator=method,
    )


def _problem(
    records: tuple[Record, ...],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    causal_order: int,
    noncausal_order: int,
    estimator: Estimator,
    weights: Weights,
) -> Problem:
    """Check everything and return what the estimator works on."""
    check_names(inputs, outputs)
    _check_periods(records)
    instruments = estimator.instruments
    channels = (*instruments, *inputs, *outputs)
    parts, centre, rms = stretches(records, channels, _weights(records, weights))
    problem = Problem(
        stretches=parts,
        instruments=instruments,
        inputs=inputs,
        outputs=outputs,
        causal_order=whole("causal_order", causal_order),
        noncausal_order=whole("noncausal_order", noncausal_order),
        centre=centre,
        scale=rms,
    )
    check_length(problem, sum(map(len, parts)), problem.equations, len(parts))
    return problem


def operator_of(
    problem: Problem, estimate: Estimate, *, samples: int, sample_period_s: float, estimator: Estimator
) -> Transmissibility:
    """Return the operator in the channels' units; warn where the data don't determine it."""
    if estimate.rank < problem.parameters and not estimate.rank_chosen:
        _warn_of_rank(problem, estimate, samples)
    skipped, split = len(problem.instruments), len(problem.instruments) + len(problem.inputs)
    rms, output_rms = problem.scale[skipped:split], problem.scale[split:]
    scaled = estimate.coefficients.reshape(problem.lags, len(rms), len(output_rms))[::-1]
    root = estimate.root.view()
    root.setflags(write=False)
    return Transmissibility(
        markov=frozen(scaled.transpose(0, 2, 1) * (output_rms[:, np.newaxis] / rms)),
        inputs=problem.inputs,
        outputs=problem.outputs,
        causal_order=problem.causal_order,
        noncausal_order=problem.noncausal_order,
        input_means=frozen(problem.centre[skipped:split]),
        output_means=frozen(problem.centre[split:]),
        input_rms=frozen(rms),
        rank=estimate.rank,
        samples=samples,
        rms_residual=frozen(estimate.rms_residual * output_rms),
        noise_variance=frozen(estimate.noise_variance * output_rms**2),
        root=root,
        sample_period_s=sample_period_s,
        estimator=repr(estimator),
        solver=estimate.solver,
        noise_model=estimate.noise_model,
        sensor_noise=estimate.sensor_noise,
    )


def names_of(names: Sequence[str]) -> tuple[str, ...]:
    """Return one name or several as a tuple."""
    return (names,) if isinstance(names, str) else tuple(names)


def check_names(inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    """Refuse an operator without inputs or outputs, or with a channel named twice."""
    if not inputs or not outputs:
        raise InputError("an operator needs at least one pseudo input and one pseudo output")
    twice = [name for names in (inputs, outputs) for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"'{twice[0]}' is given twice; name every pseudo input and pseudo output once")
    both = [name for name in outputs if name in inputs]
    if both:
        raise InputError(f"'{both[0]}' is both pseudo input and pseudo output; it would predict itself")


def _check_periods(records: tuple[Record, ...]) -> None:
    if not records:
        raise InputError("no record given; give one Record or several")
    periods = {record.sample_period_s for record in records}
    if max(periods) - min(periods) > 1e-6 * min(periods):
        raise InputError(
            f"the records are sampled every {', '.join(f'{period:g}' for period in sorted(periods))} s; one operator "
            "has one sample period, so resample them"
        )


def _weights(records: tuple[Record, ...], weights: Weights) -> list[FloatArray | None]:
    """Return one array of weights a record, or None for all 1."""
    if weights is None:
        return [None] * len(records)
    given = list(weights) if isinstance(weights, list | tuple) and len(records) > 1 else [weights]
    if len(given) != len(records):
        raise InputError(f"weights for {len(given)} records, but {len(records)} records; give one array a record")
    found: list[FloatArray | None] = []
    for record, one in zip(records, given, strict=True):
        array = None if one is None else np.asarray(one, dtype=float)
        if array is not None:
            if array.shape != (len(record),):
                raise InputError(f"weights of shape {array.shape} for {len(record)} samples; give one a sample")
            if not np.all((array >= 0) & np.isfinite(array)):
                raise InputError("weights must be finite numbers, 0 or more")
        found.append(array)
    return found


def check_length(problem: Problem, samples: int, equations: int, stretches: int = 1) -> None:
    """Refuse more Markov parameters than there are equations for, or than can be solved for."""
    parameters = problem.parameters
    if parameters > _MOST_PARAMETERS:
        raise InputError(
            f"{problem.lags} lags of {len(problem.inputs)} inputs are {parameters} Markov parameters an output; at "
            f"most {_MOST_PARAMETERS} are solved for, so lower the orders"
        )
    if equations < parameters:
        pieces = f" in {stretches} stretches" if stretches > 1 else ""
        raise InputError(
            f"{samples} samples of {', '.join(problem.inputs)}{pieces} give {equations} equations for {parameters} "
            f"Markov parameters of '{problem.outputs[0]}'; record at least {parameters + problem.lags - 1} samples or "
            "lower the orders"
        )


def _warn_of_rank(problem: Problem, estimate: Estimate, equations: int) -> None:
    source = f"instruments {', '.join(problem.instruments)} determine" if problem.instruments else "record determines"
    warnings.warn(
        f"the {source} {estimate.rank} of the {problem.parameters} Markov parameters of an output: "
        f"{cause(estimate.root[0], problem.inputs, equations)}; the smallest ones that fit were taken. Predictions on "
        "like records hold; don't read the parameters",
        RankWarning,
        stacklevel=4,
    )

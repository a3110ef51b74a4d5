"""Posing the problem: names, records, weights and orders are checked once, for everything that identifies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.method.estimators.problem import Problem
from gtmbench.method.regression.stretches import stretches
from gtmbench.record import FloatArray, Record

_MOST_PARAMETERS = 10_000  # 0.8 GB for their Gram matrix

Records = Record | Sequence[Record]
Weights = ArrayLike | Sequence[ArrayLike | None] | None


def operator_names(inputs: Sequence[str], outputs: Sequence[str]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return pseudo inputs and pseudo outputs: at least one of each, every one named once."""
    u, y = names(inputs), names(outputs)
    if not u or not y:
        raise InputError("an operator needs at least one pseudo input and one pseudo output")
    twice = [name for one in (u, y) for name in one if one.count(name) > 1]
    if twice:
        raise InputError(f"'{twice[0]}' is given twice; name every pseudo input and pseudo output once")
    both = [name for name in y if name in u]
    if both:
        raise InputError(f"'{both[0]}' is both pseudo input and pseudo output; it would predict itself")
    return u, y


def names(given: Sequence[str]) -> tuple[str, ...]:
    """Return a tuple of names; one name may come as a string."""
    return (given,) if isinstance(given, str) else tuple(given)


def as_records(given: Records) -> tuple[Record, ...]:
    """Return one record or several as a tuple: at least one, all of one sample period."""
    found = (given,) if isinstance(given, Record) else tuple(given)
    if not found:
        raise InputError("no record given; give one Record or several")
    periods = {record.sample_period_s for record in found}
    if max(periods) - min(periods) > 1e-6 * min(periods):
        raise InputError(
            f"the records are sampled every {', '.join(f'{period:g}' for period in sorted(periods))} s; one operator "
            "has one sample period, so resample them"
        )
    return found


def pose(
    records: tuple[Record, ...],
    inputs: tuple[str, ...],
    outputs: tuple[str, ...],
    causal_order: int,
    noncausal_order: int,
    *,
    instruments: tuple[str, ...] = (),
    weights: Weights = None,
) -> Problem:
    """Check everything that names don't tell and return what an estimator works on.

    Raises
    ------
    InputError
        Where channels are missing, constant, hold NaN, or the records are too short.
    """
    parts, centre, rms = stretches(records, (*instruments, *inputs, *outputs), _weights(records, weights))
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


def _weights(records: tuple[Record, ...], weights: Weights) -> list[FloatArray | None]:
    """Return one array of weights a record, or None for all 1."""
    if weights is None:
        return [None] * len(records)
    given: list[ArrayLike | None] = [weights]  # type: ignore[list-item]
    if isinstance(weights, list | tuple) and (len(records) > 1 or not np.isscalar(weights[0])):
        given = list(weights)
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
        target = f" of '{problem.outputs[0]}'" if problem.outputs else ""
        raise InputError(
            f"{samples} samples of {', '.join(problem.inputs)}{pieces} give {equations} equations for {parameters} "
            f"Markov parameters{target}; record at least {parameters + problem.lags - 1} samples or lower the orders"
        )

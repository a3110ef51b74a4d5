"""Posing the problem: names, records, weights and orders are checked once, for everything that identifies."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import names, whole
from gtmbench.clock import same_period
from gtmbench.errors import InputError
from gtmbench.method.problem import Problem, require_equations
from gtmbench.method.regression.stretches import check_constant, stretches
from gtmbench.record import FloatArray, Record, check_record

_MOST_PARAMETERS = 10_000  # 0.8 GB for their Gram matrix

Records = Record | Sequence[Record]
Weights = ArrayLike | Sequence[ArrayLike | None] | None


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
    found = (given,) if isinstance(given, Record) or not isinstance(given, Iterable) else tuple(given)
    for record in found:
        check_record(record)
    if not found:
        raise InputError("no record given; give one Record or several")
    periods = {record.sample_period_s for record in found}
    if not same_period(max(periods), min(periods)):
        raise InputError(
            f"the records are sampled every {', '.join(f'{period:g}' for period in sorted(periods))} s; one operator "
            "has one sample period, so resample them"
        )
    return found


def pose_problem(
    records: Records,
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
    found = as_records(records)
    given = [weights] if isinstance(records, Record) else weights
    parts, centre, rms = stretches(found, (*instruments, *inputs, *outputs), _weights(found, given))
    problem = Problem(
        stretches=parts,
        instruments=instruments,
        inputs=inputs,
        outputs=outputs,
        causal_order=whole("causal_order", causal_order),
        noncausal_order=whole("noncausal_order", noncausal_order),
        centre=centre,
        scale=rms,
        sample_period_s=found[0].sample_period_s,
    )
    check_parameters(problem.lags, len(inputs))
    target = f" of '{outputs[0]}'" if outputs else ""
    require_equations(problem, problem.lags, problem.parameters, f"Markov parameters{target}")
    check_constant(problem.channels, centre, rms)
    return problem


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
    found: list[FloatArray | None] = []
    for record, one in zip(records, each, strict=True):
        if one is None:
            found.append(None)
            continue
        try:
            if np.iscomplexobj(one):
                raise TypeError
            array = np.asarray(one, dtype=float)
        except (TypeError, ValueError):
            raise InputError(f"weights hold a {type(one).__name__}; give numbers, one a sample") from None
        if array.shape != (len(record),):
            raise InputError(f"weights of shape {array.shape} for {len(record)} samples; give one a sample")
        if not np.all((array == 0) | ((array >= 1e-100) & (array <= 1e100))):
            raise InputError("weights must be 0 or numbers from 1e-100 to 1e100")
        found.append(array)
    return found

"""Tables of a monitor's file: plain JSON values of what is kept, and checks of what is read, one key at a time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from gtmbench import checks
from gtmbench.checks import names, number, shown, text, whole
from gtmbench.errors import InputError
from gtmbench.files.plain import exact
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.clock import same_period
from gtmbench.values.record import FloatArray, frozen

OPERATOR_KEYS = (
    "inputs",
    "outputs",
    "causal_order",
    "noncausal_order",
    "sample_period_s",
    "estimator",
    "solver",
    "rank",
    "samples",
    "input_means",
    "output_means",
    "rms_residual",
    "markov",
)
MOST_LAGS = 10_000  # times inputs; what identification allows, too
GREATEST = 1e30  # of any figure: its fourth power is still a number, and no calibration comes near
_MOST_NAMES = 100  # beyond is a broken file
PERIODS_S = (1e-9, 86400.0)  # beyond is a broken file


def operator_table(operator: Transmissibility) -> dict[str, Any]:
    """Return what watching and describing need of an operator; its covariance isn't kept."""
    return {key: exact(getattr(operator, key)) for key in OPERATOR_KEYS}


def operator_of(
    where: str, table: Any, inputs: tuple[str, ...], outputs: tuple[str, ...], period_s: float, other: str
) -> Transmissibility:
    """Return the operator of a table; `other` says what its inputs and outputs have to agree with.

    InputError naming the key, what stands there and what should.
    """
    table = keys(where, table, OPERATOR_KEYS)
    for key, wanted in (("inputs", list(inputs)), ("outputs", list(outputs))):
        if table[key] != wanted:
            raise InputError(f"{where}.{key} is {shown(table[key])}; {other} says {shown(wanted)}")
    causal, noncausal = (
        whole(f"{where}.{key}", table[key], 0, MOST_LAGS) for key in ("causal_order", "noncausal_order")
    )
    lags = causal + noncausal + 1
    if lags * len(inputs) > MOST_LAGS:
        raise InputError(f"{where}: {lags} lags of {len(inputs)} inputs; at most {MOST_LAGS} parameters are read")
    own_s = number(f"{where}.sample_period_s", table["sample_period_s"], *PERIODS_S)
    if not same_period(own_s, period_s):
        raise InputError(f"{where}.sample_period_s is {own_s:g}; the monitor's is {period_s:g}, and they must be one")
    for key in ("estimator", "solver"):
        if not isinstance(table[key], str):
            raise InputError(f"{where}.{key} is {shown(table[key])}; it must be a text")
    markov = array_of(f"{where}.markov", table["markov"], (lags, len(outputs), len(inputs)))
    if not markov.any():
        raise InputError(f"{where}.markov holds nothing but 0, which predicts nothing; run `gtmbench calibrate`")
    return Transmissibility(
        markov=markov,
        inputs=inputs,
        outputs=outputs,
        causal_order=causal,
        noncausal_order=noncausal,
        input_means=array_of(f"{where}.input_means", table["input_means"], (len(inputs),)),
        output_means=array_of(f"{where}.output_means", table["output_means"], (len(outputs),)),
        rms_residual=array_of(f"{where}.rms_residual", table["rms_residual"], (len(outputs),)),
        rank=whole(f"{where}.rank", table["rank"]),
        samples=whole(f"{where}.samples", table["samples"], 0, 10**15),
        sample_period_s=own_s,
        estimator=table["estimator"],
        solver=table["solver"],
    )


def keys(where: str, given: Any, wanted: tuple[str, ...]) -> Mapping[str, Any]:
    """Return a table that has exactly these keys, in the file's order."""
    table = table_of(where or "it", given)
    missing = [key for key in wanted if key not in table]
    if missing:
        before = f"{where}: " if where else ""
        raise InputError(f"{before}key '{missing[0]}' is missing; there must be {', '.join(wanted)}")
    return checks.keys(table, wanted, where=where, there="there must be")


def table_of(where: str, given: Any) -> dict[str, Any]:
    """Return what should be a table."""
    return checks.table_of(where, given, "{...}")


def names_of(where: str, given: Any) -> tuple[str, ...]:
    """Return a list of channels, each once."""
    if not isinstance(given, list) or not 0 < len(given) <= _MOST_NAMES:
        raise InputError(f"{where} is {shown(given)}; it must be a list of 1 to {_MOST_NAMES} channels")
    return names(where, [text(where, name) for name in given])


def array_of(where: str, given: Any, shape: tuple[int, ...]) -> FloatArray:
    """Return lists of numbers as an array of a known shape."""
    _check_numbers(where, given, shape, shape)
    return frozen(given)


def _check_numbers(where: str, given: Any, left: tuple[int, ...], shape: tuple[int, ...]) -> None:
    if not left:
        number(where, given, -GREATEST, GREATEST)
        return
    if not isinstance(given, list) or len(given) != left[0]:
        held = f"a list of {len(given)}" if isinstance(given, list) else shown(given)
        raise InputError(f"{where} holds {held} where {left[0]} numbers or lists belong; its shape must be {shape}")
    for entry in given:
        _check_numbers(where, entry, left[1:], shape)

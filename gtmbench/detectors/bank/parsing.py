"""From the tables of a monitor's file to a monitor: names, shapes, kinds and ranges are checked, one by one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gtmbench.checks import number, shown, text, whole
from gtmbench.clock import same_period
from gtmbench.detectors.bank.bank import Bank, ResidualSpec, bank_of
from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.bank.doubt import Doubt
from gtmbench.detectors.bank.statistics import Tolerance
from gtmbench.detectors.bank.whitening import Whitener
from gtmbench.errors import InputError
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import FloatArray, frozen
from gtmbench.version import __version__

FORMAT = "gtmbench monitor"
VERSION = 1
NEVER = "inf"  # a threshold that nothing passes: JSON has no infinity
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

_KEYS = ("format", "version", "gtmbench", "sample_period_s", "name", "bank", "residuals", "provenance")
_PARTS = ("operator", "whitener", "tolerance", "thresholds", "doubt")
_MOST_LAGS = 10_000  # times inputs; what identification allows, too
_LONGEST_WHITENER = 100_000
_PERIODS_S = (1e-9, 86400.0)


def parse_monitor(document: Any) -> CalibratedBank:
    """Return the monitor of a parsed file.

    Parameters
    ----------
    document
        What `json` made of it, its numbers finite.

    Raises
    ------
    InputError
        Naming the key, what stands there and what should.
    """
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError("it isn't a monitor of gtmbench; `gtmbench calibrate` writes one")
    version, by = document.get("version"), document.get("gtmbench")
    if type(version) is not int or version != VERSION:
        raise InputError(
            f"version is {shown(version)}, written by gtmbench {shown(by)}; this is gtmbench {__version__}, which "
            f"reads version {VERSION}: use the other, or run `gtmbench calibrate`"
        )
    _keys("", document, _KEYS)
    name = text("name", document["name"])
    text("gtmbench", by)
    try:
        bank = bank_of(name, _table("bank", document["bank"]))
    except InputError as error:
        raise InputError(f"bank: {error}") from error
    period_s = number("sample_period_s", document["sample_period_s"], *_PERIODS_S)
    wanted = tuple(spec.output for spec in bank.residuals)
    parts = _keys("residuals", document["residuals"], wanted)
    for output in wanted:
        _keys(f"residuals.{output}", parts[output], _PARTS)

    def each(part: str, read: Callable[[str, Any, ResidualSpec], Any]) -> dict[str, Any]:
        return {
            spec.output: read(f"residuals.{spec.output}.{part}", parts[spec.output][part], spec)
            for spec in bank.residuals
        }

    operators = each("operator", lambda where, table, spec: _operator(where, table, spec, period_s))
    doubts = {output: doubt for output, doubt in each("doubt", _doubt).items() if doubt is not None}
    for output, doubt in doubts.items():
        if len(doubt.root) != operators[output].markov.size:
            raise InputError(
                f"residuals.{output}.doubt.root has {len(doubt.root)} rows; the operator has "
                f"{operators[output].markov.size} Markov parameters, and they must be one"
            )
    return CalibratedBank(
        bank=bank,
        operators=operators,
        whiteners=each("whitener", _whitener),
        tolerances=each("tolerance", _tolerance),
        thresholds=each("thresholds", lambda where, table, _: _thresholds(where, table, bank, period_s)),
        doubts=doubts,
        sample_period_s=period_s,
        provenance=_table("provenance", document["provenance"]),
    )


def _operator(where: str, table: Any, spec: ResidualSpec, period_s: float) -> Transmissibility:
    found = _keys(where, table, OPERATOR_KEYS)
    for key, of_bank in (("inputs", list(spec.inputs)), ("outputs", [spec.output])):
        if found[key] != of_bank:
            raise InputError(f"{where}.{key} is {shown(found[key])}; the bank says {shown(of_bank)}")
    causal, noncausal = (
        whole(f"{where}.{key}", found[key], 0, _MOST_LAGS) for key in ("causal_order", "noncausal_order")
    )
    inputs, lags = len(spec.inputs), causal + noncausal + 1
    if lags * inputs > _MOST_LAGS:
        raise InputError(f"{where}: {lags} lags of {inputs} inputs; at most {_MOST_LAGS} parameters are read")
    own_s = number(f"{where}.sample_period_s", found["sample_period_s"], *_PERIODS_S)
    if not same_period(own_s, period_s):
        raise InputError(f"{where}.sample_period_s is {own_s:g}; the monitor's is {period_s:g}, and they must be one")
    for key in ("estimator", "solver"):
        if not isinstance(found[key], str):
            raise InputError(f"{where}.{key} is {shown(found[key])}; it must be a text")
    return Transmissibility(
        markov=_array(f"{where}.markov", found["markov"], (lags, 1, inputs)),
        inputs=spec.inputs,
        outputs=(spec.output,),
        causal_order=causal,
        noncausal_order=noncausal,
        input_means=_array(f"{where}.input_means", found["input_means"], (inputs,)),
        output_means=_array(f"{where}.output_means", found["output_means"], (1,)),
        rms_residual=_array(f"{where}.rms_residual", found["rms_residual"], (1,)),
        rank=whole(f"{where}.rank", found["rank"]),
        samples=whole(f"{where}.samples", found["samples"], 0, 10**15),
        sample_period_s=own_s,
        estimator=found["estimator"],
        solver=found["solver"],
    )


def _whitener(where: str, table: Any, _: ResidualSpec) -> Whitener:
    found = _keys(where, table, ("coefficients", "mean", "deviation"))
    given = found["coefficients"]
    if not isinstance(given, list) or not 0 < len(given) <= _LONGEST_WHITENER:
        raise InputError(f"{where}.coefficients is {shown(given)}; it must be a list of 1 to {_LONGEST_WHITENER}")
    return Whitener(
        coefficients=_array(f"{where}.coefficients", given, (len(given),)),
        mean=number(f"{where}.mean", found["mean"]),
        deviation=number(f"{where}.deviation", found["deviation"], 0.0, above=True),
    )


def _tolerance(where: str, table: Any, _: ResidualSpec) -> Tolerance:
    found = _keys(where, table, ("mean", "low", "high"))
    return Tolerance(
        mean=number(f"{where}.mean", found["mean"], 0.0),
        low=number(f"{where}.low", found["low"], 0.0, 1.0, above=True),
        high=number(f"{where}.high", found["high"], 1.0),
    )


def _thresholds(where: str, table: Any, bank: Bank, period_s: float) -> dict[str, float]:
    nothing = np.zeros(0)
    labels = [series.label for series in bank.statistic.series(nothing, nothing, period_s, Tolerance())]
    found = _keys(where, table, tuple(dict.fromkeys(labels)))
    return {
        label: math.inf if value == NEVER else number(f"{where}, '{label}'", value) for label, value in found.items()
    }


def _doubt(where: str, table: Any, spec: ResidualSpec) -> Doubt | None:
    if table is None:
        return None
    found = _keys(where, table, ("raw", "white", "root"))
    given = found["root"]
    size = len(given) if isinstance(given, list) else 0
    if not 0 < size <= _MOST_LAGS or size % len(spec.inputs):
        raise InputError(f"{where}.root is {shown(given)}; it must be a square table, {len(spec.inputs)} rows a lag")
    return Doubt(
        root=_array(f"{where}.root", given, (size, size)),
        raw=number(f"{where}.raw", found["raw"], 0.0),
        white=number(f"{where}.white", found["white"], 0.0),
    )


def _keys(where: str, table: Any, keys: tuple[str, ...]) -> Mapping[str, Any]:
    """Return a table that has exactly these keys, in the file's order."""
    found = _table(where or "it", table)
    missing = [key for key in keys if key not in found]
    strange = [key for key in found if key not in keys]
    if missing or strange:
        what = f"key '{missing[0]}' is missing" if missing else f"unknown key {shown(strange[0])}"
        raise InputError(f"{where + ': ' if where else ''}{what}; there must be {', '.join(keys)}")
    return found


def _table(where: str, given: Any) -> dict[str, Any]:
    if not isinstance(given, dict):
        raise InputError(f"{where} is {shown(given)}; it must be a table, {{...}}")
    return given


def _array(where: str, given: Any, shape: tuple[int, ...]) -> FloatArray:
    _check_numbers(where, given, shape, shape)
    return frozen(given)


def _check_numbers(where: str, given: Any, left: tuple[int, ...], shape: tuple[int, ...]) -> None:
    if not left:
        number(where, given)
        return
    if not isinstance(given, list) or len(given) != left[0]:
        held = f"a list of {len(given)}" if isinstance(given, list) else shown(given)
        raise InputError(f"{where} holds {held} where {left[0]} numbers or lists belong; its shape must be {shape}")
    for entry in given:
        _check_numbers(where, entry, left[1:], shape)

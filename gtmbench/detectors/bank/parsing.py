"""A calibrated bank as plain tables, and back: names, shapes, kinds and ranges are checked, one by one."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gtmbench.checks import naming, number, shown, text
from gtmbench.detectors.bank.bank import ResidualSpec, bank_of, bank_table
from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.statistics.sight import check_sight
from gtmbench.detectors.statistics.statistic import Allowance, Statistic
from gtmbench.detectors.statistics.uncertainty import HALF, ParameterUncertainty
from gtmbench.detectors.statistics.whitening import White, Whitener
from gtmbench.detectors.tables import (
    GREATEST,
    MOST_LAGS,
    PERIODS_S,
    array_of,
    keys,
    operator_of,
    operator_table,
    table_of,
)
from gtmbench.errors import InputError
from gtmbench.files.plain import exact
from gtmbench.method.transmissibility import Transmissibility

NEVER = "inf"  # a threshold that nothing passes: JSON has no infinity
_KEYS = ("sample_period_s", "name", "bank", "residuals")
_PARTS = ("operator", "whitener", "tolerance", "thresholds", "uncertainty")
_LONGEST_WHITENER = 100_000  # coefficients: more is a broken file
_LEAST_THRESHOLD = 1e-9  # nats or deviations; the thresholds of calibrations are 1 to 100


def bank_figures(monitor: CalibratedBank) -> dict[str, Any]:
    """Return what calibration found as plain JSON values.

    Of the operators, what watching and describing need is kept; their covariances aren't.
    """
    return {
        "sample_period_s": monitor.sample_period_s,
        "name": monitor.bank.name,
        "bank": bank_table(monitor.bank),
        "residuals": {spec.output: _residual_table(monitor, spec.output) for spec in monitor.bank.residuals},
    }


def _residual_table(monitor: CalibratedBank, output: str) -> dict[str, Any]:
    whitener, tolerance = monitor.whiteners[output], monitor.tolerances[output]
    thresholds, uncertainty = monitor.thresholds[output], monitor.uncertainties.get(output)
    return {
        "operator": operator_table(monitor.operators[output]),
        **judging_table(whitener, tolerance, thresholds),
        "uncertainty": None
        if uncertainty is None
        else {key: exact(getattr(uncertainty, key)) for key in ("raw", "white", "half", "root")},
    }


def judging_table(whitener: Whitener, tolerance: Allowance, thresholds: Mapping[str, float]) -> dict[str, Any]:
    """Return what a residual is judged by as plain JSON values."""
    return {
        "whitener": {key: exact(getattr(whitener, key)) for key in ("coefficients", "mean", "deviation")},
        "tolerance": {key: getattr(tolerance, key) for key in ("mean", "low", "high")},
        "thresholds": {label: NEVER if value == math.inf else value for label, value in thresholds.items()},
    }


def calibrated_of(figures: Any, provenance: Mapping[str, Any]) -> CalibratedBank:
    """Return the calibrated bank of some figures, every key checked.

    InputError naming the key, what stands there and what should.
    """
    # from the whole to its parts, each by what was read before: a threshold means nothing without its test
    document = keys("figures", figures, _KEYS)
    name = text("name", document["name"])
    with naming("bank"):
        bank = bank_of(name, table_of("bank", document["bank"]))
    period_s = number("sample_period_s", document["sample_period_s"], *PERIODS_S)
    wanted = tuple(spec.output for spec in bank.residuals)
    parts = keys("residuals", document["residuals"], wanted)
    tables = {output: keys(f"residuals.{output}", _renamed(parts[output]), _PARTS) for output in wanted}

    def each(part: str, read: Callable[[str, Any, ResidualSpec], Any]) -> dict[str, Any]:
        return {
            spec.output: read(f"residuals.{spec.output}.{part}", tables[spec.output][part], spec)
            for spec in bank.residuals
        }

    operators = each("operator", lambda where, table, spec: _operator(where, table, spec, period_s))
    uncertainties = {
        output: uncertainty
        for output, uncertainty in each("uncertainty", _uncertainty).items()
        if uncertainty is not None
    }
    for output, uncertainty in uncertainties.items():
        if len(uncertainty.root) != operators[output].markov.size:
            raise InputError(
                f"residuals.{output}.uncertainty.root has {len(uncertainty.root)} rows; the operator has "
                f"{operators[output].markov.size} Markov parameters, and they must be one"
            )
    tolerances = each("tolerance", lambda where, table, _: tolerance_from(where, table))

    def set_for(where: str, table: Any, spec: ResidualSpec) -> dict[str, float]:
        rms = float(operators[spec.output].rms_residual[0])
        return thresholds_from(where, table, bank.statistic, tolerances[spec.output], period_s, deviation=rms)

    # last, for `set_for` refuses thresholds that no fault would pass: a monitor that is deaf isn't opened
    thresholds = each("thresholds", set_for)
    return CalibratedBank(
        bank=bank,
        operators=operators,
        whiteners=each("whitener", lambda where, table, _: whitener_from(where, table)),
        tolerances=tolerances,
        thresholds=thresholds,
        uncertainties=uncertainties,
        sample_period_s=period_s,
        provenance=dict(provenance),
    )


def _renamed(table: Any) -> Any:
    """Return a residual's table with the keys of now; it said ``doubt`` before."""
    if not isinstance(table, dict) or "doubt" not in table or "uncertainty" in table:
        return table
    return {"uncertainty" if key == "doubt" else key: value for key, value in table.items()}


def _operator(where: str, table: Any, spec: ResidualSpec, period_s: float) -> Transmissibility:
    return operator_of(where, table, spec.inputs, (spec.output,), period_s, "the bank")


def whitener_from(where: str, table: Any) -> Whitener:
    """Return the whitening filter of a table, every key checked."""
    table = keys(where, table, ("coefficients", "mean", "deviation"))
    given = table["coefficients"]
    if not isinstance(given, list) or not 0 < len(given) <= _LONGEST_WHITENER:
        raise InputError(f"{where}.coefficients is {shown(given)}; it must be a list of 1 to {_LONGEST_WHITENER}")
    return Whitener(
        coefficients=array_of(f"{where}.coefficients", given, (len(given),)),
        mean=number(f"{where}.mean", table["mean"], -GREATEST, GREATEST),
        deviation=number(f"{where}.deviation", table["deviation"], 1.0 / GREATEST, GREATEST),
    )


def tolerance_from(where: str, table: Any) -> Allowance:
    """Return the tolerance of a table, every key checked."""
    table = keys(where, table, ("mean", "low", "high"))
    return Allowance(
        mean=number(f"{where}.mean", table["mean"], 0.0, GREATEST),
        low=number(f"{where}.low", table["low"], 1.0 / GREATEST, 1.0),
        high=number(f"{where}.high", table["high"], 1.0, GREATEST),
    )


def thresholds_from(
    where: str, table: Any, statistic: Statistic, tolerance: Allowance, period_s: float, *, deviation: float = 1.0
) -> dict[str, float]:
    """Return the thresholds of a table, one a test of the statistic, that let it see.

    `deviation` is that of the healthy residual, in its unit.
    """
    nothing = np.zeros(0)
    labels = [score.label for score in statistic.scores(nothing, White.steady(nothing), period_s, Allowance())]
    table = keys(where, table, tuple(dict.fromkeys(labels)))
    thresholds = {
        label: math.inf if value == NEVER else threshold_of(f"{where}, '{label}'", value)
        for label, value in table.items()
    }
    check_sight(where, thresholds, statistic, tolerance, period_s, deviation=deviation)
    return thresholds


def threshold_of(where: str, given: Any) -> float:
    """Return a test's threshold, which is no 0: noise alone passes that.

    >>> threshold_of("thresholds", 1e-300)
    Traceback (most recent call last):
    gtmbench.errors.InputError: thresholds is 1e-300; a threshold is 1e-09 or more; run `gtmbench calibrate`
    """
    value = number(where, given)
    if abs(value) < _LEAST_THRESHOLD:
        raise InputError(f"{where} is {value:g}; a threshold is {_LEAST_THRESHOLD:g} or more; run `gtmbench calibrate`")
    return value


def _uncertainty(where: str, table: Any, spec: ResidualSpec) -> ParameterUncertainty | None:
    if table is None:
        return None
    if isinstance(table, dict):
        table = {"half": HALF, **table}  # older files have none
    table = keys(where, table, ("raw", "white", "half", "root"))
    given = table["root"]
    size = len(given) if isinstance(given, list) else 0
    if not 0 < size <= MOST_LAGS or size % len(spec.inputs):
        raise InputError(f"{where}.root is {shown(given)}; it must be a square table, {len(spec.inputs)} rows a lag")
    return ParameterUncertainty(
        root=array_of(f"{where}.root", given, (size, size)),
        raw=number(f"{where}.raw", table["raw"], 0.0, GREATEST),
        white=number(f"{where}.white", table["white"], 0.0, GREATEST),
        half=_half(where, table["half"]),
    )


def _half(where: str, given: Any) -> int:
    if given not in (0, HALF) or isinstance(given, bool):
        raise InputError(f"{where}.half is {shown(given)}; it must be 0 or {HALF}")
    return int(given)

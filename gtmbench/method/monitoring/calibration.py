"""Calibration: healthy records in, a monitor out - operators, whitening filters, thresholds for a false-alarm rate."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.method.identify import identify
from gtmbench.method.monitoring.bank import Bank
from gtmbench.method.monitoring.monitor import Monitor, residuals_of
from gtmbench.method.monitoring.statistics import tolerance_of
from gtmbench.method.monitoring.tails import block_maxima, rate_bound, tail_threshold
from gtmbench.method.monitoring.whitening import Whitener, fit_whitener
from gtmbench.method.pose import Records, as_records
from gtmbench.method.pseudo_inputs import derive
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import FloatArray, Record

_BLOCK_S = 60.0  # longer than any correlation; shorter where there is little data
_BLOCKS = 40  # wanted for a tail
Progress = Callable[[str, int, int], None]


def calibrate(
    records: Records,
    *,
    bank: Bank,
    false_alarms_per_hour: float = 0.002,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress = lambda _step, _done, _of: None,
) -> Monitor:
    """Identify a bank on healthy records and set its thresholds on others.

    With several records every third identifies and the rest set thresholds; one record is cut in two (the first 40 %
    identify). The rate asked for is shared evenly by all series of all residuals.

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements with the bank's channels, all of one sample period.
    bank : Bank
    false_alarms_per_hour : float
        Wanted of the whole monitor; far below 1 over the hours given, it stands on extrapolated tails.
    provenance : mapping, optional
        Kept with the monitor: where the records come from.
    progress : callable
        Told the step, how many are done, and of how many.

    Raises
    ------
    InputError
        Where channels are missing, or the records too short.
    """
    found = as_records(records)
    rate = number("false_alarms_per_hour", false_alarms_per_hour, 1e-9, 1e3)
    for record in found:
        bank.check_channels(record.channels)
    learn, judge = _split(found)
    total = len(judge) + 2
    progress("identify", 0, total)
    operators, whiteners = _learn(bank, learn)
    test, period_s = bank.statistic, found[0].sample_period_s
    seen: dict[str, list[tuple[FloatArray, FloatArray]]] = {spec.output: [] for spec in bank.residuals}
    for done, record in enumerate(judge, 1):
        progress("residuals", done, total)
        residuals = residuals_of(bank, record, operators)
        for output, raw in residuals.raw.items():
            seen[output].append((raw, whiteners[output].whiten(raw)))
    progress("thresholds", total - 1, total)
    tolerances = {output: tolerance_of([white for _, white in pairs], test, period_s) for output, pairs in seen.items()}
    hours = sum(len(record) for record in judge) * period_s / 3600.0
    block_s = float(np.clip(hours * 3600.0 / _BLOCKS, 1.0, _BLOCK_S))
    rows = max(round(block_s / period_s), 1)
    maxima: dict[tuple[str, str], list[FloatArray]] = {}
    greatest: dict[tuple[str, str], float] = {}
    least: dict[tuple[str, str], Callable[[float], float]] = {}
    for output, pairs in seen.items():
        for raw, white in pairs:
            for series in test.series(raw, white, period_s, tolerances[output]):
                key = output, series.label
                maxima.setdefault(key, []).append(block_maxima(series.values, rows))
                # also of blocks that aren't complete
                greatest[key] = float(np.fmax.reduce(series.values, initial=greatest.get(key, -np.inf)))
                least[key] = series.least_threshold
    share = rate / len(maxima) * rows * period_s / 3600.0
    thresholds: dict[str, dict[str, float]] = {spec.output: {} for spec in bank.residuals}
    for key, parts in maxima.items():
        output, label = key
        thresholds[output][label] = max(_threshold(parts, share), greatest[key], least[key](share / rows))
    progress("done", total, total)
    return Monitor(
        bank=bank,
        operators=operators,
        whiteners=whiteners,
        tolerances=tolerances,
        thresholds=thresholds,
        sample_period_s=period_s,
        provenance={
            **(provenance or {}),
            "records": len(found),
            "identification_hours": sum(len(record) for record in learn) * period_s / 3600.0,
            "threshold_hours": hours,
            "block_s": rows * period_s,
            "false_alarms_per_hour": rate,
            "false_alarms_per_hour_at_most": rate_bound(0, hours),
        },
    )


def _split(records: tuple[Record, ...]) -> tuple[list[Record], list[Record]]:
    if len(records) == 1:
        only = records[0]
        cut_s = only.start_s + 0.4 * (only.end_s - only.start_s)
        if len(only) < 20:
            raise InputError(f"a record of {len(only)} samples is too short to calibrate on; give minutes")
        return [only.between(only.start_s, cut_s)], [only.between(cut_s, only.end_s)]
    learn = list(records[::3])
    return learn, [record for i, record in enumerate(records) if i % 3]


def _learn(bank: Bank, records: list[Record]) -> tuple[dict[str, Transmissibility], dict[str, Whitener]]:
    """Identify every operator, then whiten what it leaves over."""
    period_s = records[0].sample_period_s
    operators: dict[str, Transmissibility] = {}
    whiteners: dict[str, Whitener] = {}
    order = round(bank.whitening_s / period_s)
    for spec in bank.residuals:
        known = [derive(record.select(bank.channels), spec.inputs) for record in records]
        derived = [_complete(record.select([*spec.inputs, spec.output])) for record in known]
        operators[spec.output] = identify(
            derived,
            inputs=spec.inputs,
            outputs=[spec.output],
            causal_order=round(spec.look_back_s / period_s),
            noncausal_order=round(spec.look_ahead_s / period_s),
        )
        residuals = [residuals_of(bank, record, operators, [spec.output]).raw[spec.output] for record in records]
        whiteners[spec.output] = fit_whitener(residuals, order=order)
    return operators, whiteners


def _complete(record: Record) -> Record:
    """Return a record without the missing rows at its ends: derivatives don't reach there."""
    there = np.flatnonzero(np.isfinite(record.values).all(axis=1))
    if len(there) == 0:
        raise InputError("a record is too short for the bank's look-back and look-ahead; give a longer one")
    return record.between(record.time_s[there[0]], record.time_s[there[-1]])


def _threshold(parts: list[FloatArray], share: float) -> float:
    maxima = np.concatenate(parts)
    if not len(maxima):
        return float("inf")  # the records are shorter than this window: it can't be judged, so it doesn't alarm
    return tail_threshold(maxima, crossings_per_block=share)

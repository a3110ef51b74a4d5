"""Calibration: healthy records in, a monitor out - operators, whitening filters, thresholds for a false-alarm rate."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from gtmbench.checks import number
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.calibrated import CalibratedBank, residuals_of
from gtmbench.detectors.bank.cautious_calibration import calibrate_cautiously
from gtmbench.detectors.bank.statistics import tolerance_of
from gtmbench.detectors.bank.tails import rate_bound
from gtmbench.detectors.bank.thresholds import Residual, thresholds_of
from gtmbench.detectors.bank.whitening import Whitener, fit_whitener
from gtmbench.errors import InputError
from gtmbench.method.identify import identify
from gtmbench.method.pseudo_inputs import derive
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import Record

_LITTLE_S = 300.0  # of healthy flight: with less, every sample counts
Progress = Callable[[str, int, int], None]


def calibrate_bank(
    records: Sequence[Record],
    bank: Bank,
    *,
    false_alarms_per_hour: float,
    provenance: Mapping[str, Any] | None = None,
    progress: Progress = lambda _step, _done, _of: None,
) -> CalibratedBank:
    """Identify a bank on healthy records and set its thresholds on others.

    With several records every third identifies and the rest set thresholds; one record is cut in two (the first 40 %
    identify). The rate asked for is shared evenly by all series of all residuals. Less than five minutes in all are
    calibrated on with caution, `calibrate_cautiously`.

    Parameters
    ----------
    records : sequence of Record
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
    found = tuple(records)
    rate = number("false_alarms_per_hour", false_alarms_per_hour, 1e-9, 1e3)
    for record in found:
        bank.check_channels(record.channels)
    if sum(map(len, found)) * found[0].sample_period_s < _LITTLE_S:
        return calibrate_cautiously(found, bank, false_alarms_per_hour=rate, provenance=provenance, progress=progress)
    learn, judge = _split(found)
    total = len(judge) + 2
    progress("identify", 0, total)
    operators, whiteners = _learn(bank, learn)
    test, period_s = bank.statistic, found[0].sample_period_s
    seen: dict[str, list[Residual]] = {spec.output: [] for spec in bank.residuals}
    for done, record in enumerate(judge, 1):
        progress("residuals", done, total)
        residuals = residuals_of(bank, record, operators)
        for output, raw in residuals.raw.items():
            seen[output].append((raw, whiteners[output].whiten(raw), None))
    progress("thresholds", total - 1, total)
    hours = sum(len(record) for record in judge) * period_s / 3600.0
    tolerances = {
        output: tolerance_of([white for _, white, _ in pairs], test, period_s) for output, pairs in seen.items()
    }
    found_thresholds, block_s = thresholds_of(test, seen, tolerances, period_s, rate)
    progress("done", total, total)
    return CalibratedBank(
        bank=bank,
        operators=operators,
        whiteners=whiteners,
        tolerances=tolerances,
        thresholds=found_thresholds,
        sample_period_s=period_s,
        provenance={
            **(provenance or {}),
            "records": len(found),
            "identification_hours": sum(len(record) for record in learn) * period_s / 3600.0,
            "threshold_hours": hours,
            "block_s": block_s,
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

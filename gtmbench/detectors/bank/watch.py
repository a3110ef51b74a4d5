"""Watching a record with a monitor: levels, alarms, findings, and virtual sensors for what failed."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank
from gtmbench.detectors.bank.diagnosis import diagnose
from gtmbench.detectors.bank.levels import Crossing, crossings, levels
from gtmbench.detectors.protocol import Score, came_down
from gtmbench.record import Record

_MOST_FINDINGS = 8


def scores_and_alarms(
    monitor: CalibratedBank, record: Record, residuals: BankResiduals
) -> tuple[dict[str, Score], tuple[Alarm, ...]]:
    """Watch a record: every alarm is diagnosed, then watching goes on with what can still be trusted.

    Raises
    ------
    InputError
        Where the record lacks a channel of the bank or has another sample period.
    """
    level = levels(monitor, record, residuals)
    findings: list[Alarm] = []
    watched, seen, row = residuals, level, 0
    while len(findings) < _MOST_FINDINGS and seen:
        found = crossings(seen, from_row=row)
        if not found:
            break
        finding = diagnose(monitor, record, watched, found[0])
        findings.append(finding)
        watched, row = _go_on(monitor, record, watched, found[0], finding)
        seen = levels(monitor, record, watched) if watched.raw else {}
    given_up: dict[str, float] = {}
    for finding in findings:
        if _lasts(finding):
            for output in _disturbed(monitor.bank, finding):
                given_up.setdefault(output, finding.time_s)
    scores = {}
    for output, of in level.items():
        until_s = given_up.get(output)
        armed = came_down(of.values, 1.0) & (of.known_s <= (np.inf if until_s is None else until_s))
        scores[output] = Score(
            name=output,
            values=of.values,
            known_s=of.known_s,
            channels=tuple(name for name in monitor.bank.channels if output in monitor.bank.disturbs(name)),
            armed=armed,
            disarmed_s=until_s,
        )
    return scores, tuple(replace(finding, number=i, fault=i) for i, finding in enumerate(findings))


def _go_on(
    monitor: CalibratedBank, record: Record, residuals: BankResiduals, crossing: Crossing, finding: Alarm
) -> tuple[BankResiduals, int]:
    """Return the residuals to watch after a finding, and from which row on.

    A passing alarm is over at its last judgement. An ended fault's rows, until its end was known, are passed over, as
    if missing. A lasting one takes the residuals that the sensor (or any candidate) enters out of the watch.
    """
    disturbed = _disturbed(monitor.bank, finding)
    if _lasts(finding):
        return _without(residuals, disturbed), crossing.row
    until_s = finding.last.time_s if finding.end_known_s is None else finding.end_known_s
    last = min(round((until_s - record.start_s) / record.sample_period_s) + 1, len(record))
    return _missing(monitor, residuals, disturbed, slice(crossing.onset_row, last)), crossing.row


def _lasts(finding: Alarm) -> bool:
    return bool(finding.last.candidates) and finding.end_known_s is None


def _disturbed(bank: Bank, finding: Alarm) -> set[str]:
    """Return the residuals that the candidates enter; without any, the one that alarmed.

    Where the attitude follows from the gyros, a fault of one enters them all.
    """
    if bank.attitude_from_gyros and finding.last.candidates:
        return {spec.output for spec in bank.residuals}
    return {output for name in finding.last.candidates for output in bank.disturbs(name)} or {finding.source}


def _without(residuals: BankResiduals, outputs: set[str]) -> BankResiduals:
    return replace(
        residuals,
        raw={name: values for name, values in residuals.raw.items() if name not in outputs},
        predicted={name: values for name, values in residuals.predicted.items() if name not in outputs},
    )


def _missing(monitor: CalibratedBank, residuals: BankResiduals, outputs: set[str], rows: slice) -> BankResiduals:
    """Return the residuals with rows blotted out, and those around that saw them."""
    raw = dict(residuals.raw)
    for name in outputs & raw.keys():
        values = np.array(raw[name])
        reach = round(monitor.history_of(name) / monitor.sample_period_s)
        values[max(rows.start - reach, 0) : rows.stop + reach] = np.nan
        raw[name] = values
    return replace(residuals, raw=raw)

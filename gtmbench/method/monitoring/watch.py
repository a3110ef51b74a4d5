"""Watching a record with a monitor: levels, alarms, findings, and virtual sensors for what failed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from gtmbench.method.monitoring.bank import Bank
from gtmbench.method.monitoring.diagnosis import diagnose
from gtmbench.method.monitoring.findings import Finding
from gtmbench.method.monitoring.levels import Crossing, Level, crossings, levels
from gtmbench.method.monitoring.monitor import BankResiduals, Monitor, bank_residuals
from gtmbench.method.monitoring.virtual import integrable, integrated_angle
from gtmbench.record import FloatArray, Record

_MOST_FINDINGS = 8


@dataclass(frozen=True, kw_only=True, eq=False)
class Watch:
    """What a monitor saw on a record.

    Attributes
    ----------
    monitor : Monitor
    record : Record
    residuals : BankResiduals
        Raw residuals and predictions, row for row beside the record.
    levels : mapping of output to Level
        Each residual's greatest statistic over its threshold; an alarm above 1.
    findings : tuple of Finding
        In time. After a fault that lasts, the residuals that the failed sensor enters are no longer watched.
    """

    monitor: Monitor
    record: Record = field(repr=False)
    residuals: BankResiduals = field(repr=False)
    levels: Mapping[str, Level] = field(repr=False)
    findings: tuple[Finding, ...]

    @property
    def alarm_s(self) -> float | None:
        """When the first alarm could be raised."""
        return self.findings[0].alarm_s if self.findings else None

    @property
    def given_up(self) -> dict[str, float]:
        """Residuals (by output) no longer watched, for they tell of a lasting fault, and since when, in seconds."""
        bank, found = self.monitor.bank, dict[str, float]()
        for finding in self.findings:
            if _lasts(finding):
                for output in _disturbed(bank, finding):
                    found.setdefault(output, finding.alarm_s)
        return found

    @property
    def armed(self) -> dict[str, NDArray[np.bool_]]:
        """Where each residual (by output) could alarm, shape (samples,): its level existed, it hadn't been given up."""
        given_up = self.given_up
        return {
            output: np.isfinite(level.values) & (level.known_s <= given_up.get(output, np.inf))
            for output, level in self.levels.items()
        }

    @property
    def armed_hours(self) -> float:
        """How long an alarm was possible, of any residual."""
        possible = np.logical_or.reduce(list(self.armed.values()))
        return float(np.count_nonzero(possible)) * self.record.sample_period_s / 3600.0

    def virtual(self, sensor: str) -> FloatArray:
        """Return what a sensor should have read, shape (samples,), to be used in place of one that failed.

        A gyro's is its residual's prediction. An attitude angle's is carried on by the gyros from the onset of its
        finding (the first row, without one), and drifts with them.
        """
        if sensor in self.residuals.predicted:
            return self.residuals.predicted[sensor]
        onset_s = min((one.onset_s for one in self.findings if one.sensor == sensor), default=self.record.start_s)
        if integrable(sensor, self.monitor.bank.channels):
            row = round((onset_s - self.record.start_s) / self.record.sample_period_s)
            return integrated_angle(self.record, sensor, row)
        return np.full(len(self.record), np.nan)


def watch(monitor: Monitor, record: Record) -> Watch:
    """Watch a record: every alarm is diagnosed, then watching goes on with what can still be trusted.

    Raises
    ------
    InputError
        Where the record lacks a channel of the bank or has another sample period.
    """
    residuals = bank_residuals(monitor, record)
    level = levels(monitor, record, residuals)
    findings: list[Finding] = []
    watched, seen, row = residuals, level, 0
    while len(findings) < _MOST_FINDINGS and seen:
        found = crossings(seen, from_row=row)
        if not found:
            break
        finding = diagnose(monitor, record, watched, found[0])
        findings.append(finding)
        watched, row = _go_on(monitor, record, watched, found[0], finding)
        seen = levels(monitor, record, watched) if watched.raw else {}
    return Watch(monitor=monitor, record=record, residuals=residuals, levels=level, findings=tuple(findings))


def _go_on(
    monitor: Monitor, record: Record, residuals: BankResiduals, crossing: Crossing, finding: Finding
) -> tuple[BankResiduals, int]:
    """Return the residuals to watch after a finding, and from which row on.

    A passing alarm is over at its last judgement. An ended fault's rows, until its end was known, are passed over, as
    if missing. A lasting one takes the residuals that the sensor (or any candidate) enters out of the watch.
    """
    disturbed = _disturbed(monitor.bank, finding)
    if _lasts(finding):
        return _without(residuals, disturbed), crossing.row
    until_s = finding.last.time_s if finding.resumed_s is None else finding.resumed_s
    last = min(round((until_s - record.start_s) / record.sample_period_s) + 1, len(record))
    return _missing(monitor, residuals, disturbed, slice(crossing.onset_row, last)), crossing.row


def _lasts(finding: Finding) -> bool:
    return bool(finding.last.candidates) and finding.resumed_s is None


def _disturbed(bank: Bank, finding: Finding) -> set[str]:
    """Return the residuals that the candidates enter; without any, the one that alarmed.

    Where the attitude follows from the gyros, a fault of one enters them all.
    """
    if bank.attitude_from_gyros and finding.last.candidates:
        return {spec.output for spec in bank.residuals}
    return {output for name in finding.last.candidates for output in bank.disturbs(name)} or {finding.residual}


def _without(residuals: BankResiduals, outputs: set[str]) -> BankResiduals:
    return replace(
        residuals,
        raw={name: values for name, values in residuals.raw.items() if name not in outputs},
        predicted={name: values for name, values in residuals.predicted.items() if name not in outputs},
    )


def _missing(monitor: Monitor, residuals: BankResiduals, outputs: set[str], rows: slice) -> BankResiduals:
    """Return the residuals with rows blotted out, and those around that saw them."""
    raw = dict(residuals.raw)
    for name in outputs & raw.keys():
        values = np.array(raw[name])
        reach = round(monitor.history_s(name) / monitor.sample_period_s)
        values[max(rows.start - reach, 0) : rows.stop + reach] = np.nan
        raw[name] = values
    return replace(residuals, raw=raw)

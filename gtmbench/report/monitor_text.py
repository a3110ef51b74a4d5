"""A monitored study as rows of text: the table at the end of a run, and what stands beside it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from itertools import groupby

from gtmbench.bench.faults import FAULTS
from gtmbench.channels import unit_of
from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.bank.detector import BankMonitor
from gtmbench.detectors.bank.tails import rate_bound
from gtmbench.report.text import per_second, severity_text
from gtmbench.study.monitored import MonitoredStudy, MonitoredTrial


def estimate_text(kind: str, parameters: Mapping[str, float], errors: Mapping[str, float], unit: str) -> str:
    """Write the parameters of a kind of fault with their standard errors; times are left out.

    >>> estimate_text("drift", {"slope": 0.04991, "onset_s": 299.9}, {"slope": 0.00012}, "deg/s")
    '0.0499 ± 0.0001 deg/s²'
    """
    slopes = {item.name for item in FAULTS[kind].parameters() if item.per_second} if kind in FAULTS else set()
    parts = []
    for name, value in parameters.items():
        if not name.endswith("_s"):
            of = per_second(unit) if name in slopes else unit
            parts.append(f"{with_error(value, errors.get(name, math.nan))} {of}".rstrip())
    return ", ".join(parts)


def with_error(value: float, error: float) -> str:
    """Write a value to the first digit of its error; without an error, or with next to none, to three digits.

    >>> with_error(4.4786, 0.0297), with_error(123.4, 20.0), with_error(-9.4325, 2e-17)
    ('4.48 ± 0.03', '123 ± 20', '-9.43')
    """
    if not (math.isfinite(error) and error > 1e-6 * abs(value)):
        return f"{value:.3g}"
    digits = min(max(-math.floor(math.log10(error)), 0), 9)
    return f"{value:.{digits}f} ± {error:.{digits}f}"


def judgement_text(judged: Judgement) -> str:
    """Say what a judgement says: who, and what kind of fault with which parameters."""
    if judged.sensor is not None:
        who = f"{judged.sensor} failed"
    else:
        who = f"undecided: {' or '.join(judged.candidates)}" if judged.candidates else "nothing is left to explain"
    if judged.kind is None:
        return who
    likeliest = judged.candidates[0] if judged.candidates else ""
    estimate = estimate_text(judged.kind, judged.parameters, judged.errors, unit_of(likeliest))
    return f"{who}; {judged.kind.replace('_', ' ')}" + (f" {estimate}" if estimate else "")


def monitored_rows(study: MonitoredStudy) -> tuple[list[str], list[list[str]], list[str]]:
    """Return the columns of the table of trials, its rows, and which columns are numbers."""
    numbers = ["severity", "delay (s)", "isolated after (s)"]
    columns = ["scenario", "fault", "channel", "severity", "delay (s)", "isolated after (s)", "verdict", "kind"]
    rows = [_row(trial) for trial in study.trials]
    if all(trial.scenario == trial.fault for trial in study.trials):  # the package's own: once is enough
        return columns[1:], [row[1:] for row in rows], numbers
    return columns, rows, numbers


def _row(trial: MonitoredTrial) -> list[str]:
    return [
        trial.scenario,
        trial.fault,
        trial.channel,
        severity_text(trial),
        "-" if trial.detection_delay_s is None else f"{trial.detection_delay_s:.2f}",
        "-" if trial.isolation_delay_s is None else f"{trial.isolation_delay_s:.2f}",
        _verdict(trial),
        _kind(trial),
    ]


def _verdict(trial: MonitoredTrial) -> str:
    verdict = trial.verdict if trial.detected else f"missed: {trial.reason}"
    if trial.sensor is not None and not trial.isolated:
        verdict += " (wrong)"
    if trial.ended_s is not None:
        verdict += f", ended at {trial.ended_s:.2f} s"
    return f"{verdict}; {trial.false_alarms} false alarms before the onset" if trial.false_alarms else verdict


def _kind(trial: MonitoredTrial) -> str:
    if trial.kind is None:
        return "-"
    values = {one.name: one.value for one in trial.parameters}
    errors = {one.name: one.error for one in trial.parameters}
    likeliest = trial.candidates[0] if trial.candidates else trial.channel
    estimate = estimate_text(trial.kind, values, errors, unit_of(likeliest))
    return f"{trial.kind.replace('_', ' ')} {estimate}".rstrip() + ("" if trial.kind_right else " (wrong)")


def summary_lines(study: MonitoredStudy) -> list[str]:
    """Say how many were found, named and told in kind, what alarmed without a fault, and by what it was watched."""
    trials, baseline = study.trials, study.baseline
    of = len(trials)
    bound = rate_bound(baseline.false_alarms, baseline.healthy_hours)
    limit = "" if bound is None else f" (at most {bound:.1f} an hour at 95 % confidence)"
    return [
        f"detected: {sum(trial.detected for trial in trials)} of {of}; the right sensor named: "
        f"{sum(trial.isolated for trial in trials)}; the right kind of fault 20 s after the alarm: "
        f"{sum(trial.kind_right_20s for trial in trials)}, at the end: {sum(trial.kind_right for trial in trials)}",
        f"false alarms: {baseline.false_alarms}; healthy flight watched: {baseline.healthy_hours:.2f} h{limit}",
        monitor_line(baseline.monitor),
    ]


def monitor_line(monitor: BankMonitor) -> str:
    """Say in a line what a monitor is."""
    ahead = sorted((monitor.look_ahead_of(spec.output), spec.output) for spec in monitor.bank.residuals)
    looks = ", ".join(
        f"{'/'.join(output for _, output in group)} {look_s:g} s"
        for look_s, group in groupby(ahead, lambda one: one[0])
    )
    thresholds = sum(len(of) for of in monitor.thresholds.values())
    hours = monitor.provenance.get("threshold_hours")
    stand = f", set on {hours:.2f} h of healthy flight" if isinstance(hours, float) else ""
    count = "1 threshold" if thresholds == 1 else f"{thresholds} thresholds"
    return f"monitor: bank {monitor.bank.name}; {count}{stand}; delays count look-ahead ({looks})"

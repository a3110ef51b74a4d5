"""A study as rows of text: the table at the end of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from gtmbench.bench.fault import Fault
from gtmbench.channels import unit_of
from gtmbench.study.trial import Injection, Study, Trial


def severity_text(trial: Injection) -> str:
    """Write a trial's severity with its unit: ``0.05 deg/s²``; empty for a fault without one."""
    return _severities(trial.injected)


def fault_text(fault: Fault) -> str:
    """Name a fault with its channel and its severity.

    >>> from gtmbench.bench.faults import Drift, Jam
    >>> fault_text(Drift(channel="p", onset_s=300, slope=0.05)), fault_text(Jam(channel="q", onset_s=300))
    ('drift of p, 0.05 deg/s²', 'jam of q')
    """
    what = f"{fault.kind.replace('_', ' ')} of {fault.channel}"
    return ", ".join(part for part in (what, _severities(fault)) if part)


def _severities(fault: Fault) -> str:
    unit, values = unit_of(fault.channel), fault.severities
    of = {item.name: per_second(unit) if item.per_second else unit for item in fault.parameters()}
    return ", ".join(f"{value:.3g} {of[name]}" for name, value in values.items())


def per_second(unit: str) -> str:
    """Write a unit per second.

    >>> per_second("deg/s"), per_second("g")
    ('deg/s²', 'g/s')
    """
    return "deg/s²" if unit == "deg/s" else f"{unit}/s"


def with_unit(what: str, unit: str) -> str:
    """Write a unit behind what it is of, where there is one.

    >>> with_unit("p", "deg/s"), with_unit("strain_3", "")
    ('p (deg/s)', 'strain_3')
    """
    return f"{what} ({unit})" if unit else what


def trial_label(trial: Injection) -> str:
    """Name a trial among those of its scenario: ``q, 0.05 deg/s²``."""
    severity = severity_text(trial)
    return f"{trial.channel}, {severity}" if severity else trial.channel


def repetitions(trials: Sequence[Injection]) -> list[int]:
    """Return for every trial how many before it broke the same channel in the same scenario, otherwise."""
    seen = Counter[tuple[str, str]]()
    counts = []
    for trial in trials:
        counts.append(seen[trial.scenario, trial.channel])
        seen[trial.scenario, trial.channel] += 1
    return counts


def trial_rows(study: Study) -> tuple[list[str], list[list[str]], list[str]]:
    """Return the columns of the table of trials, its rows, and which columns are numbers."""
    numbers = ["severity", "alarm (s)", "delay (s)", "peak ratio", "altered"]
    columns = ["scenario", "fault", "channel", *numbers, "verdict"]
    rows = [_row(trial) for trial in study.trials]
    if all(trial.scenario == trial.fault for trial in study.trials):  # the package's own: once is enough
        return columns[1:], [row[1:] for row in rows], numbers
    return columns, rows, numbers


def _row(trial: Trial) -> list[str]:
    alarm = "-" if trial.alarm_time_s is None else f"{trial.alarm_time_s:.2f}"
    delay = "-" if trial.detection_delay_s is None else f"{trial.detection_delay_s:.2f}"
    return [
        trial.scenario,
        trial.fault,
        trial.channel,
        severity_text(trial),
        alarm,
        delay,
        f"{trial.peak_ratio:.2f}",
        f"{100.0 * trial.altered_share:.1f} %",
        _verdict(trial),
    ]


def _verdict(trial: Trial) -> str:
    verdict = "detected" if trial.detected else f"missed: {trial.reason}"
    return f"{verdict}; {trial.false_alarms} false alarms before the onset" if trial.false_alarms else verdict

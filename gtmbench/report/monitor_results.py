"""Results of a monitored study as plain data: ``results.json`` and ``trials.csv``."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

from gtmbench.detectors.bank.detector import BankMonitor
from gtmbench.detectors.bank.tails import rate_bound
from gtmbench.report.results import SCHEMA, named, versions, write_tables
from gtmbench.study.monitored import MonitoredStudy


def monitored_results(study: MonitoredStudy) -> dict[str, Any]:
    """Return a monitored study as one JSON-ready object, schema 1; units stand in the names."""
    baseline, trials = study.baseline, study.trials
    setup = asdict(baseline.setup)
    del setup["operator"]  # the monitor has its own
    setup["alarm"] = {key: setup["alarm"][key] for key in ("watch_from_s", "healthy_records")}
    found = {
        "schema": SCHEMA,
        "study": "monitored",
        "trim": asdict(baseline.trim),
        "monitor": monitor_summary(baseline.monitor),
        "trials": [trial.row() for trial in trials],
        "detected": sum(trial.detected for trial in trials),
        "isolated": sum(trial.isolated for trial in trials),
        "kind_right": sum(trial.kind_right for trial in trials),
        "kind_right_20s": sum(trial.kind_right_20s for trial in trials),
        "false_alarms": baseline.false_alarms,
        "healthy_hours": baseline.healthy_hours,
        "false_alarms_per_hour_at_most": rate_bound(baseline.false_alarms, baseline.healthy_hours),
        "setup": setup,
        "versions": versions(),
        "seed": baseline.setup.seed,
    }
    return dict(plain(found))


def monitor_summary(monitor: BankMonitor) -> dict[str, Any]:
    """Say what a monitor is: its bank, its residuals with what they look back on and ahead, where it comes from."""
    return {
        "bank": monitor.bank.name,
        "title": monitor.bank.title,
        "statistic": monitor.bank.statistic.name,
        "suspects": list(monitor.bank.suspects),
        "residuals": [
            {
                "output": spec.output,
                "inputs": list(spec.inputs),
                "look_ahead_s": monitor.look_ahead_of(spec.output),
                "history_s": monitor.history_of(spec.output),
            }
            for spec in monitor.bank.residuals
        ],
        "thresholds": sum(len(of) for of in monitor.thresholds.values()),
        "sample_period_s": monitor.sample_period_s,
        "provenance": dict(monitor.provenance),
    }


def write_monitored_results(study: MonitoredStudy, folder: Path) -> None:
    """Write ``results.json`` and ``trials.csv`` (one row a trial; severities and parameters as ``name=value``)."""
    found = monitored_results(study)
    write_tables(found, [_flat(row) for row in found["trials"]], folder)


def _flat(row: Mapping[str, Any]) -> dict[str, Any]:
    parameters = row["parameters"]
    own = {
        "severity": named(row["severity"]),
        "candidates": " ".join(row["candidates"]),
        "parameters": named({one["name"]: one["value"] for one in parameters}),
    }
    errors = {
        "parameter_errors": named({one["name"]: one["error"] for one in parameters}),
        "parameters_true": named({one["name"]: one["true"] for one in parameters}),
    }
    return {**row, **own, **errors}


def plain(value: Any) -> Any:
    """Return a value as JSON has it: what isn't a finite number becomes None, numpy's numbers Python's."""
    if isinstance(value, Mapping):
        return {str(key): plain(of) for key, of in value.items()}
    if isinstance(value, (list, tuple)):
        return [plain(of) for of in value]
    if hasattr(value, "item"):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value

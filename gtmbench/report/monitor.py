"""A monitor in words and figures: what it was calibrated on, what it lets pass, what its false-alarm rate is worth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from gtmbench.channels import unit_of
from gtmbench.detectors.bank.detector import BankMonitor
from gtmbench.detectors.bank.sizes import slowest_drift, tolerated_shift
from gtmbench.detectors.protocol import Monitor
from gtmbench.report.text import duration_text


def monitor_facts(monitor: Monitor) -> dict[str, Any]:
    """Return what any monitor is as one JSON-ready object: of a bank's more, `facts`."""
    if isinstance(monitor, BankMonitor):
        return facts(monitor)
    memory_s = monitor.memory_s
    return {
        "detector": monitor.name,
        "channels": list(monitor.channels),
        "suspects": list(monitor.suspects),
        "sample_period_s": monitor.sample_period_s,
        "look_ahead_s": monitor.look_ahead_s,
        "memory_s": _finite(memory_s),
        "provenance": dict(monitor.provenance),
    }


def facts(monitor: BankMonitor) -> dict[str, Any]:
    """Return a monitor's facts as one JSON-ready object; units stand in the names, or beside."""
    return {
        "bank": monitor.bank.name,
        "title": monitor.bank.title,
        "sample_period_s": monitor.sample_period_s,
        "residuals": {output: _residual(monitor, output) for output in monitor.operators},
        "provenance": dict(monitor.provenance),
    }


def _residual(monitor: BankMonitor, output: str) -> dict[str, Any]:
    operator, tolerance = monitor.operators[output], monitor.tolerances[output]
    return {
        "inputs": list(operator.inputs),
        "unit": unit_of(output),
        "rms_residual": float(operator.rms_residual[0]),
        "look_ahead_s": monitor.look_ahead_of(output),
        "tolerated_shift": _finite(tolerated_shift(monitor, output)),
        "tolerated_energy": [tolerance.low, tolerance.high],
        "slowest_drift_per_s": _finite(slowest_drift(monitor, output)),
    }


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None


def residual_rows(monitor: BankMonitor) -> tuple[list[str], list[list[str]], list[str]]:
    """Return a table of the residuals: its columns, rows, and the columns to align to the right."""
    columns = ["residual", "unit", "RMS", "ahead (s)", "shift", "energy", "drift per s", "predicted from"]
    rows = []
    for output in monitor.operators:
        found = _residual(monitor, output)
        rows.append(
            [
                output,
                found["unit"],
                f"{found['rms_residual']:.3g}",
                f"{found['look_ahead_s']:g}",
                _figure(found["tolerated_shift"]),
                "{:.2f}..{:.2f}".format(*found["tolerated_energy"]),
                _figure(found["slowest_drift_per_s"]),
                " ".join(found["inputs"]),
            ]
        )
    return columns, rows, columns[2:-1]


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:.2g}"


def facts_text(monitor: BankMonitor) -> list[str]:
    """Return what a monitor stands on, line by line; a line is left out where the monitor doesn't know."""
    return [
        "shift, energy: what the healthy residual's mean and mean square (1: noise) may do; drift: slower ones pass",
        *origin_text(monitor),
    ]


def origin_text(monitor: BankMonitor) -> list[str]:
    """Return what a monitor was calibrated on, and what its false-alarm rate is worth, as far as it knows."""
    known = monitor.provenance
    lines = [f"calibrated on: {_origin(known)}"]
    if "tolerated_imperfections" in known:
        lines.append(f"imperfections of healthy gyros: {known['tolerated_imperfections']}")
    hours: list[Any] = [known.get(key) for key in ("identification_hours", "threshold_hours")]
    if all(_is_number(value) for value in hours):
        lines.append(f"identified on {duration_text(hours[0])}, {_thresholds_from(monitor, hours[1])}")
    wanted, bound = known.get("false_alarms_per_hour"), known.get("false_alarms_per_hour_at_most")
    if _is_number(wanted) and _is_number(bound) and _is_number(hours[1]):
        seen = duration_text(hours[1])
        lines.append(
            f"false alarms: no more than {bound:.2g} an hour at 95 % from {seen} seen, those that set "
            f"the thresholds; {wanted:g} an hour is extrapolated from the tails"
        )
    return lines


def _thresholds_from(monitor: BankMonitor, hours: Any) -> str:
    if monitor.doubts:
        return "thresholds from the same, each stretch judged by operators that hadn't seen it"
    return f"thresholds from {duration_text(hours)} of other records"


def _is_number(value: Any) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool)


def _origin(known: Mapping[str, Any]) -> str:
    """Say where the records come from; a file may hold anything there."""
    count, source = known.get("records", "?"), known.get("source")
    seeds, logs = known.get("seeds"), known.get("logs")
    if source == "flights" and isinstance(seeds, list) and len(seeds) == 2 and _is_number(known.get("duration_s")):
        return (
            f"{count} flights of {known.get('aircraft')}, {known['duration_s']:g} s each, {known.get('excitation')}, "
            f"noise {known.get('noise')}, seeds {seeds[0]} to {seeds[1]}"
        )
    if source == "logs" and isinstance(logs, list) and all(isinstance(log, dict) for log in logs):
        more = f" and {len(logs) - 5} more" if len(logs) > 5 else ""
        return f"{', '.join(str(log.get('name')) for log in logs[:5])}{more}"
    return f"{count} records"

"""A watched log as plain data."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from gtmbench.channels import unit_of
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.protocol import Watch
from gtmbench.intake.flight_log import FlightLog
from gtmbench.report.log_faults import began_s, given_up_by
from gtmbench.report.log_spans import stretches
from gtmbench.report.log_text import alarm_bound, deviation, outcome_text, passed_alarms, rms
from gtmbench.report.monitor import facts
from gtmbench.report.monitor_results import plain
from gtmbench.report.results import SCHEMA, versions
from gtmbench.study.watched_log import WatchedLog


def log_results(watched: WatchedLog) -> dict[str, Any]:
    """Return a watched log as one JSON-ready object, schema 1; units stand in the names, or beside.

    Times are the log's. `stretches` covers the log from its first sample to its last and says of every stretch whether
    it was watched, or why not; `residuals` has a row for every residual on every record that the monitor was given.
    """
    monitor = watched.monitor
    found = {
        "schema": SCHEMA,
        "study": "log",
        "outcome": watched.outcome.name.lower(),
        "exit_code": int(watched.outcome),
        "verdict": outcome_text(watched),
        "reasons": watched.reasons,
        "findings": [_finding(finding, seen) for seen in watched.watches for finding in seen.findings],
        "watched_hours": watched.armed_hours,
        "alarms_unexplained": passed_alarms(watched),
        "false_alarms_per_hour_at_most": alarm_bound(watched),
        "log": _log(watched.log),
        "monitor": facts(monitor) | {"suspects": monitor.bank.suspects},
        "identified_s": watched.identified_s,
        "stretches": [vars(one) for one in stretches(watched)],
        "residuals": [_residual(seen, output) for seen in watched.watches for output in seen.levels],
        "versions": versions(),
    }
    return dict(plain(found))


def _log(log: FlightLog) -> Mapping[str, Any]:
    return {
        "path": str(log.path),
        "channels": [{"name": name, "unit": unit_of(name)} for name in log.channels],
        "sample_period_s": log.sample_period_s,
        "segments_s": [(segment.start_s, segment.end_s) for segment in log.segments],
        "method": log.method,
        "remarks": [asdict(remark) for remark in log.remarks],
    }


def _finding(finding: Finding, seen: Watch) -> Mapping[str, Any]:
    return {
        "verdict": finding.verdict,
        "alarm_s": finding.alarm_s,
        "began_s": began_s(finding),
        "isolated_s": finding.isolated_s,
        "ended_s": finding.ended_s,
        "end_known_s": finding.resumed_s,
        "residual": finding.residual,
        "test": finding.series,
        "no_longer_watched": given_up_by(finding, seen),
        **_judgement(finding.last),
        "judgements": [_judgement(judged) for judged in finding.judgements],
    }


def _judgement(judged: Judgement) -> Mapping[str, Any]:
    """Return a judgement; parameters and errors are in `unit`, slopes per second, times in seconds."""
    return vars(judged) | {"unit": unit_of(judged.candidates[0]) if judged.candidates else ""}


def _residual(seen: Watch, output: str) -> Mapping[str, Any]:
    level = seen.levels[output]
    seen_any = bool(np.isfinite(level.values).any())
    peak = int(np.nanargmax(level.values)) if seen_any else 0
    return {
        "start_s": seen.record.start_s,
        "end_s": seen.record.end_s,
        "residual": output,
        "unit": unit_of(output),
        "watched_hours": np.count_nonzero(seen.armed[output]) * seen.record.sample_period_s / 3600.0,
        "rms_identified": seen.monitor.operators[output].rms_residual[0],
        "rms": rms([seen.residuals.raw[output]]),
        "rms_signal": deviation([seen.record[output]]),
        "peak_level": level.values[peak] if seen_any else None,
        "peak_level_s": level.known_s[peak] if seen_any else None,
    }

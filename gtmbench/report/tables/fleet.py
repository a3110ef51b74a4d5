"""A fleet of logs as a table: what is kept of each, and which is worst."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from gtmbench.faults.kinds.additive import Bias
from gtmbench.files.plain import Column, Row, plain
from gtmbench.jobs.parts import Parts
from gtmbench.report.log_findings import alarm_bound, passed_alarms
from gtmbench.report.tables.envelope import envelope
from gtmbench.report.words.certificate import certificate_text
from gtmbench.report.words.fleet import counts_text, words_text
from gtmbench.report.words.verdict import verdict_text
from gtmbench.study.log.autopilot_messages import of_sensors, words_of
from gtmbench.study.log.gyros import gyro_figures
from gtmbench.study.log.watched import WatchedLog
from gtmbench.values.channels import GYROS
from gtmbench.verdict.verdict import Outcome

ERROR = "error"
NONE_WATCHED = 2  # an exit code
_OUTCOMES = (*(outcome.name.lower() for outcome in (Outcome.FAILED, Outcome.UNKNOWN)), ERROR, "healthy")  # worst first
_OF_GYROS: Mapping[str, str] = {
    "residual_rms_deg_s": "the gyro's residual, root mean square, where an alarm was possible",
    "bias_deg_s": "by how much the gyro reads more than the attitude turns",
    "noise_deg_s": "of the gyro from sample to sample, vibration included",
    "bias_seen_deg_s": "from which bias of the gyro on one would have been detected; null: none would",
}
COLUMNS: Mapping[str, Column] = {
    "task": Column("int32", "of the fleet; a task is a log, in the order in which they were given"),
    "log": Column("string", "its file"),
    "outcome": Column("string", "failed, unknown (can't tell), error (couldn't be watched), healthy"),
    "verdict": Column("string", "in words: the first line that `gtmbench monitor` prints"),
    "judged_share": Column("double", "of the time in motion in which the asked sensor is judged that is judged least"),
    "failed_sensors": Column("string", "that failed, with commas between; empty where none did"),
    "suspected_sensors": Column("string", "of which one failed, or that may have, with commas between"),
    "certificate": Column("string", "what would have been detected, in words"),
    "start_s": Column("double", "of the log, on its own clock"),
    "end_s": Column("double", "of the log"),
    "rate_hz": Column("double", "of its samples as they were watched"),
    "monitor": Column("string", "that watched"),
    "watched_hours": Column("double", "how long an alarm was possible"),
    "alarms": Column("int32", "that something is left to explain"),
    "doubtful_alarms": Column("int32", "of these, that may be motion or model"),
    "first_alarm_s": Column("double", "when the first of these was raised"),
    "alarms_unexplained": Column("int32", "that nothing explains: false ones"),
    "false_alarms_per_hour_at_most": Column("double", "that this length shows, at 95 %"),
    "autopilot": Column("string", "its first word of a gyro or accelerometer; null of logs that tell no events"),
    "autopilot_words": Column("int32", "how many words on gyros and accelerometers"),
    **{f"{gyro}_{name}": Column("double", meaning) for gyro in GYROS for name, meaning in _OF_GYROS.items()},
    "error": Column("string", "why the log couldn't be watched; the row says nothing else then"),
}


def fleet_row(watched: WatchedLog) -> Row:
    """Return what is kept of a watched log."""
    verdict = watched.verdict
    left = [alarm for alarm in watched.alarms if not alarm.has_passed]
    words = of_sensors(words_of(watched.log.events))
    segments = watched.log.segments
    row = {
        "outcome": verdict.outcome.name.lower(),
        "verdict": verdict_text(watched),
        "judged_share": verdict.judged_share(*verdict.scope.sensors),
        "failed_sensors": ", ".join(dict.fromkeys(sensor for sensor, _ in verdict.failed)),
        "suspected_sensors": ", ".join(dict.fromkeys(sensor for sensor, _ in verdict.suspected)),
        "certificate": certificate_text(watched.certificate),
        "start_s": segments[0].start_s,
        "end_s": segments[-1].end_s,
        "rate_hz": 1.0 / watched.log.sample_period_s,
        "monitor": watched.monitor.name,
        "watched_hours": watched.armed_hours,
        "alarms": len(left),
        "doubtful_alarms": sum(bool(alarm.doubt) for alarm in left),
        "first_alarm_s": left[0].time_s if left else None,
        "alarms_unexplained": passed_alarms(watched),
        "false_alarms_per_hour_at_most": alarm_bound(watched),
        "autopilot": words_text(words) if watched.log.events else None,
        "autopilot_words": len(words) if watched.log.events else None,
    }
    for gyro in gyro_figures(watched):
        seen = watched.certificate.of(gyro.name, Bias.kind)
        row |= {
            f"{gyro.name}_residual_rms_deg_s": gyro.residual_rms,
            f"{gyro.name}_bias_deg_s": gyro.bias,
            f"{gyro.name}_noise_deg_s": gyro.noise,
            f"{gyro.name}_bias_seen_deg_s": None if seen is None else seen.size,
        }
    return dict(plain(row))


def worst_first(rows: Iterable[Row]) -> list[Row]:
    """Return rows in the order in which one looks at them.

    What failed, by how many alarms none doubts; what can't be told, with alarms before without; what couldn't be
    watched; and of the healthy ones first those of which silence says least.

    >>> rows = [{"outcome": "healthy", "alarms": 0}, {"outcome": "error"}, {"outcome": "failed", "alarms": 2}]
    >>> [row["outcome"] for row in worst_first(rows)]
    ['failed', 'error', 'healthy']
    """

    def key(row: Row) -> tuple[float, ...]:
        alarms, doubtful = (row.get(name) or 0 for name in ("alarms", "doubtful_alarms"))
        seen = [row.get(f"{gyro}_bias_seen_deg_s") for gyro in GYROS]
        blind = max(math.inf if size is None else size for size in seen)
        return _OUTCOMES.index(row["outcome"]), doubtful - alarms, -alarms, -blind

    return sorted(rows, key=key)


def exit_code(rows: Iterable[Row]) -> int:
    """Return 1 where any log failed, 2 where none could be watched, 3 where some can't be told, else 0.

    A log that couldn't be watched is one that can't be told.

    >>> exit_code([{"outcome": "healthy"}, {"outcome": "error"}]), exit_code([{"outcome": "error"}])
    (3, 2)
    """
    outcomes = {row["outcome"] for row in rows}
    if "failed" in outcomes:
        return int(Outcome.FAILED)
    if outcomes == {ERROR}:
        return NONE_WATCHED
    return int(Outcome.HEALTHY if outcomes == {"healthy"} else Outcome.UNKNOWN)


def fleet_results(parts: Parts) -> dict[str, Any]:
    """Return a fleet as one JSON-ready object; `logs` has a row a log, worst first, None for what isn't."""
    rows = worst_first(parts.read().to_pylist())
    own = {
        "counts": {outcome: sum(row["outcome"] == outcome for row in rows) for outcome in _OUTCOMES},
        "logs": rows,
        "versions": parts.facts["versions"],
    }
    told = [
        {"text": f"{row['log']}: {row['verdict'] or row['error']}", "log": row["log"], "outcome": row["outcome"]}
        for row in rows
        if row["outcome"] != "healthy"
    ]
    verdict = f"{counts_text(row['outcome'] for row in rows)}."
    return envelope("monitor-fleet", verdict, own, exit_code=exit_code(rows), findings=told)

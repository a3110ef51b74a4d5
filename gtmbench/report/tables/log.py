"""A watched log as plain data: its timeline, what was found, its airframe's history."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.protocol import Watch
from gtmbench.engine.finding import Finding
from gtmbench.files.plain import attributes, envelope
from gtmbench.history.standing import Standing
from gtmbench.intake.contents import LogContents
from gtmbench.intake.estimator_words import EstimatorWord
from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.judging.certificate import SHARE
from gtmbench.log.judging.claims import began_s
from gtmbench.log.truth.autopilot_messages import beside, words_of
from gtmbench.log.truth.score import Scored, ScoredLog
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.log_findings import alarm_bound, disarmed_by, passed_alarms
from gtmbench.report.style import level
from gtmbench.report.tables.results import versions
from gtmbench.report.words.found import unit_text
from gtmbench.report.words.judgement import parameter_units
from gtmbench.report.words.listing import contents_verdict
from gtmbench.report.words.monitor import facts, rms_identified
from gtmbench.report.words.others import alarm_table, score_verdict, sensor_table
from gtmbench.report.words.units import stamp_text
from gtmbench.report.words.verdict import verdict_text
from gtmbench.values.channels import unit_of
from gtmbench.values.pieces import deviation, rms
from gtmbench.verdict.timeline import SensorSpan
from gtmbench.verdict.verdict import LogVerdict


def log_results(watched: WatchedLog) -> dict[str, Any]:
    """Return a watched log as one JSON-ready object; units stand in the names, or beside.

    Times are the log's. `timeline` covers the log from its first sample to its last and holds the state of every
    sensor. `findings` has a row for every alarm that first told of a fault; `residuals` one for every score, or
    residual, on every record that the monitor was given.
    """
    own = {
        "outcome": watched.verdict.outcome.name.lower(),
        "timeline": timeline_table(watched.verdict, watched.log.zero_stamp),
        "reasons": watched.reasons,
        "history": None if watched.beside is None else _history(watched.beside),
        "next_motions": [
            {"motion": each.motion.text, "duration_s": each.motion.duration_s, "sizes": dict(each.sizes)}
            for each in watched.next_motions
        ],
        "explained": [_explained(each) for part in (watched.judged, watched.course) if part for each in part.found],
        "certificate": {
            "share_of_time": SHARE,
            **attributes(watched.certificate, "watched_s", "missing", "unwatched", "is_named"),
            "rows": [asdict(row) | {"unit": unit_text(row)} for row in watched.certificate.rows],
        },
        "watched_hours": watched.armed_hours,
        "alarms_unexplained": passed_alarms(watched),
        "false_alarms_per_hour_at_most": alarm_bound(watched),
        "autopilot": _autopilot(watched),
        "imus": _imus(watched),
        "sensors": [sensor_table(each, watched.sensors) for each in watched.sensors],
        "gps": [alarm_table(alarm) for alarm in watched.gps],
        "estimator": [_estimator(each) for each in watched.estimator],
        "installation": None if watched.installation is None else watched.installation.table(),
        "attitude": watched.attitude,
        "log": _log(watched.log),
        "self_check": {  # two causes of one log are either-or
            **attributes(watched.check, "passed", "causes", "explained"),
            "stops": list(map(str, watched.check.stops)),
            "doubts": list(map(str, watched.check.doubts)),
            "notes": watched.check.notes,
        },
        "monitor": facts(watched.monitor),
        "identified_s": watched.identified_s,
        "left_out_of_identification": watched.left_out,
        "excursions": watched.excursions,
        "residuals": [
            _score(watch, name)
            for watch in watched.watches
            for name in dict.fromkeys([*watch.scores, *watch.residuals])
        ],
        "versions": versions(),
    }
    code, findings = watched.verdict.exit_code, _findings(watched)
    return envelope("monitor", verdict_text(watched), own, exit_code=code, findings=findings)


def _history(standing: Standing) -> dict[str, Any]:
    return {
        "airframe": standing.entry.airframe,
        "flights_before": standing.flights,
        "temperature_c": standing.entry.temperature_c,
        "text": standing.lines,
        "constants": [
            {
                "sensor": each.sensor,
                "constant": each.name,
                **attributes(each, "value", "deviation"),
                "expected": None if (told := standing.predictions.get(each.key)) is None else told.value,
                "chance": None if told is None else told.chance(each.value),
                "apart": each.key in standing.apart,
            }
            for each in standing.entry.constants
        ],
        "explanations": [
            {**attributes(each.explanation, "suspects", "kind"), "probability": each.probability}
            for each in standing.explained[:6]  # the others are hardly likely
        ],
    }


def _explained(finding: Finding) -> Mapping[str, Any]:
    """Return what the engine found; times are the log's."""
    return {
        "start_s": finding.onset_s,
        "end_s": finding.end_s,
        "onset_range_s": finding.onset_range_s,
        "kind": finding.best.kind,
        "suspects": finding.suspects,
        "names": finding.named,
        "doubt": finding.doubt,
        "evidence_nats": finding.evidence,
        "explanations": [
            {"suspect": suspect, "kind": kind, "probability": chance} for suspect, kind, chance in finding.chances
        ],
        "shown_by": [
            {"relation": relation, "channel": channel, "evidence_nats": nats}
            for relation, channel, nats in finding.shown_by
        ],
    }


def contents_results(contents: LogContents) -> dict[str, Any]:
    """Return what a log holds as one JSON-ready object."""
    own = {
        "log": contents.path.name,
        "format": contents.kind,
        **attributes(contents, "span_s", "notes", "no_time", "channels", "imus", "columns"),
        "versions": versions(),
    }
    return envelope("monitor-list", contents_verdict(contents), own)


def _log(log: FlightLog) -> Mapping[str, Any]:
    return {
        "path": str(log.path),
        "channels": [{"name": name, "unit": unit_of(name)} for name in log.channels],
        **attributes(log, "sample_period_s", "zero_stamp"),
        "zero_utc": None if log.zero_utc is None else f"{log.zero_utc}Z",
        "segments_s": [(segment.start_s, segment.end_s) for segment in log.segments],
        **attributes(log, "method", "remarks", "events", "injections", "imus"),
    }


def _autopilot(watched: WatchedLog) -> Mapping[str, Any]:
    """Return the autopilot's word, and beside each of our alarms the one that stands nearest."""
    words = words_of(watched.log.events)
    return {
        "words": words,
        "beside": [
            {
                "alarm_s": each.alarm.time_s,
                "verdict": each.alarm.verdict,
                "word_s": None if each.word is None else each.word.time_s,
                "word": None if each.word is None else each.word.text,
                "ahead_s": each.ahead_s,
            }
            for each in beside([alarm for alarm in watched.alarms if not alarm.has_passed], words)
        ],
    }


def _imus(watched: WatchedLog) -> Mapping[str, Any] | None:
    """Return which IMUs were compared, and how each is mounted; None where the log has one."""
    if not watched.further_imus:
        return None
    return {
        "imus": watched.compared_imus,
        "watched": watched.watched_imu or None,
        "turned_deg": {imu.name: imu.mounting.turned_deg for imu in watched.further_imus},
    }


def _estimator(word: EstimatorWord) -> Mapping[str, Any]:
    """Return what an estimator says of a gyro, in deg/s, or of a sensor, as a ratio that it rejects above 1."""
    of = {"quantity": word.quantity, "of": word.of, "columns": word.columns}
    return of | {"smallest": float(word.values.min()), "largest": float(word.values.max())}


def score_results(scores: ScoredLog) -> dict[str, Any]:
    """Return a log that was scored on its own truth as one JSON-ready object; times are the log's."""
    own = {
        "outcome": scores.watched.verdict.outcome.name.lower(),
        "timeline": timeline_table(scores.watched.verdict, scores.watched.log.zero_stamp),
        "log_verdict": verdict_text(scores.watched),
        "failures": [_scored(row) for row in scores.rows],
        "false_alarms": [{"alarm_s": alarm.time_s, "verdict": alarm.verdict} for alarm in scores.false_alarms],
        "false_words": scores.false_words,
        "watched_hours": scores.watched.armed_hours,
        "identified_s": scores.watched.identified_s,
        "log": _log(scores.watched.log),
        "monitor": facts(scores.watched.monitor),
        "versions": versions(),
    }
    code, findings = scores.watched.verdict.exit_code, _findings(scores.watched)
    return envelope("score", score_verdict(scores), own, exit_code=code, findings=findings)


def _scored(row: Scored) -> Mapping[str, Any]:
    return {
        "injection": row.injection,
        "not_scored": row.why_not,
        "found": row.alarm is not None,
        "alarm_s": None if row.alarm is None else row.alarm.time_s,
        "delay_s": row.delay_s,
        "said": row.said,
        "named_delay_s": row.named_delay_s,
        "verdict": "" if row.alarm is None else row.alarm.verdict,
        "others_named_wrong": [{"alarm_s": alarm.time_s, "verdict": alarm.verdict} for alarm in row.others],
        "autopilot_s": None if row.word is None else row.word.time_s,
        "autopilot_delay_s": row.word_delay_s,
        "autopilot": "" if row.word is None else row.word.text,
    }


def _findings(watched: WatchedLog) -> list[Mapping[str, Any]]:
    by = {id(alarm): watch for watch in watched.watches for alarm in watch.alarms}  # none where IMUs part
    return [_finding(alarm, by.get(id(alarm))) for alarm in (*watched.alarms, *watched.of_others)]


def _finding(alarm: Alarm, watch: Watch | None) -> Mapping[str, Any]:
    nothing = Judgement(time_s=alarm.time_s, sensor=None, candidates=())
    others = () if watch is None else watch.alarms
    return {
        "text": alarm.verdict,
        "alarm_s": alarm.time_s,
        "began_s": began_s(alarm),
        **attributes(alarm, "isolated_s", "ended_s", "ended_between_s", "end_known_s"),
        "residual": alarm.source,
        "test": alarm.test,
        "no_longer_watched": [] if watch is None else disarmed_by(alarm, watch),
        "further_alarms_s": [other.time_s for other in others if other.fault == alarm.number and other != alarm],
        **_judgement(alarm.last or nothing),
        "judgements": [_judgement(judged) for judged in alarm.judgements],
    }


def _judgement(judged: Judgement) -> Mapping[str, Any]:
    """Return a judgement; `unit` is the likeliest sensor's, `parameter_units` has that of every parameter."""
    unit = unit_of(judged.axis or judged.candidates[0]) if judged.candidates else ""
    units = parameter_units(judged.kind, judged.parameters, unit) if judged.kind else {}
    together = [_judgement(each) for each in judged.together]
    return vars(judged) | {"together": together, "unit": unit, "parameter_units": units}


def _score(watch: Watch, name: str) -> Mapping[str, Any]:
    """Return what a score came to, and the residual by the same name; None for what there isn't."""
    row = {"start_s": watch.record.start_s, "end_s": watch.record.end_s, "residual": name, "unit": unit_of(name)}
    raw, score = watch.residuals.get(name), watch.scores.get(name)
    is_output, hours = raw is not None and name in watch.record, watch.record.sample_period_s / 3600.0
    row |= {
        "watched_hours": None if score is None else np.count_nonzero(score.armed) * hours,
        "rms_identified": rms_identified(watch.monitor).get(name),
        "rms": None if raw is None else rms([raw]),
        "rms_signal": deviation([watch.record[name]]) if is_output else None,
    }
    if score is None or not score.exists.any():
        return row | {"peak_level": None, "peak_level_s": None}
    levels = level(score)
    peak = int(np.nanargmax(levels))
    return row | {"peak_level": levels[peak], "peak_level_s": score.known_s[peak]}


def timeline_table(verdict: LogVerdict, zero_stamp: str = "") -> Mapping[str, Any]:
    """Return the timeline of every sensor; `judged_s` is that of the asked sensor that is judged least."""
    timeline, scope = verdict.timeline, verdict.scope
    return {
        **attributes(timeline, "span_s", "motion_s", "motion_total_s"),
        "judged_s": verdict.judged_share(*scope.sensors) * timeline.motion_total_s,
        "asked": scope.sensors,
        "limits": {**attributes(scope, "error_deg_s", "error_deg", "factor"), "judged_share": scope.judged},
        "told": timeline.told,
        "sensors": {
            name: [_span(name, span, zero_stamp) for span in spans] for name, spans in timeline.sensors.items()
        },
    }


def _span(sensor: str, span: SensorSpan, zero_stamp: str) -> Mapping[str, Any]:
    judged, sizes = span.judgement, span.sizes
    unit = unit_of(sensor)
    kind, parameters = (None, {}) if judged is None else (judged.kind, judged.parameters)
    below, above = (None, None) if sizes is None or sizes.factors is None else sizes.factors
    return {
        **attributes(span, "start_s", "end_s"),
        "start_stamp": stamp_text(zero_stamp, span.start_s, 3),
        "end_stamp": stamp_text(zero_stamp, span.end_s, 3),
        "state": str(span.state),
        **attributes(span, "reason", "suspects"),
        "kind": kind,
        "parameters": parameters,
        "parameter_units": parameter_units(kind, parameters, unit) if kind else {},
        "error": None if sizes is None else sizes.error,
        "factor_below": below,
        "factor_above": above,
        "noise": None if sizes is None else sizes.noise,
        "unit": unit,
        "within_s": None if sizes is None else sizes.within_s,
    }

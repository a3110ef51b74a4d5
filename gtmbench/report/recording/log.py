"""A watched log as a rerun recording.

=============================================  ========================================================
entity                                         holds
=============================================  ========================================================
``/sensors/GROUP/CHANNEL``                     the log's channels; GROUP: rates, wind, attitude, ..., other
``/virtual/CHANNEL``                           what those that are predicted, or failed, should have read
``/residuals/OUTPUT``                          at sample k, where there are any
``/levels/SCORE``                              over its threshold, at the time when it is known
``/threshold``                                 1: an alarm above it
``/began``, ``/alarm``, ``/named``             a point an alarm; ``named``: when the sensor was named
``/state``                                     what became of every stretch: watched, or why not
``/events``                                    remarks, stretches, alarms, judgements, the outcome, in words
``/verdict``, ``/findings/N/verdict``          outcome and alarms, field by field, as in the results
=============================================  ========================================================

All on the timeline ``time``, the log's clock; values are doubles, bit for bit those watched. A row without values
stands where samples are missing and between segments: no line runs over a gap.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rerun as rr

from gtmbench.channels import unit_of
from gtmbench.checks import printable
from gtmbench.report.recording.lines import (
    across,
    entity,
    log_events,
    log_judged,
    log_lines,
    log_marks,
    log_threshold,
    log_verdict,
    recorded,
    rgb,
)
from gtmbench.report.recording.log_blueprint import log_blueprint, sensor_entity
from gtmbench.report.recording.timeline import set_time
from gtmbench.report.style import COLOURS
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.judgement import MOST_ALARMS, Event, watch_events
from gtmbench.report.words.log import outcome_text, remark_text
from gtmbench.report.words.monitor import title_text
from gtmbench.report.words.units import with_unit
from gtmbench.report.words.watched import (
    TINTS,
    State,
    began_s,
    residuals_of,
    scores_of,
    signals_of,
    stretches,
    tints_of,
    whole_of,
)
from gtmbench.study.log.watched import Outcome, WatchedLog

_OUTCOME = (
    "outcome",
    "exit_code",
    "verdict",
    "reasons",
    "watched_hours",
    "alarms_unexplained",
    "false_alarms_per_hour_at_most",
)


def write_log_recording(watched: WatchedLog, path: Path) -> None:
    """Write the recording with its blueprint; every viewer of the same rerun version opens it ready to read."""
    name = f"{printable(watched.log.path.name)}: {title_text(watched.monitor)}"
    with recorded(path, name, log_blueprint(watched)) as recording:
        _sensors(recording, watched)
        if watched.watches:
            _virtual(recording, watched)
            tints = tints_of(watched)
            judged = dict.fromkeys([*scores_of(watched), *residuals_of(watched)])
            log_judged(recording, "", watched.watches, {name: tints[name] for name in judged})
        log_threshold(recording, whole_of(watched))
        for alarm in watched.alarms[:MOST_ALARMS]:
            log_marks(recording, "", [("began", began_s(alarm)), ("alarm", alarm.time_s), ("named", alarm.isolated_s)])
        _states(recording, watched)
        log_events(recording, "/events", _events(watched))
        _verdicts(recording, watched)


def _sensors(recording: rr.RecordingStream, watched: WatchedLog) -> None:
    log, tints = watched.log, tints_of(watched)
    for name in log.channels:
        parts = [(segment.time_s, segment[name]) for segment in log.segments]
        label = [with_unit(f"{name} measured", unit_of(name))]
        line = across(parts, log.sample_period_s)
        log_lines(recording, sensor_entity(name), *line, label, [tints[name]], channels=[name])


def _virtual(recording: rr.RecordingStream, watched: WatchedLog) -> None:
    for name in signals_of(watched):
        there = [watch for watch in watched.watches if name in watch.record]
        time_s, values = across([(one.record.time_s, one.virtual(name)) for one in there], watched.log.sample_period_s)
        if np.isfinite(values).any():
            label = [with_unit(f"{name} virtual sensor", unit_of(name))]
            tint = [COLOURS["virtual"]]
            log_lines(recording, entity("/virtual", name), time_s, values, label, tint, channels=[name])


def _states(recording: rr.RecordingStream, watched: WatchedLog) -> None:
    colours = [[*rgb(TINTS[state]), 255] for state in State]
    recording.log("/state", rr.StateConfiguration(values=[str(state) for state in State], colors=colours), static=True)
    found = stretches(watched)
    for one in found:
        set_time(recording, one.start_s)
        recording.log("/state", rr.StateChange(state=str(one.state)))
    set_time(recording, found[-1].end_s)
    recording.log("/state", rr.StateChange(state=""))  # it ends there


def _verdicts(recording: rr.RecordingStream, watched: WatchedLog) -> None:
    found = log_results(watched)
    log_verdict(recording, "/verdict", {name: found[name] for name in _OUTCOME})
    for number, finding in enumerate(found["findings"][:MOST_ALARMS], 1):
        row = {name: value for name, value in finding.items() if name != "judgements"}
        log_verdict(recording, f"/findings/{number}/verdict", row)


def _events(watched: WatchedLog) -> list[Event]:
    events: list[Event] = [(remark.start_s, "WARN", f"remark: {remark_text(remark)}") for remark in watched.log.remarks]
    events += [(one.start_s, "INFO", f"until {one.end_s:.2f} s: {one.state}") for one in stretches(watched)]
    for alarm in watched.alarms[:MOST_ALARMS]:
        if began_s(alarm) < alarm.time_s:
            events.append((began_s(alarm), "WARN", f"{alarm.verdict}: it began about here"))
    events += watch_events(watched.watches)
    level = {Outcome.FAILED: "CRITICAL", Outcome.UNKNOWN: "WARN", Outcome.HEALTHY: "INFO"}[watched.outcome]
    return [*events, (whole_of(watched)[1], level, f"outcome: {outcome_text(watched)}")]

"""A watched log as a rerun recording.

=============================================  ========================================================
entity                                         holds
=============================================  ========================================================
``/sensors/GROUP/CHANNEL``                     the log's channels; GROUP: rates, wind, attitude, ..., other
``/virtual/CHANNEL``                           what those that are predicted, or failed, should have read
``/residuals/OUTPUT``                          at sample k
``/levels/OUTPUT``                             over its threshold, at the time when it is known
``/threshold``                                 1: an alarm above it
``/began``, ``/alarm``, ``/named``             a point a finding; ``named``: when the sensor was named
``/state``                                     what became of every stretch: watched, or why not
``/events``                                    remarks, stretches, alarms, judgements, the outcome, in words
``/verdict``, ``/findings/N/verdict``          the outcome and every finding, field by field, as in the results
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
from gtmbench.detectors.alarm import Alarm
from gtmbench.report.lines import Event, across, log_events, log_lines, log_mark, log_verdict, rgb
from gtmbench.report.log_blueprint import entity, log_blueprint, sensor_entity
from gtmbench.report.log_faults import began_s, signals_of, tints_of, whole_of
from gtmbench.report.log_results import log_results
from gtmbench.report.log_spans import TINTS, State, stretches
from gtmbench.report.log_text import outcome_text, remark_text
from gtmbench.report.monitor_recording import finding_events, log_judged
from gtmbench.report.style import COLOURS
from gtmbench.report.text import with_unit
from gtmbench.report.timeline import set_time
from gtmbench.study.watched_log import Outcome, WatchedLog

_OUTCOME = (
    "outcome",
    "exit_code",
    "verdict",
    "reasons",
    "watched_hours",
    "alarms_unexplained",
    "false_alarms_per_hour_at_most",
)
_BEGAN = "#d0d0d0"  # seen on light and on dark


def write_log_recording(watched: WatchedLog, path: Path) -> None:
    """Write the recording with its blueprint; every viewer of the same rerun version opens it ready to read."""
    rr.set_strict_mode(True)  # an error must not become a warning and lost data
    recording = rr.RecordingStream("gtmbench")  # a fresh recording id: two of one id don't open side by side
    recording.save(path, default_blueprint=log_blueprint(watched))
    recording.send_recording_name(f"{printable(watched.log.path.name)}: bank {watched.monitor.bank.name}")
    _sensors(recording, watched)
    if watched.watches:
        _virtual(recording, watched)
        tints = tints_of(watched)
        log_judged(recording, "", watched.watches, {output: tints[output] for output in watched.monitor.operators})
    ends = np.array(whole_of(watched))
    log_lines(recording, "/threshold", ends, np.ones(2), ["threshold"], [COLOURS["threshold"]])
    for finding in watched.findings:
        _marks(recording, finding)
    _states(recording, watched)
    log_events(recording, "/events", _events(watched))
    _verdicts(recording, watched)
    recording.disconnect()  # writes the footer


def _sensors(recording: rr.RecordingStream, watched: WatchedLog) -> None:
    log, tints = watched.log, tints_of(watched)
    for name in log.channels:
        parts = [(segment.time_s, segment[name]) for segment in log.segments]
        label = [with_unit(f"{name} measured", unit_of(name))]
        line = across(parts, log.sample_period_s)
        log_lines(recording, sensor_entity(name), *line, label, [tints[name]], channels=[name])


def _virtual(recording: rr.RecordingStream, watched: WatchedLog) -> None:
    for name in signals_of(watched):
        parts = [(seen.record.time_s, seen.virtual(name)) for seen in watched.watches]
        label = [with_unit(f"{name} virtual sensor", unit_of(name))]
        line = across(parts, watched.log.sample_period_s)
        log_lines(recording, entity("/virtual", name), *line, label, [COLOURS["virtual"]], channels=[name])


def _marks(recording: rr.RecordingStream, finding: Finding) -> None:
    shapes = rr.components.MarkerShape
    log_mark(recording, "/began", began_s(finding), 1.0, "began", _BEGAN, shapes.Up)
    log_mark(recording, "/alarm", finding.alarm_s, 1.0, "alarm", COLOURS["threshold"], shapes.Down)
    if finding.isolated_s is not None:
        log_mark(recording, "/named", finding.isolated_s, 1.0, "named", COLOURS["beta"], shapes.Diamond)


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
    for number, finding in enumerate(found["findings"], 1):
        row = {name: value for name, value in finding.items() if name != "judgements"}
        log_verdict(recording, f"/findings/{number}/verdict", row)


def _events(watched: WatchedLog) -> list[Event]:
    events: list[Event] = [(remark.start_s, "WARN", f"remark: {remark_text(remark)}") for remark in watched.log.remarks]
    events += [(one.start_s, "INFO", f"until {one.end_s:.2f} s: {one.state}") for one in stretches(watched)]
    for finding in watched.findings:
        events.append((began_s(finding), "WARN", f"{finding.verdict}: it began about here"))
        events += finding_events(finding, "alarm")
    level = {Outcome.FAILED: "CRITICAL", Outcome.UNKNOWN: "WARN", Outcome.HEALTHY: "INFO"}[watched.outcome]
    return [*events, (whole_of(watched)[1], level, f"outcome: {outcome_text(watched)}")]

"""A monitored study as a rerun recording: shared signals once, every trial under ``/trials/SCENARIO/LABEL``.

==========================================  ===========================================================
entity                                      holds
==========================================  ===========================================================
``/truth/GROUP``, ``/sensors/GROUP``        channels of a group (rates, wind, attitude, ...)
``/surfaces``                               elevator, aileron and rudder commands, deg
``/healthy/residuals/OUTPUT``               of the healthy record, at sample k
``/healthy/levels/OUTPUT``                  over its threshold, at the time when it is known
``/threshold``                              1: an alarm above it
``/trials/.../measured``, ``.../virtual``   the broken channel, and what it should have read
``/trials/.../residuals/OUTPUT``            those that the broken channel enters; the others are the healthy ones
``/trials/.../levels/OUTPUT``               the same
``/trials/.../onset``, ``alarm``, ``named``  one point each; ``named``: when the sensor was named
``/trials/.../verdict``                     every field of the trial's row; ``/healthy/verdict``: false alarms
``/trials/.../events``                      onset, alarms, every change of judgement, ends and misses, in words
``/events``                                 false alarms on the healthy record
==========================================  ===========================================================

All on the timeline ``time``; values are doubles, bit for bit those of the study. A trial's signals run from 30 s before
its onset to 30 s after the last that is said of it, at least 120 s: before, they are the healthy ones. No view shows
the verdicts: they are for `read_recording`, which gives all of it back as a table.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from gtmbench.channels import unit_of
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Watch
from gtmbench.record import FloatArray, Span
from gtmbench.report.lines import (
    Event,
    across,
    lighter,
    log_events,
    log_lines,
    log_mark,
    log_sensors,
    log_threshold,
    log_verdict,
    trial_paths,
    trial_tints,
)
from gtmbench.report.monitor_blueprint import monitored_blueprint
from gtmbench.report.monitor_text import judgement_text
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.text import trial_label, with_unit
from gtmbench.study.monitored import MonitoredBaseline, MonitoredStudy, MonitoredTrial

_ONSET = "#d0d0d0"  # seen on light and on dark
_BEFORE_S, _AFTER_S, _AT_LEAST_S = 30.0, 30.0, 120.0


def write_monitored_recording(study: MonitoredStudy, path: Path) -> None:
    """Write the recording with its blueprint; every viewer of the same rerun version opens it ready to read."""
    rr.set_strict_mode(True)  # an error must not become a warning and lost data
    recording = rr.RecordingStream("gtmbench")  # a fresh recording id: two of one id don't open side by side
    paths = trial_paths(study.trials)
    recording.save(path, default_blueprint=monitored_blueprint(study, paths))
    baseline = study.baseline
    recording.send_recording_name(f"gtmbench study: bank {baseline.monitor.bank.name}, seed {baseline.setup.seed}")
    _shared(recording, baseline)
    for trial, root, tint in zip(study.trials, paths, trial_tints(study.trials), strict=True):
        _trial(recording, trial, root, tint)
        log_events(recording, f"{root}/events", _events(trial))
    recording.disconnect()  # writes the footer


def _shared(recording: rr.RecordingStream, baseline: MonitoredBaseline) -> None:
    log_sensors(recording, baseline.flight, baseline.healthy)
    outputs = tuple(baseline.watched.levels)
    tints = [lighter(colour(name, i)) for i, name in enumerate(outputs)]
    log_judged(recording, "/healthy", [baseline.watched], dict(zip(outputs, tints, strict=True)), ", healthy")
    log_threshold(recording, baseline.flight, 1.0, "threshold", COLOURS["threshold"])
    told = ("false_alarms", "healthy_hours")
    log_verdict(recording, "/healthy/verdict", {name: getattr(baseline, name) for name in told})
    found = baseline.watched.findings
    log_events(
        recording, "/events", [event for one in found for event in finding_events(one, "healthy record: false alarm")]
    )


def _trial(recording: rr.RecordingStream, trial: MonitoredTrial, root: str, tint: str) -> None:
    seen, unit = trial.watched, unit_of(trial.channel)
    span = _logged_s(trial)
    measured = _part(trial.record.time_s, trial.record[trial.channel], span)
    names = [f"{trial.channel} measured ({unit})"]
    log_lines(recording, f"{root}/measured", *measured, names, [tint], channels=[trial.channel])
    virtual = _part(seen.record.time_s, seen.virtual(trial.channel), span)
    if np.isfinite(virtual[1]).any():
        names = [f"virtual sensor ({unit})"]
        log_lines(recording, f"{root}/virtual", *virtual, names, [COLOURS["virtual"]], channels=[trial.channel])
    bank = seen.monitor.bank
    tints = {spec.output: colour(spec.output, i) for i, spec in enumerate(bank.residuals)}
    own = bank.disturbs(trial.channel)
    log_judged(recording, root, [seen], {output: tints[output] for output in own}, "", span)
    shapes = rr.components.MarkerShape
    marks = {
        "onset": (trial.onset_s, 1.0, _ONSET, shapes.Up),
        "alarm": (trial.alarm_time_s, 1.0, COLOURS["threshold"], shapes.Down),
        "named": (trial.isolated_s, 1.0, COLOURS["beta"], shapes.Diamond),
    }
    for name, (time_s, level, of, shape) in marks.items():
        if time_s is not None:
            log_mark(recording, f"{root}/{name}", time_s, level, name, of, shape)
    log_verdict(recording, f"{root}/verdict", trial.row())


def log_judged(
    recording: rr.RecordingStream,
    root: str,
    watches: Sequence[Watch],
    tints: Mapping[str, str],
    suffix: str = "",
    span: Span = (-np.inf, np.inf),
) -> None:
    """Log ``residuals/OUTPUT`` and ``levels/OUTPUT`` of some outputs, of one stretch or several."""
    for output, tint in tints.items():
        part, period_s = rr.escape_entity_path_part(output), watches[0].record.sample_period_s
        raw = [_part(seen.record.time_s, seen.residuals.raw[output], span) for seen in watches]
        name = with_unit(f"residual of {output}{suffix}", unit_of(output))
        log_lines(recording, f"{root}/residuals/{part}", *across(raw, period_s), [name], [tint], channels=[output])
        level = [_part(seen.levels[output].known_s, seen.levels[output].values, span) for seen in watches]
        name = f"level of {output}{suffix}"
        log_lines(recording, f"{root}/levels/{part}", *across(level, period_s), [name], [tint], channels=[output])


def _events(trial: MonitoredTrial) -> list[Event]:
    what = f"{trial.fault.replace('_', ' ')} of {trial_label(trial)}"
    events: list[Event] = [(trial.onset_s, "WARN", f"onset: {what}")]
    if trial.injected.duration_s is not None:
        events.append((trial.onset_s + trial.injected.duration_s, "WARN", f"end of the {what}"))
    for finding in trial.watched.findings:
        early = finding.alarm_s < trial.onset_s - 1e-9
        late = "false alarm" if early else f"alarm, {finding.alarm_s - trial.onset_s:.2f} s after the onset"
        events += finding_events(finding, late)
    if not trial.detected:
        events.append((trial.record.end_s, "CRITICAL", f"missed: {what}; {trial.reason}"))
    return events


def finding_events(finding: Finding, what: str) -> list[Event]:
    """Return an alarm, every change of judgement after it, and the fault's end."""
    events: list[Event] = [(finding.alarm_s, "ERROR", f"{what}: residual of {finding.residual}, {finding.series}")]
    before = None
    for judged in finding.judgements:
        now = judged.sensor, judged.candidates, judged.kind
        if now != before:
            events.append((judged.time_s, "INFO", judgement_text(judged)))
        before = now
    if events[-1][0] < finding.last.time_s:
        events.append((finding.last.time_s, "INFO", f"last word: {judgement_text(finding.last)}"))
    if finding.ended_s is not None and finding.resumed_s is not None:
        events.append((finding.resumed_s, "INFO", f"the fault has gone, since {finding.ended_s:.2f} s"))
    return events


def _logged_s(trial: MonitoredTrial) -> Span:
    """Return the span that a trial's signals are logged over."""
    said = [time_s for time_s, _, _ in _events(trial) if trial.detected]
    return trial.onset_s - _BEFORE_S, max([trial.onset_s + _AT_LEAST_S, *(time_s + _AFTER_S for time_s in said)])


def _part(time_s: FloatArray, values: FloatArray, span: Span) -> tuple[FloatArray, FloatArray]:
    shown = (time_s >= span[0] - 1e-9) & (time_s <= span[1] + 1e-9)
    return time_s[shown], values[shown]

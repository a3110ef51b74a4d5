"""A study as a rerun recording: shared signals once, every trial under ``/trials/SCENARIO/LABEL``.

==========================================  ===========================================================
entity                                      holds
==========================================  ===========================================================
``/truth/GROUP``, ``/sensors/GROUP``        channels of a group (rates, wind, attitude, load, speed, altitude)
``/surfaces``                               elevator, aileron and rudder commands, deg
``/path``, ``/attitude``                    the way flown in ft (north, east, down); the aircraft's attitude
``/healthy/verdict``                        false alarms and the hours watched
``/trials/.../measured``                    the broken channel
``/trials/.../onset``, ``alarm``, ``named``  one point each; ``named``: when the sensor was named
``/trials/.../verdict``                     every field of the trial's row
==========================================  ===========================================================

Of a detector with one score in a unit, as E(k) of the dissertation's:

==========================================  ===========================================================
``/healthy/norm``, ``/trials/.../norm``     the score, at the time at which it is known: (k + w + d) Ts
``.../residual``                            e(k), at sample k, where it has one
``/threshold``                              of the score
``/events``                                 onsets, alarms and misses of all trials, in words
``/operator/OUTPUT/INPUT``                  Markov parameters over lags
==========================================  ===========================================================

Of any other, as banks:

==========================================  ===========================================================
``/healthy/levels/SCORE``                   every score over its threshold, at the time at which it is known
``/healthy/residuals/OUTPUT``               at sample k, where it has any
``/trials/.../levels``, ``.../residuals``   those that the broken channel enters; the others are the healthy ones
``/trials/.../virtual``                     what the broken channel should have read, where that is known
``/threshold``                              1: an alarm above it
``/trials/.../events``                      onset, alarms, every change of judgement, ends and misses, in words
``/events``                                 false alarms on the healthy record
==========================================  ===========================================================

There, a trial's signals run from 30 s before its onset to 30 s after the last that is said of it, at least 120 s:
before, they are the healthy ones. With several detectors, all but the first four rows stands once for each, below
``/detectors/NAME``.

All on the timeline ``time``; values are doubles, bit for bit those of the study (levels: over the threshold). No view
shows the verdicts: they are for `read_recording`, which gives all of it back as a table.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from gtmbench.channels import unit_of
from gtmbench.detectors.protocol import Score
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.record import Span
from gtmbench.report.recording.blueprint import Placed, blueprint
from gtmbench.report.recording.lines import (
    SHAPES,
    entity,
    lighter,
    log_events,
    log_judged,
    log_lines,
    log_mark,
    log_marks,
    log_sensors,
    log_threshold,
    log_verdict,
    recorded,
    rgb,
    trial_paths,
    trial_tints,
)
from gtmbench.report.recording.scene import log_scene
from gtmbench.report.recording.views import whole
from gtmbench.report.scores import norm_of, part, tints
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.words.judgement import Event, trial_events, trial_label, watch_events
from gtmbench.report.words.monitor import title_text
from gtmbench.report.words.units import with_unit
from gtmbench.study.trial import Baseline, Study, Trial

_BEFORE_S, _AFTER_S, _AT_LEAST_S = 30.0, 30.0, 120.0


def write_recording(study: Study, path: Path) -> None:
    """Write the recording with its blueprint; every viewer of the same rerun version opens it ready to read."""
    placed = [_placed(study, baseline) for baseline in study.baselines]
    baseline = study.baseline
    names = ", ".join(title_text(one.baseline.monitor) for one in placed)
    with recorded(path, f"gtmbench study: {names}, seed {baseline.setup.seed}", blueprint(placed)) as recording:
        log_sensors(recording, baseline.flight, baseline.healthy)
        log_scene(recording, baseline.flight)
        for one in placed:
            norm = norm_of(one.baseline.watch)
            if norm is None:
                _log_levels(recording, one)
            else:
                _log_norm(recording, one, norm)


def _placed(study: Study, baseline: Baseline) -> Placed:
    trials = study.trials_of(baseline.detector)
    root = entity("/detectors", baseline.detector) if len(study.baselines) > 1 else ""
    return Placed(baseline=baseline, root=root, trials=trials, paths=[f"{root}{path}" for path in trial_paths(trials)])


def _log_norm(recording: rr.RecordingStream, placed: Placed, norm: Score) -> None:
    """Log a detector with one score in a unit: whole signals, in the colours of the trials, for one plot of all."""
    baseline, root, unit, tint = placed.baseline, placed.root, norm.unit, COLOURS["healthy"]
    _log_residual(recording, f"{root}/healthy", "healthy", tint, baseline)
    log_lines(recording, f"{root}/healthy/norm", norm.known_s, norm.values, [f"healthy ({unit})"], [tint])
    log_threshold(recording, whole(baseline.flight), norm.threshold, f"threshold ({unit})", root)
    known = {"threshold": norm.threshold, "armed_s": norm.armed_s}
    _log_false_alarms(recording, placed, known)
    if isinstance(baseline.monitor, NormMonitor):
        _log_operator(recording, root, baseline.monitor)
    events = _healthy_events(baseline)
    for trial, path, of in zip(placed.trials, placed.paths, trial_tints(placed.trials), strict=True):
        label, score = trial_label(trial), trial.watch.scores[norm.name]
        full = f"{trial.scenario}: {label}"
        _log_measured(recording, trial, path, f"{full} broken ({trial.unit})", of)
        _log_residual(recording, path, full, of, trial)
        log_lines(recording, f"{path}/norm", score.known_s, score.values, [label], [of])
        log_mark(recording, f"{path}/onset", trial.onset_s, 0.0, f"{label} onset", of, SHAPES.Up)
        if trial.alarm_time_s is not None:
            at = trial.alarm_time_s, norm.threshold
            log_mark(recording, f"{path}/alarm", *at, f"{label} alarm", of, SHAPES.Down)
        log_verdict(recording, f"{path}/verdict", trial.row())
        events += trial_events(trial)
    log_events(recording, f"{root}/events", events)


def _log_levels(recording: rr.RecordingStream, placed: Placed) -> None:
    """Log a detector with levels, or without scores: signals around the onset, for a plot a trial."""
    baseline, root = placed.baseline, placed.root
    of = tints(baseline.watch)
    pale = {name: lighter(tint) for name, tint in of.items()}
    log_judged(recording, f"{root}/healthy", [baseline.watch], pale, ", healthy")
    log_threshold(recording, whole(baseline.flight), root=root)
    _log_false_alarms(recording, placed, {})
    log_events(recording, f"{root}/events", _healthy_events(baseline))
    for trial, path, tint in zip(placed.trials, placed.paths, trial_tints(placed.trials), strict=True):
        events = trial_events(trial)
        span = _logged_s(trial, events)
        _log_measured(recording, trial, path, with_unit(f"{trial.channel} measured", trial.unit), tint, span)
        _log_virtual(recording, trial, path, span)
        log_judged(recording, path, [trial.watch], {name: of[name] for name in placed.entered(trial)}, "", span)
        marks = {"onset": trial.onset_s, "alarm": trial.alarm_time_s, "named": trial.isolated_s}
        log_marks(recording, path, marks.items())
        log_verdict(recording, f"{path}/verdict", trial.row())
        log_events(recording, f"{path}/events", events)


def _log_false_alarms(recording: rr.RecordingStream, placed: Placed, known: dict[str, float | None]) -> None:
    baseline = placed.baseline
    told = known | {"false_alarms": baseline.false_alarms, "healthy_hours": baseline.healthy_hours}
    log_verdict(recording, f"{placed.root}/healthy/verdict", told)


def _healthy_events(baseline: Baseline) -> list[Event]:
    """Return when the healthy record's score could first alarm, and false alarms."""
    events: list[Event] = []
    monitor, norm = baseline.monitor, norm_of(baseline.watch)
    if isinstance(monitor, NormMonitor) and norm is not None:
        start_s, end_s = baseline.setup.operator.identify_s
        events.append((start_s, "INFO", f"identification of {monitor.operator.name} begins"))
        events.append((end_s, "INFO", "identification ends"))
    for score in baseline.watch.scores.values():
        if norm is not None and score.armed_s is not None:
            events.append((score.armed_s, "INFO", "armed: the norm stands at or below the threshold"))
        if score.is_stuck_above:
            late = f"can't tell: {score.name} stood above its threshold from the start, so no alarm was possible"
            events.append((baseline.watch.record.end_s, "CRITICAL", late))
    return events + watch_events([baseline.watch], "healthy record: false alarm")


def _log_measured(
    recording: rr.RecordingStream, trial: Trial, path: str, name: str, tint: str, span: Span = (-np.inf, np.inf)
) -> None:
    measured = part(trial.record.time_s, trial.record[trial.channel], span)
    log_lines(recording, f"{path}/measured", *measured, [name], [tint], channels=[trial.channel])


def _log_residual(recording: rr.RecordingStream, root: str, label: str, tint: str, of: Baseline | Trial) -> None:
    """Log e(k) of every output, where there are residuals, in one colour."""
    outputs = list(of.watch.residuals)
    if outputs:
        names = [with_unit(f"{label}, e of {output}", unit_of(output)) for output in outputs]
        values = np.column_stack([of.watch.residuals[output] for output in outputs])
        tints_of = [tint] * len(outputs)
        log_lines(recording, f"{root}/residual", of.watch.record.time_s, values, names, tints_of, channels=outputs)


def _log_operator(recording: rr.RecordingStream, root: str, monitor: NormMonitor) -> None:
    operator = monitor.operator
    for o, output in enumerate(operator.outputs):
        for i, name in enumerate(operator.inputs):
            bars = rr.BarChart(operator.markov[:, o, i], abscissa=operator.lags, color=rgb(colour(name, i)))
            recording.log(f"{root}/operator/{output}/{name}", bars, static=True)


def _log_virtual(recording: rr.RecordingStream, trial: Trial, path: str, span: Span) -> None:
    virtual = part(trial.watch.record.time_s, trial.watch.virtual(trial.channel), span)
    if np.isfinite(virtual[1]).any():
        names = [with_unit("virtual sensor", trial.unit)]
        log_lines(recording, f"{path}/virtual", *virtual, names, [COLOURS["virtual"]], channels=[trial.channel])


def _logged_s(trial: Trial, events: Sequence[Event]) -> Span:
    """Return the span that a trial's signals are logged over."""
    said = [time_s for time_s, _, _ in events if trial.detected]
    return trial.onset_s - _BEFORE_S, max([trial.onset_s + _AT_LEAST_S, *(time_s + _AFTER_S for time_s in said)])

"""A study as a rerun recording: shared signals once, every trial under ``/trials/SCENARIO/LABEL``.

======================================  ===============================================================
entity                                  holds
======================================  ===============================================================
``/truth/GROUP``, ``/sensors/GROUP``    channels of a group (rates, wind, attitude, load, speed, altitude)
``/surfaces``                           elevator, aileron and rudder commands, deg
``/healthy/residual``, ``/healthy/norm``  of the healthy record
``/threshold``                          what the norm is held against
``/trials/.../measured``                the broken channel
``/trials/.../residual``                e(k), at sample k
``/trials/.../norm``                    E(k), at the time (k + w + d) Ts at which it is known
``/trials/.../onset``, ``.../alarm``    one point each
``/trials/.../verdict``                 every field of the trial's row; ``/healthy/verdict``: false alarms
``/events``                             onsets, alarms and misses, in words
``/operator/OUTPUT/INPUT``              Markov parameters over lags
``/path``, ``/attitude``                the way flown in ft (north, east, down); the aircraft's attitude
======================================  ===============================================================

All on the timeline ``time``; values are doubles, bit for bit those of the study. No view shows the verdicts: they are
for `read_recording`, which gives all of it back as a table.
"""

from __future__ import annotations

from pathlib import Path

import rerun as rr

from gtmbench.channels import unit_of
from gtmbench.report.blueprint import blueprint
from gtmbench.report.lines import (
    Event,
    log_events,
    log_lines,
    log_mark,
    log_sensors,
    log_threshold,
    log_verdict,
    rgb,
    trial_paths,
    trial_tints,
)
from gtmbench.report.scene import log_scene
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.text import trial_label
from gtmbench.study.trial import Baseline, Study, Trial


def write_recording(study: Study, path: Path) -> None:
    """Write the recording with its blueprint; every viewer of the same rerun version opens it ready to read."""
    rr.set_strict_mode(True)  # an error must not become a warning and lost data
    recording = rr.RecordingStream("gtmbench")  # a fresh recording id: two of one id don't open side by side
    labels = trial_paths(study.trials)
    recording.save(path, default_blueprint=blueprint(study, labels))
    recording.send_recording_name(f"gtmbench study: {study.baseline.operator.name}, seed {study.baseline.setup.seed}")
    _shared(recording, study)
    _operator(recording, study)
    log_scene(recording, study.baseline.flight)
    for trial, label, tint in zip(study.trials, labels, trial_tints(study.trials), strict=True):
        _trial(recording, trial, label, tint)
    _events(recording, study)
    recording.disconnect()  # writes the footer


def _shared(recording: rr.RecordingStream, study: Study) -> None:
    baseline = study.baseline
    log_sensors(recording, baseline.flight, baseline.healthy)
    unit, norm = unit_of(baseline.operator.outputs[0]), baseline.norm
    _residual(recording, "/healthy", "healthy", COLOURS["healthy"], baseline)
    log_lines(recording, "/healthy/norm", norm.known_s, norm.values, [f"healthy ({unit})"], [COLOURS["healthy"]])
    log_threshold(recording, baseline.flight, baseline.threshold, f"threshold ({unit})", COLOURS["threshold"])
    told = ("threshold", "armed_s", "false_alarms", "healthy_hours")
    log_verdict(recording, "/healthy/verdict", {name: getattr(baseline, name) for name in told})


def _residual(recording: rr.RecordingStream, root: str, label: str, tint: str, of: Baseline | Trial) -> None:
    names = [f"{label}, e of {output} ({unit_of(output)})" for output in of.residual.outputs]
    residual, tints = of.residual, [tint] * len(names)
    log_lines(recording, f"{root}/residual", residual.time_s, residual.values, names, tints, channels=residual.outputs)


def _operator(recording: rr.RecordingStream, study: Study) -> None:
    operator = study.baseline.operator
    for o, output in enumerate(operator.outputs):
        for i, name in enumerate(operator.inputs):
            bars = rr.BarChart(operator.markov[:, o, i], abscissa=operator.lags, color=rgb(colour(name, i)))
            recording.log(f"/operator/{output}/{name}", bars, static=True)


def _trial(recording: rr.RecordingStream, trial: Trial, root: str, tint: str) -> None:
    label, full = trial_label(trial), f"{trial.scenario}: {trial_label(trial)}"
    record, names = trial.record, [f"{full} broken ({trial.unit})"]
    measured = record[trial.channel]
    log_lines(recording, f"{root}/measured", record.time_s, measured, names, [tint], channels=[trial.channel])
    _residual(recording, root, full, tint, trial)
    log_lines(recording, f"{root}/norm", trial.norm.known_s, trial.norm.values, [label], [tint])
    up, down = rr.components.MarkerShape.Up, rr.components.MarkerShape.Down
    marks = {"onset": (trial.onset_s, 0.0, up), "alarm": (trial.alarm_time_s, trial.baseline.threshold, down)}
    for name, (time_s, level, marker) in marks.items():
        if time_s is not None:
            log_mark(recording, f"{root}/{name}", time_s, level, f"{label} {name}", tint, marker)
    log_verdict(recording, f"{root}/verdict", trial.row())


def _events(recording: rr.RecordingStream, study: Study) -> None:
    events: list[Event] = []
    setup = study.baseline.setup
    start_s, end_s = setup.operator.identify_s
    events.append((start_s, "INFO", f"identification of {study.baseline.operator.name} begins"))
    events.append((end_s, "INFO", "identification ends"))
    if study.baseline.armed_s is not None:
        events.append((study.baseline.armed_s, "INFO", "armed: the norm stands at or below the threshold"))
    for trial in study.trials:
        what = f"{trial.fault} of {trial_label(trial)}"
        events.append((trial.onset_s, "WARN", f"onset: {what}"))
        if trial.alarm_time_s is not None:
            late = f"{trial.detection_delay_s:.2f} s after the onset"
            events.append((trial.alarm_time_s, "ERROR", f"alarm: {what}, {late}"))
        else:
            events.append((trial.record.end_s, "CRITICAL", f"missed: {what}; {trial.reason}"))
    log_events(recording, "/events", events)

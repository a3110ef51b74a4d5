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
``/events``                             onsets, alarms and misses, in words
``/operator/OUTPUT/INPUT``              Markov parameters over lags
``/path``, ``/attitude``                the way flown in ft (north, east, down); the aircraft's attitude
======================================  ===============================================================

All on the timeline ``time``; values are doubles, bit for bit those of the study.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from gtmbench.channels import SURFACES, unit_of
from gtmbench.record import FloatArray
from gtmbench.report.blueprint import blueprint
from gtmbench.report.scene import log_scene
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.text import repetitions, trial_label
from gtmbench.report.timeline import set_time, times
from gtmbench.study.trial import Baseline, Study, Trial

GROUPS = {
    "rates": ("p", "q", "r"),
    "wind": ("alpha", "beta"),
    "attitude": ("phi", "theta", "psi"),
    "load": ("nx", "ny", "nz"),
    "speed": ("tas",),
    "altitude": ("altitude",),
}


def write_recording(study: Study, path: Path) -> None:
    """Write the recording with its blueprint; every viewer of the same rerun version opens it ready to read."""
    rr.set_strict_mode(True)  # an error must not become a warning and lost data
    recording = rr.RecordingStream("gtmbench")  # a fresh recording id: two of one id don't open side by side
    labels = trial_paths(study.trials)
    recording.save(path, default_blueprint=blueprint(study, labels, GROUPS))
    recording.send_recording_name(f"gtmbench study: {study.baseline.operator.name}, seed {study.baseline.setup.seed}")
    _shared(recording, study)
    _operator(recording, study)
    log_scene(recording, study.baseline.flight)
    for trial, label, repetition in zip(study.trials, labels, repetitions(study.trials), strict=True):
        tint = colour(trial.channel)
        for _ in range(repetition):
            tint = _lighter(tint)
        _trial(recording, trial, label, tint)
    _events(recording, study)
    recording.disconnect()  # writes the footer


def trial_paths(trials: Sequence[Trial]) -> list[str]:
    """Return every trial's entity: ``/trials/drift/p``, numbered where a scenario breaks a channel in several ways."""
    often = Counter((trial.scenario, trial.channel) for trial in trials)
    paths = []
    for trial, repetition in zip(trials, repetitions(trials), strict=True):
        several = often[trial.scenario, trial.channel] > 1
        label = f"{trial.channel}_{repetition + 1}" if several else trial.channel
        paths.append(rr.new_entity_path(["trials", trial.scenario, label]))  # escapes what a file's name may hold
    return paths


def _lines(
    recording: rr.RecordingStream,
    entity: str,
    time_s: FloatArray,
    values: FloatArray,
    names: list[str],
    tints: list[str],
) -> None:
    """Send one line (or several of a unit, as columns) with names and colours; samples that are missing stay out."""
    table = values.reshape(len(time_s), -1)
    there = np.isfinite(table).all(axis=1)
    style = rr.SeriesLines(names=names, colors=[_rgb(tint) for tint in tints], widths=1.5, aggregation_policy="MinMax")
    recording.log(entity, style, static=True)
    columns = rr.Scalars.columns(scalars=table[there].ravel())
    if table.shape[1] > 1:
        columns = columns.partition([table.shape[1]] * int(there.sum()))
    recording.send_columns(entity, indexes=[times(time_s[there])], columns=columns)


def _rgb(tint: str) -> list[int]:
    return [int(tint[i : i + 2], 16) for i in (1, 3, 5)]


def _lighter(tint: str) -> str:
    return "#" + "".join(f"{(value + 255) // 2:02x}" for value in _rgb(tint))


def _shared(recording: rr.RecordingStream, study: Study) -> None:
    baseline = study.baseline
    for root, record, suffix in (("truth", baseline.flight, "true"), ("sensors", baseline.healthy, "measured")):
        for group, members in GROUPS.items():
            there = [name for name in members if name in record]
            if there:
                tints = [colour(name, i) for i, name in enumerate(there)]
                tints = tints if root == "truth" else [_lighter(tint) for tint in tints]
                names = [f"{name} {suffix} ({unit_of(name)})" for name in there]
                _lines(recording, f"/{root}/{group}", record.time_s, record.matrix(there), names, tints)
    flight = baseline.flight
    tints = [colour(name, i) for i, name in enumerate(SURFACES)]
    names = [f"{name} (deg)" for name in SURFACES]
    _lines(recording, "/surfaces", flight.time_s, flight.matrix(SURFACES), names, tints)
    unit = unit_of(baseline.operator.outputs[0])
    healthy = COLOURS["healthy"]
    _residual(recording, "/healthy", "healthy", healthy, baseline)
    _lines(recording, "/healthy/norm", baseline.norm.known_s, baseline.norm.values, [f"healthy ({unit})"], [healthy])
    ends = np.array([flight.start_s, flight.end_s])
    level = np.full(2, baseline.threshold)
    _lines(recording, "/threshold", ends, level, [f"threshold ({unit})"], [COLOURS["threshold"]])


def _residual(recording: rr.RecordingStream, root: str, label: str, tint: str, of: Baseline | Trial) -> None:
    names = [f"{label}, e of {output} ({unit_of(output)})" for output in of.residual.outputs]
    _lines(recording, f"{root}/residual", of.residual.time_s, of.residual.values, names, [tint] * len(names))


def _operator(recording: rr.RecordingStream, study: Study) -> None:
    operator = study.baseline.operator
    for o, output in enumerate(operator.outputs):
        for i, name in enumerate(operator.inputs):
            bars = rr.BarChart(operator.markov[:, o, i], abscissa=operator.lags, color=_rgb(colour(name, i)))
            recording.log(f"/operator/{output}/{name}", bars, static=True)


def _trial(recording: rr.RecordingStream, trial: Trial, root: str, tint: str) -> None:
    label, full = trial_label(trial), f"{trial.scenario}: {trial_label(trial)}"
    measured = trial.record[trial.channel]
    _lines(recording, f"{root}/measured", trial.record.time_s, measured, [f"{full} broken ({trial.unit})"], [tint])
    _residual(recording, root, full, tint, trial)
    _lines(recording, f"{root}/norm", trial.norm.known_s, trial.norm.values, [label], [tint])
    up, down = rr.components.MarkerShape.Up, rr.components.MarkerShape.Down
    marks = {"onset": (trial.onset_s, 0.0, up), "alarm": (trial.alarm_time_s, trial.baseline.threshold, down)}
    for name, (time_s, level, marker) in marks.items():
        if time_s is not None:
            style = rr.SeriesPoints(names=f"{label} {name}", colors=_rgb(tint), markers=marker, marker_sizes=6.0)
            recording.log(f"{root}/{name}", style, static=True)
            set_time(recording, time_s)
            recording.log(f"{root}/{name}", rr.Scalars(level))


def _events(recording: rr.RecordingStream, study: Study) -> None:
    events: list[tuple[float, str, str]] = []
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
    for time_s, level, text in sorted(events):
        set_time(recording, time_s)
        recording.log("/events", rr.TextLog(f"{time_s:.2f} s  {text}", level=level))

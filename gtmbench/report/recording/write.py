"""Recordings for the rerun viewer: of a study, of a watched log.

All stand on the timeline ``time``; values are doubles, bit for bit those of the study or the log (levels: scores over
their thresholds). No view shows the verdicts: they are for `read_recording`, which gives all of a recording back as a
table. In both:

==========================================  ===========================================================
entity                                      holds
==========================================  ===========================================================
``.../residuals/OUTPUT``                    e(k), at sample k, where there are any
``.../levels/SCORE``                        over its threshold, at the time at which it is known
``.../threshold``                           1: an alarm above it
``.../events``                              what happened, in words
``.../verdict``                             what was found, field by field, as in the results
==========================================  ===========================================================

A study holds shared signals once, and every trial under ``/trials/SCENARIO/LABEL``:

==========================================  ===========================================================
``/truth/GROUP``, ``/sensors/GROUP``        channels of a group: rates, wind, attitude, heading, ...
``/surfaces``                               elevator, aileron and rudder commands, deg
``/path``, ``/attitude``                    the way flown in ft (north, east, down); the aircraft's attitude
``/healthy/verdict``                        false alarms and the hours watched
``/trials/.../measured``                    the broken channel
``/trials/.../onset``, ``alarm``, ``named``  one point each; ``named``: when the sensor was named
``/trials/.../verdict``                     every field of the trial's row
==========================================  ===========================================================

of a detector with one score in a unit, as E(k) of the dissertation's:

==========================================  ===========================================================
``/healthy/norm``, ``/trials/.../norm``     the score, at the time at which it is known: (k + w + d) Ts
``.../residual``                            e(k), at sample k, where it has one
``/threshold``                              of the score
``/events``                                 onsets, alarms and misses of all trials
``/operator/OUTPUT/INPUT``                  Markov parameters over lags
==========================================  ===========================================================

of any other, as banks:

==========================================  ===========================================================
``/healthy/levels``, ``.../residuals``      all of them
``/trials/.../levels``, ``.../residuals``   those that the broken channel enters; the others are the healthy ones
``/trials/.../virtual``                     what the broken channel should have read, where that is known
``/trials/.../events``                      onset, alarms, every change of judgement, ends and misses
``/events``                                 false alarms on the healthy record
==========================================  ===========================================================

There, a trial's signals run from 30 s before its onset to 30 s after the last that is said of it, at least 120 s:
before, they are the healthy ones. With several detectors, all but the flight (``/truth``, ``/sensors``, ``/surfaces``,
``/path``, ``/attitude``) stands once for each, below ``/detectors/NAME``.

A watched log, on the log's clock; no line runs over a gap between samples or segments:

==========================================  ===========================================================
``/sensors/GROUP/CHANNEL``                  the log's channels; GROUP: rates, wind, attitude, ..., other
``/virtual/CHANNEL``                        what those that are predicted, or failed, should have read
``/attitude``                               the aircraft as it is turned, where the log says that
``/began``, ``/alarm``, ``/named``          a point an alarm; ``named``: when the sensor was named
``/state/SENSOR``                           its timeline: clear, failed, suspected, not judged
``/events``                                 remarks, a log's events, states, alarms, judgements, the outcome
``/verdict``, ``/findings/N/verdict``       outcome and alarms
==========================================  ===========================================================
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
import rerun as rr

from gtmbench.checks import printable
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.detectors.windowed_norm import NormMonitor
from gtmbench.log.judging.claims import began_s
from gtmbench.log.opening.records import whole_s
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.figures.rescue import Scene
from gtmbench.report.log_findings import reported_sensors, residuals_of, scores_of, signals_of, tints_of
from gtmbench.report.recording.blueprint import Placed, log_blueprint, study_blueprint
from gtmbench.report.recording.entities import (
    MEASURED,
    SHAPES,
    VIRTUAL,
    Recording,
    Signal,
    entity,
    in_unit,
    joined,
    lighter,
    recorded,
    rgb,
    sensor_entity,
    trial_paths,
    trial_tints,
    whole,
)
from gtmbench.report.recording.flight import log_attitude, log_scene, log_sensors
from gtmbench.report.style import COLOURS, STATES, colour, norm_of, part, tints
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.events import MOST_ALARMS, Event, trial_events, watch_events
from gtmbench.report.words.found import certificate_lines
from gtmbench.report.words.judgement import trial_label
from gtmbench.report.words.log import event_text, remark_text
from gtmbench.report.words.others import injection_text
from gtmbench.report.words.timeline import span_text
from gtmbench.report.words.units import beside_text, stamped_text, with_unit
from gtmbench.report.words.verdict import verdict_text
from gtmbench.study.trial import Baseline, Study, Trial
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import Span
from gtmbench.verdict.verdict import Outcome

_BEFORE_S, _AFTER_S, _AT_LEAST_S = 30.0, 30.0, 120.0  # logged about a trial's onset and what is said of it
_OUTCOME = (
    "outcome",
    "exit_code",
    "verdict",
    "reasons",
    "watched_hours",
    "alarms_unexplained",
    "false_alarms_per_hour_at_most",
)


# a study


def write_recording(study: Study, path: Path) -> None:
    """Write a study with its blueprint; every viewer of the same rerun version opens it ready to read."""
    placed = [_placed_trials(study, baseline) for baseline in study.baselines]
    baseline = study.baseline
    names = ", ".join(basis_of(detector.monitor).title for detector in study.baselines)
    name = f"gtmbench study: {names}, seed {baseline.setup.seed}"
    with recorded(path, name, study_blueprint(placed)) as recording:
        log_sensors(recording, baseline.flight, baseline.healthy)
        log_scene(recording, Scene(flight=baseline.flight, moments=_moments(study)))
        for detector in placed:
            norm = norm_of(detector.baseline.watch)
            if norm is None:
                _log_scores(recording, detector)
            else:
                _log_norm(recording, detector, norm)


def _moments(study: Study) -> list[tuple[float, str]]:
    """Return what is marked on the way: when faults begin, and the first alarm of all trials."""
    onsets_s = sorted({trial.onset_s for trial in study.trials})
    alarms_s = [trial.alarm_time_s for trial in study.trials if trial.alarm_time_s is not None]
    flown = [time_s for time_s in onsets_s if time_s <= study.baseline.flight.end_s]
    marks = [(time_s, f"faults begin, {time_s:g} s") for time_s in flown[:3]]
    return marks + [(time_s, f"first alarm, {time_s:.2f} s") for time_s in sorted(alarms_s)[:1]]


def _placed_trials(study: Study, baseline: Baseline) -> Placed:
    trials = study.trials_of(baseline.detector)
    root = entity("/detectors", baseline.detector) if len(study.baselines) > 1 else ""
    paths = [f"{root}{path}" for path in trial_paths(trials)]
    return Placed(baseline=baseline, root=root, trials=list(zip(trials, paths, strict=True)))


def _tinted(placed: Placed) -> list[tuple[Trial, str, str]]:
    colours = trial_tints([trial for trial, _ in placed.trials])
    return [(trial, path, tint) for (trial, path), tint in zip(placed.trials, colours, strict=True)]


def _log_norm(recording: Recording, placed: Placed, norm: Score) -> None:
    """Log a detector with one score in a unit: whole signals, in the colours of the trials, for one plot of all."""
    baseline, root, healthy = placed.baseline, placed.root, COLOURS["healthy"]
    _log_residual(recording, f"{root}/healthy", "healthy", healthy, baseline.watch)
    recording.log_line(f"{root}/healthy/norm", (norm.known_s, norm.values), f"healthy ({norm.unit})", healthy)
    recording.log_threshold(whole(baseline.flight), norm.threshold, f"threshold ({norm.unit})", root)
    _log_false_alarms(recording, placed, {"threshold": norm.threshold, "armed_s": norm.armed_s})
    if isinstance(baseline.monitor, NormMonitor):
        _log_operator(recording, root, baseline.monitor)
    events = _healthy_events(baseline)
    for trial, path, tint in _tinted(placed):
        label, score = trial_label(trial), trial.watch.scores[norm.name]
        full = f"{trial.scenario} {path.rsplit('/', 1)[1]}"  # short, for the legend of all trials
        _log_measured(recording, trial, path, with_unit(full, trial.unit), tint)
        _log_residual(recording, path, full, tint, trial.watch)
        recording.log_line(f"{path}/norm", (score.known_s, score.values), label, tint)
        recording.log_mark(f"{path}/onset", trial.onset_s, 0.0, label, tint, SHAPES.Up)
        if trial.alarm_time_s is not None:
            at = trial.alarm_time_s, norm.threshold
            recording.log_mark(f"{path}/alarm", *at, label, tint, SHAPES.Down)
        recording.log_verdict(f"{path}/verdict", trial.row())
        events += trial_events(trial)
    recording.log_events(f"{root}/events", events)


def _log_scores(recording: Recording, placed: Placed) -> None:
    """Log a detector with several scores, or without any: signals around the onset, for a plot a trial."""
    baseline, root = placed.baseline, placed.root
    colours = tints(baseline.watch)
    pale = {name: lighter(tint) for name, tint in colours.items()}
    recording.log_judged(f"{root}/healthy", [baseline.watch], pale, ", healthy")
    recording.log_threshold(whole(baseline.flight), root=root)
    _log_false_alarms(recording, placed, {})
    recording.log_events(f"{root}/events", _healthy_events(baseline))
    for trial, path, tint in _tinted(placed):
        events, watch = trial_events(trial), trial.watch
        span = _logged_s(trial, events)
        _log_measured(recording, trial, path, with_unit(f"{trial.channel} measured", trial.unit), tint, span)
        virtual = part(watch.record.time_s, watch.virtual(trial.channel), span)
        _log_virtual(recording, f"{path}/virtual", virtual, with_unit("virtual sensor", trial.unit), trial.channel)
        recording.log_judged(path, [watch], {name: colours[name] for name in placed.entered(trial)}, "", span)
        marks = {"onset": trial.onset_s, "alarm": trial.alarm_time_s, "named": trial.isolated_s}
        recording.log_marks(path, marks.items())
        recording.log_verdict(f"{path}/verdict", trial.row())
        recording.log_events(f"{path}/events", events)


def _logged_s(trial: Trial, events: Sequence[Event]) -> Span:
    said = [time_s for time_s, _, _ in events if trial.detected]
    return trial.onset_s - _BEFORE_S, max([trial.onset_s + _AT_LEAST_S, *(time_s + _AFTER_S for time_s in said)])


def _log_false_alarms(recording: Recording, placed: Placed, known: dict[str, float | None]) -> None:
    baseline = placed.baseline
    counted = {**known, "false_alarms": baseline.false_alarms, "healthy_hours": baseline.healthy_hours}
    recording.log_verdict(f"{placed.root}/healthy/verdict", counted)


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
    recording: Recording, trial: Trial, path: str, name: str, tint: str, span: Span = (-np.inf, np.inf)
) -> None:
    """Log what the channels read that break in a trial, the first under a name and in a colour of the trial's."""
    for channel in trial.channels:
        measured = part(trial.record.time_s, trial.broken(channel), span)
        if channel == trial.channel:
            recording.log_line(f"{path}/measured", measured, name, tint, channel=channel, width=MEASURED)
        else:
            label, where = in_unit(f"{channel} measured", channel), entity(f"{path}/also", channel)
            recording.log_line(where, measured, label, colour(channel), channel=channel)


def _log_virtual(recording: Recording, entity: str, virtual: Signal, name: str, channel: str) -> None:
    """Log what a channel should have read, where that is known of any sample."""
    if np.isfinite(virtual[1]).any():
        recording.log_line(entity, virtual, name, COLOURS["virtual"], channel=channel, width=VIRTUAL)


def _log_residual(recording: Recording, root: str, label: str, tint: str, watch: Watch) -> None:
    """Log e(k) of every output, where there are residuals, in one colour."""
    outputs = list(watch.residuals)
    if outputs:
        several = len(outputs) > 1
        names = [f"{label}, e of {output}" if several else label for output in outputs]
        values = np.column_stack([watch.residuals[output] for output in outputs])
        colours = [tint] * len(outputs)
        recording.log_lines(f"{root}/residual", watch.record.time_s, values, names, colours, channels=outputs)


def _log_operator(recording: Recording, root: str, monitor: NormMonitor) -> None:
    operator = monitor.operator
    for o, output in enumerate(operator.outputs):
        for i, name in enumerate(operator.inputs):
            bars = rr.BarChart(operator.markov[:, o, i], abscissa=operator.lags, color=rgb(colour(name, i)))
            recording.stream.log(f"{root}/operator/{output}/{name}", bars, static=True)


# a watched log


def write_log_recording(watched: WatchedLog, path: Path) -> None:
    """Write a watched log with its blueprint; every viewer of the same rerun version opens it ready to read."""
    name = f"{printable(watched.log.path.name)}: {basis_of(watched.monitor).title}"
    with recorded(path, name, log_blueprint(watched)) as recording:
        _log_segments(recording, watched)
        if set(ATTITUDE) <= set(watched.log.channels):
            log_attitude(recording, watched.log.segments)
        if watched.watches:
            _log_virtual_sensors(recording, watched)
            colours, names = tints_of(watched), [*scores_of(watched), *residuals_of(watched)]
            recording.log_judged("", watched.watches, {name: colours[name] for name in names})
        recording.log_threshold(whole_s(watched.log))
        for alarm in watched.alarms[:MOST_ALARMS]:
            recording.log_marks("", [("began", began_s(alarm)), ("alarm", alarm.time_s), ("named", alarm.isolated_s)])
        _log_states(recording, watched)
        recording.log_events("/events", _log_story(watched), partial(beside_text, watched.log.zero_stamp))
        _log_outcome(recording, watched)


def _log_segments(recording: Recording, watched: WatchedLog) -> None:
    log, colours = watched.log, tints_of(watched)
    for name in log.channels:
        measured = joined([(segment.time_s, segment[name]) for segment in log.segments], log.sample_period_s)
        label = in_unit(f"{name} measured", name)
        recording.log_line(sensor_entity(name), measured, label, colours[name], channel=name, width=MEASURED)


def _log_virtual_sensors(recording: Recording, watched: WatchedLog) -> None:
    for name in signals_of(watched):
        parts = [(watch.record.time_s, watch.virtual(name)) for watch in watched.watches if name in watch.record]
        virtual = joined(parts, watched.log.sample_period_s)
        _log_virtual(recording, entity("/virtual", name), virtual, in_unit(f"{name} virtual sensor", name), name)


def _log_states(recording: Recording, watched: WatchedLog) -> None:
    colours = [[*rgb(tint), 255] for tint in STATES.values()]
    known = rr.StateConfiguration(values=list(STATES), colors=colours)
    for sensor in reported_sensors(watched.verdict):
        path, spans = entity("/state", sensor), watched.verdict.timeline.sensors[sensor]
        recording.stream.log(path, known, static=True)
        for span in spans:
            recording.set_time(span.start_s)
            recording.stream.log(path, rr.StateChange(state=str(span.state)))
        recording.set_time(spans[-1].end_s)
        recording.stream.log(path, rr.StateChange(state=""))  # it ends there


def _log_outcome(recording: Recording, watched: WatchedLog) -> None:
    results = log_results(watched)
    recording.log_verdict("/verdict", {name: results[name] for name in _OUTCOME})
    for number, finding in enumerate(results["findings"][:MOST_ALARMS], 1):
        row = {name: value for name, value in finding.items() if name != "judgements"}
        recording.log_verdict(f"/findings/{number}/verdict", row)


def _log_story(watched: WatchedLog) -> list[Event]:
    """Return remarks, what the log tells of, states of sensors, alarms and the outcome."""
    remarks, alarms = watched.log.remarks, watched.alarms[:MOST_ALARMS]
    dated = [(whole_s(watched.log)[0], "INFO", text) for text in stamped_text(watched.log, watched.verdict)]
    events: list[Event] = [(remark.start_s, "WARN", f"remark: {remark_text(remark)}") for remark in remarks]
    events += [(told.time_s, "INFO", f"the log reports: {event_text(told)}") for told in watched.log.events]
    timeline = watched.verdict.timeline
    for sensor in reported_sensors(watched.verdict):
        for span in timeline.sensors[sensor]:
            state = f"{sensor} until {span.end_s:.2f} s: {span.state}{span_text(sensor, span)}"
            events.append((span.start_s, "INFO", state))
    began = [(began_s(alarm), alarm) for alarm in alarms if began_s(alarm) < alarm.time_s]
    events += [(time_s, "WARN", f"{alarm.verdict}: it began about here") for time_s, alarm in began]
    events += watch_events(watched.watches)
    events += [(of.onset_s, "WARN", f"injected: {injection_text(of)}") for of in watched.log.injections]
    severity = {Outcome.FAILED: "CRITICAL", Outcome.UNKNOWN: "WARN", Outcome.HEALTHY: "INFO"}[watched.verdict.outcome]
    end_s, seen = whole_s(watched.log)[1], certificate_lines(watched.certificate)
    events += [(end_s, "INFO", "\n".join(seen))] if seen else []
    return [*dated, *events, (end_s, severity, f"outcome: {verdict_text(watched)}")]

"""Recordings of what an assertion failed on: a residual and its bound, or a monitor's watch and the fault.

==========================================  ===========================================================
entity                                      holds
==========================================  ===========================================================
``/sensors/NAME``                           the channels that were used, as they were read
``/virtual/NAME``                           what a channel should have read, as far as it is predicted
``/residuals/OUTPUT``                       e(k), at sample k
``/peaks/OUTPUT``, ``/thresholds/OUTPUT``   of a residual: where it was largest, and its bound
``/healthy/NAME``                           of a watch: the channel before the fault was injected
``/levels/OUTPUT``, ``/threshold``          of a watch: an alarm above 1, at the time when it is known
``/onset``, ``/due``, ``/alarms``           of a watch: one point each; ``due``: when an alarm was due
``/events``, ``/failed``                    what happened, in words, and what the assertion says
==========================================  ===========================================================

All on the timeline ``time``; values are doubles, bit for bit.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr

from gtmbench.detectors.protocol import Watch
from gtmbench.faults.fault import Fault
from gtmbench.method.residual import Residual
from gtmbench.report.recording.blueprint import failed_residual_blueprint, failed_watch_blueprint
from gtmbench.report.recording.entities import ONSET, SHAPES, Recording, entity, in_unit, lighter, recorded, whole
from gtmbench.report.style import COLOURS, colour, tints
from gtmbench.report.words.judgement import MOST_ALARMS, Event, fault_text, watch_events
from gtmbench.values.channels import unit_of
from gtmbench.values.record import FloatArray, Record, Span

_BEFORE_S, _AFTER_S = 20.0, 40.0  # shown before the first and after the last mark


def write_watch_recording(
    watch: Watch, path: Path, *, said: str, fault: Fault | None, healthy: Record | None, due_s: float | None
) -> None:
    """Write what a monitor said, with the fault, when its alarm was due, and what was said when."""
    events: list[Event] = [] if due_s is None else [(due_s, "WARN", "an alarm is due")]
    marks = [("alarms", alarm.time_s) for alarm in watch.alarms[:MOST_ALARMS]]
    marks += [] if due_s is None else [("due", due_s)]
    channels = dict.fromkeys(watch.monitor.channels or watch.record.channels)
    if fault is not None:
        events.append((fault.onset_s, "WARN", f"onset: {fault_text(fault)}"))
        marks.append(("onset", fault.onset_s))
        channels = {fault.channel: None} | channels
    blueprint = failed_watch_blueprint(watch, fault, _shown_s(watch.record, marks), list(channels))
    with recorded(path, "gtmbench: a watch that failed", blueprint) as recording:
        _log_channels(recording, watch.record, list(channels))
        if healthy is not None and fault is not None:
            name = fault.channel
            label, tint = in_unit(f"healthy {name}", name), COLOURS["healthy"]
            recording.log_line(entity("/healthy", name), (healthy.time_s, healthy[name]), label, tint)
        recording.log_judged("", [watch], tints(watch))
        for output, predicted in watch.predictions.items():
            _log_predicted(recording, watch.record, output, predicted)
        if watch.scores:
            recording.log_threshold(whole(watch.record))
        recording.log_marks("", marks)
        recording.log_events("/events", [*events, *watch_events([watch])])
        _log_text(recording, said)


def _shown_s(record: Record, marks: Sequence[tuple[str, float]]) -> Span:
    """Return the span about some marks; without any, the record's."""
    start_s, end_s = whole(record)
    times_s = [time_s for _, time_s in marks]
    return max(min(times_s, default=-np.inf) - _BEFORE_S, start_s), min(max(times_s, default=np.inf) + _AFTER_S, end_s)


def write_residual_recording(
    residual: Residual, path: Path, *, record: Record, inputs: Iterable[str], bounds: Mapping[str, float], said: str
) -> None:
    """Write a residual beside its bounds, with the channels that it stands on."""
    channels = tuple(dict.fromkeys((*residual.outputs, *inputs)))
    blueprint = failed_residual_blueprint(record, residual.outputs, channels)
    with recorded(path, "gtmbench: a residual that failed its bound", blueprint) as recording:
        _log_channels(recording, record, channels)
        for o, output in enumerate(residual.outputs):
            _log_bounded(recording, record, residual, o, bounds[output])
        _log_text(recording, said)


def _log_bounded(recording: Recording, record: Record, residual: Residual, o: int, bound: float) -> None:
    """Log the residual of an output, its bound, and where it was largest."""
    output, values, time_s = residual.outputs[o], residual.values[:, o], residual.time_s
    label = in_unit(f"residual of {output}", output)
    recording.log_line(entity("/residuals", output), (time_s, values), label, colour(output, o))
    if output in record and len(record) == len(values):  # a function of the user's may have decimated
        _log_predicted(recording, record, output, record[output] - values)
    ends, allowed = np.array(whole(record)), np.array([[-bound, bound]] * 2)
    red = COLOURS["threshold"]
    recording.log_lines(entity("/thresholds", output), ends, allowed, ["least allowed", "most allowed"], [red, red])
    if not np.isnan(values).all():
        peak = int(np.nanargmax(np.abs(values)))
        at_s, value = float(time_s[peak]), float(values[peak])
        recording.log_mark(entity("/peaks", output), at_s, value, "the largest", ONSET, SHAPES.Diamond)
        recording.log_events("/events", [(at_s, "INFO", f"residual of {output}: {value:.4g} {unit_of(output)}")])


def _log_channels(recording: Recording, record: Record, channels: Sequence[str]) -> None:
    for i, name in enumerate(channels):
        if name in record:
            label, tint = in_unit(f"measured {name}", name), lighter(colour(name, i))
            recording.log_line(entity("/sensors", name), (record.time_s, record[name]), label, tint)


def _log_predicted(recording: Recording, record: Record, name: str, values: FloatArray) -> None:
    label = in_unit(f"predicted {name}", name)
    recording.log_line(entity("/virtual", name), (record.time_s, values), label, COLOURS["virtual"])


def _log_text(recording: Recording, said: str) -> None:
    recording.stream.log("/failed", rr.TextDocument(said), static=True)

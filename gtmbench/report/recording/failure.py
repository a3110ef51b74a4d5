"""What an assertion failed on, as a rerun recording: a residual and its bound, or a monitor's watch and the fault.

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

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gtmbench.channels import unit_of
from gtmbench.detectors.protocol import Watch
from gtmbench.faults.fault import Fault
from gtmbench.method.residual import Residual
from gtmbench.record import FloatArray, Record, Span
from gtmbench.report.recording.lines import (
    ONSET,
    SHAPES,
    entity,
    lighter,
    log_events,
    log_judged,
    log_lines,
    log_mark,
    log_marks,
    log_threshold,
    recorded,
)
from gtmbench.report.recording.views import event_log, opened, plot, whole
from gtmbench.report.scores import SHOWN_LEVELS, tints
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.words.judgement import MOST_ALARMS, Event, fault_text, watch_events
from gtmbench.report.words.units import with_unit

_BEFORE_S, _AFTER_S = 20.0, 40.0  # shown before the first and after the last mark


@dataclass(frozen=True, kw_only=True, eq=False)
class FailedWatch:
    """A watch that an assertion didn't accept.

    Attributes
    ----------
    watch : Watch
        With the fault, where there is one; of a detector that shows no scores, there are alarms only.
    fault : Fault or None
    healthy : Record or None
        Before the fault was injected.
    due_s : float or None
        When an alarm was due.
    said : str
        By the assertion.
    """

    watch: Watch = field(repr=False)
    fault: Fault | None = None
    healthy: Record | None = field(default=None, repr=False)
    due_s: float | None = None
    said: str


def write_residual_recording(
    path: Path, record: Record, found: Residual, bounds: Mapping[str, float], inputs: Iterable[str], said: str
) -> None:
    """Write a residual beside its bounds, with the channels that it stands on."""
    plots = []
    for output in found.outputs:
        contents = [f"+ {entity(f'/{kind}', output)}" for kind in ("residuals", "peaks", "thresholds")]
        plots.append(plot(f"residual of {output} and its bound", contents, whole(record)))
    channels = tuple(dict.fromkeys((*found.outputs, *inputs)))
    blueprint = opened(_front("Residuals", plots), _sensors_tab(record, channels))
    with recorded(path, "gtmbench: a residual that failed its bound", blueprint) as recording:
        _log_sensors(recording, record, channels)
        for o, output in enumerate(found.outputs):
            _log_residual(recording, record, found, o, bounds[output])
        _log_said(recording, said)


def _log_residual(recording: rr.RecordingStream, record: Record, found: Residual, o: int, bound: float) -> None:
    output, values = found.outputs[o], found.values[:, o]
    tint = colour(output, o)
    log_lines(
        recording,
        entity("/residuals", output),
        found.time_s,
        values,
        [with_unit(f"residual of {output}", unit_of(output))],
        [tint],
    )
    if output in record and len(record) == len(values):  # a function of the user's may have decimated
        _log_virtual(recording, record, output, record[output] - values)
    ends, allowed = np.array([record.start_s, record.end_s]), np.array([[-bound, bound]] * 2)
    red = COLOURS["threshold"]
    log_lines(recording, entity("/thresholds", output), ends, allowed, ["least allowed", "most allowed"], [red, red])
    if not np.isnan(values).all():
        peak = int(np.nanargmax(np.abs(values)))
        time_s, value = float(found.time_s[peak]), float(values[peak])
        log_mark(recording, entity("/peaks", output), time_s, value, "the largest", ONSET, SHAPES.Diamond)
        log_events(recording, "/events", [(time_s, "INFO", f"residual of {output}: {value:.4g} {unit_of(output)}")])


def write_watch_recording(path: Path, failed: FailedWatch) -> None:
    """Write what a monitor said, with the fault, when its alarm was due, and what was said when."""
    channels, watch = _channels(failed), failed.watch
    with recorded(path, "gtmbench: a watch that failed", _watch_blueprint(failed, channels)) as recording:
        _log_sensors(recording, watch.record, channels)
        if failed.healthy is not None and failed.fault is not None:
            name, of = failed.fault.channel, failed.healthy
            line = [with_unit(f"healthy {name}", unit_of(name))], [COLOURS["healthy"]]
            log_lines(recording, entity("/healthy", name), of.time_s, of[name], *line)
        log_judged(recording, "", [watch], tints(watch))
        for output, predicted in watch.predictions.items():
            _log_virtual(recording, watch.record, output, predicted)
        if watch.scores:
            log_threshold(recording, whole(watch.record))
        log_marks(recording, "", _marks(failed))
        log_events(recording, "/events", _events(failed))
        _log_said(recording, failed.said)


def _watch_blueprint(failed: FailedWatch, channels: tuple[str, ...]) -> rrb.Blueprint:
    span, watch = _shown_s(failed), failed.watch
    levels = ["+ /levels/**", "+ /threshold", "+ /onset", "+ /due", "+ /alarms"]
    plots = [plot("levels: an alarm above 1" if watch.scores else "alarms", levels, span, top=SHOWN_LEVELS)]
    if failed.fault is not None:
        plots.append(_channel_plot(failed.fault.channel, span))
    if watch.residuals:
        plots.append(plot("residuals", ["+ /residuals/**"], span))
    return opened(_front("Alarms", plots), _sensors_tab(watch.record, channels))


def _channels(failed: FailedWatch) -> tuple[str, ...]:
    used = failed.watch.monitor.channels or failed.watch.record.channels
    broken = () if failed.fault is None else (failed.fault.channel,)
    return tuple(dict.fromkeys((*broken, *used)))


def _marks(failed: FailedWatch) -> list[tuple[str, float]]:
    marks = [("alarms", alarm.time_s) for alarm in failed.watch.alarms[:MOST_ALARMS]]
    if failed.due_s is not None:
        marks.append(("due", failed.due_s))
    if failed.fault is not None:
        marks.append(("onset", failed.fault.onset_s))
    return marks


def _events(failed: FailedWatch) -> list[Event]:
    events: list[Event] = []
    if failed.fault is not None:
        events.append((failed.fault.onset_s, "WARN", f"onset: {fault_text(failed.fault)}"))
    if failed.due_s is not None:
        events.append((failed.due_s, "WARN", "an alarm is due"))
    return events + watch_events([failed.watch])


def _shown_s(failed: FailedWatch) -> Span:
    marks = [time_s for _, time_s in _marks(failed)]
    start_s, end_s = whole(failed.watch.record)
    return (max(min(marks) - _BEFORE_S, start_s), min(max(marks) + _AFTER_S, end_s)) if marks else (start_s, end_s)


def _log_sensors(recording: rr.RecordingStream, record: Record, channels: tuple[str, ...]) -> None:
    for i, name in enumerate(channels):
        if name in record:
            line = [with_unit(f"measured {name}", unit_of(name))], [lighter(colour(name, i))]
            log_lines(recording, entity("/sensors", name), record.time_s, record[name], *line)


def _log_virtual(recording: rr.RecordingStream, record: Record, name: str, values: FloatArray) -> None:
    line = [with_unit(f"predicted {name}", unit_of(name))], [COLOURS["virtual"]]
    log_lines(recording, entity("/virtual", name), record.time_s, values, *line)


def _log_said(recording: rr.RecordingStream, said: str) -> None:
    recording.log("/failed", rr.TextDocument(said), static=True)


def _front(name: str, plots: list[rrb.TimeSeriesView]) -> rrb.Container:
    words = rrb.Vertical(event_log(["+ /events"]), rrb.TextDocumentView(name="what failed", origin="/failed"))
    return rrb.Horizontal(rrb.Vertical(*plots), words, column_shares=[5, 2], name=name)


def _sensors_tab(record: Record, channels: tuple[str, ...]) -> rrb.Container:
    return rrb.Grid(*(_channel_plot(name, whole(record)) for name in channels), grid_columns=2, name="Sensors")


def _channel_plot(name: str, span: Span) -> rrb.TimeSeriesView:
    contents = [f"+ {entity(f'/{kind}', name)}" for kind in ("healthy", "virtual", "sensors")]
    return plot(with_unit(name, unit_of(name)), contents, span)

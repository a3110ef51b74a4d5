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

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gtmbench.bench.fault import Fault
from gtmbench.channels import unit_of
from gtmbench.detectors.protocol import Watch
from gtmbench.method.residual import Residual
from gtmbench.record import FloatArray, Record, Span
from gtmbench.report.lines import Event, lighter, log_events, log_lines, log_mark, log_threshold
from gtmbench.report.monitor_recording import finding_events, log_judged
from gtmbench.report.style import COLOURS, colour
from gtmbench.report.text import fault_text, with_unit
from gtmbench.report.views import event_log, opened, plot, whole

_LEVELS = 4.0  # the levels' axis ends at this many thresholds
_MOST_ALARMS = 100  # that are shown: a function of the user's may call every sample above a threshold one
_BEFORE_S, _AFTER_S = 20.0, 40.0  # shown before the first and after the last mark
_ONSET = "#d0d0d0"  # seen on light and on dark
_SHAPES = rr.components.MarkerShape


@dataclass(frozen=True, kw_only=True, eq=False)
class FailedWatch:
    """A watch that an assertion didn't accept.

    Attributes
    ----------
    record : Record
        What was watched: with the fault, where there is one.
    alarms_s : tuple of float
    seen : Watch or None
        None where a function of the user's own raised the alarms.
    fault : Fault or None
    healthy : Record or None
        Before the fault was injected.
    due_s : float or None
        When an alarm was due.
    said : str
        By the assertion.
    """

    record: Record = field(repr=False)
    alarms_s: tuple[float, ...]
    seen: Watch | None = field(repr=False)
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
        contents = [f"+ /{kind}/{_part(output)}" for kind in ("residuals", "peaks", "thresholds")]
        plots.append(plot(f"residual of {output} and its bound", contents, whole(record)))
    channels = tuple(dict.fromkeys((*found.outputs, *inputs)))
    blueprint = opened(_front("Residuals", plots), _sensors_tab(record, channels))
    with _recorded(path, "gtmbench: a residual that failed its bound", blueprint) as recording:
        _log_sensors(recording, record, channels)
        for o, output in enumerate(found.outputs):
            _log_residual(recording, record, found, o, bounds[output])
        _log_said(recording, said)


def _log_residual(recording: rr.RecordingStream, record: Record, found: Residual, o: int, bound: float) -> None:
    output, values = found.outputs[o], found.values[:, o]
    part, tint = _part(output), colour(output, o)
    log_lines(
        recording,
        f"/residuals/{part}",
        found.time_s,
        values,
        [with_unit(f"residual of {output}", unit_of(output))],
        [tint],
    )
    if output in record and len(record) == len(values):  # a function of the user's may have decimated
        _log_virtual(recording, record, output, record[output] - values)
    ends, allowed = np.array([record.start_s, record.end_s]), np.array([[-bound, bound]] * 2)
    red = COLOURS["threshold"]
    log_lines(recording, f"/thresholds/{part}", ends, allowed, ["least allowed", "most allowed"], [red, red])
    if not np.isnan(values).all():
        peak = int(np.nanargmax(np.abs(values)))
        time_s, value = float(found.time_s[peak]), float(values[peak])
        log_mark(recording, f"/peaks/{part}", time_s, value, "the largest", _ONSET, _SHAPES.Diamond)
        log_events(recording, "/events", [(time_s, "INFO", f"residual of {output}: {value:.4g} {unit_of(output)}")])


def write_watch_recording(path: Path, failed: FailedWatch) -> None:
    """Write what a monitor saw, with the fault, when its alarm was due, and what was said when."""
    channels = _channels(failed)
    with _recorded(path, "gtmbench: a watch that failed", _watch_blueprint(failed, channels)) as recording:
        _log_sensors(recording, failed.record, channels)
        if failed.healthy is not None and failed.fault is not None:
            name, of = failed.fault.channel, failed.healthy
            log_lines(
                recording,
                f"/healthy/{_part(name)}",
                of.time_s,
                of[name],
                [with_unit(f"healthy {name}", unit_of(name))],
                [COLOURS["healthy"]],
            )
        if failed.seen is not None:
            tints = {output: colour(output, i) for i, output in enumerate(failed.seen.levels)}
            log_judged(recording, "", [failed.seen], tints)
            for output, predicted in failed.seen.residuals.predicted.items():
                _log_virtual(recording, failed.record, output, predicted)
            log_threshold(recording, failed.record, 1.0, "threshold", COLOURS["threshold"])
        for entity, time_s, tint, shape in _marks(failed):
            log_mark(recording, f"/{entity}", time_s, 1.0, entity, tint, shape)
        log_events(recording, "/events", _events(failed))
        _log_said(recording, failed.said)


def _watch_blueprint(failed: FailedWatch, channels: tuple[str, ...]) -> rrb.Blueprint:
    span = _shown_s(failed)
    levels = ["+ /levels/**", "+ /threshold", "+ /onset", "+ /due", "+ /alarms"]
    plots = [plot("levels: an alarm above 1" if failed.seen else "alarms", levels, span, top=_LEVELS)]
    if failed.fault is not None:
        plots.append(_channel_plot(failed.fault.channel, span))
    if failed.seen is not None:
        plots.append(plot("residuals", ["+ /residuals/**"], span))
    return opened(_front("Alarms", plots), _sensors_tab(failed.record, channels))


def _channels(failed: FailedWatch) -> tuple[str, ...]:
    used = failed.record.channels if failed.seen is None else failed.seen.monitor.bank.channels
    broken = () if failed.fault is None else (failed.fault.channel,)
    return tuple(dict.fromkeys((*broken, *used)))


def _marks(failed: FailedWatch) -> Iterator[tuple[str, float, str, rr.components.MarkerShape]]:
    if failed.fault is not None:
        yield "onset", failed.fault.onset_s, _ONSET, _SHAPES.Up
    if failed.due_s is not None:
        yield "due", failed.due_s, COLOURS["beta"], _SHAPES.Diamond
    for alarm_s in failed.alarms_s[:_MOST_ALARMS]:
        yield "alarms", alarm_s, COLOURS["threshold"], _SHAPES.Down


def _events(failed: FailedWatch) -> list[Event]:
    events: list[Event] = []
    if failed.fault is not None:
        events.append((failed.fault.onset_s, "WARN", f"onset: {fault_text(failed.fault)}"))
    if failed.due_s is not None:
        events.append((failed.due_s, "WARN", "an alarm is due"))
    if failed.seen is None:
        return events + [(alarm_s, "ERROR", "alarm") for alarm_s in failed.alarms_s[:_MOST_ALARMS]]
    return events + [event for finding in failed.seen.findings for event in finding_events(finding, "alarm")]


def _shown_s(failed: FailedWatch) -> Span:
    marks = [time_s for _, time_s, _, _ in _marks(failed)]
    start_s, end_s = whole(failed.record)
    return (max(min(marks) - _BEFORE_S, start_s), min(max(marks) + _AFTER_S, end_s)) if marks else (start_s, end_s)


@contextmanager
def _recorded(path: Path, name: str, blueprint: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    rr.set_strict_mode(True)  # an error must not become a warning and lost data
    recording = rr.RecordingStream("gtmbench")  # a fresh recording id: two of one id don't open side by side
    recording.save(path, default_blueprint=blueprint)
    recording.send_recording_name(name)
    try:
        yield recording
    finally:
        recording.disconnect()  # writes the footer


def _log_sensors(recording: rr.RecordingStream, record: Record, channels: tuple[str, ...]) -> None:
    for i, name in enumerate(channels):
        if name in record:
            line = [with_unit(f"measured {name}", unit_of(name))], [lighter(colour(name, i))]
            log_lines(recording, f"/sensors/{_part(name)}", record.time_s, record[name], *line)


def _log_virtual(recording: rr.RecordingStream, record: Record, name: str, values: FloatArray) -> None:
    line = [with_unit(f"predicted {name}", unit_of(name))], [COLOURS["virtual"]]
    log_lines(recording, f"/virtual/{_part(name)}", record.time_s, values, *line)


def _log_said(recording: rr.RecordingStream, said: str) -> None:
    recording.log("/failed", rr.TextDocument(said), static=True)


def _front(name: str, plots: list[rrb.TimeSeriesView]) -> rrb.Container:
    words = rrb.Vertical(event_log(["+ /events"]), rrb.TextDocumentView(name="what failed", origin="/failed"))
    return rrb.Horizontal(rrb.Vertical(*plots), words, column_shares=[5, 2], name=name)


def _sensors_tab(record: Record, channels: tuple[str, ...]) -> rrb.Container:
    return rrb.Grid(*(_channel_plot(name, whole(record)) for name in channels), grid_columns=2, name="Sensors")


def _channel_plot(name: str, span: Span) -> rrb.TimeSeriesView:
    contents = [f"+ /{kind}/{_part(name)}" for kind in ("healthy", "virtual", "sensors")]
    return plot(with_unit(name, unit_of(name)), contents, span)


def _part(name: str) -> str:
    return rr.escape_entity_path_part(name)  # a channel's name may hold anything

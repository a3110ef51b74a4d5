"""A watch, recorded: one that grows while a flight is watched, and one, or a residual, that an assertion failed on.

While it flies, its entities are those of a watched log (`write`). Test statistics are those of `monitor.watch` of the
last `SPAN_S`: a bank looks back no farther, so before a first alarm the newest rows have the values that the watch
itself judged.

==========================================  ===========================================================
entity, of what failed                      holds
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

from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.protocol import Monitor, Watch
from gtmbench.faults.fault import Fault
from gtmbench.method.residual import Residual
from gtmbench.report.recording.blueprint import (
    Playing,
    about_cursor,
    beside,
    event_log,
    failed_residual_blueprint,
    failed_watch_blueprint,
    in_pairs,
    judged_plots,
    opened,
    plot,
    signal_plots,
)
from gtmbench.report.recording.entities import (
    MEASURED,
    ONSET,
    SHAPES,
    VIRTUAL,
    RecordedLine,
    Recording,
    entity,
    in_unit,
    judged_lines,
    lighter,
    recorded,
    sensor_entity,
    whole,
)
from gtmbench.report.style import COLOURS, SHOWN_LEVELS, colour, colours, tints
from gtmbench.report.words.events import MOST_ALARMS, Event, watch_events
from gtmbench.report.words.judgement import fault_text
from gtmbench.values.channels import unit_of
from gtmbench.values.record import FloatArray, Record, Span, joined

# a bank looks back less far: 20.5 s, and two stretches of a minute before that its noise is learnt from
SPAN_S = 180.0
_SHOWN_S = 60.0  # in the viewer while it flies


class LiveRecording:
    """A recording of one sender's clock."""

    def __init__(self, monitor: Monitor, recording: rr.RecordingStream) -> None:
        self._monitor, self._recording = monitor, Recording(stream=recording)
        self._window: Record | None = None
        self._fresh: list[Record] = []
        self._sent: dict[str, float] = {}  # entity -> time of the last value that is there
        self._watch: Watch | None = None
        self._start_s = 0.0
        recording.send_recording_name(f"live: {basis_of(monitor).title}")

    @property
    def end_s(self) -> float | None:
        """When the last row was; None before the first."""
        return None if self._last is None else self._last.end_s

    @property
    def _last(self) -> Record | None:
        return self._fresh[-1] if self._fresh else self._window

    @property
    def waiting_s(self) -> float:
        """How long the rows are that aren't drawn yet."""
        return sum(map(len, self._fresh)) * self._fresh[0].sample_period_s if self._fresh else 0.0

    def take(self, rows: Record) -> None:
        """Keep some rows until `draw`; where they don't go on, the window begins anew."""
        last = self._last
        if last is None:
            self._start_s = rows.start_s
        elif (
            abs(rows.start_s - last.end_s - rows.sample_period_s) > 0.5 * rows.sample_period_s
            or last.channels != rows.channels
        ):
            self.draw()
            self._window = None
        self._fresh.append(rows)

    def draw(self) -> None:
        """Judge the rows that were taken, and log what is new."""
        if not self._fresh:
            return
        parts = [*([] if self._window is None else [self._window]), *self._fresh]
        self._fresh = []
        record = joined(parts)
        watch = self._monitor.watch(record)
        self._window = record.part(range(max(len(record) - round(SPAN_S / record.sample_period_s), 0), len(record)))
        is_first, self._watch = self._watch is None, watch
        if is_first:
            self._recording.stream.send_blueprint(_blueprint(watch, about_cursor(_SHOWN_S, 2.0), playing="following"))
        for line in _lines(watch):
            self._log(line)

    def _log(self, line: RecordedLine) -> None:
        """Log what is new of a line: what is known of it later than what was sent before."""
        time_s, values = line.signal
        last_s = self._sent.get(line.entity)
        is_new = time_s > (-np.inf if last_s is None else last_s + 1e-9)
        known = is_new & np.isfinite(values)
        if not known.any():
            return
        if last_s is None:
            channels = [line.channel] if line.channel else ()
            self._recording.style_lines(line.entity, [line.name], [line.tint], channels=channels, width=line.width)
        self._recording.send_lines(line.entity, time_s[is_new], values[is_new], goes_on=last_s is not None)
        self._sent[line.entity] = float(time_s[known][-1])

    def tell(self, time_s: float, severity: str, text: str, alarm: Alarm | None) -> None:
        """Log what was said; of an alarm also when it was raised and named."""
        self._recording.log_text("/events", time_s, severity, f"{time_s:.2f} s  {text}")
        if alarm is not None:
            self._recording.log_marks("", [("alarm", alarm.time_s), ("named", alarm.isolated_s)])

    def end(self, verdict: Mapping[str, object]) -> None:
        """Log what is left and the verdict, and let the recording open with the whole flight."""
        self.draw()
        self._recording.log_verdict("/verdict", verdict)
        if self._watch is not None and self.end_s is not None:
            span = (self._start_s, max(self.end_s, self._start_s + self._watch.record.sample_period_s))
            self._recording.stream.send_blueprint(_blueprint(self._watch, span, playing="paused"))


def _lines(watch: Watch) -> Iterator[RecordedLine]:
    record, look = watch.record, colours([*tints(watch), *watch.record.channels])
    for name in record.channels:
        label = in_unit(f"{name} measured", name)
        yield RecordedLine(sensor_entity(name), (record.time_s, record[name]), label, look[name], name, MEASURED)
    for name, predicted in watch.predictions.items():
        label = in_unit(f"{name} virtual sensor", name)
        yield RecordedLine(
            entity("/virtual", name), (record.time_s, predicted), label, COLOURS["virtual"], name, VIRTUAL
        )
    yield from judged_lines([watch], tints(watch))
    ones = np.ones(len(record))
    yield RecordedLine("/threshold", (record.time_s, ones), "threshold", COLOURS["threshold"], "")


def _blueprint(watch: Watch, shown_s: Span | rrb.TimeAxis, *, playing: Playing) -> rrb.Blueprint:
    """Return how it opens: levels, measured and virtual sensors and what was said; residuals; sensors."""
    channels = watch.record.channels
    signals = [name for name in (watch.predictions or channels) if name in channels]
    levels = plot("levels", ["/threshold", "/levels/**", "/alarm", "/named"], shown_s, top=SHOWN_LEVELS)
    grid = signal_plots(signals, "measured and virtual", shown_s)
    roots = {name: [""] for name in tints(watch)}
    judged = judged_plots(roots, watch.residuals, watch.scores, "/threshold", shown_s)
    sensors = in_pairs([plot(in_unit(name, name), [sensor_entity(name)], shown_s) for name in channels], "Sensors")
    first = beside(rrb.Vertical(levels, grid, row_shares=[3, 5]), event_log("/events"), "Flight")
    return opened(first, *([in_pairs(judged, "Residuals")] if judged else []), sensors, playing=playing)


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

"""What every recording is made of: one timeline, entities with lines, scores, marks, events and verdicts."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyarrow as pa
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from gtmbench.detectors.protocol import Watch
from gtmbench.files.writing import atomic_write
from gtmbench.report.style import COLOURS, colour, level, part
from gtmbench.report.words.events import Event
from gtmbench.report.words.judgement import repetitions
from gtmbench.report.words.units import with_unit
from gtmbench.study.trial import InjectedFaults
from gtmbench.values.channels import GYROS, unit_of
from gtmbench.values.record import FloatArray, Record, Span

Signal = tuple[FloatArray, FloatArray]  # times in s, values

TIMELINE = "time"  # seconds of the flight, to the nanosecond
GROUPS = {
    "rates": GYROS,
    "wind": ("alpha", "beta"),
    "attitude": ("phi", "theta"),
    "heading": ("psi",),  # goes round, and nz is 1 g and more: what moves less would lie flat beside them
    "load": ("nx", "ny"),
    "lift": ("nz",),
    "speed": ("tas",),
    "altitude": ("altitude",),
}
ONSET = "#d0d0d0"  # a mark's colour that is seen on light and on dark
SHAPES = rr.components.MarkerShape
MEASURED, VIRTUAL = 2.5, 1.0  # widths of lines that lie on each other: both are to be seen
_MARKS = {
    "onset": (ONSET, SHAPES.Up),
    "began": (ONSET, SHAPES.Up),
    "due": (COLOURS["beta"], SHAPES.Diamond),
    "alarm": (COLOURS["threshold"], SHAPES.Down),
    "alarms": (COLOURS["threshold"], SHAPES.Down),
    "named": (COLOURS["beta"], SHAPES.Diamond),
}


@contextmanager
def recorded(path: Path, name: str, blueprint: rrb.Blueprint) -> Iterator[Recording]:
    """Give a recording to log into, and write it with its blueprint; a viewer of the same rerun version opens it.

    Rerun encodes into memory, and the file is written here: on a full disk its own writer ends without a word, and who
    asks it to flush may wait for ever.
    """
    rr.set_strict_mode(True)  # an error must not become a warning and lost data
    recording = rr.RecordingStream("gtmbench")  # a fresh recording id: two of one id don't open side by side
    with atomic_write(path) as aside:
        encoded = rr.binary_stream(recording)
        recording.send_blueprint(blueprint, make_active=False, make_default=True)
        recording.send_recording_name(name)
        try:
            yield Recording(stream=recording)
            aside.write_bytes(encoded.read() or b"")  # to its footer; it can be read once
        finally:
            recording.disconnect()


def times(time_s: FloatArray) -> rr.TimeColumn:
    """Return times as rerun takes them: whole nanoseconds, for it cuts float seconds off."""
    return rr.TimeColumn(TIMELINE, duration=np.rint(time_s * 1e9).astype("timedelta64[ns]"))


def whole(record: Record) -> Span:
    """Return the span of a record."""
    return record.start_s, record.end_s


def in_unit(what: str, channel: str) -> str:
    """Write a channel's unit behind what is in it."""
    return with_unit(what, unit_of(channel))


def entity(root: str, name: str) -> str:
    """Return the entity below a root of anything with a name, whatever it holds."""
    return f"{root}/{rr.escape_entity_path_part(name)}"


def sensor_entity(channel: str) -> str:
    """Return the entity of a log's channel: ``/sensors/rates/p``, ``/sensors/other/...``."""
    group = next((group for group, members in GROUPS.items() if channel in members), "other")
    return entity(f"/sensors/{group}", channel)


def trial_paths(trials: Sequence[InjectedFaults]) -> list[str]:
    """Return the entities of a detector's trials: ``/trials/drift/p``, numbered where a channel breaks twice."""
    often = Counter((trial.scenario, trial.channel) for trial in trials)
    paths = []
    for trial, repetition in zip(trials, repetitions(trials), strict=True):
        several = often[trial.scenario, trial.channel] > 1
        label = f"{trial.channel}_{repetition + 1}" if several else trial.channel
        paths.append(rr.new_entity_path(["trials", trial.scenario, label]))  # escapes what a file's name may hold
    return paths


def trial_tints(trials: Sequence[InjectedFaults]) -> list[str]:
    """Return every trial's colour: its channel's, lighter for every further severity."""
    tints = []
    for trial, repetition in zip(trials, repetitions(trials), strict=True):
        tint = colour(trial.channel)
        for _ in range(repetition):
            tint = lighter(tint)
        tints.append(tint)
    return tints


def rgb(tint: str) -> list[int]:
    """Return a colour's red, green and blue, 0 to 255."""
    return [int(tint[i : i + 2], 16) for i in (1, 3, 5)]


def lighter(tint: str) -> str:
    """Return a colour half-way to white."""
    return "#" + "".join(f"{(value + 255) // 2:02x}" for value in rgb(tint))


def _sent(there: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Return the rows to send: those that are there, and the first of every interruption."""
    rows = np.flatnonzero(there)
    sent = np.array(there)
    sent[rows[:-1][np.diff(rows) > 1] + 1] = True
    return sent


def joined(parts: Sequence[Signal], sample_period_s: float) -> Signal:
    """Return stretches of a signal as one, a missing row after each: no line runs over a gap."""
    time_s = [stamp for when, _ in parts for stamp in (when, when[-1:] + sample_period_s)]
    values = [row for _, of in parts for row in (of, np.full_like(of[-1:], np.nan))]
    return np.concatenate(time_s), np.concatenate(values)


class RecordedLine(NamedTuple):
    """A line of a recording: its entity, times and values, how it is called and looks."""

    entity: str
    signal: Signal
    name: str
    tint: str
    channel: str
    width: float = 1.5


def judged_lines(
    watches: Sequence[Watch], tints: Mapping[str, str], suffix: str = "", span: Span = (-np.inf, np.inf)
) -> Iterator[RecordedLine]:
    """Give the lines of `log_judged`."""
    period_s = watches[0].record.sample_period_s
    for name, tint in tints.items():
        if name in watches[0].residuals:
            parts = [part(watch.record.time_s, watch.residuals[name], span) for watch in watches]
            label = in_unit(f"residual of {name}{suffix}", name)
            yield RecordedLine(entity("/residuals", name), joined(parts, period_s), label, tint, name)
        if name in watches[0].scores:
            scores = [watch.scores[name] for watch in watches]
            parts = [part(score.known_s, level(score), span) for score in scores]
            yield RecordedLine(
                entity("/levels", name), joined(parts, period_s), f"test statistic of {name}{suffix}", tint, name
            )


def _flat(name: str, value: object) -> Iterator[tuple[str, object]]:
    if isinstance(value, (Mapping, list, tuple)):
        for key, of in value.items() if isinstance(value, Mapping) else enumerate(value):
            yield from _flat(f"{name}.{key}", of)
    else:
        yield name, value


@dataclass(frozen=True, kw_only=True)
class Recording:
    """A recording to log into."""

    stream: rr.RecordingStream

    def set_time(self, time_s: float) -> None:
        """Set the time of what is logged next."""
        self.stream.set_time(TIMELINE, duration=np.timedelta64(round(time_s * 1e9), "ns"))

    def style_lines(
        self, entity: str, names: list[str], tints: list[str], *, channels: Sequence[str] = (), width: float = 1.5
    ) -> None:
        """Send how lines are called and look, without their values."""
        style = rr.SeriesLines(names=names, colors=[*map(rgb, tints)], widths=width, aggregation_policy="MinMax")
        self.stream.log(entity, style, static=True)
        if channels:
            components = {"channels": pa.array(channels)}
            self.stream.log(entity, rr.DynamicArchetype("Lines", components=components), static=True)

    def log_lines(
        self,
        entity: str,
        time_s: FloatArray,
        values: FloatArray,
        names: list[str],
        tints: list[str],
        *,
        channels: Sequence[str] = (),
        width: float = 1.5,
    ) -> None:
        """Send lines of a unit as columns, with names and colours.

        Rows that are missing stay out; one without values stands for those between others, and breaks the line there.
        `names` are what the viewer shows; `channels`, where the lines are channels, what `read_recording` calls them.
        """
        self.style_lines(entity, names, tints, channels=channels, width=width)
        self.send_lines(entity, time_s, values)

    def send_lines(self, entity: str, time_s: FloatArray, values: FloatArray, *, goes_on: bool = False) -> int:
        """Send the values of lines, and return how many rows; those that go on from earlier values break as others."""
        table = values.reshape(len(time_s), -1)
        there = np.asarray(np.isfinite(table).all(axis=1))
        sent = _sent(np.append(True, there))[1:] if goes_on else _sent(there)
        columns = rr.Scalars.columns(scalars=table[there].ravel()).partition(table.shape[1] * there[sent])
        self.stream.send_columns(entity, indexes=[times(time_s[sent])], columns=columns)
        return int(sent.sum())

    def log_line(
        self, entity: str, signal: Signal, name: str, tint: str, *, channel: str = "", width: float = 1.5
    ) -> None:
        """Send one line, as `log_lines` does several."""
        channels = [channel] if channel else ()
        self.log_lines(entity, *signal, [name], [tint], channels=channels, width=width)

    def log_threshold(self, span: Span, value: float = 1.0, name: str = "threshold", root: str = "") -> None:
        """Log ``/threshold``, from the beginning of a span to its end."""
        self.log_line(f"{root}/threshold", (np.array(span), np.full(2, value)), name, COLOURS["threshold"])

    def log_judged(
        self,
        root: str,
        watches: Sequence[Watch],
        tints: Mapping[str, str],
        suffix: str = "",
        span: Span = (-np.inf, np.inf),
    ) -> None:
        """Log ``residuals/OUTPUT`` and ``levels/SCORE``, as far as they have a colour, of one stretch or several."""
        for line in judged_lines(watches, tints, suffix, span):
            self.log_line(f"{root}{line.entity}", line.signal, line.name, line.tint, channel=line.channel)

    def log_mark(self, entity: str, time_s: float, value: float, name: str, tint: str, marker: SHAPES) -> None:
        """Log one point."""
        style = rr.SeriesPoints(names=name, colors=rgb(tint), markers=marker, marker_sizes=6.0)
        self.stream.log(entity, style, static=True)
        self.set_time(time_s)
        self.stream.log(entity, rr.Scalars(value))

    def log_marks(self, root: str, marks: Iterable[tuple[str, float | None]]) -> None:
        """Log points beside scores, at the threshold, each of a name in the same look everywhere; some have no time."""
        for name, time_s in marks:
            if time_s is not None:
                self.log_mark(f"{root}/{name}", time_s, 1.0, name, *_MARKS[name])

    def log_events(self, entity: str, events: Iterable[Event], beside: Callable[[float], str] = lambda _: "") -> None:
        """Log what happened, in words, in time; with what stands beside the seconds, such as a log's own stamps."""
        for time_s, severity, text in sorted(events):
            self.log_text(entity, time_s, severity, f"{time_s:z.2f} s{beside(time_s)}  {text}")

    def log_text(self, entity: str, time_s: float, severity: str, text: str) -> None:
        """Log words at a time; `severity`: ``INFO``, ``WARN``, ``ERROR`` or ``CRITICAL``."""
        self.set_time(time_s)
        self.stream.log(entity, rr.TextLog(text, level=severity))

    def log_verdict(self, entity: str, row: Mapping[str, object]) -> None:
        """Log what was found, for programs: numbers bit for bit, words, None as neither; names with dots."""
        fields = [field for name, value in row.items() for field in _flat(name, value)]
        numbers = [float(value) if isinstance(value, (int, float, np.generic)) else None for _, value in fields]
        # in a table of numbers, NaN and None look alike
        texts = [value if isinstance(value, str) else "nan" if value != value else None for _, value in fields]
        columns = {
            "fields": pa.array([name for name, _ in fields], pa.string()),
            "values": pa.array(numbers, pa.float64()),
            "texts": pa.array(texts, pa.string()),
        }
        self.stream.log(entity, rr.DynamicArchetype("Verdict", components=columns), static=True)

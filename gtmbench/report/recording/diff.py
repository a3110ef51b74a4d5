"""Two recordings, compared: values, not bytes, for two files of equal runs differ in ids and dates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd

Name = tuple[str, str]  # entity, series
Told = tuple[str, float, str, str]  # entity, time in s, level, text
Line = tuple[npt.NDArray[Any], FloatArray]  # times in s (of a Markov parameter its lag, in words), values


@dataclass(frozen=True, kw_only=True)
class Closeness:
    """Within `relative` times the series' greatest magnitude, or `absolute`, values are equal; at 0: bit for bit."""

    relative: float = 0.0
    absolute: float = 0.0

    def limit(self, scale: float) -> float:
        """Return how far values of a scale may lie apart."""
        return max(self.absolute, self.relative * scale)


@dataclass(frozen=True, kw_only=True)
class SamplePair:
    """A sample of two recordings, in the series' unit; `at`: its time in s, of a Markov parameter its lag, in words."""

    at: float | str
    a: float
    b: float
    difference: float


@dataclass(frozen=True, kw_only=True)
class LineDifference:
    """A series that differs."""

    entity: str
    series: str
    # samples, differing: samples that both recordings hold, and how many of them differ
    samples: int
    differing: int
    # only_a, only_b: samples at times at which the other recording has none
    only_a: int
    only_b: int
    worst: SamplePair | None  # the one that differs most; None where only times do
    # its difference over the series' greatest magnitude; inf where a sample is missing in one or isn't a number
    relative: float

    @property
    def name(self) -> Name:
        """Entity and series."""
        return self.entity, self.series

    @property
    def text(self) -> str:
        """How it is called."""
        return self.entity if self.entity.endswith(f"/{self.series}") else f"{self.entity} {self.series}"

    @property
    def differing_text(self) -> str:
        """How many samples differ."""
        of, others = f"{self.differing} of {self.samples}", self.only_a + self.only_b
        return f"{of}, {others} at other times" if others else of


@dataclass(frozen=True, kw_only=True)
class RecordingDiff:
    """What two recordings differ in."""

    # series, fields, events: how many of each were held against each other
    series: int
    fields: int
    events: int
    # only_a, only_b: series, and fields of verdicts, that the other recording lacks
    only_a: tuple[Name, ...]
    only_b: tuple[Name, ...]
    lines: tuple[LineDifference, ...]  # the worst first
    verdicts: tuple[dict[str, Any], ...]  # fields of verdicts that differ: entity, field, a, b (numbers, words, None)
    told: tuple[dict[str, Any], ...]  # events, in time: only_in (``A`` or ``B``), entity, time_s, level, text

    @property
    def equal(self) -> bool:
        """Whether nothing differs."""
        return not (self.only_a or self.only_b or self.lines or self.verdicts or self.told)

    @property
    def alone(self) -> list[tuple[str, Name]]:
        """The series and fields that only ``A`` or ``B`` has."""
        return [("A", name) for name in self.only_a] + [("B", name) for name in self.only_b]

    @property
    def text(self) -> str:
        """What it comes to, in a sentence."""
        held = f"{self.series} series, {self.fields} fields of verdicts, {self.events} events"
        if self.equal:
            return f"Equal: {held}."
        only = f"; {len(self.alone)} series or fields in one only" if self.alone else ""
        series = f"{len(self.lines)} of {self.series} series"
        fields = f"{len(self.verdicts)} of {self.fields} fields of verdicts"
        return f"Different: {series}, {fields}, {len(self.told)} events in one only{only}."


def compare(a: pd.DataFrame, b: pd.DataFrame, tolerance: Closeness | None = None) -> RecordingDiff:
    """Compare two recordings, as `read_recording` gives them.

    `tolerance`: of numbers; left out, they have to be equal bit for bit (NaN equals NaN). Words always have to be.
    """
    tolerance = tolerance or Closeness()
    lines_a, lines_b = lines(a), lines(b)
    fields_a, fields_b = _fields(a), _fields(b)
    names_a, names_b = [*lines_a, *fields_a], [*lines_b, *fields_b]
    shared = [name for name in lines_a if name in lines_b]
    differing = [line for name in shared if (line := _line(name, lines_a[name], lines_b[name], tolerance))]
    common = [name for name in fields_a if name in fields_b]
    told_a, told_b = events(a), events(b)
    return RecordingDiff(
        series=len(shared),
        fields=len(common),
        events=(told_a & told_b).total(),
        only_a=tuple(name for name in names_a if name not in set(names_b)),
        only_b=tuple(name for name in names_b if name not in set(names_a)),
        lines=tuple(sorted(differing, key=lambda line: -line.relative)),
        verdicts=tuple(
            {"entity": name[0], "field": name[1], "a": fields_a[name], "b": fields_b[name]}
            for name in common
            if not _alike(fields_a[name], fields_b[name], tolerance)
        ),
        told=tuple(
            dict(zip(("only_in", "entity", "time_s", "level", "text"), event, strict=True))
            for event in sorted(
                [*_only_in("A", told_a - told_b), *_only_in("B", told_b - told_a)], key=lambda one: one[2]
            )
        ),
    )


def lines(frame: pd.DataFrame) -> dict[Name, Line]:
    """Return the series of numbers of a recording, each with the times that its values stand at."""
    numbers = frame[~_of_verdicts(frame) & ~_of_events(frame)]
    series = {}
    for name, rows in numbers.groupby(["entity", "series"], observed=True, sort=True):
        static = rows.time_s.isna().all()
        series[name] = (rows.text.astype(str) if static else rows.time_s).to_numpy(), rows.value.to_numpy()
    return series


def _of_verdicts(frame: pd.DataFrame) -> pd.Series:
    return frame.entity.str.endswith("/verdict")


def _of_events(frame: pd.DataFrame) -> pd.Series:
    return frame.text.notna() & frame.value.isna() & ~_of_verdicts(frame)


def _fields(frame: pd.DataFrame) -> dict[Name, float | str | None]:
    rows = frame[_of_verdicts(frame)]
    return {
        (entity, field): text if isinstance(text, str) else None if np.isnan(value) else value
        for entity, field, value, text in zip(rows.entity, rows.series, rows.value, rows.text, strict=True)
    }


def events(frame: pd.DataFrame) -> Counter[Told]:
    """Return the events of a recording: entity, time in s, level and text, counted."""
    rows = frame[_of_events(frame)]
    return Counter(zip(rows.entity, rows.time_s, rows.series, rows.text, strict=True))


def _only_in(which: str, told: Counter[Told]) -> Iterator[tuple[str, str, float, str, str]]:
    return ((which, *event) for event in told.elements())


def _line(name: Name, a: Line, b: Line, tolerance: Closeness) -> LineDifference | None:
    """Return how a series differs, None where it doesn't."""
    at, values_a, values_b = a[0], a[1], b[1]
    if not np.array_equal(a[0], b[0]):
        at, in_a, in_b = np.intersect1d(a[0], b[0], return_indices=True)
        values_a, values_b = a[1][in_a], b[1][in_b]
    scale = max(np.abs(values[np.isfinite(values)]).max(initial=0.0) for values in (values_a, values_b))
    with np.errstate(invalid="ignore", over="ignore"):
        distance = np.abs(values_a - values_b)
    distance[np.isnan(distance)] = np.inf
    limit = tolerance.limit(scale)
    same = (values_a.view(np.int64) == values_b.view(np.int64)) | (np.isnan(values_a) & np.isnan(values_b))
    differs = ~same & ~((distance <= limit) & (limit > 0.0))
    only_a, only_b = len(a[0]) - len(at), len(b[0]) - len(at)
    if not (differs.any() or only_a or only_b):
        return None
    worst = None
    if differs.any():
        k = int(np.argmax(np.where(differs, distance, -1.0)))
        place = at[k] if isinstance(at[k], str) else float(at[k])
        worst = SamplePair(at=place, a=float(values_a[k]), b=float(values_b[k]), difference=float(distance[k]))
    return LineDifference(
        entity=name[0],
        series=name[1],
        samples=len(at),
        differing=int(differs.sum()),
        only_a=only_a,
        only_b=only_b,
        worst=worst,
        relative=np.inf if only_a or only_b or worst is None else worst.difference / (scale or 1.0),
    )


def _alike(a: float | str | None, b: float | str | None, tolerance: Closeness) -> bool:
    if isinstance(a, float) and isinstance(b, float):
        return a == b or abs(a - b) <= tolerance.limit(max(abs(a), abs(b)))
    return a == b


def difference_tables(comparison: RecordingDiff) -> list[tuple[str, list[str], list[list[str]]]]:
    """Return what differs as tables that have rows: their titles, columns and rows."""
    samples = ["samples that differ", "at worst", "A", "B", "difference", "relative"]
    events = [[event[key] for key in ("only_in", "entity", "level", "text")] for event in comparison.told]
    made = [
        ("Series that differ, the worst first", ["series", *samples], list(map(_row, comparison.lines))),
        ("Verdicts that differ", ["verdict", "field", "A", "B"], field_rows(comparison)),
        ("Events in one only", ["in", "entity", "level", "event"], events),
        ("Series and fields in one only", ["in", "entity", "series"], [[in_, *name] for in_, name in comparison.alone]),
    ]
    return [each for each in made if each[2]]


def _row(line: LineDifference) -> list[str]:
    worst = line.worst
    if worst is None:
        return [line.text, line.differing_text, *[""] * 5]
    at = worst.at if isinstance(worst.at, str) else f"{worst.at:.10g} s"
    values = [f"{value:.6g}" for value in (worst.a, worst.b, worst.difference)]
    return [line.text, line.differing_text, at, *values, "" if line.only_a + line.only_b else f"{line.relative:.1e}"]


def field_rows(comparison: RecordingDiff) -> list[list[str]]:
    """Return the fields that differ, a row each: entity, field, and what it is in both."""
    return [[one["entity"], one["field"], _cell(one["a"]), _cell(one["b"])] for one in comparison.verdicts]


def _cell(value: float | str | None) -> str:
    return value if isinstance(value, str) else "-" if value is None else f"{value:.10g}"

"""Which column of a table tells the time, or which two of them; and which of a log's clocks tell another time."""

from __future__ import annotations

import re
import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.alike_times import finest_of_alike, stands_mostly
from gtmbench.intake.formats.raw import Meaning, RawLog, RawSeries, in_seconds, origin_of, since_text
from gtmbench.intake.mapping import ChosenColumn, judged, mapped_column, there
from gtmbench.intake.names import NameGuess, is_table_header, stated_unit
from gtmbench.intake.stamps import FAR_S
from gtmbench.intake.tracks import FEWEST
from gtmbench.intake.units import unit
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import Span

_WHOLE = re.compile(r"(?i)(?P<before>.*?)(?P<unit>secs?|seconds?)")
_BEGINNING, _ORDERLY = 10_000, 0.9  # stamps; of their steps
_UNITS = {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9}  # a second
_STEPS_S = (0.002, 0.5)  # between a log's samples
_EPOCH_S = (6.3e8, 2.53e9)  # the years 1990 to 2050, since 1970
_DAY_S = 86400.0  # by definition
_DAY, _SHEET, _MATLAB = "d", 25569.0, 719529.0  # 1970 as spreadsheets and MATLAB count days
_DAYS = (32874.0, 54789.0), (726834.0, 748750.0)  # the same years
# rise, and aren't times
_COUNTS = re.compile(r"(?i)index|count|number|num|seq|frame|sample|packet|^id|_id|lat|lon|alt|dist")
_FEWEST_STEPS, _UNEVEN = 50, 0.2  # of a column that is known by them; of the usual step
_PLAIN = ("t", "time", "timestamp", "time_s", "stamp")
_SECONDS = Meaning(channel="time", unit="s")
_BESIDE_S = 60.0  # a topic that begins when others have ended, a minute ago, may be of the same flight
_FINE = {  # how a column of what is beyond whole seconds ends, and how many of its units are one
    **dict.fromkeys(("nsec", "nsecs", "nanosec", "nanosecs", "nanosecond", "nanoseconds"), 1e9),
    **dict.fromkeys(("usec", "usecs", "microsec", "microsecs", "microsecond", "microseconds"), 1e6),
}


def with_time(raw: RawLog, mapped: str | None) -> RawLog:
    """Return a log whose clocks are known: a container's own, or from the columns that tell the time."""
    if raw.clocks and mapped is None:
        return raw
    tables = dict.fromkeys(series.clock for series in raw.series)
    if len(tables) > 1 and not raw.clocks and mapped is None:
        return _table_by_table(raw, list(tables))
    told = _stated_time(raw, mapped)
    clocks, since = in_seconds({told.clock: told.stamps}, told.per_second)
    taken = {column.name for column in told.columns}
    rest = tuple(other for other in raw.series if other.name not in taken)
    timed = replace(raw, series=rest, time=(told.name, told.stated), time_guessed=told.guessed)
    since = since or ((since_text(told.since_s, is_utc=told.is_utc),) if told.since_s else ())
    return timed.with_clocks(clocks, told.note, *since)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Told:
    """Which column tells a table's time, or which two, and their stamps."""

    columns: tuple[RawSeries, ...]
    stamps: NDArray[Any]
    stated: str
    per_second: float
    guessed: str = ""
    since_s: float = 0.0  # that was taken off the stamps

    @property
    def clock(self) -> str:
        return self.columns[0].clock

    @property
    def origin_s(self) -> float:
        """When its stamps begin to count, in seconds since 1970; 0 where they are as they were logged."""
        return self.since_s or self.columns[0].since_s

    @property
    def is_utc(self) -> bool:
        """Whether its dates are UTC: those of a spreadsheet, and texts without a zone, may be anywhere's."""
        return self.stated != _DAY and (not self.columns[0].told or self.columns[0].told.endswith("UTC"))

    @property
    def name(self) -> str:
        return " + ".join(column.name for column in self.columns)

    @property
    def note(self) -> str:
        if len(self.columns) > 1:
            return f"time: columns '{self.name}'"
        told = f", {self.columns[0].told}" if self.columns[0].told else f" in {self.stated}"
        return f"time: column '{self.name}'{told}{f', by {self.guessed}' if self.guessed else ''}"


def _stated_time(raw: RawLog, mapped: str | None) -> _Told:
    series, meaning, per_second = time_column(raw, mapped)
    beyond = beyond_seconds(raw, series)
    if beyond is not None:
        return _in_two_columns(series, *beyond)
    _check_steps(series, meaning.unit, per_second)
    stamps, since_s = series.load(), 0.0
    if meaning.unit == _DAY and np.isfinite(stamps).any():  # a log without any stamp is refused behind this
        first = float(stamps[np.isfinite(stamps)][0])
        stamps, since_s = stamps - first, (first - (_MATLAB if first > _DAYS[1][0] else _SHEET)) * _DAY_S
    return _Told(
        columns=(series,),
        stamps=stamps,
        stated=meaning.unit,
        per_second=per_second,
        guessed=meaning.guessed,
        since_s=since_s,
    )


def _table_by_table(raw: RawLog, tables: Sequence[str]) -> RawLog:
    """Return a log of several tables, each with its own time; those without one are left out."""
    told: dict[str, _Told] = {}
    without: list[str] = []
    why = ""
    for table in tables:
        own = tuple(series for series in raw.series if series.clock == table)
        try:
            told[table] = _stated_time(replace(raw, series=own, by_name=True), None)
        except InputError as error:
            without, why = [*without, table], why or str(error)
    if not told:
        raise InputError(why)
    same: dict[str, str | None] = {}
    for table in without:  # of the only table with a time that has as many rows
        rows = len(next(series for series in raw.series if series.clock == table).load())
        alike = [name for name, each in told.items() if len(each.stamps) == rows]
        same[table] = alike[0] if len(alike) == 1 else None
    series = tuple(replace(each, clock=same.get(each.clock) or each.clock) for each in raw.series)
    raw, without = replace(raw, series=series), [table for table in without if same[table] is None]
    clocks, since = _on_one_clock(told)
    times = {column.name for each in told.values() for column in each.columns}
    rest = tuple(series for series in raw.series if series.clock in clocks and series.name not in times)
    notes = [f"no time, so not taken: {', '.join(without[:12])}"] if without else []
    guessed = [each for each in told.values() if each.guessed]
    if guessed:  # of no one column
        raw = replace(raw, time=("", guessed[0].stated), time_guessed=guessed[0].guessed)
    said = [each.note for each in (guessed or list(told.values()))[:4]]  # tables
    return replace(raw, series=rest).with_clocks(clocks, *said, *since, *notes)


def _on_one_clock(told: Mapping[str, _Told]) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return the stamps of several tables in seconds, and a note on when they begin."""
    units, first_s = {each.per_second for each in told.values()}, min(each.origin_s for each in told.values())
    if len(units) == 1 and not any(each.origin_s for each in told.values()):
        return in_seconds({table: each.stamps for table, each in told.items()}, units.pop())
    stamps = {table: each.origin_s - first_s + each.stamps / each.per_second for table, each in told.items()}
    clocks, since = in_seconds(stamps, 1.0)
    is_utc = all(each.is_utc for each in told.values())
    return clocks, since or ((since_text(first_s, is_utc=is_utc),) if first_s else ())


def time_column(raw: RawLog, mapped: str | None) -> tuple[RawSeries, Meaning, float]:
    """Return the column that tells the time, or its whole seconds, its meaning, and how many of its unit are one."""
    series, meaning = mapped_column(raw, "time", mapped) if mapped is not None else _time_column(raw)
    known = unit(meaning.unit)
    if known is None:
        raise InputError(f"'{meaning.unit}' isn't a unit of time; give s, ms, us or ns")
    if meaning.late_s:
        raise InputError(f"--map time={mapped}: a channel's stamps may be late (@), the time itself can't be")
    return series, meaning, known.factor


def beyond_seconds(raw: RawLog, seconds: RawSeries) -> tuple[RawSeries, float] | None:
    """Return the column of what is beyond a column's whole seconds, and how many of its units are one."""
    told = _WHOLE.fullmatch(seconds.name)
    if told is None:
        return None
    names = {series.name.lower(): series for series in raw.series}
    endings = [(told["before"].lower() + ending, per_second) for ending, per_second in _FINE.items()]
    of = [(names[name], per_second) for name, per_second in endings if name in names]
    return of[0] if len(of) == 1 and of[0][0].clock == seconds.clock else None


def _in_two_columns(seconds: RawSeries, fine: RawSeries, per_second: float) -> _Told:
    whole, beyond = seconds.values(), fine.values() / per_second
    if np.any(np.abs(beyond) >= 1.0):
        raise InputError(
            f"'{fine.name}' isn't what is beyond the whole seconds of '{seconds.name}': --map time=COLUMN:UNIT"
        )
    origin_s = float(origin_of(whole, 1.0) or 0.0)
    return _Told(
        columns=(seconds, fine), stamps=(whole - origin_s) + beyond, stated="s", per_second=1.0, since_s=origin_s
    )


def _time_column(raw: RawLog) -> tuple[RawSeries, Meaning]:
    looks = [(series, told) for series in raw.series if (told := judged(series, raw)).channel == "time"]
    sure = _sure(raw, looks)
    exact = [(series, meaning) for series, meaning in sure if is_table_header(series.name)]
    pairs = [(series, _SECONDS) for series in raw.series if beyond_seconds(raw, series)]
    for certain in (exact, pairs, sure):
        if len(certain) == 1 and not (certain[0][0].told and stands_mostly(certain[0][0])):
            return certain[0]
    stepped = [(series, meaning) for series, _ in looks if (meaning := by_steps(series)) is not None]
    whole = [each for each in _of_shortest_name(stepped) if _is_whole(each[0])]
    if len(whole) == 1 and not any(_is_whole(series) for series, _ in (*sure, *pairs)):
        return whole[0]  # of every row, where messages with times of their own are joined
    measured = _measured_evenly(raw)
    if sure or pairs:
        return finest_of_alike([*pairs, *sure, *stepped, *measured]) or _only([*pairs, *sure])
    if len(looks) > 1:
        stepped = _of_shortest_name(stepped)
    if (found := finest_of_alike(stepped)) is not None:
        return found
    if raw.rate_hz:
        return _counted_rows(raw)
    if looks:
        raise InputError("; ".join(_without_unit(series, told) for series, told in looks[:3]))
    rising = measured or [(each, meaning) for each in raw.series if (meaning := rises_evenly(each)) is not None]
    if (found := finest_of_alike(rising)) is not None:
        return found
    perhaps = measured_time(raw) or [series.name for series, _ in rising]
    said = f" (perhaps {', '.join(map(repr, perhaps[:3]))})" if perhaps else ""
    raise InputError(f"no column tells the time: --map time=COLUMN:UNIT{said}; {there(raw)}")


def _sure(raw: RawLog, looks: Sequence[tuple[RawSeries, NameGuess]]) -> list[tuple[RawSeries, Meaning]]:
    """Return the columns that tell the time by their names and units, or by what stands in them."""
    named = [(series, told.meaning) for series, told in looks if told.meaning is not None]
    known = {series.name for series, _ in named}
    sure = [*named, *((each, _SECONDS) for each in raw.series if each.told and each.name not in known)]
    if raw.is_nameless:  # a date without a header, the same in every row, is a fact about the log
        sure = [each for each in sure if np.ptp(np.nan_to_num(each[0].values())) > 0]
    return sure


def _counted_rows(raw: RawLog) -> tuple[RawSeries, Meaning]:
    """Return a counter of samples, or the row's number without one, at the rate that stands beside the columns."""
    meaning = Meaning(channel="time", unit=f"{1.0 / raw.rate_hz:.12g} s", guessed=f"the stated {raw.rate_hz:g} Hz")
    for series in raw.series:
        turns = np.diff(series.values()) if _COUNTS.search(series.name) else np.zeros(0)
        if len(turns) and np.median(turns) == 1.0:
            return replace(series, load=partial(_run_on, series)), meaning
    rows = len(raw.series[0].load())
    return RawSeries(name="row", load=partial(np.arange, rows), clock=raw.series[0].clock), meaning


def _run_on(counter: RawSeries) -> FloatArray:
    """Return a counter of 8 or 16 bits as it would run on."""
    values = counter.values()
    most = float(np.nanmax(values, initial=0.0))
    bits = [bits for bits in (8, 16) if most == 2.0**bits - 1.0]
    return np.asarray(np.unwrap(values, period=2.0 ** bits[0])) if bits else values


def _only(certain: Sequence[tuple[RawSeries, Meaning]]) -> tuple[RawSeries, Meaning]:
    """Return the one column that tells the time, though it be coarse; of several none."""
    both = {series.name: meaning for series, meaning in certain}
    if len(both) == 1:
        return certain[0]
    first, meaning = next(iter(both.items()))
    raise InputError(
        f"columns {' and '.join(map(repr, both))} both tell the time, and not the same; choose: "
        f"--map {shlex.quote(f'time={first}:{meaning.unit}')}"
    )


def _measured_evenly(raw: RawLog) -> list[tuple[RawSeries, Meaning]]:
    """Return the columns that state a unit of time and rise in it as a log's samples do."""
    found = []
    for series in raw.series:
        stated = stated_unit(series.name, series.unit)[1]
        known = unit(stated) if stated and not _COUNTS.search(series.name) else None
        if known is not None and known.dimension == "time":
            step_s = _usual_step(series) / known.factor
            if _STEPS_S[0] <= step_s <= _STEPS_S[1]:
                found.append((series, Meaning(channel="time", unit=stated, guessed=f"its steps of {step_s:.3g} s")))
    return found


def _is_whole(series: RawSeries) -> bool:
    return bool(np.isfinite(series.values()).all())


def measured_time(raw: RawLog) -> list[str]:
    """Return the columns that state a unit of time."""
    return [
        series.name
        for series in raw.series
        if (measure := unit(stated_unit(series.name, series.unit)[1])) and measure.dimension == "time"
    ]


def _of_shortest_name(told: list[tuple[RawSeries, Meaning]]) -> list[tuple[RawSeries, Meaning]]:
    """Return the column whose name says time and nothing else, where one does; else all."""
    plain = [(series, meaning) for series, meaning in told if series.name.lower() in _PLAIN]
    return plain if len(plain) == 1 else told


def by_steps(series: RawSeries) -> Meaning | None:
    """Return the unit of a column that tells the time, by its steps or the epoch that it counts from; None where open.

    A log has 2 to 500 samples a second, and a date is of the years from 1990 to 2050. Microseconds since a boot ten to
    forty minutes ago look like a date in seconds, whose steps would be hours.
    """
    values = series.values()[:_BEGINNING]
    usual, known = _usual_step(series), values[np.isfinite(values)]
    middle = float(np.median(known)) if len(known) else 0.0
    epochs = [
        name
        for name, per_second in _UNITS.items()
        if _EPOCH_S[0] < middle / per_second < _EPOCH_S[1] and usual / per_second <= FAR_S
    ]
    if len(epochs) == 1 and np.ptp(known) > 0:
        return Meaning(channel="time", unit=epochs[0], guessed="the date that it counts to")
    if any(low < middle < high for low, high in _DAYS) and _STEPS_S[0] <= usual * _DAY_S <= _STEPS_S[1]:
        return Meaning(channel="time", unit=_DAY, guessed="the date that its days count to")
    fits = [name for name, per_second in _UNITS.items() if _STEPS_S[0] <= usual / per_second <= _STEPS_S[1]]
    return Meaning(channel="time", unit=fits[0], guessed=f"its steps of {usual:.6g}") if len(fits) == 1 else None


def rises_evenly(series: RawSeries) -> Meaning | None:
    """Return the unit of a column that is called anything and rises by even steps, as only a time does; else None."""
    if _COUNTS.search(series.name):
        return None
    values = series.values()[:_BEGINNING]
    steps = np.diff(values[np.isfinite(values)])  # a header that stands there again is a row without a number
    if len(steps) < _FEWEST_STEPS or not np.all(steps > 0) or np.sum(steps) == len(steps):
        return None
    usual = float(np.median(steps))
    even = np.mean(np.abs(steps - usual) < _UNEVEN * usual)
    return by_steps(series) if even > _ORDERLY else None


def _without_unit(series: RawSeries, told: NameGuess) -> str:
    """Say what is open about a column that looks like the time, or what its steps make of it."""
    hint = unit_hint(series.name, _usual_step(series))
    return f"column '{series.name}' " + (told.why_not.partition(": --map")[0] + hint if hint else told.why_not)


def _check_steps(series: RawSeries, stated: str, per_second: float) -> None:
    """Refuse stamps that are hours apart in the unit that is stated, where another one makes a log's rate of them."""
    step = _usual_step(series)
    hint = unit_hint(series.name, step)
    if step / per_second > FAR_S and hint:
        raise InputError(f"column '{series.name}' rises by {step:.6g} {stated} a sample, which is hours{hint}")


def _usual_step(series: RawSeries) -> float:
    """Return by how much stamps rise from sample to sample, at a log's beginning; 0 where they are in no order."""
    steps = np.diff(series.load()[:_BEGINNING].astype(np.float64))
    forward = steps[steps > 0]
    return float(np.median(forward)) if len(forward) > _ORDERLY * len(steps) else 0.0


def unit_hint(column: str, step: float) -> str:
    """Return what to type where only one unit makes a log's rate, 2 to 500 Hz, of stamps that rise so much a sample.

    >>> unit_hint("t", 20.0), unit_hint("t", 1.0)
    ('; by its steps of 20 it is in ms: --map time=t:ms', '')
    """
    fits = [name for name, per_second in _UNITS.items() if _STEPS_S[0] <= step / per_second <= _STEPS_S[1]]
    typed = "".join(shlex.quote(f"time={column}:{name}") for name in fits)
    return f"; by its steps of {step:.6g} it is in {fits[0]}: --map {typed}" if fits else ""


def elsewhere(clocks: Mapping[str, FloatArray]) -> dict[str, Span]:
    """Return the clocks that tell another time than most stamps do, with where they run: they nowhere overlap.

    >>> since_boot, of_week = np.arange(0.0, 9.0, 0.1), np.arange(4e5, 4e5 + 9.0)
    >>> elsewhere({"IMU": since_boot, "ATT": since_boot + 1.0, "GPS": of_week})
    {'GPS': (400000.0, 400008.0)}
    """
    spans: dict[str, tuple[float, float]] = {}
    counts: dict[str, int] = {}
    for name, time_s in clocks.items():
        known = time_s[np.isfinite(time_s)]
        if len(known):
            spans[name], counts[name] = main_span(known), len(known)
    groups: list[tuple[Span, list[str]]] = []
    for name, (start_s, end_s) in sorted(spans.items(), key=lambda one: one[1]):
        if groups and start_s <= groups[-1][0][1] + _BESIDE_S:
            (first_s, last_s), names = groups[-1]
            groups[-1] = (first_s, max(last_s, end_s)), [*names, name]
        else:
            groups.append(((start_s, end_s), [name]))
    groups.sort(key=lambda group: -sum(counts[name] for name in group[1]))
    return {name: spans[name] for _, names in groups[1:] for name in names}


def main_span(time_s: FloatArray) -> Span:
    """Return from when until when most of some stamps run: those from before a clock was set don't count, nor strays.

    >>> main_span(np.array([0.0, 1e6, 1e6 + 1.0, 1e6 + 2.0]))
    (1000000.0, 1000002.0)
    """
    most = max(np.split(time_s, np.flatnonzero(np.abs(np.diff(time_s)) > FAR_S) + 1), key=len)
    return float(most.min()), float(most.max())


def of_no_use(chosen: Sequence[ChosenColumn], raw: RawLog) -> dict[str, str]:
    """Return the channels that can't be brought to the others' clock, and why: another time, or hardly a sample."""
    clocks = {choice.series.clock for choice in chosen} & raw.clocks.keys()
    away = elsewhere({name: time_s for name, time_s in raw.clocks.items() if name in clocks})
    no_use = {}
    for choice in chosen:
        count = _counted(raw, choice.series)
        if choice.series.clock in away:
            start_s, end_s = away[choice.series.clock]
            no_use[choice.channel] = (
                f"'{choice.series.name}' is on another clock than the others, from {start_s:.10g} to {end_s:.10g} s"
            )
        elif count < FEWEST:
            no_use[choice.channel] = f"'{choice.series.name}' holds {count} samples; at least {FEWEST} are needed"
    return no_use


def _counted(raw: RawLog, series: RawSeries) -> int:
    """Return how many samples a column holds, as far as that they are few."""
    count = 0
    for values in raw.parts(series):
        count += int(np.count_nonzero(np.isfinite(values)))
        if count >= FEWEST:
            break
    return count

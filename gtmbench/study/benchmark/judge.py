"""The judge: thresholds, alarms and a row of the table, by one rule for all entries.

*Quickness*, the one number that rows are sorted by. A fault that is detected d seconds after its onset, and by the
limit of quickest detection after L, counts log(T/d)/log(T/L) (at most 1; d and L at least 0.1 s); a missed one 0. T is
the deadline; faults whose limit lies beyond it are left out. Quickness is the mean, for who keeps the allowed rate.

- *threshold*: by group, from the greatest scores of the minutes of its calibration flights, whose tail is extrapolated
  (`detectors/statistics/thresholds.py`), for the allowed rate.
- *alarm*: a score that rises above its threshold, having been at or below it.
- *false alarm*: before the onset or on a healthy flight; those within a minute of a counted one are that one. Who
  certainly raises more than is allowed (the lower bound of the rate is above) has no quickness.
- *detected*: the first alarm at or after the onset comes before the deadline.
- *named*: by names within 20 s of that alarm, the last of them; without names by the channels whose own scores stand
  above their own thresholds at any time in the second from the alarm on.
- *spread*: lowest and highest quickness over calibrations whose flights are drawn anew, with replacement.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.statistics.thresholds import HealthyMaxima, ScoreMaxima, block_maxima
from gtmbench.faults.fault import Fault
from gtmbench.method.windowed_alarms import rising
from gtmbench.study.benchmark.definition import CALIBRATION, Definition, Flight, Group
from gtmbench.study.benchmark.entry import Entry, Said, Scores, score_files
from gtmbench.study.scores.intervals import Rate, rate
from gtmbench.values.record import FloatArray

CALIBRATIONS = 10  # drawn anew, for the spread
SHORTEST_S = 0.1  # below that a delay counts no less
_BLOCK_S = 60.0  # of which the greatest scores are kept
_SAME_ALARM_S = 60.0
_NAMED_WITHIN_S, _RISE_TOGETHER_S = 20.0, 1.0
_TIE_S = 1e-6
RIGHT, WRONG, EITHER, UNNAMED, MISSED = "right", "wrong", "either-or", "unnamed", "missed"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What an entry made of a flight with a fault; of times and sizes in the units of a `Fault`.

    Attributes
    ----------
    flight, group, kind, channel : str
    sizes : mapping of str to float
        The fault's severities.
    limit_s, delay_s : float
        Infinite where nobody can tell within the flight, and where it is missed.
    told : str
        Right, wrong, either-or, unnamed, missed.
    """

    flight: str
    group: str
    kind: str
    channel: str
    sizes: Mapping[str, float]
    limit_s: float
    delay_s: float
    told: str


@dataclass(frozen=True, kw_only=True)
class Point:
    """A point of the curve: what becomes of an entry at another allowed rate."""

    allowed_per_hour: float
    false_alarms: Rate
    quickness: float
    detected: int
    median_delay_s: float


@dataclass(frozen=True, kw_only=True)
class Row:
    """A row of the table.

    Attributes
    ----------
    name, title, source, machine : str
    microseconds_a_sample : float
    quickness : float or None
        None for who raises certainly more false alarms than are allowed.
    spread : (float, float) or None
        None of a table of alarms, which has no calibration.
    findable : int
        Faults whose limit is below the deadline.
    detected, right, wrong, either, unnamed : int
        Of these.
    luck : int
        Alarms in time on the others, which nobody can find.
    median_delay_s, median_limit_s, times_limit : float
        Medians: of all findable faults, a missed one infinitely late; of delay over limit where detected.
    false_alarms : Rate
    curve : tuple of Point
        Rising in the allowed rate; the benchmark's own among them.
    outcomes : tuple of Outcome
    """

    name: str
    title: str
    source: str
    machine: str
    microseconds_a_sample: float
    quickness: float | None
    spread: tuple[float, float] | None
    findable: int
    detected: int
    right: int
    wrong: int
    either: int
    unnamed: int
    luck: int
    median_delay_s: float
    median_limit_s: float
    times_limit: float
    false_alarms: Rate
    curve: tuple[Point, ...]
    outcomes: tuple[Outcome, ...] = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Heard:
    """The alarms of one flight at every set of thresholds, and whom each first one after the onset would name."""

    flight: Flight
    times_s: list[FloatArray]
    named: tuple[str, ...]  # at the benchmark's own thresholds


def judge(entry: Entry, definition: Definition, split: str, limits_s: Mapping[str, float]) -> Row:
    """Return the row of an entry.

    Parameters
    ----------
    entry : Entry
    definition : Definition
    split : str
        Which is judged.
    limits_s : mapping of id to float
        The limit of every flight with a fault.
    """
    rates = sorted({*definition.other_rates_per_hour, definition.false_alarms_per_hour})
    flights = [flight for flight in definition.flights(split) if not flight.twin]
    if entry.alarms is None:
        heard = [each for group in definition.groups for each in _heard(entry, definition, group, flights, rates)]
    else:
        heard = [_told(flight, entry.alarms[flight.id], entry.names) for flight in flights]
    outcomes = tuple(_outcome(each, 0, definition, limits_s) for each in heard if each.flight.fault is not None)
    false = _false_alarms(heard, 0)
    scored = entry.alarms is None
    redrawn = range(1, 1 + CALIBRATIONS) if scored else ()
    of_draws = [_quickness(_outcomes(heard, place, definition, limits_s), definition) for place in redrawn]
    curve = [_point(heard, 1 + CALIBRATIONS + i, each, definition, limits_s) for i, each in enumerate(rates)]
    return _row(entry, outcomes, false, definition, of_draws, curve if scored else [])


def _row(
    entry: Entry,
    outcomes: tuple[Outcome, ...],
    false: Rate,
    definition: Definition,
    of_draws: Sequence[float],
    curve: Sequence[Point],
) -> Row:
    findable = [each for each in outcomes if each.limit_s < definition.deadline_s]
    told = [each.told for each in findable]
    found = [each for each in findable if each.told != MISSED]
    ratios = [max(each.delay_s, SHORTEST_S) / max(each.limit_s, SHORTEST_S) for each in found]
    keeps = false.low <= definition.false_alarms_per_hour
    return Row(
        name=entry.facts.name,
        title=entry.facts.title,
        source=entry.facts.source,
        machine=entry.facts.machine,
        microseconds_a_sample=entry.facts.microseconds_a_sample,
        quickness=_quickness(outcomes, definition) if keeps else None,
        spread=(min(of_draws), max(of_draws)) if of_draws else None,
        findable=len(findable),
        detected=len(found),
        right=told.count(RIGHT),
        wrong=told.count(WRONG),
        either=told.count(EITHER),
        unnamed=told.count(UNNAMED),
        luck=sum(each.told != MISSED for each in outcomes) - len(found),
        median_delay_s=_median([each.delay_s for each in findable]),
        median_limit_s=_median([each.limit_s for each in findable]),
        times_limit=_median(ratios),
        false_alarms=false,
        curve=tuple(curve),
        outcomes=outcomes,
    )


def quickness_of(delay_s: float, limit_s: float, deadline_s: float) -> float:
    """Return what a detected fault counts: 1 at the limit, 0 at the deadline, by the logarithm in between.

    >>> [round(quickness_of(delay_s, 1.0, 60.0), 2) for delay_s in (0.5, 1.0, 7.7, 60.0, float("inf"))]
    [1.0, 1.0, 0.5, 0.0, 0.0]
    """
    if delay_s >= deadline_s:
        return 0.0
    share = math.log(deadline_s / max(delay_s, SHORTEST_S)) / math.log(deadline_s / max(limit_s, SHORTEST_S))
    return min(share, 1.0)


def _quickness(outcomes: Sequence[Outcome], definition: Definition) -> float:
    counted = [
        quickness_of(each.delay_s, each.limit_s, definition.deadline_s)
        for each in outcomes
        if each.limit_s < definition.deadline_s
    ]
    return float(np.mean(counted)) if counted else 0.0


def _median(values: Sequence[float]) -> float:
    return float(np.quantile(values, 0.5, method="higher")) if values else math.nan


def _heard(
    entry: Entry, definition: Definition, group: Group, flights: Sequence[Flight], rates: Sequence[float]
) -> Iterator[_Heard]:
    """Yield the alarms of a group's flights by its score files."""
    healthy = [flight for flight in definition.flights(CALIBRATION) if flight.group == group]
    whole, channels = _maxima(entry, healthy)
    allowed = definition.false_alarms_per_hour
    sets = [whole.thresholds(allowed), *whole.redrawn(allowed, CALIBRATIONS), *map(whole.thresholds, rates)]
    thresholds = [each["score"][""] for each in sets]
    of_channels = channels.thresholds(allowed).get("channels", {}) if channels is not None else {}
    for flight, scores in score_files(entry, [flight for flight in flights if flight.group == group]):
        period_s = group.sample_period_s
        times_s = [np.asarray(rising(scores.score, threshold) * period_s, dtype=np.float64) for threshold in thresholds]
        alarm_s = _first(times_s[0], flight.fault)
        if entry.names:
            named = _named(entry.names.get(flight.id, ()), alarm_s)
        else:
            named = _above(scores, of_channels, alarm_s, period_s)
        yield _Heard(flight=flight, times_s=times_s, named=named)


def _maxima(entry: Entry, flights: Sequence[Flight]) -> tuple[HealthyMaxima, HealthyMaxima | None]:
    """Return the greatest scores of calibration flights' minutes: of the score, and of those by channel."""
    rows = round(_BLOCK_S / flights[0].group.sample_period_s)
    kept: dict[str, ScoreMaxima] = {}
    for _, scores in score_files(entry, flights):
        for label, values in {"": scores.score, **scores.by_channel}.items():
            of = kept.setdefault(
                label, ScoreMaxima(reach=1.0, least=lambda _: -math.inf, in_nats=False, most=entry.facts.bound)
            )
            of.maxima.append(block_maxima(values, rows))
            of.greatest.append(float(values.max()))
    period_s = flights[0].group.sample_period_s
    whole = HealthyMaxima(tests={("score", ""): kept.pop("")}, rows=rows, sample_period_s=period_s)
    tests = {("channels", label): of for label, of in kept.items()}
    return whole, HealthyMaxima(tests=tests, rows=rows, sample_period_s=period_s) if tests else None


def _told(flight: Flight, alarms: Sequence[Said], names: Mapping[str, list[Said]]) -> _Heard:
    """Return the alarms of a table: the same at all thresholds."""
    times_s = np.array([time_s for time_s, _ in alarms], dtype=np.float64)
    named = _named(names.get(flight.id, ()), _first(times_s, flight.fault))
    return _Heard(flight=flight, times_s=[times_s], named=named)


def _first(times_s: FloatArray, fault: Fault | None) -> float:
    """Return the first alarm at or after the onset; infinite where there is none, or no fault."""
    if fault is None:
        return math.inf
    after = times_s[times_s >= fault.onset_s - _TIE_S]
    return float(after[0]) if len(after) else math.inf


def _named(names: Sequence[Said], alarm_s: float) -> tuple[str, ...]:
    """Return who is named last within 20 s of an alarm."""
    within = [sensors for time_s, sensors in names if alarm_s - _TIE_S <= time_s <= alarm_s + _NAMED_WITHIN_S]
    return within[-1] if within else ()


def _above(scores: Scores, thresholds: Mapping[str, float], alarm_s: float, period_s: float) -> tuple[str, ...]:
    """Return the channels whose own scores stand above their thresholds within a second of an alarm."""
    if not math.isfinite(alarm_s):
        return ()
    row = round(alarm_s / period_s)
    rows = slice(row, row + round(_RISE_TOGETHER_S / period_s) + 1)
    return tuple(name for name, values in scores.by_channel.items() if (values[rows] > thresholds[name]).any())


def _outcomes(
    heard: Sequence[_Heard], place: int, definition: Definition, limits_s: Mapping[str, float]
) -> list[Outcome]:
    return [_outcome(each, place, definition, limits_s) for each in heard if each.flight.fault is not None]


def _outcome(heard: _Heard, place: int, definition: Definition, limits_s: Mapping[str, float]) -> Outcome:
    """Return what became of a fault, at one of the sets of thresholds."""
    flight = heard.flight
    fault = flight.fault
    assert fault is not None
    delay_s = round(max(_first(heard.times_s[place], fault) - fault.onset_s, 0.0), 6)
    missed = delay_s > definition.deadline_s
    return Outcome(
        flight=flight.id,
        group=flight.group.name,
        kind=fault.kind,
        channel=fault.channel,
        sizes=fault.severities,
        limit_s=limits_s[flight.id],
        delay_s=math.inf if missed else delay_s,
        told=MISSED if missed else _verdict(heard.named, fault.channel),
    )


def _verdict(named: Sequence[str], channel: str) -> str:
    if not named:
        return UNNAMED
    if channel not in named:
        return WRONG
    return RIGHT if len(named) == 1 else EITHER


def _false_alarms(heard: Sequence[_Heard], place: int) -> Rate:
    """Return the rate of false alarms, of healthy flights and of what lies before an onset."""
    ends_s = [each.flight.end_s if each.flight.fault is None else each.flight.fault.onset_s for each in heard]
    events = [_counted(each.times_s[place], end_s) for each, end_s in zip(heard, ends_s, strict=True)]
    return rate(np.array(events, dtype=int), np.array(ends_s) / 3600.0, np.arange(len(heard)))


def _counted(times_s: FloatArray, end_s: float) -> int:
    """Return how many alarms come before a time, those within a minute of a counted one left out.

    >>> _counted(np.array([1.0, 2.0, 70.0, 99.0]), 90.0)
    2
    """
    count, last_s = 0, -math.inf
    for time_s in times_s.tolist():
        if last_s + _SAME_ALARM_S <= time_s < end_s - _TIE_S:
            count, last_s = count + 1, time_s
    return count


def _point(
    heard: Sequence[_Heard], place: int, allowed: float, definition: Definition, limits_s: Mapping[str, float]
) -> Point:
    if len(heard[0].times_s) <= place:  # a table of alarms is the same at any rate
        place = 0
    outcomes = _outcomes(heard, place, definition, limits_s)
    findable = [each.delay_s for each in outcomes if each.limit_s < definition.deadline_s]
    return Point(
        allowed_per_hour=allowed,
        false_alarms=_false_alarms(heard, place),
        quickness=_quickness(outcomes, definition),
        detected=sum(math.isfinite(delay_s) for delay_s in findable),
        median_delay_s=_median(findable),
    )


def ranked(rows: Sequence[Row]) -> list[Row]:
    """Return rows by quickness, those without one last."""
    return sorted(rows, key=lambda row: (row.quickness is None, -(row.quickness or 0.0), row.name))


def places(rows: Sequence[Row]) -> dict[str, tuple[int, int]]:
    """Return the places that each row may have: two rows differ where their spreads don't overlap.

    A row without quickness comes after all that have one. A table of alarms has its number as its spread.
    """
    ends = {row.name: _ends(row) for row in rows}
    found = {}
    for name, (low, high) in ends.items():
        better = sum(other[0] > high for other in ends.values())
        worse = sum(other[1] < low for other in ends.values())
        found[name] = (1 + better, len(rows) - worse)
    return found


def _ends(row: Row) -> tuple[float, float]:
    if row.quickness is None:
        return (-1.0, -1.0)
    low, high = row.spread or (row.quickness, row.quickness)
    return min(low, row.quickness), max(high, row.quickness)

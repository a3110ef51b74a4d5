"""The judge: thresholds, alarms and a row of the table, by one rule for all entries.

*Quickness*, the one number that rows are sorted by. A fault has some flights; d is the mean of its delays over these, r
that of the reference (`gtmbench/study/reference.py`) and T that of how long a fault could have been detected: up to the
deadline, or the flight's end. A missed one counts with all of that. Quickness is the sum of log(T/d) over all faults,
over the sum of log(T/r); d and r are at least 0.1 s. The reference has 1, who misses all has 0.

- *threshold*: by group, from the greatest scores of the minutes of its calibration flights, whose tail is extrapolated
  (`detectors/statistics/thresholds.py`), for the allowed rate.
- *alarm*: a score that rises above its threshold, having been at or below it.
- *false alarm*: before the onset or on a healthy flight but a look-alike; the next counts again after 10 s. Who
  certainly raises more than is allowed (the lower bound of the rate is above) has no quickness.
- *detected*: the first alarm at or after the onset comes within T.
- *named*: by names within 20 s of that alarm, the last of them; without names by the channels whose own scores stand
  above their own thresholds at any time in the second from the alarm on.
- *interval*: 95 % of quickness when faults, their flights and the calibration are drawn anew, with replacement. Two
  rows differ where their difference does, on the same draws (5 % for all pairs together, by Holm's steps).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.statistics.thresholds import HealthyMaxima, ScoreMaxima, block_maxima
from gtmbench.method.residual import rising
from gtmbench.study.benchmark.definition import (
    ALIKE,
    CALIBRATION,
    COMMON,
    EASY,
    PAIR,
    SINGLE,
    Definition,
    Flight,
    Group,
)
from gtmbench.study.benchmark.entry import Entry, Facts, Said, Scores
from gtmbench.study.benchmark.flights import Told, horizon_s
from gtmbench.study.scores.intervals import Estimate, IntArray, Rate, rate
from gtmbench.study.scores.ranking import LEVEL, TIE_S, holm
from gtmbench.values.record import FloatArray

CALIBRATIONS = 20  # drawn anew, for the interval
DRAWS = 2000  # of which 50 lie beyond each end of a 95 % interval
SHORTEST_S = 0.1  # below that a mean delay counts no less
_BLOCK_S = 60.0  # of which the greatest scores are kept
_HOLD_S, _NAMED_WITHIN_S, _RISE_TOGETHER_S = 10.0, 20.0, 1.0  # of the rule, as the module's text and its page have it
RIGHT, WRONG, EITHER, UNNAMED, MISSED = "right", "wrong", "either-or", "unnamed", "missed"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What an entry made of a flight with a fault; of times and sizes in the units of a `Fault`.

    Attributes
    ----------
    flight, group, role : str
    case : int
        Which of the group's faults it is; -1 but for those that quickness counts.
    kind, channel : str
        Of the first fault.
    sizes : mapping of str to float
        Its severities.
    horizon_s : float
        How long after the onset it may be detected.
    reference_s : float
        Mean delay of the reference, at most the horizon; NaN where it isn't counted.
    delay_s : float
        Infinite where it is missed.
    told : str
        Right, wrong, either-or, unnamed, missed: of a pair whether the second is named after its onset.
    """

    flight: str
    group: str
    role: str
    case: int
    kind: str
    channel: str
    sizes: Mapping[str, float]
    horizon_s: float
    reference_s: float
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
    """A row of the table."""

    facts: Facts  # what the entry says of itself
    # quickness: with its 95 % interval; None for who raises certainly more false alarms than are allowed
    quickness: Estimate | None
    # flights, detected, right, wrong, either, unnamed: flights with a fault that quickness counts, and what was made of
    # them
    flights: int
    detected: int
    right: int
    wrong: int
    either: int
    unnamed: int
    # easy, second, accused, alike: how many of how many: easy faults detected, second faults named, flights of a common
    # cause on which a sensor is named alone, healthy look-alikes with an alarm
    easy: tuple[int, int]
    second: tuple[int, int]
    accused: tuple[int, int]
    alike: tuple[int, int]
    median_delay_s: float  # median_delay_s, reference_s: medians over these flights, a missed one infinitely late
    reference_s: float
    false_alarms: Rate
    curve: tuple[Point, ...]  # rising in the allowed rate; the benchmark's own among them
    outcomes: tuple[Outcome, ...] = field(repr=False)
    # draws: shape (draws,); quickness with faults, flights and calibration drawn anew; none where quickness isn't known
    draws: FloatArray = field(repr=False)

    @property
    def name(self) -> str:
        """The entry's."""
        return self.facts.name


@dataclass(frozen=True, kw_only=True, eq=False)
class _Heard:
    """The alarms of one flight at every set of thresholds, and whom its first one after the last onset would name."""

    flight: Flight
    times_s: list[FloatArray]
    named: tuple[str, ...]  # at the benchmark's own thresholds


def judge(entry: Entry, definition: Definition, split: str, reference: Mapping[str, Told]) -> Row:
    """Return the row of an entry.

    `split`: which is judged. `reference`: what the reference makes of every flight that quickness counts.
    """
    rates = sorted({*definition.other_rates_per_hour, definition.false_alarms_per_hour})
    flights = [flight for flight in definition.flights(split) if not flight.twin]
    if entry.alarms is None:
        heard = [each for group in definition.groups for each in _heard(entry, definition, group, flights, rates)]
    else:
        heard = [_told(flight, entry.alarms[flight.id], entry.names) for flight in flights]
    outcomes = tuple(_outcome(each, definition, reference) for each in heard if each.flight.faults)
    counted = [each for each in outcomes if each.role == SINGLE]
    scored = entry.alarms is None
    singles = [each for each in heard if each.flight.role == SINGLE]
    draws = range(1 + CALIBRATIONS if scored else 1)
    delays_s = np.array([[_delay_s(each, place, definition) for each in singles] for place in draws])
    false = _false_alarms(heard, 0)
    told = [each.told for each in counted]
    alike_s = [each.times_s[0] for each in heard if each.flight.role == ALIKE]
    keeps = false.low <= definition.false_alarms_per_hour
    drawn = drawn_anew(counted, delays_s) if keeps and counted else np.zeros(0)
    return Row(
        facts=entry.facts,
        quickness=estimated(_quickness(delays_s[0], counted), drawn) if len(drawn) else None,
        flights=len(counted),
        detected=len(counted) - told.count(MISSED),
        right=told.count(RIGHT),
        wrong=told.count(WRONG),
        either=told.count(EITHER),
        unnamed=told.count(UNNAMED),
        easy=_of(outcomes, EASY, (RIGHT, WRONG, EITHER, UNNAMED)),
        second=_of(outcomes, PAIR, (RIGHT, EITHER)),
        accused=_of(outcomes, COMMON, (RIGHT, WRONG)),
        alike=(sum(len(times_s) > 0 for times_s in alike_s), len(alike_s)),
        median_delay_s=_median([each.delay_s for each in counted]),
        reference_s=_median([each.reference_s for each in counted]),
        false_alarms=false,
        curve=tuple(
            _point(heard, place, each, definition, counted) for place, each in enumerate(rates, 1 + CALIBRATIONS)
        )
        if scored
        else (),
        outcomes=outcomes,
        draws=drawn,
    )


def _of(outcomes: Sequence[Outcome], role: str, told: Sequence[str]) -> tuple[int, int]:
    own = [each.told for each in outcomes if each.role == role]
    return sum(each in told for each in own), len(own)


def quickness_of(delays_s: FloatArray, reference_s: FloatArray, horizon_s: FloatArray, cases: IntArray) -> float:
    """Return quickness: of flights' delays, the reference's means, how long each could be detected, and the faults.

    >>> cases, horizon_s, reference_s = np.array([0, 0, 1, 1]), np.full(4, 50.0), np.full(4, 0.5)
    >>> delays_s = (reference_s, np.full(4, np.inf), np.array([0.5, 0.5, np.inf, np.inf]))
    >>> [quickness_of(each, reference_s, horizon_s, cases) for each in delays_s]
    [1.0, 0.0, 0.5]
    """
    weights = np.ones((1, len(cases)))
    return float(_drawn_quickness(delays_s[np.newaxis], reference_s, horizon_s, cases, weights)[0])


def _drawn_quickness(
    delays_s: FloatArray, reference_s: FloatArray, horizon_s: FloatArray, cases: IntArray, weights: FloatArray
) -> FloatArray:
    """Return quickness of some draws: delays and how often a flight counts, each of shape (draws, flights)."""
    sums = np.zeros((len(cases), int(cases.max()) + 1))
    sums[np.arange(len(cases)), cases] = 1.0
    often = weights @ sums
    there = np.maximum(often, 1e-12)
    d, r, most = (
        ((weights * each) @ sums) / there for each in (np.minimum(delays_s, horizon_s), reference_s, horizon_s)
    )
    short, best = (np.log(np.maximum(most, SHORTEST_S) / np.maximum(each, SHORTEST_S)) for each in (d, r))
    return np.asarray((often * short).sum(axis=1) / (often * best).sum(axis=1))


def drawn_anew(counted: Sequence[Outcome], delays_s: FloatArray) -> FloatArray:
    """Return quickness with faults, flights and calibration drawn anew; of all rows alike, so that they pair.

    A kind of fault keeps its number of faults, as the definition deals them out. Draws are about quickness as it is: a
    mean of few delays, and the largest of few healthy scores, are smaller where values are drawn twice. `delays_s`,
    shape (calibrations, flights): with the calibration as it is, and drawn anew.
    """
    draw = np.random.default_rng(len(counted))
    reference_s, horizon_s, cases = _columns(counted)
    flights = [np.flatnonzero(cases == case) for case in range(int(cases.max()) + 1)]
    kinds = np.array([counted[own[0]].kind for own in flights])
    weights = np.zeros((DRAWS, len(cases)))
    for kind in np.unique(kinds):
        alike = np.flatnonzero(kinds == kind)
        times = draw.multinomial(len(alike), np.full(len(alike), 1.0 / len(alike)), size=DRAWS)
        for case, often in zip(alike.tolist(), times.T, strict=True):
            own = flights[case]
            within = draw.multinomial(len(own), np.full(len(own), 1.0 / len(own)), size=DRAWS)
            weights[:, own] = within * often[:, np.newaxis]
    calibrations = draw.integers(0, len(delays_s), DRAWS)
    drawn = _drawn_quickness(delays_s[calibrations], reference_s, horizon_s, cases, weights)
    return drawn - np.median(drawn) + _quickness(delays_s[0], counted)


def estimated(value: float, drawn: FloatArray) -> Estimate:
    """Return a value with the 95 % interval of its draws."""
    low, high = np.quantile(drawn, [0.025, 0.975])
    return Estimate(value=value, low=float(low), high=float(high))


def _quickness(delays_s: FloatArray, counted: Sequence[Outcome]) -> float:
    return quickness_of(delays_s, *_columns(counted))


def _columns(counted: Sequence[Outcome]) -> tuple[FloatArray, FloatArray, IntArray]:
    """Return the reference's means, how long each could be detected, and the number of its fault; shape (flights,)."""
    _, cases = np.unique([f"{each.group} {each.case}" for each in counted], return_inverse=True)
    return np.array([each.reference_s for each in counted]), np.array([each.horizon_s for each in counted]), cases


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
    period_s = group.sample_period_s
    for flight in (flight for flight in flights if flight.group == group):
        scores = entry.scores(flight)
        times_s = [np.asarray(rising(scores.score, threshold) * period_s, dtype=np.float64) for threshold in thresholds]
        alarm_s = _first(times_s[0], flight)
        if entry.names:
            named = _named(entry.names.get(flight.id, ()), alarm_s)
        else:
            named = _above(scores, of_channels, alarm_s, period_s)
        yield _Heard(flight=flight, times_s=times_s, named=named)


def _maxima(entry: Entry, flights: Sequence[Flight]) -> tuple[HealthyMaxima, HealthyMaxima | None]:
    """Return the greatest scores of calibration flights' minutes: of the score, and of those by channel."""
    rows = round(_BLOCK_S / flights[0].group.sample_period_s)
    kept: dict[str, ScoreMaxima] = {}
    for scores in map(entry.scores, flights):
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
    named = _named(names.get(flight.id, ()), _first(times_s, flight))
    return _Heard(flight=flight, times_s=[times_s], named=named)


def _first(times_s: FloatArray, flight: Flight, onset: int = -1) -> float:
    """Return the first alarm at or after the last onset; infinite where there is none, or no fault."""
    after = times_s[times_s >= flight.faults[onset].onset_s - TIE_S] if flight.faults else times_s[:0]
    return float(after[0]) if len(after) else math.inf


def _named(names: Sequence[Said], alarm_s: float) -> tuple[str, ...]:
    """Return who is named last within 20 s of an alarm."""
    within = [sensors for time_s, sensors in names if alarm_s - TIE_S <= time_s <= alarm_s + _NAMED_WITHIN_S]
    return within[-1] if within else ()


def _above(scores: Scores, thresholds: Mapping[str, float], alarm_s: float, period_s: float) -> tuple[str, ...]:
    """Return the channels whose own scores stand above their thresholds within a second of an alarm."""
    if not math.isfinite(alarm_s):
        return ()
    row = round(alarm_s / period_s)
    rows = slice(row, row + round(_RISE_TOGETHER_S / period_s) + 1)
    return tuple(name for name, values in scores.by_channel.items() if (values[rows] > thresholds[name]).any())


def _delay_s(heard: _Heard, place: int, definition: Definition, onset: int = 0) -> float:
    """Return the delay at one of the sets of thresholds; infinite where a fault is missed."""
    flight = heard.flight
    delay_s = round(max(_first(heard.times_s[place], flight, onset) - flight.faults[onset].onset_s, 0.0), 6)
    return delay_s if delay_s <= horizon_s(definition, flight) else math.inf


def _outcome(heard: _Heard, definition: Definition, reference: Mapping[str, Told]) -> Outcome:
    """Return what became of a flight with a fault."""
    flight = heard.flight
    first, last = flight.faults[0], flight.faults[-1]
    delay_s = _delay_s(heard, 0, definition, -1 if flight.role == PAIR else 0)
    return Outcome(
        flight=flight.id,
        group=flight.group.name,
        role=flight.role,
        case=flight.case,
        kind=first.kind,
        channel=first.channel,
        sizes=first.severities,
        horizon_s=horizon_s(definition, flight),
        reference_s=reference[flight.id].mean_s if flight.role == SINGLE else math.nan,
        delay_s=delay_s,
        told=MISSED if math.isinf(delay_s) else _verdict(heard.named, last.channel),
    )


def _verdict(named: Sequence[str], channel: str) -> str:
    if not named:
        return UNNAMED
    if channel not in named:
        return WRONG
    return RIGHT if len(named) == 1 else EITHER


def _false_alarms(heard: Sequence[_Heard], place: int) -> Rate:
    """Return the rate of false alarms, of healthy flights and of what lies before an onset."""
    heard = [each for each in heard if each.flight.role != ALIKE]
    ends_s = [each.flight.onset_s for each in heard]
    events = [_counted(each.times_s[place], end_s) for each, end_s in zip(heard, ends_s, strict=True)]
    return rate(np.array(events, dtype=int), np.array(ends_s) / 3600.0, np.arange(len(heard)))


def _counted(times_s: FloatArray, end_s: float) -> int:
    """Return how many alarms come before a time, those within 10 s of a counted one left out.

    >>> _counted(np.array([1.0, 2.0, 12.0, 99.0]), 90.0)
    2
    """
    count, last_s = 0, -math.inf
    for time_s in times_s.tolist():
        if last_s + _HOLD_S <= time_s < end_s - TIE_S:
            count, last_s = count + 1, time_s
    return count


def _point(
    heard: Sequence[_Heard], place: int, allowed: float, definition: Definition, counted: Sequence[Outcome]
) -> Point:
    delays_s = np.array([_delay_s(each, place, definition) for each in heard if each.flight.role == SINGLE])
    return Point(
        allowed_per_hour=allowed,
        false_alarms=_false_alarms(heard, place),
        quickness=_quickness(delays_s, counted) if counted else 0.0,
        detected=int(np.isfinite(delays_s).sum()),
        median_delay_s=_median(delays_s.tolist()),
    )


def ranked(rows: Sequence[Row]) -> list[Row]:
    """Return rows by quickness, those without one last."""
    return sorted(rows, key=lambda row: (row.quickness is None, -_value(row), row.name))


def _value(row: Row) -> float:
    return -1.0 if row.quickness is None else row.quickness.value


@dataclass(frozen=True, kw_only=True)
class Difference:
    """How much quicker the first of two rows is, on the same faults."""

    first: str
    second: str
    quickness: Estimate  # the difference, with its 95 % interval
    p: float  # of no difference, corrected for all pairs by Holm's steps


def differences(rows: Sequence[Row]) -> list[Difference]:
    """Return every pair of rows that have quickness, the better one first."""
    those = [row for row in ranked(rows) if row.quickness is not None]
    found = []
    for first, second in itertools.combinations(those, 2):
        off = first.draws - second.draws
        beyond = 2.0 * min(float((off <= 0.0).mean()), float((off >= 0.0).mean()))
        # draws that never cross 0 tell less than the many pairs ask for: there the tail is the normal distribution's
        p = max(beyond, math.erfc(abs(float(off.mean())) / max(math.sqrt(2.0) * float(off.std()), 1e-300)))
        estimate = estimated(_value(first) - _value(second), off)
        found.append(Difference(first=first.name, second=second.name, quickness=estimate, p=min(p, 1.0)))
    return [replace(each, p=p) for each, p in zip(found, holm([each.p for each in found]), strict=True)]


def places(rows: Sequence[Row], told: Sequence[Difference]) -> dict[str, tuple[int, int]]:
    """Return the places that each row may have: those that no test tells apart share theirs.

    A row without quickness comes after all that have one.
    """
    differ = {(each.first, each.second) for each in told if each.p <= LEVEL}
    numbered = [row.name for row in rows if row.quickness is not None]
    found = {row.name: (len(numbered) + 1, len(rows)) for row in rows}
    for name in numbered:
        better, worse = (sum(pair[of] == name for pair in differ) for of in (1, 0))
        found[name] = (1 + better, len(numbered) - worse)
    return found

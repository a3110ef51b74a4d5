"""An airframe's constants over its flights, the worst first, and when one that changes slowly reaches its limit."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.history.entry import AT_REST, FACTOR, NOISE, OFFSET, Entry, kind_of
from gtmbench.history.spread import (
    FEWEST,
    Key,
    Lines,
    Prediction,
    alike_of,
    constants_by_flight,
    fitted,
    predicted,
    warmth,
)
from gtmbench.history.standing import CHANCE, installed
from gtmbench.values.record import BoolArray, FloatArray, IntArray

_WITHIN = 0.05  # that the crossing lies outside its interval
_LIMITS = {OFFSET: 5.0, AT_REST: 5.0, FACTOR: 0.1}  # how far from zero an offset may be, in deg/s; from one a factor


@dataclass(frozen=True, kw_only=True)
class Trend:
    """A constant that changes from flight to flight."""

    sensor: str
    name: str
    flights: int  # by how many it is told
    # slope, deviation: its change a flight, and the standard deviation of that
    slope: float
    deviation: float
    limit: float  # which it will reach
    crossing: float  # the flight at which it does, counted from the first of the installation, which is 1
    between: tuple[float, float]  # between which flights, with 95 %


def trends_of(flights: Sequence[Entry]) -> tuple[Trend, ...]:
    """Return the constants that change slowly over the flights of an installation, the first to reach its limit first.

    `flights`: of one airframe since its installation began, in order.
    """
    keys = tuple(dict.fromkeys(key for each in flights for key in each.by_key if key[1] in _LIMITS))
    values, deviations = constants_by_flight(flights, keys)
    enough = np.isfinite(values).sum(axis=1) > FEWEST
    if not enough.any():
        return ()
    keys = tuple(key for key, is_told in zip(keys, enough, strict=True) if is_told)
    numbers, warmer = np.arange(1.0, len(flights) + 1.0), warmth(flights)
    middle = float(numbers.mean())
    columns = np.column_stack([np.ones(len(flights)), 0.0 * numbers if warmer is None else warmer, numbers - middle])
    kinds = [kind_of(name) for _, name in keys]
    prior = np.array([[np.inf, max(each.per_k, 1e-9), np.inf] for each in kinds])
    least = np.array([each.spread for each in kinds])
    lines = fitted(values[enough], deviations[enough], columns, prior, least, alike_of(keys))
    found = [_trend(key, lines, at, len(flights), middle) for at, key in enumerate(keys)]
    return tuple(sorted((each for each in found if each is not None), key=lambda each: each.crossing))


def _trend(key: Key, lines: Lines, at: int, flights: int, middle: float) -> Trend | None:
    from scipy.special import stdtr, stdtrit

    start, _, slope = lines.theta[at].tolist()
    covariance, degrees = lines.covariance[at], float(lines.degrees[at])
    deviation = float(np.sqrt(covariance[2, 2]))
    if 2.0 * float(stdtr(degrees, -abs(slope) / deviation)) > CHANCE / len(lines.theta):
        return None
    usual = 1.0 if key[1] == FACTOR else 0.0
    reaches = usual + np.sign(slope) * _LIMITS[key[1]]
    away = start - reaches
    quantile = -float(stdtrit(degrees, 0.5 * _WITHIN))
    # Fieller: all m at which the line, a + b m, may be at the limit
    square = slope**2 - quantile**2 * covariance[2, 2]
    half = slope * away - quantile**2 * covariance[0, 2]
    rest = away**2 - quantile**2 * covariance[0, 0]
    root = np.sqrt(max(half**2 - square * rest, 0.0))
    return Trend(
        sensor=key[0],
        name=key[1],
        flights=flights,
        slope=slope,
        deviation=deviation,
        limit=float(reaches),
        crossing=middle - away / slope,
        between=(middle + float(-half - root) / float(square), middle + float(-half + root) / float(square)),
    )


def trend_text(trend: Trend) -> str:
    """Say how a constant changes, and when it will reach its limit."""
    unit = kind_of(trend.name).unit
    behind = f" {unit}" if unit else ""
    low, high = trend.between
    reaches = f"it reaches {trend.limit:.3g}{behind} at flight {trend.crossing:.0f} ({low:.0f} to {high:.0f})"
    return f"changes by {trend.slope:.2g}{behind} a flight; {reaches}"


_SURE = 1.96  # deviations of a normal law: 95 %


@dataclass(frozen=True, kw_only=True, eq=False)
class Overview:
    """A constant of an airframe over its flights; a noise in its sensor's unit."""

    sensor: str
    name: str
    unit: str
    # shape (flights,): their numbers, from 1, of all flights of the airframe that tell it
    flights: IntArray = field(repr=False)
    values: FloatArray = field(repr=False)  # shape (flights,)
    intervals: FloatArray = field(repr=False)  # shape (flights, 2): between which each lies with 95 %
    is_apart: BoolArray = field(repr=False)  # shape (flights,): which were others than before
    # between which the last flight is expected by those before it; None where fewer than five tell
    usual: tuple[float, float] | None
    chance: float  # how likely the last flight's is, by these; 1 where nothing is expected
    trend: Trend | None  # where it changes slowly
    began: int  # at which flight the installation begins

    @property
    def is_apart_now(self) -> bool:
        """Whether the last flight is another than before."""
        return bool(self.is_apart[-1])

    @property
    def is_worth_a_look(self) -> bool:
        """Whether it is another than before, or changes slowly."""
        return self.is_apart_now or self.trend is not None

    @property
    def title(self) -> str:
        """Whose constant it is, which, and in which unit."""
        return f"{self.sensor}: {self.name}{f' ({self.unit})' if self.unit else ''}"


def overviews_of(flights: Sequence[Entry]) -> tuple[Overview, ...]:
    """Return the constants of an airframe over its flights, the worst first.

    Those that the last flight parts from come first, then those that change slowly, then by how unlikely the last is.

    `flights`: of one airframe, in order.
    """
    if not flights:
        return ()
    last = flights[-1]
    own = [*installed(flights, last), last] if not last.begins else [last]
    began = len(flights) - len(own) + 1
    trends = {(each.sensor, each.name): each for each in trends_of(own)}
    keys = dict.fromkeys(key for each in flights for key in each.by_key)
    expected = predicted(own[:-1], last)
    found = [_overview(flights, key, expected.get(key), trends.get(key), began) for key in keys]
    return tuple(sorted(found, key=lambda each: (not each.is_apart_now, each.trend is None, each.chance)))


def _overview(
    flights: Sequence[Entry], key: Key, expected: Prediction | None, trend: Trend | None, began: int
) -> Overview:
    told = [(number, each, each.by_key[key]) for number, each in enumerate(flights, 1) if key in each.by_key]
    values = np.array([each.value for _, _, each in told])
    off = _SURE * np.array([each.deviation for _, _, each in told])
    intervals = np.column_stack([values - off, values + off])
    last, usual, chance = flights[-1], None, 1.0
    apart = np.array([key in each.apart for _, each, _ in told], dtype=bool)
    if expected is not None:
        reach, chance = expected.reach(CHANCE), expected.chance(last.by_key[key].value)
        low, high = _shown(key[1], np.array([expected.value - reach, expected.value + reach])).tolist()
        usual = low, high
        apart[-1] &= not low <= float(_shown(key[1], values)[-1]) <= high  # one of a sensor that failed otherwise isn't
    return Overview(
        sensor=key[0],
        name=key[1],
        unit="deg/s" if key[1] == NOISE else kind_of(key[1]).unit,
        flights=np.array([number for number, _, _ in told]),
        values=_shown(key[1], values),
        intervals=_shown(key[1], intervals),
        is_apart=apart,
        usual=usual,
        chance=chance,
        trend=trend,
        began=began,
    )


def _shown(name: str, values: FloatArray) -> FloatArray:
    """Return values as they are shown: of a noise not the logarithm."""
    return np.exp(values) if name == NOISE else values

"""Constants that change slowly over flights, and the flight at which each will reach its limit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.history.constant import AT_REST, FACTOR, OFFSET, kind_of
from gtmbench.history.entry import Entry
from gtmbench.history.spread import FEWEST, Key, Lines, alike_of, constants_by_flight, fitted, warmth

CHANCE = 1e-3  # that constants which don't change are said to, at a flight
_WITHIN = 0.05  # that the crossing lies outside its interval
_FACTOR = 0.1  # from one: where a factor is asked by nobody


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


def trends_of(flights: Sequence[Entry], limits: Mapping[str, float] | None = None) -> tuple[Trend, ...]:
    """Return the constants that change slowly over the flights of an installation, the first to reach its limit first.

    `flights`: of one airframe since its installation began, in order. `limits`, by name: how far from zero an offset
    may be, in deg/s, and from one a factor; 5 and 0.1 by default.

    >>> from gtmbench.history.constant import Constant
    >>> def flight(number):
    ...     read = Constant(sensor="q", name="offset", value=0.2 * number + 0.1 * (number % 2), deviation=0.02)
    ...     return Entry(digest=str(number), log="", airframe="a", constants=(read,))
    >>> (trend,) = trends_of([flight(number) for number in range(10)])
    >>> round(trend.slope, 1), round(trend.crossing), trend.between[0] < 25.0 < trend.between[1]
    (0.2, 25, True)
    """
    own = {OFFSET: 5.0, AT_REST: 5.0, FACTOR: _FACTOR} | dict(limits or {})
    keys = tuple(dict.fromkeys(key for each in flights for key in each.by_key if key[1] in own))
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
    found = [_trend(key, lines, at, len(flights), middle, own[key[1]]) for at, key in enumerate(keys)]
    return tuple(sorted((each for each in found if each is not None), key=lambda each: each.crossing))


def _trend(key: Key, lines: Lines, at: int, flights: int, middle: float, limit: float) -> Trend | None:
    from scipy.special import stdtr, stdtrit

    start, _, slope = lines.theta[at].tolist()
    covariance, degrees = lines.covariance[at], float(lines.degrees[at])
    deviation = float(np.sqrt(covariance[2, 2]))
    if 2.0 * float(stdtr(degrees, -abs(slope) / deviation)) > CHANCE / len(lines.theta):
        return None
    usual = 1.0 if key[1] == FACTOR else 0.0
    reaches = usual + np.sign(slope) * limit
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

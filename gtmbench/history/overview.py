"""An airframe's constants over its flights, the worst first: what its page, figure, recording and table show."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.history.constant import NOISE, kind_of
from gtmbench.history.entry import Entry
from gtmbench.history.spread import Key, Prediction, predicted
from gtmbench.history.standing import CHANCE, installed
from gtmbench.history.trend import Trend, trends_of
from gtmbench.values.record import BoolArray, FloatArray, IntArray

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
    return tuple(sorted(found, key=_worst))


def _worst(shown: Overview) -> tuple[bool, bool, float]:
    return not (len(shown.is_apart) and shown.is_apart[-1]), shown.trend is None, shown.chance


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

"""A sensor that is off by a constant, or by what grows.

No scale: what an airspeed reads of gusts would explain itself, and a force hardly changes where nothing turns.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.explanation import Explanation, seconds
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY, MAGNETOMETER, WHOLE, names_of
from gtmbench.values.record import FloatArray

_SHORTEST_S = 10.0  # of a drift: in less it is as good as a step


@dataclass(frozen=True)
class _Bounds:
    """The least error of a channel that is a failure, in its unit, and the most that one has."""

    least: float
    most: float


# in m/s2, m/s, shares of the field, deg and m
_BOUNDS: dict[str, _Bounds] = (
    dict.fromkeys(ACCELEROMETERS, _Bounds(0.7, 40.0))
    | dict.fromkeys(GPS_VELOCITY, _Bounds(1.0, 1000.0))
    | dict.fromkeys(MAGNETOMETER, _Bounds(0.05, 3.0))
    | {
        "tas": _Bounds(2.0, 100.0),
        "alpha": _Bounds(1.5, 60.0),
        "beta": _Bounds(1.5, 60.0),
        "altitude": _Bounds(5.0, 5000.0),
    }
)


def explanations(course: Course) -> list[Explanation]:
    """Return them for every channel that is read, of size one of its unit."""
    return [
        each
        for name, bounds in _BOUNDS.items()
        if course.has(*WHOLE.get(names_of(name)[-1], (name,)))
        for each in _of(course, name, bounds)
    ]


def _of(course: Course, name: str, bounds: _Bounds) -> Iterator[Explanation]:
    unit = course.strength if name in MAGNETOMETER else 1.0
    one = np.full(len(course.flight), unit)
    yield Explanation(
        suspect=name,
        kind="bias",
        effect=partial(_on, name=name, wrong=one),
        low=-bounds.most,
        high=bounds.most,
        least=bounds.least,
    )
    yield Explanation(
        suspect=name,
        kind="drift",
        effect=partial(_on, name=name, wrong=unit * course.flight.time_s),
        price=1.0,
        reach=bounds.most,
        least=bounds.least / 60.0,
        shortest_s=_SHORTEST_S,
        since=seconds,
        base=f"{name} bias",
    )


def _on(_: Flight, *, name: str, wrong: FloatArray) -> Effect:
    return Effect(channels={name: wrong})

"""What changes while every sensor is well: the wind, and an attitude that leans or whose heading is off."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from gtmbench.engine.course.course import WIND, Course
from gtmbench.engine.explanation import Explanation, seconds
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import FloatArray

_MOST_M_S, _LEAST_M_S, _MINUTE_S = 20.0, 0.5, 60.0  # the most that the wind changes by; the least that is worth a word
_LEAN_DEG, _HEADING_DEG, _LEAST_DEG = 10.0, 40.0, 1.0  # the most that an attitude leans, and that is worth a word


def explanations(course: Course) -> list[Explanation]:
    """Return them, of size one m/s, m/s2, deg and deg/s."""
    found: list[Explanation] = []
    if course.has("tas"):
        for name in WIND:
            found += _steps_and_ramps("wind", name, partial(_air, name=name), _MOST_M_S, _LEAST_M_S)
    for angle, name in enumerate(ATTITUDE):
        most = _HEADING_DEG if name == "psi" else _LEAN_DEG
        found += _steps_and_ramps("attitude", name, partial(_turned, angle=angle), most, _LEAST_DEG)
    return found


def _steps_and_ramps(
    suspect: str, name: str, effect: Callable[..., Effect], most: float, least: float
) -> Iterator[Explanation]:
    """Give what is off by a step, and by what grows over a minute or longer."""
    yield Explanation(
        suspect=suspect,
        kind=f"{name} changes",
        effect=partial(effect, ramp=False),
        low=-most,
        high=most,
        least=least,
        lasts=False,
        is_healthy=True,
    )
    yield Explanation(
        suspect=suspect,
        kind=f"{name} drifts",
        effect=partial(effect, ramp=True),
        reach=most,
        least=least / _MINUTE_S,
        since=seconds,
        base=f"{suspect} {name} changes",
        is_healthy=True,
    )


def _air(flight: Flight, *, name: str, ramp: bool) -> Effect:
    return Effect(channels={name: _course_of(flight, ramp=ramp)})


def _turned(flight: Flight, *, angle: int, ramp: bool) -> Effect:
    return Effect(turned=flight.angle_axes[:, :, angle] * _course_of(flight, ramp=ramp)[:, np.newaxis])


def _course_of(flight: Flight, *, ramp: bool) -> FloatArray:
    return flight.time_s if ramp else np.ones(len(flight))

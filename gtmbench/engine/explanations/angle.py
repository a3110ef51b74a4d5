"""An angle that is off: by a step, by what grows, or in proportion to itself.

Where the gyros are known to drive the attitude, phi and theta don't fail by themselves: references lean instead, and
nothing failed.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from gtmbench.engine.explanation import Explanation, seconds
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import FloatArray

MOST_DEG = 40.0  # a bank or pitch that errs by more would have shown in the flight
STEP = "step"  # a bias of an angle
_STEP_DEG, _DRIFT_DEG_S, _SCALE, _SHORTEST_S = 2.0, 0.1, 0.12, 7.0  # the least that fail
_LOWEST, _HIGHEST = -4.0, 3.0  # as a gyro's scale
_PSI = 2


def explanations(flight: Flight) -> list[Explanation]:
    """Return them for each angle, of size one deg, deg/s and one."""
    found = []
    is_driven = flight.is_driven and not flight.is_assumed
    for angle, name in enumerate(ATTITUDE):
        most = np.inf if angle == _PSI else MOST_DEG
        is_pulled = is_driven and angle != _PSI  # then it is no sensor
        found += [
            Explanation(
                suspect=name,
                kind=STEP,
                effect=partial(_off, angle=angle, wrong=_one),
                price=np.inf if is_driven else 1.0,
                low=-max(most, 60.0),
                high=max(most, 60.0),
                least=_STEP_DEG,
                lasts=False,
            ),
            Explanation(
                suspect="references" if is_pulled else name,
                kind=f"drift of {name}" if is_pulled else "drift",
                effect=partial(_off, angle=angle, wrong=_time),
                price=1.0,
                reach=most,
                least=_DRIFT_DEG_S,
                shortest_s=_SHORTEST_S,
                is_healthy=is_pulled,
                axes=(angle,),
                since=seconds,
                base=f"{name} step",
            ),
            Explanation(
                suspect="references" if is_driven else name,
                kind=f"scale of {name}" if is_driven else "scale",
                effect=partial(_scaled, angle=angle),
                price=3.0 if is_driven else 1.0,
                low=_LOWEST,
                high=_HIGHEST,
                least=_SCALE,
                shortest_s=_SHORTEST_S,
                is_healthy=is_driven,
                axes=(angle,),
                mirror=-1.0,
                since=_psi if angle == _PSI else None,
                base=f"{name} step" if angle == _PSI else "",
            ),
        ]
    return found


def _off(flight: Flight, *, angle: int, wrong: Callable[[Flight, int], FloatArray]) -> Effect:
    turned = flight.angle_axes[:, :, angle] * wrong(flight, angle)[:, np.newaxis]
    turning = np.gradient(turned, flight.blocks.period_s, axis=0)
    return Effect(turned=turned, turning=turning)


def _scaled(flight: Flight, *, angle: int) -> Effect:
    """Return an angle that is off by itself; it grows by the gyros' turns, or its own noise would explain itself."""
    axis, own = flight.angle_axes[:, :, angle], flight.angles[:, angle]
    turned = axis * own[:, np.newaxis]
    rotating = np.gradient(axis, flight.blocks.period_s, axis=0)
    return Effect(turned=turned, turning=rotating * own[:, np.newaxis] + axis * flight.turning[:, [angle]])


def _one(flight: Flight, _: int) -> FloatArray:
    return np.ones(len(flight))


def _time(flight: Flight, _: int) -> FloatArray:
    return flight.time_s


def _psi(flight: Flight) -> FloatArray:
    return flight.angles[:, _PSI]

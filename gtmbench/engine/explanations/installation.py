"""What a healthy installation changes by: the attitude's clock, and iron near the compass."""

from __future__ import annotations

from functools import partial

import numpy as np

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect
from gtmbench.values.attitude_estimators import filtered

_LAG_S, _LEAST_S = 1.0, 0.005  # the most that a link delays; a tenth of a sample at 20 Hz
_IRON_DEG, _LEAST_DEG = 40.0, 1.0  # of a compass beside a motor; of one that is calibrated
_COMPASS_S = 5.0  # by which an estimator follows its compass


def explanations(_: Flight) -> list[Explanation]:
    """Return them; of size one second, and of one degree at headings north and east."""
    clock = Explanation(
        suspect="clock",
        kind="lag",
        effect=_lag,
        low=-_LAG_S,
        high=_LAG_S,
        least=_LEAST_S,
        is_healthy=True,
        axes=(0, 1, 2),
    )
    iron = [
        Explanation(
            suspect="compass",
            kind=f"iron {name}",
            effect=partial(_iron, is_east=is_east),
            low=-_IRON_DEG,
            high=_IRON_DEG,
            least=_LEAST_DEG,
            is_healthy=True,
            axes=(2,),
        )
        for name, is_east in (("north", False), ("east", True))
    ]
    return [clock, *iron]


def _lag(flight: Flight) -> Effect:
    return Effect(gains=np.gradient(flight.gyros, flight.blocks.period_s, axis=0))


def _iron(flight: Flight, *, is_east: bool) -> Effect:
    """Return a heading that is off by the sine, or cosine, of itself, as an estimator follows it."""
    psi = np.radians(flight.angles[:, 2])
    wrong = np.cos(psi) if is_east else np.sin(psi)
    step = flight.blocks.period_s
    off = filtered([step / _COMPASS_S], [1.0, -(1.0 - step / _COMPASS_S)], wrong - wrong[0]) + wrong[0]
    turning = flight.angle_axes[:, :, 2] * np.gradient(off, step)[:, np.newaxis]
    return Effect(turning=turning)

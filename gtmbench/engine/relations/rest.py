"""Gyros while the aircraft stands: y = what they read, in deg/s.

Standing says nothing about gains: in proportion to what a gyro reads there, its own noise would explain itself.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, Relation
from gtmbench.engine.relations.attitude import others_rough
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

_LEAST_S = 10.0  # of standing, that tell an offset
_OFFSET_DEG_S, _FLOOR_DEG_S, _WANDER_DEG_S = 3.0, 0.1, 0.1  # of a gyro that isn't calibrated; that warms up


def relation(flight: Flight) -> Relation | None:
    """Return the relation of a flight's gyros at rest; None where it doesn't stand."""
    stands = flight.stands
    if np.count_nonzero(stands) * flight.blocks.period_s < _LEAST_S:
        return None
    return Relation(
        name="rest",
        channels=GYROS,
        said="{} while the aircraft stands",
        unit="deg/s",
        values=np.where(stands[:, np.newaxis], flight.blocks.gyros, np.nan),
        regressors=np.ones((len(flight), 3, 1)),
        prior=np.array([_OFFSET_DEG_S]),
        floor=np.array([_FLOOR_DEG_S]),
        wander=_WANDER_DEG_S,
        asked=stands,
        response=response,
        regime=others_rough(flight),
    )


def response(_: Flight, effect: Effect) -> FloatArray | None:
    """Return what the gyros are off by, whatever they read."""
    return effect.gyros

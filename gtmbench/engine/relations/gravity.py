"""The attitude against the specific force: y = by how much they disagree about the vertical, in deg.

An accelerometer feels every acceleration, so this is a witness: it says nothing of a size.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, Relation
from gtmbench.values.record import FloatArray

_HALF = 0.5  # of the judged blocks have to hold a force near 1 g
_WANDER_DEG = 2.0  # by accelerations that last
_ANGLE_DEG, _RATE_DEG_S = 30.0, 10.0  # what a constant is a tilt at: so that all have one prior


def relation(flight: Flight) -> Relation | None:
    """Return the relation of a flight's attitude and accelerometers; None where most forces aren't near 1 g."""
    lean = flight.lean
    if not flight.judged.any() or np.isfinite(lean[flight.judged]).mean() < _HALF:
        return None
    phi, theta = flight.angles[:, 0] / _ANGLE_DEG, flight.angles[:, 1] / _ANGLE_DEG
    turning = np.nan_to_num(flight.blocks.rates[:, 2]) / _RATE_DEG_S
    columns = np.column_stack([np.ones(len(flight)), phi, theta, turning])
    return Relation(
        name="gravity",
        channels=("roll", "pitch"),
        said="{} by the attitude, less by the specific force",
        unit="deg",
        values=lean,
        regressors=np.stack([columns, columns], axis=1),
        prior=np.full(4, 10.0),
        floor=np.ones(4),
        wander=_WANDER_DEG,
        asked=flight.judged,
        response=response,
        shift=shift,
        is_witness=True,
    )


def response(flight: Flight, effect: Effect) -> FloatArray | None:
    """Return the tilt that the attitude is off by, about forward and right, in deg."""
    return None if effect.turned is None else flight.levelled(effect.turned)


def shift(flight: Flight, effect: Effect) -> FloatArray | None:
    """Return by how much phi and theta are off among the regressors, as they stand there.

    The force of a multicopter stands along its own axis: it leans with phi and theta, whatever they are, and tells
    nothing of them.
    """
    if effect.turned is None:
        return None
    tilt = flight.levelled(effect.turned) / _ANGLE_DEG
    none = np.zeros(len(tilt))
    columns = np.column_stack([none, tilt[:, 0], tilt[:, 1], none])
    return np.stack([columns, columns], axis=1)

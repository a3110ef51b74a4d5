"""How rough each gyro is beside the others: y = the logarithm of its mean square second difference.

What shakes the aircraft raises all of them; a gyro that gets noisy rises alone.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, Relation
from gtmbench.engine.relations.attitude import log_rough, others_rough
from gtmbench.values.channels import GYROS
from gtmbench.values.record import BoolArray, FloatArray

_PRIOR = np.array([10.0, 1.0, 1.0])  # level, share of the others', power of the liveliness
_FLOOR = np.array([0.2, 0.05, 0.08])  # from one part of a log to another
_WANDER = 0.8  # by engines that change: half as loud again
_LIVELIEST, _MOVES = 0.9, 0.2  # motion: more than this share of what the liveliest tenth has at least


def relation(flight: Flight) -> Relation | None:
    """Return the relation of a flight's gyros' noise, in motion: engines, air and runways make noise, too."""
    one, lively = np.ones(len(flight)), np.log(flight.lively)
    others = others_rough(flight)
    columns = [np.column_stack([one, others[:, axis], lively]) for axis in range(3)]
    return Relation(
        name="roughness",
        channels=GYROS,
        said="roughness of {}, as a logarithm",
        unit="",
        values=log_rough(flight),
        regressors=np.stack(columns, axis=1),
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER,
        asked=in_motion(flight),
        response=response,
        enters=GYROS,
    )


def in_motion(flight: Flight) -> BoolArray:
    """Tell in which blocks a flight moves so much that what its gyros shake by is told by motion."""
    return np.asarray(flight.judged & (flight.lively > _MOVES * np.quantile(flight.lively, _LIVELIEST)))


def response(_: Flight, effect: Effect) -> FloatArray | None:
    """Return by how much the logarithm of the gyros' roughness rises."""
    return effect.rough

"""How rough gyros of a further IMU are, beside those that are watched: y = log of one's roughness less the other's.

What shakes the aircraft raises both; a gyro that gets noisy rises alone, whichever of both it is.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.imu import FlightImu, rough_of
from gtmbench.engine.relation import BETWEEN, Effect, Relation
from gtmbench.engine.relations.attitude import log_rough, others_rough
from gtmbench.engine.relations.roughness import in_motion
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

# level, share of what shakes both about the other axes, power of the liveliness
_PRIOR, _FLOOR = np.array([10.0, 0.5, 1.0]), np.array([0.2, 0.05, 0.08])
_WANDER = 0.3  # by what shakes one IMU more than the other


def relations(flight: Flight) -> list[Relation]:
    """Return the relation of each further IMU, but of one whose axes lie along none of the aircraft's."""
    return [_relation(flight, imu) for imu in flight.compared]


def _relation(flight: Flight, imu: FlightImu) -> Relation:
    own = flight.by(imu)
    one, lively = np.ones(len(flight)), np.log(flight.lively)
    watched, others = log_rough(flight), 0.5 * (others_rough(own) + others_rough(flight))
    columns = [np.column_stack([one, others[:, axis], lively]) for axis in range(3)]

    def response(_: Flight, effect: Effect) -> FloatArray | None:
        told = effect.channels or {}
        found = np.column_stack([told.get(rough_of(channel), 0.0 * one) for channel in imu.channels])
        found = found if effect.rough is None else found - effect.rough
        return found if found.any() else None

    return Relation(
        name=f"{BETWEEN}: roughness of {imu.name}",
        channels=imu.channels,
        said="roughness of {} less that of the watched one, as a logarithm",
        unit="",
        values=log_rough(own) - watched,
        regressors=np.stack(columns, axis=1),
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER,
        asked=in_motion(flight),
        response=response,
        enters=(*GYROS, *imu.channels),
    )

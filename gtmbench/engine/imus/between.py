"""Gyros of a further IMU against those that are watched: y = one less the other, in deg/s.

Offsets, gains, misalignments and a lag are constants of the installation. Attitude and motion are in both, so a gyro
that is off shows here within a block; which of both it is, other relations tell.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.imu import FlightImu
from gtmbench.engine.relation import BETWEEN, Effect, Relation
from gtmbench.engine.relations.attitude import others_rough
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

# offset (deg/s), three gains, lag (s)
_PRIOR = np.array([3.0, 0.1, 0.1, 0.1, 0.1])
_FLOOR = np.array([0.07, 0.02, 0.02, 0.02, 0.01])  # from one part of a log to another
_WANDER_DEG_S, _LEAST_DEG_S = 0.05, 0.02  # by vibration that aliases; of noise


def relations(flight: Flight) -> list[Relation]:
    """Return the relation of each further IMU, but of one whose axes lie along none of the aircraft's."""
    return [_relation(flight, imu) for imu in flight.compared]


def relation_of(imu: FlightImu) -> str:
    """Return what the relation of a further IMU is called."""
    return f"{BETWEEN}: {imu.name}"


def _relation(flight: Flight, imu: FlightImu) -> Relation:
    gyros = flight.gyros
    slopes = np.gradient(gyros, flight.blocks.period_s, axis=0)
    one = np.ones(len(flight))
    columns = [np.column_stack([one, gyros, slopes[:, axis]]) for axis in range(3)]

    def response(_: Flight, effect: Effect) -> FloatArray | None:
        parts = [-part for part in (effect.gyros, effect.gains) if part is not None]
        told = effect.channels or {}
        own = [told.get(name) for name in imu.channels]
        if any(each is not None for each in own):
            none = np.zeros(len(flight))
            parts.append(np.column_stack([none if each is None else each for each in own]))
        return sum(parts[1:], parts[0]) if parts else None

    return Relation(
        name=relation_of(imu),
        channels=imu.channels,
        said="{} less that of the watched one",
        unit="deg/s",
        values=imu.gyros - flight.blocks.gyros,
        regressors=np.stack(columns, axis=1),
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER_DEG_S,
        least=_LEAST_DEG_S,
        asked=flight.judged,
        response=response,
        regime=others_rough(flight),
        enters=GYROS,
        is_of_axes=True,
    )

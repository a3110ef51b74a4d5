"""Gyros against the attitude's turning: y = gyro - rate, in deg/s.

Offsets, gains, misalignments, a lag and a pull of references that grows with the angle are constants of a healthy
installation. A gyro that is off shows in y itself where the attitude has sources of its own; where the gyros drive it,
by how references turn it back.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.flight import Flight, trailing_means
from gtmbench.engine.relation import Effect, Relation
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

# offset (deg/s), three gains, lag (s), pull by phi or theta (deg/s a deg)
_PRIOR = np.array([3.0, 0.1, 0.1, 0.1, 0.1, 0.03])
_FLOOR = np.array([0.1, 0.02, 0.02, 0.02, 0.01, 0.01])  # from one part of a log to another
_WANDER_DEG_S = 0.2  # by references that correct an estimator


def relation(flight: Flight) -> Relation | None:
    """Return the relation of a flight's gyros and attitude."""
    blocks = flight.blocks
    gyros = np.nan_to_num(blocks.gyros)
    slopes = np.gradient(gyros, blocks.period_s, axis=0)
    one, none = np.ones(len(flight)), np.zeros(len(flight))
    pulls = (flight.angles[:, 0], flight.angles[:, 1], none)
    columns = [np.column_stack([one, gyros, slopes[:, axis], pulls[axis]]) for axis in range(3)]
    return Relation(
        name="attitude",
        channels=GYROS,
        said="{} less the attitude's rate",
        unit="deg/s",
        values=blocks.gyros - blocks.rates,
        regressors=np.stack(columns, axis=1),
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER_DEG_S,
        asked=flight.judged,
        response=response,
        enters=GYROS,
        is_of_axes=True,
        regime=others_rough(flight),
    )


def response(flight: Flight, effect: Effect) -> FloatArray | None:
    """Return f - C' (de/dt): f what the gyros are off by, e what the attitude is, C from body to earth axes."""
    parts = [part for part in (effect.gyros, effect.gains) if part is not None]
    if effect.turning is not None:
        parts.append(-np.einsum("nji,nj->ni", flight.matrices, effect.turning))
    return sum(parts[1:], parts[0]) if parts else None


def others_rough(flight: Flight) -> FloatArray:
    """Return how rough the other two gyros are: one's own would hide that it is noisy; shape (blocks, 3)."""
    rough = log_rough(flight)
    return np.stack([np.delete(rough, axis, axis=1).mean(axis=1) for axis in range(3)], axis=1)


def log_rough(flight: Flight) -> FloatArray:
    """Return the logarithm of each gyro's roughness over about a second, shape (blocks, 3); NaN where it is missing.

    Of less than half a second it is none: by luck a few samples are as smooth as no noise is, and its logarithm tells.
    """
    return np.asarray(np.log(over_second(flight, flight.blocks.rough) + 1e-8))


def over_second(flight: Flight, values: FloatArray) -> FloatArray:
    """Return means over about a second that ends with each block; NaN where less than half of it is known."""
    over = max(round(1.0 / flight.blocks.period_s), 1)
    return trailing_means(values, over, (over + 1) // 2)

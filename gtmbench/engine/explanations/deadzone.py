"""A gyro that reads nothing of small turns and less of all others."""

from __future__ import annotations

import numpy as np

from gtmbench.engine.explanation import Explanation, of_gyros
from gtmbench.engine.flight import Flight
from gtmbench.values.record import FloatArray

_LEAST_DEG_S, _SHORTEST_S, _PRICE = 0.2, 15.0, 3.0
_READS_DEG_S = 0.15  # more than nothing


def explanations(flight: Flight) -> list[Explanation]:
    """Return them for each gyro, of a half width of one deg/s."""
    most = 2.0 * float(flight.spread.max()) + 1.0
    return of_gyros(
        "deadzone", wrong, price=_PRICE, low=0.0, high=most, least=_LEAST_DEG_S, shortest_s=_SHORTEST_S, is_gain=True
    )


def wrong(flight: Flight, axis: int) -> FloatArray:
    """Return -sign(y) where the gyro reads anything."""
    read = flight.gyros[:, axis]
    return np.where(np.abs(read) > _READS_DEG_S, -np.sign(read), 0.0)

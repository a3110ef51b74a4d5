"""A gyro that reads a part of its turns, or more: e = k y, so that its factor is 1 / (1 - k); k = 2 turns its sign."""

from __future__ import annotations

from gtmbench.engine.explanation import Explanation, of_gyros
from gtmbench.engine.flight import Flight
from gtmbench.values.record import FloatArray

_LOWEST, _HIGHEST, _LEAST, _SHORTEST_S = -4.0, 3.0, 0.12, 7.0  # beyond, it is another motion


def explanations(_: Flight) -> list[Explanation]:
    """Return them for each gyro."""
    return of_gyros(
        "scale", wrong, low=_LOWEST, high=_HIGHEST, least=_LEAST, shortest_s=_SHORTEST_S, is_gain=True, mirror=1.0
    )


def wrong(flight: Flight, axis: int) -> FloatArray:
    """Return what the gyro reads."""
    return flight.gyros[:, axis]

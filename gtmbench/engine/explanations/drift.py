"""A gyro whose error grows from its onset on."""

from __future__ import annotations

from gtmbench.engine.explanation import Explanation, of_gyros
from gtmbench.engine.flight import Flight
from gtmbench.values.record import FloatArray

_LEAST_DEG_S2, _SHORTEST_S = 0.01, 15.0  # in less a ramp is as good as a step


def explanations(_: Flight) -> list[Explanation]:
    """Return them for each gyro, of size one deg/s^2."""
    return of_gyros("drift", wrong, price=1.0, least=_LEAST_DEG_S2, shortest_s=_SHORTEST_S, since=seconds, base="bias")


def wrong(flight: Flight, _: int) -> FloatArray:
    """Return the time since the log began; that of the onset is taken off."""
    return flight.time_s


def seconds(flight: Flight) -> FloatArray:
    """Return the time since the log began, at each block's beginning."""
    return flight.time_s - 0.5 * flight.blocks.period_s

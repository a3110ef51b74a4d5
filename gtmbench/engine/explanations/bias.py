"""A gyro that reads a constant too much."""

from __future__ import annotations

import numpy as np

from gtmbench.engine.explanation import Explanation, of_gyros
from gtmbench.engine.flight import Flight
from gtmbench.values.record import FloatArray

_LEAST_DEG_S = 0.4  # a gyro that warms up changes by as much


def explanations(_: Flight) -> list[Explanation]:
    """Return them for each gyro, of size one deg/s."""
    return of_gyros("bias", wrong, least=_LEAST_DEG_S)


def wrong(flight: Flight, _: int) -> FloatArray:
    """Return 1."""
    return np.ones(len(flight))

"""A gyro that gets noisy: the logarithm of its roughness rises."""

from __future__ import annotations

from functools import partial

import numpy as np

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, on_axis
from gtmbench.values.channels import GYROS

PRICE = 8.0  # shaking that one axis feels alone isn't rare
LEAST = 1.5  # e^1.5 is twice the deviation


def explanations(_: Flight) -> list[Explanation]:
    """Return one for each gyro, of size one in the logarithm of its power."""
    return [
        Explanation(suspect=gyro, kind="noise", effect=partial(_rougher, axis=axis), price=PRICE, low=0.0, least=LEAST)
        for axis, gyro in enumerate(GYROS)
    ]


def _rougher(flight: Flight, *, axis: int) -> Effect:
    return Effect(rough=on_axis(np.ones(len(flight)), axis))

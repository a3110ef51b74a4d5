"""What an explanation does to the readings of a flight, relation by relation the same."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gtmbench.values.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Effect:
    """What readings are off by, of size one; each of shape (blocks, 3), None for nothing."""

    gyros: FloatArray | None = field(default=None, repr=False)  # added to what p, q, r read, whatever they read
    # added likewise, but in proportion to what they read: nothing of it is seen at rest
    gains: FloatArray | None = field(default=None, repr=False)
    # how far the attitude is off, as a rotation vector in earth axes
    turned: FloatArray | None = field(default=None, repr=False)
    turning: FloatArray | None = field(default=None, repr=False)  # how fast that grows
    rough: FloatArray | None = field(default=None, repr=False)  # added to the logarithm of the gyros' roughness
    # by channel, shape (blocks,): added to what other sensors read, in the units of `Course`
    channels: Mapping[str, FloatArray] | None = field(default=None, repr=False)


def on_axis(values: FloatArray, axis: int) -> FloatArray:
    """Return values in one of three columns, zeros in the others, shape (blocks, 3).

    >>> on_axis(np.array([1.0, 2.0]), 1).tolist()
    [[0.0, 1.0, 0.0], [0.0, 2.0, 0.0]]
    """
    columns = np.zeros((len(values), 3))
    columns[:, axis] = values
    return columns

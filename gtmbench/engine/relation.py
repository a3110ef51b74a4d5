"""A relation between sensors: what it is off by, what it may be off by in health, and how it answers to an effect."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.values.record import BoolArray, FloatArray


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


BETWEEN = "between IMUs"  # relations are called so that hold one against another
Response = Callable[[Flight, Effect], FloatArray | None]


@dataclass(frozen=True, kw_only=True, eq=False)
class Relation:
    """y = X theta + e over blocks, of each of its channels."""

    name: str
    channels: tuple[str, ...]  # whose equation each is
    # said, unit: what y is, in words, {} for the channel, and its unit; "" of a number
    said: str
    unit: str
    values: FloatArray = field(repr=False)  # shape (blocks, channels): y; NaN where it isn't known
    regressors: FloatArray = field(repr=False)  # shape (blocks, channels, constants): X
    # shape (constants,): how large constants are in health: standard deviations about zero
    prior: FloatArray = field(repr=False)
    # shape (constants,): by how much they may differ from one part of a log to another
    floor: FloatArray = field(repr=False)
    wander: float  # by how much means over some seconds wander at least, in y's unit
    asked: BoolArray = field(repr=False)  # shape (blocks,): blocks in which it is judged
    # from a flight and an effect to what y is off by, shape (blocks, channels); None for nothing
    response: Response = field(repr=False)
    # from a flight and an effect to what the regressors are off by, shape (blocks, channels, constants), where they are
    # made of the attitude; None for nothing
    shift: Response | None = field(default=None, repr=False)
    # shape (blocks, channels): what its noise depends on beside the liveliness of the motion
    regime: FloatArray | None = field(default=None, repr=False)
    least: float = 0.0  # the least noise that it is given, in y's unit: what repeats itself has none
    enters: tuple[str, ...] = ()  # the gyros that enter each of its equations, beside the one that it is of
    is_of_axes: bool = False  # whether its channels are gyros, and each shows its own one first
    is_witness: bool = False  # whether it has no say in a fault's size, and at most half of the evidence

    def title(self, channel: int) -> str:
        """Return what y of a channel is, in words."""
        return self.said.format(self.channels[channel])

    def answer(self, flight: Flight, effect: Effect, channel: int, constants: FloatArray) -> FloatArray | None:
        """Return what an effect adds to y - X theta of a channel, shape (blocks,); None for nothing."""
        response = self.response(flight, effect)
        shifted = None if self.shift is None else self.shift(flight, effect)
        if response is None:
            return None
        return response[:, channel] - (0.0 if shifted is None else shifted[:, channel] @ constants)

"""A relation between sensors: what it is off by, what it may be off by in health, and how it answers to an effect."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from gtmbench.engine.effect import Effect
from gtmbench.engine.flight import Flight
from gtmbench.values.record import BoolArray, FloatArray

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

"""How a kind of fault shows: what its class says of it to the engines that look for it, and how large it usually is."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Literal, NamedTuple, get_args

import numpy as np

from gtmbench.checks import listed, number, shown
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray

How = Literal[
    "linear",  # it adds so much of a shape that the class gives: size times what it reads at size one
    "search",  # values of one parameter are tried on the class
    "gain",  # linear; near -1 it is a wrong sign
    "sign",
    "fixed",  # no parameter: what the class reads
    "tone",  # its frequency is where the spectrum of the residual peaks
    "white",  # noise, by its spectrum
    "walk",  # a random walk, by its spectrum
    "spikes",
    "last",  # one reading for good: the last healthy one,
    "beyond",  # one beyond all healthy ones,
    "constant",  # or any other
    "repeated",  # readings are repeated evenly
    "rounded",  # readings are whole multiples of one
    "turned",  # it mixes two sensors of the same make
    "swapped",  # it changes two of them
]
PassesFor = Literal["motion", "loop", "turn", "estimator", "excitation"]
HELD: tuple[How, ...] = ("last", "constant", "beyond", "repeated")  # the same reading again and again
CONSTANT = HELD[:3]  # all but a stretch that is told again: those read one value
SHOWN: tuple[How, ...] = (*HELD, "rounded")  # by the sensor's own readings
Of = Literal["", "reach", "slew"]
Read = Literal["", "limit", "step"]
When = Literal["", "late", "growing", "traced", "straight"]


@dataclass(frozen=True, kw_only=True)
class Shape:
    """How a kind of fault shows to a diagnosis, which compares it with what every other kind would have read.

    Attributes
    ----------
    how : str
        How it is looked for: "linear", "search" or "fixed"; others are those of kinds that there are.
    family : str
        Kinds that studies leave out together.
    parameter : str
        The one that is found.
    healthy : float
        Of "linear": the parameter at which nothing is wrong. Reads F(y; healthy + s) = y + s (F(y; healthy + 1) - y).
    size : str
        Of "search": another parameter, in which the kind is linear about zero; it is found beside.
    low, high : float
        Of "search": between which values it is looked for, in the parameter's unit, or times `of`.
    of : str
        "reach": the most that the sensor should have read; "slew": twice the fastest that it should have changed.
    read : str
        Of "search": what the readings show it as: the "limit" that they meet again and again, their usual "step".
    when : str
        What has to be seen before it is tried: readings that are "late", an error that is "growing", readings that are
        "straight" (held) or "traced" (held or clipped).
    price : float
        What the kind costs a priori, in nats: the logarithm of how much rarer it is than others.
    column, beside : str
        Of "linear": a diagnosis' own name of the shape; "felt" for what each accelerometer reads.
    spread : float
        By how much its parameter's error is larger than noise alone lets expect.
    passes_for : tuple of str
        What healthy looks like it: "motion" (a model's error in it, filters, mounts, vibration), the answer of a "loop"
        to another sensor's fault, of a gyro a "turn" that its angle reads, of an angle an "estimator" set anew, another
        "excitation" than was learnt.
    of_angle : tuple of str
        Of a gyro: the kinds of its angle that look the same near wings level.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.Shape(how="search", parameter="fading_s", low=0.5, high=60.0).family
    'own'
    >>> gb.Shape(how="linear", parameter="size", price=-1.0)
    Traceback (most recent call last):
    gtmbench.errors.InputError: shape: price is -1.0; it must be a finite number, 0 or more
    """

    how: How
    family: str = "own"
    parameter: str = ""
    healthy: float = 0.0
    size: str = ""
    low: float = 0.0
    high: float = 0.0
    of: Of = ""
    read: Read = ""
    when: When = ""
    price: float = 0.0
    column: str = ""
    beside: str = ""
    spread: float = 1.0
    passes_for: tuple[PassesFor, ...] = ()
    of_angle: tuple[str, ...] = ()

    @property
    def figure(self) -> str:
        """The parameter that says how large it is."""
        return self.size or self.parameter

    def __post_init__(self) -> None:
        for name, of in (("how", How), ("of", Of), ("read", Read), ("when", When)):
            legal = get_args(of)
            if (value := getattr(self, name)) not in legal:
                raise InputError(f"shape: {name} is {shown(value)}; it must be {listed(filter(None, legal), 'or')}")
        number("shape: price", self.price, 0.0)
        number("shape: healthy", self.healthy)
        if self.how == "search":
            number("shape: low", self.low, 0.0, above=True)
            number("shape: high", self.high, self.low, above=True)


@dataclass(frozen=True, kw_only=True)
class WholeLog:
    """How a kind shows to the engine that judges a whole log: as an error of a gyro that is linear in its size."""

    # from what a gyro reads and the times, each of shape (blocks,), to what it reads too much at size one
    wrong: Callable[[FloatArray, FloatArray], FloatArray] = field(repr=False)
    name: str = ""  # as the engine calls it, if not as the kind is called
    price: float = 0.0  # minus the log of its odds a priori, in nats
    # low, high: between what its size is
    low: float = -math.inf
    high: float = math.inf
    of_motion: bool = False  # whether `high` is times the largest deviation of a gyro, and one more
    least: float = 0.0  # what is smaller is no failure
    shortest_s: float = 0.0  # in less it looks like another one, or like chance
    is_gain: bool = False  # whether it needs motion to show
    mirror: float = math.nan  # the size at which a gyro's own noise explains itself; NaN for none
    grows_from: str = ""  # the kind that its beginning looks like, where it grows with the time since its onset
    # from a size to the class's parameter, where that isn't the size
    parameter: Callable[[float], float] | None = field(default=None, repr=False)


@dataclass(frozen=True, kw_only=True)
class Typical:
    """How large a kind usually is: for pictures, campaigns, studies and certificates.

    Attributes
    ----------
    shown : mapping
        Parameters with which it is well seen on a gyro that turns by 20 deg/s; "axis" and "other" for another gyro.
    gyro, angle : tuple of float
        Mild and strong figures of its parameter, in the channel's unit or in percents of something.
    of : str
        What these are percents of: "rms", "peak" or "slew".
    certified_s : float or None
        Within which a certificate lets it be detected; None for kinds that certificates leave out.
    largest : str
        What a sensor is called that has the largest there is.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.Typical(shown={"share": 0.5}, gyro=(0.2, 0.8)).gyro[-1]
    0.8
    """

    shown: Mapping[str, object] = field(default_factory=dict)
    gyro: tuple[float, ...] = (0.0,)
    angle: tuple[float, ...] = (0.0,)
    of: str = ""
    certified_s: float | None = None
    largest: str = ""


_OF_NOISE = 3.0  # deviations


class Same(NamedTuple):
    """When a fault reads what another kind would: by the readings before it, and those since; and why."""

    reads: Callable[[FloatArray, FloatArray], bool]
    why: str


def is_always(*_: FloatArray) -> bool:
    """Whatever it reads."""
    return True


def is_beyond(before: FloatArray, since: FloatArray) -> bool:
    """Whether it reads more than it ever read before."""
    return len(before) > 0 and bool(abs(since[-1]) > np.abs(before).max())


def is_last(before: FloatArray, since: FloatArray) -> bool:
    """Whether it reads what it read last, within the noise: what changes from one reading to the next."""
    if len(before) < 2:
        return False
    noise = float(np.sqrt(0.5 * np.mean(np.square(np.diff(before)))))
    return bool(abs(since[-1] - before[-1]) <= _OF_NOISE * noise)


def is_constant(_: FloatArray, since: FloatArray) -> bool:
    """Whether it has read one value ever since."""
    return bool(np.ptp(since) == 0.0)


def is_one_sided(_: FloatArray, since: FloatArray) -> bool:
    """Whether its readings have never reached zero since."""
    return bool(np.all(since > 0.0) or np.all(since < 0.0))

"""The sensor chain: filter, delay, sample rate and quantum between the motion and what an autopilot reads of it.

Of one sensor, with x the motion in its unit and Ts the simulation's sample period,

    y'(t) = 2 pi f (x(t) - y(t))           the anti-alias filter, exact for straight lines between samples
    z(t)  = y(t - delay)                   the transport delay, by straight lines between samples
    s(j)  = round((z(t_j) + noise)/quantum) quantum,    t_j: every 1/rate seconds, at the next sample of the simulation

and the reading is the last s. Faults act on the reading, as `inject` puts them into a record.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from functools import partial
from types import MappingProxyType
from typing import Any

import numpy as np

from gtmbench.checks import keys, meant, number, shown, table_of
from gtmbench.errors import InputError
from gtmbench.values.channels import CHANNELS, SENSORS
from gtmbench.values.record import FloatArray

IDEAL, CHAIN = "ideal", "chain"  # sensors by name: without delay at every sample, and the aircraft's own chain
_FASTEST_HZ, _LARGEST = 1e5, 1e6  # of what a file may state

Step = Callable[[float, float], float]
Chained = Callable[[Sequence[float], Sequence[float]], list[float]]


@dataclass(frozen=True, kw_only=True)
class SensorPath:
    """The way of one sensor's reading to the autopilot. What is left out is ideal.

    Attributes
    ----------
    rate_hz : float or None
        How many samples a second; between them the last is held. None: one at every sample of the simulation.
    delay_s : float
        How late a sample is, in seconds, at most 2.
    filter_hz : float or None
        The corner frequency of the anti-alias filter, which is of first order. None: no filter.
    quantum : float
        The reading's step, in the channel's unit; 0: none.
    noise : float or None
        The standard deviation of the white noise of a sample, in the channel's unit. None: the T2's.

    Raises
    ------
    InputError
        If a value is invalid.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.SensorPath(rate_hz=50.0, delay_s=0.055, quantum=0.01).noise is None
    True
    """

    rate_hz: float | None = None
    delay_s: float = 0.0
    filter_hz: float | None = None
    quantum: float = 0.0
    noise: float | None = None

    def __post_init__(self) -> None:
        for name, most in (("rate_hz", _FASTEST_HZ), ("filter_hz", _FASTEST_HZ)):
            if (value := getattr(self, name)) is not None:
                object.__setattr__(self, name, number(name, value, 1e-3, most))
        # nobody flies on a sensor that is later
        object.__setattr__(self, "delay_s", number("delay_s", self.delay_s, 0.0, 2.0))
        object.__setattr__(self, "quantum", number("quantum", self.quantum, 0.0, _LARGEST))
        if self.noise is not None:
            object.__setattr__(self, "noise", number("noise", self.noise, 0.0, _LARGEST))

    def start(self, sample_period_s: float, louder: float) -> Step:
        """Return a function from a sample's motion and T2's noise to the reading; `louder` scales the noise."""
        filtered = _filtering(self.filter_hz, sample_period_s)
        delayed = _delaying(self.delay_s / sample_period_s)
        per_sample = 1.0 if self.rate_hz is None else min(self.rate_hz * sample_period_s, 1.0)
        quantum = self.quantum
        held = math.nan
        count = 0

        def step(motion: float, noise: float) -> float:
            nonlocal held, count
            late = delayed(filtered(motion))
            # fresh where another whole sample has become due; the small number is for rates that rounding can't hold
            if count == 0 or int(count * per_sample + 1e-9) != int((count - 1) * per_sample + 1e-9):
                held = late + louder * noise
                if quantum:
                    held = round(held / quantum) * quantum
            count += 1
            return held

        return step


def _wrapping(step: Step) -> Step:
    """Return a step of an angle that wraps at 180 deg: nothing reads what lies between its two ends."""
    before, turned = math.nan, 0.0

    def wrapping_step(angle_deg: float, noise: float) -> float:
        nonlocal before, turned
        if abs(angle_deg - before) > 180.0:
            turned += math.copysign(360.0, before - angle_deg)
        before = angle_deg
        reading = step(angle_deg + turned, noise)
        return (reading + 180.0) % 360.0 - 180.0 if abs(reading) > 180.0 else reading

    return wrapping_step


def _filtering(corner_hz: float | None, sample_period_s: float) -> Callable[[float], float]:
    """Return the filter of first order, exact for straight lines between samples; it begins at rest."""
    if corner_hz is None:
        return lambda value: value
    span = 2.0 * math.pi * corner_hz * sample_period_s
    kept = math.exp(-span)
    new, old = 1.0 - (1.0 - kept) / span, (1.0 - kept) / span - kept
    last: tuple[float, float] | None = None  # what went in, and what came out

    def filtered(value: float) -> float:
        nonlocal last
        before, out = (value, value) if last is None else last
        out = kept * out + new * value + old * before
        last = value, out
        return out

    return filtered


def _delaying(samples: float) -> Callable[[float], float]:
    """Return a delay of so many samples, by straight lines between them; before the first sample it reads that."""
    if not samples:
        return lambda value: value
    whole = int(samples + 1e-9)
    part = samples - whole if samples - whole > 1e-9 else 0.0
    kept: deque[float] = deque(maxlen=whole + 2)

    def delayed(value: float) -> float:
        if not kept:
            kept.extend([value] * (whole + 2))
        else:
            kept.append(value)
        return (1.0 - part) * kept[1] + part * kept[0]

    return delayed


@dataclass(frozen=True, kw_only=True)
class SensorChain:
    """The chain of all sensors, by channel; those left out are ideal.

    Attributes
    ----------
    paths : mapping of str to SensorPath

    Raises
    ------
    InputError
        If a channel isn't a sensor.

    Examples
    --------
    Any aircraft can have one, in its ``aircraft.toml`` or here:

    >>> import gtmbench as gb
    >>> chain = gb.SensorChain(paths={"p": gb.SensorPath(delay_s=0.02)})
    >>> truth = gb.fly(duration_s=1.0)
    >>> late = gb.measure(truth, noise="t2", sensors=chain)
    >>> noise = gb.measure(truth, noise="t2")["p"] - truth["p"]
    >>> bool(abs(late["p"][50] - (truth["p"][48] + noise[50])) < 1e-12)
    True
    """

    paths: Mapping[str, SensorPath] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name in self.paths:
            if name not in SENSORS:
                known = f"there are {', '.join(SENSORS)}{meant(name, SENSORS)}"
                raise InputError(f"chain: no sensor {shown(name)}; {known}")
        object.__setattr__(self, "paths", MappingProxyType(dict(self.paths)))

    def __reduce__(self) -> tuple[Any, ...]:
        return partial(SensorChain, paths=dict(self.paths)), ()

    @property
    def table(self) -> dict[str, dict[str, float]]:
        """As plain values, which `chain_of_table` reads."""
        usual = vars(SensorPath())  # a noise of 0 isn't the usual one, which is the T2's
        return {
            name: {key: value for key, value in vars(path).items() if value != usual[key]}
            for name, path in self.paths.items()
        }

    def start(self, sample_period_s: float, channels: Sequence[str] = SENSORS) -> Chained:
        """Return a function of a sample's motion and T2's noise, each in the order of the channels."""
        steps = [
            (column, _wrapping(step) if name == "phi" else step)
            for column, name in enumerate(channels)
            if (path := self.paths.get(name)) is not None
            for louder in (1.0 if path.noise is None else path.noise / CHANNELS[name].noise,)
            for step in (path.start(sample_period_s, louder),)
        ]

        def read(motion: Sequence[float], noise: Sequence[float]) -> list[float]:
            sample = [value + error for value, error in zip(motion, noise, strict=False)]
            for column, step in steps:
                sample[column] = step(motion[column], noise[column])
            return sample

        return read

    def readings(
        self, motion: FloatArray, noise: FloatArray, sample_period_s: float, channels: Sequence[str]
    ) -> FloatArray:
        """Return what the sensors read of a motion and the T2's noise, both of shape (samples, channels)."""
        read = self.start(sample_period_s, channels)
        return np.array([read(*row) for row in zip(motion.tolist(), noise.tolist(), strict=True)])


def chain_of_table(table: Mapping[str, Any]) -> SensorChain:
    """Return the chain of a table ``[chain]``: by sensor, what its way is.

    >>> chain_of_table({"phi": {"rate_hz": 50, "delay_s": 0.055}}).paths["phi"].rate_hz
    50.0
    """
    known = keys(dict(table), SENSORS, section=CHAIN)
    paths = {}
    for name, given in known.items():
        section = f"{CHAIN}.{name}"
        own = keys(table_of(section, given), [each.name for each in fields(SensorPath)], section=section)
        try:
            paths[name] = SensorPath(**own)
        except InputError as error:
            raise InputError(f"{section}.{error}") from error
    return SensorChain(paths=paths)

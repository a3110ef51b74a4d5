"""Faults that add something to the signal: y_b(t) = y(t) + something."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.faults.distortions import Distribution, drawn, random_walk
from gtmbench.faults.fault import Distorted, Fault, Formula, State, check_unit, periods
from gtmbench.faults.parameter import flag, other_channel, random_seed, setting, severity
from gtmbench.faults.shape import Shape, Typical, WholeLog
from gtmbench.values.clock import FloatArray, Value


@dataclass(frozen=True, kw_only=True)
class Bias(Formula):
    """A step: y + size.

    Parameters
    ----------
    size : float
        What is added, in the channel's unit.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Bias(channel="p", onset_s=1.0, size=0.5).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([1.0, 1.0, 2.0])]
    [1.0, 1.5, 2.5]
    """

    kind: ClassVar[str] = "bias"
    occurs: ClassVar[str] = (
        "a supply that sags, a thermal shock; the MPU-6050 gyro's data sheet allows 20 deg/s to begin with"
    )
    shape: ClassVar = Shape(
        how="linear",
        family="additive",
        parameter="size",
        column="1",
        passes_for=("estimator",),
        of_angle=("drift", "thermal_bias"),
    )
    whole_log: ClassVar = WholeLog(
        wrong=lambda read, _: np.ones(len(read)), least=0.4
    )  # one that warms up does as much
    typical: ClassVar = Typical(shown={"size": 20.0}, gyro=(0.3, 2.0), angle=(1.0, 4.0), certified_s=10.0)
    size: float = severity()

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Add it."""
        return now[0] + self.size


@dataclass(frozen=True, kw_only=True)
class Drift(Formula):
    """A ramp is added: y + slope (t - onset). Section 4.4 takes 0.05 deg/s2 on a rate gyro.

    Parameters
    ----------
    slope : float
        In the channel's unit per second.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Drift(channel="p", onset_s=1.0, slope=0.5).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([1.0, 1.0, 1.0])]
    [1.0, 1.0, 1.5]
    """

    kind: ClassVar[str] = "drift"
    printed: ClassVar[str] = "Fig. 4.3"
    occurs: ClassVar[str] = "warming up; the dissertation's, 0.05 deg/s²"
    # what is slow in the noise looks like a slope
    shape: ClassVar = Shape(how="linear", family="additive", parameter="slope", column="t", spread=1.7)
    whole_log: ClassVar = WholeLog(
        wrong=lambda _, time_s: time_s, price=1.0, least=0.01, shortest_s=15.0, grows_from="bias"
    )
    typical: ClassVar = Typical(shown={"slope": 2.0}, gyro=(0.01, 0.05), angle=(0.2, 1.0), certified_s=20.0)
    slope: float = severity(per_second=True)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Add the ramp."""
        return now[0] + self.slope * elapsed_s


@dataclass(frozen=True, kw_only=True)
class ThermalBias(Formula):
    """A bias follows a temperature that settles: y + size (1 - exp(-(t - onset)/warming_s)).

    Parameters
    ----------
    size : float
        What is added in the end, in the channel's unit.
    warming_s : float
        The time constant with which it warms up or cools down, in seconds.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.ThermalBias(channel="p", onset_s=1.0, size=2.0, warming_s=1.0).stream(sample_period_s=1.0)
    >>> [round(step(time_s, [1.0]), 3) for time_s in range(5)]
    [1.0, 1.0, 2.264, 2.729, 2.9]
    """

    kind: ClassVar[str] = "thermal_bias"
    occurs: ClassVar[str] = "a heater that fails, sun on the housing, the cold of a climb"
    shape: ClassVar = Shape(
        how="search",
        family="additive",
        parameter="warming_s",
        size="size",
        low=0.5,
        high=20.0,
        when="growing",
        spread=1.7,  # when it began, how fast and how far it settles hang together
        passes_for=("motion", "estimator"),
        of_angle=("thermal_bias", "drift"),
    )
    typical: ClassVar = Typical(shown={"size": 25.0, "warming_s": 4.0}, gyro=(2.0, 5.0), angle=(2.0, 5.0))
    size: float = severity()
    warming_s: float = severity(unit="s", low=0.0, above=True)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Add what has warmed up."""
        share: Value = -np.expm1(-elapsed_s / self.warming_s)
        return now[0] + self.size * share


@dataclass(frozen=True, kw_only=True)
class Oscillation(Formula):
    """A sine is added: y + amplitude sin(2 pi frequency_hz (t - onset) + phase_deg); or it `replaces` the signal.

    Parameters
    ----------
    amplitude : float
        In the channel's unit.
    frequency_hz : float
    phase_deg : float, optional
        At the onset.
    replaces : bool, optional
        Whether the sine replaces the signal; by default it is added.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Oscillation(channel="p", onset_s=0.0, amplitude=2.0, frequency_hz=0.25).stream(sample_period_s=1.0)
    >>> [round(step(time_s, [1.0]), 9) for time_s in range(4)]
    [1.0, 3.0, 1.0, -1.0]
    """

    kind: ClassVar[str] = "oscillation"
    occurs: ClassVar[str] = "unstable electronics; liquid and solid oscillatory failures (Goupil 2010)"
    shape: ClassVar = Shape(
        how="tone", family="additive", parameter="amplitude", passes_for=("motion",), of_angle=("oscillation",)
    )
    typical: ClassVar = Typical(shown={"amplitude": 12.0, "frequency_hz": 1.5}, gyro=(1.0, 3.0), angle=(0.3, 1.5))
    amplitude: float = severity(low=0.0)
    frequency_hz: float = setting(unit="Hz", low=0.0)
    phase_deg: float = setting(unit="deg", default=0.0)
    replaces: bool = flag()

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Add the sine, or put it in place."""
        angle = 2.0 * math.pi * self.frequency_hz * elapsed_s + math.radians(self.phase_deg)
        wave: Value = self.amplitude * np.sin(angle)
        return wave if self.replaces else now[0] + wave


@dataclass(frozen=True, kw_only=True)
class RandomWalk(Fault):
    """A random walk is added: y + w, w(k) = w(k-1) + gain sqrt(Ts) n(k), n standard normal, from 0 at the beginning.

    After T seconds w has a standard deviation of gain sqrt(T).

    Parameters
    ----------
    gain : float
        In the channel's unit per sqrt(s).
    seed : int, optional
        Seed of the random draws.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.RandomWalk(channel="p", onset_s=1.0, gain=0.1).stream(sample_period_s=1.0)
    >>> [round(step(time_s, [0.0]), 3) for time_s in range(5)]
    [0.0, 0.0, 0.136, 0.164, 0.086]
    """

    kind: ClassVar[str] = "random_walk"
    occurs: ClassVar[str] = "rate random walk of IEEE Std 952-1997; temperature"
    # the step from its beginning to its end is one number at all frequencies
    shape: ClassVar = Shape(how="walk", family="additive", parameter="gain", spread=2.0, passes_for=("turn",))
    typical: ClassVar = Typical(shown={"gain": 6.0, "seed": 2}, gyro=(0.2, 1.0), angle=(0.5, 2.0))
    gain: float = severity(per="sqrt(s)", low=0.0)
    seed: int = random_seed()

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Add the walk of a stretch."""
        draws = _drawn(self, "standard_normal", elapsed_s, sample_period_s)
        walk, carried = random_walk(draws, self.gain, sample_period_s, carried)
        return readings[:, 0] + walk, carried


@dataclass(frozen=True, kw_only=True)
class Noise(Formula):
    """White noise is added: y + deviation n(k), n standard normal.

    Parameters
    ----------
    deviation : float
        Standard deviation, in the channel's unit.
    seed : int, optional
        Seed of the random draws.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Noise(channel="p", onset_s=1.0, deviation=0.5).stream(sample_period_s=1.0)
    >>> [round(step(time_s, [1.0]), 3) for time_s in range(4)]
    [1.0, 0.865, 1.097, 1.415]
    """

    kind: ClassVar[str] = "noise"
    occurs: ClassVar[str] = "a loose mount, a bad contact, sound at a MEMS gyro's resonance (Son et al. 2015)"
    shape: ClassVar = Shape(
        how="white", family="variance", parameter="deviation", passes_for=("estimator", "excitation")
    )
    typical: ClassVar = Typical(shown={"deviation": 6.0}, gyro=(1.5, 4.0), angle=(0.2, 0.6), certified_s=10.0)
    deviation: float = severity(low=0.0)
    seed: int = random_seed()

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Add a draw a sample."""
        return now[0] + self.deviation * _drawn(self, "standard_normal", elapsed_s, sample_period_s)


@dataclass(frozen=True, kw_only=True)
class Spikes(Formula):
    """Single samples are off by +size or -size, each sample with probability rate_hz Ts: rate_hz spikes a second.

    Parameters
    ----------
    size : float
        In the channel's unit.
    rate_hz : float
        Mean number of spikes a second.
    seed : int, optional
        Seed of the random draws.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Spikes(channel="p", onset_s=0.0, size=9.0, rate_hz=0.5).stream(sample_period_s=1.0)
    >>> [step(time_s, [1.0]) for time_s in range(6)]
    [-8.0, 1.0, 10.0, 1.0, -8.0, 1.0]
    """

    kind: ClassVar[str] = "spikes"
    occurs: ClassVar[str] = (
        "flipped bits, mixed-up words: an A330's angle of attack on 7 October 2008 (ATSB AO-2008-070)"
    )
    shape: ClassVar = Shape(how="spikes", family="variance", parameter="size")
    typical: ClassVar = Typical(shown={"size": 30.0, "rate_hz": 1.0}, gyro=(10.0, 40.0), angle=(2.0, 8.0))
    size: float = severity(low=0.0)
    rate_hz: float = setting(unit="Hz", low=0.0)
    seed: int = random_seed()

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Add the spikes: one draw tells whether there is one, and its sign."""
        draw = _drawn(self, "random", elapsed_s, sample_period_s)
        likely = min(self.rate_hz * sample_period_s, 1.0)
        sign = 1.0 * (draw < 0.5 * likely) - 1.0 * (draw > 1.0 - 0.5 * likely)
        return now[0] + self.size * sign


@dataclass(frozen=True, kw_only=True)
class GSensitivity(Formula):
    """Acceleration leaks in: y + coefficient n, n the specific force in g that the accelerometer of `axis` reads.

    At rest n is 1 g along the vertical; the resulting bias belongs to the fault.

    Parameters
    ----------
    axis : str
        The accelerometer: nx, ny or nz.
    coefficient : float
        In the channel's unit per g.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.GSensitivity(channel="p", onset_s=0.0, axis="nz", coefficient=0.1).stream(sample_period_s=1.0)
    >>> step(0.0, [1.0, 2.0])
    1.2
    """

    kind: ClassVar[str] = "g_sensitivity"
    beside: ClassVar[str] = "to"
    occurs: ClassVar[str] = "MEMS gyros: 0.1 deg/s per g in the MPU-6050's data sheet"
    shape: ClassVar = Shape(
        how="linear", family="cross-axis", parameter="coefficient", beside="felt", passes_for=("motion",)
    )
    typical: ClassVar = Typical(shown={"axis": "nz", "coefficient": 20.0}, gyro=(0.5, 4.0), angle=(1.0, 4.0))
    axis: str = other_channel()
    coefficient: float = severity(per="g")

    def __post_init__(self) -> None:
        super().__post_init__()
        check_unit(f"{self.kind}: axis", self.axis, "g")

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Add what leaks in."""
        return now[0] + self.coefficient * now[1]


def _drawn(
    fault: RandomWalk | Noise | Spikes, distribution: Distribution, elapsed_s: Value, sample_period_s: float
) -> Value:
    """Return what a fault draws at some times: by its seed, its kind and its channel, and samples since its onset."""
    number = periods(elapsed_s, sample_period_s, sample_period_s)
    return drawn(distribution, fault.seed, f"{fault.kind} of {fault.channel}", number)

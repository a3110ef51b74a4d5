"""Faults that shape the signal: gains, bends, limits, steps and bandwidth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.faults.distortions import clipped, followed, lagged, lagged_sample, quantised, rate_limited
from gtmbench.faults.fault import Broken, Distorted, Fault, Following, Formula, State, check_unit
from gtmbench.faults.parameter import other_channel, severity
from gtmbench.faults.shape import Same, Shape, Typical, WholeLog, is_constant, is_one_sided
from gtmbench.values.channels import unit_of
from gtmbench.values.clock import FloatArray, Value

_AT_LIMIT = 1.0 - 1e-6  # of the limit: rounding


@dataclass(frozen=True, kw_only=True)
class ScaleFactor(Formula):
    """The gain is wrong: factor y, about zero, not about the mean.

    Parameters
    ----------
    factor : float
        1 is healthy.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.ScaleFactor(channel="p", onset_s=0.0, factor=1.5).stream(sample_period_s=1.0)
    >>> step(0.0, [2.0])
    3.0
    """

    kind: ClassVar[str] = "scale_factor"
    occurs: ClassVar[str] = "a range that is set otherwise than it is read; ageing"
    shape: ClassVar = Shape(
        how="gain", family="multiplicative", parameter="factor", healthy=1.0, passes_for=("estimator", "excitation")
    )
    whole_log: ClassVar = WholeLog(  # e = k y, so that its factor is 1 / (1 - k); k = 2 turns its sign
        wrong=lambda read, _: read,
        name="scale",
        low=-4.0,
        high=3.0,
        least=0.12,
        shortest_s=7.0,  # beyond these it is another motion
        is_gain=True,
        mirror=1.0,
        parameter=lambda size: 1.0 / (1.0 - size) if abs(1.0 - size) > 1e-6 else math.inf,
    )
    typical: ClassVar = Typical(shown={"factor": 1.6}, gyro=(1.1, 1.3), angle=(1.1, 1.3), certified_s=10.0)
    factor: float = severity(unit="")

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Scale."""
        return self.factor * now[0]


@dataclass(frozen=True, kw_only=True)
class ScaleDrift(Formula):
    """The gain goes wrong by and by: (1 + rate (t - onset)) y.

    Parameters
    ----------
    rate : float
        In 1/s.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.ScaleDrift(channel="p", onset_s=1.0, rate=0.1).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([2.0, 2.0, 2.0, 2.0])]
    [2.0, 2.0, 2.2, 2.4]
    """

    kind: ClassVar[str] = "scale_drift"
    occurs: ClassVar[str] = "ageing, a supply that runs down, warming up"
    shape: ClassVar = Shape(
        how="linear", family="multiplicative", parameter="rate", spread=1.7, passes_for=("motion", "turn")
    )
    typical: ClassVar = Typical(shown={"rate": 0.08}, gyro=(0.005, 0.02), angle=(0.005, 0.02))
    rate: float = severity(unit="1/s")

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Scale by more and more."""
        return now[0] + self.rate * elapsed_s * now[0]


@dataclass(frozen=True, kw_only=True)
class SignFlip(Formula):
    """The sign is wrong: -y.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.SignFlip(channel="p", onset_s=0.0).stream(sample_period_s=1.0)(0.0, [2.0])
    -2.0
    """

    kind: ClassVar[str] = "sign_flip"
    occurs: ClassVar[str] = "mounted the wrong way round: the Proton-M of 2 July 2013"
    shape: ClassVar = Shape(how="sign", family="multiplicative")
    typical: ClassVar = Typical()

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Turn it round."""
        return -now[0]


@dataclass(frozen=True, kw_only=True)
class Misalignment(Formula):
    """The sensor is turned towards another axis, whose sensor stays as it is: cos(angle) y + sin(angle) y_axis.

    Parameters
    ----------
    axis : str
        The sensor of the other axis.
    angle_deg : float
        How far it is turned.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Misalignment(channel="p", onset_s=0.0, axis="q", angle_deg=90.0).stream(sample_period_s=1.0)
    >>> round(step(0.0, [2.0, 5.0]), 9)
    5.0
    """

    kind: ClassVar[str] = "misalignment"
    beside: ClassVar[str] = "towards"
    occurs: ClassVar[str] = "a bent or loose mount"
    shape: ClassVar = Shape(how="turned", family="cross-axis", parameter="angle_deg", passes_for=("motion",))
    typical: ClassVar = Typical(shown={"axis": "q", "angle_deg": 60.0}, gyro=(8.0, 20.0), angle=(8.0, 20.0))
    axis: str = other_channel()
    angle_deg: float = severity(unit="deg", low=-180.0, high=180.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        check_unit(f"{self.kind}: axis", self.axis, unit_of(self.channel))

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Mix the two axes."""
        angle = math.radians(self.angle_deg)
        return math.cos(angle) * now[0] + math.sin(angle) * now[1]


@dataclass(frozen=True, kw_only=True)
class Deadzone(Formula):
    """Signals within +-half_width vanish, larger ones lose the half-width: ``sign(y) max(|y| - half_width, 0)``.

    Parameters
    ----------
    half_width : float
        In the channel's unit.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Deadzone(channel="p", onset_s=0.0, half_width=1.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([-3.0, 0.5, 3.0])]
    [-2.0, 0.0, 2.0]
    """

    kind: ClassVar[str] = "deadzone"
    printed: ClassVar[str] = "Fig. 4.4"
    occurs: ClassVar[str] = "friction; the dissertation's"
    shape: ClassVar = Shape(
        how="search", family="clipping", parameter="half_width", low=0.01, high=1.0, of="reach", when="straight"
    )
    whole_log: ClassVar = WholeLog(  # 0.15 deg/s are more than nothing
        wrong=lambda read, _: np.where(np.abs(read) > 0.15, -np.sign(read), 0.0),
        price=3.0,
        low=0.0,
        high=2.0,
        of_motion=True,
        least=0.2,
        shortest_s=15.0,
        is_gain=True,
    )
    typical: ClassVar = Typical(
        shown={"half_width": 10.0}, gyro=(25.0, 50.0), angle=(25.0, 50.0), of="rms", certified_s=10.0, largest="dead"
    )
    same_as: ClassVar = {
        "stuck": Same(is_constant, "the signal never left the deadzone"),
        "bias": Same(is_one_sided, "the signal never came into the deadzone, and has lost the half-width"),
    }
    half_width: float = severity(per_second=False, low=0.0)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Shrink towards zero."""
        return now[0] - clipped(now[0], -self.half_width, self.half_width)

    def undone(self, readings: FloatArray, expected: FloatArray) -> FloatArray:
        """Add the half-width; where it reads nothing, it isn't told."""
        told = readings + self.half_width * np.sign(readings)
        return np.where(readings == 0.0, np.clip(expected, -self.half_width, self.half_width), told)


@dataclass(frozen=True, kw_only=True)
class Saturation(Formula):
    """The magnitude is held within +-limit.

    Parameters
    ----------
    limit : float
        In the channel's unit.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Saturation(channel="p", onset_s=0.0, limit=1.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([-3.0, 0.5, 3.0])]
    [-1.0, 0.5, 1.0]
    """

    kind: ClassVar[str] = "saturation"
    occurs: ClassVar[str] = "a range that is too small; the dissertation's"
    shape: ClassVar = Shape(
        how="search", family="clipping", parameter="limit", low=0.01, high=1.0, of="reach", read="limit", when="traced"
    )
    typical: ClassVar = Typical(shown={"limit": 12.0}, gyro=(40.0, 20.0), angle=(40.0, 20.0), of="peak")
    same_as: ClassVar = {"stuck": Same(is_constant, "the signal never came back within the limit")}
    limit: float = severity(per_second=False, low=0.0)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Clip."""
        return clipped(now[0], -self.limit, self.limit)

    def undone(self, readings: FloatArray, expected: FloatArray) -> FloatArray:
        """Return the readings; where it is at a limit, it isn't told."""
        beyond = np.sign(readings) * np.maximum(np.sign(readings) * expected, self.limit)
        return np.where(np.abs(readings) < self.limit * _AT_LIMIT, readings, beyond)


@dataclass(frozen=True, kw_only=True)
class RateSaturation(Following):
    """The signal follows no faster than rate_limit: y_b(k) = y_b(k-1) + clip(y(k) - y_b(k-1), +-rate_limit Ts).

    It starts from the last healthy sample. A missing sample (NaN) stays missing and is passed over.

    Parameters
    ----------
    rate_limit : float
        In the channel's unit per second.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.RateSaturation(channel="p", onset_s=1.0, rate_limit=2.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([0.0, 3.0, 3.0])]
    [0.0, 2.0, 3.0]
    """

    kind: ClassVar[str] = "rate_saturation"
    occurs: ClassVar[str] = "an amplifier's slew rate; the dissertation's"
    shape: ClassVar = Shape(
        how="search",
        family="clipping",
        parameter="rate_limit",
        low=0.01,
        high=1.0,
        of="slew",
        read="step",
        when="straight",
        passes_for=("loop", "turn"),
    )
    typical: ClassVar = Typical(shown={"rate_limit": 25.0}, gyro=(20.0, 10.0), angle=(20.0, 10.0), of="slew")
    rate_limit: float = severity(per_second=True, low=0.0)

    def follow(self, y: Value, before: Value, sample_period_s: float) -> Value:
        """Follow no faster."""
        return followed(before, y, self.rate_limit * sample_period_s)

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Follow the signal over a stretch."""
        return rate_limited(readings[:, 0], self.rate_limit * sample_period_s, carried)


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Following):
    """Backlash, `width` in all: y_b(k) = min(max(y_b(k-1), y(k) - width/2), y(k) + width/2).

    It starts from the last healthy sample, amid its play. A missing sample stays missing and is passed over.

    Parameters
    ----------
    width : float
        The whole play, in the channel's unit.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Hysteresis(channel="p", onset_s=1.0, width=2.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([0.0, 0.5, 3.0, 2.0, 0.0])]
    [0.0, 0.0, 2.0, 2.0, 1.0]
    """

    kind: ClassVar[str] = "hysteresis"
    occurs: ClassVar[str] = "play in a vane's linkage"
    shape: ClassVar = Shape(
        how="search",
        family="clipping",
        parameter="width",
        low=0.02,
        high=2.0,
        of="reach",
        when="straight",
        spread=1.5,  # each side of the play has to be found
        passes_for=("loop", "turn"),
    )
    typical: ClassVar = Typical(shown={"width": 20.0}, gyro=(50.0, 150.0), angle=(50.0, 150.0), of="rms")
    same_as: ClassVar = {
        "stuck": Same(is_constant, "the signal never left its play"),
        "jam": Same(is_constant, "the same: that value is the last healthy one"),
    }
    width: float = severity(low=0.0)

    def follow(self, y: Value, before: Value, sample_period_s: float) -> Value:
        """Stay where the play allows it."""
        return clipped(before, y - 0.5 * self.width, y + 0.5 * self.width)


@dataclass(frozen=True, kw_only=True)
class Quantisation(Formula):
    """Readings are whole multiples of quantum: quantum round(y/quantum).

    Parameters
    ----------
    quantum : float
        In the channel's unit.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Quantisation(channel="p", onset_s=0.0, quantum=0.5).stream(sample_period_s=1.0)
    >>> step(0.0, [0.7])
    0.5
    """

    kind: ClassVar[str] = "quantisation"
    occurs: ClassVar[str] = "lost bits, a range that is far too wide"
    shape: ClassVar = Shape(how="rounded", family="clipping", parameter="quantum", when="straight")
    typical: ClassVar = Typical(shown={"quantum": 12.0}, gyro=(3.0, 8.0), angle=(0.5, 2.0))
    quantum: float = severity(low=1e-9)  # a finer one doesn't round, it costs digits

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Round."""
        return quantised(now[0], self.quantum)


@dataclass(frozen=True, kw_only=True)
class Lag(Fault):
    """Bandwidth is lost, down to 1/(2 pi lag_s) Hz: lag_s dy_b/dt + y_b = y, in rest at the last healthy sample.

    Between samples y runs straight; so the solution is exact (`lagged`). A missing sample stays missing and is passed
    over.

    Parameters
    ----------
    lag_s : float
        Time constant, in seconds.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Lag(channel="p", onset_s=1.0, lag_s=2.0).stream(sample_period_s=1.0)
    >>> [round(step(time_s, [y]), 3) for time_s, y in enumerate([0.0, 1.0, 1.0, 1.0])]
    [0.0, 0.213, 0.523, 0.711]
    """

    kind: ClassVar[str] = "lag"
    occurs: ClassVar[str] = "a filter that is set too low, tubes of air data"
    shape: ClassVar = Shape(
        how="search",
        family="timing",
        parameter="lag_s",
        low=0.005,
        high=1.0,
        when="late",
        passes_for=("motion", "turn"),
    )
    typical: ClassVar = Typical(shown={"lag_s": 0.5}, gyro=(0.03, 0.2), angle=(0.05, 0.2))
    lag_s: float = severity(unit="s", low=0.0, above=True)

    def begin(self, before: FloatArray) -> State:
        """Rest at the last healthy sample."""
        return float(before[0]), 0.0, 0.0

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Filter a stretch."""
        return lagged(readings[:, 0], self.lag_s, sample_period_s, carried)

    def distort_sample(self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State) -> Broken:
        """Filter a sample."""
        return lagged_sample(now[0], self.lag_s, sample_period_s, carried)

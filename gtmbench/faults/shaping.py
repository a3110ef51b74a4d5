"""Faults that shape the signal: gains, bends, limits, steps and bandwidth."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

from gtmbench.faults.distortions import clipped, followed, lagged, lagged_sample, quantised, rate_limited
from gtmbench.faults.fault import Distorted, Fault, Formula, State, check_unit
from gtmbench.faults.parameter import other_channel, severity
from gtmbench.values.channels import unit_of
from gtmbench.values.clock import FloatArray, Value


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
    factor: float = severity(unit="")

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Scale."""
        return self.factor * now[0]


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
    half_width: float = severity(per_second=False, low=0.0)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Shrink towards zero."""
        return now[0] - clipped(now[0], -self.half_width, self.half_width)


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
    limit: float = severity(per_second=False, low=0.0)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Clip."""
        return clipped(now[0], -self.limit, self.limit)


@dataclass(frozen=True, kw_only=True)
class RateSaturation(Fault):
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
    rate_limit: float = severity(per_second=True, low=0.0)

    def begin(self, before: FloatArray) -> State:
        """Start from the last healthy sample."""
        return float(before[0])

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Follow the signal over a stretch."""
        return rate_limited(readings[:, 0], self.rate_limit * sample_period_s, carried)

    def distort_sample(
        self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State
    ) -> tuple[float, State]:
        """Follow the signal by one step."""
        at = followed(carried, now[0], self.rate_limit * sample_period_s)
        return at if now[0] == now[0] else now[0], at


@dataclass(frozen=True, kw_only=True)
class Hysteresis(Fault):
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
    width: float = severity(low=0.0)

    def begin(self, before: FloatArray) -> State:
        """Start from the last healthy sample."""
        return float(before[0])

    def distort_sample(
        self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State
    ) -> tuple[float, State]:
        """Stay where the play allows it."""
        y, half = now[0], 0.5 * self.width
        if y != y:
            return y, carried
        at = clipped(carried, y - half, y + half) if carried == carried else y
        return at, at


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
    lag_s: float = severity(unit="s", low=0.0, above=True)

    def begin(self, before: FloatArray) -> State:
        """Rest at the last healthy sample."""
        return float(before[0]), 0.0

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Filter a stretch."""
        return lagged(readings[:, 0], self.lag_s, sample_period_s, carried)

    def distort_sample(
        self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State
    ) -> tuple[float, State]:
        """Filter a sample."""
        return lagged_sample(now[0], self.lag_s, sample_period_s, carried)

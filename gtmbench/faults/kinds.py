"""The kinds of faults, one class each.

A new fault is a class with its `kind`, its parameters (each declared by `severity` or `other_channel`) and `distort`
(and `begin`, where it carries something over), and an entry in `FAULTS`; a user's own is registered (`registry`). With
an entry in `detectors/isolation/hypotheses.py` that says how its parameters are searched, a diagnosis knows it, too.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from gtmbench.faults.distortions import rate_limited
from gtmbench.faults.fault import Distorted, Fault, severity
from gtmbench.record import FloatArray


@dataclass(frozen=True, kw_only=True)
class Drift(Fault):
    """A ramp is added: y + slope (t - onset). Section 4.4 takes 0.05 deg/s2 on a rate gyro.

    >>> step = Drift(channel="p", onset_s=1.0, slope=0.5).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([1.0, 1.0, 1.0])]
    [1.0, 1.0, 1.5]
    """

    kind: ClassVar[str] = "drift"
    slope: float = severity(per_second=True)

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any) -> Distorted:
        """Add the ramp."""
        return readings[:, 0] + self.slope * elapsed_s, None


@dataclass(frozen=True, kw_only=True)
class Deadzone(Fault):
    """Signals within +-half_width vanish, larger ones lose the half-width: sign(y) max(|y| - half_width, 0).

    >>> step = Deadzone(channel="p", onset_s=0.0, half_width=1.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([-3.0, 0.5, 3.0])]
    [-2.0, 0.0, 2.0]
    """

    kind: ClassVar[str] = "deadzone"
    half_width: float = severity(per_second=False, low=0.0)

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any) -> Distorted:
        """Shrink towards zero."""
        y = readings[:, 0]
        return y - np.clip(y, -self.half_width, self.half_width), None


@dataclass(frozen=True, kw_only=True)
class Saturation(Fault):
    """The magnitude is held within +-limit.

    >>> step = Saturation(channel="p", onset_s=0.0, limit=1.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([-3.0, 0.5, 3.0])]
    [-1.0, 0.5, 1.0]
    """

    kind: ClassVar[str] = "saturation"
    limit: float = severity(per_second=False, low=0.0)

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any) -> Distorted:
        """Clip."""
        return np.clip(readings[:, 0], -self.limit, self.limit), None


@dataclass(frozen=True, kw_only=True)
class RateSaturation(Fault):
    """The signal follows no faster than rate_limit: y_b(k) = y_b(k-1) + clip(y(k) - y_b(k-1), +-rate_limit Ts).

    It starts from the last healthy sample. A missing sample (NaN) stays missing and is passed over.

    >>> step = RateSaturation(channel="p", onset_s=1.0, rate_limit=2.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([0.0, 3.0, 3.0])]
    [0.0, 2.0, 3.0]
    """

    kind: ClassVar[str] = "rate_saturation"
    rate_limit: float = severity(per_second=True, low=0.0)

    def begin(self, before: FloatArray) -> Any:
        """Start from the last healthy sample."""
        return float(before[0])

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any) -> Distorted:
        """Follow the signal, step by step."""
        return rate_limited(readings[:, 0], self.rate_limit * sample_period_s, carried)


@dataclass(frozen=True, kw_only=True)
class Jam(Fault):
    """The sensor stays at its last healthy sample: y(k) = y(onset - Ts), or the first sample if it never was healthy.

    >>> step = Jam(channel="p", onset_s=1.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([3.0, 1.0, 2.0])]
    [3.0, 3.0, 3.0]
    """

    kind: ClassVar[str] = "jam"

    def begin(self, before: FloatArray) -> Any:
        """Hold the last healthy sample."""
        return float(before[0])

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any) -> Distorted:
        """Repeat it."""
        return np.full(len(readings), carried), carried


FAULTS: dict[str, type[Fault]] = {kind.kind: kind for kind in (Drift, Deadzone, Saturation, RateSaturation, Jam)}

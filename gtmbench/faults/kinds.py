"""The kinds of faults, and how they are injected into a record.

A new fault is one class with its `kind`, its parameters (each declared by `severity` or `other_channel`) and `distort`
(and `begin`, where it carries something over), and one entry in `FAULTS`; a user's own is registered (`registry`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from gtmbench.errors import InputError
from gtmbench.faults.distortions import deadzone, rate_saturation, saturation
from gtmbench.faults.fault import Fault, severity
from gtmbench.record import FloatArray, Record


@dataclass(frozen=True, kw_only=True)
class Drift(Fault):
    """A ramp is added: y + slope (t - onset). Section 4.4 takes 0.05 deg/s2 on a rate gyro.

    >>> record = Record([1.0, 1.0, 1.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, Drift(channel="p", onset_s=1.0, slope=0.5))["p"]
    array([1. , 1. , 1.5])
    """

    kind: ClassVar[str] = "drift"
    slope: float = severity(per_second=True)

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Add the ramp."""
        return seen[:, 0] + self.slope * elapsed_s, None


@dataclass(frozen=True, kw_only=True)
class Deadzone(Fault):
    """Signals within +-half_width vanish, larger ones lose the half-width: sign(y) max(|y| - half_width, 0).

    >>> record = Record([-3.0, 0.5, 3.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, Deadzone(channel="p", onset_s=0.0, half_width=1.0))["p"]
    array([-2.,  0.,  2.])
    """

    kind: ClassVar[str] = "deadzone"
    half_width: float = severity(per_second=False, low=0.0)

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Shrink towards zero."""
        return deadzone(seen[:, 0], self.half_width), None


@dataclass(frozen=True, kw_only=True)
class Saturation(Fault):
    """The magnitude is held within +-limit.

    >>> record = Record([-3.0, 0.5, 3.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, Saturation(channel="p", onset_s=0.0, limit=1.0))["p"]
    array([-1. ,  0.5,  1. ])
    """

    kind: ClassVar[str] = "saturation"
    limit: float = severity(per_second=False, low=0.0)

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Clip."""
        return saturation(seen[:, 0], self.limit), None


@dataclass(frozen=True, kw_only=True)
class RateSaturation(Fault):
    """The signal follows no faster than rate_limit: y_b(k) = y_b(k-1) + clip(y(k) - y_b(k-1), +-rate_limit Ts).

    It starts from the last healthy sample. A missing sample (NaN) stays missing and is passed over.

    >>> record = Record([0.0, 3.0, 3.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, RateSaturation(channel="p", onset_s=1.0, rate_limit=2.0))["p"]
    array([0., 2., 3.])
    """

    kind: ClassVar[str] = "rate_saturation"
    rate_limit: float = severity(per_second=True, low=0.0)

    def begin(self, before: FloatArray) -> Any:
        """Start from the last healthy sample."""
        return float(before[0])

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Follow the signal, step by step."""
        broken = rate_saturation(seen[:, 0], self.rate_limit * sample_period_s, float(carried))
        reached = broken[~np.isnan(broken)]
        return broken, float(reached[-1]) if len(reached) else carried


@dataclass(frozen=True, kw_only=True)
class Jam(Fault):
    """The sensor stays at its last healthy sample: y(k) = y(onset - Ts), or the first sample if it never was healthy.

    >>> record = Record([3.0, 1.0, 2.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, Jam(channel="p", onset_s=1.0))["p"]
    array([3., 3., 3.])
    """

    kind: ClassVar[str] = "jam"

    def begin(self, before: FloatArray) -> Any:
        """Hold the last healthy sample."""
        return float(before[0])

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Repeat it."""
        return np.full(len(seen), carried), carried


FAULTS: dict[str, type[Fault]] = {kind.kind: kind for kind in (Drift, Deadzone, Saturation, RateSaturation, Jam)}


def inject(record: Record, faults: Fault | Sequence[Fault]) -> Record:
    """Return the record with one or several faults, applied one after the other.

    Raises
    ------
    InputError
        Where the record lacks a channel, or a fault's onset lies outside of it.

    Examples
    --------
    >>> record = Record([3.0, 1.0, 2.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, Jam(channel="p", onset_s=1.0))["p"]
    array([3., 3., 3.])
    """
    for fault in [faults] if isinstance(faults, Fault) else faults:
        if not isinstance(fault, Fault):
            raise InputError(f"{fault!r} is no fault; give one such as Jam(channel='p', onset_s=300)")
        if not record.start_s - 1e-9 <= fault.onset_s <= record.end_s + 1e-9:
            raise InputError(
                f"{fault.kind} on '{fault.channel}' begins at {fault.onset_s:g} s, outside of the record, which runs "
                f"from {record.start_s:g} to {record.end_s:g} s"
            )
        record = record.replace(fault.channel, fault.array(record))
    return record

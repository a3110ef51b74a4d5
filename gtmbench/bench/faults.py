"""Faults: what breaks on a measured channel, from when, for how long.

Every kind says once how it distorts a stretch of samples, given what it carries over from the stretch before. The
array form takes the whole fault as one stretch, the streaming form takes stretches of one sample: the same code, so
the same result, and a fault can sit inside a control loop.

A new fault is one class with `distort` (and `begin`, where it carries something over) and one entry in `FAULTS`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.record import FloatArray, Record


@dataclass(frozen=True, kw_only=True)
class Severity:
    """A parameter that says how bad a fault is: in its channel's unit, or in that unit per second."""

    name: str
    per_second: bool


def _figure(*, per_second: bool) -> Any:
    return field(metadata={"per_second": per_second})


@dataclass(frozen=True, kw_only=True)
class Fault:
    """What every fault has: a channel, an onset, and a duration (none: for good).

    Active on ``onset_s <= t < onset_s + duration_s``. It acts on the measured signal, noise included, and changes its
    own channel only.
    """

    kind: ClassVar[str]

    channel: str
    onset_s: float
    duration_s: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.channel, str):
            raise InputError(f"{self.kind}: channel is {self.channel!r}; it must be a channel's name")
        for name in ("onset_s", *(item.name for item in self.severities())):
            number(f"{self.kind}: {name}", getattr(self, name))
        if self.duration_s is not None:
            number(f"{self.kind}: duration_s", self.duration_s, 0.0, above=True)

    @classmethod
    def severities(cls) -> tuple[Severity, ...]:
        """Return the parameters that say how bad it is, in order."""
        own = [item for item in fields(cls) if "per_second" in item.metadata]
        return tuple(Severity(name=item.name, per_second=item.metadata["per_second"]) for item in own)

    @property
    def reads(self) -> tuple[str, ...]:
        """The channels it looks at, its own first."""
        return (self.channel,)

    def begin(self, before: FloatArray) -> Any:
        """Return what the fault carries into its first stretch, from the last healthy sample of `reads`."""
        return None

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Return the broken samples of a stretch, and what to carry into the next.

        Parameters
        ----------
        seen : shape (samples, len(reads))
            The channels the fault reads, its own first.
        elapsed_s : shape (samples,)
            Time since the onset, in seconds.
        sample_period_s : float
            Ts, in seconds.
        carried
            What `begin` or the stretch before returned.
        """
        raise NotImplementedError

    def active(self, time_s: FloatArray) -> np.ndarray[Any, np.dtype[np.bool_]]:
        """Return at which times the fault is active; a time counts as reached up to a nanosecond before it."""
        begun = time_s >= self.onset_s - 1e-9
        return begun if self.duration_s is None else begun & (time_s < self.onset_s + self.duration_s - 1e-9)

    def array(self, record: Record) -> FloatArray:
        """Return the broken channel of a record, shape (samples,)."""
        time_s = record.time_s
        seen = record.matrix(self.reads)
        broken = seen[:, 0].copy()
        stretch = np.flatnonzero(self.active(time_s))
        if len(stretch):
            first, last = int(stretch[0]), int(stretch[-1]) + 1
            carried = self.begin(seen[max(first - 1, 0)])
            elapsed = time_s[first:last] - self.onset_s
            broken[first:last], _ = self.distort(seen[first:last], elapsed, record.sample_period_s, carried)
        return broken

    def stream(self, sample_period_s: float) -> Callable[[float, Sequence[float]], float]:
        """Return a function that takes a time and the sample of `reads`, in order, and gives the broken sample."""
        carried: Any = None
        before: FloatArray | None = None
        begun = False

        def step(time_s: float, sample: Sequence[float]) -> float:
            nonlocal carried, before, begun
            seen = np.asarray(sample, dtype=np.float64).reshape(1, -1)
            moment = np.array([time_s])
            if not self.active(moment)[0]:
                before = seen[0]
                return float(seen[0, 0])
            if not begun:
                carried = self.begin(seen[0] if before is None else before)
                begun = True
            broken, carried = self.distort(seen, moment - self.onset_s, sample_period_s, carried)
            return float(broken[0])

        return step


@dataclass(frozen=True, kw_only=True)
class Drift(Fault):
    """A ramp is added: y + slope (t - onset). Section 4.4 takes 0.05 deg/s2 on a rate gyro.

    >>> record = Record([1.0, 1.0, 1.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, Drift(channel="p", onset_s=1.0, slope=0.5))["p"]
    array([1. , 1. , 1.5])
    """

    kind: ClassVar[str] = "drift"
    slope: float = _figure(per_second=True)

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
    half_width: float = _figure(per_second=False)

    def __post_init__(self) -> None:
        """Refuse a negative width."""
        super().__post_init__()
        number("deadzone: half_width", self.half_width, 0.0)

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Shrink towards zero."""
        y = seen[:, 0]
        return y - np.clip(y, -self.half_width, self.half_width), None


@dataclass(frozen=True, kw_only=True)
class Saturation(Fault):
    """The magnitude is held within +-limit.

    >>> record = Record([-3.0, 0.5, 3.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, Saturation(channel="p", onset_s=0.0, limit=1.0))["p"]
    array([-1. ,  0.5,  1. ])
    """

    kind: ClassVar[str] = "saturation"
    limit: float = _figure(per_second=False)

    def __post_init__(self) -> None:
        """Refuse a negative limit."""
        super().__post_init__()
        number("saturation: limit", self.limit, 0.0)

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Clip."""
        return np.clip(seen[:, 0], -self.limit, self.limit), None


@dataclass(frozen=True, kw_only=True)
class RateSaturation(Fault):
    """The signal follows no faster than rate_limit: y_b(k) = y_b(k-1) + clip(y(k) - y_b(k-1), +-rate_limit Ts).

    It starts from the last healthy sample. A missing sample (NaN) stays missing and is passed over.

    >>> record = Record([0.0, 3.0, 3.0], channels=["p"], sample_period_s=1.0)
    >>> inject(record, RateSaturation(channel="p", onset_s=1.0, rate_limit=2.0))["p"]
    array([0., 2., 3.])
    """

    kind: ClassVar[str] = "rate_saturation"
    rate_limit: float = _figure(per_second=True)

    def __post_init__(self) -> None:
        """Refuse a negative limit."""
        super().__post_init__()
        number("rate_saturation: rate_limit", self.rate_limit, 0.0)

    def begin(self, before: FloatArray) -> Any:
        """Start from the last healthy sample."""
        return float(before[0])

    def distort(
        self, seen: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any
    ) -> tuple[FloatArray, Any]:
        """Follow the signal, step by step."""
        step = self.rate_limit * sample_period_s
        at = float(carried)
        broken = []
        for y in seen[:, 0].tolist():
            if math.isnan(y):
                broken.append(y)
                continue
            if math.isnan(at) or abs(y - at) <= step:
                at = y
            else:
                at += math.copysign(step, y - at)
            broken.append(at)
        return np.array(broken), at


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
        if not record.start_s - 1e-9 <= fault.onset_s <= record.end_s + 1e-9:
            raise InputError(
                f"{fault.kind} on '{fault.channel}' begins at {fault.onset_s:g} s, outside of the record, which runs "
                f"from {record.start_s:g} to {record.end_s:g} s"
            )
        record = record.replace(fault.channel, fault.array(record))
    return record

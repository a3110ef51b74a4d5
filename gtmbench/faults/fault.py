"""What every fault has: a channel, an onset, parameters, and one way of distorting a signal.

A kind says once how it distorts a stretch of samples, given what it carries over from the stretch before. The array
form takes the whole fault as one stretch, the streaming form takes stretches of one sample, and a diagnosis takes what
a virtual sensor says the suspect should have read: the same code, so the same result, and a fault can sit inside a
control loop.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields
from functools import cache
from typing import Any, ClassVar

import numpy as np

from gtmbench.checks import number, shown
from gtmbench.errors import InputError
from gtmbench.record import FloatArray, Record

Distorted = tuple[FloatArray, Any]  # broken samples, and what is carried into the next stretch


@dataclass(frozen=True, kw_only=True)
class Parameter:
    """A parameter of a kind of fault beyond channel, onset and duration.

    A severity is a number in the channel's unit, or in that unit per second; otherwise it is the name of a channel
    that the fault reads beside its own.
    """

    name: str
    is_severity: bool
    per_second: bool = False
    low: float = -math.inf


def severity(*, per_second: bool, low: float = -math.inf) -> Any:
    """Declare a severity among a fault's fields, with the least value it may have."""
    return field(metadata={"is_severity": True, "per_second": per_second, "low": low})


def other_channel() -> Any:
    """Declare a channel that the fault reads among its fields."""
    return field(metadata={"is_severity": False})


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
            raise InputError(f"{self.kind}: channel is {shown(self.channel)}; it must be a channel's name")
        number(f"{self.kind}: onset_s", self.onset_s)
        for parameter in self.parameters():
            if parameter.is_severity:
                number(f"{self.kind}: {parameter.name}", getattr(self, parameter.name), parameter.low)
        if self.duration_s is not None:
            number(f"{self.kind}: duration_s", self.duration_s, 0.0, above=True)

    @classmethod
    @cache  # a diagnosis makes thousands of a kind
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return the parameters of this kind, in order."""
        return tuple(Parameter(name=each.name, **each.metadata) for each in fields(cls) if each.metadata)

    @property
    def severities(self) -> dict[str, float]:
        """How bad it is: the severities by name, in the channel's unit (per second for slopes)."""
        return {each.name: float(getattr(self, each.name)) for each in self.parameters() if each.is_severity}

    @property
    def reads(self) -> tuple[str, ...]:
        """The channels it looks at, its own first."""
        others = (getattr(self, each.name) for each in self.parameters() if not each.is_severity)
        return (self.channel, *others)

    def begin(self, before: FloatArray) -> Any:
        """Return what the fault carries into its first stretch, from the last healthy sample of `reads`."""
        return None

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: Any) -> Distorted:
        """Return the broken samples of a stretch, and what to carry into the next.

        Parameters
        ----------
        readings : shape (samples, len(reads))
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
        readings = record.matrix(self.reads)
        broken = readings[:, 0].copy()
        stretch = np.flatnonzero(self.active(time_s))
        if len(stretch):
            first, last = int(stretch[0]), int(stretch[-1]) + 1
            carried = self.begin(readings[max(first - 1, 0)])
            elapsed = time_s[first:last] - self.onset_s
            broken[first:last], _ = self.distort(readings[first:last], elapsed, record.sample_period_s, carried)
        return broken

    def stream(self, sample_period_s: float) -> Callable[[float, Sequence[float]], float]:
        """Return a function that takes a time and the sample of `reads`, in order, and gives the broken sample."""
        carried: Any = None
        before: FloatArray | None = None
        begun = False

        def step(time_s: float, sample: Sequence[float]) -> float:
            nonlocal carried, before, begun
            readings = np.asarray(sample, dtype=np.float64).reshape(1, -1)
            moment = np.array([time_s])
            if not self.active(moment)[0]:
                before = readings[0]
                return float(readings[0, 0])
            if not begun:
                carried = self.begin(readings[0] if before is None else before)
                begun = True
            broken, carried = self.distort(readings, moment - self.onset_s, sample_period_s, carried)
            return float(broken[0])

        return step


def inject(record: Record, faults: Fault | Sequence[Fault]) -> Record:
    """Return the record with one or several faults, applied one after the other.

    Raises
    ------
    InputError
        Where the record lacks a channel, or a fault's onset lies outside of it.

    Examples
    --------
    >>> from gtmbench.faults.kinds import Jam
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

"""What every fault has: a channel, its times, parameters, and one way of distorting a signal.

A kind says once how it distorts a stretch of samples, given what it carries over from the stretch before, or how it
distorts one sample; or, where nothing is carried, it is one formula for both (`Formula`). The array form, the streaming
form and a diagnosis, which asks what a broken sensor would have read, all stand on that: the same code, so the same
result, and a fault can sit inside a control loop. When a fault is active and how it comes in is the same for all kinds.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields
from functools import cache
from typing import Any, ClassVar, overload

import numpy as np

from gtmbench.checks import number, shown
from gtmbench.errors import InputError
from gtmbench.faults.parameter import SLACK_S, Intermittent
from gtmbench.faults.parameter import Parameter as Parameter
from gtmbench.faults.parameter import other_channel as other_channel
from gtmbench.faults.parameter import setting as setting
from gtmbench.faults.parameter import severity as severity
from gtmbench.faults.shape import Same, Shape, Typical, WholeLog
from gtmbench.values.attitude_estimators import AttitudeEstimator
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS, OF_OWN_RATE, unit_of
from gtmbench.values.clock import Value, even_times_s
from gtmbench.values.record import BoolArray, FloatArray, Record

State = Any  # what a kind carries from one stretch into the next: its own business
Distorted = tuple[FloatArray, State]  # broken samples, and that
Broken = tuple[float, State]  # a broken sample, and that


@dataclass(frozen=True, kw_only=True)
class Fault:
    """The base of all faults: the channel, the time when it is active, and how it develops.

    Let F(y) be the kind's effect on the signal. A sample at time t reads

        y_b(t) = y(t) + w(t) (F(y)(t) - y(t)),   w(t) = min((t - onset_s)/ramp_s, 1),

    while the fault is active, on ``onset_s <= t < onset_s + duration_s``, and y(t) otherwise. It acts on the measured
    signal, noise included, and changes the channels named in `changes` only.

    Parameters
    ----------
    channel : str
        The sensor that fails.
    onset_s : float
        When, in seconds.
    duration_s : float or None
        Duration in seconds; None: permanent.
    ramp_s : float
        Seconds until it is fully developed; 0: w = 1 at once.
    intermittent : Intermittent or None
        When it is on; None: always. Each spell starts from the last healthy sample; the time since the onset and random
        draws run on in the pauses.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> record = gb.Record(np.zeros(6), channels=["p"], sample_period_s=1.0)
    >>> fault = gb.Bias(channel="p", onset_s=1.0, duration_s=3.0, ramp_s=2.0, size=4.0)  # it comes in over 2 s
    >>> gb.inject(record, fault)["p"]
    array([0., 0., 2., 4., 0., 0.])
    >>> fault.kind, fault.severities, fault.changes
    ('bias', {'size': 4.0}, ('p',))
    """

    kind: ClassVar[str]
    occurs: ClassVar[str] = ""  # where, for the page of kinds
    printed: ClassVar[str] = ""  # as which figure of the dissertation
    shape: ClassVar[Shape | None] = None
    whole_log: ClassVar[WholeLog | None] = None
    typical: ClassVar[Typical | None] = None
    same_as: ClassVar[Mapping[str, Same]] = {}  # a kind told in its place: when both would have read the same
    beside: ClassVar[str] = "and"  # between its sensor's name and the other's that it reads

    channel: str
    onset_s: float
    duration_s: float | None = None
    ramp_s: float = 0.0
    intermittent: Intermittent | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.channel, str):
            raise InputError(f"{self.kind}: channel is {shown(self.channel)}; it must be a channel's name")
        number(f"{self.kind}: onset_s", self.onset_s)
        for parameter in self.parameters():
            parameter.check(self.kind, getattr(self, parameter.name))
        if self.channel in self.reads[1:]:
            raise InputError(f"{self.kind}: '{self.channel}' is its own other channel; name another one")
        if self.duration_s is not None:
            number(f"{self.kind}: duration_s", self.duration_s, 0.0, above=True)
        number(f"{self.kind}: ramp_s", self.ramp_s, 0.0)
        if not isinstance(self.intermittent, Intermittent | None):
            wanted = "Intermittent(period_s=..., duty=...) or None"
            raise InputError(f"{self.kind}: intermittent is {shown(self.intermittent)}; it must be {wanted}")

    @classmethod
    @cache  # a diagnosis makes thousands of a kind
    def parameters(cls) -> tuple[Parameter, ...]:
        """Return the parameters of this kind, in order."""
        declared = [each for each in fields(cls) if each.metadata]
        return tuple(Parameter(name=each.name, default=each.default, **each.metadata) for each in declared)

    @property
    def severities(self) -> dict[str, float]:
        """The severities by name, in their units, without those left out."""
        named = [(each.name, getattr(self, each.name)) for each in self.parameters() if each.is_severity]
        return {name: float(value) for name, value in named if value is not None}

    @property
    def reads(self) -> tuple[str, ...]:
        """The channels that it reads, its own first."""
        return (self.channel, *(getattr(self, each.name) for each in self.parameters() if each.is_channel))

    @property
    def parts(self) -> tuple[Fault, ...]:
        """The faults of one channel each that this one consists of, itself first; they act at the same time."""
        return (self,)

    @property
    def changes(self) -> tuple[str, ...]:
        """The channels that it changes, its own first."""
        return tuple(part.channel for part in self.parts)

    def begin(self, before: FloatArray) -> State:
        """Return the state for the first stretch, from the last healthy sample of `reads`."""
        return None

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Return the broken samples of a stretch, and the state for the next.

        By default it applies `distort_sample` to one sample after the other.

        Parameters
        ----------
        readings : shape (samples, len(reads))
            The channels that the fault reads, its own first.
        elapsed_s : shape (samples,)
            Time since the onset, in seconds.
        sample_period_s : float
            Ts, in seconds.
        carried
            The state from `begin` or from the stretch before.
        """
        if type(self).distort_sample is Fault.distort_sample:
            raise NotImplementedError(f"{type(self).__name__} defines neither distort nor distort_sample")
        broken = []
        for now, since_s in zip(readings.tolist(), elapsed_s.tolist(), strict=True):
            value, carried = self.distort_sample(now, since_s, sample_period_s, carried)
            broken.append(value)
        return np.array(broken, dtype=np.float64), carried

    def undone(self, readings: FloatArray, expected: FloatArray) -> FloatArray | None:
        """Return what the channel should have read by what it reads; None where that tells no more than is expected.

        Parameters
        ----------
        readings : shape (samples,)
        expected : shape (samples,)
            What it should have read by other sensors: where the readings don't tell.
        """
        return None

    def distort_sample(self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State) -> Broken:
        """Return one broken sample and the state for the next: `distort` in plain floats, ten times as fast.

        By default it is `distort` of a stretch of one sample.
        """
        broken, carried = self.distort(np.array([now]), np.array([elapsed_s]), sample_period_s, carried)
        return float(broken[0]), carried

    def onset_row(self, record: Record) -> int:
        """Return the row of a record from which on the fault may act: the first at or after the onset."""
        return math.ceil((self.onset_s - SLACK_S - record.start_s) / record.sample_period_s)

    @overload
    def active(self, time_s: float) -> bool: ...
    @overload
    def active(self, time_s: FloatArray) -> BoolArray: ...
    def active(self, time_s: Value) -> bool | BoolArray:
        """Return at which times the fault is active; a time counts as reached up to a nanosecond before it."""
        active = time_s >= self.onset_s - SLACK_S
        if self.duration_s is not None:
            active = active & (time_s < self.onset_s + self.duration_s - SLACK_S)
        if self.intermittent is not None:
            active = active & self.intermittent.is_on(time_s - self.onset_s)
        return active

    def broken(self, readings: FloatArray, time_s: FloatArray, sample_period_s: float) -> FloatArray:
        """Return the broken channel, shape (samples,), from readings of shape (samples, len(reads))."""
        broken = readings[:, 0].copy()
        active = np.concatenate([[False], self.active(time_s), [False]])
        for first, end in np.flatnonzero(active[1:] != active[:-1]).reshape(-1, 2).tolist():
            carried = self.begin(readings[max(first - 1, 0)])
            now, elapsed_s = readings[first:end], time_s[first:end] - self.onset_s
            broken[first:end], _ = self.distort(now, elapsed_s, sample_period_s, carried)
            coming = slice(first, first + int(np.searchsorted(elapsed_s, self.ramp_s)))
            broken[coming] = self._coming(readings[coming, 0], broken[coming], time_s[coming] - self.onset_s)
        return broken

    def array(self, record: Record) -> FloatArray:
        """Return the broken channel of a record, shape (samples,); of a sensor of its own rate, only readings break."""
        readings, time_s, period_s = record.matrix(self.reads), record.time_s, record.sample_period_s
        read = np.isfinite(readings[:, 0])
        if self.channel not in OF_OWN_RATE or read.all() or np.count_nonzero(read) < 2:
            return self.broken(readings, time_s, period_s)
        values = readings[:, 0].copy()
        values[read] = self.broken(readings[read], time_s[read], float(np.median(np.diff(time_s[read]))))
        return values

    def onwards(self, record: Record, stop: int) -> tuple[FloatArray, FloatArray]:
        """Return the channel from `onset_row` up to another row, without the fault and with it."""
        row = max(self.onset_row(record), 0)
        before = max(row - 1, 0)  # a fault begins with the last healthy sample
        readings = record.values[before:stop, record.columns(self.reads)]
        time_s = even_times_s(record.start_s, record.sample_period_s, range(before, before + len(readings)))
        broken = self.broken(readings, time_s, record.sample_period_s)
        return readings[row - before :, 0], broken[row - before :]

    def stream(self, sample_period_s: float) -> Callable[[float, Sequence[float]], float]:
        """Return a function that takes a time and the sample of `reads`, in order, and gives the broken sample."""
        carried: State = None
        before: tuple[float, ...] | None = None
        begun = False

        def step(time_s: float, sample: Sequence[float]) -> float:
            nonlocal carried, before, begun
            time_s, now = float(time_s), tuple(map(float, sample))
            if not self.active(time_s):
                before, begun = now, False
                return now[0]
            if not begun:
                carried = self.begin(np.array(now if before is None else before))
                begun = True
            elapsed_s = time_s - self.onset_s
            broken, carried = self.distort_sample(now, elapsed_s, sample_period_s, carried)
            return broken if elapsed_s >= self.ramp_s else self._coming(now[0], broken, elapsed_s)

        return step

    def _coming(self, y: Value, broken: Value, elapsed_s: Value) -> Value:
        """Return y + w (F(y) - y), while the fault comes in."""
        return y + elapsed_s / self.ramp_s * (broken - y) if self.ramp_s else broken


class Formula(Fault):
    """A kind that carries nothing: one formula, of numbers or of arrays of them."""

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value | float:
        """Return the broken samples.

        Parameters
        ----------
        now : sequence of float or array
            What the channels of `reads` read.
        elapsed_s : float or array
            Time since the onset, in seconds.
        sample_period_s : float
            Ts, in seconds.
        """
        raise NotImplementedError

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Apply the formula to arrays."""
        broken = np.empty(len(readings))
        broken[:] = self.formula(list(readings.T), elapsed_s, sample_period_s)
        return broken, None

    def distort_sample(self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State) -> Broken:
        """Apply the formula to numbers."""
        return float(self.formula(now, elapsed_s, sample_period_s)), None


class Following(Fault):
    """A kind that makes of each sample, and of what it read before, what it reads; missing samples are passed over."""

    def follow(self, y: Value, before: Value, sample_period_s: float) -> Value:
        """Return what it reads, of numbers or of arrays.

        Parameters
        ----------
        y : float or array
            What it should read.
        before : float or array
            What it read one sample before.
        sample_period_s : float
            Ts, in seconds.
        """
        raise NotImplementedError

    def begin(self, before: FloatArray) -> State:
        """Start from the last healthy sample."""
        return float(before[0])

    def distort_sample(self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State) -> Broken:
        """Follow the signal by one step."""
        y = now[0]
        if y != y:
            return y, carried
        at = self.follow(y, carried, sample_period_s) if carried == carried else y
        return at, at


def periods(elapsed_s: Value, period_s: float, sample_period_s: float) -> Value:
    """Return how many whole periods have passed; one is over up to a thousandth of a sample before its end.

    >>> periods(0.29999, 0.1, 0.1), periods(0.2, 0.1, 0.1)
    (3.0, 2.0)
    """
    return (elapsed_s + SLACK_S + 1e-3 * sample_period_s) // period_s


def check_unit(what: str, channel: str, unit: str) -> None:
    """Refuse a channel whose unit is known to be another one."""
    if unit and unit_of(channel) not in ("", unit):
        raise InputError(f"{what} is '{channel}', which is in {unit_of(channel)}; it must be a channel in {unit}")


def inject(record: Record, faults: Fault | Sequence[Fault], *, attitude: AttitudeEstimator | None = None) -> Record:
    """Return the record with one or several faults, applied one after the other.

    Parameters
    ----------
    record : Record
    faults : Fault or sequence of Fault
        Each acts on the result of those before it. Of a magnetometer and a GPS, which are slower than a record, the
        readings are broken, and rows between them stay missing.
    attitude : AttitudeEstimator, optional
        The estimator of the record's attitude: phi, theta and psi become its result on the broken gyros, and faults of
        these act on that. Without one the attitude is unchanged, as for a vertical gyro or a camera.

    Raises
    ------
    InputError
        If the record lacks a channel, or a fault's onset lies outside of it.

    Examples
    --------
    >>> import gtmbench as gb
    >>> record = gb.Record([3.0, 1.0, 2.0], channels=["p"], sample_period_s=1.0)
    >>> gb.inject(record, gb.Jam(channel="p", onset_s=1.0))["p"]
    array([3., 3., 3.])

    An estimator integrates a gyro's bias until its references hold against it:

    >>> level = {"p": 0.0, "q": 0.0, "r": 0.0, "phi": 1.0, "theta": 0.0, "psi": 90.0}
    >>> flight = gb.Record([list(level.values())] * 3001, channels=list(level), sample_period_s=0.01)
    >>> bias = gb.Bias(channel="p", onset_s=10.0, size=2.0)
    >>> broken = gb.inject(flight, bias, attitude=gb.AttitudeEstimator(time_constant_s=5.0))
    >>> broken["phi"][[0, 999, 1500, 3000]].round(1)
    array([ 1. ,  1. ,  7.3, 10.8])
    """
    listed = [faults] if isinstance(faults, Fault) else list(faults)
    broken = _broken(record, listed)
    if attitude is None:
        return broken
    _check_estimated(record, attitude)
    estimated = attitude.bent(record, broken)
    for name in ATTITUDE:
        record = record.replace(name, estimated[name])
    return _broken(record, listed)


def _broken(record: Record, faults: Sequence[Fault]) -> Record:
    for fault in faults:
        check_onset(fault, record.start_s, record.end_s)
        check_of_sensor(fault)
        broken = {part.channel: part.array(record) for part in fault.parts}
        for channel, values in broken.items():
            record = record.replace(channel, values)
    return record


def _check_estimated(record: Record, attitude: object) -> None:
    """Refuse what is no estimator, and a record without the channels that one goes by."""
    if not isinstance(attitude, AttitudeEstimator):
        raise InputError(
            f"attitude is {shown(attitude)}; give an estimator such as AttitudeEstimator(time_constant_s=5), or None "
            "for an attitude that no gyro enters"
        )
    missing = [name for name in (*GYROS, *ATTITUDE) if name not in record.channels]
    if missing:
        raise InputError(
            f"an estimator makes {', '.join(ATTITUDE)} of {', '.join(GYROS)}, and {', '.join(missing)} isn't there; "
            "give a record that has them all, or leave attitude out"
        )


def check_of_sensor(fault: Fault) -> None:
    """Refuse a fault of a surface in what is recorded already: the aircraft would have flown otherwise."""
    commanded = [channel for channel in fault.changes if channel in COMMANDS]
    if commanded:
        raise InputError(
            f"{fault.kind} of {commanded[0]}: a broken surface makes another flight, which no record can be turned "
            "into; fly it: gtmbench fly --fault, or gb.fly(faults=...)"
        )


def check_onset(fault: object, start_s: float, end_s: float) -> None:
    """Refuse what is no fault, or one that begins outside of a record."""
    if not isinstance(fault, Fault):
        raise InputError(f"{fault!r} is no fault; give one such as Jam(channel='p', onset_s=300)")
    if not start_s - 1e-9 <= fault.onset_s <= end_s + 1e-9:
        raise InputError(
            f"{fault.kind} on '{fault.channel}' begins at {fault.onset_s:g} s, outside of the record, which runs "
            f"from {start_s:g} to {end_s:g} s"
        )

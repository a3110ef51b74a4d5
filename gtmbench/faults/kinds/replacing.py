"""Faults that put something in the place of the reading: nothing, a constant, an older one, another channel's."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar

import numpy as np

from gtmbench.faults.distortions import rate_limited
from gtmbench.faults.fault import Broken, Distorted, Fault, Formula, State, periods
from gtmbench.faults.parameter import other_channel, severity
from gtmbench.faults.shape import Same, Shape, Typical, is_always, is_beyond, is_last
from gtmbench.values.clock import FloatArray, Value


@dataclass(frozen=True, kw_only=True)
class Dropout(Formula):
    """Nothing arrives: NaN.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.Dropout(channel="p", onset_s=0.0).stream(sample_period_s=1.0)(0.0, [2.0])
    nan
    """

    kind: ClassVar[str] = "dropout"
    occurs: ClassVar[str] = "a plug, a power supply; words without computed data on an ARINC 429 bus"
    typical: ClassVar = Typical()

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value | float:
        """Read nothing."""
        return math.nan


@dataclass(frozen=True, kw_only=True)
class Stuck(Formula):
    """The sensor reads a value that never changes: y_b(k) = value; zero where none is given.

    Parameters
    ----------
    value : float, optional
        In the channel's unit.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.Stuck(channel="p", onset_s=0.0).stream(sample_period_s=1.0)(0.0, [2.0])
    0.0
    """

    kind: ClassVar[str] = "stuck"
    occurs: ClassVar[str] = "a broken wire, a converter that is off"
    shape: ClassVar = Shape(how="constant", family="replacing", parameter="value")
    typical: ClassVar = Typical(gyro=(0.0, 5.0), angle=(0.0, 10.0))
    same_as: ClassVar = {
        "jam": Same(is_last, "it may have been there already"),
        "hardover": Same(is_beyond, "only the place of its stop tells one"),
    }
    value: float = severity(default=0.0)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value | float:
        """Read it."""
        return self.value


@dataclass(frozen=True, kw_only=True)
class Jam(Fault):
    """The sensor stays at its last healthy sample: y(k) = y(onset - Ts), or the first sample if it never was healthy.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Jam(channel="p", onset_s=1.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([3.0, 1.0, 2.0])]
    [3.0, 3.0, 3.0]
    """

    kind: ClassVar[str] = "jam"
    occurs: ClassVar[str] = "a frozen vane, a task that has stopped; the dissertation's"
    shape: ClassVar = Shape(how="last", family="replacing")
    typical: ClassVar = Typical()
    same_as: ClassVar = {"stuck": Same(is_always, "it is stuck, at the last healthy value")}

    def begin(self, before: FloatArray) -> State:
        """Hold the last healthy sample."""
        return float(before[0])

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Repeat it."""
        return np.full(len(readings), carried), carried


@dataclass(frozen=True, kw_only=True)
class Hardover(Fault):
    """The sensor runs to its stop and stays: y_b(k) = y_b(k-1) + clip(limit - y_b(k-1), +-rate_limit Ts).

    It starts from the last healthy sample, and without a rate limit it jumps to its stop.

    Parameters
    ----------
    limit : float
        The stop, in the channel's unit.
    rate_limit : float or None, optional
        How fast it runs there, in the channel's unit per second; None: at once.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Hardover(channel="p", onset_s=1.0, limit=-5.0, rate_limit=4.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([1.0, 2.0, 1.0, 2.0])]
    [1.0, -3.0, -5.0, -5.0]
    """

    kind: ClassVar[str] = "hardover"
    occurs: ClassVar[str] = "a short circuit to the supply; the gyro of the Schiaparelli lander for a second (ESA 2017)"
    shape: ClassVar = Shape(how="beyond", family="replacing", parameter="limit")
    typical: ClassVar = Typical(shown={"limit": 50.0, "rate_limit": 25.0}, gyro=(60.0, -150.0), angle=(60.0, -90.0))
    same_as: ClassVar = {"stuck": Same(is_always, "at its stop it is stuck")}
    limit: float = severity()
    rate_limit: float | None = severity(per_second=True, low=0.0, above=True, default=None)

    def begin(self, before: FloatArray) -> State:
        """Start from the last healthy sample, or from the stop."""
        return self.limit if self.rate_limit is None else float(before[0])

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Run, and stay."""
        stop = np.full(len(readings), self.limit)
        return rate_limited(stop, (self.rate_limit or 0.0) * sample_period_s, carried)


@dataclass(frozen=True, kw_only=True)
class Stale(Fault):
    """Only one reading every hold_s is fresh, and is repeated until the next: y_b(t) = y(onset + n hold_s), n whole.

    Where that is between samples the next one is taken; one that is missing (NaN) isn't: the one before is repeated on.

    Parameters
    ----------
    hold_s : float
        From one fresh reading to the next, in seconds.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Stale(channel="p", onset_s=1.0, hold_s=2.0).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([0.0, 1.0, 2.0, 3.0, 4.0])]
    [0.0, 1.0, 1.0, 3.0, 3.0]
    """

    kind: ClassVar[str] = "stale"
    occurs: ClassVar[str] = "a task that runs more seldom than it is asked"
    shape: ClassVar = Shape(how="repeated", family="replacing", parameter="hold_s")
    typical: ClassVar = Typical(shown={"hold_s": 1.0}, gyro=(0.1, 0.5), angle=(0.1, 0.5))
    hold_s: float = severity(unit="s", low=0.0, above=True)

    def begin(self, before: FloatArray) -> State:
        """Repeat the last healthy sample where none is fresh."""
        return -1.0, float(before[0])

    def distort_sample(self, now: Sequence[float], elapsed_s: float, sample_period_s: float, carried: State) -> Broken:
        """Read, or repeat."""
        number, held = periods(elapsed_s, self.hold_s, sample_period_s), carried[1]
        if number != carried[0] and now[0] == now[0]:
            held = now[0]
        return held, (number, held)


@dataclass(frozen=True, kw_only=True)
class Delay(Fault):
    """Readings are late: y_b(t) = y(t - delay_s), between samples on a straight line.

    Until the first late reading arrives after the onset, the last one is held.

    Parameters
    ----------
    delay_s : float
        In seconds.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Delay(channel="p", onset_s=1.0, delay_s=1.5).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([0.0, 1.0, 2.0, 4.0, 8.0])]
    [0.0, 0.0, 0.5, 1.5, 3.0]
    """

    kind: ClassVar[str] = "delay"
    occurs: ClassVar[str] = "an overloaded bus, a queue that is never emptied"
    shape: ClassVar = Shape(
        how="search",
        family="timing",
        parameter="delay_s",
        low=0.01,
        high=1.0,
        when="late",
        passes_for=("motion", "turn"),
    )
    typical: ClassVar = Typical(shown={"delay_s": 0.6}, gyro=(0.03, 0.2), angle=(0.05, 0.2))
    delay_s: float = severity(unit="s", low=0.0)

    def begin(self, before: FloatArray) -> State:
        """Hold the last healthy sample until another arrives."""
        return (float(before[0]),)

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Look back over a stretch and what was before."""
        samples, share = _late(self.delay_s, sample_period_s)
        history = np.concatenate([carried, readings[:, 0]])
        rows = np.arange(len(carried), len(history)) - samples
        late = history[np.maximum(rows, 0)]
        if share:
            late = late + share * (history[np.maximum(rows - 1, 0)] - late)
        return late, tuple(history[-(samples + 1) :].tolist())


@dataclass(frozen=True, kw_only=True)
class ClockSlip(Fault):
    """Time stamps slip, so that readings come later and later: y_b(t) = y(t - slip (t - onset)).

    Parameters
    ----------
    slip : float
        Seconds a second.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.ClockSlip(channel="p", onset_s=1.0, slip=0.5).stream(sample_period_s=1.0)
    >>> [step(time_s, [y]) for time_s, y in enumerate([0.0, 1.0, 3.0, 5.0, 7.0])]
    [0.0, 1.0, 2.0, 3.0, 4.0]
    """

    kind: ClassVar[str] = "clock_slip"
    occurs: ClassVar[str] = "a logger's own clock that runs slow, a queue that is emptied too slowly"
    shape: ClassVar = Shape(
        how="search",
        family="timing",
        parameter="slip",
        low=0.0005,
        high=0.2,
        when="late",
        spread=8.0,  # small differences of readings, in which the model's error is far more than noise
        passes_for=("motion", "turn"),
    )
    typical: ClassVar = Typical(shown={"slip": 0.1}, gyro=(0.005, 0.02), angle=(0.005, 0.02))
    slip: float = severity(unit="", low=0.0, high=1.0)

    def begin(self, before: FloatArray) -> State:
        """Remember the last healthy sample."""
        return None, 0.0, (float(before[0]),)

    def distort(self, readings: FloatArray, elapsed_s: FloatArray, sample_period_s: float, carried: State) -> Distorted:
        """Look back over a stretch and what was before, from the first reading on that is still needed."""
        if not len(elapsed_s):
            return elapsed_s, carried
        number = periods(elapsed_s, sample_period_s, sample_period_s)
        least, first, kept = carried if carried[0] is not None else (number[0] - 1.0, number[0] - 1.0, carried[2])
        history = np.concatenate([kept, readings[:, 0]])
        at = np.maximum(number - self.slip * elapsed_s / sample_period_s, least)
        share = at - np.floor(at)
        rows = (at - share - first).astype(np.int64)
        after = history[np.minimum(rows + 1, len(history) - 1)]
        late = np.where(share > 0.0, history[rows] + share * (after - history[rows]), history[rows])
        return late, (least, first + float(rows[-1]), tuple(history[rows[-1] :].tolist()))


@dataclass(frozen=True, kw_only=True)
class Swap(Formula):
    """Two channels are swapped: each reads the other's signal. The one kind that changes two channels.

    Parameters
    ----------
    other : str
        The other channel.

    Examples
    --------
    >>> import gtmbench as gb
    >>> step = gb.Swap(channel="p", onset_s=0.0, other="q").stream(sample_period_s=1.0)
    >>> step(0.0, [2.0, 5.0])
    5.0
    """

    kind: ClassVar[str] = "swap"
    beside: ClassVar[str] = "with"
    occurs: ClassVar[str] = "crossed plugs, another mounting's axes"
    shape: ClassVar = Shape(how="swapped", family="cross-axis")
    typical: ClassVar = Typical(shown={"other": "q"})
    other: str = other_channel()

    @property
    def parts(self) -> tuple[Fault, ...]:
        """The fault itself, and the same for the other channel."""
        return self, replace(self, channel=self.other, other=self.channel)

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Read the other channel."""
        return now[1]


@dataclass(frozen=True, kw_only=True)
class Float(Formula):
    """A surface without hinge moment follows the flow: ratio a, with a the angle of the flow that turns it.

    A surface that nothing holds stands where its hinge moment vanishes, Ch_a a + Ch_d d = 0, so d = ratio a with
    ratio = -Ch_a/Ch_d. An elevator (trailing edge down positive) follows alpha with a ratio of about -0.5, a rudder
    (trailing edge left positive) beta with about +0.5. The flow at the tail is taken for that at the centre of gravity:
    downwash and the tail's own motion are left out, and so is the inertia of the surface. Ailerons float up together,
    which one command can't say: with ratio 0 they trail.

    Parameters
    ----------
    flow : str
        The angle that it follows: alpha or beta.
    ratio : float
        Deflection per degree of the flow.

    Examples
    --------
    >>> import gtmbench as gb
    >>> fault = gb.Float(channel="elevator", onset_s=0.0, flow="alpha", ratio=-0.5)
    >>> fault.stream(sample_period_s=1.0)(0.0, [2.0, 3.0])
    -1.5
    """

    kind: ClassVar[str] = "float"
    occurs: ClassVar[str] = "a broken push rod; of surfaces alone, as physics goes"
    typical: ClassVar = Typical(shown={"flow": "q", "ratio": 1.5}, gyro=(), angle=())
    flow: str = other_channel()
    ratio: float = severity(unit="")

    def formula(self, now: Sequence[Value], elapsed_s: Value, sample_period_s: float) -> Value:
        """Follow the flow."""
        return self.ratio * now[1]


@lru_cache(maxsize=64)
def _late(delay_s: float, sample_period_s: float) -> tuple[int, float]:
    """Return by how many whole samples a delay is late, and by which share of one more."""
    late = round(delay_s / sample_period_s, 9)
    return int(late), late - int(late)

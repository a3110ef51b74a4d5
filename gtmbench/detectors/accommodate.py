"""Accommodation: a gyro that a monitor names is flown without; what it should read comes from the attitude's slope.

From the alarm to the name takes two thirds of a second or more, and a damper that works the wrong way needs less to
throw the aircraft. So from the alarm on a gyro is heard only as far as the attitude agrees: of the two rates the
autopilot gets the lesser, and none where they differ in sign. Whichever of the two is at fault, that is a rate between
0 and the right one: damping may be lost, but nothing is driven. Once the gyro is named the virtual rate alone stands
in. It is given back when the fault has ended, when nothing is left to explain, and when an attitude angle is named for
the alarm of this one gyro. Where several gyros have alarmed such a verdict gives nothing back: two broken gyros look
like one broken angle, and to lose damping is safer than to fly on them. Nor is a gyro heard alone whose score is
disarmed, for what is known of another fault.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise

from gtmbench.checks import meant, shown, whole
from gtmbench.detectors.protocol import Monitor, Stream, is_ready
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, Motion, factor_of, raw_needs, reproduces
from gtmbench.values.channels import SENSORS
from gtmbench.values.clock import same_period
from gtmbench.values.record import Record

SUSPECTED, REPLACED, GIVEN_BACK = "suspected", "replaced", "given back"  # what is told, of a gyro
STAND_INS = ("attitude", "zero")
_ATTITUDE = {"p": "p_att", "q": "q_att", "r": "r_att"}  # of a gyro, the pseudo input that stands in for it
_COLUMNS = {name: column for column, name in enumerate(SENSORS)}

Readings = Sequence[float]  # one sample of every sensor, in the order of `SENSORS`
Tell = Callable[[float, str, str, float], None]  # a time in seconds, what happened, to which channel, and its value


@dataclass(frozen=True, kw_only=True)
class Accommodate:
    """Replace the gyro that a monitor names, between the sensors and the autopilot.

    Attributes
    ----------
    monitor : Monitor
        One that names gyros, as bank C does.
    stand_in : "attitude" or "zero"
        The replacement of a gyro: the rate computed from the attitude's slope by kinematics, or zero.
    slope_samples : int
        The number of samples that the slope is fitted over. More samples mean less noise and a delay of half as many
        samples. At the GTM's gains 4 cost little of either, and 10 swing the aircraft by 40 deg/s.

    Raises
    ------
    InputError
        If a value is invalid, or the monitor can't name a gyro or needs what isn't sensed.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flights = [gb.measure(gb.fly("gtm", "multisine+turbulence", 200.0, seed), noise="t2") for seed in (7, 8)]
    >>> monitor = gb.calibrate(flights, bank=gb.load_bank("C"))
    >>> flip = gb.SignFlip(channel="r", onset_s=40.0)
    >>> rescued = gb.fly_in_loop(duration_s=45.0, faults=flip, accommodate=gb.Accommodate(monitor))
    >>> [(event.kind, event.channel) for event in rescued.events], rescued.departed_s
    ([('suspected', 'r'), ('replaced', 'r')], None)
    """

    monitor: Monitor = field(kw_only=False)
    stand_in: str = STAND_INS[0]
    slope_samples: int = 4

    def __post_init__(self) -> None:
        if not (hasattr(self.monitor, "stream") and is_ready(self.monitor)):
            raise InputError(f"monitor is {shown(self.monitor)}; give a calibrated one, as gb.calibrate makes")
        if self.stand_in not in STAND_INS:
            raise InputError(
                f"no stand-in {shown(self.stand_in)}; there are {', '.join(STAND_INS)}{meant(self.stand_in, STAND_INS)}"
            )
        whole("slope_samples", self.slope_samples, 2, 100)
        if not self.gyros:
            raise InputError(
                f"{self.monitor.name} names no gyro, so none can be flown without; give a monitor that does, of bank C"
            )
        if unread := [name for name in self.monitor.channels if name not in SENSORS]:
            raise InputError(f"{self.monitor.name} needs {', '.join(unread)}, and a loop senses {', '.join(SENSORS)}")

    @property
    def gyros(self) -> tuple[str, ...]:
        """The gyros that the monitor may name."""
        return tuple(name for name in _ATTITUDE if name in self.monitor.suspects)

    def start(self, sample_period_s: float, tell: Tell) -> Callable[[float, Readings], Readings]:
        """Begin a flight anew, as a loop's accommodation does.

        Parameters
        ----------
        sample_period_s : float
        tell : callable
            Called with the time in seconds, the action (`SUSPECTED`, `REPLACED` or `GIVEN_BACK`), the gyro, and the
            rate handed on in deg/s.

        Returns
        -------
        callable
            Takes the time in seconds and the readings of all sensors, and returns those to fly on.

        Raises
        ------
        InputError
            If the monitor was calibrated at another sample period.
        """
        wanted_s = self.monitor.sample_period_s
        if wanted_s is not None and not same_period(wanted_s, sample_period_s):
            raise InputError(
                f"{self.monitor.name} was calibrated at {wanted_s:g} s a sample, and the loop runs at "
                f"{sample_period_s:g} s; calibrate it on records of that rate"
            )
        stream = self.monitor.stream()
        attitude = _VirtualRates(self.slope_samples, sample_period_s)
        now_is: dict[str, str] = {}  # of a gyro that isn't flown on as it is, SUSPECTED or REPLACED

        def virtual(gyro: str) -> float:
            return 0.0 if self.stand_in == "zero" else attitude.rate(gyro)

        def hand_on(time_s: float, readings: Readings) -> Readings:
            attitude.take(readings)
            sample = Record([readings], channels=SENSORS, sample_period_s=sample_period_s, start_s=time_s)
            before = dict(now_is)
            if stream.push(sample) or now_is:
                now_is.clear()
                now_is.update(distrusted(stream, self.gyros))
            if not (now_is or before):
                return readings
            flown = list(readings)
            for gyro in self.gyros:
                column, standing = _COLUMNS[gyro], now_is.get(gyro)
                if standing == REPLACED:
                    flown[column] = virtual(gyro)
                elif standing == SUSPECTED:
                    flown[column] = lesser(readings[column], virtual(gyro))
                if standing != before.get(gyro):
                    tell(time_s, standing or GIVEN_BACK, gyro, flown[column])
            return flown

        return hand_on


def distrusted(stream: Stream, gyros: Sequence[str]) -> dict[str, str]:
    """Return the gyros that a fault that lasts names (`REPLACED`), and those that it may hide (`SUSPECTED`).

    These are the ones whose scores rose, but for one that a failed angle explains; and while no gyro is named those
    whose scores the fault keeps from alarming: nobody would say if they failed, too.
    """
    risen: set[str] = set()
    named: set[str | None] = set()
    for alarm in stream.alarms:
        first = alarm
        while not first.is_first:
            first = stream.alarms[first.fault]
        if alarm.ended_s is None and first.ended_s is None and not first.has_passed:
            risen |= _about(alarm.source, gyros)
            said = first.last
            named |= {None} if said is None else {said.sensor, said.partner if said.swapped else said.sensor}
    suspected = set(risen)
    if named - set(gyros):
        suspected |= {gyro for score, armed in stream.armed.items() if not armed for gyro in _about(score, gyros)}
    if len(risen) == 1 and not named & {None, *gyros}:  # an angle explains what rose
        suspected -= risen
    return {gyro: REPLACED if gyro in named else SUSPECTED for gyro in gyros if gyro in named | suspected}


def _about(score: str, gyros: Sequence[str]) -> set[str]:
    return {gyro for gyro in gyros if gyro == score or reproduces(score, gyro)}


def lesser(one: float, other: float) -> float:
    """Return the one nearer to 0, and 0 where they differ in sign; where one is missing (NaN), the other.

    >>> lesser(2.0, 5.0), lesser(-3.0, -1.0), lesser(2.0, -1.0), lesser(math.nan, 4.0)
    (2.0, -1.0, 0.0, 4.0)
    """
    if math.isnan(one) or math.isnan(other):
        return other if math.isnan(one) else one
    if one * other <= 0.0:
        return 0.0
    return one if abs(one) < abs(other) else other


class _VirtualRates:
    """Rates from the attitude: straight lines through its last samples, and kinematics."""

    def __init__(self, samples: int, sample_period_s: float) -> None:
        about = [row - (samples - 1) / 2.0 for row in range(samples)]
        spread = sum(row * row for row in about) * sample_period_s
        # by the steps between samples, for a heading runs from 360 deg to 0
        self._weights = [sum(about[row:]) / spread for row in range(1, samples)]
        self._latest: deque[Readings] = deque(maxlen=samples)

    def take(self, readings: Readings) -> None:
        """Take the next sample."""
        self._latest.append(readings)

    def rate(self, gyro: str) -> float:
        """Return what a gyro should read, in deg/s, as of half the samples ago; NaN where that isn't known."""
        name = _ATTITUDE[gyro]
        if len(self._latest) <= len(self._weights):
            return math.nan
        motion = Motion(raw_needs(name), self._channel, self._slope)
        return math.degrees(float(PSEUDO_INPUTS[name].compute(motion)))

    def _channel(self, name: str) -> float:
        return self._latest[-1][_COLUMNS[name]] * factor_of(name)

    def _slope(self, name: str) -> float:
        values = [readings[_COLUMNS[name]] for readings in self._latest]
        steps = [(after - before + 180.0) % 360.0 - 180.0 for before, after in pairwise(values)]
        return sum(weight * step for weight, step in zip(self._weights, steps, strict=True)) * factor_of(name)

"""Accommodation: a sensor that a monitor names is flown without; what it should read comes from the others.

From the alarm to the name takes two thirds of a second or more, and a damper that works the wrong way needs less to
throw the aircraft. So while nobody is named, no reading of the axis can do harm:

- of a gyro and the rate of the attitude's slope the autopilot gets the lesser, and none where they differ in sign;
- of an angle as read, as the gyros carry it on and as it was, the one in the middle.

Damping may be lost, but nothing is driven, for as long as it takes. Gyro and angle of an axis explain each other's
faults, and a wrong name would fly on the broken one: on late sensors a monitor names the wrong one of the two in one
flight of four. So a name alone replaces nothing. It is the flight path that tells, within seconds (`stand_in.py`): whom
it contradicts decisively is replaced, as is the one of the two that has read one value for long. Its stand-in is flown
alone: the slope's rate for a gyro, for an angle what the gyros carry on. A gyro stays out until it has proved well for
long, an angle until the landing, for nothing tells whether its level is right again.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from gtmbench.checks import meant, number, shown, whole
from gtmbench.detectors.accommodation.stand_in import (
    COLUMNS,
    Balance,
    CarriedAngles,
    Guard,
    Readings,
    VirtualRates,
    known,
    lateness_s,
)
from gtmbench.detectors.protocol import Monitor, Stream, is_ready
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import reproduces
from gtmbench.values.channels import ATTITUDE, GYROS, SENSORS
from gtmbench.values.clock import same_period
from gtmbench.values.record import Record

SUSPECTED, REPLACED, GIVEN_BACK = "suspected", "replaced", "given back"  # what is told, of a sensor
OUT_OF_DATE, UNCERTAIN = "out of date", "uncertain"  # of a stand-in: nothing new makes it; how far it may be off by now
STAND_INS = ("attitude", "zero")
_ANGLE_OF, _GYRO_OF = dict(zip(GYROS, ATTITUDE, strict=True)), dict(zip(ATTITUDE, GYROS, strict=True))
_KEPT_S = 25.0  # of readings, from before a fault's onset
_UNCERTAIN_DEG = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0)  # of a carried angle's error, when it is told
_BLENDED_S = 0.3  # over which the autopilot is handed from one rate or angle to the other
_GUARDED_S = 0.5  # a gyro is suspected after it did what it never had, where no alarm follows
_STUCK_S = 0.3  # of one value: sensors have noise
_IN_TIME_S = 0.022  # a rate that is later than this damps less and less, and then drives: a share of it is flown
_SHARE_UNKNOWN = 0.4  # where it isn't known how late it is
_SMOOTHED_S, _AGREES = 1.0, 3.0  # over which a gyro's difference is averaged, and how many times the usual is agreement

Tell = Callable[[float, str, str, float], None]  # a time in seconds, what happened, to which channel, and its value


@dataclass(frozen=True, kw_only=True)
class Accommodate:
    """Fly without the gyro or the attitude angle that failed, between the sensors and the autopilot.

    A monitor's alarm, or a gyro that does what it never did on this flight, puts an axis under suspicion; the flight
    path tells which of its two sensors is wrong.

    Attributes
    ----------
    monitor : Monitor
        One that names gyros, as bank C does.
    stand_in : "attitude" or "zero"
        The replacement of a gyro: the rate computed from the attitude's slope by kinematics, or zero.
    slope_samples : int
        The number of fresh attitude samples that the slope is fitted over. More samples mean less noise and a delay of
        half as many samples. At the GTM's gains 4 cost little of either, and 10 swing the aircraft by 40 deg/s.
    proving_s : float
        How long a replaced gyro must agree with its stand-in, without an alarm of its axis, until it is flown on again.

    Raises
    ------
    InputError
        If a value is invalid, or the monitor can't name a gyro or needs what isn't sensed.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flights = [gb.measure(gb.fly("gtm", "multisine+turbulence", 200.0, seed), noise="t2") for seed in (7, 8)]
    >>> monitor = gb.calibrate(flights, bank=gb.load_bank("C"))
    >>> flip = gb.SignFlip(channel="q", onset_s=40.0)
    >>> rescued = gb.fly_in_loop(duration_s=45.0, faults=flip, accommodate=gb.Accommodate(monitor))
    >>> [(event.kind, event.channel) for event in rescued.events if event.channel == "q"], rescued.departed_s
    ([('suspected', 'q'), ('replaced', 'q')], None)
    """

    monitor: Monitor = field(kw_only=False)
    stand_in: str = STAND_INS[0]
    slope_samples: int = 4
    proving_s: float = 30.0

    def __post_init__(self) -> None:
        if not (hasattr(self.monitor, "stream") and is_ready(self.monitor)):
            raise InputError(f"monitor is {shown(self.monitor)}; give a calibrated one, as gb.calibrate makes")
        if self.stand_in not in STAND_INS:
            raise InputError(
                f"no stand-in {shown(self.stand_in)}; there are {', '.join(STAND_INS)}{meant(self.stand_in, STAND_INS)}"
            )
        whole("slope_samples", self.slope_samples, 2, 100)
        number("proving_s", self.proving_s, 0.0, 1e6)
        if not self.gyros:
            raise InputError(
                f"{self.monitor.name} names no gyro, so none can be flown without; give a monitor that does, of bank C"
            )
        if unread := [name for name in self.monitor.channels if name not in SENSORS]:
            raise InputError(f"{self.monitor.name} needs {', '.join(unread)}, and a loop senses {', '.join(SENSORS)}")

    @property
    def gyros(self) -> tuple[str, ...]:
        """The gyros that the monitor may name."""
        return tuple(name for name in GYROS if name in self.monitor.suspects)

    @property
    def angles(self) -> tuple[str, ...]:
        """The attitude angles that the monitor may name, and whose gyro it may."""
        return tuple(name for name in ATTITUDE if {name, _GYRO_OF[name]} <= set(self.monitor.suspects))

    def start(self, sample_period_s: float, tell: Tell) -> Callable[[float, Readings], Readings]:
        """Begin a flight anew, as a loop's accommodation does.

        Parameters
        ----------
        sample_period_s : float
        tell : callable
            Called with the time in seconds, the event, the channel, and the value handed on in its unit. Events are
            `SUSPECTED`, `REPLACED`, `GIVEN_BACK`; `OUT_OF_DATE`, where the attitude that a rate comes from has stood
            still, and zero is flown; `UNCERTAIN`, with how far a carried angle may be off by now, in deg.

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
        return _Hand(self, sample_period_s, tell).on


class _Hand:
    """An accommodation at work on one flight."""

    def __init__(self, accommodate: Accommodate, sample_period_s: float, tell: Tell) -> None:
        self._gyros, self._angles = accommodate.gyros, accommodate.angles
        self._is_zero = accommodate.stand_in == "zero"
        self._period_s, self._tell = sample_period_s, tell
        self._stream = accommodate.monitor.stream()
        self._rates = VirtualRates(accommodate.slope_samples, sample_period_s)
        self._slope_samples = accommodate.slope_samples
        self._kept: deque[tuple[float, Readings]] = deque(maxlen=round(_KEPT_S / sample_period_s))
        self._standing: dict[str, str] = {}  # of a sensor that isn't flown on as it is, SUSPECTED or REPLACED
        self._proofs: dict[str, _Proof] = {}  # of a gyro that was replaced
        self._latched: set[str] = set()
        self._carried: CarriedAngles | None = None
        self._carried_for: frozenset[str] | None = None
        self._flown: dict[str, float] = {}  # what was handed on last, of sensors that aren't flown on as they are
        self._balance: Balance | None = None
        self._guard = Guard(sample_period_s)
        self._guarded_s: dict[str, float] = {}  # of a gyro beyond what it did, until when it is suspected for that
        self._blends: dict[
            str, list[float]
        ] = {}  # of such a sensor, what is still added to it, and for how many samples
        self._is_told: dict[str, float] = {}
        self._proving_s = accommodate.proving_s
        self._stuck = _Stuck(sample_period_s)
        self._share = math.nan  # of a virtual rate that is flown; found at the first alarm

    def on(self, time_s: float, readings: Readings) -> Readings:
        """Return the readings to fly on."""
        self._rates.take(readings)
        self._stuck.take(readings)
        self._kept.append((time_s, readings))
        sample = Record([readings], channels=SENSORS, sample_period_s=self._period_s, start_s=time_s)
        told = self._stream.push(sample)
        before = self._standing
        for name in self._guard.take(readings, is_learning=not before):
            if name in self._gyros:
                self._guarded_s[name] = time_s + _GUARDED_S
        if told or before or self._guarded_s:
            self._decide(time_s, readings)
        if not (self._standing or before or self._blends):
            return readings
        return self._handed(time_s, readings, before)

    def _decide(self, time_s: float, readings: Readings) -> None:
        """Decide what every sensor is: heard, suspected or replaced."""
        axes = doubted_gyros(self._stream, self._gyros, is_settled=bool(self._latched))
        self._guarded_s = {name: until_s for name, until_s in self._guarded_s.items() if time_s < until_s}
        axes |= set(self._guarded_s)
        if axes and math.isnan(self._share):
            self._share = self._shared()
        standing = {}
        for gyro in self._gyros:
            if gyro in axes:
                self._settle(gyro)
                standing.update(dict.fromkeys(self._axis(gyro), SUSPECTED))
        for name, proof in list(self._proofs.items()):
            if proof.holds_s(readings, self._rates, is_doubted=name in axes) >= self._proving_s:
                self._latched.discard(name)
                del self._proofs[name]
        # what rose of a sensor is what a latched one of its axis does
        self._standing = {name: suspected for name, suspected in standing.items() if _other(name) not in self._latched}
        self._standing.update(dict.fromkeys(self._latched, REPLACED))

    def _axis(self, gyro: str) -> list[str]:
        return [name for name in (gyro, _ANGLE_OF[gyro]) if name in (*self._gyros, *self._angles)]

    def _settle(self, gyro: str) -> None:
        """Settle who of a doubted axis is replaced: who is stuck, or whom the path contradicts; else nobody yet."""
        axis = self._axis(gyro)
        stuck = [name for name in axis if self._stuck.is_so(name)]
        contradicted = None if self._balance is None else self._balance.wrong(_ANGLE_OF[gyro])
        wrong = stuck[0] if len(stuck) == 1 else contradicted
        if wrong in axis and wrong not in self._latched:
            self._latched -= set(axis)
            self._proofs.pop(gyro, None)
            self._latch(str(wrong))

    def _latch(self, name: str) -> None:
        if name not in self._latched:
            self._latched.add(name)
            if name in self._gyros:
                self._proofs[name] = _Proof(name, self._kept, self._slope_samples, self._period_s)

    def _shared(self) -> float:
        """Return which share of a virtual rate can be flown, as late as it is."""
        rows = [readings for _, readings in self._kept][: -round(1.0 / self._period_s)]
        late_s = lateness_s(rows, self._slope_samples, self._period_s)
        return _SHARE_UNKNOWN if math.isinf(late_s) else min(1.0, _IN_TIME_S / max(late_s, self._period_s))

    def _carry(self, readings: Readings) -> CarriedAngles | None:
        """Carry the distrusted angles on by a sample, from the onset where they are others than before."""
        which = frozenset(name for name in self._standing if name in ATTITUDE)
        if not which:
            self._carried = self._carried_for = self._balance = None
            return None
        rates = {name: known(self._rates.rate(name), 0.0) for name in GYROS if self._standing.get(name) == REPLACED}
        if self._carried is not None and self._carried_for == which:
            self._carried.step(readings, rates)
            if self._balance is not None:
                self._balance.take(readings, self._carried)
            return self._carried
        onset_s = _onset_s(self._stream, self._kept[-1][0])
        before = [readings for time_s, readings in self._kept if onset_s - 0.55 < time_s <= onset_s - 0.05]
        self._balance = Balance(before or [readings], self._period_s)
        self._carried = CarriedAngles(tuple(self._kept), onset_s, which, self._period_s, self._balance.take)
        self._carried_for = which
        return self._carried

    def _handed(self, time_s: float, readings: Readings, before: dict[str, str]) -> Readings:
        flown = list(readings)
        carried = self._carry(readings)
        for name in (*self._gyros, *self._angles):
            standing, column = self._standing.get(name), COLUMNS[name]
            read = readings[column]
            value = read
            if standing is not None:
                value = (
                    self._rate(name, standing, read, time_s)
                    if name in GYROS
                    else self._angle(name, standing, read, carried)
                )
            if standing != before.get(name) and name in self._flown:
                # without a bump: what differs fades, but not what a reading that has failed had put in
                self._blends[name] = [self._flown[name] - value, 1.0]
            flown[column] = self._blended(name, value)
            if standing != before.get(name):
                self._tell(time_s, standing or GIVEN_BACK, name, flown[column])
                self._is_told.pop(name, None)
            if standing == REPLACED and name in ATTITUDE and carried is not None:
                self._tell_error(time_s, name, carried.error_deg(name))
            if standing is not None or name in self._blends:
                self._flown[name] = flown[column]
            else:
                self._flown.pop(name, None)
        return flown

    def _rate(self, name: str, standing: str, read: float, time_s: float) -> float:
        if self._is_zero:
            virtual = 0.0
        elif (virtual := self._rates.rate(name)) != virtual or self._standing.get(_ANGLE_OF[name]) == REPLACED:
            virtual = 0.0
            if standing == REPLACED and name not in self._is_told:
                self._is_told[name] = 0.0
                self._tell(time_s, OUT_OF_DATE, name, 0.0)
        virtual *= self._share
        return virtual if standing == REPLACED else lesser(read, virtual)

    def _angle(self, name: str, standing: str, read: float, carried: CarriedAngles | None) -> float:
        if carried is None:
            return read
        if standing == REPLACED:
            return carried.angle(name)
        return _middle(read, carried.angle(name), carried.held[name])

    def _blended(self, name: str, value: float) -> float:
        if name not in self._blends:
            return value
        difference, share = self._blends[name]
        share -= self._period_s / _BLENDED_S
        if share <= 0.0 or math.isnan(difference):
            del self._blends[name]
            return value
        self._blends[name] = [difference, share]
        return value + share * difference

    def _tell_error(self, time_s: float, name: str, error_deg: float) -> None:
        reached = max((limit for limit in _UNCERTAIN_DEG if error_deg >= limit), default=0.0)
        if reached > self._is_told.get(name, 0.0):
            self._is_told[name] = reached
            self._tell(time_s, UNCERTAIN, name, error_deg)


class _Stuck:
    """Which gyros and angles have read one value for so long that noise can't have."""

    def __init__(self, sample_period_s: float) -> None:
        self._long = round(_STUCK_S / sample_period_s)
        self._last, self._for = dict.fromkeys((*GYROS, *ATTITUDE), math.nan), dict.fromkeys((*GYROS, *ATTITUDE), 0)

    def take(self, readings: Readings) -> None:
        """Take the next sample; one that is missing is stuck, too."""
        for name, last in self._last.items():
            reading = readings[COLUMNS[name]]
            if reading == last or reading != reading:
                self._for[name] += 1
            else:
                self._for[name], self._last[name] = 0, reading

    def is_so(self, name: str) -> bool:
        """Whether a sensor is stuck or gone."""
        return self._for[name] >= self._long


class _Proof:
    """Whether a replaced gyro reads again what its stand-in says: how far they differ, beside how far they did."""

    def __init__(
        self, gyro: str, kept: Sequence[tuple[float, Readings]], slope_samples: int, sample_period_s: float
    ) -> None:
        self._gyro, self._period_s = gyro, sample_period_s
        self._column = COLUMNS[gyro]
        self._share = sample_period_s / _SMOOTHED_S
        rates, squares, count = VirtualRates(slope_samples, sample_period_s), 0.0, 0
        for _, readings in list(kept)[: -round(5.0 / sample_period_s)]:  # by then most alarms have come
            rates.take(readings)
            difference = readings[self._column] - rates.rate(gyro)
            if difference == difference:
                squares, count = squares + difference * difference, count + 1
        self._usual = squares / count if count else 0.0
        self._now = math.inf
        self._for_s = 0.0

    def holds_s(self, readings: Readings, rates: VirtualRates, *, is_doubted: bool) -> float:
        """Take a sample; return for how long the gyro has read well."""
        difference = readings[self._column] - rates.rate(self._gyro)
        square = difference * difference if difference == difference else math.inf
        if math.isinf(self._now):
            self._now = square
        self._now += self._share * (square - self._now) if not math.isinf(square) else 0.0
        well = not is_doubted and square < math.inf and self._now < _AGREES * self._usual
        self._for_s = self._for_s + self._period_s if well else 0.0
        return self._for_s


def doubted_gyros(stream: Stream, gyros: Sequence[str], *, is_settled: bool = False) -> set[str]:
    """Return the gyros whose axis a fault that lasts may be in.

    These are the ones whose scores rose, and those of the axes of sensors that are named. As long as nothing is settled
    and no gyro is named, they are also those whose scores the fault keeps from alarming: nobody would say if they
    failed, too.
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
            named |= {None} if said is None else {*(said.failed or (None,))}
    axes = risen | {_GYRO_OF.get(name, name) for name in named if name is not None}
    if named - set(gyros) and not is_settled:
        axes |= {gyro for score, armed in stream.armed.items() if not armed for gyro in _about(score, gyros)}
    return axes & set(gyros)


def _onset_s(stream: Stream, now_s: float) -> float:
    """Return when the faults that last began, as far as their alarms and judgements tell."""
    onsets_s = [now_s]
    for alarm in stream.alarms:
        if alarm.ended_s is None and not alarm.has_passed:
            onsets_s.append(alarm.onset_s)
            onset_s = alarm.last.parameters.get("onset_s") if alarm.last else None
            if onset_s is not None and onset_s > alarm.onset_s - 5.0:
                onsets_s.append(onset_s)
    return max(min(onsets_s), now_s - _KEPT_S + 2.0)


def _other(name: str) -> str:
    """Return an axis' other sensor."""
    return _ANGLE_OF.get(name) or _GYRO_OF[name]


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


def _middle(read: float, carried: float, held: float) -> float:
    """Return the angle in the middle of three; where the reading is missing, the carried one."""
    return carried if math.isnan(read) else sorted((read, carried, held))[1]

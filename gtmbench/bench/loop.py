"""The loop: sensors are read, broken, and flown on, step by step; what that does to the aircraft is an event."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from math import inf
from operator import call
from pathlib import Path
from typing import Protocol

import numpy as np

from gtmbench.bench.airborne import FLOWN, Airborne, Outside, first_outside, take_off
from gtmbench.bench.aircraft import SAMPLE_PERIOD_S, Aircraft
from gtmbench.bench.attitude_filter import REFERENCE_NOISE_DEG, filtering, reference_noise
from gtmbench.bench.autopilot import Autopilot
from gtmbench.bench.engine import simulating
from gtmbench.bench.excitation import Excitation
from gtmbench.bench.flight import check_envelope
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.sensor_chain import IDEAL, Chained, SensorChain
from gtmbench.bench.sensors import noise_blocks
from gtmbench.checks import meant, shown, whole
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, check_onset
from gtmbench.values.attitude import OWN, AttitudeEstimator, SteepError, estimator_of, too_steep
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS, SENSORS
from gtmbench.values.record import FloatArray, Record

DEPARTURE, ENVELOPE, OUT_OF_LOOP = "departure", "envelope", "out of loop"
GAINS_WANTED = "find its gains by gtmbench autopilot, or give some"
_BLOCK = 4096  # samples whose noise is drawn at a time
_PSI = SENSORS.index("psi")
_PHI, _THETA = SENSORS.index("phi"), SENSORS.index("theta")
_GYROS = [SENSORS.index(name) for name in GYROS]
_ATTITUDE = [SENSORS.index(name) for name in ATTITUDE]

Readings = Sequence[float]  # one sample of every sensor, in the order of `SENSORS`, NaN where one is missing
HandOn = Callable[[float, Readings], Readings]
Tell = Callable[[float, str, str, float], None]  # a time, a kind, a channel and its value, as a `LoopEvent` has them


@dataclass(frozen=True, kw_only=True)
class LoopEvent:
    """An event in a closed-loop flight.

    Attributes
    ----------
    time_s : float
    kind : str
        "departure": the aircraft is first beyond a limit of its ``[departure]``; "envelope": it left the range of its
        model, or its estimator's theta that of Euler angles, where the flight ends; "out of loop": a fault began on a
        channel that the autopilot doesn't read; and the events of an `Accommodation`.
    channel : str
    value : float or None
        The channel's value in its unit, if it matters.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly_in_loop(duration_s=4.0, faults=gb.SignFlip(channel="q", onset_s=2.0))
    >>> event = flight.events[0]
    >>> event.kind, 2.0 < event.time_s < 4.0
    ('departure', True)
    """

    time_s: float
    kind: str
    channel: str
    value: float | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class LoopFlight:
    """A flight with an autopilot in the loop.

    Attributes
    ----------
    truth : Record
        Every channel, as `fly` gives it; it ends early if the aircraft left its envelope.
    sensed : Record
        The sensor readings, noise and faults included, before any accommodation.
    events : tuple of LoopEvent
        In the order of their times.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly_in_loop(duration_s=2.0)
    >>> flight.departed_s is None, len(flight.truth) == len(flight.sensed)
    (True, True)
    >>> [name for name in flight.readings(commands=True).channels if name not in flight.sensed]
    ['elevator', 'aileron', 'rudder', 'throttle']
    """

    truth: Record = field(repr=False)
    sensed: Record = field(repr=False)
    events: tuple[LoopEvent, ...]

    @property
    def departed_s(self) -> float | None:
        """When the aircraft departed or left its envelope; None if it didn't."""
        return departed_s(self.events)

    def readings(self, *, commands: bool = False) -> Record:
        """Return `sensed`, optionally with the surface commands."""
        if not commands:
            return self.sensed
        values = np.column_stack([self.sensed.values, self.truth.matrix(COMMANDS)])
        return Record(values, channels=(*SENSORS, *COMMANDS), sample_period_s=SAMPLE_PERIOD_S)


def departed_s(events: Sequence[LoopEvent]) -> float | None:
    """Return when a departure, or the end of an envelope, comes first among events; None: never."""
    return min((event.time_s for event in events if event.kind in (DEPARTURE, ENVELOPE)), default=None)


class Accommodation(Protocol):
    """The protocol of an object between the sensors and the autopilot that may replace bad readings.

    Examples
    --------
    >>> import gtmbench as gb
    >>> class Untouched:
    ...     def start(self, sample_period_s, tell):
    ...         return lambda time_s, readings: readings  # the autopilot gets what the sensors read
    >>> flight = gb.fly_in_loop(duration_s=1.0, accommodate=Untouched())
    >>> flight.events
    ()
    """

    def start(self, sample_period_s: float, tell: Tell) -> HandOn:
        """Begin a flight anew.

        Return a function that is called once a sample, with the time in seconds and the readings of all sensors in the
        order of `SENSORS` (not to be changed), and returns the readings that the autopilot gets. `tell` takes a time, a
        kind, a channel and its value, and adds them to the flight's events.
        """


def fly_in_loop(
    aircraft: str | Path | Aircraft = "gtm",
    excitation: str | Excitation = "turbulence",
    duration_s: float = 500.0,
    seed: int = 1,
    *,
    autopilot: Autopilot | None = None,
    faults: Fault | Sequence[Fault] = (),
    noise: str | None = "t2",
    noise_seed: int | None = None,
    accommodate: Accommodation | None = None,
    attitude: str | AttitudeEstimator = OWN,
    sensors: str | SensorChain = IDEAL,
    altitude_ft: float | None = None,
    tas_kt: float | None = None,
) -> LoopFlight:
    """Trim and fly with an autopilot that flies on the sensor readings, with noise and faults.

    At each step the sensors are read, and faults distort the readings, one after the other as in `inject`. An estimator
    may compute the attitude from the broken gyros, and faults of the attitude distort that. `accommodate` may replace
    readings. The autopilot computes commands, and the excitation is added to them. They hold until the next step. A
    flight that leaves the aircraft's envelope after a fault began ends there, and so does one whose estimator's theta
    passes 85 deg, beyond which its Euler angles aren't valid.

    Parameters
    ----------
    aircraft, excitation, duration_s, seed, altitude_ft, tas_kt
        As `fly` takes them.
    autopilot : Autopilot, optional
        Instead of the aircraft's own for these sensors.
    faults : Fault or sequence of Fault
    noise : "t2" or None
        The sensor noise, the same numbers as in `measure`. None: perfect sensors.
    noise_seed : int, optional
        Seed of the noise, if it differs from the flight's.
    accommodate : Accommodation, optional
    attitude : str or AttitudeEstimator
        The source of phi, theta and psi. "own": a vertical gyro, which doesn't use p, q and r. Or an estimator, or the
        name of one (`gtmbench.values.attitude.ESTIMATORS`), that computes them from the readings of p, q and r and from
        references: the truth with 0.5 deg of white noise, drawn as `filtered_attitude` draws it of `noise_seed`. On a
        chain its attitude is as late as the gyros that it reads; rate, delay and quantum of phi, theta and psi aren't
        added.
    sensors : "ideal", "chain" or SensorChain
        The way from motion to readings: at once; the aircraft's own chain, flown with the gains that were found
        on it; or another chain.

    Raises
    ------
    InputError
        If an argument is invalid, the aircraft has no autopilot, or an estimator's theta passes 85 deg before
        any fault began.
    TrimError
        If the aircraft can't be trimmed.
    EnvelopeError
        If the flight leaves the range of the aircraft's model before any fault began.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.fly_in_loop(duration_s=4.0, faults=gb.SignFlip(channel="q", onset_s=2.0))
    >>> [event.kind for event in flight.events][:1], len(flight.sensed) == len(flight.truth)
    (['departure'], True)
    """
    craft = load_aircraft(aircraft)
    sensor_chain = craft.chain_of(sensors)
    pilot = craft.autopilot_on(sensors) if autopilot is None else autopilot
    if pilot is None:
        raise InputError(f"'{craft.name}' has no autopilot; {GAINS_WANTED}")
    broken = tuple([faults] if isinstance(faults, Fault) else faults)
    seed = whole("seed", seed)
    noise_seed = seed if noise_seed is None else whole("noise_seed", noise_seed)
    estimator = estimator_of(attitude)
    airborne = take_off(craft, excitation, duration_s, seed, altitude_ft=altitude_ft, tas_kt=tas_kt)
    _check_faults(broken, float(airborne.time_s[-1]))
    blocks = noise_blocks(noise, noise_seed, len(airborne.time_s), _BLOCK)
    estimate = None if estimator is None else _Estimate(estimator, broken, noise_seed, len(airborne.time_s))
    events: list[LoopEvent] = []

    def tell(time_s: float, kind: str, channel: str, value: float) -> None:
        events.append(LoopEvent(time_s=time_s, kind=kind, channel=channel, value=value))

    hand_on = None if accommodate is None else accommodate.start(SAMPLE_PERIOD_S, tell)
    with simulating(airborne.fdm, craft):
        read, sensed, commands = _fly(
            airborne, pilot, [_Breaking(fault) for fault in broken], blocks, hand_on, estimate, sensor_chain
        )
    truth = airborne.record(read, commands)
    onset_s = min((fault.onset_s for fault in broken), default=inf)
    left = first_outside(truth, craft.envelope)
    if left is not None:
        if truth.time_s[left.row] < onset_s:
            check_envelope(truth, craft, "the loop", "check the autopilot's gains, or choose a gentler excitation")
        truth, sensed = _until(truth, left.row), sensed[: left.row + 1]
        events.append(_event(ENVELOPE, truth, left))
    elif estimate is not None and (steep_deg := estimate.steep_deg) is not None:
        if truth.end_s + SAMPLE_PERIOD_S < onset_s:
            raise too_steep(steep_deg, truth.end_s)
        events.append(LoopEvent(time_s=truth.end_s, kind=ENVELOPE, channel="theta", value=steep_deg))
    if departed := first_outside(truth, craft.departure):
        events.append(_event(DEPARTURE, truth, departed))
    events += [
        LoopEvent(time_s=fault.onset_s, kind=OUT_OF_LOOP, channel=fault.channel)
        for fault in broken
        if not set(fault.changes) & set(pilot.reads)
    ]
    return LoopFlight(
        truth=truth,
        sensed=Record(sensed, channels=SENSORS, sample_period_s=SAMPLE_PERIOD_S),
        events=tuple(sorted(events, key=lambda event: event.time_s)),
    )


def _check_faults(faults: Sequence[Fault], end_s: float) -> None:
    for fault in faults:
        check_onset(fault, 0.0, end_s)
        for channel in fault.reads:
            if channel not in SENSORS:
                known = f"there are {', '.join(SENSORS)}{meant(channel, SENSORS)}"
                raise InputError(f"{fault.kind}: no sensor channel {shown(channel)}; {known}")


def _until(flight: Record, row: int) -> Record:
    return Record(flight.values[: row + 1], channels=flight.channels, sample_period_s=flight.sample_period_s)


def _event(kind: str, flight: Record, outside: Outside) -> LoopEvent:
    return LoopEvent(time_s=float(flight.time_s[outside.row]), kind=kind, channel=outside.channel, value=outside.value)


class _Breaking:
    """A fault at work in a loop: the columns it reads and changes, and its stream, which rests while it is over."""

    def __init__(self, fault: Fault) -> None:
        # two samples early: the stream has to see the last healthy one
        self.begins_s = fault.onset_s - 2.5 * SAMPLE_PERIOD_S
        self.ends_s = inf if fault.duration_s is None else fault.onset_s + fault.duration_s + SAMPLE_PERIOD_S
        self._parts = [
            (SENSORS.index(part.channel), [SENSORS.index(name) for name in part.reads], part.stream(SAMPLE_PERIOD_S))
            for part in fault.parts
        ]

    def distort(self, time_s: float, sample: list[float]) -> None:
        """Break a sample in place; the parts of a fault act at the same time."""
        broken = [(column, step(time_s, [sample[i] for i in reads])) for column, reads, step in self._parts]
        for column, value in broken:
            sample[column] = value


def _break(faults: Sequence[_Breaking], time_s: float, sample: list[float]) -> None:
    """Break a sample in place, by one fault after the other."""
    for fault in faults:
        if fault.begins_s <= time_s < fault.ends_s:
            fault.distort(time_s, sample)


class _Estimate:
    """An estimator at work in a loop: the attitude that it makes of what the gyros are about to read.

    Faults act on that attitude as they act on a gyro, in their order. So they are at work twice, as in `inject`: here
    on a copy, for what the gyros read, and then on all that is read.
    """

    def __init__(self, estimator: AttitudeEstimator, faults: Sequence[Fault], seed: int, samples: int) -> None:
        self._faults = [_Breaking(fault) for fault in faults]
        self._step = filtering(estimator, SAMPLE_PERIOD_S)
        blocks = reference_noise(REFERENCE_NOISE_DEG, seed, samples, _BLOCK)
        self._noise = chain.from_iterable(block.tolist() for block in blocks)
        self._phi = 0.0
        self.steep_deg: float | None = None  # its theta, once that is too steep to go on

    def enters(self, time_s: float, sample: list[float], attitude: Sequence[float]) -> bool:
        """Put the estimated attitude into a healthy sample, given the true one, psi unwrapped; say whether it could."""
        read = sample.copy()
        _break(self._faults, time_s, read)
        phi, theta, psi = attitude
        self._phi = phi - 360.0 * round((phi - self._phi) / 360.0)
        told = [angle + error for angle, error in zip((self._phi, theta, psi), next(self._noise), strict=True)]
        try:
            estimated = self._step(time_s, [read[i] for i in _GYROS], told)
        except SteepError as error:
            self.steep_deg = error.theta_deg
            return False
        for column, angle in zip(_ATTITUDE, estimated, strict=True):
            sample[column] = angle
        return True


def _fly(
    airborne: Airborne,
    pilot: Autopilot,
    faults: Sequence[_Breaking],
    noise: Iterator[FloatArray],
    hand_on: HandOn | None,
    estimate: _Estimate | None,
    sensors: SensorChain | None,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Step; return what was read of the engine, what the sensors read, and the commands, a row a sample.

    Ends with the first sample outside of the envelope, or before one whose attitude can't be estimated.
    """
    limits = airborne.aircraft.limits
    command = pilot.engage(airborne.trim, limits, SAMPLE_PERIOD_S)
    low, high = zip(*(limits[name] for name in COMMANDS), strict=True)
    read, write, run = airborne.read, airborne.write, airborne.fdm.run
    bounds = [(bound.column, bound.scale, bound.low, bound.high) for bound in airborne.bounds]
    scales = [channel.scale for channel in FLOWN[: len(SENSORS)]]
    psi_before = read[_PSI]() * scales[_PSI]  # lies in 0..360; sensors read it unwrapped
    turned = 360.0 * round((airborne.trim.yaw_deg - psi_before) / 360.0)
    kept, sensed, commanded = array("d"), array("d"), array("d")
    keep, keep_sensed, keep_commands = kept.extend, sensed.extend, commanded.extend
    chained: Chained | None = None if sensors is None else sensors.start(SAMPLE_PERIOD_S)
    steps = len(airborne.time_s)
    for step, (time_s, added, noises) in enumerate(chain.from_iterable(_rows(airborne, noise)), start=1):
        now = list(map(call, read))
        sample = [value * scale + error for value, scale, error in zip(now, scales, noises, strict=False)]
        psi = now[_PSI] * scales[_PSI]
        if not -180.0 <= psi - psi_before <= 180.0:
            turned += 360.0 if psi < psi_before else -360.0
        psi_before = psi
        sample[_PSI] = psi + turned + noises[_PSI]
        if chained is not None:
            motion = [value * scale for value, scale in zip(now, scales, strict=False)]
            motion[_PSI] = psi + turned
            sample = chained(motion, noises)
        if estimate is not None:
            attitude = now[_PHI] * scales[_PHI], now[_THETA] * scales[_THETA], psi + turned
            if not estimate.enters(time_s, sample, attitude):
                break
        _break(faults, time_s, sample)
        keep(now)
        keep_sensed(sample)
        wanted = command(sample if hand_on is None else hand_on(time_s, sample))
        given = [
            bottom if (value := base + extra) < bottom else top if value > top else value
            for base, extra, bottom, top in zip(wanted, added, low, high, strict=True)
        ]
        keep_commands(given)
        if step == steps or not _within(now, bounds):
            break
        for column, factor, to_property in write:
            to_property(given[column] * factor)
        run()
    rows = len(commanded) // len(COMMANDS)
    arrays = [np.frombuffer(values).reshape(rows, -1) for values in (kept, sensed, commanded)]
    return arrays[0], arrays[1], arrays[2]


def _rows(
    airborne: Airborne, noise: Iterator[FloatArray]
) -> Iterator[Iterator[tuple[float, list[float], list[float]]]]:
    """Give for every sample its time, what the excitation adds and the sensors' noise, as plain floats, in blocks."""
    first = 0
    for noises in noise:
        block = slice(first, first + len(noises))
        yield zip(airborne.time_s[block].tolist(), airborne.added[block].tolist(), noises.tolist(), strict=True)
        first = block.stop


def _within(now: Sequence[float], bounds: Sequence[tuple[int, float, float, float]]) -> bool:
    return all(low <= now[column] * scale <= high for column, scale, low, high in bounds)

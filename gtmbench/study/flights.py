"""What every study begins with: one setup, trimmed and flown, its sensors, and faults put into their readings."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from typing import ClassVar

from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.breaking import is_of_surface
from gtmbench.bench.flight import fly, trim
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.loop import fly_in_loop, found_controller
from gtmbench.bench.loop_flight import DEPARTURE, OUT_OF_LOOP, LoopEvent, LoopFlight
from gtmbench.bench.other_sensors import OtherSensors
from gtmbench.bench.sensor_chain import SensorChain
from gtmbench.bench.sensors import measure
from gtmbench.errors import EnvelopeError, InputError
from gtmbench.faults.fault import Fault, inject
from gtmbench.faults.kinds.replacing import Delay
from gtmbench.jobs.progress import Tell
from gtmbench.study.fault_tables import FaultSpec
from gtmbench.study.scenario import Scenario, Setup
from gtmbench.study.trial import InjectedFaults
from gtmbench.values.attitude_estimators import OWN
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS, OF_OWN_RATE, SENSORS, unit_of
from gtmbench.values.record import Record

BROKEN = 2  # the record that is broken in the trials
SEED_STEP = 1000  # between the noise seeds of one study's records, so that studies with near seeds share none


@dataclass(frozen=True, kw_only=True, eq=False)
class Flown:
    """A setup that has been flown; `flight` is truth.

    Record 2 is broken in the trials, it and those after it are watched for false alarms; 0 and 1 are for identification
    and threshold. `commands`: whether surface commands come along with what the sensors read.
    """

    setup: Setup
    trim: Trim
    flight: Record = field(repr=False)
    commands: bool = False
    is_in_loop: ClassVar[bool] = False

    def sensed(self, number: int) -> Record:
        """Return what the sensors read, record 0, 1, 2, ...: the same flight, other noise."""
        if number not in self._last:  # the trials of a record ask for it one after the other
            self._last.clear()
            self._last[number] = self._read(self.flight, number)
        return self._last[number]

    def _read(self, truth: Record, number: int) -> Record:
        """Return what all sensors read of a flight."""
        own = self._with_setups_attitude(self._measured(number, truth), truth, number)
        return self._with_others(own, truth, number)

    def _with_others(self, readings: Record, truth: Record, number: int) -> Record:
        """Return readings with those of the setup's magnetometer and GPS."""
        return self.setup.others.beside(readings, truth, _noise_seed(self.setup, number))

    def _measured(self, number: int, truth: Record) -> Record:
        """Return what the sensors read of this flight, or of another.

        Each channel's noise has the amplitude that it has in the study: a signal-to-noise ratio would give another on
        another flight.
        """
        setup, seed, chain = self.setup, _noise_seed(self.setup, number), _chain(self.setup)
        is_other = truth is not self.flight
        of = truth if is_other and chain is not None else self.flight  # a chain's noise is no difference of two records
        readings = measure(of, snr=setup.snr, noise=setup.noise, seed=seed, commands=self.commands, sensors=chain)
        if not is_other or chain is not None:
            return readings
        noise = readings.values - self.flight.matrix(readings.channels)
        values = truth.matrix(readings.channels) + noise[: len(truth)]
        return Record(values, channels=readings.channels, sample_period_s=truth.sample_period_s)

    def _with_setups_attitude(self, readings: Record, truth: Record, number: int) -> Record:
        """Return readings with the setup's attitude, made of these gyros where an estimator makes it."""
        estimated = estimated_attitude(readings, truth, self.setup.attitude, _noise_seed(self.setup, number))
        return with_late_attitude(estimated, self.setup.attitude_late_s)

    @cached_property
    def _last(self) -> dict[int, Record]:
        return {}

    def elsewhere(self, excitation: str, duration_s: float, seed: int, number: int) -> Record:
        """Return what the same sensors read on another flight; `number` is of the noise, as `sensed` has it."""
        truth = _flown_open(replace(self.setup, excitation=excitation, duration_s=duration_s, seed=seed))
        return self._read(truth, number)

    def broken(self, scenario: str, spec: FaultSpec, number: int = BROKEN) -> tuple[InjectedFaults, Record]:
        """Break a record by a trial's faults, their severities resolved against the flight.

        Return it, and what the sensors would have read without their faults; with a fault of a surface both are of a
        flight of their own.
        """
        faults = self.faults(spec)
        truth = self._flown_with(faults)
        broken, healthy = self._injected(faults, number, truth), self._healthy(number, truth)
        return _injection(scenario, faults, self._true(truth), broken), healthy

    def bends(self, faults: Sequence[Fault]) -> bool:
        """Say whether faults bend channels beside those that they break: by a flight, or by way of an estimator."""
        of_gyros = any(name in GYROS for fault in faults for name in fault.changes)
        return self.is_in_loop or any(map(is_of_surface, faults)) or (self.setup.attitude != OWN and of_gyros)

    def injected(self, faults: Sequence[Fault], number: int) -> Record:
        """Return what the sensors of a record read with faults; an estimator's attitude is that of the broken gyros.

        Faults of the attitude act on that. Faults of surfaces are flown.
        """
        return self._injected(faults, number, self._flown_with(faults))

    def _flown_with(self, faults: Sequence[Fault]) -> Record:
        """Return the truth with faults of surfaces: this flight's, where there are none."""
        of_surfaces = tuple(fault for fault in faults if is_of_surface(fault))
        if not of_surfaces:
            return self.flight
        return _flown_open(self.setup, of_surfaces)

    def _healthy(self, number: int, truth: Record) -> Record:
        return self.sensed(number) if truth is self.flight else self._read(truth, number)

    def _injected(self, faults: Sequence[Fault], number: int, truth: Record) -> Record:
        of_sensors = [fault for fault in faults if not is_of_surface(fault)]
        healthy = self._healthy(number, truth)
        if self.bends(of_sensors):
            own = [fault for fault in of_sensors if not _is_of_others(fault)]
            bent = self._with_setups_attitude(inject(self._measured(number, truth), own), truth, number)
            healthy = _with_attitude(healthy, bent)
        return inject(healthy, of_sensors)

    def faults(self, spec: FaultSpec) -> tuple[Fault, ...]:
        """Return a trial's faults, their severities resolved against the flight."""
        return spec.faults(self.truth.between(*self.setup.severity_reference_s))

    @cached_property
    def truth(self) -> Record:
        """The flight, with what the setup's magnetometer and GPS would read of it without noise."""
        return self.setup.others.true(self.flight)

    def _true(self, flight: Record) -> Record:
        return self.truth if flight is self.flight else self.setup.others.true(flight)


@dataclass(frozen=True, kw_only=True, eq=False)
class FlownInLoop(Flown):
    """A setup that has been flown by an autopilot: records have flights of their own, for it flies on their noise.

    `flight` is the truth of record 2.
    """

    is_in_loop: ClassVar[bool] = True

    healthy: LoopFlight = field(repr=False)

    def sensed(self, number: int) -> Record:
        """Return what the sensors read, record 0, 1, 2, ...: the same air and excitation, other noise."""
        return self._read_in_loop(self.healthy if number == BROKEN else _flown_healthy(self.setup, number), number)

    def _read_in_loop(self, flight: LoopFlight, number: int) -> Record:
        return self._with_others(flight.readings(commands=self.commands), flight.truth, number)

    def elsewhere(self, excitation: str, duration_s: float, seed: int, number: int) -> Record:
        """Return what the same sensors read on another flight of the same autopilot."""
        other = replace(self.setup, excitation=excitation, duration_s=duration_s)
        return self._read_in_loop(_flown_healthy(other, number, seed), number)

    def broken(self, scenario: str, spec: FaultSpec, number: int = BROKEN) -> tuple[InjectedFaults, Record]:
        """Fly a record anew with a trial's faults in the loop; it ends where the aircraft leaves its envelope.

        Nobody in the loop reads the magnetometer and the GPS: their faults are put into their readings.
        """
        faults = self.faults(spec)
        flight = _flown_in_loop(self.setup, number, [fault for fault in faults if not _is_of_others(fault)])
        healthy = self._read_in_loop(flight, number)
        unread = [fault for fault in faults if _is_of_others(fault) and fault.onset_s <= healthy.end_s]
        events = [LoopEvent(time_s=fault.onset_s, kind=OUT_OF_LOOP, channel=fault.channel) for fault in unread]
        told = sorted([*flight.events, *events], key=lambda event: event.time_s)
        injection = _injection(scenario, faults, self._true(flight.truth), inject(healthy, unread), told)
        noise_seed = _noise_seed(self.setup, number)
        unbroken = measure(flight.truth, noise=self.setup.noise, seed=noise_seed, sensors=_chain(self.setup))
        if self.setup.attitude != OWN:
            unbroken = _with_attitude(unbroken, self._with_setups_attitude(flight.sensed, flight.truth, number))
        return injection, self._with_others(unbroken, flight.truth, number)


def _is_of_others(fault: Fault) -> bool:
    """Tell whether a fault breaks the magnetometer or the GPS."""
    return fault.channel in OF_OWN_RATE


def _with_attitude(record: Record, of: Record) -> Record:
    """Return a record with another's attitude."""
    for name in ATTITUDE:
        record = record.replace(name, of[name])
    return record


def with_late_attitude(record: Record, late_s: float) -> Record:
    """Return a record whose attitude comes later than its other channels, as an estimator's may.

    >>> record = Record([[0.0, 0.0], [1.0, 1.0], [2.0, 2.0]], channels=["p", "phi"], sample_period_s=0.01)
    >>> with_late_attitude(record, 0.01).values.tolist()
    [[0.0, 0.0], [1.0, 0.0], [2.0, 1.0]]
    """
    late = [Delay(channel=name, onset_s=record.start_s, delay_s=late_s) for name in ATTITUDE if name in record]
    return inject(record, late) if late_s and late else record


def _chain(setup: Setup) -> SensorChain | None:
    return load_aircraft(setup.aircraft).chain_of(setup.sensors)


def _noise_seed(setup: Setup, number: int) -> int:
    return setup.seed + SEED_STEP * number


def _flown_open(setup: Setup, faults: Sequence[Fault] = ()) -> Record:
    return fly(
        setup.aircraft,
        setup.excitation,
        setup.duration_s,
        setup.seed,
        faults=faults,
        altitude_ft=setup.altitude_ft,
        tas_kt=setup.tas_kt,
    )


def _flown_in_loop(setup: Setup, number: int, faults: Sequence[Fault] = (), seed: int | None = None) -> LoopFlight:
    return fly_in_loop(
        setup.aircraft,
        setup.excitation,
        setup.duration_s,
        setup.seed if seed is None else seed,
        autopilot=setup.autopilot,
        controller=None if setup.controller is None else found_controller(setup.controller),
        attitude=setup.attitude,
        sensors=setup.sensors,
        faults=faults,
        noise=setup.noise,
        noise_seed=_noise_seed(setup, number),
        altitude_ft=setup.altitude_ft,
        tas_kt=setup.tas_kt,
    )


def _flown_healthy(setup: Setup, number: int, seed: int | None = None) -> LoopFlight:
    """Fly without a fault, and refuse an autopilot that doesn't hold the aircraft even so."""
    flight = _flown_in_loop(setup, number, seed=seed)
    checked = "the autopilot's gains" if setup.controller is None else "the controller"
    for event in flight.events:
        if event.kind == DEPARTURE:
            raise EnvelopeError(
                f"the loop departs without a fault: {event.channel} is {event.value:.4g} {unit_of(event.channel)} at "
                f"t = {event.time_s:g} s; check {checked}, or choose a gentler excitation"
            )
    return flight


def _injection(
    scenario: str, faults: Sequence[Fault], flight: Record, record: Record, events: Sequence[LoopEvent] = ()
) -> InjectedFaults:
    first, *also = faults
    return InjectedFaults(
        scenario=scenario,
        fault=first.kind,
        channel=first.channel,
        severity=first.severities,
        unit=unit_of(first.channel),
        injected=first,
        also=tuple(also),
        flight=flight,
        record=record,
        events=tuple(events),
    )


def fly_setup(setup: Setup, commands: bool, tell: Tell) -> Flown:
    """Trim and fly a setup."""
    tell("trim")
    trimmed = trim(setup.aircraft, **setup.trim_point)
    tell("fly")
    if not setup.is_in_loop:
        flight = _flown_open(setup)
        return Flown(setup=setup, trim=trimmed, flight=flight, commands=commands)
    healthy = _flown_healthy(setup, BROKEN)
    return FlownInLoop(setup=setup, trim=trimmed, flight=healthy.truth, healthy=healthy, commands=commands)


def check_flown(detector: str, channels: Iterable[str], others: OtherSensors) -> None:
    """Refuse, before anything is flown, a detector that needs what no flight has."""
    there = (*SENSORS, *COMMANDS, *others.channels)
    missing = [channel for channel in channels if channel not in there]
    if missing:
        raise InputError(f"'{detector}' needs {', '.join(missing)}, which no flight has; there are {', '.join(there)}")


def common_setup(scenarios: Sequence[Scenario], seed: int | None) -> Setup:
    """Return the setup that scenarios share, with another seed if one is given."""
    if not scenarios:
        raise InputError("no scenario given")
    first = scenarios[0]
    names = [scenario.name for scenario in scenarios]
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"two scenarios have the name '{twice[0]}'; rename one file, or run them one at a time")
    for other in scenarios[1:]:
        if other.setup != first.setup:
            settings, others = asdict(first.setup), asdict(other.setup)
            key = next(key for key in settings if settings[key] != others[key])
            raise InputError(
                f"scenarios '{first.name}' and '{other.name}' differ in {key} ({settings[key]} and {others[key]}); a "
                "study has one flight and one detector, so run them one at a time"
            )
    return first.setup if seed is None else replace(first.setup, seed=seed)

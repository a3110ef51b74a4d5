"""A simulation: one aircraft, stepped sample by sample by whoever commands it, with sensors, surfaces and faults."""

from __future__ import annotations

from array import array
from collections.abc import Callable, Iterator, Sequence
from copy import copy
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S, Aircraft
from gtmbench.bench.autopilot import Trim
from gtmbench.bench.breaking import Surfaces, check_faults
from gtmbench.bench.engine import failure
from gtmbench.bench.excitation import Excitation
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.loop_flight import DEPARTURE, ENVELOPE, LoopEvent, LoopFlight, event_of
from gtmbench.bench.sensor_chain import IDEAL, SensorChain
from gtmbench.bench.sensor_readings import Readings, Sensing
from gtmbench.bench.stepping import FLOWN, Airborne, Stepping, beyond, first_outside, take_off
from gtmbench.checks import number, shown, whole
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.values.attitude_estimators import OWN, AttitudeEstimator, estimator_of
from gtmbench.values.channels import CHANNELS, COMMANDS, SENSORS
from gtmbench.values.record import FloatArray, Record

DURATION, ATTITUDE = "duration", "attitude"  # why a simulation is over, beside `ENVELOPE`
Rule = Callable[["Simulation"], object]
_NAMES = [channel.name for channel in FLOWN]
_SUMMED = [_NAMES.index("north"), _NAMES.index("east")]  # read as speeds
_BLOCK = 4096  # samples
_NO_ATTITUDE = dict.fromkeys(("phi", "theta", "psi"), float("nan"))
_UNITS = ", ".join(f"{name} ({CHANNELS[name].unit})" for name in COMMANDS)


@dataclass(frozen=True, kw_only=True)
class _Switch:
    """A fault that was switched on, or off, after a sample of the flight."""

    row: int
    index: int
    fault: Fault
    is_on: bool
    by_rule: bool = False


@dataclass(frozen=True, kw_only=True)
class _Armed:
    """A fault that waits for a rule, since a sample of the flight."""

    row: int
    index: int
    fault: Fault
    rule: Rule


class Simulation:
    """An aircraft that flies one sample of 0.01 s a call, on commands of your own.

    Sample k is read at k Ts. The commands that are given then hold until (k + 1) Ts, where sample k + 1 is read. The
    same arguments, seed, commands and switches give the same bits. `fly_in_loop` is written with it.

    Parameters
    ----------
    aircraft : str, Path or Aircraft
        A name that ``gtmbench list --all`` shows, or the path of an aircraft's folder.
    excitation : str or Excitation
        What is added to the commands, and whether the air is turbulent. ``gb.Excitation()``: nothing, in calm air.
    duration_s : float
        How long a flight can last, in seconds.
    faults : Fault or sequence of Fault
        The faults of every flight whose onset is known before. `switch_on` adds others by hand or by a rule.
    noise : "t2" or None
        The sensor noise; None: perfect sensors.
    noise_seed : int, optional
        Seed of the noise, if it differs from the flight's.
    sensors : "ideal", "chain" or SensorChain
        As `fly_in_loop` takes them. Ideal by default, as for every controller of your own: noisy, but neither late nor
        rounded. The GTM's own autopilot flies on "chain"; compare with it on the same sensors.
    attitude, altitude_ft, tas_kt
        As `fly_in_loop` takes them.

    Raises
    ------
    InputError
        If an argument is invalid.

    Examples
    --------
    >>> import gtmbench as gb
    >>> simulation = gb.Simulation("gtm", "turbulence", duration_s=10.0)
    >>> readings = simulation.reset(seed=1)
    >>> level = list(simulation.trim.commands.values())  # elevator, aileron, rudder in deg, throttle in percent
    >>> while not simulation.is_over:
    ...     if simulation.time_s == 5.0:
    ...         bias = simulation.switch_on(gb.Bias(channel="q", onset_s=0.0, size=2.0))
    ...     readings = simulation.step([level[0] + 0.5 * readings.q, *level[1:]])
    >>> simulation.end, simulation.time_s, bias.onset_s, len(simulation.flight().sensed)
    ('duration', 10.0, 5.01, 1001)
    """

    def __init__(
        self,
        aircraft: str | Path | Aircraft = "gtm",
        excitation: str | Excitation = "turbulence",
        duration_s: float = 500.0,
        *,
        faults: Fault | Sequence[Fault] = (),
        noise: str | None = "t2",
        noise_seed: int | None = None,
        attitude: str | AttitudeEstimator = OWN,
        sensors: str | SensorChain = IDEAL,
        altitude_ft: float | None = None,
        tas_kt: float | None = None,
    ) -> None:
        self.aircraft: Aircraft = load_aircraft(aircraft)
        self._excitation = excitation
        self._duration_s = duration_s
        self._stated = tuple([faults] if isinstance(faults, Fault) else faults)
        self._noise = noise
        self._noise_seed = None if noise_seed is None else whole("noise_seed", noise_seed)
        self._estimator = estimator_of(attitude)
        self._chain = self.aircraft.chain_of(sensors)
        self._altitude_ft, self._tas_kt = altitude_ft, tas_kt
        self._state: _Flying | None = None
        self._seed = 1
        self._switches: list[_Switch] = []  # all, in the order of their time: a fork does them again
        self._armed: list[_Armed] = []  # all that ever waited
        self._waiting: list[_Armed] = []

    def reset(self, seed: int = 1, *, faults: Fault | Sequence[Fault] | None = None) -> Readings:
        """Begin a new flight in trim, by a fresh engine, and return its first sample.

        What was switched on in the flight before is forgotten.

        Parameters
        ----------
        seed : int
            Of the excitation, the turbulence and the noise.
        faults : Fault or sequence of Fault, optional
            The faults of this flight and the next ones, instead of those stated before.

        Raises
        ------
        InputError
            If an argument is invalid.
        TrimError
            If the aircraft can't be trimmed.
        """
        self._seed = whole("seed", seed)
        if faults is not None:
            self._stated = tuple([faults] if isinstance(faults, Fault) else faults)
        self._state = self._taken_off()
        self._switches, self._armed, self._waiting = [], [], []
        return self.readings

    def _taken_off(self) -> _Flying:
        airborne = take_off(
            self.aircraft,
            self._excitation,
            self._duration_s,
            self._seed,
            altitude_ft=self._altitude_ft,
            tas_kt=self._tas_kt,
        )
        check_faults(self._stated, float(airborne.time_s[-1]))
        noise_seed = self._seed if self._noise_seed is None else self._noise_seed
        sensing = Sensing(
            self._noise,
            noise_seed,
            len(airborne.time_s),
            self._stated,
            self._estimator,
            self._chain,
            airborne.trim.yaw_deg,
        )
        return _Flying(airborne, sensing, Surfaces(self._stated, self.aircraft.limits))

    @property
    def _flying(self) -> _Flying:
        if self._state is None:
            raise InputError("the simulation hasn't begun; call reset(seed) first")
        return self._state

    def step(self, commands: Sequence[float]) -> Readings:
        """Fly on for one sample and return what the sensors read then.

        Parameters
        ----------
        commands : sequence of four float
            Elevator, aileron and rudder in deg, throttle in percent, in the order of `COMMANDS`. The excitation is
            added, and the aircraft's limits hold. They are commands: the aircraft's servos follow them.

        Returns
        -------
        Readings
            After the last sample, see `is_over`. Where an estimator's theta has passed 85 deg its attitude is NaN, and
            the sample isn't kept.

        Raises
        ------
        InputError
            If the commands aren't four finite numbers, or the flight is over.
        """
        flying = self._flying
        if flying.end is not None:
            raise InputError(f"the flight is over at {self.time_s:g} s ({flying.end}); call reset(seed)")
        flying.fly(flying.limited(checked_commands(commands)))
        if self._waiting:
            self._ask_rules()
        return flying.readings

    def fly_by(self, command: Callable[[Sequence[float]], Sequence[float]]) -> Sequence[float]:
        """Fly to the end on what a function of the readings commands, as by calls of `step`, but quicker.

        Parameters
        ----------
        command : function
            Of a plain list of the readings in the order of `SENSORS`, which isn't to be changed. It returns commands as
            `step` takes them, and is called after the last sample, too, except where an attitude can't be estimated any
            more.

        Returns
        -------
        sequence of four float
            What it commanded last: what `flight` takes.

        Raises
        ------
        InputError
            If the commands aren't four finite numbers.

        Examples
        --------
        >>> import gtmbench as gb
        >>> simulation = gb.Simulation("gtm", "turbulence", duration_s=5.0)
        >>> _ = simulation.reset(seed=1)
        >>> level = list(simulation.trim.commands.values())
        >>> last = simulation.fly_by(lambda readings: [level[0] + 0.5 * readings[1], *level[1:]])
        >>> simulation.end, len(simulation.flight(last).truth)
        ('duration', 501)
        """
        flying = self._flying
        fly, limited = flying.fly, flying.limited
        commands = command(flying.sample)
        while flying.end is None:
            fly(limited(checked_commands(commands)))
            if self._waiting:
                self._ask_rules()
            if flying.end != ATTITUDE:  # there is something to command by
                commands = command(flying.sample)
        return commands

    @property
    def readings(self) -> Readings:
        """What the sensors read last."""
        return self._flying.readings

    @property
    def commanded(self) -> list[float]:
        """What was commanded at the sample before the last one, excitation and limits included; it flew to this one."""
        return self._flying.commanded_last

    @property
    def time_s(self) -> float:
        """The time of the last sample, in seconds since the flight began."""
        return self._flying.time_s

    @property
    def is_over(self) -> bool:
        """Whether the flight has ended."""
        return self._flying.end is not None

    @property
    def end(self) -> str | None:
        """Why the flight has ended; None: it goes on.

        "duration": it has lasted its time. "envelope": the aircraft left the range in which its model is valid.
        "attitude": the estimator's theta passed 85 deg.
        """
        return self._flying.end

    @property
    def trim(self) -> Trim:
        """The steady flight from which this one began."""
        return self._flying.airborne.trim

    @property
    def truth(self) -> dict[str, float]:
        """The true state now, by channel in the channel's unit; sensors with neither noise nor faults would read it.

        Examples
        --------
        >>> import gtmbench as gb
        >>> simulation = gb.Simulation("gtm", gb.Excitation(), noise=None)
        >>> readings = simulation.reset()
        >>> simulation.truth["altitude"] == readings.altitude, simulation.truth["north"]
        (True, 0.0)
        """
        return self._flying.truth

    @property
    def faults(self) -> tuple[Fault, ...]:
        """The faults of this flight so far, with their onsets: those by time, then those switched on."""
        return (*self._stated, *(each.fault for each in self._switches if each.is_on))

    def switch_on(self, fault: Fault, when: Rule | None = None) -> Fault:
        """Break a sensor or a surface from the next sample on, or from the one after a rule first holds.

        The same bits as a fault whose onset was known before. Several may act, on any channels: each acts on the result
        of those before it.

        Parameters
        ----------
        fault : Fault
            Its `onset_s` is replaced by the time of the next sample.
        when : function of the simulation, optional
            It is asked after every sample, this one included, until it returns true. It must not change the simulation.

        Returns
        -------
        Fault
            With the onset that it got; under a rule that doesn't hold yet, as it was given.

        Raises
        ------
        InputError
            If it is no fault of a sensor or a surface, or the flight is over.

        Examples
        --------
        >>> import gtmbench as gb
        >>> simulation = gb.Simulation("gtm", "turbulence", duration_s=20.0)
        >>> _ = simulation.reset(seed=3)
        >>> jam = gb.Jam(channel="p", onset_s=0.0)
        >>> _ = simulation.switch_on(jam, when=lambda now: abs(now.truth["phi"]) > 2.0)
        >>> while not simulation.is_over:
        ...     _ = simulation.step(simulation.trim.commands.values())
        >>> [(fault.kind, fault.onset_s > 0.0) for fault in simulation.faults]
        [('jam', True)]
        """
        flying = self._flying
        if not isinstance(fault, Fault):
            raise InputError(f"{shown(fault)} is no fault; give one such as gb.Jam(channel='p', onset_s=0)")
        if flying.end is not None:
            raise InputError(f"the flight is over at {self.time_s:g} s ({flying.end}), so nothing can break any more")
        coming = replace(fault, onset_s=flying.next_time_s)
        check_faults([coming], coming.onset_s)
        index = len(self._stated) + len(self._armed) + len(self._switches)
        if when is None:
            self._switch(_Switch(row=flying.row, index=index, fault=coming, is_on=True))
            return coming
        if not callable(when):
            raise InputError(f"when is {shown(when)}; it must be a function of the simulation that says true or false")
        armed = _Armed(row=flying.row, index=index, fault=fault, rule=when)
        self._armed.append(armed)
        self._waiting.append(armed)
        self._ask_rules()
        return fault if armed in self._waiting else coming

    def switch_off(self, fault: Fault) -> None:
        """End a fault: from the next sample on its sensor or surface is healthy.

        Parameters
        ----------
        fault : Fault
            One of `faults`.

        Raises
        ------
        InputError
            If no such fault is on.
        """
        on = dict(enumerate(self._stated))
        for each in self._switches:
            if each.is_on:
                on[each.index] = each.fault
            else:
                del on[each.index]
        index = next((index for index, there in on.items() if there == fault), None)
        if index is None:
            said = ", ".join(f"{each.kind} of {each.channel}" for each in on.values()) or "none"
            raise InputError(f"{shown(fault)} isn't among the faults that are on: {said}")
        self._switch(_Switch(row=self._flying.row, index=index, fault=fault, is_on=False))

    def _switch(self, switch: _Switch) -> None:
        self._switches.append(switch)
        self._flying.switch(switch)

    def _ask_rules(self) -> None:
        """Switch on what has waited for this sample."""
        flying = self._flying
        if flying.end is None:
            for armed in [armed for armed in self._waiting if armed.rule(self)]:
                coming = replace(armed.fault, onset_s=flying.next_time_s)
                self._switch(_Switch(row=flying.row, index=armed.index, fault=coming, is_on=True, by_rule=True))
                self._waiting.remove(armed)

    def fork(self, at_s: float | None = None) -> Simulation:
        """Return another simulation that has flown the same flight up to an instant, and can fly on otherwise.

        JSBSim's state can't be copied, so a fresh engine flies all samples again: on the GTM about 40 ms, and 13 ms for
        every 10 s. What was switched on before that instant is on; what was switched after it isn't.

        Parameters
        ----------
        at_s : float, optional
            The time of a sample that has been flown, in seconds; by default the last one's.

        Raises
        ------
        InputError
            If that time hasn't been flown.

        Examples
        --------
        >>> import gtmbench as gb
        >>> simulation = gb.Simulation(duration_s=10.0)
        >>> _ = simulation.reset()
        >>> while not simulation.is_over:
        ...     _ = simulation.step(simulation.trim.commands.values())
        >>> other = simulation.fork(4.0)
        >>> _ = other.switch_on(gb.Jam(channel="p", onset_s=0.0))
        >>> other.time_s, other.readings == gb.Readings(*simulation.flight().sensed.values[400].tolist())
        (4.0, True)
        """
        flown = self._flying
        at_s = flown.time_s if at_s is None else number("at_s", at_s, 0.0)
        row = round(at_s / SAMPLE_PERIOD_S)
        if row > flown.row:
            raise InputError(f"at_s is {at_s:g}, but this flight has come to {flown.time_s:g} s; give a time before")
        other = copy(self)
        other._state = again = self._taken_off()
        # of this very sample, only a rule belongs to the flight so far: a hand is free to do otherwise
        done = [each for each in self._switches if each.row < row or (each.row == row and each.by_rule)]
        other._switches, begun = done, {each.index for each in done}
        other._armed = [each for each in self._armed if each.row < row]
        other._waiting = [each for each in other._armed if each.index not in begun]
        for sample, given in enumerate(flown.commanded(row)):
            again.switch_all(done, sample)
            again.fly(given)
        again.switch_all(done, row)
        return other

    def flight(self, last_commands: Sequence[float] | None = None) -> LoopFlight:
        """Return what has been flown so far: the truth, what the sensors read, and departures.

        Parameters
        ----------
        last_commands : sequence of four float, optional
            What is commanded at the last sample, which nothing has flown yet; by default what was before.

        Examples
        --------
        >>> import gtmbench as gb
        >>> simulation = gb.Simulation(duration_s=10.0)
        >>> _ = simulation.reset()
        >>> _ = simulation.step(simulation.trim.commands.values())
        >>> flight = simulation.flight()
        >>> flight.truth.values.shape, flight.sensed.channels == flight.readings().channels
        ((2, 19), True)
        """
        flying = self._flying
        read, sensed, commands = flying.rows(last_commands)
        truth = flying.airborne.record(read, commands, flying.surfaces.actual(commands))
        events = []
        if left := first_outside(truth, self.aircraft.envelope):
            truth, sensed = truth.part(range(left.row + 1)), sensed[: left.row + 1]
            events.append(event_of(ENVELOPE, truth, left))
        elif (steep_deg := flying.sensing.steep_deg) is not None:
            events.append(LoopEvent(time_s=truth.end_s, kind=ENVELOPE, channel="theta", value=steep_deg))
        if departed := first_outside(truth, self.aircraft.departure):
            events.append(event_of(DEPARTURE, truth, departed))
        return LoopFlight(
            truth=truth,
            sensed=Record(sensed, channels=SENSORS, sample_period_s=SAMPLE_PERIOD_S),
            events=tuple(sorted(events, key=lambda event: event.time_s)),
        )


class _Flying:
    """One flight of a simulation: its engine, its sensors, and what both gave so far."""

    def __init__(self, airborne: Airborne, sensing: Sensing, surfaces: Surfaces) -> None:
        self.airborne, self.sensing, self.surfaces = airborne, sensing, surfaces
        self._low, self._high = zip(*(airborne.aircraft.limits[name] for name in COMMANDS), strict=True)
        self._write = [(column, factor) for column, factor, _ in airborne.write]
        self._stepping = Stepping(airborne)
        self._sensed, self._commanded = array("d"), array("d")
        self._coming, self._read, self._keep = _plan(airborne).__next__, sensing.read, self._sensed.extend
        self._north_east, self._summed_to = [0.0, 0.0], 0
        self._last = len(airborne.time_s) - 1
        self.row = 0
        self.sample: list[float]  # what the sensors read last, in the order of `SENSORS`
        self.end: str | None = None
        self._look()

    @property
    def next_time_s(self) -> float:
        return float(self.airborne.time_s.item(self.row + 1))

    def limited(self, commands: Sequence[float]) -> list[float]:
        """Return what is commanded: with the excitation of this sample, within the limits."""
        return [
            low if (value := base + extra) < low else high if value > high else value
            for base, extra, low, high in zip(commands, self._added, self._low, self._high, strict=True)
        ]

    def fly(self, commanded: Sequence[float]) -> None:
        """Fly on for one sample."""
        self._commanded.extend(commanded)
        driven = self.surfaces.driven(self.time_s, commanded, self._stepping.now)
        try:
            self._stepping.step([driven[column] * factor for column, factor in self._write])
        except RuntimeError as error:
            raise failure(self.airborne.fdm, self.airborne.aircraft, error) from error
        self.row += 1
        self._look()

    def _look(self) -> None:
        """Read the sensors, and see whether the flight is over."""
        now = self._stepping.now
        self.time_s, self._added = self._coming()
        sample = self._read(self.time_s, now)
        if sample is None:
            self.end = ATTITUDE
            self.sample = list(self.readings._replace(**_NO_ATTITUDE))
            return
        self._keep(sample)
        self.sample = sample
        if beyond(now, self.airborne.bounds):
            self.end = ENVELOPE
        elif self.row == self._last:
            self.end = DURATION

    @property
    def readings(self) -> Readings:
        return Readings._make(self.sample)

    def switch(self, switch: _Switch) -> None:
        """Switch a fault on, or off, from the next sample on."""
        for breakable in (self.sensing, self.surfaces):
            if switch.is_on:
                breakable.begin(switch.index, switch.fault)
            else:
                breakable.end(switch.index)

    def switch_all(self, switches: Sequence[_Switch], row: int) -> None:
        """Switch what was switched after a sample."""
        for switch in switches:
            if switch.row == row:
                self.switch(switch)

    def commanded(self, rows: int) -> list[list[float]]:
        """Return what was commanded at the first samples."""
        values: list[list[float]] = np.array(self._commanded).reshape(-1, len(COMMANDS))[:rows].tolist()
        return values

    @property
    def commanded_last(self) -> list[float]:
        """What was commanded last, in the order of `COMMANDS`."""
        return self._commanded[-len(COMMANDS) :].tolist()

    def rows(self, last_commands: Sequence[float] | None) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return what was read of the engine, what the sensors read, and the commands, a row a sample."""
        sensed = np.array(self._sensed).reshape(-1, len(SENSORS))
        commands = self.commanded(len(sensed))
        if len(commands) < len(sensed):
            if last_commands is not None:
                commands.append(self.limited(last_commands))
            elif commands:
                commands.append(commands[-1])
            else:
                commands.append(self.limited(list(self.airborne.trim.commands.values())))
        return self._stepping.read[: len(sensed)], sensed, np.array(commands)

    @property
    def truth(self) -> dict[str, float]:
        """The true state at the last sample."""
        read = self._stepping.read_from(self._summed_to)
        for before, after in pairwise(read[:, _SUMMED].tolist()):
            for i in range(2):
                self._north_east[i] += (after[i] + before[i]) * (SAMPLE_PERIOD_S / 2.0)
        self._summed_to += len(read) - 1
        values = [value * channel.scale for value, channel in zip(self._stepping.now, FLOWN, strict=True)]
        state = dict(zip(_NAMES, values, strict=True))
        return state | {"psi": self.sensing.psi_deg, "north": self._north_east[0], "east": self._north_east[1]}


def _plan(airborne: Airborne) -> Iterator[tuple[float, list[float]]]:
    """Give for every sample its time and what the excitation adds, as plain floats."""
    for first in range(0, len(airborne.time_s), _BLOCK):
        block = slice(first, first + _BLOCK)
        yield from zip(airborne.time_s[block].tolist(), airborne.added[block].tolist(), strict=True)


def checked_commands(commands: Sequence[float]) -> tuple[float, ...]:
    """Return commands as four plain numbers.

    >>> checked_commands(np.array([1, 2, 3, 50]))
    (1.0, 2.0, 3.0, 50.0)
    """
    try:
        elevator, aileron, rudder, throttle = commands
        elevator, aileron, rudder, throttle = float(elevator), float(aileron), float(rudder), float(throttle)
    except (TypeError, ValueError):
        raise _not_commands(commands) from None
    total = elevator + aileron + rudder + throttle
    if total - total != 0.0:  # NaN or infinite
        raise _not_commands(commands)
    return elevator, aileron, rudder, throttle


def _not_commands(commands: object) -> InputError:
    return InputError(f"commands are {shown(commands)}; give four finite numbers: {_UNITS}")

"""The loop: sensors are read, broken, and flown on, step by step, by an autopilot or a controller of one's own.

What that does to the aircraft is an event.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from math import inf
from pathlib import Path
from typing import Any, Protocol

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S, Aircraft
from gtmbench.bench.autopilot import Autopilot, Trim
from gtmbench.bench.breaking import is_of_surface
from gtmbench.bench.excitation import Excitation
from gtmbench.bench.flight import check_envelope
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.loop_flight import ENVELOPE, OUT_OF_LOOP, SURFACE_FAILED, ControllerError, LoopEvent, LoopFlight
from gtmbench.bench.sensor_chain import IDEAL, SensorChain
from gtmbench.bench.sensor_readings import Readings
from gtmbench.bench.simulation import Simulation, checked_commands
from gtmbench.checks import one_line, shown
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.imports import brought_object
from gtmbench.values.attitude_estimators import OWN, AttitudeEstimator, too_steep
from gtmbench.values.channels import SENSORS

Commanding = Callable[[Readings, float], Sequence[float]]
_CONTROLLER_WANTED = (
    "give a function of (readings, time_s), or an object or a class with a method command(readings, time_s)"
)


class Controller(Protocol):
    """The protocol of a controller of your own.

    It may have a method ``start(trim)``, which is called before every flight with the steady flight (`Trim`) it begins
    in. What a controller keeps from sample to sample it should forget there; or give the class itself, without
    arguments: it is then made anew for every flight. It may say which channels it reads, ``reads = ("p", "q")``:
    then a fault of another one is an event, "out of loop". It may have a method ``told(event)``, which is called when a
    `SurfaceWatch` names a surface that failed (`LoopEvent`).

    Examples
    --------
    >>> import gtmbench as gb
    >>> class Damper:
    ...     def start(self, trim):
    ...         self.level = trim.commands
    ...
    ...     def command(self, readings, time_s):
    ...         level = self.level
    ...         return level["elevator"] + 0.3 * readings.q, level["aileron"], level["rudder"], level["throttle"]
    >>> flight = gb.fly_in_loop(duration_s=5.0, controller=Damper())
    >>> flight.departed_s is None
    True
    """

    def command(self, readings: Readings, time_s: float) -> Sequence[float]:
        """Return elevator, aileron and rudder in deg and throttle in percent, for one sample.

        Parameters
        ----------
        readings : Readings
            What the sensors read, faults included; NaN where a reading is missing. With an `Accommodation`, what that
            hands on.
        time_s : float
            In seconds since the flight began. It is called once a sample, every 0.01 s.
        """


def check_controller(controller: object) -> None:
    """Refuse what is no controller."""
    if not callable(controller) and not callable(getattr(controller, "command", None)):
        raise InputError(f"controller is {shown(controller)}; {_CONTROLLER_WANTED}")
    if isinstance(controller, type) and not callable(getattr(controller, "command", None)):
        raise InputError(
            f"controller is the class {controller.__name__}, which has no method command; {_CONTROLLER_WANTED}"
        )


def name_of(controller: object) -> str:
    """Return what a controller is called in messages: its function's or class's name."""
    return str(getattr(controller, "__name__", None) or type(controller).__name__)


def take_over(controller: Any, trim: Trim) -> Commanding:
    """Return what commands one flight: a class is made anew, and what has `start` is told the trim."""
    check_controller(controller)
    try:
        made = controller() if isinstance(controller, type) else controller
        if callable(start := getattr(made, "start", None)):
            start(trim)
    except Exception as error:  # somebody's own controller may do anything
        raise failed(controller, "before the flight", error) from error
    command: Commanding = made.command if callable(getattr(made, "command", None)) else made
    return command


def listener(command: Commanding) -> Callable[[LoopEvent], object] | None:
    """Return the method of a controller that is told of events; None of one that has none."""
    told = getattr(getattr(command, "__self__", None), "told", None)
    return told if callable(told) else None


def failed(controller: object, when: str, error: Exception) -> ControllerError:
    """Return the error of a controller that has raised, or whose commands were refused, in a line."""
    said = str(error) if isinstance(error, InputError) else f"{type(error).__name__}: {error}"
    return ControllerError(one_line(f"controller '{name_of(controller)}' {when}: {said}"))


def found_controller(source: str) -> object:
    """Return the controller that a scenario names, ``FILE.py:OBJECT``, of a file that has been imported before."""
    controller = brought_object(source)
    check_controller(controller)
    return controller


GAINS_WANTED = "find its gains by gtmbench aircraft NAME --autopilot, or give some"

Row = Sequence[float]  # one sample of every sensor, in the order of `SENSORS`, NaN where one is missing
Watching = Callable[[float, Row, Sequence[float]], Mapping[str, str | None]]
Command = Callable[[Row], Sequence[float]]
HandOn = Callable[[float, Row], Row]
Tell = Callable[[float, str, str, float], None]  # a time, a kind, a channel and its value, as a `LoopEvent` has them


class SurfaceWatch(Protocol):
    """The protocol of an object beside the loop that knows the commands and names surfaces that fail.

    It changes nothing of what is flown: a surface that is named is an event, "surface failed", and a controller of the
    user's own is told of it. `gb.WatchSurfaces` is one, by a monitor.
    """

    def start(self, sample_period_s: float) -> Watching:
        """Begin a flight anew.

        Return a function that is called once a sample, with the time in seconds, the readings of all sensors in the
        order of `SENSORS` and what was commanded then in the order of `COMMANDS`; it returns the surfaces that it has
        named since the last call, or knows more of, each with the kind of its fault, None where that isn't known.
        """


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
    controller: object = None,
    faults: Fault | Sequence[Fault] = (),
    noise: str | None = "t2",
    noise_seed: int | None = None,
    accommodate: Accommodation | None = None,
    watch_surfaces: SurfaceWatch | None = None,
    attitude: str | AttitudeEstimator = OWN,
    sensors: str | SensorChain | None = None,
    altitude_ft: float | None = None,
    tas_kt: float | None = None,
) -> LoopFlight:
    """Trim and fly with an autopilot, or a controller of your own, on the sensor readings, with noise and faults.

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
    controller : Controller, function or class, optional
        Instead of an autopilot: a function ``command(readings, time_s)``, or an object or a class with a method of that
        name, that returns elevator, aileron and rudder in deg and throttle in percent (`Controller`).
    faults : Fault or sequence of Fault
        Of sensors, of surfaces (elevator, aileron, rudder) and of the throttle. With one of a surface the truth also
        has where the surfaces were driven: ``elevator_actual`` and so on, beside what was commanded.
    noise : "t2" or None
        The sensor noise, the same numbers as in `measure`. None: perfect sensors.
    noise_seed : int, optional
        Seed of the noise, if it differs from the flight's.
    accommodate : Accommodation, optional
    watch_surfaces : SurfaceWatch, optional
        What names surfaces that fail, such as ``gb.WatchSurfaces(monitor)``: events, which a controller is told.
    attitude : str or AttitudeEstimator
        The source of phi, theta and psi. "own": a vertical gyro, which doesn't use p, q and r. Or an estimator, or the
        name of one (`gtmbench.values.attitude_estimators.ESTIMATORS`), that computes them from p, q and r, and from
        references: the truth with 0.5 deg of white noise, drawn as `filtered_attitude` draws it of `noise_seed`. On a
        chain its attitude is as late as the gyros that it reads; rate, delay and quantum of phi, theta and psi aren't
        added.
    sensors : "ideal", "chain" or SensorChain, optional
        The way from motion to readings: at once; the aircraft's own chain, flown with the gains that were found
        on it; or another chain. Where nobody says, the aircraft's own, if its own gains for it fly, as the GTM's do;
        with an `autopilot` or a `controller` of yours, ideal ones.

    Raises
    ------
    InputError
        If an argument is invalid, the aircraft has no autopilot, or an estimator's theta passes 85 deg before
        any fault began.
    ControllerError
        If the controller raises, or gives anything but four finite numbers; it holds what was flown.
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
    if sensors is None:
        sensors = craft.loop_sensors if autopilot is None and controller is None else IDEAL
    pilot = craft.autopilot_on(sensors) if autopilot is None else autopilot
    if controller is not None:
        check_controller(controller)
        if autopilot is not None:
            raise InputError("both autopilot and controller are given, and only one can fly; keep one")
    elif pilot is None:
        raise InputError(f"'{craft.name}' has no autopilot; {GAINS_WANTED}")
    simulation = Simulation(
        craft,
        excitation,
        duration_s,
        faults=faults,
        noise=noise,
        noise_seed=noise_seed,
        attitude=attitude,
        sensors=sensors,
        altitude_ft=altitude_ft,
        tas_kt=tas_kt,
    )
    simulation.reset(seed)
    events: list[LoopEvent] = []

    def tell(time_s: float, kind: str, channel: str, value: float) -> None:
        events.append(LoopEvent(time_s=time_s, kind=kind, channel=channel, value=value))

    hand_on = None if accommodate is None else accommodate.start(SAMPLE_PERIOD_S, tell)
    heard: Callable[[LoopEvent], object] | None = None
    if controller is not None:
        (command, heard), reads = _own(controller, simulation), getattr(controller, "reads", SENSORS)
    else:
        assert pilot is not None
        command, reads = pilot.engage(simulation.trim, craft.limits, SAMPLE_PERIOD_S), pilot.reads

    by = command if hand_on is None else lambda readings: command(hand_on(simulation.time_s, readings))
    if watch_surfaces is not None:
        by = _watched(by, watch_surfaces.start(SAMPLE_PERIOD_S), simulation, events, heard)
    commands = simulation.fly_by(by)
    flight = simulation.flight(commands)
    _check_end(simulation, flight, "the autopilot's gains" if controller is None else "the controller")
    events += flight.events
    events += [
        LoopEvent(time_s=fault.onset_s, kind=OUT_OF_LOOP, channel=fault.channel)
        for fault in simulation.faults
        if not is_of_surface(fault) and not set(fault.changes) & set(reads)
    ]
    return replace(flight, events=tuple(sorted(events, key=lambda event: event.time_s)))


def _own(controller: object, simulation: Simulation) -> tuple[Command, Callable[[LoopEvent], object] | None]:
    """Return a controller of the user's own as a function of the readings, which says what it does wrong."""
    try:
        command = take_over(controller, simulation.trim)
    except ControllerError as error:
        error.flight = simulation.flight()
        raise

    def tried(work: Callable[[], Any]) -> Any:
        try:
            return work()
        except Exception as error:  # somebody's own controller may do anything
            failure = failed(controller, f"at {simulation.time_s:g} s", error)
            failure.flight = simulation.flight()
            raise failure from error

    def checked(readings: Row) -> Sequence[float]:
        commands: Sequence[float] = tried(
            lambda: checked_commands(command(Readings._make(readings), simulation.time_s))
        )
        return commands

    listens = listener(command)
    return checked, None if listens is None else lambda event: tried(lambda: listens(event))


def _watched(
    command: Command,
    watching: Watching,
    simulation: Simulation,
    events: list[LoopEvent],
    heard: Callable[[LoopEvent], object] | None,
) -> Command:
    """Return what commands, and shows each sample and what was commanded there to a watch of surfaces."""
    before: tuple[float, list[float]] | None = None

    def watched(readings: Row) -> Sequence[float]:
        nonlocal before
        if before is not None:
            for surface, fault in watching(*before, simulation.commanded).items():
                events.append(LoopEvent(time_s=before[0], kind=SURFACE_FAILED, channel=surface, fault=fault))
                if heard is not None:
                    heard(events[-1])
        before = simulation.time_s, list(readings)
        return command(readings)

    return watched


def _check_end(simulation: Simulation, flight: LoopFlight, flown_by: str) -> None:
    """Refuse a flight that ended before anything broke."""
    onset_s = min((fault.onset_s for fault in simulation.faults), default=inf)
    left = next((event for event in flight.events if event.kind == ENVELOPE), None)
    if left is None or left.time_s >= onset_s:
        return
    what, remedy = "the loop", f"check {flown_by}, or choose a gentler excitation"
    check_envelope(flight.truth, simulation.aircraft, what, remedy)
    if left.value is not None and left.time_s + SAMPLE_PERIOD_S < onset_s:
        raise too_steep(left.value, left.time_s)

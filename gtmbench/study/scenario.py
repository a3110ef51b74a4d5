"""Scenarios: what is flown, what breaks, what watches; read from a TOML file, every key checked."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from gtmbench.bench.autopilot import Autopilot, autopilot_of
from gtmbench.bench.excitation import parts_of
from gtmbench.bench.known_aircraft import load_aircraft
from gtmbench.bench.loop import GAINS_WANTED, found_controller
from gtmbench.bench.other_sensors import Gps, Magnetometer, OtherSensors, gps_of, magnetometer_of
from gtmbench.bench.sensor_chain import CHAIN, IDEAL
from gtmbench.bench.sensors import NOISES, SNR_SPAN
from gtmbench.bench.stepping import LONGEST_S
from gtmbench.checks import keys, meant, naming, number, shown, table_of, text, whole
from gtmbench.errors import InputError
from gtmbench.files.shipped import read_shipped, shipped_scenarios
from gtmbench.files.writing import is_file
from gtmbench.study.fault_tables import FaultSpec, fault_specs
from gtmbench.values.attitude_estimators import OWN, estimator_of
from gtmbench.values.channels import CHANNELS, OF_OWN_RATE, names_of, sensor_list
from gtmbench.values.record import Span

_MOST_TRIALS = 1000  # of a run, which holds all of them in memory
_MOST_FAULTS = 100_000  # of a campaign's flight
_LONGEST_S = 500_000.0  # of all trials: 7 GB


@dataclass(frozen=True, kw_only=True)
class OperatorSetup:
    """Table ``[operator]``: what is identified, and from which part of the healthy record."""

    inputs: tuple[str, ...] = ("p", "q", "beta")
    outputs: tuple[str, ...] = ("r",)
    causal_order: int = 50
    noncausal_order: int = 50
    identify_s: Span = (25.0, 200.0)


@dataclass(frozen=True, kw_only=True)
class AlarmSetup:
    """Table ``[alarm]``: window, threshold, and how much healthy flight is watched for false alarms."""

    window: int = 1000
    threshold_factor: float = 1.5
    threshold_s: Span = (200.0, 480.0)
    watch_from_s: float = 25.0
    healthy_records: int = 5


@dataclass(frozen=True, kw_only=True)
class Setup:
    """Everything of a scenario but its faults. Scenarios with equal setups share flight, operator and threshold.

    With an `autopilot`, or a `controller` of the user's own, the loop is closed: every fault is flown, and sensors have
    the T2's noise.
    """

    aircraft: str = "gtm"
    excitation: str = "dissertation"
    duration_s: float = 500.0
    snr: float | None = 50.0
    noise: str | None = None
    seed: int = 1
    altitude_ft: float | None = None  # None: the aircraft's own trim
    tas_kt: float | None = None
    attitude: str = OWN  # whose it is: a vertical gyro's own, or that of an estimator of `ESTIMATORS`
    sensors: str = IDEAL  # what lies between motion and readings: nothing, or the aircraft's own chain
    attitude_late_s: float = 0.0  # how much later than the other sensors' the attitude's samples are
    magnetometer: Magnetometer | None = None
    gps: Gps | None = None
    severity_reference_s: Span = (25.0, 300.0)
    autopilot: Autopilot | None = None
    controller: str | None = None  # FILE.py:OBJECT, of a file that the user has imported
    operator: OperatorSetup = field(default_factory=OperatorSetup)
    alarm: AlarmSetup = field(default_factory=AlarmSetup)

    @property
    def trim_point(self) -> dict[str, float]:
        """What is said of the trim, as `fly` and `trim` take it."""
        stated = {"altitude_ft": self.altitude_ft, "tas_kt": self.tas_kt}
        return {name: value for name, value in stated.items() if value is not None}

    @property
    def is_in_loop(self) -> bool:
        """Whether somebody flies on the sensor readings."""
        return self.autopilot is not None or self.controller is not None

    @property
    def others(self) -> OtherSensors:
        """The sensors beside the aircraft's own."""
        return OtherSensors(magnetometer=self.magnetometer, gps=self.gps)

    @property
    def facts(self) -> dict[str, object]:
        """As plain values; ideal sensors go without saying, and a controller and sensors that aren't there."""
        stated = asdict(self)
        if self.sensors == IDEAL:
            del stated["sensors"]
        return {
            name: each
            for name, each in stated.items()
            if each is not None or name not in ("controller", "magnetometer", "gps")
        }


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A scenario file: a setup and the faults to try in it, one trial each; `states_...`: what it gives itself.

    Examples
    --------
    >>> import gtmbench as gb
    >>> scenario = gb.load_scenario("jam")
    >>> scenario.setup.duration_s, [fault.channel for fault in scenario.faults]
    (500.0, ['p', 'q', 'r'])
    """

    name: str
    title: str
    setup: Setup
    faults: tuple[FaultSpec, ...]
    states_noise: bool = True
    states_sensors: bool = True

    def __post_init__(self) -> None:
        check_aboard(self.setup, self.faults)


def check_aboard(setup: Setup, specs: Iterable[FaultSpec]) -> None:
    """Refuse faults of a magnetometer or a GPS that no flight of a setup has."""
    for spec in specs:
        check_aboard(setup, spec.also)
        for channel in spec.fault.reads:
            if channel in OF_OWN_RATE and channel not in setup.others.channels:
                table = names_of(channel)[-1]
                raise InputError(f"{spec.text}: the flight has no '{channel}'; add a table [{table}]")


def load_scenario(source: str | Path) -> Scenario:
    """Read a scenario from a file, or one of the package's by name (``drift``).

    Parameters
    ----------
    source : str or Path
        A name that ``gtmbench list`` shows, or a file.

    Raises
    ------
    InputError
        Naming file, key, what was given and what is legal.

    Examples
    --------
    >>> import gtmbench as gb
    >>> scenario = gb.load_scenario("drift")
    >>> [(fault.kind, fault.channel, fault.onset_s) for fault in scenario.faults][0]
    ('drift', 'p', 300.0)
    """
    path, table = _scenario_tables(source)
    with naming(path):
        return _fits_in_memory(scenario_of(path.stem, table))


def _scenario_tables(source: str | Path) -> tuple[Path, dict[str, Any]]:
    """Return the path and the tables of a scenario; ``faults/drift.toml`` is the one that ships where there is none."""
    shipped, given = shipped_scenarios(), Path(source)
    if given.parent.name == "faults" and given.stem in shipped and not is_file(given):
        source = given.stem
    return read_shipped(source, "scenario", shipped)


def scenario_of(name: str, table: dict[str, Any]) -> Scenario:
    """Return the scenario that a file's table says, however many trials it has."""
    title = text("title", table.pop("title", text("its name", name)))
    blocks = table.pop("faults", None)
    setup = _setup(table)
    specs = _specs(blocks, setup.duration_s)
    return Scenario(
        name=name,
        title=title,
        setup=setup,
        faults=tuple(specs),
        states_noise="snr" in table or "noise" in table,
        states_sensors="sensors" in table,
    )


def _fits_in_memory(scenario: Scenario) -> Scenario:
    """Refuse a scenario whose trials can't be held in memory together, as a run's are."""
    trials, duration_s = len(scenario.faults), scenario.setup.duration_s
    if trials > _MOST_TRIALS:
        raise InputError(f"{trials} trials; a scenario has at most {_MOST_TRIALS}, so split it, or make it a campaign")
    if trials * duration_s > _LONGEST_S:
        held = f"{trials} trials of {duration_s:g} s would be held in memory"
        raise InputError(f"{held}; a scenario has at most {_LONGEST_S:g} s in all, so split it, or make it a campaign")
    return scenario


def _specs(blocks: Any, end_s: float) -> list[FaultSpec]:
    if not isinstance(blocks, list) or not blocks or not all(isinstance(block, dict) for block in blocks):
        raise InputError("no [[faults]] given; add at least one table with kind, channels and onset_s")
    if (most := sum(map(_combinations, blocks))) > _MOST_FAULTS:
        raise InputError(f"{most} trials of one flight; at most {_MOST_FAULTS} are allowed")
    return [spec for i, block in enumerate(blocks, 1) for spec in fault_specs(f"faults, table {i}", block, end_s)]


def _combinations(block: dict[str, Any]) -> int:
    """Return how many trials a table asks for at most, before they are made."""
    return math.prod(len(value) for key, value in block.items() if isinstance(value, list) and key != "also")


def load_faults(source: str | Path) -> tuple[FaultSpec, ...]:
    """Read what a scenario breaks, for a recorded flight: a fault may begin whenever that has samples.

    >>> [trial.text for trial in load_faults("jam")]
    ['jam of p, from 300 s', 'jam of q, from 300 s', 'jam of r, from 300 s']
    """
    path, table = _scenario_tables(source)
    with naming(path):
        text("title", table.pop("title", path.stem))
        blocks = table.pop("faults", None)
        _setup(table)
        specs = _specs(blocks, math.inf)
        if len(specs) > _MOST_TRIALS:
            raise InputError(f"{len(specs)} trials; a scenario has at most {_MOST_TRIALS}, so split it")
        return tuple(specs)


def setting(key: str, value: Any) -> Any:
    """Return the value of a setup's key, checked as in a file.

    >>> setting("duration_s", 60)
    60.0
    """
    return _CHECKS[key](key, value)


def _setup(table: dict[str, Any]) -> Setup:
    if "snr" in table and "noise" in table:
        raise InputError("both snr and noise are given; keep one")
    if "noise" in table:
        table = {**table, "snr": None}
    states_snr = "snr" in table and "noise" not in table
    setup = Setup(**_checked(Setup, table, ""))
    if "sensors" not in table and table.get("autopilot") == {}:  # the aircraft's own gains
        setup = replace(setup, sensors=load_aircraft(setup.aircraft).loop_sensors)
    setup = with_chain(_with_autopilot(setup, states_snr), states_snr=states_snr)
    for key, span in (
        ("operator.identify_s", setup.operator.identify_s),
        ("alarm.threshold_s", setup.alarm.threshold_s),
        ("severity_reference_s", setup.severity_reference_s),
    ):
        if not span[0] < span[1] <= setup.duration_s:
            section, _, name = key.rpartition(".")
            meant = "" if name in table.get(section, table) else " unless it is given"
            raise InputError(
                f"{key} is {list(span)}{meant}, but the flight lasts {setup.duration_s:g} s (duration_s); give a "
                "start before the end, both within it"
            )
    number("alarm.watch_from_s", setup.alarm.watch_from_s, 0.0, setup.duration_s)
    for name in setup.operator.inputs:
        if name in setup.operator.outputs:
            raise InputError(f"operator: '{name}' is both pseudo input and pseudo output; it would predict itself")
    units = {name: CHANNELS[name].unit for name in setup.operator.outputs}
    if len(set(units.values())) > 1:
        given = ", ".join(f"{name} in {unit}" for name, unit in units.items())
        raise InputError(f"operator.outputs: {given}; one norm needs one unit, so take outputs of one kind")
    return setup


def with_chain(setup: Setup, *, states_snr: bool = False) -> Setup:
    """Return a setup with the noise of sensors on a chain: the T2's, which doesn't depend on the flight."""
    if setup.sensors == IDEAL:
        return setup
    load_aircraft(setup.aircraft).chain_of(setup.sensors)
    if states_snr:
        raise InputError(
            f"snr is {setup.snr:g}, but a sensor chain has noise of its own, which is no ratio of a flight; "
            'give noise = "t2"'
        )
    return replace(setup, snr=None, noise="t2")


def _with_autopilot(setup: Setup, states_snr: bool) -> Setup:
    """Return a setup with the gains that ``[autopilot]`` leaves to the aircraft, and with sensors for a loop."""
    gains: Any = setup.autopilot  # the table, as it stands there
    if setup.controller is not None:
        if gains is not None:
            raise InputError("both [autopilot] and controller are given, and only one can fly; keep one")
        return _on_readings(setup, states_snr)
    if gains is None:
        return setup
    own = load_aircraft(setup.aircraft).autopilot_on(setup.sensors)
    return flown_by(setup, autopilot_of(gains, own) if gains else None, states_snr)


def flown_by(setup: Setup, autopilot: Autopilot | None, states_snr: bool) -> Setup:
    """Return a setup in the loop of an autopilot, or of the aircraft's own, with sensors for it."""
    autopilot = autopilot or load_aircraft(setup.aircraft).autopilot_on(setup.sensors)
    if autopilot is None:
        raise InputError(f"[autopilot] is empty, and '{setup.aircraft}' has no gains of its own; {GAINS_WANTED}")
    return _on_readings(replace(setup, autopilot=autopilot), states_snr)


def flown_on(scenario: Scenario, aircraft: str) -> Scenario:
    """Return a scenario flown on another aircraft, at that one's own trim and by its own autopilot.

    >>> other = flown_on(load_scenario("jam"), "c172p")
    >>> other.setup.aircraft, other.setup.altitude_ft
    ('c172p', None)
    """
    setup = replace(
        scenario.setup, aircraft=setting("aircraft", aircraft), altitude_ft=None, tas_kt=None, autopilot=None
    )
    if scenario.setup.autopilot is not None and not scenario.states_sensors:
        setup = replace(setup, sensors=load_aircraft(setup.aircraft).loop_sensors)
    if scenario.setup.autopilot is not None:
        setup = flown_by(setup, None, states_snr=False)
    return replace(scenario, setup=with_chain(setup))


def sensed_by(scenario: Scenario, sensors: str) -> Scenario:
    """Return a scenario on other sensors, in the loop by the gains for them, unless it has gains of its own.

    >>> setup = sensed_by(load_scenario("in_the_loop"), "ideal").setup
    >>> setup.sensors, setup.autopilot.lead_s
    ('ideal', 0.0)
    """
    before, craft = scenario.setup, load_aircraft(scenario.setup.aircraft)
    setup = replace(before, sensors=setting("sensors", sensors))
    if before.autopilot is not None and before.autopilot == craft.autopilot_on(before.sensors):
        setup = replace(setup, autopilot=craft.autopilot_on(sensors))
    setup = with_chain(setup, states_snr=scenario.states_noise and before.noise is None)
    return replace(scenario, setup=setup, states_sensors=True)


def _on_readings(setup: Setup, states_snr: bool) -> Setup:
    """Return a setup in the loop with sensors for it."""
    if states_snr:
        raise InputError(
            f"snr is {setup.snr:g}, but in the loop sensors are noisy before there is a flight to be a ratio of; "
            'give noise = "t2"'
        )
    if setup.attitude_late_s:
        raise InputError(
            f"attitude_late_s is {setup.attitude_late_s:g}, but in the loop the autopilot flies on the attitude, "
            "and comes in time; leave it out"
        )
    return replace(setup, snr=None, noise="t2")


def _checked(of: type, table: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Return a table's values as a dataclass wants them, or say which key is wrong and how."""
    own = [item.name for item in fields(of)]
    known = keys(table, own if prefix else ["title", *own, "faults"], section=prefix.rstrip("."))
    return {key: _CHECKS[key](prefix + key, value) for key, value in known.items()}


def _table(of: type) -> Callable[[str, Any], Any]:
    def check(key: str, value: Any) -> Any:
        return of(**_checked(of, table_of(key, value), f"{key}."))

    return check


def _name_among(look_up: Callable[[str], object]) -> Callable[[str, Any], str]:
    def check(key: str, value: Any) -> str:
        name = text(key, value)
        with naming(key):
            look_up(name)
        return name

    return check


def _one_of(legal: Sequence[str], there: str) -> Callable[[str, Any], str]:
    def check(key: str, value: Any) -> str:
        if value not in legal:
            raise InputError(f"{key} is {shown(value)}; {there}{meant(value, legal)}")
        return str(value)

    return check


def _times(key: str, value: Any) -> Span:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{key} is {shown(value)}; it must be two times in seconds, [start, end]")
    return number(f"{key}[0]", value[0], 0.0), number(f"{key}[1]", value[1], 0.0, 1e9)


# every key of a scenario, and how its value is checked
_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "aircraft": _name_among(load_aircraft),
    "excitation": _name_among(parts_of),
    "duration_s": lambda key, value: number(key, value, 0.0, LONGEST_S, above=True),
    "snr": lambda key, value: None if value is None else number(key, value, *SNR_SPAN),
    "noise": _one_of(NOISES, f"there is {', '.join(NOISES)}, or give snr"),
    "seed": whole,
    "altitude_ft": lambda key, value: number(key, value, 0.0, 100_000.0, above=True),
    "tas_kt": lambda key, value: number(key, value, 0.0, 2_000.0, above=True),
    "attitude": _name_among(estimator_of),
    "sensors": _one_of((IDEAL, CHAIN), f"there are {IDEAL}, {CHAIN}"),
    "attitude_late_s": lambda key, value: number(key, value, 0.0, 10.0),
    "magnetometer": magnetometer_of,
    "gps": gps_of,
    "severity_reference_s": _times,
    "autopilot": table_of,
    "controller": _name_among(found_controller),
    "operator": _table(OperatorSetup),
    "inputs": sensor_list,
    "outputs": sensor_list,
    "causal_order": lambda key, value: whole(key, value, 0, 2000),
    "noncausal_order": lambda key, value: whole(key, value, 0, 2000),
    "identify_s": _times,
    "alarm": _table(AlarmSetup),
    "window": lambda key, value: whole(key, value, 0, 1_000_000),
    "threshold_factor": lambda key, value: number(key, value, 0.0, 1e6, above=True),
    "threshold_s": _times,
    "watch_from_s": lambda key, value: number(key, value, 0.0),
    "healthy_records": lambda key, value: whole(key, value, 1, 1000),
}

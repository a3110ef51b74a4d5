"""An aircraft: its model's folder, and what is known of it beyond the model, as a commented `aircraft.toml` says it."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gtmbench.bench.autopilot import Autopilot, autopilot_of
from gtmbench.bench.sensor_chain import CHAIN, IDEAL, SensorChain, chain_of_table
from gtmbench.checks import boolean, keys, meant, number, shown, table_of, text, whole
from gtmbench.errors import InputError
from gtmbench.values.channels import CHANNELS, COMMANDS, SURFACES
from gtmbench.values.record import Span

if TYPE_CHECKING:
    from tomlkit.items import Item

SAMPLE_PERIOD_S = 0.01  # of flights, their sensors and monitors: 100 Hz
UNKNOWNS = ("alpha", "phi", *COMMANDS)  # what trim solves for
_FLAGS = ("without_io", "spin_up", "settle", "rudderless", "motorless")
_UNUSUAL = ("spin_up", "settle", "steps_a_sample", "rudderless", "motorless")  # stated only where they are
MOST_STEPS = 100  # of JSBSim in a sample
# deg; beyond, a flight is a departure unless the facts say otherwise
_UPSET: dict[str, Span] = {"phi": (-60.0, 60.0), "theta": (-45.0, 45.0)}
_STEP = r"[A-Za-z_][\w.-]*(\[\d{1,3}\])?"
_PROPERTY = re.compile(rf"/?{_STEP}(/{_STEP})*", flags=re.ASCII)  # asked for any other, JSBSim ends the process


@dataclass(frozen=True, kw_only=True)
class Command:
    """How a command reaches the model: the property that is set, and what 1 of it is in the channel's unit."""

    property: str
    unit: float = 1.0


def _in_own_units() -> dict[str, Command]:
    return {name: Command(property=CHANNELS[name].jsbsim) for name in COMMANDS}


@dataclass(frozen=True, kw_only=True)
class Aircraft:
    """One aircraft: its model's folder (with ``NAME/NAME.xml``) and the facts of its ``aircraft.toml``.

    Attributes
    ----------
    altitude_ft, tas_kt, psi_deg, latitude_deg, guess
        The trim condition, and the start of its search.
    limits, envelope : dict
        The bounds of commands and flights, by channel, in the channel's unit.
    commands : dict
        By channel, how the command reaches the model.
    excitation : dict
        By surface, the factor on the deflection that an excitation has on the GTM.
    properties : dict
        JSBSim properties that are set after loading the model.
    departure : dict
        By channel, the span beyond which the aircraft is out of control. By default alpha's is the envelope's, bank's
        60 deg and pitch's 45 deg.
    autopilot : Autopilot or None
        Its gains, if they are known.
    chain : SensorChain or None
        The way from its motion to the sensor readings, if that is known.
    chain_autopilot : Autopilot or None
        The gains that were found on that chain; None: `autopilot` flies there, too.
    without_io : bool
        Whether the model's input and output sections are left out. Otherwise a model that has some is refused.
    spin_up : bool
        Whether its propellers are turned up to their speed before a flight, because JSBSim's own search fails.
    settle : bool
        Whether its engines run until their thrust is steady before a flight, because JSBSim's own search fails.
    steps_a_sample : int
        Into how many steps JSBSim divides a sample of 0.01 s: small propellers change quicker than that.
    rudderless : bool
        Whether nothing answers the rudder command. Trim then finds a sideslip instead.
    motorless : bool
        Whether nothing answers the throttle command. Trim then finds a steady descent instead.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gtm = gb.load_aircraft("gtm")
    >>> gtm.altitude_ft, gtm.tas_kt, gtm.limits["elevator"]
    (8000.0, 100.58, (-30.0, 20.0))
    """

    name: str
    title: str
    folder: Path
    altitude_ft: float
    tas_kt: float
    psi_deg: float
    latitude_deg: float
    guess: dict[str, float]
    limits: dict[str, Span]
    envelope: dict[str, Span]
    commands: dict[str, Command] = field(default_factory=_in_own_units)
    excitation: dict[str, float] = field(default_factory=lambda: dict.fromkeys(SURFACES, 1.0))
    properties: dict[str, float] = field(default_factory=dict)
    departure: dict[str, Span] = field(default_factory=dict)
    autopilot: Autopilot | None = None
    chain: SensorChain | None = None
    chain_autopilot: Autopilot | None = None
    without_io: bool = False
    spin_up: bool = False
    settle: bool = False
    steps_a_sample: int = 1
    rudderless: bool = False
    motorless: bool = False

    def chain_of(self, sensors: str | SensorChain) -> SensorChain | None:
        """Return the chain that is meant by "chain", this aircraft's own, or by itself; None: "ideal" sensors.

        Raises
        ------
        InputError
            If there are no such sensors, or the aircraft has no chain.
        """
        if isinstance(sensors, SensorChain):
            return sensors
        if sensors not in (IDEAL, CHAIN):
            likely = meant(sensors, (IDEAL, CHAIN))
            raise InputError(f"no sensors {shown(sensors)}; there are {IDEAL}, {CHAIN}{likely}")
        if sensors == CHAIN and self.chain is None:
            raise InputError(f"'{self.name}' has no sensor chain; add a table [{CHAIN}] to its aircraft.toml")
        return self.chain if sensors == CHAIN else None

    @property
    def loop_sensors(self) -> str:
        """The sensors that its own autopilot flies on where nobody says: its chain, if gains are known for it."""
        return IDEAL if self.chain is None or self.chain_autopilot is None else CHAIN

    def autopilot_on(self, sensors: str | SensorChain) -> Autopilot | None:
        """Return the gains for some sensors: on its own chain those that were found there, if known."""
        chain = self.chain_of(sensors)
        is_own = chain is not None and chain == self.chain
        return self.chain_autopilot or self.autopilot if is_own else self.autopilot

    @property
    def model(self) -> Path:
        """The model's file."""
        return self.folder / f"{self.name}.xml"

    @property
    def searched(self) -> dict[str, Span]:
        """Where trim looks for its unknowns; a sideslip has the rudder's place, a flight path angle the throttle's."""
        commands = {name: self.limits[name] for name in COMMANDS}
        glides = {"throttle": (-45.0, 5.0)} if self.motorless else {}  # deg, the flight path angle of what has no motor
        return {"alpha": self.envelope["alpha"], "phi": (-60.0, 60.0), **commands, **glides}


def aircraft_of(folder: Path, facts: dict[str, Any]) -> Aircraft:
    """Return the aircraft of a model's folder and the tables of an ``aircraft.toml``."""
    trim, limits, envelope = (table_of(key, facts.get(key)) for key in ("trim", "limits", "envelope"))
    guess = table_of("trim.guess", trim.get("guess"))
    for table, wanted, given in (
        ("trim", ("altitude_ft", "tas_kt", "psi_deg", "latitude_deg"), trim),
        ("trim.guess", UNKNOWNS, guess),
        ("limits", COMMANDS, limits),
        ("envelope", ("alpha", "altitude"), envelope),
    ):
        if missing := sorted(set(wanted) - given.keys()):
            raise InputError(f"[{table}] lacks {', '.join(missing)}")
    departure = table_of("departure", facts.get("departure", {}))
    for table, spans in (("envelope", envelope), ("departure", departure)):
        if unknown := spans.keys() - CHANNELS.keys():
            likely = meant(min(unknown), CHANNELS)
            raise InputError(f"[{table}] names no channel: {', '.join(sorted(unknown))}{likely}")
    commands = keys(table_of("commands", facts.get("commands", {})), COMMANDS, section="commands")
    excitation = keys(table_of("excitation", facts.get("excitation", {})), SURFACES, section="excitation")
    properties = table_of("properties", facts.get("properties", {}))
    within = {key: _span(f"envelope.{key}", value) for key, value in envelope.items()}
    aircraft = Aircraft(
        name=text("the folder's name", folder.name),
        title=text("title", facts.get("title")),
        folder=folder,
        altitude_ft=number("trim.altitude_ft", trim["altitude_ft"], -1e6, 1e6),
        tas_kt=number("trim.tas_kt", trim["tas_kt"], 0.0, 2000.0, above=True),
        psi_deg=number("trim.psi_deg", trim["psi_deg"], -360.0, 360.0),
        latitude_deg=number("trim.latitude_deg", trim["latitude_deg"], -90.0, 90.0),
        guess={key: number(f"trim.guess.{key}", guess[key]) for key in UNKNOWNS},
        limits={key: _span(f"limits.{key}", limits[key]) for key in COMMANDS},
        envelope=within,
        commands=_in_own_units() | {key: _command(f"commands.{key}", commands, key) for key in commands},
        excitation=dict.fromkeys(SURFACES, 1.0)
        | {key: number(f"excitation.{key}", value, 0.0, 1e3) for key, value in excitation.items()},
        properties={
            _property("properties", key): number(f"properties.{key}", value) for key, value in properties.items()
        },
        departure=_UPSET
        | {"alpha": within["alpha"]}
        | {key: _span(f"departure.{key}", value) for key, value in departure.items()},
        autopilot=autopilot_of(table_of("autopilot", facts["autopilot"])) if "autopilot" in facts else None,
        chain=chain_of_table(table_of("chain", facts["chain"])) if "chain" in facts else None,
        chain_autopilot=autopilot_of(table_of("chain_autopilot", facts["chain_autopilot"]))
        if "chain_autopilot" in facts
        else None,
        steps_a_sample=whole("steps_a_sample", facts.get("steps_a_sample", 1), 1, MOST_STEPS),
        **{name: boolean(name, facts.get(name, False)) for name in _FLAGS},
    )
    for key, (low, high) in aircraft.searched.items():
        if not low <= aircraft.guess[key] <= high:
            raise InputError(f"trim.guess.{key} is {aircraft.guess[key]:g}; it must lie in {low:g}..{high:g}")
    return aircraft


def facts_of(aircraft: Aircraft) -> dict[str, Any]:
    """Return an aircraft's facts as the tables of an ``aircraft.toml``, the inverse of `aircraft_of`."""
    return {
        "title": aircraft.title,
        "without_io": aircraft.without_io,
        **{name: value for name in _UNUSUAL if (value := getattr(aircraft, name)) is True or value > 1},
        "trim": {
            **{key: getattr(aircraft, key) for key in ("altitude_ft", "tas_kt", "psi_deg", "latitude_deg")},
            "guess": dict(aircraft.guess),
        },
        "limits": {name: list(span) for name, span in aircraft.limits.items()},
        "envelope": {name: list(span) for name, span in aircraft.envelope.items()},
        "commands": {name: asdict(command) for name, command in aircraft.commands.items()},
        "excitation": dict(aircraft.excitation),
        "departure": {name: list(span) for name, span in aircraft.departure.items()},
        **({"autopilot": asdict(aircraft.autopilot)} if aircraft.autopilot else {}),
        **({"chain": aircraft.chain.table} if aircraft.chain else {}),
        **({"chain_autopilot": asdict(aircraft.chain_autopilot)} if aircraft.chain_autopilot else {}),
        "properties": dict(aircraft.properties),
    }


def _command(name: str, commands: dict[str, Any], key: str) -> Command:
    given = keys(table_of(name, commands[key]), ("property", "unit"), section=name)
    unit = number(f"{name}.unit", given.get("unit", 1.0), -1e6, 1e6)
    if abs(unit) < 1e-6:
        raise InputError(f"{name}.unit is {unit:g}; it must be what 1 of the property is in {CHANNELS[key].unit}")
    return Command(property=_property(f"{name}.property", given.get("property")), unit=unit)


def _property(name: str, value: Any) -> str:
    if not isinstance(value, str) or not _PROPERTY.fullmatch(value):
        raise InputError(f"{name} is {shown(value)}; it must be the name of a property, such as fcs/flap-cmd-norm")
    return value


def _span(name: str, value: Any) -> Span:
    if not isinstance(value, list) or len(value) != 2:
        raise InputError(f"{name} is {shown(value)}; it must be two numbers, [low, high]")
    low, high = (number(name, bound) for bound in value)
    if not low < high:
        raise InputError(f"{name} is {shown(value)}; the first must be less than the second")
    return low, high


Facts = Mapping[str, Any]

_OF_SMALL = {
    "spin_up": "true: its propellers are turned up before a flight, because JSBSim's own search for their speed fails",
    "settle": "true: its engines run until their thrust is steady before a flight, because JSBSim's own search fails",
    "steps_a_sample": "JSBSim's steps in a sample of 0.01 s: small propellers change quicker than that",
    "rudderless": "true: nothing answers the rudder command, and trim finds a sideslip instead",
    "motorless": "true: nothing answers the throttle command, and trim finds a steady descent (its guess: deg)",
}
_SECTIONS = {
    "trim": "where it is trimmed, and where the search for that begins (deg, percent of throttle)",
    "commands": "how commands reach the model: a property, and what 1 of it is in deg (of the throttle: in percent)",
    "limits": "what can be commanded: deg, percent",
    "excitation": "how many times what an excitation moves on the GTM (a multisine: 0.7 deg RMS) it moves here",
    "envelope": "where the model is valid; a flight that leaves it is an error. Any channel may stand here",
    "departure": "beyond this it isn't flown any more but falls; of a flight in the loop that is an event",
    "autopilot": "gains of the autopilot that flies in the loop; found by gtmbench aircraft NAME --autopilot",
    "chain": "by sensor, the way from motion to reading: rate_hz, delay_s, filter_hz, quantum, noise",
    "chain_autopilot": "gains of the autopilot on that chain; gtmbench aircraft NAME --autopilot --sensors chain",
    "properties": "what is set when the model has been loaded: gear, flaps, fuel, levers of engines, other simulators'",
}


def commented(facts: Facts, model: str | None = None) -> str:
    """Return facts as an ``aircraft.toml`` that says what each means.

    >>> print(commented({"title": "A kite", "without_io": False, "trim": {"altitude_ft": 300.0}}, "../kite"))
    # What gtmbench knows of this aircraft beyond its JSBSim model. Every figure is to be edited.
    title = "A kite"
    model = "../kite"  # a name of `gtmbench list --all`, or a folder's path
    without_io = false  # true: leave out input and output sections, which would open ports and write files
    <BLANKLINE>
    # where it is trimmed, and where the search for that begins (deg, percent of throttle)
    [trim]
    altitude_ft = 300.0
    <BLANKLINE>
    """
    lines = [
        "# What gtmbench knows of this aircraft beyond its JSBSim model. Every figure is to be edited.",
        f"title = {_value(facts['title'])}",
        *([f"model = {_value(model)}  # a name of `gtmbench list --all`, or a folder's path"] if model else []),
        f"without_io = {_value(facts['without_io'])}  # true: leave out input and output sections, which would open "
        "ports and write files",
        *(f"{key} = {_value(facts[key])}  # {said}" for key, said in _OF_SMALL.items() if key in facts),
    ]
    for section in _SECTIONS:
        if table := facts.get(section):
            lines += ["", *_section(section, table)]
    return "\n".join(lines) + "\n"


def autopilot_table(gains: Facts, section: str = "autopilot") -> str:
    """Return gains as the table of an ``aircraft.toml`` or a scenario; on a chain, as ``[chain_autopilot]``.

    >>> print(autopilot_table({"psi_to_phi": 0.8}))
    # gains of the autopilot that flies in the loop; found by gtmbench aircraft NAME --autopilot
    [autopilot]
    psi_to_phi = 0.8
    <BLANKLINE>
    """
    return "\n".join(_section(section, gains)) + "\n"


def _section(section: str, table: Facts) -> list[str]:
    import tomlkit

    values = [f"{tomlkit.key(key).as_string()} = {_value(value)}" for key, value in table.items()]
    return [f"# {_SECTIONS[section]}", f"[{section}]", *values]


def listed(entries: Mapping[str, Facts], head: str) -> str:
    """Return the facts of many aircraft, a table each, each fact in a line; `head` are lines of comment."""
    import tomlkit

    document = tomlkit.parse(head)
    for name in sorted(entries, key=str.casefold):
        table = tomlkit.table()
        table.update({key: _inline(value) for key, value in entries[name].items()})
        document[name] = table
    return tomlkit.dumps(document)


def _value(value: Any) -> str:
    return _inline(value).as_string()


def _inline(value: Any) -> Item:
    """Return what stands in one line, tables too."""
    import tomlkit

    if not isinstance(value, Mapping):
        item: Item = tomlkit.item(value)
        return item
    table = tomlkit.inline_table()
    table.update({key: _inline(each) for key, each in value.items()})
    return table

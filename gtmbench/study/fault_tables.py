"""Trials to come: the ``[[faults]]`` tables of a scenario, one trial a channel and severity, or ready faults."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Any

from gtmbench.channels import CHANNELS, sensor_list
from gtmbench.checks import keys, number, shown
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, Parameter
from gtmbench.faults.registry import find_fault
from gtmbench.study.severity import Severity, parse_severity


@dataclass(frozen=True, kw_only=True)
class FaultSpec:
    """One trial to come: a fault, and by name the severities that a file gives, which may be relative to the flight.

    In `fault` a relative severity is its share (0.5 for half the RMS) until `build` puts the figure there.
    """

    fault: Fault
    severities: dict[str, Severity] = field(default_factory=dict)

    @property
    def kind(self) -> str:
        """The kind of fault."""
        return self.fault.kind

    @property
    def channel(self) -> str:
        """The channel that breaks."""
        return self.fault.channel

    @property
    def onset_s(self) -> float:
        """When it breaks."""
        return self.fault.onset_s

    @property
    def duration_s(self) -> float | None:
        """For how long; None: for good."""
        return self.fault.duration_s


def fault_specs(where: str, block: dict[str, Any], flight_s: float) -> list[FaultSpec]:
    """Return the trials of one table of a flight of `flight_s` seconds.

    Raises
    ------
    InputError
        Naming the table, the key, what was given and what is legal.
    """
    try:
        cls = find_fault(block.get("kind"))
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    parameters = cls.parameters()
    own = [item.name for item in parameters]
    legal = ["kind", "channels", "onset_s", "duration_s", "unit", *own]
    keys(block, legal, where=where, there=f"a {cls.kind} has")
    for key in ("channels", "onset_s", *own):
        if key not in block:
            raise InputError(f"{where}: key '{key}' is missing; a {cls.kind} needs it")
    channels = _channels(block["channels"], block.get("unit"), where)
    onset_s = number(f"{where}: onset_s", block["onset_s"], 0.0, flight_s)
    duration_s = number(f"{where}: duration_s", block["duration_s"], 0.0, above=True) if "duration_s" in block else None
    others = {item.name: block[item.name] for item in parameters if not item.is_severity}
    for key, name in others.items():
        sensor_list(f"{where}: {key}", [name])
    combinations = _severities(parameters, block, where)
    specs = []
    for channel in channels:
        for severities in combinations:
            figures = {name: given.value for name, given in severities.items()}
            try:  # the fault itself knows what its parameters may be; a share can't be wrong
                fault = cls(channel=channel, onset_s=onset_s, duration_s=duration_s, **figures, **others)
            except InputError as error:
                raise InputError(f"{where}: {error}") from error
            specs.append(FaultSpec(fault=fault, severities=severities))
    return specs


def spec_of(fault: Fault, flight_s: float = math.inf) -> FaultSpec:
    """Return the trial of a ready fault, of whatever class, in a flight of `flight_s` seconds.

    Raises
    ------
    InputError
        Where it isn't a fault, its channels aren't sensors, or it begins outside of the flight.

    Examples
    --------
    >>> from gtmbench.faults.kinds import Jam
    >>> spec_of(Jam(channel="p", onset_s=300.0)).kind
    'jam'
    """
    if not isinstance(fault, Fault) or not isinstance(getattr(fault, "kind", None), str):
        raise InputError(f"{shown(fault)} is no fault with a kind; give one such as Jam(channel='p', onset_s=300)")
    sensor_list(f"{fault.kind}: channels", list(dict.fromkeys(fault.reads)))
    number(f"{fault.kind}: onset_s", fault.onset_s, 0.0, flight_s)
    return FaultSpec(fault=fault)


def build(spec: FaultSpec, severities: dict[str, float]) -> Fault:
    """Return the fault of a trial, its severities now absolute."""
    figures: dict[str, Any] = {**severities}
    return replace(spec.fault, **figures)


def _channels(channels: Any, unit: Any, where: str) -> tuple[str, ...]:
    names = sensor_list(f"{where}: channels", channels)
    for name in names:
        if unit is not None and unit != CHANNELS[name].unit:
            raise InputError(
                f"{where}: unit is {shown(unit)}, but channel '{name}' is in {CHANNELS[name].unit}; convert the figures"
            )
    return names


def _severities(parameters: tuple[Parameter, ...], block: dict[str, Any], where: str) -> list[dict[str, Severity]]:
    """Return every combination of the severities given."""
    combinations: list[dict[str, Severity]] = [{}]
    for item in parameters:
        if item.is_severity:
            key = f"{where}: {item.name}"
            given = block[item.name] if isinstance(block[item.name], list) else [block[item.name]]
            if not given:
                raise InputError(f"{key} is an empty list; give a number or a list of them")
            steps = [parse_severity(entry, per_second=item.per_second, key=key) for entry in given]
            combinations = [{**others, item.name: step} for others in combinations for step in steps]
    return combinations

"""The ``[[faults]]`` tables of a scenario: one trial for every channel and every severity."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gtmbench.bench.fault import Fault, Parameter
from gtmbench.bench.faults import FAULTS
from gtmbench.channels import CHANNELS, sensor_list
from gtmbench.checks import number, shown
from gtmbench.errors import InputError
from gtmbench.study.severity import Severity, parse_severity


@dataclass(frozen=True, kw_only=True)
class FaultSpec:
    """One trial to come: a kind of fault on a channel, its severities still relative where the file says so."""

    kind: str
    channel: str
    onset_s: float
    duration_s: float | None
    severities: dict[str, Severity]
    other_channels: dict[str, str]


def fault_specs(where: str, block: dict[str, Any], flight_s: float) -> list[FaultSpec]:
    """Return the trials of one table of a flight of `flight_s` seconds.

    Raises
    ------
    InputError
        Naming the table, the key, what was given and what is legal.
    """
    kind = block.get("kind")
    if not isinstance(kind, str) or kind not in FAULTS:
        raise InputError(f"{where}: kind is {shown(kind)}; there are {', '.join(FAULTS)}")
    parameters = FAULTS[kind].parameters()
    own = [item.name for item in parameters]
    legal = ["kind", "channels", "onset_s", "duration_s", "unit", *own]
    for key in block:
        if key not in legal:
            raise InputError(f"{where}: unknown key {shown(key)}; a {kind} has {', '.join(legal)}")
    for key in ("channels", "onset_s", *own):
        if key not in block:
            raise InputError(f"{where}: key '{key}' is missing; a {kind} needs it")
    channels = _channels(block["channels"], block.get("unit"), where)
    onset_s = number(f"{where}: onset_s", block["onset_s"], 0.0, flight_s)
    duration_s = number(f"{where}: duration_s", block["duration_s"], 0.0, above=True) if "duration_s" in block else None
    others = {item.name: block[item.name] for item in parameters if not item.is_severity}
    for key, name in others.items():
        sensor_list(f"{where}: {key}", [name])
    specs = [
        FaultSpec(
            kind=kind,
            channel=channel,
            onset_s=onset_s,
            duration_s=duration_s,
            severities=severities,
            other_channels=others,
        )
        for channel in channels
        for severities in _severities(parameters, block, where)
    ]
    for spec in specs:  # the fault itself knows what its parameters may be; a share can't be wrong
        try:
            build(spec, {name: figure.value for name, figure in spec.severities.items()})
        except InputError as error:
            raise InputError(f"{where}: {error}") from error
    return specs


def build(spec: FaultSpec, severities: dict[str, float]) -> Fault:
    """Return the fault of a trial, its severities now absolute."""
    return FAULTS[spec.kind](
        channel=spec.channel,
        onset_s=spec.onset_s,
        duration_s=spec.duration_s,
        **severities,
        **spec.other_channels,
    )


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

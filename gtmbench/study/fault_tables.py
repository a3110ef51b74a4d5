"""Trials to come: the ``[[faults]]`` tables of a scenario, one trial a channel and severity, or ready faults.

A severity is an absolute figure, or a share of what the healthy channel does, resolved once against a flight.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gtmbench.bench.sensors import rms_about_mean
from gtmbench.channels import CHANNELS, sensor_list
from gtmbench.checks import keys, naming, number, shown
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, Parameter
from gtmbench.faults.registry import find_fault
from gtmbench.record import Record

_SHARE = re.compile(r"\s*([0-9]+(?:\.[0-9]+)?)\s*%\s*of\s+(\w+)\s*")


@dataclass(frozen=True, kw_only=True)
class Severity:
    """A number in the channel's unit (per second for slopes), or a share of ``of``: rms, peak or slew."""

    value: float
    of: str | None = None


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
    with naming(where):
        cls = find_fault(block.get("kind"))
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
            with naming(where):  # the fault itself knows what its parameters may be; a share can't be wrong
                fault = cls(channel=channel, onset_s=onset_s, duration_s=duration_s, **figures, **others)
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


def parse_severity(given: Any, *, per_second: bool, key: str) -> Severity:
    """Read a number, or a text such as ``"50 % of rms"``.

    Raises
    ------
    InputError
        Naming the key and what is legal there.

    Examples
    --------
    >>> parse_severity("40 % of peak", per_second=False, key="limit")
    Severity(value=0.4, of='peak')
    """
    legal = ("slew",) if per_second else ("rms", "peak")
    is_number = isinstance(given, (int, float)) and not isinstance(given, bool)
    if is_number and abs(given) < 1e9:  # neither inf nor NaN is
        return Severity(value=float(given))
    match = _SHARE.fullmatch(given) if isinstance(given, str) else None
    if match and match[2] in legal:
        return Severity(value=float(match[1]) / 100.0, of=match[2])
    texts = " or ".join(f"'20 % of {name}'" for name in legal)
    raise InputError(
        f"{key} is {shown(given)}; it must be a number in the channel's unit{' per second' * per_second}, or {texts}"
    )


def resolve(severity: Severity, reference: Record, channel: str) -> float:
    """Return a severity as an absolute figure, in the channel's unit (per second for slew).

    Shares refer to the noise-free channel with its mean removed: its RMS, its greatest magnitude (peak), or its
    greatest change from one sample to the next over the sample period (slew).
    """
    if severity.of is None:
        return severity.value
    values = reference[channel] - reference[channel].mean()
    if len(values) < 2:
        raise InputError(f"the span that severities refer to holds {len(values)} sample; give a longer one")
    measures = {
        "rms": rms_about_mean(values),
        "peak": float(np.max(np.abs(values))),
        "slew": float(np.max(np.abs(np.diff(values)))) / reference.sample_period_s,
    }
    return severity.value * measures[severity.of]

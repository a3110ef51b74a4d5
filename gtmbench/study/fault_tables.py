"""Trials to come: the ``[[faults]]`` tables of a scenario, one trial a channel and severity, or ready faults.

A ``[[faults.also]]`` table adds a fault to the trials of the table above it; ``[faults.expect.NAME]`` says what a
detector is expected to make of them. A severity is an absolute figure, or a share of what the healthy channel does,
resolved once against a flight.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from gtmbench.bench.breaking import check_faults
from gtmbench.bench.sensors import rms_about_mean
from gtmbench.checks import keys, meant, naming, number, shown, table_of, text
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.faults.parameter import Intermittent, Parameter
from gtmbench.faults.registry import find_fault
from gtmbench.values.channels import OF_OWN_RATE, SENSORS, WHOLE, axis_of, breakable_list, names_of, unit_of
from gtmbench.values.record import Record

_SHARE = re.compile(r"\s*([0-9]+(?:\.[0-9]+)?)\s*%\s*of\s+(\w+)\s*")
_SHARES = {"": ("rms", "peak"), "s": ("slew",)}  # of what a severity may be a share, by what its unit is divided by
_TIMES = ("onset_s", "duration_s", "end_s", "ramp_s", "intermittent")


@dataclass(frozen=True, kw_only=True)
class Severity:
    """A number in the parameter's unit, or a share of ``of``: rms, peak or slew."""

    value: float
    of: str | None = None

    def __str__(self) -> str:
        return f"{self.value:g}" if self.of is None else f"{100.0 * self.value:g} % of {self.of}"


@dataclass(frozen=True, kw_only=True)
class FaultSpec:
    """One trial to come: a fault, and by name the severities that a file gives, which may be relative to the flight.

    In `fault` a relative severity is its share (0.5 for half the RMS) until `build` puts the figure there. `also` are
    further faults of the same trial, in the order in which they act after it; `expect` is what is expected of
    detectors, by their names.
    """

    fault: Fault
    severities: dict[str, Severity] = field(default_factory=dict)
    also: tuple[FaultSpec, ...] = ()
    expect: Mapping[str, Expectation] = field(default_factory=dict)

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

    @property
    def text(self) -> str:
        """The trial in a line: ``drift of p, slope 0.05, from 300 s``, and so on for the others."""
        severities = "".join(f", {name} {given}" for name, given in self.severities.items())
        until = "" if self.duration_s is None else f" to {self.onset_s + self.duration_s:g} s"
        own = f"{self.kind.replace('_', ' ')} of {self.channel}{severities}, from {self.onset_s:g} s{until}"
        return " + ".join([own, *(other.text for other in self.also)])

    def absolute(self, where: str) -> tuple[Fault, ...]:
        """Return the trial's faults in their order where no severity is relative, for a record without its truth."""
        for name, given in self.severities.items():
            if given.of is not None:
                raise InputError(
                    f"{where}: {name} is '{given}', and what it is a share of is only known of a flight of the bench; "
                    f"give a figure in {unit_of(self.channel)}{' per second' * (given.of == 'slew')}"
                )
        return self.fault, *(fault for other in self.also for fault in other.absolute(where))

    def faults(self, reference: Record) -> tuple[Fault, ...]:
        """Return the trial's faults in their order, relative severities resolved against a noise-free record."""
        own = build(self, {name: resolve(given, reference, self.channel) for name, given in self.severities.items()})
        return own, *(fault for other in self.also for fault in other.faults(reference))


def fault_specs(where: str, block: dict[str, Any], flight_s: float) -> list[FaultSpec]:
    """Return the trials of one table of a flight of `flight_s` seconds."""
    with naming(where):
        cls = find_fault(block.get("kind"))
    _check_keys(cls, block, ("channels", *_TIMES, "unit", "also", "expect"), where)
    specs = []
    for channel in _channels(block["channels"], block.get("unit"), where):
        also = tuple(_also(where, number, table, channel, flight_s) for number, table in _tables(block, where))
        expect = expectations(where, block.get("expect", {}), channel)
        for severities in _severities(cls.parameters(), block, where):
            fault = _fault(cls, channel, block, severities, where, flight_s)
            specs.append(FaultSpec(fault=fault, severities=severities, also=also, expect=expect))
    return specs


def _tables(block: Mapping[str, Any], where: str) -> list[tuple[int, dict[str, Any]]]:
    also = block.get("also", [])
    if not isinstance(also, list) or not all(isinstance(table, dict) for table in also):
        raise InputError(f"{where}: also is {shown(also)}; write further faults of the trial as [[faults.also]] tables")
    return list(enumerate(also, 1))


def _also(where: str, number: int, block: dict[str, Any], channel: str, flight_s: float) -> FaultSpec:
    """Return a further fault of a trial: of one channel, the trial's own where the table names none."""
    where = f"{where}, also {number}"
    with naming(where):
        cls = find_fault(block.get("kind"))
    if "channels" in block:
        raise InputError(f"{where}: a fault of [[faults.also]] has one channel, not channels; write a table for each")
    _check_keys(cls, block, ("channel", *_TIMES, "unit"), where)
    (own,) = _channels([block.get("channel", channel)], block.get("unit"), where, key="channel")
    severities, *more = _severities(cls.parameters(), block, where)
    if more:
        raise InputError(f"{where}: a list of severities would be more trials; a fault of [[faults.also]] has one")
    fault = _fault(cls, own, block, severities, where, flight_s)
    return FaultSpec(fault=fault, severities=severities)


def _check_keys(cls: type[Fault], block: Mapping[str, Any], common: Sequence[str], where: str) -> None:
    parameters = cls.parameters()
    keys(block, ["kind", *common, *(item.name for item in parameters)], where=where, there=f"a {cls.kind} has")
    needed = [item.name for item in parameters if item.is_required]
    for key in (*(name for name in ("channels", "onset_s") if name in common), *needed):
        if key not in block:
            raise InputError(f"{where}: key '{key}' is missing; a {cls.kind} needs it")


def _fault(
    cls: type[Fault],
    channel: str,
    block: Mapping[str, Any],
    severities: Mapping[str, Severity],
    where: str,
    flight_s: float,
) -> Fault:
    """Return a fault as a table states it; a relative severity as its share."""
    onset_s = number(f"{where}: onset_s", block["onset_s"], 0.0, flight_s)
    settings = {item.name: block[item.name] for item in cls.parameters() if item.name in block and not item.is_severity}
    for item in cls.parameters():
        if item.is_channel and item.name in settings:
            _breakable(f"{where}: {item.name}", [settings[item.name]])
    figures: dict[str, Any] = {name: given.value for name, given in severities.items()}
    with naming(where):  # the fault itself knows what its parameters may be; a share can't be wrong
        fault = cls(
            channel=channel,
            onset_s=onset_s,
            duration_s=_duration_s(block, onset_s, where),
            ramp_s=block.get("ramp_s", 0.0),
            intermittent=_intermittent(block),
            **figures,
            **settings,
        )
        check_faults([fault], flight_s, beside=OF_OWN_RATE)
    return fault


def _duration_s(block: Mapping[str, Any], onset_s: float, where: str) -> float | None:
    if "duration_s" in block and "end_s" in block:
        raise InputError(f"{where}: both duration_s and end_s are given; keep one")
    if "end_s" in block:
        return round(number(f"{where}: end_s", block["end_s"], onset_s, above=True) - onset_s, 9)
    return number(f"{where}: duration_s", block["duration_s"], 0.0, above=True) if "duration_s" in block else None


def _intermittent(block: Mapping[str, Any]) -> Intermittent | None:
    if "intermittent" not in block:
        return None
    written = "{period_s = ..., duty = ...}"
    table = keys(
        table_of("intermittent", block["intermittent"], written),
        ["period_s", "duty", "jitter", "seed", "by_chance"],
        where="intermittent",
    )
    for key in ("period_s", "duty"):
        if key not in table:
            raise InputError(
                f"intermittent: key '{key}' is missing; it is {written}, and perhaps jitter, seed and by_chance"
            )
    return Intermittent(**table)


def spec_of(faults: Fault | Sequence[Fault], flight_s: float = math.inf) -> FaultSpec:
    """Return the trial of a ready fault, of whatever class, or of several, in a flight of `flight_s` seconds.

    >>> from gtmbench.faults.kinds.replacing import Jam
    >>> spec_of(Jam(channel="p", onset_s=300.0)).kind
    'jam'
    """
    first, *also = faults if isinstance(faults, (tuple, list)) and faults else [faults]
    if not isinstance(first, Fault) or not isinstance(getattr(first, "kind", None), str):
        raise InputError(f"{shown(first)} is no fault with a kind; give one such as Jam(channel='p', onset_s=300)")
    _breakable(f"{first.kind}: channels", list(dict.fromkeys(first.reads)))
    number(f"{first.kind}: onset_s", first.onset_s, 0.0, flight_s)
    check_faults([first], flight_s, beside=OF_OWN_RATE)
    return FaultSpec(fault=first, also=tuple(spec_of(other, flight_s) for other in also))


def build(spec: FaultSpec, severities: dict[str, float]) -> Fault:
    """Return the fault of a trial, its severities now absolute."""
    figures: dict[str, Any] = {**severities}
    return replace(spec.fault, **figures)


def _channels(channels: Any, unit: Any, where: str, *, key: str = "channels") -> tuple[str, ...]:
    names = _breakable(f"{where}: {key}", channels)
    for name in names:
        if unit is not None and unit != unit_of(name):
            raise InputError(
                f"{where}: unit is {shown(unit)}, but channel '{name}' is in {unit_of(name)}; convert the figures"
            )
    return names


def _breakable(where: str, channels: Any) -> tuple[str, ...]:
    """Return channels that can break, of a GPS and a magnetometer, too: whether the flight has these, others check."""
    return breakable_list(where, channels, beside=OF_OWN_RATE)


def _severities(parameters: tuple[Parameter, ...], block: Mapping[str, Any], where: str) -> list[dict[str, Severity]]:
    """Return every combination of the severities given."""
    combinations: list[dict[str, Severity]] = [{}]
    for item in parameters:
        if item.is_severity and item.name in block:
            key = f"{where}: {item.name}"
            given = block[item.name] if isinstance(block[item.name], list) else [block[item.name]]
            if not given:
                raise InputError(f"{key} is an empty list; give a number or a list of them")
            steps = [parse_severity(entry, item, key=key) for entry in given]
            combinations = [{**others, item.name: step} for others in combinations for step in steps]
    return combinations


def parse_severity(given: Any, item: Parameter, *, key: str) -> Severity:
    """Read a severity: a number, or a text such as ``"50 % of rms"`` of one in the channel's unit.

    >>> from gtmbench.faults.kinds.shaping import Saturation
    >>> (limit,) = Saturation.parameters()
    >>> parse_severity("40 % of peak", limit, key="limit")
    Severity(value=0.4, of='peak')
    """
    legal = _SHARES.get(item.per, ()) if item.unit is None else ()
    is_number = isinstance(given, (int, float)) and not isinstance(given, bool)
    if is_number and abs(given) < 1e9:  # neither inf nor NaN is
        return Severity(value=float(given))
    match = _SHARE.fullmatch(given) if isinstance(given, str) else None
    if match and match[2] in legal:
        return Severity(value=float(match[1]) / 100.0, of=match[2])
    texts = [_in_words(item), *(f"'20 % of {name}'" for name in legal)]
    raise InputError(f"{key} is {shown(given)}; it must be {' or '.join(texts)}")


def _in_words(item: Parameter) -> str:
    """Say what kind of number a severity is."""
    if item.unit is not None:
        return f"a number in {item.unit}" if item.unit else "a number"
    per = " per second" if item.per_second else f" per {item.per}" if item.per else ""
    return f"a number in the channel's unit{per}"


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


_KEYS = ("detect_within_s", "isolate_as", "kind", "undetectable_because")
_OWN = {
    "channel": "the channel that the trial breaks",
    "axis": "it, or the other sensor of its axis",
    "sensor": "the sensor that it is a part of: magnetometer, gps, accelerometers",
}
_KNOWN = (*SENSORS, *WHOLE, *_OWN)


@dataclass(frozen=True, kw_only=True)
class Expectation:
    """What a detector is expected to make of a trial."""

    detect_within_s: float | None = None  # from the onset to the alarm; None: however late
    # isolate_as: one sensor: it is named in the end. Several: what the detector is left with lies within. Empty:
    # whatever
    isolate_as: tuple[str, ...] = ()
    kind: str | None = None  # the kind of fault in the end; None: whatever
    undetectable_because: str = ""  # why no alarm is expected after the onset; empty where one is


def expectations(where: str, given: Any, channel: str) -> dict[str, Expectation]:
    """Return what is expected of each detector of a trial that breaks a channel, by the detectors' names.

    >>> expectations("faults, table 1", {"C": {"detect_within_s": 2.0, "isolate_as": "channel"}}, "p")["C"].isolate_as
    ('p',)
    """
    tables = table_of(f"{where}: expect", given, "[faults.expect.DETECTOR]")
    return {name: _expectation(f"{where}: expect.{name}", table, channel) for name, table in tables.items()}


def _expectation(where: str, given: Any, channel: str) -> Expectation:
    table = keys(table_of(where, given, "[faults.expect.DETECTOR]"), _KEYS, where=where, there="there are")
    if not table:
        raise InputError(f"{where} expects nothing; give {', '.join(_KEYS[:-1])}, or {_KEYS[-1]}")
    if "undetectable_because" in table:
        if len(table) > 1:
            others = ", ".join(key for key in table if key != "undetectable_because")
            raise InputError(f"{where}: undetectable_because and {others} contradict each other; keep one")
        return Expectation(undetectable_because=text(f"{where}: undetectable_because", table["undetectable_because"]))
    within = table.get("detect_within_s")
    return Expectation(
        detect_within_s=None if within is None else number(f"{where}: detect_within_s", within, 0.0, above=True),
        isolate_as=_sensors(f"{where}: isolate_as", table["isolate_as"], channel) if "isolate_as" in table else (),
        kind=text(f"{where}: kind", table["kind"]) if "kind" in table else None,
    )


def _sensors(where: str, given: Any, channel: str) -> tuple[str, ...]:
    """Return the sensors that are meant, each once."""
    named = given if isinstance(given, list) else [given]
    for name in named:
        if not isinstance(name, str) or name not in _KNOWN:
            own = ", ".join(f"'{word}' ({meaning})" for word, meaning in _OWN.items())
            known = f"there are {', '.join((*SENSORS, *WHOLE))}, and {own}{meant(name, _KNOWN)}"
            raise InputError(f"{where}: no sensor {shown(name)}; {known}")
    if not named:
        raise InputError(f"{where} is an empty list; name a sensor, or those that it may be left between")
    words = {"channel": (channel,), "axis": axis_of(channel), "sensor": names_of(channel)[-1:]}
    return tuple(dict.fromkeys(sensor for name in named for sensor in words.get(name, (name,))))

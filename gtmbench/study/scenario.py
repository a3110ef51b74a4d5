"""Scenarios: what is flown, what breaks, what watches; read from a TOML file, every key checked."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields
from pathlib import Path
from typing import Any

from gtmbench.bench.faults import FAULTS
from gtmbench.channels import CHANNELS, SENSORS
from gtmbench.errors import InputError
from gtmbench.files import shipped_scenarios
from gtmbench.study.severity import Figure, parse_severity

Span = tuple[float, float]
_LARGEST_FILE_BYTES = 1_000_000


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
    """Everything of a scenario but its faults. Scenarios with equal setups share flight, operator and threshold."""

    aircraft: str = "gtm"
    excitation: str = "dissertation"
    duration_s: float = 500.0
    snr: float | None = None
    noise: str | None = None
    seed: int = 1
    severity_reference_s: Span = (25.0, 300.0)
    operator: OperatorSetup = field(default_factory=OperatorSetup)
    alarm: AlarmSetup = field(default_factory=AlarmSetup)


@dataclass(frozen=True, kw_only=True)
class FaultSpec:
    """One trial to come: a kind of fault on a channel, its severities still relative where the file says so."""

    kind: str
    channel: str
    onset_s: float
    duration_s: float | None
    severities: dict[str, Figure]


@dataclass(frozen=True, kw_only=True)
class Scenario:
    """A scenario file: a setup and the faults to try in it, one trial each."""

    name: str
    title: str
    setup: Setup
    faults: tuple[FaultSpec, ...]


def load_scenario(source: str | Path) -> Scenario:
    """Read a scenario from a file, or one of the package's by name (``drift``).

    Raises
    ------
    InputError
        Naming file, key, what was given and what is legal.
    """
    shipped = shipped_scenarios()
    path = shipped.get(str(source), Path(source))
    if not path.is_file() and path.parent.name == "faults" and path.stem in shipped:
        path = shipped[path.stem]  # faults/drift.toml, away from a checkout
    if not path.is_file():
        raise InputError(f"no scenario '{source}'; give a TOML file or one of {', '.join(shipped)}")
    if path.stat().st_size > _LARGEST_FILE_BYTES:
        raise InputError(f"{path} has {path.stat().st_size} bytes; a scenario has at most {_LARGEST_FILE_BYTES}")
    try:
        table = tomllib.loads(path.read_text(encoding="utf-8"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, RecursionError, OSError) as error:
        raise InputError(f"{path} isn't a readable TOML file: {error}") from error
    try:
        return _scenario(path.stem, table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _scenario(name: str, table: dict[str, Any]) -> Scenario:
    title = table.pop("title", name)
    blocks = table.pop("faults", None)
    if not isinstance(title, str):
        raise InputError(f"title is {title!r}; it must be a text")
    if not isinstance(blocks, list) or not blocks or not all(isinstance(block, dict) for block in blocks):
        raise InputError("no [[faults]] given; add at least one table with kind, channels and onset_s")
    setup = _setup(table)
    faults = tuple(spec for number, block in enumerate(blocks, 1) for spec in _faults(number, block, setup))
    return Scenario(name=name, title=title, setup=setup, faults=faults)


def _setup(table: dict[str, Any]) -> Setup:
    if "snr" in table and "noise" in table:
        raise InputError("both snr and noise are given; keep one")
    if "noise" not in table:
        table.setdefault("snr", 50.0)  # the dissertation's
    values = _checked(Setup, table, "")
    setup = Setup(**values)
    _inside(setup.duration_s, "operator.identify_s", setup.operator.identify_s)
    _inside(setup.duration_s, "alarm.threshold_s", setup.alarm.threshold_s)
    _inside(setup.duration_s, "severity_reference_s", setup.severity_reference_s)
    if setup.alarm.healthy_records < 1:
        raise InputError("alarm.healthy_records is 0; at least 1 healthy record must be watched for false alarms")
    for name in (*setup.operator.inputs, *setup.operator.outputs):
        if name not in SENSORS:
            raise InputError(f"operator: no sensor channel '{name}'; there are {', '.join(SENSORS)}")
    return setup


def _inside(duration_s: float, key: str, span: Span) -> None:
    if not 0.0 <= span[0] < span[1] <= duration_s:
        raise InputError(
            f"{key} is {list(span)}, but the flight lasts {duration_s:g} s (duration_s); give a start before the end, "
            "both within it"
        )


def _checked(of: type, table: Mapping[str, Any], prefix: str) -> dict[str, Any]:
    """Return a table's values as a dataclass wants them, or say which key is wrong and how."""
    known = {item.name: item for item in fields(of)}
    for key in table:
        if key not in known:
            where = f" in [{prefix.rstrip('.')}]" if prefix else ""
            raise InputError(f"unknown key '{key}'{where}; there are {', '.join(known)}")
    return {key: _value(known[key], value, prefix + key) for key, value in table.items()}


_TABLES: dict[str, type] = {"operator": OperatorSetup, "alarm": AlarmSetup}


def _value(item: Field[Any], value: Any, key: str) -> Any:
    kind = str(item.type)
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if item.name in _TABLES:
        if not isinstance(value, dict):
            raise InputError(f"{key} is {value!r}; it must be a table, [{key}]")
        return _TABLES[item.name](**_checked(_TABLES[item.name], value, f"{key}."))
    if kind.startswith("str") and isinstance(value, str):
        return value
    if kind.startswith("int") and number and isinstance(value, int) and 0 <= value < 2**31:
        return value
    if kind.startswith("float") and number and 0.0 <= value < 1e9:
        return float(value)
    if kind == "Span" and _is_list_of(value, (int, float)) and len(value) == 2:
        return (float(value[0]), float(value[1]))
    if kind.startswith("tuple") and value and _is_list_of(value, str):
        return tuple(value)
    wanted = {
        "str": "a text",
        "int": "a whole number, 0 or more",
        "flo": "a number, 0 or more",
        "Spa": "two times in seconds, [start, end]",
        "tup": "a list of channel names",
    }[kind[:3]]
    raise InputError(f"{key} is {value!r}; it must be {wanted}")


def _is_list_of(value: Any, kind: type | tuple[type, ...]) -> bool:
    return isinstance(value, list) and all(isinstance(entry, kind) and not isinstance(entry, bool) for entry in value)


def _faults(number: int, block: dict[str, Any], setup: Setup) -> list[FaultSpec]:
    """Return the trials of one [[faults]] table: every channel with every severity given."""
    where = f"faults, table {number}"
    kind = block.pop("kind", None)
    if kind not in FAULTS:
        raise InputError(f"{where}: kind is {kind!r}; there are {', '.join(FAULTS)}")
    own = FAULTS[kind].severities()
    legal = ["kind", "channels", "onset_s", "duration_s", "unit", *(item.name for item in own)]
    for key in block:
        if key not in legal:
            raise InputError(f"{where}: unknown key '{key}'; a {kind} has {', '.join(legal)}")
    for key in ("channels", "onset_s", *(item.name for item in own)):
        if key not in block:
            raise InputError(f"{where}: key '{key}' is missing; a {kind} needs it")
    channels = block["channels"]
    if not _is_list_of(channels, str) or not channels:
        raise InputError(f"{where}: channels is {channels!r}; it must be a list of channel names")
    onset, duration = _time(block, "onset_s", where), _time(block, "duration_s", where)
    if onset is None or onset > setup.duration_s:
        raise InputError(f"{where}: onset_s is {onset:g}, after the flight's end at {setup.duration_s:g} s")
    trials: list[dict[str, Figure]] = [{}]
    for item in own:
        given = block[item.name] if isinstance(block[item.name], list) else [block[item.name]]
        steps = [parse_severity(entry, per_second=item.per_second, key=f"{where}: {item.name}") for entry in given]
        trials = [{**trial, item.name: step} for trial in trials for step in steps]
    for channel in channels:
        _check_fault_channel(channel, block.get("unit"), where)
    return [
        FaultSpec(kind=kind, channel=channel, onset_s=onset, duration_s=duration, severities=trial)
        for channel in channels
        for trial in trials
    ]


def _time(block: dict[str, Any], key: str, where: str) -> float | None:
    value = block.get(key)
    if value is None and key not in block:
        return None
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value < 1e9:
        raise InputError(f"{where}: {key} is {value!r}; it must be a time in seconds, 0 or more")
    return float(value)


def _check_fault_channel(channel: str, unit: Any, where: str) -> None:
    if channel not in SENSORS:
        raise InputError(f"{where}: no sensor channel '{channel}'; there are {', '.join(SENSORS)}")
    if unit is not None and unit != CHANNELS[channel].unit:
        raise InputError(
            f"{where}: unit is {unit!r}, but channel '{channel}' is in {CHANNELS[channel].unit}; convert the figures"
        )

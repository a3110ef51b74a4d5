"""Banks: which sensors are predicted from which channels, and how the residuals are judged; read from a small TOML."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from gtmbench.checks import keys, meant, naming, number, shown, table_of, text
from gtmbench.detectors.statistics.statistic import STATISTICS, Statistic
from gtmbench.errors import InputError
from gtmbench.files.shipped import read_shipped, shipped_banks
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, kinematic, raw_needs, reproduces
from gtmbench.values.channels import ATTITUDE, GYROS

_MOST_RESIDUALS = 50  # a bank's file with more is a mistake: an aircraft has some ten sensors
# what is left of a gyro's fault is slow beside the references' noise: it takes longer filters
_DRIVEN_WHITENING_S = 1.5


@dataclass(frozen=True, kw_only=True)
class ResidualSpec:
    """One residual of a bank: a sensor, and what predicts it; or a pseudo output, and sensors that predict it."""

    output: str  # the sensor, or a pseudo input that reproduces one (`is_early`)
    inputs: tuple[str, ...]  # channels and pseudo inputs
    # look_back_s, look_ahead_s: r Ts and d Ts; a bank is written in seconds, so that it fits any sample rate
    look_back_s: float
    look_ahead_s: float

    @property
    def is_early(self) -> bool:
        """Whether it raises alarms only, and diagnoses stand on others: its output isn't a sensor."""
        return self.output in PSEUDO_INPUTS

    @property
    def is_kinematic(self) -> bool:
        """Whether kinematics say what its sensor should read: a pseudo input reads as the sensor."""
        return any(reproduces(name, self.output) for name in self.inputs)

    @property
    def is_fixed_by_physics(self) -> bool:
        """Whether input and output read the same motion and nothing else, so that only lag and noise are open."""
        return len(self.inputs) == 1 and kinematic(self.inputs[0], self.output)

    @property
    def source(self) -> str:
        """The sensor whose residual its alarms are put down to: the output, or what a pseudo output reproduces."""
        return (PSEUDO_INPUTS[self.output].reproduces or self.output) if self.is_early else self.output

    @cached_property
    def needs(self) -> frozenset[str]:
        """The measured channels that enter it."""
        return frozenset(raw for name in (self.output, *self.inputs) for raw in raw_needs(name))


@dataclass(frozen=True, kw_only=True)
class Bank:
    """Residuals, the test that judges them, and the sensors that it may suspect.

    Attributes
    ----------
    name, title : str
    residuals : tuple of ResidualSpec
    suspects : tuple of str
        Sensors whose fault may explain an alarm.
    statistic : Statistic
    whitening_s : float
        Length of the whitening filters.
    attitude_from_gyros : bool
        Whether the attitude comes from a filter that the gyros drive, as on most aircraft. A gyro's fault then bends
        it, and shows only as the filter's references pull the attitude back. After an alarm no residual that uses the
        attitude is evidence of another fault. `driven` turns any bank into such a bank.

    Examples
    --------
    >>> import gtmbench as gb
    >>> bank = gb.load_bank("C")
    >>> [(spec.output, spec.inputs) for spec in bank.residuals][0]
    ('p', ('p_att',))
    >>> bank.suspects, bank.affects("phi")
    (('p', 'q', 'r', 'phi', 'theta', 'psi'), ('p', 'q', 'r'))
    """

    name: str
    title: str
    residuals: tuple[ResidualSpec, ...]
    suspects: tuple[str, ...]
    statistic: Statistic = field(default_factory=Statistic)
    whitening_s: float = 0.3
    attitude_from_gyros: bool = False

    @cached_property
    def channels(self) -> tuple[str, ...]:
        """The measured channels that it needs, outputs first."""
        outputs = [spec.output for spec in self.diagnostic]
        inputs = sorted({raw for spec in self.residuals for raw in spec.needs} - set(outputs))
        return (*outputs, *inputs)

    @cached_property
    def diagnostic(self) -> tuple[ResidualSpec, ...]:
        """The residuals that a diagnosis uses: all but the early ones."""
        return tuple(spec for spec in self.residuals if not spec.is_early)

    @property
    def kinematic(self) -> tuple[str, ...]:
        """The sensors that kinematics predict."""
        return tuple(spec.output for spec in self.residuals if spec.is_kinematic)

    @property
    def predicts_gyros_from_attitude(self) -> bool:
        """Whether it needs to know if the gyros drive the attitude."""
        return any(spec.output in GYROS and self.sources(spec) & set(ATTITUDE) for spec in self.residuals)

    def sources(self, spec: ResidualSpec) -> set[str]:
        """Return the measured channels that a residual's prediction uses."""
        return {raw for name in spec.inputs for raw in raw_needs(name)}

    def affects(self, channel: str) -> tuple[str, ...]:
        """Return the residuals (by output, an early one by its source) that a fault of a channel enters."""
        return tuple(dict.fromkeys(spec.source for spec in self.residuals if channel in spec.needs))

    def check_channels(self, channels: Iterable[str]) -> None:
        """Refuse a record that lacks a channel, and suggest what to use instead."""
        check_channels(f"bank {self.name}", self.channels, channels)

    def driven(self) -> Bank:
        """Return the bank for an attitude that the gyros drive.

        The remainder of a gyro's fault is slow compared with the references' noise, so whitening takes longer filters.

        >>> load_bank("C").driven().attitude_from_gyros
        True
        """
        return replace(self, attitude_from_gyros=True, whitening_s=max(self.whitening_s, _DRIVEN_WHITENING_S))


def check_channels(name: str, needed: Iterable[str], channels: Iterable[str]) -> None:
    """Refuse channels that lack one which a detector needs, and say which bank could be used instead."""
    there = set(channels)
    missing = [channel for channel in needed if channel not in there]
    if missing:
        usable = [bank for bank in shipped_banks() if set(load_bank(bank).channels) <= there]
        raise InputError(
            f"{name} needs {', '.join(needed)}, and {', '.join(missing)} isn't there; with these channels can be used: "
            f"{', '.join(f'bank {bank}' for bank in usable) or 'no bank'}{meant(missing[0], there - set(needed))}"
        )


def load_bank(source: str | Path) -> Bank:
    """Read a bank from a TOML file, or one of the package's by name (``C``).

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
    >>> bank = gb.load_bank("C")
    >>> bank.channels
    ('p', 'q', 'r', 'phi', 'psi', 'theta')
    >>> bank.affects("psi")
    ('p', 'q', 'r')
    """
    path, table = read_shipped(source, "bank", shipped_banks())
    with naming(path):
        return bank_of(text("its name", path.stem), table)


def bank_of(name: str, table: dict[str, Any]) -> Bank:
    """Return a bank from its tables, every key checked."""
    keys(table, ("title", "suspects", "whitening_s", "attitude_from_gyros", "residuals", "alarm"))
    blocks = table.get("residuals")
    if not isinstance(blocks, list) or not 0 < len(blocks) <= _MOST_RESIDUALS:
        raise InputError(f"a bank has 1 to {_MOST_RESIDUALS} tables [[residuals]], each with output and inputs")
    specs: list[ResidualSpec] = []
    for i, block in enumerate(blocks, 1):
        specs.append(_residual_spec(f"residuals, table {i}", block, specs))
    _check_early(specs)
    bank = Bank(
        name=name,
        title=text("title", table.get("title", name)),
        residuals=tuple(specs),
        suspects=_names("suspects", table.get("suspects", [spec.output for spec in specs])),
        statistic=_statistic(table.get("alarm", {})),
        whitening_s=number("whitening_s", table.get("whitening_s", 0.3), 0.0, 60.0),
        attitude_from_gyros=_flag("attitude_from_gyros", table.get("attitude_from_gyros", False)),
    )
    idle = [channel for channel in bank.suspects if not bank.affects(channel)]
    if idle:
        raise InputError(f"suspects: a fault of {shown(idle[0])} enters no residual; leave it out")
    return bank


def bank_table(bank: Bank) -> dict[str, Any]:
    """Return a bank as the tables that `bank_of` reads."""
    test = bank.statistic
    return {
        "title": bank.title,
        "suspects": list(bank.suspects),
        "whitening_s": bank.whitening_s,
        "attitude_from_gyros": bank.attitude_from_gyros,
        "residuals": [
            {
                "output": spec.output,
                "inputs": list(spec.inputs),
                "look_back_s": spec.look_back_s,
                "look_ahead_s": spec.look_ahead_s,
            }
            for spec in bank.residuals
        ],
        "alarm": {
            "statistic": test.name,
            "windows_s": list(test.windows_s),
            "baseline_s": test.baseline_s,
            "shift": test.shift,
            "ratio": test.ratio,
            "two_sided": test.two_sided,
        },
    }


def _residual_spec(where: str, block: Any, before: list[ResidualSpec]) -> ResidualSpec:
    if not isinstance(block, dict):
        raise InputError(f"{where} is {shown(block)}; it must be a table")
    keys(block, ("output", "inputs", "look_back_s", "look_ahead_s"), where=where)
    output = text(f"{where}: output", block.get("output"))
    inputs = _names(f"{where}: inputs", block.get("inputs"))
    if any(spec.output == output for spec in before):
        raise InputError(f"{where}: output '{output}' has a residual already; name every sensor once")
    for name in inputs:
        shared = sorted(raw_needs(output) & raw_needs(name))
        if shared:
            raise InputError(f"{where}: '{name}' holds '{shared[0]}' itself; it would predict itself")
    return ResidualSpec(
        output=output,
        inputs=inputs,
        look_back_s=number(f"{where}: look_back_s", block.get("look_back_s", 0.1), 0.0, 60.0),
        look_ahead_s=number(f"{where}: look_ahead_s", block.get("look_ahead_s", 0.1), 0.0, 60.0),
    )


def _check_early(specs: list[ResidualSpec]) -> None:
    """Refuse a pseudo output without a residual of its sensor that every fault enters: alarms couldn't be diagnosed."""
    sensors = {spec.output: spec.needs for spec in specs if not spec.is_early}
    for i, spec in enumerate(specs, 1):
        if not spec.is_early:
            continue
        if spec.source not in sensors:
            raise InputError(
                f"residuals, table {i}: output '{spec.output}' isn't a sensor; give a measured channel, or beside it "
                "the residual of the sensor that it reproduces, which its alarms are diagnosed by"
            )
        lacking = sorted(spec.needs - sensors[spec.source])
        if lacking:
            raise InputError(
                f"residuals, table {i}: output '{spec.output}' alarms for faults of {', '.join(lacking)}, which don't "
                f"enter the residual of {spec.source} that they are diagnosed by"
            )


def _statistic(given: Any) -> Statistic:
    legal = ("statistic", "window_s", "windows_s", "baseline_s", "shift", "ratio", "two_sided")
    alarm = keys(table_of("alarm", given), legal, where="alarm")
    default = Statistic()
    name = alarm.get("statistic", default.name)
    if not isinstance(name, str) or name not in STATISTICS:
        raise InputError(
            f"alarm.statistic is {shown(name)}; there are {', '.join(STATISTICS)}{meant(name, STATISTICS)}"
        )
    windows = alarm.get("windows_s", alarm.get("window_s", list(default.windows_s)))
    windows = windows if isinstance(windows, list) else [windows]
    if not 0 < len(windows) <= 30:
        raise InputError(f"alarm.windows_s holds {len(windows)} windows; give 1 to 30")
    return Statistic(
        name=name,
        windows_s=tuple(number("alarm.windows_s", value, 0.0, 3600.0, above=True) for value in windows),
        baseline_s=number("alarm.baseline_s", alarm.get("baseline_s", default.baseline_s), 1.0, 86400.0),
        shift=number("alarm.shift", alarm.get("shift", default.shift), 1e-3, 100.0),
        ratio=number("alarm.ratio", alarm.get("ratio", default.ratio), 1.001, 1e6),
        two_sided=_flag("alarm.two_sided", alarm.get("two_sided", name != "energy")),
    )


def _flag(key: str, value: Any) -> bool:
    if not isinstance(value, bool):
        raise InputError(f"{key} is {shown(value)}; give true or false")
    return value


def _names(key: str, value: Any) -> tuple[str, ...]:
    if not isinstance(value, list) or not 0 < len(value) <= 50 or not all(isinstance(name, str) for name in value):
        raise InputError(f"{key} is {shown(value)}; it must be a list of channel names")
    for name in value:
        if value.count(name) > 1:
            raise InputError(f"{key}: '{name}' stands there twice; name every channel once")
    return tuple(text(key, name) for name in value)

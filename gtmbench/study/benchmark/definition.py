"""The definition of a benchmark: its groups, splits, flights and faults, all of which follow from one frozen file.

A *group* is one aircraft, one sample rate and one kind of sensors; detectors learn and get their thresholds by group.
A *split* says what flights are for: `learn` to train on, `calibration` to set thresholds on, `development` to look at,
`test` to be judged on. `private` is a second test split, whose seeds follow from a secret.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.checks import keys, naming
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import find_fault
from gtmbench.files.disk import check_size, is_file, no_such
from gtmbench.files.seals import digest_of
from gtmbench.files.shipped import read_shipped, shipped_benchmarks

GTMBENCH_1 = "gtmbench-1"
LEARN, CALIBRATION, DEVELOPMENT, TEST, PRIVATE = "learn", "calibration", "development", "test", "private"
HEALTHY_SPLITS, JUDGED_SPLITS = (LEARN, CALIBRATION), (DEVELOPMENT, TEST, PRIVATE)
_GROUP_SEEDS = 100_000  # between the first flights of two groups
_CUT = (0.4, 0.8)  # where a flight is cut short, of its length
_SHORTEST_SECRET, _LARGEST_SECRET = 16, 65536  # bytes


@dataclass(frozen=True, kw_only=True)
class Group:
    """Flights of one aircraft, with one sample rate and one kind of sensors.

    Attributes
    ----------
    name, aircraft, sensors : str
    rate_hz : float
    excitations, noise : tuple of str
        Which the flights have in turn.
    lost : tuple of float
        Share of rows that are missing, in turn.
    learn, calibration, development, test : int
        Healthy flights of the split; a private split has as many as the test.
    every_fault : int
        Every so many faults of the definition's list is flown.
    twins : int
        Flights that are there twice, once cut short.
    """

    name: str
    aircraft: str
    sensors: str = "ideal"
    rate_hz: float = 100.0
    excitations: tuple[str, ...]
    noise: tuple[str, ...] = ("white",)
    lost: tuple[float, ...] = (0.0,)
    learn: int
    calibration: int
    development: int = 0
    test: int
    every_fault: int
    twins: int

    @property
    def sample_period_s(self) -> float:
        """Ts, in seconds."""
        return 1.0 / self.rate_hz

    def healthy(self, split: str) -> int:
        """Return how many healthy flights a split has."""
        return int(getattr(self, TEST if split == PRIVATE else split))


@dataclass(frozen=True, kw_only=True)
class Flight:
    """One flight of the benchmark: all that it takes to fly it, and its fault.

    Attributes
    ----------
    id : str
        The name of its files, which tells nothing of it.
    group : Group
    split : str
    seed : int
        Of excitation, turbulence, noise and losses.
    excitation, noise : str
    lost : float
    rows : int
        Samples; less than its twin's where it is cut short.
    fault : Fault or None
    twin : str
        The id of the same flight in full; empty for others.
    """

    id: str
    group: Group
    split: str
    seed: int
    excitation: str
    noise: str
    lost: float
    rows: int
    fault: Fault | None = None
    twin: str = ""

    @property
    def path(self) -> str:
        """Where its files stand in a folder, without their ending."""
        return f"{self.group.name}/{self.split}/{self.id}"

    @property
    def end_s(self) -> float:
        """The time of its last sample."""
        return (self.rows - 1) * self.group.sample_period_s


@dataclass(frozen=True, kw_only=True)
class Definition:
    """A benchmark's definition.

    Attributes
    ----------
    name, title : str
    digest : str
        Of all that its file says.
    duration_s, deadline_s, false_alarms_per_hour : float
    other_rates_per_hour : tuple of float
    onset_s : (float, float)
    channels : tuple of str
    versions, seeds : mapping
    groups : tuple of Group
    faults : tuple of mapping
        Of each its kind, channel and parameters.

    Examples
    --------
    >>> full, quick = load_definition(), load_definition(quick=True)
    >>> len(full.faults), [group.name for group in full.groups], [group.name for group in quick.groups]
    (138, ['gtm', 'gtm-chain', 'gtm-50hz', 'gtm-25hz', 'A320', 'c172p'], ['gtm'])
    >>> flights = list(full.flights(TEST))
    >>> healthy = [flight for flight in flights if flight.fault is None and not flight.twin]
    >>> sum(flight.rows * flight.group.sample_period_s for flight in healthy) / 3600.0 > 50.0
    True
    """

    name: str
    title: str
    digest: str
    duration_s: float
    onset_s: tuple[float, float]
    deadline_s: float
    false_alarms_per_hour: float
    other_rates_per_hour: tuple[float, ...]
    channels: tuple[str, ...]
    versions: Mapping[str, str]
    seeds: Mapping[str, int]
    groups: tuple[Group, ...]
    faults: tuple[Mapping[str, Any], ...] = field(repr=False)
    secret: bytes = field(default=b"", repr=False)

    def flights(self, split: str) -> Iterator[Flight]:
        """Yield the flights of a split, group by group, in an order that tells nothing; twins come last."""
        for number in range(len(self.groups)):
            yield from self._flights(split, number)

    def _flights(self, split: str, number: int) -> Iterator[Flight]:
        group, first = self.groups[number], self._first_seed(split, number)
        broken = self.faults[number % group.every_fault :: group.every_fault] if split in JUDGED_SPLITS else ()
        if split == DEVELOPMENT and not group.development:
            return
        draw = np.random.default_rng([first, 0])
        cases = [*broken, *[None] * group.healthy(split)]
        flights = []
        for place, case in enumerate(draw.permutation(len(cases)).tolist()):
            flights.append(self._flight(group, split, first + 1 + place, place, cases[case]))
        yield from flights
        if split in JUDGED_SPLITS:
            for place in draw.permutation(len(flights))[: group.twins].tolist():
                rows = int(draw.uniform(*_CUT) * flights[place].rows)
                yield replace(
                    flights[place], id=self._id(first, split, f"twin {place}"), rows=rows, twin=flights[place].id
                )

    def _flight(self, group: Group, split: str, seed: int, place: int, case: Mapping[str, Any] | None) -> Flight:
        turn = {name: getattr(group, name) for name in ("excitations", "noise", "lost")}
        excitation, noise, lost = (values[place % len(values)] for values in turn.values())
        return Flight(
            id=self._id(seed, split, split),
            group=group,
            split=split,
            seed=seed,
            excitation=excitation,
            noise=noise,
            lost=lost,
            rows=round(self.duration_s * group.rate_hz) + 1,
            fault=None if case is None else self._fault(case, seed),
        )

    def _fault(self, case: Mapping[str, Any], seed: int) -> Fault:
        given, cls = dict(case), find_fault(case["kind"])
        del given["kind"]
        onset_s = round(float(np.random.default_rng([seed, 1]).uniform(*self.onset_s)), 2)
        if any(each.name == "seed" for each in fields(cls)):
            given["seed"] = seed
        return cls(onset_s=onset_s, **given)

    def _first_seed(self, split: str, number: int) -> int:
        if split == PRIVATE:
            if not self.secret:
                raise InputError("a private split follows from a secret; give --private-seed FILE")
            return _whole(self.secret + f"/{number}".encode()) % 2**30
        return self.seeds[split] + number * _GROUP_SEEDS

    def _id(self, seed: int, split: str, what: str) -> str:
        """Return the name of a flight; of a private one it takes the secret to find the seed in it."""
        secret = self.secret if split == PRIVATE else b""
        return hashlib.sha256(secret + f"{self.name}/{seed}/{what}".encode()).hexdigest()[:12]

    @cached_property
    def differing(self) -> str:
        """In words: which versions differ from those that the definition names; empty where none does."""
        here = {name: version(name) for name in self.versions}
        return ", ".join(f"{name} {here[name]} for {has}" for name, has in self.versions.items() if here[name] != has)

    def check_versions(self) -> None:
        """Refuse other versions of what flies and draws than those that give the benchmark's bits.

        Raises
        ------
        InputError
        """
        if self.differing:
            raise InputError(
                f"this isn't {self.name}: there is {self.differing}; install those versions, or give --any-versions "
                f"and call the result 'not {self.name}'"
            )


def load_definition(name: str | Path = GTMBENCH_1, *, quick: bool = False) -> Definition:
    """Return a benchmark's definition by its name, or of a TOML file of the same layout.

    Parameters
    ----------
    name : str or Path
    quick : bool
        Its small version, with flights of its own.

    Raises
    ------
    InputError
        Where there is none, or the file isn't one.
    """
    path, tables = read_shipped(name, "benchmark", shipped_benchmarks())
    with naming(path):
        legal = {each.name for each in fields(Definition)} - {"digest", "secret"} | {"quick"}
        keys(tables, legal)
        try:
            return _definition(tables, quick=quick)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(f"it is no definition of a benchmark: {type(error).__name__}: {error}") from error


def _definition(tables: Mapping[str, Any], *, quick: bool) -> Definition:
    given = dict(tables)
    small = given.pop("quick", {})
    groups = [Group(**{key: _tuples(value) for key, value in group.items()}) for group in given.pop("groups")]
    if quick:
        chosen, counts = small["groups"], {key: value for key, value in small.items() if key != "groups"}
        groups = [replace(group, **counts) for group in groups if group.name in chosen]
        given |= {"name": f"{given['name']}-quick"}
    faults = tuple(case for table in given.pop("faults") for case in _cases(table))
    plain = {key: _tuples(value) for key, value in given.items()}
    return Definition(digest=digest_of(tables), groups=tuple(groups), faults=faults, **plain)


def _cases(table: Mapping[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the faults of a table: every channel with every combination of the values that it lists."""
    settings = {key: value for key, value in table.items() if key != "channels"}
    lists = {key: value if isinstance(value, list) else [value] for key, value in settings.items()}
    for channel in table["channels"]:
        for values in itertools.product(*lists.values()):
            yield {"channel": channel, **dict(zip(lists, values, strict=True))}


def _tuples(value: Any) -> Any:
    return tuple(value) if isinstance(value, list) else value


def _whole(content: bytes) -> int:
    return int.from_bytes(hashlib.sha256(content).digest()[:8], "big")


def with_secret(definition: Definition, path: Path) -> Definition:
    """Return a definition with a private split, whose seeds follow from what a file holds.

    Raises
    ------
    InputError
        If there is no such file, or what it holds could be guessed.
    """
    if not is_file(path):
        raise InputError(no_such(path))
    check_size(path, "secret", _LARGEST_SECRET)
    secret = path.read_bytes()
    if len(secret) < _SHORTEST_SECRET:
        raise InputError(
            f"{path}: {len(secret)} bytes could be guessed; write at least {_SHORTEST_SECRET} random bytes into it"
        )
    return replace(definition, secret=secret)


def secret_digest(definition: Definition) -> str:
    """Return the digest that is published before anybody sees private flights."""
    return hashlib.sha256(definition.secret).hexdigest()

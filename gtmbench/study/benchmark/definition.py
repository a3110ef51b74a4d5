"""The definition of a benchmark: its groups, splits, flights and faults, all of which follow from one frozen file.

A *group* is one aircraft, one sample rate and one kind of sensors; detectors learn and get their thresholds by group.
A *split* says what flights are for: `learn` to train on, `calibration` to set thresholds on, `development` to look at,
`test` to be judged on. `private` is a second test split, which follows from a secret.

A *case* is one fault, drawn from the ranges of a table; it is flown `repeats` times, each time on another flight. What
is drawn follows from the SHA-256 of the benchmark's name, split and group: no two sets share a flight.
"""

from __future__ import annotations

import hashlib
import hmac
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
from gtmbench.files.seals import digest_of
from gtmbench.files.shipped import read_shipped, shipped_benchmarks
from gtmbench.files.writing import check_size, is_file, no_such
from gtmbench.values.channels import ATTITUDE, GYROS

GTMBENCH_2 = "gtmbench-2"
LEARN, CALIBRATION, DEVELOPMENT, TEST, PRIVATE = "learn", "calibration", "development", "test", "private"
JUDGED_SPLITS = (DEVELOPMENT, TEST, PRIVATE)
HEALTHY, ALIKE, SINGLE, EASY, COMMON, PAIR = "healthy", "alike", "single", "easy", "common", "pair"
_CUT = (0.4, 0.8)  # where a flight is cut short, of its length
_SHORTEST_SECRET = 16  # bytes: 128 bits at least
_LATER_S = (10.0, 20.0)  # a second fault after the first


@dataclass(frozen=True, kw_only=True)
class Group:
    """Flights of one aircraft, with one sample rate and one kind of sensors."""

    name: str
    aircraft: str
    sensors: str = "ideal"
    rate_hz: float = 100.0
    # learn, calibration, development, test: healthy flights of the split; a private split has as many as the test
    learn: int
    calibration: int
    development: int = 0
    test: int
    single: int  # faults that quickness counts, each flown `repeats` times
    # easy, common, pair, alike: flights with a fault that a repeated or round reading betrays, with one cause in all
    # gyros, with two faults, and healthy ones with gusts, gaps and repeated rows that look like faults
    easy: int
    common: int
    pair: int
    alike: int
    twins: int  # flights that are there twice, once cut short

    @property
    def sample_period_s(self) -> float:
        """Ts, in seconds."""
        return 1.0 / self.rate_hz

    def healthy(self, split: str) -> int:
        """Return how many healthy flights a split has."""
        return int(getattr(self, TEST if split == PRIVATE else split))


@dataclass(frozen=True, kw_only=True)
class Flight:
    """One flight of the benchmark: all that it takes to fly it, and its faults."""

    id: str  # the name of its files, which tells nothing of it
    group: Group
    split: str
    seed: int  # of all that is drawn; 128 bits
    rows: int  # samples; less than its twin's where it is cut short
    role: str = HEALTHY  # healthy, alike, single, easy, common or pair
    case: int = -1  # which fault of the group it is a flight of; -1 but for single ones
    faults: tuple[Fault, ...] = ()
    twin: str = ""  # the id of the same flight in full; empty for others

    @property
    def path(self) -> str:
        """Where its files stand in a folder, without their ending."""
        return f"{self.group.name}/{self.split}/{self.id}"

    @property
    def end_s(self) -> float:
        """The time of its last sample."""
        return (self.rows - 1) * self.group.sample_period_s

    @property
    def onset_s(self) -> float:
        """When its first fault begins; its end where there is none."""
        return self.faults[0].onset_s if self.faults else self.end_s


@dataclass(frozen=True, kw_only=True)
class Definition:
    """A benchmark's definition.

    >>> full, quick = load_definition(), load_definition(quick=True)
    >>> [group.name for group in full.groups], [group.name for group in quick.groups]
    (['gtm', 'gtm-chain', 'gtm-50hz', 'gtm-25hz', 'A320', 'c172p'], ['gtm'])
    >>> seeds = [{flight.seed for flight in of.flights(TEST)} for of in (full, quick)]
    >>> len(seeds[0] & seeds[1])
    0
    """

    name: str
    title: str
    digest: str  # of all that its file says
    duration_s: float
    onset_s: tuple[float, float]
    deadline_s: float
    false_alarms_per_hour: float
    other_rates_per_hour: tuple[float, ...]
    repeats: int  # flights of a fault
    channels: tuple[str, ...]
    quanta: Mapping[str, float]  # the step of its readings, in its unit
    versions: Mapping[str, str]
    groups: tuple[Group, ...]
    # single, easy, common: tables of faults: kind, channels, and of each parameter a value or a range, even in the
    # logarithm
    single: tuple[Mapping[str, Any], ...] = field(repr=False)
    easy: tuple[Mapping[str, Any], ...] = field(repr=False)
    common: tuple[Mapping[str, Any], ...] = field(repr=False)
    secret: bytes = field(default=b"", repr=False)

    def flights(self, split: str) -> Iterator[Flight]:
        """Yield the flights of a split, group by group, in an order that tells nothing; twins come last."""
        for group in self.groups:
            yield from self._flights(split, group)

    def _flights(self, split: str, group: Group) -> Iterator[Flight]:
        if split == DEVELOPMENT and not group.development:
            return
        draw = np.random.default_rng(self._seed(split, group, "order"))
        kinds = [(HEALTHY, -1)] * group.healthy(split)
        if split in JUDGED_SPLITS:
            fewer = 8 if split == DEVELOPMENT else 1  # of the test's faults
            kinds += [(SINGLE, case) for case in range(group.single // fewer)] * self.repeats
            kinds += [
                (role, case) for role in (EASY, COMMON, PAIR, ALIKE) for case in range(getattr(group, role) // fewer)
            ]
        flights = [
            self._flight(split, group, place, *kinds[of])
            for place, of in enumerate(draw.permutation(len(kinds)).tolist())
        ]
        yield from flights
        if split in JUDGED_SPLITS:
            for place in draw.permutation(len(flights))[: group.twins].tolist():
                full, rows = flights[place], int(draw.uniform(*_CUT) * flights[place].rows)
                yield replace(full, id=self._id(split, full.seed, "twin"), rows=rows, twin=full.id)

    def _flight(self, split: str, group: Group, place: int, role: str, case: int) -> Flight:
        seed = self._seed(split, group, place)
        return Flight(
            id=self._id(split, seed, "flight"),
            group=group,
            split=split,
            seed=seed,
            rows=round(self.duration_s * group.rate_hz) + 1,
            role=role,
            case=case if role == SINGLE else -1,
            faults=self._faults(split, group, role, case, seed),
        )

    def _faults(self, split: str, group: Group, role: str, case: int, seed: int) -> tuple[Fault, ...]:
        """Return the faults of a case, with the onset of a flight."""
        draw = np.random.default_rng([seed, 1])
        onset_s = round(float(draw.uniform(*self.onset_s)), 2)
        if role in (SINGLE, EASY):
            return (self._fault(split, group, role, case, onset_s, seed),)
        if role == COMMON:
            first = self._fault(split, group, role, case, onset_s, seed)
            seeds = {"seed": first.seed + 1} if hasattr(first, "seed") else {}
            return first, *(replace(first, channel=name, **seeds) for name in GYROS if name != first.channel)
        if role == PAIR:
            first = self._fault(split, group, PAIR, 2 * case, min(onset_s, self.onset_s[1] - _LATER_S[1]), seed)
            second = self._fault(split, group, PAIR, 2 * case + 1, first.onset_s + float(draw.uniform(*_LATER_S)), seed)
            if axis_index(second.channel) == axis_index(first.channel):
                names = GYROS if second.channel in GYROS else ATTITUDE
                second = replace(second, channel=names[(axis_index(first.channel) + 1) % len(names)])
            return first, replace(second, onset_s=round(second.onset_s, 2))
        return ()

    def _fault(self, split: str, group: Group, role: str, case: int, onset_s: float, seed: int) -> Fault:
        """Return the fault of a case: the tables in turn, and of a table's ranges one part after the other."""
        tables = self.single if role == PAIR else getattr(self, role)
        turn = case + self.groups.index(group)
        given, part = dict(tables[turn % len(tables)]), case // len(tables)
        parts = -(-getattr(group, SINGLE if role == PAIR else role) // len(tables))
        draw = np.random.default_rng(self._seed(split, group, f"{role} {case}"))
        cls, channels = find_fault(given.pop("kind")), given.pop("channels")
        signed, first = given.pop("signed", False), True
        for key, value in given.items():
            if isinstance(value, list):
                low, high = np.log(value)
                share = (part % parts + draw.random()) / parts if first else draw.random()
                sign = draw.choice([-1.0, 1.0]) if signed and first else 1.0
                given[key], first = float(sign * np.exp(low + share * (high - low))), False
        if any(each.name == "seed" for each in fields(cls)):
            given["seed"] = seed % 2**31
        return cls(channel=str(draw.choice(channels)), onset_s=onset_s, **given)

    def _seed(self, split: str, group: Group, what: object) -> int:
        """Return 128 bits that follow from what is drawn, and in a private split from the secret, too."""
        if split == PRIVATE and not self.secret:
            raise InputError("a private split follows from a secret; give --private-seed FILE")
        secret = self.secret if split == PRIVATE else b""
        told = f"{self.name}/{split}/{group.name}/{what}".encode()
        return int.from_bytes(hmac.digest(secret, told, "sha256")[:16], "big")  # of the secret, not of its digest

    def _id(self, split: str, seed: int, what: str) -> str:
        """Return the name of a flight; of a private one it takes the secret to find the seed in it."""
        secret = self.secret if split == PRIVATE else b""
        return hashlib.sha256(secret + f"{seed}/{what}".encode()).hexdigest()[:12]

    @cached_property
    def differing(self) -> str:
        """In words: which versions differ from those that the definition names; empty where none does."""
        here = {name: version(name) for name in self.versions}
        return ", ".join(f"{name} {here[name]} for {has}" for name, has in self.versions.items() if here[name] != has)

    def check_versions(self) -> None:
        """Refuse other versions of what flies and draws than those that give the benchmark's bits."""
        if self.differing:
            raise InputError(
                f"this isn't {self.name}: there is {self.differing}; install those versions, or give --any-versions "
                f"and call the result 'not {self.name}'"
            )


def load_definition(name: str | Path = GTMBENCH_2, *, quick: bool = False) -> Definition:
    """Return a benchmark's definition by its name, or of a TOML file of the same layout.

    `quick`: its small version, with flights of its own.
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
    groups = [Group(**group) for group in given.pop("groups")]
    if quick:
        chosen, counts = small["groups"], {key: value for key, value in small.items() if key != "groups"}
        groups = [replace(group, **counts) for group in groups if group.name in chosen]
        given |= {"name": f"{given['name']}-quick"}
    plain: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in given.items()}
    return Definition(digest=digest_of(tables), groups=tuple(groups), **plain)


def axis_index(channel: str) -> int:
    """Return which axis a gyro or an angle is of: 0, 1 or 2."""
    return (GYROS if channel in GYROS else ATTITUDE).index(channel)


def with_secret(definition: Definition, path: Path) -> Definition:
    """Return a definition with a private split, whose seeds follow from what a file holds."""
    if not is_file(path):
        raise InputError(no_such(path))
    check_size(path, "secret", 65536)
    secret = path.read_bytes()
    if len(secret) < _SHORTEST_SECRET:
        raise InputError(
            f"{path}: {len(secret)} bytes could be guessed; write at least {_SHORTEST_SECRET} random bytes into it"
        )
    return replace(definition, secret=secret)


def secret_digest(definition: Definition) -> str:
    """Return the digest that is published before anybody sees private flights."""
    return hashlib.sha256(definition.secret).hexdigest()

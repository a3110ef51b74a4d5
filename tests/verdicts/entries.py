"""The corpus of verdicts as it is written down: what is flown, broken, done to the file, how it is watched, and asked.

The files are `corpus/*.toml`, one a subject; an entry is a table, `README.md` beside them describes its keys. A variant
is an entry that differs from its parent in the keys that it gives.
"""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import gtmbench as gb
from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import FAULTS
from gtmbench.values.channels import ATTITUDE, GYROS

FOLDER = Path(__file__).parent / "corpus"
SIX = (*GYROS, *ATTITUDE)
EVERY = (*SIX, "alpha", "beta", "nx", "ny", "nz", "tas", "altitude")
SETS: Mapping[str, tuple[str, ...]] = {"six": SIX, "all": EVERY, "with accelerometers": (*SIX, "nx", "ny", "nz")}
STATES = ("failed", "suspected", "not judged", "clear")
_TIMES = ("from_s", "to_s", "at_s", "onset_s", "at")  # keys that `later_s` moves


@dataclass(frozen=True, kw_only=True)
class Broken:
    """A fault of a recipe, and the number of the IMU that has it.

    Attributes
    ----------
    fault : Fault
        Its times are counted from the log's first sample, as all times of an entry.
    imu : int
        1 is the first.
    """

    fault: Fault
    imu: int = 1

    @property
    def sensor(self) -> str:
        """The sensor's name in a timeline."""
        return self.fault.channel if self.imu == 1 else f"{self.fault.channel} of IMU{self.imu}"


@dataclass(frozen=True, kw_only=True)
class Watching:
    """How an entry's log is watched.

    Attributes
    ----------
    detector : str
        ``auto``, a recipe's name, or ``ready C`` for the monitor that ships with the package.
    healthy : tuple of (start, end)
        In seconds since the log's first sample; empty where nothing is said.
    attitude : str
        As `gb.watch_log` takes it.
    judge : str or None
    limits, mapping : tuple of str
    """

    detector: str = "auto"
    healthy: tuple[tuple[float, float], ...] = ()
    attitude: str = "auto"
    judge: str | None = None
    limits: tuple[str, ...] = ()
    mapping: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class Required:
    """What is required of a sensor at one time: one of some states, and of a failure perhaps its kind.

    Attributes
    ----------
    at : float
        In seconds since the log's first sample.
    sensor : str
    state : tuple of str
    kind : str
        Of the fault that a judgement names; "" where any will do.
    """

    at: float
    sensor: str
    state: tuple[str, ...]
    kind: str = ""

    def __post_init__(self) -> None:
        unknown = set(self.state) - set(STATES)
        if unknown or not self.state:
            raise ValueError(f"{self.sensor} at {self.at:g} s: no state {', '.join(unknown) or 'is given'}")


@dataclass(frozen=True, kw_only=True)
class Entry:
    """One log, and the verdict that is required of it.

    Attributes
    ----------
    name, about : str
    seed, duration_s, excitation
        Of the flight; the seed is that of the noise, too.
    rate_hz : float
        At which sensors are sampled.
    noise : float
        As a share of the T2's.
    stand_s : float
        How long it stands before it flies.
    bumps_s : tuple of float
        When it touches the ground and flies on.
    attitude : str
        ``own``, or the name of an estimator that the gyros drive (`gtmbench.values.attitude_estimators.ESTIMATORS`).
    channels : tuple of str
        That the log has.
    faults : tuple of Broken
    done : tuple of mapping
        Done to the table, in this order; `tests.verdicts.alterations.DONE` has them.
    file : str
        How it is written; `tests.verdicts.log_files.WRITTEN` has them.
    imus : tuple of mapping
        Of a log with several: ``turned_deg`` about the vertical axis, more ``noise``, in deg/s, of each.
    clock_s : float
        The log's clock at its first sample.
    watch : Watching
    require : tuple of Required
    exit : tuple of int
        The exit codes that are right; empty where any is.
    never_clear, never_failed : tuple of str
        Sensors, over the whole log, beside what the faults require (`tests.verdicts.requirements`).
    first_line_has : tuple of str
        Each is ``a|b``: one of the words has to be in the first line.
    quick : bool
        Whether it runs in `make test`.
    xfail : str
        Which issue mends it, and why: a strict expected failure.
    xfails : tuple of str
        Which breaches that is about (`tests.verdicts.requirements.Breach`); any other fails.
    """

    name: str
    about: str
    seed: int
    duration_s: float
    excitation: str = "multisine+turbulence"
    rate_hz: float = 50.0
    noise: float = 1.0
    stand_s: float = 0.0
    bumps_s: tuple[float, ...] = ()
    attitude: str = "own"
    channels: tuple[str, ...] = SIX
    faults: tuple[Broken, ...] = ()
    done: tuple[Mapping[str, Any], ...] = ()
    file: str = "csv"
    imus: tuple[Mapping[str, Any], ...] = ({},)
    clock_s: float = 0.0
    watch: Watching = field(default_factory=Watching)
    require: tuple[Required, ...] = ()
    exit: tuple[int, ...] = ()
    never_clear: tuple[str, ...] = ()
    never_failed: tuple[str, ...] = ()
    first_line_has: tuple[str, ...] = ()
    quick: bool = False
    xfail: str = ""
    xfails: tuple[str, ...] = ("wrong name", "kind")

    @property
    def broken(self) -> tuple[str, ...]:
        """The sensors that break, each once."""
        return tuple(dict.fromkeys(each.sensor for each in self.faults))

    def with_faults(self, *faults: Fault) -> Entry:
        """Return the entry with other faults, and nothing required but what these require."""
        nothing: dict[str, Any] = {"require": (), "exit": (), "never_clear": (), "first_line_has": (), "xfail": ""}
        return replace(self, faults=tuple(Broken(fault=each) for each in faults), **nothing)


def entry(name: str) -> Entry:
    """Return the entry of a name.

    Raises
    ------
    KeyError
        Where there is none.
    """
    return {each.name: each for each in entries()}[name]


@cache
def entries() -> tuple[Entry, ...]:
    """Return all entries, in the order of the files and within them."""
    read = [each for path in sorted(FOLDER.glob("*.toml")) for each in _of_file(path)]
    twice = {each.name for each in read if [other.name for other in read].count(each.name) > 1}
    if twice:
        raise ValueError(f"entries of the same name: {', '.join(sorted(twice))}")
    return tuple(read)


def _of_file(path: Path) -> Iterator[Entry]:
    for name, table in tomllib.loads(path.read_text()).items():
        variants = table.pop("variants", [])
        try:
            yield entry_of(name, table)
            for variant in variants:
                yield entry_of(f"{name}-{variant['name']}", varied(table, variant))
        except (KeyError, TypeError, ValueError) as error:
            raise ValueError(f"{path.name}, {name}: {error}") from error


def varied(table: Mapping[str, Any], variant: Mapping[str, Any]) -> dict[str, Any]:
    """Return an entry's table with what a variant gives: its keys, then other axes, later times and larger sizes.

    >>> base = {"seed": 1, "faults": [{"kind": "bias", "channel": "p", "onset_s": 50.0, "size": 4.0}], "quick": True}
    >>> varied(base, {"name": "q", "axes": {"p": "q"}, "later_s": 5.0, "times": -0.5})
    {'seed': 1, 'faults': [{'kind': 'bias', 'channel': 'q', 'onset_s': 55.0, 'size': -2.0}]}
    """
    own = {key: value for key, value in variant.items() if key not in {"name", "axes", "later_s", "times"}}
    kept = {key: value for key, value in table.items() if key not in {"quick", "xfail", "xfails"}}
    changed: dict[str, Any] = {**kept, **own}
    axes = variant.get("axes", {})
    changed = _changed(changed, lambda _, value: axes.get(value, value))
    later_s, times = variant.get("later_s", 0.0), variant.get("times", 1.0)
    for part in ("faults", "require", "done"):
        if part in changed and part not in own:
            changed[part] = _changed(changed[part], lambda key, value: value + later_s if key in _TIMES else value)
    if "faults" in changed and "faults" not in own:
        changed["faults"] = _changed(
            changed["faults"], lambda key, value: value * times if key in {"size", "slope", "deviation"} else value
        )
    return changed


def _changed(value: Any, change: Any, key: str = "") -> Any:
    """Return a tree of tables and lists with its leaves changed."""
    if isinstance(value, Mapping):
        return {name: _changed(each, change, name) for name, each in value.items()}
    if isinstance(value, list):
        return [_changed(each, change, key) for each in value]
    return change(key, value)


def entry_of(name: str, table: Mapping[str, Any]) -> Entry:
    """Return the entry of a table."""
    known = {each.name for each in fields(Entry)} - {"name"}
    if unknown := set(table) - known:
        raise ValueError(f"no key {', '.join(sorted(unknown))}; there are {', '.join(sorted(known))}")
    told: dict[str, Any] = {
        key: tuple(value) if isinstance(value, list) else value for key, value in table.items() if key not in _READ
    }
    return Entry(name=name, **told, **{key: read(table[key]) for key, read in _READ.items() if key in table})


def fault_of(table: Mapping[str, Any]) -> Broken:
    """Return the fault of a table."""
    told = dict(table)
    imu = told.pop("imu", 1)
    return Broken(fault=FAULTS[told.pop("kind")](**told), imu=imu)


def _channels_of(value: str | Sequence[str]) -> tuple[str, ...]:
    return SETS[value] if isinstance(value, str) else tuple(value)


def _watching_of(table: Mapping[str, Any]) -> Watching:
    told: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in table.items()}
    spans = tuple((float(start_s), float(end_s)) for start_s, end_s in told.pop("healthy", ()))
    return Watching(healthy=spans, **told)


def _required_of(tables: Sequence[Mapping[str, Any]]) -> tuple[Required, ...]:
    return tuple(Required(**{**each, "state": tuple(each["state"])}) for each in tables)


_READ: Mapping[str, Any] = {
    "faults": lambda tables: tuple(map(fault_of, tables)),
    "channels": _channels_of,
    "watch": _watching_of,
    "require": _required_of,
}
READY = {"ready C": Path(gb.__file__).parent / "baselines" / "bank-C.json"}  # calibrated on twelve flights, 100 Hz

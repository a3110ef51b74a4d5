"""Baselines of ``gtmbench check``: which scenarios, how much worse is still well, and the figures of a good run."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from gtmbench.check.compare import Recorded
from gtmbench.check.figures import Value, trial_names
from gtmbench.check.rules import FORMER, KINDS, RULES
from gtmbench.check.tolerance import Tolerance, parse_tolerance
from gtmbench.checks import keys, number, shown, table_of, whole
from gtmbench.detectors.windowed_norm import SCORE
from gtmbench.errors import InputError
from gtmbench.files import is_file, read_toml
from gtmbench.shipped import shipped_baselines, shipped_scenarios
from gtmbench.study.flights import common_setup
from gtmbench.study.scenario import Scenario, load_scenario

TOLERATED = tuple(name for name, rule in RULES.items() if rule.form != "flag")
_SETTINGS = ("scenarios", "seed", "detector", "monitor", "tolerances")


@dataclass(frozen=True, kw_only=True)
class Reference:
    """A baseline: a file that says what is run, and what its figures were.

    Attributes
    ----------
    path : Path
    scenarios : tuple of Scenario
    seed : int
        Of excitation and noise: the file's, else the scenarios'.
    detector : str or None
        A name of `gtmbench list`, a bank's or a monitor's file; None: the scenarios' own operator and threshold watch.
    tolerances : mapping of str to Tolerance
        By figure.
    recorded_seed : int or None
        With which the figures were recorded; None where there are none yet.
    recorded : mapping
        The figures by kind, name and figure.
    """

    path: Path
    scenarios: tuple[Scenario, ...]
    seed: int
    detector: str | None
    tolerances: Mapping[str, Tolerance]
    recorded_seed: int | None = None
    recorded: Recorded = field(default_factory=dict, repr=False)

    @property
    def trials(self) -> list[str]:
        """The names of the trials that its scenarios make."""
        return trial_names(
            (scenario.name, spec.kind, spec.channel) for scenario in self.scenarios for spec in scenario.faults
        )

    def check_recorded(self) -> None:
        """Refuse figures that are none of what would be run: before the run, not after it.

        Raises
        ------
        InputError
            Naming what differs.
        """
        if self.recorded_seed is None:
            raise InputError(f"{self.path}: it holds no figures yet; --update records them")
        if self.recorded_seed != self.seed:
            raise InputError(
                f"{self.path}: its figures are those of seed {self.recorded_seed}, and the seed is {self.seed}; set it "
                "back, or record anew by --update"
            )
        was = self.recorded.get("trials", {})
        new = [name for name in self.trials if name not in was]
        gone = [name for name in was if name not in self.trials]
        if new:
            raise InputError(f"{self.path}: it holds no figures of trial '{new[0]}' yet; --update records them")
        if gone:
            raise InputError(
                f"{self.path}: it holds figures of trial '{gone[0]}', which isn't in its scenarios; put it back, or "
                "drop it by --update"
            )


def find_baseline(source: str) -> Path:
    """Return the path of a baseline: one of the package's by name, else a file that may not exist yet.

    >>> find_baseline("dissertation").name
    'dissertation.toml'
    """
    return shipped_baselines().get(source, Path(source))


def read_reference(path: Path) -> Reference:
    """Read a baseline from a file, every key checked.

    Raises
    ------
    InputError
        Naming file, key, what was given and what is legal.
    """
    if not is_file(path):
        raise InputError(
            f"no baseline '{str(path)[:200]}'; give one of {', '.join(shipped_baselines())}, or record one: "
            "gtmbench check FILE.toml --update"
        )
    return reference_of(path, read_toml(path, "baseline"))


def reference_of(path: Path, table: dict[str, Any]) -> Reference:
    """Return the baseline of a parsed file, every key checked; `path`: where the file stands, or will.

    Raises
    ------
    InputError
        As `read_reference`.
    """
    try:
        return _reference(path, table)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _reference(path: Path, table: dict[str, Any]) -> Reference:
    table = _upgraded(table)
    _known("", table, (*_SETTINGS, "recorded", *KINDS))
    scenarios = tuple(load_scenario(_beside(path, name)) for name in _texts("scenarios", table.get("scenarios")))
    seed = whole("seed", table["seed"]) if "seed" in table else None
    detector = table.get("detector")
    if detector is not None and not isinstance(detector, str):
        raise InputError(f"detector is {shown(detector)}; it must be a name of `gtmbench list`, or a file")
    recorded = _known("recorded", table.get("recorded", {}), ("seed",))
    return Reference(
        path=path,
        scenarios=scenarios,
        seed=common_setup(scenarios[:1], seed).seed,  # the others': when they are run
        detector=None if detector is None else _detector(path, detector),
        tolerances=_tolerances(table.get("tolerances", {})),
        recorded_seed=whole("recorded.seed", recorded["seed"]) if "seed" in recorded else None,
        recorded={kind: _groups(kind, table[kind]) for kind in KINDS if kind in table},
    )


def _upgraded(table: dict[str, Any]) -> dict[str, Any]:
    """Return the tables as they are called now: ``monitor`` is ``detector``, norms and levels are scores."""
    if not any(key in table for key in ("monitor", *FORMER)):
        return table
    if "monitor" in table and "detector" in table:
        raise InputError("both detector and monitor are given; monitor is its former name, so keep detector")
    found = {("detector" if key == "monitor" else key): value for key, value in table.items() if key not in FORMER}
    scores = dict(table_of("score", found.get("score", {})))
    for kind in FORMER:
        for name, figures in table_of(kind, table.get(kind, {})).items():
            now = SCORE if kind == "norm" else name
            if now in scores:
                raise InputError(f"both {kind}.{name} and score.{now} are given; the first is a former name, remove it")
            scores[now] = figures
    return {**found, "score": scores} if scores else found


def is_detectors_file(name: str) -> bool:
    """Whether a bank's or a monitor's file is meant, not a name."""
    return Path(name).suffix.lower() in (".toml", ".json")


def _detector(path: Path, name: str) -> str:
    """Return what watches as it is found from here: a file's path, or a name; a baseline imports no Python."""
    if is_detectors_file(name):
        return str(path.parent / name)
    if ":" in name:
        raise InputError(
            f"detector is {shown(name)}, and a baseline imports no Python; state the detector's own name, and give "
            f"--detector {name} on the command line"
        )
    return name


def _beside(path: Path, name: str) -> str | Path:
    return name if name in shipped_scenarios() else path.parent / name


def _tolerances(given: Any) -> dict[str, Tolerance]:
    stated = _known("tolerances", given, TOLERATED)
    return {name: parse_tolerance(f"tolerances.{name}", stated.get(name, RULES[name].tolerance)) for name in TOLERATED}


def _groups(kind: str, given: Any) -> dict[str, dict[str, Value]]:
    groups = {}
    for name, figures in table_of(kind, given).items():
        where = f"{kind}.{name}"
        own = _known(where, figures, KINDS[kind][1])
        groups[name] = {key: _value(f"{where}.{key}", RULES[key].form, value) for key, value in own.items()}
    return groups


def _value(where: str, form: str, given: Any) -> Value:
    if form == "flag":
        if not isinstance(given, bool):
            raise InputError(f"{where} is {shown(given)}; it must be true or false")
        return given
    if form == "count":
        return whole(where, given)
    if form == "list":
        if not isinstance(given, list):
            raise InputError(f"{where} is {shown(given)}; it must be a list of numbers")
        return tuple(_real(f"{where}[{i}]", one) for i, one in enumerate(given))
    return _real(where, given)


def _real(where: str, given: Any) -> float:
    """Return a number; nan (there is none) and inf (a threshold that nothing passes) are figures, too."""
    return given if isinstance(given, float) else number(where, given)


def _texts(where: str, given: Any) -> list[str]:
    if given is None:
        raise InputError(f"no {where} given; name those to run")
    if not isinstance(given, list) or not given or not all(isinstance(one, str) for one in given):
        raise InputError(f"{where} is {shown(given)}; it must be a list of names or files")
    return given


def _known(section: str, given: Any, legal: tuple[str, ...]) -> dict[str, Any]:
    return keys(table_of(section, given), legal, section=section)

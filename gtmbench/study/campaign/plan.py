"""What a campaign is: scenarios, the axes that multiply them, what watches; and the tasks that it comes to.

A campaign's TOML is a scenario's with three keys and four tables more: ``scenarios`` (others, by name or file),
``detectors``, ``isolate``; ``[axes]``, ``[healthy]``, ``[calibration]`` and ``[[smallest]]``. Every value of every axis
is flown with every value of the others.
"""

from __future__ import annotations

import hashlib
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

from gtmbench.checks import boolean, keys, naming, number, shown, table_of, text
from gtmbench.detectors.registry import for_data_file, is_python
from gtmbench.errors import InputError
from gtmbench.files.plain import plain
from gtmbench.files.shipped import read_shipped, shipped_campaigns
from gtmbench.study.campaign.axes import Axes, axes_of, count, fact_of_axis, flights, noise_seeds
from gtmbench.study.campaign.searches import SeveritySearch, searches_of
from gtmbench.study.campaign.task import Task, healthy_seeds, record_number
from gtmbench.study.fault_tables import FaultSpec
from gtmbench.study.flights import SEED_STEP
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.run import with_noise
from gtmbench.study.scenario import Scenario, Setup, check_aboard, load_scenario, scenario_of, setting
from gtmbench.study.trial import fault_row
from gtmbench.study.watchers import OWN

MANY = 10_000_000  # trials: nobody means more without saying so
_OWN_KEYS = ("title", "scenarios", "detectors", "isolate", "axes", "healthy", "calibration", "smallest")
CALIBRATION = CalibrationFlights(flights=12, duration_s=300.0, seed=1_000_000_001)  # those of `gtmbench run`

_ANY_FAULT = {"kind": "dropout", "channels": ["p"], "onset_s": 0.0}  # a scenario has one


@dataclass(frozen=True, kw_only=True)
class Campaign:
    """A campaign: scenarios times axes, with faults and detectors.

    Attributes
    ----------
    name, title : str
    scenarios : tuple of Scenario
        The faults and their flights; an axis replaces a scenario's own setting.
    axes : mapping of str to sequence
        Values that multiply the scenarios, by the names of `AXES`.
    healthy : mapping of str to sequence, or None
        Axes of further healthy flights; axes that it doesn't name are the campaign's.
    detectors : tuple of str
        The detectors, as a data file may name them.
    isolate : bool
        Whether detectors also isolate and diagnose, or only detect.
    calibration : CalibrationFlights
        The calibration flights of detectors that aren't tied to an excitation, once per aircraft and attitude.
    false_alarms_per_hour : float or None
        The rate to calibrate these for; None: their own.
    searches : tuple of Search
        Searches for the smallest detected faults, on every flight with faults.

    Examples
    --------
    >>> import gtmbench as gb
    >>> campaign = gb.load_campaign("ci")
    >>> campaign.flights, campaign.trials, campaign.detectors
    (2, 20, ('C', 'paper', 'dissertation'))
    """

    name: str
    title: str
    scenarios: tuple[Scenario, ...]
    axes: Mapping[str, Sequence[object]] = field(default_factory=dict)
    healthy: Mapping[str, Sequence[object]] | None = None
    detectors: tuple[str, ...] = (OWN,)
    isolate: bool = True
    calibration: CalibrationFlights = CALIBRATION
    false_alarms_per_hour: float | None = None
    searches: tuple[SeveritySearch, ...] = ()

    def watched_by(self, detectors: Sequence[str]) -> Campaign:
        """Return the campaign with further detectors.

        As in a study, scenarios that state neither snr nor noise have the T2's noise if any detector but their own
        operator watches.
        """
        everyone = tuple(dict.fromkeys((*self.detectors, *detectors)))
        others = any(detector != OWN for detector in everyone)
        scenarios = tuple(with_noise(each) if others else each for each in self.scenarios)
        return replace(self, detectors=everyone, scenarios=scenarios)

    def tasks(self) -> Iterator[Task]:
        """Yield the tasks, one a flight, in a fixed order: the first axis varies slowest."""
        numbers = itertools.count()
        for setup, faults in self._setups():
            for breaking, axes in self._blocks():
                for flown in flights(setup, axes):
                    yield Task(
                        number=next(numbers),
                        setup=flown,
                        faults=tuple(faults) if breaking else (),
                        noise_seeds=tuple(noise_seeds(axes)),
                        isolate=self.isolate,
                        searches=self.searches if breaking else (),
                    )

    def _setups(self) -> list[tuple[Setup, list[tuple[str, FaultSpec]]]]:
        """Return the setups that differ, and all that breaks on the flights of each."""
        found: list[tuple[Setup, list[tuple[str, FaultSpec]]]] = []
        for scenario in self.scenarios:
            own = next((faults for setup, faults in found if setup == scenario.setup), None)
            if own is None:
                found.append((scenario.setup, own := []))
            own += [(scenario.name, spec) for spec in scenario.faults]
        return found

    def _blocks(self) -> list[tuple[bool, Axes]]:
        """Return the axes of flights on which something breaks, and of those on which nothing does."""
        breaks = self.searches or any(one.faults for one in self.scenarios)
        blocks: list[tuple[bool, Axes]] = [(True, self.axes)] if breaks else []
        return blocks + ([] if self.healthy is None else [(False, {**self.axes, **self.healthy})])

    @property
    def flights(self) -> int:
        """The number of flights, which is the number of tasks."""
        return sum(count(axes) for _, axes in self._blocks()) * len(self._setups())

    @property
    def trials(self) -> int:
        """The number of faults that every detector is tried on, without healthy records."""
        return sum(len(scenario.faults) for scenario in self.scenarios) * self._broken_records()

    @property
    def searches_made(self) -> int:
        """The number of searches for every detector."""
        return len(self.searches) * self._broken_records() * len(self._setups())

    @property
    def search_trials(self) -> int:
        """The greatest number of trials of these searches; each is one row."""
        return sum(search.trials for search in self.searches) * self._broken_records() * len(self._setups())

    def _broken_records(self) -> int:
        """Return how many records are broken, of each setup."""
        return sum(count(axes) * len(noise_seeds(axes)) for breaks, axes in self._blocks() if breaks)

    @property
    def records(self) -> int:
        """The number of healthy records that every detector watches."""
        return sum(
            count(axes) * len(healthy_seeds(setup, noise_seeds(axes)))
            for setup, _ in self._setups()
            for _, axes in self._blocks()
        )

    @property
    def aircraft(self) -> tuple[str, ...]:
        """Every aircraft that is flown."""
        return tuple(dict.fromkeys(aircraft for aircraft, _ in self.told_apart))

    @property
    def told_apart(self) -> tuple[tuple[str, str], ...]:
        """Every pair of aircraft and attitude; detectors are calibrated for each."""
        flown = [
            pair
            for _, axes in self._blocks()
            for setup in (scenario.setup for scenario in self.scenarios)
            for pair in itertools.product(
                axes.get("aircraft", (setup.aircraft,)), axes.get("attitude", (setup.attitude,))
            )
        ]
        return tuple(dict.fromkeys(flown))

    def facts(self) -> dict[str, object]:
        """Return everything that determines the rows, as plain values."""
        return {
            "name": self.name,
            "title": self.title,
            "scenarios": {
                scenario.name: {"setup": scenario.setup.facts, "faults": [_fact(spec) for spec in scenario.faults]}
                for scenario in self.scenarios
            },
            "axes": {name: fact_of_axis(values) for name, values in self.axes.items()},
            "healthy": None if self.healthy is None else {n: fact_of_axis(v) for n, v in self.healthy.items()},
            "detectors": list(self.detectors),
            "isolate": self.isolate,
            "searches": [[search.text, _fact(search.mildest), _fact(search.severest)] for search in self.searches],
            "calibration": self.calibration.provenance() | {"false_alarms_per_hour": self.false_alarms_per_hour},
            "aircraft": {name: _digest(Path(name)) for name in self.aircraft if Path(name).is_dir()},
        }

    def check_kept_apart(self) -> None:
        """Refuse calibration flights among the flights of the test.

        Raises
        ------
        InputError
            Naming the seed.
        """
        known = range(self.calibration.seed, self.calibration.seed + self.calibration.flights)
        for setup, _ in self._setups():
            for _, axes in self._blocks():
                records = [0, 1, *map(record_number, healthy_seeds(setup, noise_seeds(axes)))]
                seeds = axes.get("seed", (setup.seed,))
                spans = [seeds] if isinstance(seeds, range) else [range(seed, seed + 1) for seed in seeds]
                for span, record in itertools.product(spans, records):  # record 0's noise has the flight's own seed
                    first = max(span[0], known[0] - SEED_STEP * record)
                    if first <= min(span[-1], known[-1] - SEED_STEP * record):
                        raise InputError(
                            f"seed {first} is one of calibration's, {known[0]} to {known[-1]} (or its noise is): what "
                            "was calibrated on is no test; give calibration.seed another first one"
                        )


def load_campaign(source: str | Path, *, detectors: Sequence[str] = ()) -> Campaign:
    """Read a campaign from a file, or one of the package's by name (``ci``).

    Parameters
    ----------
    source : str or Path
    detectors : sequence of str
        They watch in addition to its own.

    Raises
    ------
    InputError
        Naming file, key, what was given and what is legal.

    Examples
    --------
    >>> import gtmbench as gb
    >>> campaign = gb.load_campaign("dissertation")
    >>> campaign.flights, campaign.trials, campaign.detectors
    (1, 15, ('dissertation',))
    """
    path, table = read_shipped(source, "campaign", shipped_campaigns())
    with naming(path):
        campaign = _campaign(path.stem, table)
    return campaign.watched_by(detectors)


def _campaign(name: str, table: dict[str, Any]) -> Campaign:
    keys(table, [*_OWN_KEYS, *(item.name for item in fields(Setup)), "faults"])
    own = {key: table.pop(key) for key in _OWN_KEYS if key in table}
    title = text("title", own.get("title", name))
    axes = axes_of("axes", own.get("axes", {}))
    healthy = axes_of("healthy", own["healthy"]) if "healthy" in own else None
    nothing_breaks = healthy is not None or "smallest" in own
    scenarios = _scenarios(name, title, own.get("scenarios", []), table, only_healthy=nothing_breaks)
    detectors = _names("detectors", own.get("detectors", [OWN]))
    for python in filter(is_python, detectors):
        for_data_file(python)  # refuses it
    calibration, rate = _calibration(own.get("calibration", {}))
    campaign = Campaign(
        name=name,
        title=title,
        scenarios=scenarios,
        axes=axes,
        healthy=healthy,
        detectors=detectors,
        isolate=boolean("isolate", own.get("isolate", True)),
        calibration=replace(
            calibration,
            attitude_late_s=_shared(scenarios, "attitude_late_s"),
            sensors=_shared(scenarios, "sensors"),
            others=_shared(scenarios, "others"),
        ),
        false_alarms_per_hour=rate,
        searches=_searches(scenarios, own),
    )
    campaign.check_kept_apart()
    return campaign


def _scenarios(name: str, title: str, named: Any, table: dict[str, Any], *, only_healthy: bool) -> tuple[Scenario, ...]:
    """Return the scenarios that a campaign names, and the one that its own keys make."""
    others = [load_scenario(source) for source in _names("scenarios", named, least=0)]
    twice = [other.name for other in others if [one.name for one in others].count(other.name) > 1]
    if twice:
        raise InputError(f"two scenarios have the name '{twice[0]}'; rename one file")
    if "faults" in table:
        return (*others, scenario_of(name, {"title": title, **table}))
    if others and table:
        raise InputError(
            f"{next(iter(table))} stands beside scenarios, which have their own; give it in their files or in [axes]"
        )
    if others:
        return tuple(others)
    if not only_healthy:
        raise InputError(
            "nothing would break: name scenarios = [...], or add [[faults]] or [[smallest]] (or [healthy] for that "
            "alone)"
        )
    stated = scenario_of(name, {"title": title, **table, "faults": [_ANY_FAULT]})
    return (replace(stated, faults=()),)


def _searches(scenarios: Sequence[Scenario], table: Mapping[str, Any]) -> tuple[SeveritySearch, ...]:
    shortest_s = min(scenario.setup.duration_s for scenario in scenarios)
    searches = searches_of(table["smallest"], shortest_s) if "smallest" in table else ()
    for scenario in scenarios:
        check_aboard(scenario.setup, [search.mildest for search in searches])
    return searches


def _calibration(given: Any) -> tuple[CalibrationFlights, float | None]:
    table = table_of("calibration", given)
    keys(table, ["flights", "duration_s", "excitation", "seed", "false_alarms_per_hour"], section="calibration")
    stated = {name: value for name, value in table.items() if name != "false_alarms_per_hour"}
    rate = table.get("false_alarms_per_hour")
    with naming("calibration"):
        if "excitation" in stated:
            setting("excitation", stated["excitation"])
        return (
            replace(CALIBRATION, **stated),
            None if rate is None else number("false_alarms_per_hour", rate, 1e-9, 1e3),
        )


def _shared(scenarios: Sequence[Scenario], key: str) -> Any:
    """Return a setting of all flights, which those that detectors are calibrated on have, too."""
    given = sorted({getattr(scenario.setup, key) for scenario in scenarios}, key=str)
    if len(given) > 1:
        said = "[gps] or [magnetometer] differ" if key == "others" else f"{key} is {given[0]} and {given[1]}"
        raise InputError(f"{said} in its scenarios; detectors are calibrated for one: split them")
    return given[0]


def _names(key: str, given: Any, least: int = 1) -> tuple[str, ...]:
    if not isinstance(given, list) or len(given) < least or not all(isinstance(name, str) for name in given):
        raise InputError(f"{key} is {shown(given)}; it must be a list of names or files")
    twice = [name for name in given if given.count(name) > 1]
    if twice:
        raise InputError(f"{key} names '{twice[0]}' twice")
    return tuple(given)


# ---- facts ----


def _fact(spec: FaultSpec) -> dict[str, Any]:
    """Say of a trial to come all that its rows hang on."""
    given = {name: str(severity) for name, severity in spec.severities.items()}
    return {**plain(fault_row(spec.fault)), "given": given, "also": [_fact(other) for other in spec.also]}


def _digest(folder: Path) -> str:
    """Return a digest of an aircraft of somebody's own."""
    digest = hashlib.sha256()
    for path in sorted(path for path in folder.iterdir() if path.is_file()):
        digest.update(path.name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]

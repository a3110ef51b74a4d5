"""A task: one flight, with all of its faults and detectors. What it does stands in one function, `rows_of`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.channels import COMMANDS, unit_of
from gtmbench.checks import one_line
from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.detectors.protocol import Detector, Monitor, is_ready, is_recipe
from gtmbench.errors import GtmbenchError
from gtmbench.progress import counted, silent
from gtmbench.record import Record
from gtmbench.study.campaign.rows import COLUMNS, Row
from gtmbench.study.campaign.searches import Search, search_row
from gtmbench.study.fault_tables import FaultSpec
from gtmbench.study.flights import Flown, fly_setup
from gtmbench.study.run import watched
from gtmbench.study.scenario import Setup
from gtmbench.study.score import altered_share, false_alarms, score
from gtmbench.study.trial import Injection

Watchers = Mapping[str, Detector | Monitor]  # by name: monitors, and recipes that are tied to their flight
_TIE = 1e-9  # seconds


@dataclass(frozen=True, kw_only=True)
class Task:
    """One flight of a campaign.

    Attributes
    ----------
    number : int
    setup : Setup
        What is flown.
    faults : tuple of (str, FaultSpec)
        What breaks, one trial each, with the name of its scenario.
    noise_seeds : tuple of int
        The healthy readings that are broken, numbered from 1 on: 1 is what `gtmbench run` breaks.
    isolate : bool
        Whether it is asked what failed.
    searches : tuple of Search
        For the smallest faults that are detected, on the records that are broken.
    """

    number: int
    setup: Setup
    faults: tuple[tuple[str, FaultSpec], ...]
    noise_seeds: tuple[int, ...] = (1,)
    isolate: bool = True
    searches: tuple[Search, ...] = ()


def rows_of(task: Task, watchers: Watchers) -> list[Row]:
    """Fly once, and return a row a detector and healthy record, and one a detector and trial or search.

    What goes wrong is told in the rows that it spoils, and in no others.

    Examples
    --------
    >>> from gtmbench.study.scenario import AlarmSetup
    >>> setup = Setup(duration_s=60.0, noise="t2", snr=None, alarm=AlarmSetup(healthy_records=1))
    >>> from gtmbench.study.calibration import prepared
    >>> (row,) = rows_of(Task(number=0, setup=setup, faults=()), {"none": prepared(lambda record: [])})
    >>> row["detector"], row["noise_seed"], row["false_alarms"], round(3600 * row["armed_hours"])
    ('none', 1, 0, 35)
    """
    commands = any(name in COMMANDS for watcher in watchers.values() for name in watcher.channels)
    flown = _tried(fly_setup, task.setup, commands, counted(silent, 2))
    monitors = {name: _tried(_ready, watcher, flown) for name, watcher in watchers.items()}
    judge = _judged if task.isolate else _detected
    rows = []
    for noise_seed in healthy_seeds(task.setup, task.noise_seeds):
        about = {**_about(task), "noise_seed": noise_seed}
        healthy = _tried(_sensed, flown, noise_seed)
        for name, monitor in monitors.items():
            rows.append({**about, "detector": name, **_cells(_tried(_quiet, monitor, healthy, task.setup))})
        for scenario, spec in task.faults if noise_seed in task.noise_seeds else ():
            broken = _tried(_broken, flown, scenario, spec, healthy)
            fault = {**about, **_of_fault(scenario, spec), **_severity(broken)}
            for name, monitor in monitors.items():
                verdict = _tried(judge, monitor, healthy, broken, task.setup)
                rows.append({**fault, "detector": name, **_cells(verdict)})
        for search in task.searches if noise_seed in task.noise_seeds else ():
            sought = {**about, **_of_search(search)}
            for name, monitor in monitors.items():
                found = _tried(_searched, search, flown, monitor, healthy)
                rows.append({**sought, "detector": name, **_cells(found)})
    return rows


def healthy_seeds(setup: Setup, noise_seeds: Sequence[int]) -> tuple[int, ...]:
    """Return the noise seeds of the records that are watched healthy: those that are broken, and a scenario's others.

    >>> healthy_seeds(Setup(), [1, 9])
    (1, 2, 3, 4, 5, 9)
    """
    first = noise_seeds[0]
    return tuple(sorted({*range(first, first + setup.alarm.healthy_records), *noise_seeds}))


def record_number(noise_seed: int) -> int:
    """Return which of a flight's records (`Flown.sensed`) has a noise seed; 0 and 1 are for calibration.

    >>> record_number(1)
    2
    """
    return noise_seed + 1


class _Failed(str):
    """What went wrong, in a line."""

    __slots__ = ()


def _tried(work: Callable[..., Any], *given: Any) -> Any:
    """Return what some work makes of what is given, or what went wrong: in it, or in what it was given."""
    failed = next((one for one in given if isinstance(one, _Failed)), None)
    if failed is not None:
        return failed
    try:
        return work(*given)
    except MemoryError:  # not this trial's fault, and another time it may go well
        raise
    except GtmbenchError as error:
        return _Failed(one_line(str(error)))
    except Exception as error:  # somebody's own detector or fault may do anything
        return _Failed(one_line(f"{type(error).__name__}: {error}"))


def _cells(found: Any) -> Row:
    return {"error": str(found)} if isinstance(found, _Failed) else found


def _ready(watcher: Detector | Monitor, flown: Flown) -> Monitor:
    """Return a monitor; a recipe that is tied to its flight's excitation learns from that flight, other noise."""
    if is_recipe(watcher):
        return watcher.calibrate([flown.sensed(0), flown.sensed(1)])
    assert is_ready(watcher)
    return watcher


def _sensed(flown: Flown, noise_seed: int) -> Record:
    return flown.sensed(record_number(noise_seed))


def _broken(flown: Flown, scenario: str, spec: FaultSpec, healthy: Record) -> Injection:
    return flown.broken(scenario, spec, healthy)


def _quiet(monitor: Monitor, healthy: Record, setup: Setup) -> Row:
    """Say what a monitor made of a healthy record."""
    watch = watched(monitor, healthy, setup)
    peak = max((score.peak() for score in watch.scores.values()), default=None)
    return {"false_alarms": len(false_alarms(watch)), "armed_hours": watch.armed_hours, "peak_ratio": peak}


def _searched(search: Search, flown: Flown, monitor: Monitor, healthy: Record) -> Row:
    start_s = min(flown.setup.alarm.watch_from_s, healthy.end_s)
    return search_row(search, flown, monitor, healthy.between(start_s, healthy.end_s))


def _judged(monitor: Monitor, healthy: Record, broken: Injection, setup: Setup) -> Row:
    """Hold all that a monitor says of a broken record against the truth."""
    watch = watched(monitor, broken.record, setup)
    verdict = score(watch, fault=broken.injected, also=broken.also, healthy=healthy, broken=broken.record)
    row = {name: value for name, value in vars(verdict).items() if name in COLUMNS}
    return {**row, "candidates": " ".join(verdict.candidates)}


def _detected(monitor: Monitor, healthy: Record, broken: Injection, setup: Setup) -> Row:
    """Say only whether and when there was an alarm: a bank's first doesn't wait for what is said of it."""
    if not isinstance(monitor, BankMonitor) or not np.isfinite(broken.record.matrix(monitor.channels)).all():
        judged = _judged(monitor, healthy, broken, setup)  # of missing samples a bank's scores alone don't tell
        return {name: value for name, value in judged.items() if name in _OF_DETECTION}
    start_s = min(setup.alarm.watch_from_s, broken.record.end_s)
    alarms = bank_alarms(monitor, broken.record.between(start_s, broken.record.end_s))
    faults = (broken.injected, *broken.also)
    onset_s = min(fault.onset_s for fault in faults)
    first = next((alarm for alarm in alarms if alarm.time_s >= onset_s - _TIE), None)
    return {
        "detected": first is not None,
        "alarm_time_s": None if first is None else round(first.time_s, 9),
        "detection_delay_s": None if first is None else round(first.time_s - onset_s, 9),
        "look_ahead_s": round(monitor.look_ahead_s, 9),
        "altered_share": altered_share(faults, healthy, broken.record),
        "false_alarms": sum(alarm.time_s < onset_s - _TIE for alarm in alarms),
    }


_OF_DETECTION = (
    "detected",
    "alarm_time_s",
    "detection_delay_s",
    "look_ahead_s",
    "peak_ratio",
    "altered_share",
    "false_alarms",
)


def _about(task: Task) -> Row:
    """Say what is flown."""
    setup = vars(task.setup)
    names = ("aircraft", "excitation", "altitude_ft", "tas_kt", "duration_s", "seed")
    return {"task": task.number, **{name: setup[name] for name in names}}


def _of_fault(scenario: str, spec: FaultSpec) -> Row:
    """Say what breaks, as the scenario has it."""
    name, given = next(iter(spec.severities.items()), (None, None))
    return {
        "scenario": scenario,
        "fault": spec.kind,
        "channel": spec.channel,
        "severity_name": name,
        "severity_given": None if given is None else str(given),
        "unit": unit_of(spec.channel),
        "what": spec.text,
        "onset_s": min(spec.onset_s, *(other.onset_s for other in spec.also), spec.onset_s),
    }


def _of_search(search: Search) -> Row:
    """Say what is searched for."""
    mildest, severest = search.bounds
    return {
        "fault": search.mildest.kind,
        "channel": search.mildest.channel,
        "severity_name": search.parameter,
        "severity_given": f"{mildest} to {severest}",
        "unit": unit_of(search.mildest.channel),
        "what": search.text,
        "onset_s": search.mildest.onset_s,
        "mildest": mildest.value,
        "severest": severest.value,
        "severity_of": mildest.of,
    }


def _severity(broken: Injection | _Failed) -> Row:
    """Say the first severity as a figure: of a share, what it came to on this flight."""
    figures = {} if isinstance(broken, _Failed) else broken.severity
    return {"severity": next(iter(figures.values()), None)}

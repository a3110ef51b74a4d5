"""A task: one flight, with all of its faults and detectors. What it does stands in one function, `rows_of`."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

from gtmbench.bench.loop_flight import departed_s
from gtmbench.checks import one_line
from gtmbench.detectors.protocol import Detector, Monitor, Watch, is_ready, is_recipe
from gtmbench.detectors.tried_faults import FAR, Detection, trials_on
from gtmbench.errors import GtmbenchError
from gtmbench.faults.fault import Fault
from gtmbench.files.plain import Row
from gtmbench.jobs.progress import counted, silent
from gtmbench.study.campaign.rows import COLUMNS, crossings
from gtmbench.study.campaign.searches import SeveritySearch, search_row
from gtmbench.study.fault_tables import FaultSpec
from gtmbench.study.flights import Flown, fly_setup
from gtmbench.study.run import watched
from gtmbench.study.scenario import Setup
from gtmbench.study.score import altered_share, false_alarms, score
from gtmbench.study.trial import InjectedFaults
from gtmbench.study.watchers import Watchers, need_commands
from gtmbench.values.channels import unit_of
from gtmbench.values.record import Record


@dataclass(frozen=True, kw_only=True)
class Task:
    """One flight of a campaign."""

    number: int
    setup: Setup  # what is flown
    faults: tuple[tuple[str, FaultSpec], ...]  # what breaks, one trial each, with the name of its scenario
    # the healthy readings that are broken, numbered from 1 on: 1 is what `gtmbench run` breaks
    noise_seeds: tuple[int, ...] = (1,)
    isolate: bool = True  # whether it is asked what failed
    searches: tuple[SeveritySearch, ...] = ()  # for the smallest faults that are detected, on the broken records


def rows_of(task: Task, watchers: Watchers) -> list[Row]:
    """Fly once, and return a row a detector and healthy record, and one a detector and trial or search.

    What goes wrong is told in the rows that it spoils, and in no others.

    >>> from gtmbench.study.scenario import AlarmSetup
    >>> setup = Setup(duration_s=60.0, noise="t2", snr=None, alarm=AlarmSetup(healthy_records=1))
    >>> from gtmbench.detectors.registry import prepared
    >>> (row,) = rows_of(Task(number=0, setup=setup, faults=()), {"none": prepared(lambda record: [])})
    >>> row["detector"], row["noise_seed"], row["false_alarms"], round(3600 * row["armed_hours"])
    ('none', 1, 0, 35)
    """
    flown = _tried(fly_setup, task.setup, need_commands(watchers), counted(silent, 2))
    monitors = {name: _tried(_ready, watcher, flown) for name, watcher in watchers.items()}
    rows = []
    for noise_seed in healthy_seeds(task.setup, task.noise_seeds):
        about = {**_about(task), "noise_seed": noise_seed}
        healthy = _tried(_sensed, flown, noise_seed)
        quiet = {name: _tried(watched, monitor, healthy, task.setup) for name, monitor in monitors.items()}
        judges = {name: _tried(_judge, watch, flown, task) for name, watch in quiet.items()}
        rows += [{**about, "detector": name, **_cells(_tried(_healthy, watch))} for name, watch in quiet.items()]
        for scenario, spec in task.faults if noise_seed in task.noise_seeds else ():
            broken = _tried(_Broken, flown, scenario, spec, noise_seed)
            fault = {**about, **_of_fault(scenario, spec), **_severity(broken)}
            for name in monitors:
                verdict = _tried(lambda judge, broken: judge(broken), judges[name], broken)
                rows.append({**fault, "detector": name, **_cells(verdict)})
        for search in task.searches if noise_seed in task.noise_seeds else ():
            sought = {**about, **_of_search(search)}
            for name, watch in quiet.items():
                found = _tried(search_row, search, flown, watch, record_number(noise_seed))
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


class _Broken:
    """A trial's faults, and the record with them: made where somebody looks at it."""

    def __init__(self, flown: Flown, scenario: str, spec: FaultSpec, noise_seed: int) -> None:
        self._flown, self._scenario, self._spec = flown, scenario, spec
        self._number = record_number(noise_seed)
        self.faults = flown.faults(spec)

    @cached_property
    def record(self) -> tuple[InjectedFaults, Record]:
        """The broken record, and what it would have been without."""
        return self._flown.broken(self._scenario, self._spec, self._number)


def _healthy(watch: Watch) -> Row:
    """Say what a monitor made of a healthy record."""
    peak = max((score.peak() for score in watch.scores.values()), default=None)
    return {"false_alarms": len(false_alarms(watch)), "armed_hours": watch.armed_hours, "peak_ratio": peak}


def _judge(quiet: Watch, flown: Flown, task: Task) -> Callable[[_Broken], Row]:
    """Return what is asked of a monitor on a record with faults: everything, or only whether and when it alarms."""
    begun = getattr(quiet.monitor, "begun", None)
    more = {} if begun is None else {"begun": begun(quiet)}
    judge = partial(_judged, quiet.monitor, task.setup, more)
    if task.isolate:
        return judge
    if flown.is_in_loop:
        return lambda broken: _of_detection(judge(broken))
    trials = trials_on(quiet.monitor, quiet.record)

    def detected(broken: _Broken) -> Row:
        fault, *also = broken.faults
        before = fault.onset_s <= quiet.record.start_s  # it may begin before anybody watches
        if also or before or flown.bends(broken.faults):
            return _of_detection(judge(broken))
        return _detected(trials.detection(fault), fault, quiet)

    return detected


def _judged(monitor: Monitor, setup: Setup, more: Mapping[str, Any], broken: _Broken) -> Row:
    """Hold all that a monitor says of a broken record against the truth. `more`: that its `watch` takes."""
    injection, healthy = broken.record
    watch = watched(monitor, injection.record, setup, **more)
    verdict = score(watch, fault=injection.injected, also=injection.also, healthy=healthy, broken=injection.record)
    row = {name: value for name, value in vars(verdict).items() if name in COLUMNS}
    said = {"candidates": " ".join(verdict.candidates), "departure_time_s": departed_s(injection.events)}
    return {**row, **said, **crossings(watch, verdict.onset_s)}


def _detected(detection: Detection, fault: Fault, quiet: Watch) -> Row:
    """Say only whether and when there was an alarm."""
    alarm_s, healthy = detection.alarm_s, quiet.record
    broken = {part.channel: part.array(healthy) for part in fault.parts}
    return {
        "detected": alarm_s is not None,
        "alarm_time_s": alarm_s,
        "detection_delay_s": None if alarm_s is None else round(alarm_s - fault.onset_s, 9),
        "look_ahead_s": round(quiet.monitor.look_ahead_s, 9),
        "peak_ratio": detection.peak_ratio,
        "altered_share": altered_share([fault], healthy, broken),
        "false_alarms": len(false_alarms(quiet, fault.onset_s)),
    }


def _of_detection(judged: Row) -> Row:
    told = {name: value for name, value in judged.items() if name in _OF_DETECTION}
    return told | {"peak_ratio": min(judged["peak_ratio"], FAR)}


_OF_DETECTION = (
    "detected",
    "alarm_time_s",
    "detection_delay_s",
    "look_ahead_s",
    "peak_ratio",
    "altered_share",
    "false_alarms",
    "departure_time_s",
)


def _about(task: Task) -> Row:
    """Say what is flown."""
    setup = vars(task.setup)
    names = ("aircraft", "excitation", "attitude", "altitude_ft", "tas_kt", "duration_s", "seed")
    return {"task": task.number, **{name: setup[name] for name in names}, "closed_loop": task.setup.is_in_loop}


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


def _of_search(search: SeveritySearch) -> Row:
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


def _severity(broken: _Broken | _Failed) -> Row:
    """Say the first severity as a figure: of a share, what it came to on this flight."""
    figures = {} if isinstance(broken, _Failed) else broken.faults[0].severities
    return {"severity": next(iter(figures.values()), None)}

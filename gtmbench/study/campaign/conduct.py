"""A campaign at work: its tasks on processes of this machine, one shard of them, or on a Dask cluster, into parts.

Whoever conducts it writes the parts; processes and workers only make rows. So nothing but the folder has to be kept,
and it doesn't matter who ends when. Detectors are calibrated once an aircraft and attitude, and their files stand with
the parts.
"""

from __future__ import annotations

import hashlib
import itertools
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.bench.loop import found_controller
from gtmbench.checks import naming
from gtmbench.detectors.base import FunctionDetector
from gtmbench.detectors.monitor_file import kind_of, load_monitor, save_monitor
from gtmbench.detectors.protocol import Detector, Monitor, is_ready, is_recipe, with_provenance
from gtmbench.detectors.registry import as_detector
from gtmbench.detectors.statistics.thresholds import Luck
from gtmbench.errors import InputError
from gtmbench.faults.registry import loaded_faults
from gtmbench.imports import digests_of, files_of
from gtmbench.jobs.parts import Parts, Shard, hold, parts_in, waiting_alone
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.workers import Workers, versions
from gtmbench.study.campaign.plan import MANY, Campaign, load_campaign
from gtmbench.study.campaign.rows import table_of
from gtmbench.study.campaign.task import Task, rows_of
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.run import knowing
from gtmbench.study.scenario import Setup
from gtmbench.study.watchers import OWN, Watchers, check_watchers, is_tied, own_detector
from gtmbench.values.channels import COMMANDS, SENSORS
from gtmbench.values.record import Record

if TYPE_CHECKING:
    import pandas as pd
    import pyarrow as pa


WHAT = "campaign"
_MOST_PARTS = 1000  # of a folder: a part costs 5 kB and a few milliseconds however many flights it holds


def campaign(
    source: str | Path | Campaign,
    *,
    out: str | Path,
    detectors: Sequence[str] = (),
    jobs: int = 1,
    resume: bool = False,
    progress: Progress = silent,
) -> pd.DataFrame:
    """Run a campaign, and return a row a trial and detector, and one a healthy record and detector.

    Parameters
    ----------
    source : str, Path or Campaign
        A TOML file, or the name of one of the package's (``ci``).
    out : str or Path
        The folder of its parts, one a flight (of more than a thousand flights, several), each written when finished.
    detectors : sequence of str
        They watch in addition to its own, as `find_detector` takes them.
    jobs : int
        Processes. The caller's main module is imported by each of them, so a script needs its
        ``if __name__ == "__main__":``.
    resume : bool
        Continue the run in the folder.
    progress : callable
        Called with the step, the number done and the total.

    Raises
    ------
    GtmbenchError
        As `conduct`. A failed trial is a row with its `error`.

    Examples
    --------
    >>> import tempfile
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     rows = gb.campaign("dissertation", out=f"{folder}/out")
    >>> trials = rows[rows["fault"].notna()]
    >>> len(trials), int(trials["detected"].sum()), int(rows["false_alarms"].sum())
    (15, 15, 0)
    """
    meant = source if isinstance(source, Campaign) else load_campaign(source)
    return (
        conduct(meant.watched_by(detectors), Path(out), jobs=jobs, resume=resume, yes=True, progress=progress)
        .read()
        .to_pandas()
    )


def conduct(
    campaign: Campaign,
    out: Path,
    *,
    jobs: int = 1,
    shard: Shard | None = None,
    scheduler: str | None = None,
    tls: Path | None = None,
    resume: bool = False,
    yes: bool = False,
    progress: Progress = silent,
) -> Parts:
    """Fly, break and watch what isn't in the folder yet, and return its parts.

    `out`: the folder of the parts; made where there is none.
    `shard`: only these tasks; other shards may be at work in the folder at the same time.
    `scheduler`: the address of a Dask scheduler whose workers do the tasks instead.
    `tls`: a folder with ca.pem, cert.pem and key.pem, for a scheduler at tls://.
    `yes`: whether more than ten million trials are meant.
    Raises InputError if the campaign can't be meant, or the folder is of another one, or in use.
    """
    detectors = named(campaign)
    check_size(campaign, len(detectors.names), yes=yes)
    workers = Workers(processes=jobs, scheduler=scheduler, tls=tls, files=_files(campaign, detectors))
    workers.check()
    facts = {
        "campaign": campaign.facts(),
        "flights": campaign.flights,
        "versions": versions(),
        "python": digests_of(workers.files),
    }
    a_part = flights_a_part(campaign.flights)
    tasks = -(-campaign.flights // a_part)
    with parts_in(out, what=WHAT, tasks=tasks, facts=facts, resume=resume, shard=shard) as begun:
        parts, monitors = calibrated(campaign, detectors, begun, processes=jobs, progress=progress)
        todo = parts.todo(shard)
        wanted = frozenset(todo)
        grouped = itertools.groupby(campaign.tasks(), lambda task: task.number // a_part)
        flights = (list(flights) for part, flights in grouped if part in wanted)
        progress("flights", 0, len(todo) * a_part)
        for finished, (place, rows) in enumerate(workers.completed(partial(_rows, detectors, monitors), flights), 1):
            parts.write(todo[place], rows)
            progress("flights", finished * a_part, len(todo) * a_part)
        return parts


def flights_a_part(flights: int) -> int:
    """Return how many flights one part of a campaign holds: one, unless there are thousands.

    >>> flights_a_part(1000), flights_a_part(125_000)
    (1, 125)
    """
    return -(-flights // _MOST_PARTS)


def flights_of(parts: Parts) -> tuple[int, int]:
    """Return how many flights a campaign has, and how many of them are finished."""
    flights = int(parts.facts.get("flights", parts.tasks))
    return flights, min(len(parts.done()) * -(-flights // parts.tasks), flights)


def check_size(campaign: Campaign, detectors: int, *, yes: bool) -> None:
    """Refuse a campaign of so many trials that nobody means it without saying so."""
    trials = (campaign.trials + campaign.search_trials + campaign.records) * detectors
    if trials > MANY and not yes:
        raise InputError(
            f"{campaign.flights:,} flights with {trials:,} trials in all; that is more than {MANY:,}: say --yes if "
            "it is meant, or look at the axes (--dry-run)"
        )


def _files(campaign: Campaign, detectors: Named) -> tuple[str, ...]:
    """Return the files in which the user's own detectors, faults and controllers stand."""
    specs = [spec for scenario in campaign.scenarios for spec in scenario.faults]
    faults = [one.fault for spec in specs for one in (spec, *spec.also)]
    functions = [getattr(detector, "function", None) for detector in detectors.detectors.values()]
    controllers = [found_controller(each) for scenario in campaign.scenarios if (each := scenario.setup.controller)]
    return files_of([*faults, *loaded_faults().values(), *detectors.detectors.values(), *functions, *controllers])


def _rows(detectors: Named, monitors: Monitors, flights: Sequence[Task]) -> pa.Table:
    return table_of([row for task in flights for row in rows_of(task, detectors.watchers(task.setup, monitors))])


Monitors = Mapping[tuple[str, str, str], Monitor]  # by a detector's name, an aircraft and an attitude


@dataclass(frozen=True, kw_only=True)
class Named:
    """A campaign's detectors by name, found and held against its flights, and not yet calibrated."""

    detectors: Mapping[str, Detector | Monitor]
    own: bool  # whether the scenarios' own watches, too, by each one's ``[operator]`` and ``[alarm]``

    @property
    def names(self) -> tuple[str, ...]:
        """All of their names."""
        return ((OWN,) if self.own else ()) + tuple(self.detectors)

    def watchers(self, setup: Setup, calibrated: Monitors) -> Watchers:
        """Return what watches a flight; what is tied to its excitation as a recipe."""
        own: dict[str, Detector | Monitor] = {OWN: own_detector(setup)} if self.own else {}
        of = setup.aircraft, setup.attitude
        others = {name: calibrated.get((name, *of), detector) for name, detector in self.detectors.items()}
        return own | others


def named(campaign: Campaign) -> Named:
    """Find a campaign's detectors, and refuse those that don't fit its flights."""
    detectors: dict[str, Detector | Monitor] = {}
    for source in campaign.detectors:
        if source == OWN:
            continue
        detector = as_detector(source)
        if detector.name in detectors:
            raise InputError(f"two detectors have the name '{detector.name}'; rows couldn't tell them apart")
        detectors[detector.name] = detector
    found = Named(detectors=detectors, own=OWN in campaign.detectors)
    for scenario in campaign.scenarios:
        with naming(scenario.name):
            check_watchers(found.watchers(scenario.setup, {}), scenario.setup)
            for name, detector in detectors.items():
                if _learns(detector) and scenario.setup.noise is None:
                    raise InputError(
                        f"its noise is stated by snr, which is another one on every flight, and '{name}' is calibrated "
                        'for one; state noise = "t2" instead'
                    )
    return found


def calibrated(
    campaign: Campaign, detectors: Named, parts: Parts, *, processes: int, progress: Progress
) -> tuple[Parts, Monitors]:
    """Return every monitor by name, aircraft and attitude, as its file in the folder has it.

    What isn't there yet is calibrated. Of several shards that begin together one calibrates, and the others wait.
    """
    monitors: dict[tuple[str, str, str], Monitor] = {}
    digests: dict[str, str] = {}
    with waiting_alone(parts.folder):
        for aircraft, attitude in campaign.told_apart:
            flights = replace(campaign.calibration, aircraft=aircraft, attitude=attitude)
            records: list[Record] = []
            for name, detector in detectors.detectors.items():
                if is_recipe(detector) and is_tied(detector):
                    continue
                if is_ready(detector) and not _is_kept(detector):
                    monitors[name, aircraft, attitude] = detector
                    continue
                path = parts.folder / _file_name(name, *_file_words(campaign, aircraft, attitude))
                if not path.is_file():
                    if _learns(detector) and not records:
                        records = _flown(flights, detectors, processes, progress)
                    rate = campaign.false_alarms_per_hour
                    save_monitor(_monitor(flights, knowing(detector, attitude), records, rate, progress), path)
                monitors[name, aircraft, attitude] = load_monitor(path, _restoring(detector))
                digests[path.name] = hashlib.sha256(path.read_bytes()).hexdigest()[:16]
    return hold(parts, monitors=digests, threshold_spreads=_spreads(monitors)), monitors


def _spreads(monitors: Monitors) -> dict[str, float]:
    """Return within how many times other flights would have set 95 % of a detector's thresholds, by its name."""
    found: dict[str, float] = {}
    for (name, *_), monitor in monitors.items():
        luck = Luck.from_provenance(monitor.provenance)
        if luck is not None and np.isfinite(luck.within):
            found[name] = max(luck.within, found.get(name, 1.0))
    return found


def _restoring(detector: Detector | Monitor) -> Detector | None:
    """Return who restores a monitor's file; a bank's needs nobody, and of little flight isn't quite the recipe's."""
    return detector if is_recipe(detector) and kind_of(detector) != "bank" else None


def _learns(detector: Detector | Monitor) -> bool:
    """Whether it is calibrated on flights that shake everything, once."""
    return is_recipe(detector) and not is_tied(detector) and not isinstance(detector, FunctionDetector)


def _is_kept(monitor: Monitor) -> bool:
    """Whether a monitor can be written down; one in Python goes to the tasks as it is."""
    try:
        monitor.figures()
    except (InputError, AttributeError):
        return False
    return True


def _flown(flights: CalibrationFlights, detectors: Named, processes: int, progress: Progress) -> list[Record]:
    """Fly what all detectors are calibrated on, once."""
    wanted = {channel for detector in detectors.detectors.values() for channel in detector.channels}
    commands = [name for name in COMMANDS if name in wanted]
    return flights.sensed([*SENSORS, *flights.others.channels, *commands], processes=processes, progress=progress)


def _monitor(
    flights: CalibrationFlights,
    detector: Detector | Monitor,
    records: list[Record],
    false_alarms_per_hour: float | None,
    progress: Progress,
) -> Monitor:
    if not is_recipe(detector):
        assert is_ready(detector)
        return detector
    if isinstance(detector, FunctionDetector):
        return detector.calibrate()
    seen = [record.select(detector.channels) for record in records] if detector.channels else records
    monitor = detector.calibrate(seen, false_alarms_per_hour, progress=progress)
    return with_provenance(monitor, flights.provenance() | {"records": len(records)})


def _file_words(campaign: Campaign, aircraft: str, attitude: str) -> list[str]:
    """Return what tells the monitors of a detector apart."""
    several = [len({*values}) > 1 for values in zip(*campaign.told_apart, strict=True)]
    return [word for word, is_told in zip((Path(aircraft).name, attitude), several, strict=True) if is_told]


def _file_name(*words: str) -> str:
    """Return a name for a monitor's file: legal everywhere, another one for every detector."""
    told = "-".join(words)
    plain = re.sub(r"[^A-Za-z0-9_.-]+", "_", told)
    mark = "" if plain == told else f"-{hashlib.sha256(told.encode()).hexdigest()[:6]}"
    return f"monitor-{plain[:100]}{mark}.json"

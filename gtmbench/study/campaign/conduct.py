"""A campaign at work: its tasks on processes of this machine, one shard of them, or on a Dask cluster, into parts.

Whoever conducts it writes the parts; processes and workers only make rows. So nothing but the folder has to be kept,
and it doesn't matter who ends when.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from gtmbench.bench.loop import found_controller
from gtmbench.errors import InputError
from gtmbench.faults.registry import loaded_faults
from gtmbench.imports import digests_of, files_of
from gtmbench.jobs.parts import Parts, Shard, parts_in
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.workers import Workers, versions
from gtmbench.study.campaign.plan import MANY, Campaign, load_campaign
from gtmbench.study.campaign.rows import table_of
from gtmbench.study.campaign.task import Task, rows_of
from gtmbench.study.campaign.watchers import Monitors, Named, calibrated, named

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

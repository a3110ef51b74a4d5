"""Who does long work: this process, others on this machine, or the workers of a Dask cluster."""

from __future__ import annotations

import os
import pickle
import platform
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from gtmbench.errors import InputError
from gtmbench.files.shipped import code_facts
from gtmbench.imports import load_files
from gtmbench.jobs.cluster import GOES_ON, check_cluster, completed_on_cluster, difference
from gtmbench.jobs.processes import completed, in_order
from gtmbench.jobs.progress import Progress, silent

Task = TypeVar("Task")
Result = TypeVar("Result")
_LIBRARIES = ("jsbsim", "numpy", "scipy")  # whose versions results hang on
_KILLED = f"a process was killed (no memory? perhaps with fewer --jobs); {GOES_ON}"


class _Order(NamedTuple):
    """What all tasks share, as it travels: once to a process, with every task to a cluster."""

    versions: tuple[tuple[str, str], ...]  # of the gtmbench that conducts, and of what results hang on
    files: tuple[str, ...]  # to be imported first
    work: bytes  # a pickle


@dataclass(frozen=True, kw_only=True)
class Workers:
    """Who does long work.

    `processes`: on this machine. `scheduler`: of a Dask cluster that does it instead; `tls`: a folder with ca.pem,
    cert.pem and key.pem, for one at tls://. `files`: in which the user's own classes stand.

    >>> Workers().spread(abs, [-2, 3], step="count", progress=print)
    count 0 2
    count 1 2
    count 2 2
    [2, 3]
    """

    processes: int = 1
    scheduler: str | None = None
    tls: Path | None = None
    files: tuple[str, ...] = ()

    def check(self) -> None:
        """Refuse a scheduler that doesn't answer, and workers with another gtmbench, before the long work."""
        if self.scheduler is not None:
            check_cluster(self.scheduler, self.tls, versions)

    def completed(self, work: Callable[[Task], Result], tasks: Iterable[Task]) -> Iterator[tuple[int, Result]]:
        """Give what some work makes of every task as soon as it is made, with the task's place among the tasks.

        Elsewhere than here, work, tasks and results travel as pickles.
        """
        if self.scheduler is None and self.processes <= 1:
            return completed(work, tasks, processes=1)
        order = _Order(tuple(versions().items()), self.files, pickle.dumps(work))
        packed = map(pickle.dumps, tasks)
        if self.scheduler is not None:
            return completed_on_cluster(partial(done, order), packed, scheduler=self.scheduler, tls=self.tls)
        return completed(_done_here, packed, processes=self.processes, begin=partial(_join, order), killed=_KILLED)

    def spread(
        self, work: Callable[[Task], Result], tasks: Sequence[Task], *, step: str, progress: Progress = silent
    ) -> list[Result]:
        """Return what some work makes of every task, in the tasks' order."""
        return in_order(self.completed(work, tasks), len(tasks), step=step, progress=progress)


ALONE = Workers()  # this process


def versions() -> dict[str, str]:
    """Return what results hang on beside their input: versions, and a digest of this package's code and data."""
    return code_facts(_LIBRARIES)


def done(order: _Order, packed: bytes) -> Any:
    """Do a task, in whichever process, and return what comes of it.

    Raises InputError if this isn't the gtmbench that the work comes from: its results would be others.
    """
    work = _work(order)
    return work(pickle.loads(packed))  # noqa: S301  our own, from the process that conducts


_joined: list[_Order] = []


def _join(order: _Order) -> None:
    """Keep what all tasks share, in a process that begins."""
    _joined[:] = [order]


def _done_here(packed: bytes) -> Any:
    return done(_joined[0], packed)


@lru_cache(maxsize=1)
def _work(order: _Order) -> Callable[[Any], Any]:
    """Return the work, unpickled once a process, if this is the gtmbench that it comes from."""
    if differs := difference(dict(order.versions), versions()):
        here = f"process {os.getpid()} on {platform.node()}"
        raise InputError(f"a worker ({here}) has {differs}; rows of both don't mix: install the same everywhere")
    load_files(order.files)
    work: Callable[[Any], Any] = pickle.loads(order.work)  # noqa: S301
    return work

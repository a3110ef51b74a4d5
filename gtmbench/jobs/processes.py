"""Work that is spread over processes: results in the order of the tasks, and nothing left running behind."""

from __future__ import annotations

import faulthandler
import multiprocessing
import os
import signal
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import ExitStack, contextmanager
from functools import cache, partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, TextIO, TypeVar

from gtmbench.errors import GtmbenchError
from gtmbench.jobs.progress import Progress, silent
from gtmbench.jobs.threads import one_thread_each

Task = TypeVar("Task")
Result = TypeVar("Result")
_AHEAD = 2  # tasks a process that are handed out, so that none waits for its next
_KILLED = "a process was killed (no memory?); close others, or use fewer processes"


def spread(
    work: Callable[[Task], Result],
    tasks: Sequence[Task],
    *,
    processes: int,
    step: str,
    progress: Progress = silent,
    begin: Callable[[], object] | None = None,
    killed: str = _KILLED,
) -> list[Result]:
    """Return what some work makes of every task, in the tasks' order.

    `work`: of a task; for other processes picklable, as tasks and results are. `processes`: how many at most. The
    caller's main module is imported by each of them, so a script needs its ``if __name__ == "__main__":``. With one,
    this process does the work, unless there is something to begin with. `begin`: called in every process before its
    first task; arguments (such as large ones that all tasks share) come by `functools.partial`. Raises GtmbenchError
    where a process was killed from outside. What the work itself raises comes as it is.

    >>> spread(abs, [-2, 3], processes=1, step="count", progress=print)
    count 0 2
    count 1 2
    count 2 2
    [2, 3]
    """
    fewer = min(processes, len(tasks))
    made = completed(work, tasks, processes=fewer, begin=begin, killed=killed)
    return in_order(made, len(tasks), step=step, progress=progress)


def in_order(made: Iterable[tuple[int, Result]], count: int, *, step: str, progress: Progress = silent) -> list[Result]:
    """Return so many results, which come with their places, in order."""
    results: dict[int, Result] = {}
    progress(step, 0, count)
    for place, result in made:
        results[place] = result
        progress(step, len(results), count)
    return [results[place] for place in range(count)]


def completed(
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    *,
    processes: int,
    begin: Callable[[], object] | None = None,
    killed: str = _KILLED,
) -> Iterator[tuple[int, Result]]:
    """Give what some work makes of every task as soon as it is made, with the task's place among the tasks.

    Tasks are taken as processes become free, so there may be any number of them; `spread` has what is left out here.

    >>> dict(completed(abs, [-2, 3], processes=1))
    {0: 2, 1: 3}
    """
    if processes <= 1 and begin is None:
        yield from enumerate(map(work, tasks))
        return
    with _pool(max(processes, 1), begin, killed) as submit:
        if submit is None:  # a machine without semaphores
            yield from enumerate(map(work, tasks))
            return
        waiting = enumerate(tasks)
        running: dict[Future[Result], int] = {}
        while True:
            for number, task in islice(waiting, _AHEAD * max(processes, 1) - len(running)):
                running[submit(work, task)] = number
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                yield running.pop(future), future.result()


class Lost(NamedTuple):
    """What is left of a task whose process died at it, or was ended after `limit_s`."""

    after_s: float
    limit_s: float

    @property
    def is_late(self) -> bool:
        """Whether it had all the time that it was given."""
        return self.after_s >= self.limit_s


def survived(
    work: Callable[[Task], Result],
    tasks: Iterable[Task],
    *,
    processes: int,
    limit_s: float,
    begin: Callable[[], object] | None = None,
) -> Iterator[tuple[int, Result | Lost]]:
    """Give what some work makes of every task, as `completed` does; one that kills its process doesn't end the others.

    Every task has a process for itself meanwhile, and so much time.

    >>> dict(survived(abs, [-2, 3], processes=1, limit_s=60.0))
    {0: 2, 1: 3}
    """
    bounded = partial(_bounded, work, limit_s)
    with ExitStack() as stack:

        def new() -> Callable[..., Future[Any]] | None:
            return stack.enter_context(_pool(1, begin, _KILLED))

        waiting, free = enumerate(tasks), [new()]
        if free[0] is None:  # a machine without semaphores
            yield from enumerate(map(work, tasks))
            return
        running: dict[Future[Result], tuple[int, Callable[..., Future[Any]], float]] = {}
        while True:
            for number, task in islice(waiting, max(processes, 1) - len(running)):
                submit = free.pop() if free else new()
                assert submit is not None
                running[submit(bounded, task)] = number, submit, time.monotonic()
            if not running:
                return
            for future in wait(running, return_when=FIRST_COMPLETED).done:
                number, submit, begun_s = running.pop(future)
                try:
                    result: Result | Lost = future.result()
                except BrokenProcessPool:
                    result = Lost(time.monotonic() - begun_s, limit_s)
                else:
                    free.append(submit)
                yield number, result


_kept = threading.local()  # a thread's process, how it is given work: it stays for the next task


def survived_one(work: Callable[[Task], Result], task: Task, *, limit_s: float) -> Result | Lost:
    """Return what some work makes of a task in a process that this thread keeps for its next one.

    For a worker of a cluster, which must not die of a task: what `survived` does for many, one at a time. The process
    ends with this one, so one that may have no children, as it couldn't end them, may have this.
    """
    if not hasattr(_kept, "submit"):
        multiprocessing.current_process()._config["daemon"] = False  # type: ignore[attr-defined]
        _kept.stack = ExitStack()
        _kept.submit = _kept.stack.enter_context(_pool(1, None, _KILLED))
    begun_s = time.monotonic()
    try:
        result: Result = _kept.submit(partial(_bounded, work, limit_s), task).result()
    except BrokenProcessPool:
        del _kept.submit
        return Lost(time.monotonic() - begun_s, limit_s)
    return result


def _bounded(work: Callable[[Task], Result], limit_s: float, task: Task) -> Result:
    """Do a task, or end this process: by a thread of C, for a library may hold Python's lock for ever."""
    faulthandler.dump_traceback_later(limit_s, exit=True, file=_nowhere())
    try:
        return work(task)
    finally:
        faulthandler.cancel_dump_traceback_later()


@cache
def _nowhere() -> TextIO:
    return Path(os.devnull).open("w")


@contextmanager
def _pool(
    processes: int, begin: Callable[[], object] | None, killed: str
) -> Iterator[Callable[..., Future[Any]] | None]:
    """Give how to submit work to processes that end with the block; None where there can't be any."""
    context = multiprocessing.get_context("spawn")  # a fork would copy locks that threads of ours hold
    try:
        pool = ProcessPoolExecutor(processes, mp_context=context, initializer=_begun, initargs=(begin,))
    except (OSError, ImportError):
        if begin is not None:
            begin()
        yield None
        return

    def submit(work: Callable[[Any], Any], task: Any) -> Future[Any]:
        with _interrupts_wait(), one_thread_each():  # processes start here; Ctrl-C is ours to handle, not theirs
            return pool.submit(work, task)

    others = set(multiprocessing.active_children())
    try:
        yield submit
    except BrokenProcessPool as error:
        raise GtmbenchError(killed) from error
    except BaseException:  # nobody waits for what goes nowhere
        for child in set(multiprocessing.active_children()) - others:
            child.terminate()
        raise
    finally:
        pool.shutdown(wait=True, cancel_futures=True)


def _begun(begin: Callable[[], object] | None) -> None:
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if begin is not None:
        begin()


def _end_with_parent() -> None:
    """End when the process that wants the work is gone, however it went: nobody would ask for more."""
    parent = multiprocessing.parent_process()
    if parent is not None:
        parent.join()
        os._exit(1)


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Hold Ctrl-C back for a moment; processes that start meanwhile never see it."""
    if not hasattr(signal, "pthread_sigmask") or threading.current_thread() is not threading.main_thread():
        yield
        return
    former = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, former)

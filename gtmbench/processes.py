"""Work that is spread over processes: results in the order of the tasks, and nothing left running behind."""

from __future__ import annotations

import multiprocessing
import signal
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any, TypeVar

from gtmbench.errors import GtmbenchError
from gtmbench.progress import Progress, silent

Task = TypeVar("Task")
Result = TypeVar("Result")
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

    Parameters
    ----------
    work : callable
        Of a task; for other processes picklable, as tasks and results are.
    tasks : sequence
    processes : int
        How many at most. The caller's main module is imported by each of them, so a script needs its
        ``if __name__ == "__main__":``. With one, this process does the work, unless there is something to begin with.
    step : str
        What progress is told.
    progress : callable
        Told the step, how many tasks are done, and of how many.
    begin : callable, optional
        Called in every process before its first task; arguments (such as large ones that all tasks share) come by
        `functools.partial`.
    killed : str
        What is said where a process dies.

    Raises
    ------
    GtmbenchError
        Where a process was killed from outside. What the work itself raises comes as it is.

    Examples
    --------
    >>> spread(abs, [-2, 3], processes=1, step="count", progress=print)
    count 0 2
    count 1 2
    count 2 2
    [2, 3]
    """
    results: list[Result] = []
    progress(step, 0, len(tasks))
    with _mapped(min(processes, len(tasks)), begin, killed) as mapped:
        for result in mapped(work, tasks):
            results.append(result)
            progress(step, len(results), len(tasks))
    return results


@contextmanager
def _mapped(processes: int, begin: Callable[[], object] | None, killed: str) -> Iterator[Callable[..., Any]]:
    """Give a `map` over processes that end with the block; the plain one where there is no need of others."""
    if processes <= 1 and begin is None:
        yield map
        return
    context = multiprocessing.get_context("spawn")  # a fork would copy locks that threads of ours hold
    try:
        pool = ProcessPoolExecutor(max(processes, 1), mp_context=context, initializer=_begun, initargs=(begin,))
    except (OSError, ImportError):  # a machine without semaphores
        if begin is not None:
            begin()
        yield map
        return

    def mapped(work: Callable[[Any], Any], tasks: Sequence[Any]) -> Any:
        with _interrupts_wait():  # the processes start here; Ctrl-C is ours to handle, not theirs
            return pool.map(work, tasks)

    others = set(multiprocessing.active_children())
    try:
        yield mapped
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
    if begin is not None:
        begin()


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

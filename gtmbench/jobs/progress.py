"""Long work: how far it is, as whoever works tells a function, and how much time it may take."""

from __future__ import annotations

import signal
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gtmbench.checks import number, printable
from gtmbench.errors import GtmbenchError

_REMEMBERED_S = 3600.0  # how far back the time that is left is estimated from: a step may take minutes
Progress = Callable[[str, int, int], None]  # a step, how many are done, of how many
Tell = Callable[[str], None]  # a step, as it begins


def silent(_step: str, _done: int, _of: int) -> None:
    """Tell nobody how far something is."""


def counted(progress: Progress, total: int) -> Tell:
    """Return a function to be told every step as it begins; `progress` hears how many are done, and of how many.

    >>> tell = counted(print, 2)
    >>> tell("fly"), tell("watch")
    fly 0 2
    watch 1 2
    (None, None)
    """
    done = -1

    def tell(step: str) -> None:
        nonlocal done
        done += 1
        progress(step, done, total)

    return tell


@contextmanager
def progress_bar(*, silent: bool = False) -> Iterator[Callable[..., None]]:
    """Give a function that shows a step, how many are done and of how many; None: one more, of as many as before.

    The bar stands on stderr, on terminals only, and is gone afterwards.
    """
    from rich.console import Console
    from rich.progress import (
        BarColumn,
        MofNCompleteColumn,
        Progress,
        TextColumn,
        TimeElapsedColumn,
        TimeRemainingColumn,
    )

    columns = (
        TextColumn("{task.description:<24}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    console = Console(stderr=True)
    with Progress(
        *columns,
        console=console,
        disable=silent or not console.is_terminal,
        transient=True,
        speed_estimate_period=_REMEMBERED_S,
    ) as bar:
        task = bar.add_task("reading", total=None)

        def tell(step: str, done: int | None = None, total: int | None = None) -> None:
            bar.update(
                task, description=printable(step), completed=done, total=total, advance=1 if done is None else None
            )

        yield tell


class _TimeIsUpError(BaseException):
    """No reader's ``except Exception`` keeps it."""


@contextmanager
def limited(seconds: float | None) -> Iterator[None]:
    """End the work of a block after so many seconds; outside of a main thread, or without an alarm clock, never.

    `seconds`: without a number there is no limit. Raises GtmbenchError where it wasn't done in time.

    >>> with limited(0.01):
    ...     threading.Event().wait()
    Traceback (most recent call last):
    gtmbench.errors.GtmbenchError: not done within 0.01 s; cut the log, or allow more with --time-limit
    """
    limit_s = 0.0 if seconds is None else number("--time-limit", seconds, 0.0, 1e6, above=True)
    if not limit_s or threading.current_thread() is not threading.main_thread() or not hasattr(signal, "setitimer"):
        yield
        return

    def ring(*_: object) -> None:
        raise _TimeIsUpError

    former = signal.signal(signal.SIGALRM, ring)
    signal.setitimer(signal.ITIMER_REAL, limit_s)
    try:
        yield
    except _TimeIsUpError:
        raise GtmbenchError(f"not done within {limit_s:g} s; cut the log, or allow more with --time-limit") from None
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, former)

"""Progress: whoever works long tells a function the step, how many are done, and of how many."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from gtmbench.checks import printable

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

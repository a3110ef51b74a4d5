"""What commands write and print: files that they claim, what they come to, tables."""

from __future__ import annotations

import math
import os
import shutil
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from gtmbench.checks import listed, printable
from gtmbench.errors import InputError
from gtmbench.files.folders import check_folder
from gtmbench.files.locks import alone, lock_beside
from gtmbench.files.plain import dumps
from gtmbench.files.writing import check_file, write_text
from gtmbench.jobs.progress import progress_bar

if TYPE_CHECKING:
    from gtmbench.intake.contents import LogColumn

_NO_SCREEN = 140  # characters


def claim_file(
    target: Path | None, *, force: bool, option: str = "--out", ends: Sequence[str] = (), read: Iterable[Path] = ()
) -> None:
    """Refuse a result's file that can't be written, isn't to be replaced or is being written; keep others off it.

    `ends`: how its name may end. `read`: files that the command reads, none of which it may be.
    """
    if target is None:
        return
    if ends and target.suffix.lower() not in ends:
        raise InputError(f"{option} is '{target}'; its name ends in {listed(ends, 'or')}")
    if target.exists() and any(each.exists() and target.samefile(each) for each in read):
        raise InputError(f"{option} is '{target}', which is read; give another name")
    _claim(target, partial(check_file, target, force=force, option=option))


def claim_folder(target: Path, *, force: bool) -> None:
    """Do the same for a folder of results."""
    _claim(target, partial(check_folder, target, force=force))


def _claim(target: Path, check: Callable[[], None]) -> None:
    """Check a place, and hold it until the command ends; then again, for somebody may just have finished there."""
    check()
    lock = lock_beside(target.resolve())
    click.get_current_context().with_resource(alone(lock, f"another command writes {target}"))
    check()


def write_new(target: Path, text: str) -> None:
    """Write a file that somebody will edit, never over another."""
    if target.exists():
        raise InputError(f"{target} exists; give another name")
    claim_file(target, force=False)
    write_text(target, text)


def check_screen(instead: str) -> None:
    """Refuse to open a window where there is no screen; `instead` says what to use."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(f"there is no screen here (neither DISPLAY nor WAYLAND_DISPLAY is set); use {instead}")


def echo(text: str, *, bold: bool = False, err: bool = False) -> None:
    """Print lines, without what a terminal would take for commands: names and titles come from files."""
    plain = "\n".join(map(printable, text.split("\n")))
    click.secho(plain, bold=bold or None, err=err)


def say(lines: Iterable[str]) -> None:
    """Print lines one by one."""
    for line in lines:
        echo(line)


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object."""
    click.echo(dumps(value, indent=2))


def is_json() -> bool:
    """Whether the running command prints JSON and nothing else."""
    return bool(click.get_current_context().params["as_json"])


def is_silent() -> bool:
    """Whether the running command prints nothing for people, but errors."""
    return is_json() or bool(click.get_current_context().params["quiet"])


def shown_progress() -> AbstractContextManager[Callable[..., None]]:
    """Return the running command's bar, as `progress_bar` does."""
    return progress_bar(silent=is_silent())


def finish(result: Mapping[str, Any], rest: Callable[[], Iterable[str] | None] | None = None) -> int:
    """Print what a command comes to, an `envelope`, and return its exit code.

    With ``--json`` all of it; else its verdict and the `rest`, lines or what prints them; with ``-q`` nothing.
    """
    if is_json():
        print_json(result)
    elif not is_silent():
        echo(result["verdict"])
        say((rest() if rest else None) or ())
    return int(result["exit_code"])


def screen_width() -> int:
    """Return how many characters fit beside each other; a pipe or a file has no width of its own."""
    return shutil.get_terminal_size(fallback=(_NO_SCREEN, 50)).columns if sys.stdout.isatty() else _NO_SCREEN


def print_table(
    title: str, columns: Sequence[str], rows: Sequence[Sequence[str]], *, right: Sequence[str] = ()
) -> None:
    """Print a table; the columns named in `right` are aligned to the right."""
    from rich import box
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(printable(title)), title_justify="left", title_style="bold", box=box.SIMPLE_HEAD, pad_edge=False
    )
    for name in columns:
        table.add_column(name, justify="right" if name in right else "left", overflow="fold")
    for row in rows:
        table.add_row(*(Text(printable(cell)) for cell in row))  # as text: rich reads [p q beta] as markup
    console = Console(highlight=False)
    if not console.is_terminal:
        console = Console(highlight=False, width=_NO_SCREEN)
    console.print(table)


def print_columns(log: Path, columns: Sequence[LogColumn]) -> None:
    """Print what a log holds: its columns, and which channels they become."""
    names = ["column", "unit", "samples", "rate (Hz)", "from (s)", "to (s)", "channel"]
    rows = []
    for column in columns:
        times = [column.rate_hz, column.start_s, column.end_s]
        shown = [f"{value:.6g}" if math.isfinite(value) else "-" for value in times]
        rows.append([column.name, column.unit, str(column.samples), *shown, column.channel or column.why_not])
    print_table(log.name, names, rows, right=names[2:6])

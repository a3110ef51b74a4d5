"""What commands are made of: options under headings, old names; files that they claim, what they come to, tables."""

from __future__ import annotations

import math
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Container, Iterable, Mapping, Sequence
from contextlib import AbstractContextManager
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.core import ParameterSource

from gtmbench.checks import listed, printable, shown
from gtmbench.errors import InputError
from gtmbench.files.folders import check_folder
from gtmbench.files.locks import alone, lock_beside
from gtmbench.files.plain import dumps
from gtmbench.files.writing import check_file, is_file, write_text
from gtmbench.jobs.progress import progress_bar

if TYPE_CHECKING:
    from gtmbench.intake.contents import LogColumn

F = TypeVar("F", bound=Callable[..., Any])
PATH = click.Path(path_type=Path)

_APART = {  # the heading of options that few need
    "Long runs": ("--resume", "--time-limit", "--scheduler", "--tls"),
    "An aircraft's history": ("--history", "--aircraft-id"),
    "Faults of your own": ("--import",),
    "Help, files that exist": ("--force", "-h"),
}
_ALIASES = {"--identify": "--healthy"}  # old names that work


class HeadedCommand(click.Command):
    """A command whose help has headings."""

    def parse_args(self, ctx: click.Context, args: list[str]) -> list[str]:
        """Parse a command line, in which old names of options work."""
        words = [word.partition("=") for word in args]
        return super().parse_args(ctx, [f"{_ALIASES.get(name, name)}{equals}{value}" for name, equals, value in words])

    def format_options(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the options, those that few need apart."""
        apart = {name: heading for heading, names in _APART.items() for name in names}
        sections: dict[str, list[tuple[str, str]]] = {"Options": [], **{heading: [] for heading in _APART}}
        for option in self.get_params(ctx):
            record = option.get_help_record(ctx) if isinstance(option, click.Option) else None
            if record is not None:
                # click keeps the names of --help in a set: either may come first
                sections[next((apart[name] for name in option.opts if name in apart), "Options")].append(record)
        for heading, records in sections.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def told_names(file: str = "names.toml") -> dict[str, dict[str, str]]:
    """Return what a file beside this one says of commands and of names, by sections."""
    import tomllib
    from importlib.resources import files

    return tomllib.loads((files("gtmbench.cli") / file).read_text(encoding="utf-8"))


def moved_command(given: Sequence[str]) -> str:
    """Say what is typed instead of a command of old; "" where it never was one."""
    old = next((word for word in given if not word.startswith("-")), "")
    now = told_names("moved.toml")["commands"].get(old)
    return f"gtmbench {old} has moved: {now}" if now else ""


def moved_option(command: str, option: str) -> str:
    """Return what is typed instead of an option that a command no longer has; "" where it never had it."""
    return told_names("moved.toml").get(command, {}).get(option, "")


def common_options(command: F) -> F:
    """Add ``--json`` and ``-q``, which `finish` heeds, to a command, whose errors name options as they were typed.

    ``--duration is -3``, not ``duration_s is -3.0``.
    """

    @wraps(command)
    def told(*arguments: Any, as_json: bool, quiet: bool, **options: Any) -> Any:  # noqa: ARG001
        try:
            return command(*arguments, **options)
        except InputError as error:
            raise InputError(typed(str(error), click.get_current_context())) from error

    json = click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")
    quiet = click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")
    return cast(F, quiet(json(told)))


def typed(message: str, context: click.Context) -> str:
    """Return a message that begins with an argument's name and value with the option that gave it."""
    for option in context.command.params:
        value = context.params.get(option.name or "")
        if value is None or not isinstance(option, click.Option):
            continue
        for key in (*option.opts, *(f"{option.name}{unit}" for unit in ("", "_s", "_ft", "_kt", "_hz"))):
            if message.startswith(f"{key} is {shown(value)};"):
                written = f"{value:g}" if isinstance(value, float) else shown(value)
                return f"{option.opts[0]} is {written}{message.removeprefix(f'{key} is {shown(value)}')}"
    return message


def command_line(without: Container[str] = ()) -> str:
    """Return the running command as it was typed, files by their names alone; some options left out."""
    context = click.get_current_context()
    words = ["gtmbench", str(context.command.name)]
    for option in context.command.params:
        name = option.name or ""
        if name in without or context.get_parameter_source(name) is not ParameterSource.COMMANDLINE:
            continue
        given = context.params[name] if option.expose_value else context.meta[name]
        texts = [
            Path(str(each)).name if isinstance(each, Path) or is_file(Path(str(each))) else str(each)
            for each in (given if isinstance(given, tuple) else (given,))
        ]
        if isinstance(option, click.Option):
            key = option.opts[0]
            words += [key] if option.is_flag else [word for text in texts for word in (key, text)]
        else:
            words += texts
    return shlex.join(words)


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

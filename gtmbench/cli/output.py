"""What the commands share: the options every one of them has, and how they print."""

from __future__ import annotations

import math
import os
import shlex
import shutil
import sys
from collections.abc import Callable, Container, Mapping, Sequence
from functools import partial, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar, cast

import click
from click.core import ParameterSource

from gtmbench.checks import printable, shown
from gtmbench.errors import InputError
from gtmbench.files.disk import atomic_write, check_file, is_file
from gtmbench.files.folders import check_folder
from gtmbench.files.locks import alone, lock_beside
from gtmbench.files.plain import dumps

if TYPE_CHECKING:
    from gtmbench.intake.contents import LogColumn

_NO_SCREEN = 140  # characters
F = TypeVar("F", bound=Callable[..., Any])


def common_options(command: F) -> F:
    """Add ``--json`` and ``-q`` to a command, whose errors name options as they were typed."""
    command = _as_typed(command)
    command = click.option("--json", "as_json", is_flag=True, help="Print one JSON object and nothing else.")(command)
    return click.option("-q", "--quiet", is_flag=True, help="Print nothing but errors.")(command)


def _as_typed(command: F) -> F:
    """Let a command's errors name an option as it was typed: ``--duration is -3``, not ``duration_s is -3.0``."""

    @wraps(command)
    def told(*arguments: Any, **options: Any) -> Any:
        try:
            return command(*arguments, **options)
        except InputError as error:
            raise InputError(typed(str(error), click.get_current_context())) from error

    return cast(F, told)


def claim_file(target: Path, *, force: bool, option: str = "--out") -> None:
    """Refuse a result's file that can't be written, isn't to be replaced or is being written; keep others off it."""
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
    with atomic_write(target) as aside:
        aside.write_text(text, encoding="utf-8")


def check_screen(instead: str) -> None:
    """Refuse to open a window where there is no screen; `instead` says what to use."""
    if sys.platform == "linux" and not (os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY")):
        raise InputError(f"there is no screen here (neither DISPLAY nor WAYLAND_DISPLAY is set); use {instead}")


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
        given = context.params[name]
        texts = [_by_name(each) for each in (given if isinstance(given, tuple) else (given,))]
        if isinstance(option, click.Option):
            key = option.opts[0]
            words += [key] if option.is_flag else [word for text in texts for word in (key, text)]
        else:
            words += texts
    return shlex.join(words)


def _by_name(given: object) -> str:
    path = Path(str(given))
    return path.name if isinstance(given, Path) or is_file(path) else str(given)


def map_option(command: F) -> F:
    """Add ``--map`` and ``--units`` to a command that reads a log: its `mapping` holds both, of files what they say."""

    @wraps(command)
    def told(*arguments: Any, mapping: tuple[str, ...], units: str | None, **options: Any) -> Any:
        files = map_files(mapping)
        typed = [text for text in mapping if Path(text) not in files]
        own = {text.partition("=")[0].strip() for text in typed}
        kept = [text for file in files for text in _kept_mapping(file) if text.partition("=")[0] not in own]
        stated = () if units is None else (f"units={units}",)
        return command(*arguments, mapping=(*typed, *kept, *stated), **options)

    option = click.option(
        "--map",
        "mapping",
        multiple=True,
        metavar="CHANNEL=COLUMN:UNIT|FILE.toml",
        help="Map a column whose name doesn't identify it: p=gyro_x:rad/s, nz=-az:m/s2 (turns the sign), "
        "time=stamp:us, psi=yaw:deg@0.3 (stamped 0.3 s late). Or a file of these; `gtmbench monitor` writes it where "
        "there is none.",
    )
    unit = click.option(
        "--units",
        type=click.Choice(["rad", "deg"]),
        help="What angles, and rates per second, are in that state no unit.",
    )
    return cast(F, option(unit(told)))


def map_files(mapping: Sequence[str]) -> list[Path]:
    """Return the files among what ``--map`` was given."""
    return [Path(text) for text in mapping if "=" not in text and text.lower().endswith(".toml")]


def _kept_mapping(path: Path) -> list[str]:
    """Return what a file of maps holds; nothing of one that the command is to write.

    Raises InputError where it isn't such a file, or there is none and the command doesn't write it.
    """
    if not path.exists() and click.get_current_context().command.name == "monitor":
        return []
    from gtmbench.intake.flight_log import read_map_file

    return read_map_file(path)


def attitude_option(command: F) -> F:
    """Add ``--attitude`` to a command that calibrates on logs."""
    return click.option(
        "--attitude",
        type=click.Choice(["auto", "own", "driven"]),
        default="auto",
        show_default=True,
        help="Whether an estimator computes the log's attitude from the gyros (driven) or it is independent (own). "
        "auto: as the format documents, otherwise as the samples show.",
    )(command)


def scope_options(command: F) -> F:
    """Add ``--judge`` and ``--limit`` to a command that gives a verdict on logs; limits are checked before any work."""

    @wraps(command)
    def told(*arguments: Any, limits: tuple[str, ...], **options: Any) -> Any:
        from gtmbench.verdict.scope import Scope

        Scope(sensors=()).with_limits(limits)
        return command(*arguments, limits=limits, **options)

    judge = click.option(
        "--judge",
        metavar="SENSORS",
        help="What the verdict speaks for: p,q,r or gyros, attitude, surfaces, all.  [default: gyros and attitude]",
    )
    limit = click.option(
        "--limit",
        "limits",
        multiple=True,
        metavar="SIZE",
        help="A fault that has to show for a sensor to be clear: 2deg/s of a gyro, 8deg of an angle, factor=0.7 of a "
        "gyro. Repeat it for several.  [default: 5deg/s, 10deg]",
    )
    return cast(F, judge(limit(told)))


def echo(text: str, *, bold: bool = False, err: bool = False) -> None:
    """Print lines, without what a terminal would take for commands: names and titles come from files."""
    plain = "\n".join(map(printable, text.split("\n")))
    click.secho(plain, bold=bold or None, err=err)


def print_json(value: Mapping[str, Any]) -> None:
    """Print one JSON object."""
    click.echo(dumps(value, indent=2))


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


def cluster_options(command: F) -> F:
    """Give a command ``--scheduler`` and ``--tls``."""
    tls = click.option(
        "--tls",
        type=click.Path(path_type=Path),
        metavar="FOLDER",
        help="With --scheduler: the folder of ca.pem, cert.pem and key.pem.",
    )
    where = "Run the tasks on a Dask cluster: tcp://HOST:PORT, tls://..."
    return click.option("--scheduler", metavar="ADDRESS", help=where)(tls(command))


def check_cluster_options(scheduler: str | None, tls: Path | None) -> None:
    """Refuse certificates of no scheduler."""
    if tls is not None and scheduler is None:
        raise InputError("--tls is for a --scheduler, and none is given")

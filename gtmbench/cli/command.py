"""A command as gtmbench has it: options under headings and in every command, old names that say where they went."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Container, Sequence
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar, cast

import click
from click.core import ParameterSource

from gtmbench.checks import shown
from gtmbench.errors import InputError
from gtmbench.files.writing import is_file

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
        given = context.params[name]
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

"""The command line's frame: the commands, and how every one of them ends.

Exit codes: 0 well; 1 what was looked for was found: a regression (`check`), a fault (`monitor`, `live`,
`score`), an altered file or another recording (`verify`), a verdict that the scenario doesn't expect (`run --strict`);
2 bad input or a failure that was foreseen (one line says why); 3 `monitor`, `live` or `score` could not tell, trials of
a `campaign` failed; 130 Ctrl-C.
"""

from __future__ import annotations

import io
import os
import re
import signal
import sys
import traceback
import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from pathlib import Path
from typing import Any

import click

from gtmbench.checks import one_line
from gtmbench.cli.output import echo, moved_command, moved_option, print_json, told_names
from gtmbench.errors import GtmbenchError, NoteWarning, RankWarning
from gtmbench.files.plain import envelope
from gtmbench.files.writing import is_file
from gtmbench.jobs.threads import one_thread
from gtmbench.version import __version__

# in which order, and under which heading, --help lists commands, and in which file each is; imported when it is run
SECTIONS = {
    "Begin": {"demo": "demo", "list": "listing"},
    "Watch a flight": {"monitor": "monitor", "live": "live", "score": "inject"},
    "Fly and break": {"fly": "flight", "inject": "inject", "aircraft": "aircraft"},
    "Compare detectors": {"run": "study", "campaign": "campaign", "benchmark": "campaign"},
    "Calibrate, hold in CI, take on board": {"calibrate": "calibrate", "check": "check", "export": "calibrate"},
    "Look at results": {"view": "study", "verify": "verify"},
}
_FILES = {name: file for commands in SECTIONS.values() for name, file in commands.items()}


class _App(click.Group):
    """Lists commands by what they are for, and lets a closed pipe be told as whatever fails.

    Click would end with 1 at a closed pipe, which says that a fault was found.
    """

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:  # noqa: ARG002  (click's)
        """Write each section's commands, with the whole first sentence of each."""
        said = told_names()["commands"]
        for title, commands in SECTIONS.items():
            with formatter.section(title):
                formatter.write_dl([(name, said[name]) for name in commands])

    def list_commands(self, ctx: click.Context) -> list[str]:  # noqa: ARG002  (click's)
        return list(_FILES)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:  # noqa: ARG002  (click's)
        if cmd_name not in _FILES:
            return None
        command: click.Command = getattr(import_module(f"gtmbench.cli.{_FILES[cmd_name]}"), f"{cmd_name}_command")
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        try:
            return super().resolve_command(ctx, args)
        except click.NoSuchCommand:  # click suggests none that isn't imported
            raise click.NoSuchCommand(args[0], possibilities=_FILES, ctx=ctx) from None

    def make_context(self, *arguments: Any, **extra: Any) -> click.Context:
        with _pipes():
            return super().make_context(*arguments, **extra)

    def invoke(self, ctx: click.Context) -> Any:
        with _pipes():
            return super().invoke(ctx)


@contextmanager
def _pipes() -> Iterator[None]:
    try:
        yield
    except BrokenPipeError as error:
        raise _PrintError(_unforeseen(error)) from error


class _PrintError(GtmbenchError):
    """Nothing can be printed to standard output any more: its error is for the other stream."""


@click.group(cls=_App, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="gtmbench")
def app() -> None:
    """Fly an aircraft, break a sensor, and find out from the sensors alone.

    Without arguments, `gtmbench run` reproduces section 4.4 of the dissertation: 15 broken gyros, 15 verdicts.
    """


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit; no traceback for anything that was foreseen."""
    given = list(sys.argv[1:] if arguments is None else arguments)
    as_json = "--json" in given
    one_thread()
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal without ± or ² gets ?, not a traceback
    warnings.showwarning = lambda message, *_: None if as_json else _note(message)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))  # so that what stands aside is cleared away
    sys.exit(_run(given, as_json))


def _run(given: list[str], as_json: bool) -> int:
    try:
        code = app.main(given, prog_name="gtmbench", standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()  # a full disk shows here, not after the last word
    except click.exceptions.NoArgsIsHelpError as error:
        click.echo(error.format_message())
        return 2
    except click.UsageError as error:
        return _fail(_with_help(error, given), as_json)
    except click.ClickException as error:
        return _fail(error.format_message(), as_json)
    except GtmbenchError as error:
        return _fail(str(error), as_json and not isinstance(error, _PrintError))
    except (KeyboardInterrupt, click.Abort):
        return _fail("interrupted; nothing is half-written", as_json, code=130)
    except (OSError, MemoryError) as error:
        return _fail(_unforeseen(error), as_json)
    except Exception as error:  # exit code 1 would say that a fault was found
        traceback.print_exc()
        return _fail(f"this shouldn't have happened ({type(error).__name__}: {error}); please report it", as_json)
    return code if isinstance(code, int) else 0


def _unforeseen(error: OSError | MemoryError) -> str:
    """Return what failed, of a file by its name; what has none is what is printed: to a pipe or a file."""
    if isinstance(error, MemoryError):
        return f"there isn't memory enough; {error or 'close others'}"
    why = error.strerror or str(error) or type(error).__name__
    if error.filename is not None:
        return f"{error.filename}: {why}"
    with suppress(OSError, ValueError):  # what couldn't be printed would be tried again when Python ends
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
    return f"can't print to standard output: {why}"


def _with_help(error: click.UsageError, given: Sequence[str]) -> str:
    """Return what is wrong with a command line, and where it says how it should be."""
    message = error.format_message().rstrip(".").replace("is not a valid float", "is no number")
    if error.ctx is None:
        return message
    if isinstance(error, click.NoSuchCommand) and (now := moved_command(given)):
        return now
    if isinstance(error, click.NoSuchOption) and (now := moved_option(str(error.ctx.command.name), error.option_name)):
        return f"{error.option_name} has moved: {now}"
    if "Did you mean" in message:
        return message
    dashed = next((word for word in given if re.match(r"-[a-z]{2}", word)), None)
    if isinstance(error, click.NoSuchOption) and dashed:
        return f"{message}. Did you mean '-{dashed}'?"
    if isinstance(error, click.NoSuchCommand) and is_file(Path(given[0])):
        return f"{message}. Did you mean 'gtmbench monitor {given[0]}'?"
    return f"{message}; {error.ctx.command_path} --help says what there is"


def _note(message: Warning | str) -> None:
    if isinstance(message, RankWarning | NoteWarning):  # a library's own warnings mean nothing to a user
        echo(f"note: {one_line(str(message))}", err=True)


def _fail(message: str, as_json: bool, code: int = 2) -> int:
    line = one_line(message)
    with suppress(OSError):  # nobody listens any more
        if as_json:
            print_json(envelope("error", line, {"error": line}, exit_code=code))
        else:
            echo(f"gtmbench: {line}", err=True)
    return code

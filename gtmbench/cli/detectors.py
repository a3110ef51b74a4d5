"""What the commands share about detectors and faults of one's own: ``--detector``, ``--calibrated``, ``--import``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from gtmbench.errors import InputError

F = TypeVar("F", bound=Callable[..., Any])
METAVAR = "NAME|FILE.json|FILE.py:OBJECT|PACKAGE:OBJECT"
_HELP = (
    "The detector: a name from `gtmbench list`, a bank's .toml, a monitor's .json from `gtmbench calibrate`, or a "
    "Python object (a detector, a monitor, or a function from a record to the times of its alarms). Python is "
    "imported only if you name it here."
)


def detector_option(text: str = "", *, multiple: bool = False, calibrated: bool = True) -> Callable[[F], F]:
    """Return the option ``--detector``, and ``--calibrated``."""

    def added(command: F) -> F:
        if calibrated:
            command = click.option(
                "--calibrated",
                type=click.Path(path_type=Path),
                metavar="FILE.json",
                help="The file that `gtmbench calibrate` saved for your own --detector.",
            )(command)
        name = "detectors" if multiple else "detector"
        help_text = f"{_HELP} {text}".strip() + (" Repeat it for several." if multiple else "")
        return click.option("--detector", name, multiple=multiple, metavar=METAVAR, help=help_text)(command)

    return added


def import_option(command: F) -> F:
    """Add ``--import``: packages or files that register faults of one's own."""

    def brought(_context: click.Context, _option: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
        if value:
            from gtmbench.faults.registry import import_package

            for source in value:
                import_package(source)
        return value

    return click.option(
        "--import",
        "imported",
        multiple=True,
        metavar="PACKAGE|FILE.py",
        expose_value=False,
        is_eager=True,
        callback=brought,
        help="Import this first, to register your own faults for use in scenarios.",
    )(command)


def watchers_of(sources: Sequence[str], calibrated: Path | None) -> list[Any]:
    """Return what a command's ``--detector``, given several times, names: the dissertation's stays a name.

    Raises
    ------
    InputError
        Where --calibrated doesn't say whose figures it holds.
    """
    from gtmbench.detectors.registry import find_detector

    if calibrated is not None and len(sources) != 1:
        raise InputError(f"--calibrated {calibrated} is of one detector; give --detector FILE.py:OBJECT once")
    return [source if source == "dissertation" else find_detector(source, calibrated=calibrated) for source in sources]

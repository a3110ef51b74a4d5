"""What the commands share about detectors and faults of one's own: ``--detector``, ``--import``."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, TypeVar

import click

F = TypeVar("F", bound=Callable[..., Any])
METAVAR = "NAME|FILE.json|FILE.py:OBJECT|PACKAGE:OBJECT"
_HELP = (
    "The detector: a name from `gtmbench list`, a bank's .toml, a monitor's .json from `gtmbench calibrate`, or a "
    "Python object (a detector, a monitor, or a function from a record to the times of its alarms; with what `gtmbench "
    "calibrate` saved of it: FILE.py:OBJECT@FILE.json). Python is imported only if you name it here."
)


def detector_option(text: str = "", *, multiple: bool = False) -> Callable[[F], F]:
    """Return the option ``--detector``."""
    name = "detectors" if multiple else "detector"
    help_text = f"{_HELP} {text}".strip() + (" Repeat it for several." if multiple else "")
    return click.option("--detector", name, multiple=multiple, metavar=METAVAR, help=help_text)


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
        help="Import this first, to register your own faults, for scenarios and for names in a verdict.",
    )(command)


def watchers_of(sources: Sequence[str]) -> list[Any]:
    """Return what a command's ``--detector``, given several times, names: the dissertation's stays a name."""
    from gtmbench.detectors.registry import find_detector

    return [source if source == "dissertation" else find_detector(source) for source in sources]

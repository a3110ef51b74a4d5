"""Whatever can serve as a detector, as one: recipes, monitors, classes of either, banks and plain functions.

Detectors of installed packages are listed by name without importing them, and imported where one is named.
"""

from __future__ import annotations

from typing import Any, cast

from gtmbench.checks import meant, one_line, shown
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.detectors.base import FunctionDetector
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.errors import InputError
from gtmbench.imports import DETECTORS, load_installed, load_object
from gtmbench.imports import installed as announced

CROSS_CHECK = "cross-check"
_WHERE = "gtmbench.engine.course.detector:CrossCheck"  # above this room, so it is imported where it is named
_DETECTOR = ("name", "channels", "calibrate")
_MONITOR = (
    "name",
    "channels",
    "suspects",
    "sample_period_s",
    "look_ahead_s",
    "memory_s",
    "provenance",
    "watch",
    "stream",
)


def adapted(given: Any, called: str | None = None) -> Detector | Monitor:
    """Return an object as a Detector or a Monitor; `called` is what the user calls it.

    InputError saying what is missing.
    """
    if isinstance(given, type):
        given = _instance_of(given)
    if isinstance(given, Bank):
        return BankDetector(bank=given)
    for mark, what, wanted in (("watch", "Monitor", _MONITOR), ("calibrate", "Detector", _DETECTOR)):
        if hasattr(given, mark):
            _check(given, what, wanted, called)
            return cast(Detector | Monitor, given)
    if callable(given):
        return FunctionDetector(given)
    raise InputError(
        f"{shown(called or given)} is a {type(given).__name__}, no detector; give a Detector, a Monitor, a Bank or a "
        "function from a Record to the times of its alarms"
    )


def cross_check() -> Detector:
    """Return the detector of the engine's course.

    >>> cross_check().name
    'cross-check'
    """
    return cast(Detector, adapted(load_object(_WHERE)))


def installed_names() -> dict[str, str]:
    """Return the names of installed detectors and where each stands, ``package.module:OBJECT``; nothing is imported."""
    return announced(DETECTORS)


def installed(name: str) -> Detector | Monitor:
    """Return an installed detector by its name. InputError where none has that name, or it can't be imported."""
    names = installed_names()
    if name not in names:
        raise InputError(
            f"no installed detector is called '{name}'; there are {', '.join(names) or 'none'}{meant(name, names)}"
        )
    return adapted(load_installed(DETECTORS, name), name)


def _instance_of(cls: type) -> Any:
    """Return an object of a class that needs nothing to be made."""
    try:
        return cls()
    except TypeError as error:
        raise InputError(f"{cls.__name__} can't be made without arguments: {one_line(str(error))}") from error


def _check(given: Any, what: str, wanted: tuple[str, ...], called: str | None) -> None:
    named = called or getattr(given, "name", None) or type(given).__name__
    missing = [name for name in wanted if not hasattr(given, name)]
    if missing:
        hint = "" if what == "Detector" else "; gtmbench.BaseMonitor gives what may be left out"
        raise InputError(f"a {what} has {', '.join(wanted)}; '{named}' lacks {', '.join(missing)}{hint}")
    if not isinstance(given.name, str) or not given.name:
        raise InputError(f"'{named}': name is {shown(given.name)}; it must be a short text")
    channels = given.channels
    if isinstance(channels, str) or not all(isinstance(name, str) for name in channels):
        raise InputError(f"'{named}': channels is {shown(channels)}; it must be a tuple of names, ('p', 'q')")

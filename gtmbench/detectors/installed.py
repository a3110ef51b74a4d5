"""Detectors of installed packages: listed by name without importing them, imported where one is named."""

from __future__ import annotations

from importlib.metadata import EntryPoint, entry_points

from gtmbench.checks import one_line
from gtmbench.detectors.adapt import adapted
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.errors import InputError

GROUP = "gtmbench.detectors"


def installed_names() -> dict[str, str]:
    """Return the names of installed detectors and where each stands, ``package.module:OBJECT``; nothing is imported."""
    return {name: point.value for name, point in _points().items()}


def installed(name: str) -> Detector | Monitor:
    """Return an installed detector by its name.

    Raises
    ------
    InputError
        Where none has that name, or it can't be imported.
    """
    points = _points()
    if name not in points:
        raise InputError(f"no installed detector is called '{name}'; there are {', '.join(points) or 'none'}")
    point = points[name]
    try:
        found = point.load()
    except Exception as error:  # somebody's package may fail in any way
        said = one_line(str(error)) or type(error).__name__
        raise InputError(f"the installed detector '{name}' ({point.value}) can't be imported: {said}") from error
    return adapted(found, name)


def _points() -> dict[str, EntryPoint]:
    return {point.name: point for point in sorted(entry_points(group=GROUP), key=lambda point: point.name)}

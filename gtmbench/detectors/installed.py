"""Detectors of installed packages: listed by name without importing them, imported where one is named."""

from __future__ import annotations

from gtmbench.detectors.adapt import adapted
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.errors import InputError
from gtmbench.imports import installed as announced
from gtmbench.imports import load_installed

GROUP = "gtmbench.detectors"  # of entry points: NAME = "package.module:OBJECT"


def installed_names() -> dict[str, str]:
    """Return the names of installed detectors and where each stands, ``package.module:OBJECT``; nothing is imported."""
    return announced(GROUP)


def installed(name: str) -> Detector | Monitor:
    """Return an installed detector by its name.

    Raises
    ------
    InputError
        Where none has that name, or it can't be imported.
    """
    names = installed_names()
    if name not in names:
        raise InputError(f"no installed detector is called '{name}'; there are {', '.join(names) or 'none'}")
    return adapted(load_installed(GROUP, name), name)

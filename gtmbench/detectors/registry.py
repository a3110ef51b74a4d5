"""Detectors by what a user writes: a name, a bank's or a monitor's file, or an object in Python.

Python is imported only where a name ends in ``:OBJECT`` (or is that of an installed package's detector); data files go
through `for_data_file`, which doesn't know that form. What few ask for is imported where it is named: who watches a log
needs none of it.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from gtmbench.checks import meant, shown
from gtmbench.detectors.adapt import CROSS_CHECK, adapted, cross_check, installed, installed_names
from gtmbench.detectors.bank.bank import load_bank
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.bank_detector import AutoDetector, BankDetector
from gtmbench.detectors.base import FunctionDetector
from gtmbench.detectors.protocol import Detector, Monitor, is_recipe
from gtmbench.errors import InputError
from gtmbench.files.shipped import shipped_banks
from gtmbench.files.writing import LOGS, is_folder

DISSERTATION = "dissertation"


def find_detector(source: str | Path) -> Detector | Monitor:
    """Return a detector, or a monitor if the source is one.

    Parameters
    ----------
    source : str or Path
        ``dissertation``, ``auto``, ``cross-check``, the name of a bank, of a rival or of an installed detector; the
        TOML file of a bank; a monitor's JSON file; or ``FILE.py:OBJECT``, ``package.module:OBJECT``, which imports that
        Python: a Detector, a Monitor, a class of either that needs no arguments, a Bank, or a function from a Record to
        the times of its alarms. ``FILE.py:OBJECT@FILE.json`` is the monitor that was saved of such a detector.

    Raises
    ------
    InputError
        If there is no such detector, or the file isn't of it.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.find_detector("C").channels
    ('p', 'q', 'r', 'phi', 'psi', 'theta')
    >>> gb.find_detector("dissertation").outputs
    ('r',)
    """
    name, figures = _and_figures(str(source))
    if not is_python(source):
        return for_data_file(source)
    detector = _python(name)
    if figures is None:
        return detector
    if not is_recipe(detector):
        raise InputError(f"{name} is a monitor, calibrated already; leave @{figures} out")
    from gtmbench.detectors.monitor_file import load_monitor

    return load_monitor(figures, detector)


def as_detector(given: Any) -> Detector | Monitor:
    """Return whatever can serve as a detector as one.

    `given`: a class of the first two that needs no arguments, too; text and paths are what `find_detector` takes.
    InputError saying what is missing.

    >>> as_detector(lambda record: []).calibrate([]).suspects
    ()
    """
    return find_detector(given) if isinstance(given, str | Path) else adapted(given)


def prepared(given: Any) -> Detector | Monitor:
    """Return whatever can serve as a detector as one; a plain function, which learns nothing, as a monitor at once.

    InputError as `as_detector`.

    >>> is_recipe(prepared(lambda record: [])), is_recipe(prepared("C"))
    (False, True)
    """
    detector = as_detector(given)
    return detector.calibrate() if isinstance(detector, FunctionDetector) else detector


def for_data_file(source: str | Path) -> Detector | Monitor:
    """Return a detector that a baseline, a scenario or a campaign names: by name or by its file, never in Python.

    InputError if it is Python, or there is none of that name.
    """
    if is_python(source):
        raise InputError(
            f"'{source}': a data file doesn't import Python; give --detector FILE.py:OBJECT on the command line"
        )
    name, suffix = str(source), Path(source).suffix.lower()
    if name == DISSERTATION:
        from gtmbench.detectors.windowed_norm import DissertationOperator

        return DissertationOperator()
    if name == AUTO:
        return AutoDetector()
    if name == CROSS_CHECK:
        return cross_check()
    if name in shipped_banks() or suffix == ".toml":
        return BankDetector(bank=load_bank(source))
    if suffix == ".json":
        from gtmbench.detectors.monitor_file import load_monitor

        return load_monitor(source)
    from gtmbench.detectors.rivals.catalogue import RIVALS
    from gtmbench.detectors.surfaces.surfaces import SURFACE_DETECTORS

    if name in RIVALS:
        return RIVALS[name]
    if name in SURFACE_DETECTORS:
        return SURFACE_DETECTORS[name]
    if name in installed_names():
        return installed(name)
    raise InputError(_none(name, suffix))


def _none(name: str, suffix: str) -> str:
    """Return what to say of a text that names no detector."""
    if suffix == ".py":
        return f"{name} is a file of Python; say which object in it is the detector: {name}:OBJECT"
    if is_folder(name):
        return f"{name} is a folder; give a bank's .toml or a monitor's .json in it, or a name of `gtmbench list`"
    if suffix in LOGS:
        return f"{name} is no detector but, by its name, a log; watch it: gtmbench monitor {name}"
    known = detector_names()
    return (
        f"no detector is called {shown(name)}; there are {', '.join(known)}, or give a bank's .toml, a monitor's "
        f".json, FILE.py:OBJECT or package.module:OBJECT{meant(name, known)}"
    )


def detector_names() -> dict[str, str]:
    """Return every detector that can be named, and what it is in a line; installed ones aren't imported.

    >>> list(detector_names())[:3]
    ['dissertation', 'auto', 'B']
    """
    from gtmbench.detectors.rivals.catalogue import RIVALS
    from gtmbench.detectors.surfaces.surfaces import SURFACE_DETECTORS

    banks = {name: load_bank(name).title for name in shipped_banks()}
    others = {name: f"installed: {value}" for name, value in installed_names().items()}
    ours = {
        DISSERTATION: "an operator between sensors, and E(k) of its residual",
        AUTO: "a bank of the relations that the channels allow, of those of banks C and B",
        **banks,
        **{name: rival.title for name, rival in RIVALS.items()},
        **{name: detector.title for name, detector in SURFACE_DETECTORS.items()},
        CROSS_CHECK: "magnetometer, GPS, accelerometers, airspeed and altitude, compared with each other",
    }
    return ours | {name: title for name, title in others.items() if name not in ours}


def is_python(source: str | Path) -> bool:
    r"""Whether an object in Python is meant; a drive's colon (``C:\bank.toml``) isn't followed by a name.

    >>> [is_python(source) for source in ("mine.py:Mine", "mine.py:Mine@mine.json", "mine.json", "C")]
    [True, True, False, False]
    """
    place, colon, name = _and_figures(str(source))[0].rpartition(":")
    return bool(colon and place) and all(part.isidentifier() for part in name.split("."))


def _and_figures(source: str) -> tuple[str, str | None]:
    """Return the name of a detector and the file of its figures, where one stands behind it."""
    name, at, figures = source.rpartition("@")
    return (name, figures) if at and figures.lower().endswith(".json") else (source, None)


def _python(source: str) -> Detector | Monitor:
    from gtmbench.imports import load_object

    return adapted(load_object(source), source.rpartition(":")[2])

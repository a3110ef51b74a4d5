"""A monitor as one JSON file: numbers and names, nothing that runs; read back bit for bit, every key checked.

Its digest tells whether it holds what was written. One envelope for every detector: ``detector`` says whose figures
they are, and that detector's ``restore`` reads them.
"""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from gtmbench.checks import naming, shown, text
from gtmbench.detectors.adapt import CROSS_CHECK, cross_check, installed, installed_names
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.bank_detector import AutoDetector, BankDetector, BankMonitor, restore_bank
from gtmbench.detectors.protocol import Detector, Monitor
from gtmbench.detectors.rivals.rival import Rival, RivalMonitor
from gtmbench.detectors.surfaces.surfaces import SurfaceDetector, SurfaceMonitor, restore_surfaces
from gtmbench.detectors.tables import keys, table_of
from gtmbench.detectors.windowed_norm import DissertationOperator, NormMonitor, restore_norm
from gtmbench.errors import InputError, NoteWarning
from gtmbench.files.plain import dumps
from gtmbench.files.seals import KEY, check_seal, seal
from gtmbench.files.writing import atomic_write, check_size, is_file, no_such
from gtmbench.version import __version__

FORMAT = "gtmbench monitor"
VERSION = 3  # of the file's layout; 1 and 2 are read, too


def _restore_rival(figures: Mapping[str, Any], provenance: Mapping[str, Any]) -> Monitor:
    from gtmbench.detectors.rivals.catalogue import restore_rival  # who watches a log needs none of them

    return restore_rival(figures, provenance)


BUILT_IN: dict[str, Callable[[Mapping[str, Any], Mapping[str, Any]], Monitor]] = {
    "bank": restore_bank,
    "dissertation": restore_norm,
    "rival": _restore_rival,
    "surfaces": restore_surfaces,
    CROSS_CHECK: lambda figures, provenance: cross_check().restore(figures, provenance),
}

_KEYS_2 = ("format", "version", "gtmbench", "detector", "figures", "provenance")  # version 2: without a digest
_KEYS = (*_KEYS_2, KEY)
_FIGURES_1 = ("sample_period_s", "name", "bank", "residuals")  # version 1: a bank's, beside the others
_KEYS_1 = ("format", "version", "gtmbench", *_FIGURES_1, "provenance")
_LARGEST_FILE_BYTES = 50_000_000  # beyond is a broken file
_MOST_DIGITS = 18  # of a whole number
_MOST_WORDS = 400  # characters of a message: a broken file may hold anything


def save_monitor(monitor: Monitor, path: str | Path) -> None:
    """Write a monitor; `load_monitor` returns one with the same judgements, on any machine.

    Saving a loaded monitor gives the same bytes.

    Parameters
    ----------
    monitor : Monitor
        Of any detector that gives `figures`.
    path : str or Path
        The file; replaced when the new one is complete.

    Raises
    ------
    InputError
        If the file can't be written there, or the monitor holds what couldn't be read back.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((9000, 4))
    >>> record = gb.Record(noise, channels=["p", "q", "r", "beta"], sample_period_s=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.save_monitor(gb.calibrate(record, bank=gb.load_bank("paper")), Path(folder, "monitor.json"))
    ...     gb.load_monitor(Path(folder, "monitor.json")).operators["r"]
    Transmissibility([p q beta] -> r, lags -5..5, rank 33 of 33, condition nan)
    """
    path = Path(path)
    try:
        content = _text(monitor)
        kept = _kept_document(_parsed(content))
        if kept.detector in BUILT_IN:
            BUILT_IN[kept.detector](kept.figures, kept.provenance)
    except (TypeError, ValueError, RecursionError) as error:  # an InputError is a ValueError
        raise InputError(f"the monitor can't be saved: {_short(error)}") from error
    with atomic_write(path) as aside:
        aside.write_text(content, encoding="utf-8", newline="\n")


def load_monitor(path: str | Path, detector: Detector | None = None) -> Monitor:
    """Read a monitor that `save_monitor` or ``gtmbench calibrate`` wrote.

    Parameters
    ----------
    path : str or Path
    detector : Detector, optional
        The recipe of the figures in the file; needed if it neither comes with gtmbench nor is installed.

    Raises
    ------
    InputError
        Naming the file, the key, its value and what is legal.

    Examples
    --------
    >>> import tempfile
    >>> import gtmbench as gb
    >>> import numpy as np
    >>> u = np.random.default_rng(1).standard_normal(2000)
    >>> record = gb.Record(np.column_stack([u, 2.0 * u + np.roll(u, 9)]), channels=["p", "r"], sample_period_s=0.01)
    >>> recipe = gb.DissertationOperator(inputs=("p",), causal_order=2, noncausal_order=2, window=100)
    >>> monitor = recipe.calibrate([record, record])
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.save_monitor(monitor, f"{folder}/mine.json")
    ...     again = gb.load_monitor(f"{folder}/mine.json")
    >>> again.threshold == monitor.threshold
    True
    """
    path = Path(path)
    if not is_file(path):
        raise InputError(no_such(path, "`gtmbench calibrate` writes one"))
    try:
        check_size(path, "monitor", _LARGEST_FILE_BYTES)
        document = _parsed(path.read_text(encoding="utf-8"))
        kept = _kept_document(document)
        if KEY not in document:
            why = f"{path} carries no digest, so whether it was altered can't be told; calibrate anew, or save it again"
            warnings.warn(NoteWarning(why), stacklevel=2)
        return _restored(kept) if detector is None else _restored_by(detector, kept)
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: {_short(error)}") from error


def check_monitor(path: Path) -> None:
    """Refuse a monitor's file that doesn't hold what was written, whoever can read its figures. Raises InputError."""
    with naming(path):
        check_size(path, "monitor", _LARGEST_FILE_BYTES)
        if KEY not in (document := _parsed(path.read_text(encoding="utf-8"))):
            raise InputError("it carries no digest")
        _kept_document(document)


def digest_in(path: Path) -> str | None:
    """Return the digest that a monitor's file carries; None where it carries none, as older ones do."""
    with naming(path):
        given = _parsed(path.read_text(encoding="utf-8")).get(KEY)
    return given if isinstance(given, str) else None


def digest_of_monitor(monitor: Monitor) -> str:
    """Return the digest that a monitor's file would carry."""
    return str(_parsed(_text(monitor))[KEY])


@dataclass(frozen=True, kw_only=True)
class _Kept:
    """What a monitor's file holds."""

    detector: str
    figures: dict[str, Any]
    provenance: dict[str, Any]


def kind_of(detector: Detector | Monitor) -> str:
    """Return who restores it: ``bank``, ``dissertation``, ``rival`` or the name of a detector of somebody's own.

    InputError if somebody's own goes by a name that is gtmbench's.
    """
    if isinstance(detector, BankDetector | BankMonitor | AutoDetector):
        return "bank"
    if isinstance(detector, DissertationOperator | NormMonitor):
        return "dissertation"
    if isinstance(detector, Rival | RivalMonitor):
        return "rival"
    if isinstance(detector, SurfaceDetector | SurfaceMonitor):
        return "surfaces"
    if basis_of(detector).is_whole:
        return CROSS_CHECK
    if detector.name in BUILT_IN:
        raise InputError(f"'{detector.name}' is the name of a detector of gtmbench; call yours otherwise")
    return detector.name


def _restored(kept: _Kept) -> Monitor:
    if kept.detector in BUILT_IN:
        return BUILT_IN[kept.detector](kept.figures, kept.provenance)
    if kept.detector not in installed_names():
        raise InputError(
            f"a monitor of '{kept.detector}', which isn't installed here; give --detector FILE.py:OBJECT@FILE.json"
        )
    return _restored_by(installed(kept.detector), kept)


def _restored_by(detector: Detector | Monitor, kept: _Kept) -> Monitor:
    restore = getattr(detector, "restore", None)
    if restore is None:
        raise InputError(f"'{detector.name}' has no restore(figures, provenance); a Detector that reads files needs it")
    if kind_of(detector) != kept.detector:
        raise InputError(
            f"a monitor of '{kept.detector}', which '{detector.name}' can't restore; give its own detector"
        )
    monitor: Monitor = restore(kept.figures, kept.provenance)
    if monitor.name != detector.name:
        raise InputError(f"a monitor of '{monitor.name}', and the detector is '{detector.name}'; give its own detector")
    return monitor


def _kept_document(document: Any) -> _Kept:
    """Check the envelope; version 1 held a bank's figures beside the other keys."""
    if not isinstance(document, dict) or document.get("format") != FORMAT:
        raise InputError("it isn't a monitor of gtmbench; `gtmbench calibrate` writes one")
    version, by = document.get("version"), document.get("gtmbench")
    if type(version) is not int or not 1 <= version <= VERSION:
        raise InputError(
            f"version is {shown(version)}, written by gtmbench {shown(by)}; this is gtmbench {__version__}, which "
            f"reads versions 1 to {VERSION}: use the other, or run `gtmbench calibrate`"
        )
    keys("", document, {1: _KEYS_1, 2: _KEYS_2, VERSION: _KEYS}[version])
    if version == VERSION:
        check_seal(document, "copy it anew, or run `gtmbench calibrate`")
    text("gtmbench", by)
    if version == 1:
        document = {**document, "detector": "bank", "figures": {key: document[key] for key in _FIGURES_1}}
    return _Kept(
        detector=text("detector", document["detector"]),
        figures=table_of("figures", document["figures"]),
        provenance=table_of("provenance", document["provenance"]),
    )


def _text(monitor: Monitor) -> str:
    """Write a line for every figure, and a line for every entry of a table of tables: differences can be read."""
    figures = _figures(monitor)
    document = {
        "format": FORMAT,
        "version": VERSION,
        "gtmbench": __version__,
        "detector": kind_of(monitor),
        "figures": figures,
        "provenance": dict(monitor.provenance),
    }
    sealed = seal(document)
    lines = {key: _line(value, "  ") for key, value in sealed.items()}
    lines["figures"] = _table({key: _line(value, "    ") for key, value in figures.items()}, "  ")
    return _table(lines, "") + "\n"


def _figures(monitor: Monitor) -> dict[str, Any]:
    figures = monitor.figures()
    if not isinstance(figures, dict):
        raise InputError(f"figures() of '{monitor.name}' returned {shown(figures)}; return a table of plain values")
    return figures


def _line(value: Any, indent: str = "") -> str:
    """Write a value on a line, but tables of tables a line an entry."""
    if isinstance(value, dict) and value and all(isinstance(entry, dict) for entry in value.values()):
        return _table({key: dumps(entry) for key, entry in value.items()}, indent)
    return dumps(value)


def _table(lines: Mapping[str, str], indent: str) -> str:
    rows = ",\n".join(f"{indent}{dumps(key)}: {line}" for key, line in lines.items())
    return f"{{\n{rows}\n{indent[2:]}}}"


def _parsed(text: str) -> Any:
    """Read JSON that holds finite numbers and every key once."""
    try:
        return json.loads(
            text, parse_float=_float, parse_int=_int, parse_constant=_float, object_pairs_hook=_without_twins
        )
    except json.JSONDecodeError as error:
        raise InputError(
            f"it isn't whole JSON ({error.msg}, line {error.lineno}, column {error.colno}); copy it anew, or run "
            "`gtmbench calibrate`"
        ) from error
    except RecursionError:
        raise InputError("its JSON is nested too deeply for a monitor; run `gtmbench calibrate`") from None


def _float(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise InputError(f"it holds {text[:40]}; a monitor holds finite numbers")
    return value


def _int(text: str) -> int:
    if len(text) > _MOST_DIGITS:
        raise InputError(f"it holds a whole number of {len(text)} digits; a monitor has none so long")
    return int(text)


def _without_twins(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    table = dict(pairs)
    if len(table) < len(pairs):
        twice = next(key for key in table if sum(other == key for other, _ in pairs) > 1)
        raise InputError(f"key {twice[:60]!r} stands there twice")
    return table


def _short(error: BaseException) -> str:
    words = " ".join(str(error).split()) or type(error).__name__
    return words if len(words) <= _MOST_WORDS else f"{words[: _MOST_WORDS - 3]}..."

"""A monitor as one JSON file: numbers and names, nothing that runs; read back bit for bit, every key checked."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np

from gtmbench.detectors.bank.bank import bank_table
from gtmbench.detectors.bank.detector import BankMonitor
from gtmbench.detectors.bank.parsing import FORMAT, NEVER, OPERATOR_KEYS, VERSION, parse_monitor
from gtmbench.errors import InputError
from gtmbench.files import check_size, is_file, written_aside
from gtmbench.version import __version__

_LARGEST_FILE_BYTES = 50_000_000
_MOST_DIGITS = 18  # of a whole number
_MOST_WORDS = 400  # characters of a message: a broken file may hold anything


def save_monitor(monitor: BankMonitor, path: str | Path) -> None:
    """Write a monitor; `load_monitor` returns one that judges alike, on any machine.

    Of the operators, what watching and describing need is kept; their covariances aren't. Saving what was loaded
    gives the same bytes.

    Parameters
    ----------
    monitor : CalibratedBank
    path : str or Path
        The file; replaced when the new one is complete.

    Raises
    ------
    InputError
        Where the file can't be written there, or the monitor holds what couldn't be read back.

    Examples
    --------
    >>> import tempfile
    >>> from gtmbench.detectors.bank.bank import load_bank
    >>> from gtmbench.detectors.bank.detector import calibrate
    >>> from gtmbench.record import Record
    >>> noise = np.random.default_rng(1).standard_normal((9000, 4))
    >>> record = Record(noise, channels=["p", "q", "r", "beta"], sample_period_s=0.1)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     save_monitor(calibrate(record, bank=load_bank("paper")), Path(folder, "monitor.json"))
    ...     load_monitor(Path(folder, "monitor.json")).operators["r"]
    Transmissibility([p q beta] -> r, lags -5..5, rank 33 of 33, condition nan)
    """
    path = Path(path)
    try:
        lines = [f"{json.dumps(key)}: {_line(value)}" for key, value in _document(monitor).items()]
        text = "{\n" + ",\n".join(lines) + "\n}\n"
        parse_monitor(_parsed(text))
    except (TypeError, ValueError, RecursionError) as error:  # an InputError is a ValueError
        raise InputError(f"the monitor can't be saved: {_short(error)}") from error
    with written_aside(path) as aside:
        aside.write_text(text, encoding="utf-8", newline="\n")


def load_monitor(path: str | Path) -> BankMonitor:
    """Read a monitor that `save_monitor` or ``gtmbench calibrate`` wrote.

    Raises
    ------
    InputError
        Naming the file, the key, what stands there and what should.
    """
    path = Path(path)
    try:
        if not is_file(path):
            raise InputError("no such file; `gtmbench calibrate` writes one")
        check_size(path, "monitor", _LARGEST_FILE_BYTES)
        return BankMonitor(**vars(parse_monitor(_parsed(path.read_text(encoding="utf-8")))))
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"{path}: {_short(error)}") from error


def _document(monitor: BankMonitor) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "version": VERSION,
        "gtmbench": __version__,
        "sample_period_s": monitor.sample_period_s,
        "name": monitor.bank.name,
        "bank": bank_table(monitor.bank),
        "residuals": {spec.output: _residual_table(monitor, spec.output) for spec in monitor.bank.residuals},
        "provenance": dict(monitor.provenance),
    }


def _residual_table(monitor: BankMonitor, output: str) -> dict[str, Any]:
    operator, whitener = monitor.operators[output], monitor.whiteners[output]
    tolerance, thresholds = monitor.tolerances[output], monitor.thresholds[output]
    doubt = monitor.doubts.get(output)
    return {
        "operator": {key: _plain(getattr(operator, key)) for key in OPERATOR_KEYS},
        "whitener": {key: _plain(getattr(whitener, key)) for key in ("coefficients", "mean", "deviation")},
        "tolerance": {key: getattr(tolerance, key) for key in ("mean", "low", "high")},
        "thresholds": {label: NEVER if value == math.inf else value for label, value in thresholds.items()},
        "doubt": None if doubt is None else {key: _plain(getattr(doubt, key)) for key in ("raw", "white", "root")},
    }


def _plain(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else list(value) if isinstance(value, tuple) else value


def _line(value: Any) -> str:
    """Write a value of the first level: on a line, but tables of tables a line an entry."""
    if isinstance(value, dict) and value and all(isinstance(entry, dict) for entry in value.values()):
        entries = [f"  {json.dumps(key)}: {json.dumps(entry, allow_nan=False)}" for key, entry in value.items()]
        return "{\n" + ",\n".join(entries) + "\n}"
    return json.dumps(value, allow_nan=False)


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

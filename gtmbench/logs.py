"""Flights as files: CSV and Parquet whose headers carry the units, read back bit for bit."""

from __future__ import annotations

from pathlib import Path

from gtmbench.channels import header_of
from gtmbench.errors import InputError
from gtmbench.files import written_aside
from gtmbench.record import Record

SUFFIXES = (".csv", ".parquet")


def check_log_path(path: Path) -> str:
    """Return the ending of a log's path, or refuse it."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a flight is written as {' or '.join(SUFFIXES)}, not as '{path.suffix}'")
    return suffix


def write_log(record: Record, path: str | Path) -> None:
    """Write a record; `read_log` returns it with the same values, channels and times.

    Raises
    ------
    InputError
        Where the ending isn't .csv or .parquet, or the folder can't be written.
    """
    path = Path(path)
    suffix = check_log_path(path)
    frame = record.frame().rename(columns=header_of).reset_index()
    with written_aside(path) as aside:
        if suffix == ".csv":
            frame.to_csv(aside, index=False)
        else:
            frame.to_parquet(aside, index=False)


def read_log(path: str | Path) -> Record:
    """Read an evenly sampled log with a header row: ``time_s`` and columns with units (``p_deg_s``, ``beta_deg``).

    Columns that the channel table doesn't know are kept by their own names.

    Raises
    ------
    InputError
        Where the file is missing, isn't a table, has no time, is unevenly sampled, or a known channel's unit is
        missing or another one.
    """
    import pandas as pd

    path = Path(path)
    suffix = check_log_path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    try:
        frame = pd.read_csv(path) if suffix == ".csv" else pd.read_parquet(path)
    except (ValueError, OSError, MemoryError) as error:  # pandas' and pyarrow's own errors are among these
        reason = str(error).splitlines()[0] if str(error) else type(error).__name__
        raise InputError(f"{path} isn't a readable {suffix[1:]} table: {reason}") from error
    try:
        return Record.from_frame(frame)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error

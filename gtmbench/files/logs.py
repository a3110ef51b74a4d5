"""Flights as files of our own: CSV and Parquet whose headers carry the units, read back bit for bit.

Two doors lead from a file to records. `read_log` is for what `write_log` wrote, and for logs that keep to it: one
header, one even clock, our units; whatever differs is an error, nothing is guessed, mended or left out. `open_log`
(`gtmbench.intake`) is for anybody's log: it finds out formats, units and clocks, cuts at gaps, and says what it did.
What they share stands below both: headers in `gtmbench.values.channels`, how large a log may be here.
"""

from __future__ import annotations

import warnings
from pathlib import Path
from typing import TYPE_CHECKING

from gtmbench.checks import naming, one_line, shown
from gtmbench.errors import InputError
from gtmbench.files.writing import atomic_write, check_size, count_lines, is_file, no_such
from gtmbench.values.channels import channel_of, header_of
from gtmbench.values.record import Record

if TYPE_CHECKING:
    import pandas as pd

SUFFIXES = (".csv", ".parquet")
LARGEST_LOG_BYTES = 1 << 30  # more is no log of one flight
MOST_LOG_VALUES = 200_000_000  # samples times channels: 1.6 GB of doubles


def check_log_path(path: Path) -> str:
    """Return the ending of a log's path, or refuse it."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a flight is written as {' or '.join(SUFFIXES)}, not as '{path.suffix}'")
    return suffix


def write_log(record: Record, path: str | Path) -> None:
    """Write a record; `read_log` returns it with the same values, channels and times.

    Parameters
    ----------
    record : Record
    path : str or Path
        The ending sets the format: ``.csv`` or ``.parquet``.

    Raises
    ------
    InputError
        If the ending isn't .csv or .parquet, the folder can't be written, or a channel's name would be read back
        as something else.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> record = gb.Record([[1.5, 0.1], [2.5, 0.2]], channels=["p", "beta"], sample_period_s=0.01)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(record, Path(folder, "log.csv"))
    ...     print(Path(folder, "log.csv").read_text().splitlines()[0], gb.read_log(Path(folder, "log.csv")))
    time_s,p_deg_s,beta_deg Record(2 samples, 0..0.01 s, every 0.01 s: p, beta)
    """
    path = Path(path)
    suffix = check_log_path(path)
    for name in record.channels:
        if not _comes_back(name):
            raise InputError(f"channel '{name}' would be read back as something else; rename it before writing")
    frame = record.frame().rename(columns=header_of).reset_index()
    with atomic_write(path) as aside:
        if suffix == ".csv":
            frame.to_csv(aside, index=False)
        else:
            frame.to_parquet(aside, index=False)


def _comes_back(name: str) -> bool:
    try:
        return name != "time_s" and channel_of(header_of(name)) == name
    except InputError:
        return False


def read_log(path: str | Path, *, sample_period_s: float | None = None) -> Record:
    """Read an evenly sampled log with a header row: ``time_s`` and columns with units (``p_deg_s``, ``beta_deg``).

    Columns that the channel table doesn't know are kept by their own names. With `sample_period_s` given, only the
    first stamp is used: for logs whose stamps are rounded.

    Parameters
    ----------
    path : str or Path
        CSV or Parquet.
    sample_period_s : float, optional
        Ts, in seconds.

    Raises
    ------
    InputError
        If the file is missing, isn't a table, has no time, is unevenly sampled, or a known channel's unit is
        missing or another one.

    Examples
    --------
    >>> import tempfile
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(gb.fly("gtm", duration_s=1.0), f"{folder}/flight.csv")
    ...     record = gb.read_log(f"{folder}/flight.csv")
    >>> len(record), record.sample_period_s, record.channels[:3]
    (101, 0.01, ('p', 'q', 'r'))
    """
    import pandas as pd

    path = Path(path)
    suffix = check_log_path(path)
    if not is_file(path):
        raise InputError(no_such(path))
    check_size(path, "log", LARGEST_LOG_BYTES)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)  # rows longer than the header
            frame = _read_csv(path) if suffix == ".csv" else _read_parquet(path)
    # ValueError and OSError: pandas' and pyarrow's own errors are among these
    except (ValueError, OSError, MemoryError, pd.errors.ParserWarning) as error:
        reason = one_line(str(error)) or type(error).__name__
        raise InputError(f"{path} isn't a readable {suffix[1:]} table: {reason}") from error
    with naming(path):
        names = {name: name if name == "time_s" else channel_of(str(name)) for name in frame.columns}
        return Record.from_frame(frame.rename(columns=names), sample_period_s=sample_period_s)


def _read_csv(path: Path) -> pd.DataFrame:
    """Read a table under its own column names: pandas would number those that stand there twice."""
    import pandas as pd

    lines = count_lines(path)
    names = pd.read_csv(path, header=None, nrows=1, dtype=str).iloc[0].tolist()
    twice = [name for name in names if names.count(name) > 1]
    if twice:
        raise ValueError(f"column {shown(twice[0])} stands there twice")
    _check_values(lines * len(names))
    return pd.read_csv(path, index_col=False)


def _read_parquet(path: Path) -> pd.DataFrame:
    import pandas as pd
    import pyarrow.parquet as pq

    held = pq.read_metadata(path)
    _check_values(held.num_rows * held.num_columns)  # a few kilobytes can say that there are billions
    return pd.read_parquet(path)


def _check_values(count: int) -> None:
    if count > MOST_LOG_VALUES:
        raise ValueError(f"it would be {count:.3g} values; at most {MOST_LOG_VALUES:.0e} are read")

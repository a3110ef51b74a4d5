"""What tables have in common, CSV or Parquet: columns of numbers, one clock, which one of the columns tells."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import MOST_COLUMNS


def check_names(names: Sequence[str]) -> None:
    """Refuse a table whose columns can't be told apart, or that has more than are meant."""
    if len(names) > MOST_COLUMNS:
        raise InputError(f"it has {len(names)} columns; at most {MOST_COLUMNS} are read")
    seen: set[str] = set()
    for name in names:
        if name and name in seen:
            raise InputError(f"column '{name[:60]}' stands there twice; rename one of them")
        seen.add(name)


def dates_in_seconds(dates: NDArray[Any]) -> tuple[NDArray[np.float64], str]:
    """Return dates as seconds since the first of them, NaN where one is missing, and a note that says so."""
    nanoseconds = dates.astype("datetime64[ns]")
    there = ~np.isnat(nanoseconds)
    if not there.any():
        return np.full(len(dates), np.nan), "no date can be read"
    first = nanoseconds[there][0]
    whole = (nanoseconds - first).astype(np.int64)
    return np.where(there, whole / 1e9, np.nan), f"dates: times are since the first, {first.astype('datetime64[us]')}"

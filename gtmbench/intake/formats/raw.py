"""What a log's file holds before anything is made of it: columns as they are named, each with its own stamps."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import one_line
from gtmbench.clock import FloatArray
from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import MOST_VALUES

EPOCH_S = 1e8  # stamps beyond three years count from 1970, not from when the logger was switched on
_GREATEST = 1e100
_LAST_DATE_S = 2.5e11  # of four figures a year


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """Which channel a column is, by a format's documentation: its unit there, and -1 where its axis points away."""

    channel: str
    unit: str
    sign: float = 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class RawSeries:
    """A column of a log.

    Attributes
    ----------
    name : str
        As the log calls it; of a container ``topic.field``.
    load : function
        Gives its values as they are stored, shape (samples,).
    clock : str
        Which of the log's clocks its stamps are.
    unit : str
        As stated beside the name; "" where it isn't.
    meaning : Meaning or None
        Where the format documents what it is.
    """

    name: str
    load: Callable[[], NDArray[Any]] = field(repr=False)
    clock: str = ""
    unit: str = ""
    meaning: Meaning | None = None

    def values(self) -> FloatArray:
        """Return the values as float64, NaN where they are beyond all measure: nothing can be calculated with them."""
        values = self.load().astype(np.float64)
        values[~(np.abs(values) < _GREATEST)] = np.nan
        return values


@dataclass(frozen=True, kw_only=True, eq=False)
class RawLog:
    """A log's columns and clocks.

    Attributes
    ----------
    kind : str
        The format, as a message calls it.
    series : tuple of RawSeries
    clocks : mapping of FloatArray
        Stamps in seconds, in the file's order; empty where a column has to be found that tells the time.
    ignored : tuple of str
        Columns that hold no numbers.
    notes : tuple of str
        What a reader of this log should know about how it was read.
    by_name : bool
        Whether columns that aren't documented may be known by their names: anybody's tables, not a container's topics.
    """

    kind: str
    series: tuple[RawSeries, ...]
    clocks: Mapping[str, FloatArray] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()
    by_name: bool = True

    def with_clocks(self, clocks: Mapping[str, FloatArray], *notes: str) -> RawLog:
        """Return the log with these clocks beside its own, and with notes on them."""
        return replace(self, clocks={**self.clocks, **clocks}, notes=(*self.notes, *notes))


def first_stamp(stamps: NDArray[Any]) -> float:
    """Return the first stamp that is one, NaN where none is."""
    finite = stamps[np.isfinite(stamps)] if stamps.dtype.kind == "f" else stamps
    return finite[0] if len(finite) else np.nan


def in_seconds(clocks: Mapping[str, NDArray[Any]], per_second: float) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return stamps in seconds, counted from the first where they count from 1970, and a note that says so."""
    starts = [first for first in map(first_stamp, clocks.values()) if np.isfinite(first)]
    origin = min(starts, default=0)
    if not origin / per_second > EPOCH_S:
        return {name: stamps / per_second for name, stamps in clocks.items()}, ()
    # whole numbers are subtracted as such: nanoseconds since 1970 don't fit into a double
    seconds = {name: (stamps - origin).astype(np.float64) / per_second for name, stamps in clocks.items()}
    since_s = float(origin) / per_second
    said = np.datetime64(round(since_s * 1e3), "ms") if since_s < _LAST_DATE_S else f"{since_s:.6g} s"
    return seconds, (f"stamps count from 1970: times are since the first, {said}",)


def check_values(count: float, what: str) -> None:
    """Refuse more values than fit into memory."""
    if not count <= MOST_VALUES:
        raise InputError(f"{what} would be {count:.3g} values; at most {MOST_VALUES:.0e} are read: cut the log")


@contextmanager
def reading(path: Path, kind: str) -> Iterator[None]:
    """Turn whatever a format's library raises on a broken file into one line that names the file.

    Libraries raise nearly anything on garbage, bare Exceptions included; nothing but a library's work on a file belongs
    into this block.
    """
    try:
        yield
    except InputError as error:
        raise InputError(f"{path}: {one_line(str(error))}") from error
    except Exception as error:
        reason = one_line(str(error))[:160] or type(error).__name__
        raise InputError(f"{path} isn't a readable {kind}: {reason}") from error

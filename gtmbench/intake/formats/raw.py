"""What a log's file holds before anything is made of it: columns as they are named, each with its own stamps.

And what several formats store otherwise than channels are: stamps in ticks, dates, attitudes as quaternions.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.events import Event
from gtmbench.intake.published_failures import Injection
from gtmbench.values.clock import FloatArray
from gtmbench.values.pieces import pieces

IntArray = NDArray[np.int64]

_EPOCH_S = 1e8  # stamps beyond three years count from 1970, not from when the logger was switched on
ANGLES = ("roll", "pitch", "yaw")  # that a quaternion becomes


@dataclass(frozen=True, kw_only=True)
class Meaning:
    """Which channel a column is: its unit, -1 where its axis points away, and how many seconds late it was stamped."""

    channel: str
    unit: str
    sign: float = 1.0
    late_s: float = 0.0
    guessed: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class RawSeries:
    """A column of a log."""

    name: str  # as the log calls it; of a container ``topic.field``
    load: Callable[[], NDArray[Any]] = field(repr=False)  # gives its values as they are stored, shape (samples,)
    clock: str = ""  # which of the log's clocks its stamps are
    unit: str = ""  # as stated beside the name; "" where it isn't
    meaning: Meaning | None = None  # where the format documents what it is
    made_of: tuple[str, ...] = ()  # the columns that it is worked out of, where the file itself has no such column
    # of a column of dates, which becomes seconds since its first one: when that is, in seconds since 1970
    since_s: float = 0.0
    told: str = ""  # what its values were before they became seconds: dates, times of day or durations; "" for numbers

    def stored(self) -> FloatArray:
        """Return the values as float64, as they stand there."""
        return self.load().astype(np.float64)

    def values(self) -> FloatArray:
        """Return the values as float64, NaN where they are beyond all measure: nothing can be calculated with them."""
        values = self.stored()
        for rows in pieces(len(values)):
            measured(values[rows])
        return values


def measured(values: FloatArray) -> None:
    """Put NaN where values are beyond all measure, in place."""
    values[~(np.abs(values) < 1e100)] = np.nan  # no reading is larger


@dataclass(frozen=True, kw_only=True, eq=False)
class RawLog:
    """A log's columns and clocks."""

    kind: str  # the format, as a message calls it
    series: tuple[RawSeries, ...]
    # stamps in seconds, in the file's order; empty where a column has to be found that tells the time
    clocks: Mapping[str, FloatArray] = field(default_factory=dict)
    ignored: tuple[str, ...] = ()  # columns that hold no numbers
    notes: tuple[str, ...] = ()  # what a reader of this log should know about how it was read
    # whether columns that aren't documented may be known by their names: anybody's tables, not a container's topics
    by_name: bool = True
    time: tuple[str, str] | None = None  # the column that tells the time, and its unit; None where the container does
    is_nameless: bool = False  # whether it is a table without a header, whose columns are called by their numbers
    rate_hz: float = 0.0  # samples a second, as stated beside the columns; 0 where that isn't
    facts: Mapping[str, str] = field(default_factory=dict, repr=False)  # what stands above a table, by name
    # what shows the time's column or unit, where nothing states it; of several tables, with their columns
    time_guessed: str = ""
    # whether the documented attitude is that of an estimator which the gyros drive, as autopilots' are
    attitude_from_gyros: bool = False
    hardware: str = ""  # the identifier of the autopilot that wrote it, as the log states it; "" where it doesn't
    # whether a radio received it, so that what is missing may be the link's loss and no sensor's
    is_received: bool = False
    # gives what the log says happened, in any order, on the clocks as they are; nothing of a table
    events: Callable[[], Sequence[Event]] = field(default=tuple, repr=False)
    # gives the failures that the log says were injected, likewise
    injections: Callable[[], Sequence[Injection]] = field(default=tuple, repr=False)
    # gives some columns a batch of rows after the other, by name; of a format that can be read so
    batches: Callable[[Sequence[str]], Iterator[Mapping[str, NDArray[Any]]]] | None = field(default=None, repr=False)

    def with_clocks(self, clocks: Mapping[str, FloatArray], *notes: str) -> RawLog:
        """Return the log with these clocks beside its own, and with notes on them."""
        return replace(self, clocks={**self.clocks, **clocks}, notes=(*self.notes, *notes))

    def parts(self, series: RawSeries) -> Iterator[FloatArray]:
        """Give a column's values a part after the other, where the format can: who has seen enough reads no further."""
        if self.batches is None or series.made_of or series.unit:  # worked out, or dates
            yield series.values()
            return
        for batch in self.batches([series.name]):
            values = batch[series.name].astype(np.float64)
            measured(values)
            yield values


@dataclass(frozen=True, kw_only=True, eq=False)
class Cells:
    """What some cells of a column are to hold instead."""

    column: RawSeries
    rows: IntArray  # which of its values, from 0
    values: FloatArray  # instead of those; NaN for none


@dataclass(frozen=True, kw_only=True)
class Format:
    """A format of logs."""

    name: str  # as a message lists it
    magic: tuple[bytes, ...]  # what its files begin with: one of these
    # of files that are nothing else: one that begins otherwise is refused, not tried as a CSV
    suffixes: tuple[str, ...]
    # Gives a path's log. With `has_parts`, it also takes which part of the file is meant, "" for all of it.
    read: Callable[..., RawLog]
    # writes a file anew with other values in some cells, everything else as it was
    rewrite: Callable[[Path, Path, Sequence[Cells]], None] | None = None
    pattern: bytes = b""  # a regular expression of what they begin with, where no few bytes tell; "" for none
    has_parts: bool = False  # whether what stands behind a colon names a part: a branch, a sheet, a system
    is_folder: Callable[[Path], bool] | None = None  # tells whether a folder is one log of this format

    def begins(self, head: bytes) -> bool:
        """Tell whether a file's first bytes are those of this format."""
        return head.startswith(self.magic) or bool(self.pattern and re.match(self.pattern, head, re.DOTALL))


def documented_first(series: Iterable[RawSeries], documented: Iterable[tuple[str, str]]) -> tuple[RawSeries, ...]:
    """Return a container's columns as its format's documentation, (topic, field) by (topic, field), prefers them."""
    order = [f"{topic}.{field}" for topic, field in documented]
    return tuple(sorted(series, key=lambda column: order.index(column.name) if column.meaning else len(order)))


def in_seconds(clocks: Mapping[str, NDArray[Any]], per_second: float) -> tuple[dict[str, FloatArray], tuple[str, ...]]:
    """Return stamps in seconds, counted from the first where they count from 1970, and a note that says so."""
    firsts = [origin_of(stamps, per_second) for stamps in clocks.values() if len(stamps)]
    since = [first for first in firsts if first is not None]
    if 2 * len(since) <= len(firsts):  # most of them count from when the logger was switched on
        return {name: stamps / per_second for name, stamps in clocks.items()}, ()
    origin = min(since)
    # whole numbers are subtracted as such: nanoseconds since 1970 don't fit into a double
    seconds = {name: (stamps - origin).astype(np.float64) / per_second for name, stamps in clocks.items()}
    return seconds, (since_text(float(origin) / per_second),)


def origin_of(stamps: NDArray[Any], per_second: float) -> Any | None:
    """Return the first of some stamps that counts from 1970, in their unit, where most do; else None."""
    known = stamps[np.isfinite(stamps)] if stamps.dtype.kind == "f" else stamps
    late = known[known > _EPOCH_S * per_second]
    return late[0] if 2 * len(late) > len(known) else None


def since_text(origin_s: float, *, is_utc: bool = True) -> str:
    """Say when stamps begin that count from 1970, or that are dates of no stated zone.

    >>> since_text(1714564800.25)
    'stamps count from 1970: times are since the first, 2024-05-01 12:00:00.250 UTC'
    """
    said = f"{origin_s:.6g} s"
    if origin_s < 2.5e11:  # a year has four figures
        said = date_text(np.datetime64(round(origin_s * 1e3), "ms"), is_utc=is_utc)
    return f"stamps {'count from 1970' if is_utc else 'are dates'}: times are since the first, {said}"


def date_text(date: np.datetime64, *, is_utc: bool) -> str:
    """Return a date and a time of day to a millisecond."""
    return str(date.astype("datetime64[ms]")).replace("T", " ") + " UTC" * is_utc


def euler_deg(quaternion: Sequence[NDArray[Any]], angle: str) -> FloatArray:
    """Return roll, pitch or yaw in degrees; the quaternion is w, x, y, z, from the body to the world.

    >>> euler_deg([np.array([0.5**0.5]), np.array([0.5**0.5]), np.array([0.0]), np.array([0.0])], "roll").round(9)
    array([90.])
    """
    w, x, y, z = (np.asarray(part, dtype=np.float64) for part in quaternion)
    with np.errstate(all="ignore"):  # a quaternion of zeros has no attitude: NaN
        norm = w * w + x * x + y * y + z * z
        if angle == "roll":
            turned = np.arctan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
        elif angle == "pitch":
            turned = np.arcsin(np.clip(2 * (w * y - x * z) / norm, -1.0, 1.0))
        else:
            turned = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return np.where(np.abs(norm - 1.0) < 0.1, np.degrees(turned), np.nan)

"""The gate where readings enter: what lies beyond a channel's physical range is missing, counted and told.

No instrument and no fault reads such a number; a damaged file does. A single one says nothing of the sensor. Where it
is more than one reading in a hundred of a second, the sensor isn't judged.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from gtmbench.values.channels import LEAST_LIMIT, limit_of
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray, Record, Span

_SECOND_S = 1.0  # about a reading, in which the others are counted
_MOST = 0.01  # of a second's readings
REASON = "readings beyond the range of any such sensor"


@dataclass(frozen=True, kw_only=True)
class OutOfRange:
    """Readings of a channel that no sensor reads, and that are taken as missing.

    Attributes
    ----------
    channel : str
    count : int
    first_s, first : float
        When the first of them was, in seconds, and what it read, in the channel's unit.
    spans : tuple of (start, end)
        Where they are more than one in a hundred of a second's readings: the channel isn't judged there.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.OutOfRange(channel="q", count=1, first_s=12.5, first=1e30).text
    '1 reading of q is 1e30: taken as missing'
    """

    channel: str
    count: int
    first_s: float
    first: float
    spans: tuple[Span, ...] = field(default=(), repr=False)

    @property
    def text(self) -> str:
        """What was done, in a line."""
        read = f"{self.first:.4g}".replace("e+", "e")
        if self.count == 1:
            return f"1 reading of {self.channel} is {read}: taken as missing"
        first = f"beyond {limit_of(self.channel):g}, the first {read} at {self.first_s:.6g} s"
        return f"{self.count} readings of {self.channel} are {first}: taken as missing"


def out_of_range(channel: str, time_s: FloatArray, outside: BoolArray, first: float) -> OutOfRange:
    """Return what there is to say of readings in time, some of which are outside, and what the first of those is.

    >>> time_s = np.arange(200) * 0.01
    >>> found = out_of_range("q", time_s, time_s == 1.0, 1e30)
    >>> found.count, found.spans
    (1, ())
    """
    rows = np.flatnonzero(outside)
    spans = tuple(_judged_nowhere(time_s, rows))
    return OutOfRange(channel=channel, count=len(rows), first_s=float(time_s[rows[0]]), first=first, spans=spans)


def _judged_nowhere(time_s: FloatArray, rows: np.ndarray[tuple[int], np.dtype[np.int64]]) -> Iterator[Span]:
    """Give where some rows are more than one in a hundred of those of the second before or behind one of them."""
    at_s, places = time_s[rows], np.arange(len(rows))
    since, until = np.searchsorted(at_s, at_s - _SECOND_S, "right"), np.searchsorted(at_s, at_s + _SECOND_S, "left")
    before = rows + 1 - np.searchsorted(time_s, at_s - _SECOND_S, "right")
    behind = np.searchsorted(time_s, at_s + _SECOND_S, "left") - rows
    many = (places + 1 - since > _MOST * before) | (until - places > _MOST * behind)
    around_s = at_s[many]
    for group in np.split(around_s, np.flatnonzero(np.diff(around_s) > 2.0 * _SECOND_S) + 1):
        if len(group):
            yield float(group[0] - _SECOND_S), float(group[-1] + _SECOND_S)


def within_range(record: Record) -> tuple[Record, tuple[OutOfRange, ...]]:
    """Return a record without readings that no sensor reads, and what these were.

    >>> within_range(Record([[1.0], [1e30]], channels=["q"], sample_period_s=0.1))[0]["q"]
    array([ 1., nan])
    """
    found: list[OutOfRange] = []
    if not (np.abs(record.values) > LEAST_LIMIT).any():
        return record, ()
    for channel in record.channels:
        values = record[channel]
        outside = np.abs(values) > limit_of(channel)
        if outside.any():
            found.append(out_of_range(channel, record.time_s, outside, float(values[outside][0])))
            record = record.replace(channel, np.where(outside, np.nan, values))
    return record, tuple(found)

"""An excursion: a stretch in which residuals say nothing, for the motion is beyond what the monitor knows."""

from __future__ import annotations

import math
from dataclasses import dataclass

from gtmbench.values.record import Record

MOTION = "motion beyond what was identified"  # a reason


@dataclass(frozen=True, kw_only=True)
class Excursion:
    """A stretch in which residuals say nothing.

    Attributes
    ----------
    start_s, end_s : float
    reason : str
        What it is: ``touchdown``, ``reset``, ``motion beyond what was identified``.
    settles_s : float
        How long after it an alarm that began with it may be its own: estimators take their time.
    is_judged : bool
        Whether residuals are judged all the same: it is told, and nothing need come of it. Only an alarm that begins
        there can't be told.
    is_hard : bool
        Whether gyros and attitude both turned harder there than the monitor knows.
    """

    start_s: float
    end_s: float
    reason: str
    settles_s: float = 10.0
    is_judged: bool = False
    is_hard: bool = False


def rows_of(excursion: Excursion, record: Record) -> range:
    """Return the rows of a record that an excursion covers."""
    rows = rows_about(excursion, record.start_s, record.sample_period_s)
    return range(min(rows.start, len(record)), min(rows.stop, len(record)))


def rows_about(excursion: Excursion, start_s: float, period_s: float) -> range:
    """Return the rows that an excursion covers of rows that begin at `start_s`, however many these are."""
    first, last = ((time_s - start_s) / period_s for time_s in (excursion.start_s, excursion.end_s))
    return range(max(math.ceil(first - 1e-6), 0), max(math.floor(last + 1e-6) + 1, 0))

"""From residuals to alarms: every series over its threshold, the greatest of a residual's being its level."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.bank.calibrated import BankResiduals, CalibratedBank, all_series, bank_residuals
from gtmbench.detectors.bank.statistics import Series
from gtmbench.record import FloatArray, Record, frozen


@dataclass(frozen=True, kw_only=True)
class Crossing:
    """A residual's level that rises above 1.

    Attributes
    ----------
    output : str
        Whose residual.
    row : int
        Of the record; the residual of this row is known at `time_s`.
    time_s : float
        When the alarm could be raised: look-ahead counted.
    onset_row : int
        Where the change began, as far as the series tells.
    series : str
        Which test crossed, the one furthest above its threshold.
    """

    output: str
    row: int
    time_s: float
    onset_row: int
    series: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Level:
    """A residual's greatest statistic over its threshold, row for row; an alarm above 1.

    Attributes
    ----------
    values : shape (samples,)
        NaN where no series exists.
    known_s : shape (samples,)
        When each value is known, in seconds.
    """

    values: FloatArray = field(repr=False)
    known_s: FloatArray = field(repr=False)
    leading: np.ndarray[tuple[int], np.dtype[np.int_]] = field(repr=False)
    series: tuple[Series, ...] = field(repr=False)


def levels(monitor: CalibratedBank, record: Record, residuals: BankResiduals) -> dict[str, Level]:
    """Return every residual's level on a record."""
    found = {}
    for output, series in all_series(monitor, residuals).items():
        thresholds = monitor.thresholds[output]
        values = np.full(len(record), -np.inf)
        leading = np.zeros(len(record), dtype=int)
        for i, one in enumerate(series):
            level = over(one.values, thresholds[one.label])
            higher = level > values  # never where it is NaN
            values[higher] = level[higher]
            leading[higher] = i
        values[np.isneginf(values)] = np.nan
        known_s = np.round(record.time_s + monitor.look_ahead_of(output), 9)
        found[output] = Level(values=frozen(values), known_s=frozen(known_s), leading=leading, series=tuple(series))
    return found


def over(values: FloatArray, threshold: float) -> FloatArray:
    """Return values over their threshold: above 1 where they pass it, also where both are negative."""
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(threshold / values if threshold < 0.0 else values / threshold)


def crossings(level: Mapping[str, Level], *, from_row: int = 0) -> list[Crossing]:
    """Return the upward crossings of 1, in the order in which they can be known; missing values are passed over."""
    found = []
    for output, one in level.items():
        there = np.flatnonzero(~np.isnan(one.values[from_row:])) + from_row
        above = one.values[there] > 1.0
        rising = above & ~np.concatenate([[False], above])[:-1]
        for row in there[rising].tolist():
            series = one.series[one.leading[row]]
            reach = int(np.broadcast_to(series.reach, one.values.shape)[row])
            found.append(
                Crossing(
                    output=output,
                    row=row,
                    time_s=float(one.known_s[row]),
                    onset_row=max(row - reach, 0),
                    series=series.label,
                )
            )
    return sorted(found, key=lambda crossing: (crossing.time_s, crossing.output))


def bank_alarms(monitor: CalibratedBank, record: Record) -> list[Crossing]:
    """Return every alarm of a monitor on a record, without asking what it means; `watch` does."""
    return crossings(levels(monitor, record, bank_residuals(monitor, record)))

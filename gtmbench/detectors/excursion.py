"""An excursion: a stretch in which residuals say nothing, for the motion is beyond what the monitor knows.

How fast the aircraft turns, held against what a monitor was calibrated on.

An operator's error is a share of what turns: at the rates of a tumble, and in an oscillation quicker than any that it
was identified on, a percent of it passes for a fault. Gyros tell the rates, and so do the steps of the angles; only
where both say so is it motion, so one sensor's fault can't pass for that.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record

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


_AVERAGED_S = 0.06  # over which rates are averaged: noise isn't motion
COVERED = 0.999  # of the rows that a monitor was calibrated on
BEYOND = 1.5  # times what these reach: less costs names, more misses touchdowns
APART_S = 0.15  # an attitude may be late
_FASTER, _STRAYS_DEG = 1.5, 2.0  # than the gyros say, within that: lags differ, and readings have noise
_ABOUT_S = 1.0  # longer than a row is told from the rows about it
STEEP_DEG = 80.0  # of pitch: beyond, an error of roll or heading is 6 times one of what turns
_KEYS = ("gyros_deg_s", "gyros_swing_deg_s", "attitude_deg_s", "attitude_swing_deg_s")


@dataclass(frozen=True, kw_only=True)
class Turning:
    """How fast it turned where a monitor was calibrated, and how far that swung within 0.2 s."""

    # what 99.9 % of the rows don't exceed, in deg/s, rates and their swing as the gyros tell them and as the attitude
    # does; empty where that isn't known
    limits: tuple[float, ...] = ()

    @classmethod
    def of(cls, records: Iterable[Record]) -> Turning:
        """Return how fast it turned in records; without limits where they lack a gyro or an angle."""
        sizes = [_sizes(record) for record in records if {*GYROS, *ATTITUDE} <= set(record.channels)]
        known = [each[np.isfinite(each)] for each in np.concatenate(sizes, axis=1)] if sizes else []
        if not known or not all(map(len, known)):
            return cls()
        return cls(limits=tuple(float(np.quantile(each, COVERED)) for each in known))

    @classmethod
    def from_provenance(cls, provenance: Mapping[str, Any]) -> Turning:
        """Return what a monitor's provenance tells; no limits where it doesn't."""
        told = provenance.get("turning")
        limits = [told.get(key) for key in _KEYS] if isinstance(told, Mapping) else []
        numbers = [float(limit) for limit in limits if isinstance(limit, (int, float))]
        return cls(limits=tuple(numbers)) if len(numbers) == len(_KEYS) else cls()

    @property
    def table(self) -> dict[str, float]:
        """As plain values, which `told` reads; empty without limits."""
        return dict(zip(_KEYS, self.limits, strict=True)) if self.limits else {}

    def excursion(self, record: Record, known: int = 0) -> Excursion | None:
        """Return the motion beyond that in a record, or near the vertical, from its first row to its last, or None.

        `known`: so many of its first rows were looked at before, and nothing was beyond.
        """
        if not self.limits or not len(record):
            return None
        begin = min(max(known - round(_ABOUT_S / record.sample_period_s), 0), len(record))
        is_beyond = _is_steep(record)
        is_beyond[begin:] |= self._beyond(record.part(range(begin, len(record))))
        times_s = record.time_s[is_beyond]
        return Excursion(start_s=float(times_s[0]), end_s=float(times_s[-1]), reason=MOTION) if len(times_s) else None

    def _beyond(self, record: Record) -> BoolArray:
        """Return the rows in which gyros say that it is beyond, and about then the attitude does."""
        with np.errstate(invalid="ignore"):
            beyond = _sizes(record) > BEYOND * np.array(self.limits)[:, np.newaxis]
        rate, swing = (_about(told, round(APART_S / record.sample_period_s)) for told in beyond[2:])
        return np.asarray((beyond[0] & rate) | (beyond[1] & swing))


def _is_steep(record: Record) -> BoolArray:
    """Return the rows near the vertical, but where pitch came there faster than the gyros turned: that is its fault."""
    theta = record["theta"]
    rows = max(round(APART_S / record.sample_period_s), 1)
    with np.errstate(invalid="ignore"):
        is_steep = np.abs(theta) > STEEP_DEG
    if not is_steep.any():  # as nearly always, and every look at an alarm asks
        return np.asarray(is_steep)
    turned = np.cumsum(np.nan_to_num(np.linalg.norm(record.matrix(GYROS), axis=1))) * record.sample_period_s
    came = np.diff(is_steep, prepend=False) & is_steep
    since = np.maximum.accumulate(np.where(came, np.arange(len(theta)), 0))  # the row with which it became steep
    is_possible = np.ones(len(theta), dtype=bool)
    for lag in range(1, min(rows, len(theta) - 1) + 1):
        moved, could = np.abs(theta[lag:] - theta[:-lag]), turned[lag:] - turned[:-lag]
        is_possible[lag:] &= ~(moved > _FASTER * could + _STRAYS_DEG)
    return np.asarray(is_steep & is_possible[since])


def _about(told: BoolArray, rows: int) -> BoolArray:
    """Return where any is told within so many rows; scipy.ndimage, which has this, takes long to import."""
    count = np.concatenate([[0], np.cumsum(told)])
    at = np.arange(len(told))
    return np.asarray(count[np.minimum(at + rows + 1, len(told))] > count[np.maximum(at - rows, 0)])


def _sizes(record: Record) -> FloatArray:
    """Return how fast it turns and how far that swings, shape (4, samples) as `_KEYS`, NaN where unknown."""
    steps = np.diff(record.matrix(ATTITUDE).T, axis=1, prepend=np.nan)
    turned = ((steps + 180.0) % 360.0 - 180.0) / record.sample_period_s
    return np.array(
        [size for rates in (record.matrix(GYROS).T, turned) for size in _size(rates, record.sample_period_s)]
    )


def _size(rates: FloatArray, period_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the size of averaged rates, and how far each is from the middle of the averages beside it."""
    samples, rows = max(round(_AVERAGED_S / period_s), 1), rates.shape[1]
    size, swing = np.full(rows, np.nan), np.full(rows, np.nan)
    if rows <= 2 * samples:
        return size, swing
    count = rows - samples + 1
    averages = rates[:, :count].copy()
    for late in range(1, samples):
        averages += rates[:, late : late + count]
    averages /= samples
    first = samples // 2  # the row in the middle of the first average
    size[first : first + averages.shape[1]] = np.linalg.norm(averages, axis=0)
    strays = averages[:, samples:-samples] - (averages[:, : -2 * samples] + averages[:, 2 * samples :]) / 2.0
    swing[first + samples : first + samples + strays.shape[1]] = np.linalg.norm(strays, axis=0)
    return size, swing

"""What a fault put on a record would do to its sensor's own residual, without watching the record again.

A sensor doesn't enter its own prediction, so what a fault changes in its readings is what it changes in its residual.
Whitening passes that on from the onset, and the scores after it follow from the monitor's own statistic.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.monitor.scores import IntArray, over
from gtmbench.detectors.statistics.statistic import Spread
from gtmbench.detectors.statistics.whitening import Whitener
from gtmbench.faults.fault import Fault
from gtmbench.record import BoolArray, FloatArray, Record


@dataclass(frozen=True, kw_only=True, eq=False)
class Superposition:
    """A sensor's own residual on a record that was watched.

    Attributes
    ----------
    monitor : CalibratedBank
    sensor : str
        One with a residual of its own.
    record : Record
    raw : shape (samples,)
        Its residual.
    spread : Spread or None
        By which the residual is divided before it is judged.
    armed : shape (samples,)
        Where its score, once known, could have raised an alarm.
    """

    monitor: CalibratedBank
    sensor: str
    record: Record = field(repr=False)
    raw: FloatArray = field(repr=False)
    spread: Spread | None = field(repr=False)
    armed: BoolArray = field(repr=False)

    def alarm_row(self, fault: Fault, within_s: float) -> int | None:
        """Return a row whose score raises an alarm within some seconds of a fault's onset; None where none does.

        None, too, where the residual wasn't armed at the onset.

        Parameters
        ----------
        fault : Fault
            Of the sensor, and one that reads no other.
        within_s : float
            From the onset until the alarm could be raised: look-ahead counts.
        """
        period_s = self.record.sample_period_s
        row = round((fault.onset_s - self.record.start_s) / period_s)
        stop = min(row + round(within_s / period_s) - self._ahead + 1, len(self.record))
        if not self.armed[row] or stop <= row:
            return None
        before = max(row - 1, 0)  # what a fault begins with
        readings = self._readings[before:stop]
        changed = fault.broken(readings, self._time_s[before:stop], period_s) - readings[:, 0]
        return self._above(row, stop, changed[row - before :])

    def _above(self, row: int, stop: int, changed: FloatArray) -> int | None:
        """Return an armed row whose score is above 1 once some rows of the residual are changed by so much."""
        test, whitener, thresholds = self.monitor.bank.statistic, self._whitener, self.monitor.thresholds[self.sensor]
        first = self._looked_back_from(row)
        raw = self.raw[first:stop].copy()
        raw[row - first :] += changed
        white = self._white[first:stop].copy()
        seen = max(row - whitener.order, first)  # by the whitening filter
        white[row - first :] = whitener.whiten(raw[seen - first :])[row - seen :]
        spread = None if self.spread is None else self.spread.between(slice(first, stop))
        there, given = test.given(raw, white, spread)
        at = range(int(np.searchsorted(there, row - first)), len(there))
        rows = there[at.start :] + first
        armed = self.armed[rows]
        tolerance = self.monitor.tolerances[self.sensor]
        for score in test.of(given, self.record.sample_period_s, tolerance, at=at):
            above = np.flatnonzero((over(score.values, thresholds[score.label]) > 1.0) & armed)
            if len(above):
                return int(rows[above[0]])
        return None

    def _looked_back_from(self, row: int) -> int:
        """Return the first row that the statistics look at from one on: missing samples are passed over."""
        looks_back = self.monitor.bank.statistic.looks_back(self.record.sample_period_s)
        before = int(np.searchsorted(self._there, row)) - looks_back
        return int(self._there[before]) if before > 0 else 0

    @property
    def _ahead(self) -> int:
        return round(self.monitor.look_ahead_of(self.sensor) / self.record.sample_period_s)

    @cached_property
    def _whitener(self) -> Whitener:
        return self.monitor.whiteners[self.sensor]

    @cached_property
    def _white(self) -> FloatArray:
        return self._whitener.whiten(self.raw)

    @cached_property
    def _there(self) -> IntArray:
        return np.flatnonzero(np.isfinite(self._white))

    @cached_property
    def _readings(self) -> FloatArray:
        return self.record[self.sensor][:, np.newaxis]

    @cached_property
    def _time_s(self) -> FloatArray:
        return self.record.time_s

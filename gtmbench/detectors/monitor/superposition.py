"""What a fault put on a record would do to a residual, without watching the record again.

A sensor doesn't enter its own prediction, so what a fault changes in its readings is what it changes in its residual.
Whitening passes that on from the onset, and the scores after it follow from the monitor's own statistic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.monitor.scores import IntArray
from gtmbench.detectors.statistics.greatest import greatest_score
from gtmbench.detectors.statistics.statistic import Given, Spread, Statistic, Tolerance, over
from gtmbench.detectors.statistics.whitening import Whitener
from gtmbench.faults.fault import Fault
from gtmbench.record import BoolArray, FloatArray, Record


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangedResidual:
    """A residual of a record that may be changed from some row on.

    Attributes
    ----------
    monitor : CalibratedBank
    output : str
    raw : shape (samples,)
        As it is.
    spread : Spread or None
        By which the residual is divided before it is judged.
    """

    monitor: CalibratedBank
    output: str
    raw: FloatArray = field(repr=False)
    spread: Spread | None = field(repr=False)

    def greatest(self, begin: int, changed: FloatArray, rows: range) -> float:
        """Return the greatest score of some rows; -inf where there is none.

        Parameters
        ----------
        begin : int
        changed : shape (rows from `begin` on,)
            What the residual is instead; the last is that of the last row asked for.
        rows : range
            None before `begin`.
        """
        _, given, at = self._samples(begin, changed, rows)
        return greatest_score(self._test, given, self._period_s, self._tolerance, self._thresholds, at)

    def scores(self, begin: int, changed: FloatArray, rows: range) -> tuple[IntArray, FloatArray]:
        """Return which of some rows have a score, and the scores."""
        there, given, at = self._samples(begin, changed, rows)
        greatest = np.full(len(there), -np.inf)
        for score in self._test.of(given, self._period_s, self._tolerance, at=at):
            np.fmax(greatest, over(score.values, self._thresholds[score.label]), out=greatest)
        exists = greatest > -np.inf
        return there[exists], greatest[exists]

    @cached_property
    def ahead(self) -> int:
        """How many rows after one its score is known."""
        return round(self.monitor.look_ahead_of(self.output) / self._period_s)

    def _samples(self, begin: int, changed: FloatArray, rows: range) -> tuple[IntArray, Given, range]:
        """Return the rows asked for that have a sample, and what the statistic takes: samples, and which are meant."""
        first, before = self._before(begin)
        raw = np.concatenate([self.raw[first:begin], changed])
        seen = max(begin - self._whitener.order, first)  # by the whitening filter
        white = np.concatenate([before, self._whitener.whiten(raw[seen - first :])[begin - seen :]])
        spread = None if self.spread is None else self.spread.between(slice(first, begin + len(changed)))
        there, given = self._test.given(raw, white, spread)
        at = range(int(np.searchsorted(there, rows.start - first)), len(there))
        return there[at.start :] + first, given, at

    def _before(self, row: int) -> tuple[int, FloatArray]:
        """Return the first row that the statistics look at from one on, and what is whitened from it up to that one.

        Missing samples are passed over, so it is looked for farther and farther back.
        """
        if row not in self._latest:
            self._latest.clear()
            self._latest[row] = self._looked_back_at(row)
        return self._latest[row]

    def _looked_back_at(self, row: int) -> tuple[int, FloatArray]:
        wanted = self._test.looks_back(self._period_s)
        rows = wanted
        while True:
            first = max(row - rows, 0)
            seen = max(first - self._whitener.order, 0)
            white = self._whitener.whiten(self.raw[seen:row])[first - seen :]
            there = np.flatnonzero(np.isfinite(white))
            if len(there) > wanted or (len(there) == wanted and first > 0):
                first, white = first + int(there[-wanted]), white[there[-wanted] :]
                return first, white
            if first == 0:
                return 0, white
            rows *= 2

    @property
    def _test(self) -> Statistic:
        return self.monitor.bank.statistic

    @property
    def _tolerance(self) -> Tolerance:
        return self.monitor.tolerances[self.output]

    @property
    def _thresholds(self) -> Mapping[str, float]:
        return self.monitor.thresholds[self.output]

    @property
    def _period_s(self) -> float:
        return self.monitor.sample_period_s

    @property
    def _whitener(self) -> Whitener:
        return self.monitor.whiteners[self.output]

    @cached_property
    def _latest(self) -> dict[int, tuple[int, FloatArray]]:
        """What `_before` returned last: faults of many sizes are put on one row."""
        return {}


@dataclass(frozen=True, kw_only=True, eq=False)
class Superposition:
    """A sensor's own residual on a record that was watched.

    Attributes
    ----------
    sensor : str
        One with a residual of its own.
    record : Record
    residual : ChangedResidual
        Its own.
    armed : shape (samples,)
        Where its score, once known, could have raised an alarm.
    """

    sensor: str
    record: Record = field(repr=False)
    residual: ChangedResidual = field(repr=False)
    armed: BoolArray = field(repr=False)

    def alarm_row(self, fault: Fault, within_s: float) -> int | None:
        """Return a row whose score raises an alarm within some seconds of a fault's onset; None where none does.

        None, too, where the residual wasn't armed at the onset.

        Parameters
        ----------
        fault : Fault
            Of the sensor.
        within_s : float
            From the onset until the alarm could be raised: look-ahead counts.
        """
        row = fault.onset_row(self.record)
        stop = min(row + round(within_s / self.record.sample_period_s) - self.residual.ahead + 1, len(self.record))
        if not self.armed[row] or stop <= row:
            return None
        was, reads = fault.onwards(self.record, stop)
        changed = self.residual.raw[row:stop] + (reads - was)
        rows, scores = self.residual.scores(row, changed, range(row, stop))
        above = np.flatnonzero((scores > 1.0) & self.armed[rows])
        return int(rows[above[0]]) if len(above) else None

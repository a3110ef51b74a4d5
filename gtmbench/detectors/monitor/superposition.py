"""What a fault put on a record would do to a residual, without watching the record again.

A sensor doesn't enter its own prediction, so what a fault changes in its readings is what it changes in its residual;
but for a gyro that drives the attitude, which bends the prediction, too (`Following`).
Whitening passes that on from the onset, by the noise as it was learnt until then, and the scores after it follow from
the monitor's own statistic.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.monitor.following import Following
from gtmbench.detectors.monitor.scores import IntArray
from gtmbench.detectors.statistics.learnt_noise import NoiseFollower, follower
from gtmbench.detectors.statistics.statistic import Spread, Statistic, Tolerance, over
from gtmbench.detectors.statistics.whitening import White
from gtmbench.faults.fault import Fault
from gtmbench.values.attitude import AttitudeEstimator
from gtmbench.values.record import BoolArray, FloatArray, Record

_REMEMBERED_S = 60.0  # every so often what follows the noise is kept, for trials to go on from


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
    before : shape (rows,) or None
        On which the noise was learnt before the record began.
    """

    monitor: CalibratedBank
    output: str
    raw: FloatArray = field(repr=False)
    spread: Spread | None = field(repr=False)
    before: FloatArray | None = field(default=None, repr=False)

    def greatest(self, begin: int, changed: FloatArray, rows: range) -> float:
        """Return the greatest score of some rows; -inf where there is none. Parameters are those of `scores`."""
        return float(self.scores(begin, changed, rows)[1].max(initial=-np.inf))

    def scores(self, begin: int, changed: FloatArray, rows: range) -> tuple[IntArray, FloatArray]:
        """Return which of some rows have a score, and the scores.

        Parameters
        ----------
        begin : int
        changed : shape (rows from `begin` on,)
            What the residual is instead; the last is that of the last row asked for.
        rows : range
            None before `begin`.
        """
        first = self._first(begin)
        raw = np.concatenate([self.raw[first:begin], changed])
        return self._scores(first, raw, self._white(first, begin, changed), rows)

    def healthy_scores(self, rows: range) -> tuple[IntArray, FloatArray]:
        """Return which of some rows have a score as the residual is, and the scores."""
        first = self._first(rows.start)
        own = slice(first, rows.stop)
        return self._scores(first, self.raw[own], self._healthy.between(own), rows)

    def _scores(self, first: int, raw: FloatArray, white: White, rows: range) -> tuple[IntArray, FloatArray]:
        """Return which of some rows have a score, and the scores, by the residual from the row `first` on."""
        spread = None if self.spread is None else self.spread.between(slice(first, first + len(raw)))
        there, given = self._test.given(raw, white, spread)
        at = range(int(np.searchsorted(there, rows.start - first)), len(there))
        there = there[at.start :] + first
        greatest = np.full(len(there), -np.inf)
        for score in self._test.of(given, self._period_s, self._tolerance, at=at):
            np.fmax(greatest, over(score.values, self._thresholds[score.label]), out=greatest)
        exists = greatest > -np.inf
        return there[exists], greatest[exists]

    @cached_property
    def ahead(self) -> int:
        """How many rows after one its score is known."""
        return round(self.monitor.look_ahead_of(self.output) / self._period_s)

    def _white(self, first: int, begin: int, changed: FloatArray) -> White:
        """Return rows from `first` on, whitened by the noise as it is known before `begin`, then as it is learnt."""
        if self.monitor.knows_noise:
            return White.steady(np.concatenate([self.raw[first:begin], changed]))
        white = self._pushed(self._noise_at(begin), begin, changed)
        if len(white) < len(changed):  # it is still learning
            white = White.steady(np.full(len(changed), np.nan))
        own = white.between(slice(len(white) - len(changed), None))
        return White.joined([self._healthy.between(slice(first, begin)), own])

    def _noise_at(self, row: int) -> NoiseFollower:
        """Return what follows the noise, as it is before a row; that is remembered, for the next trial there."""
        if row not in self._remembered:
            known = max(each for each in self._remembered if each <= row)
            noise = self._remembered[known].copy()
            self._pushed(noise, known, self.raw[known:row])
            self._remembered[row] = noise
        return self._remembered[row].copy()

    def _pushed(self, noise: NoiseFollower, first: int, raw: FloatArray) -> White:
        """Return what rows from `first` on make known to what follows the noise."""
        return noise.push(raw, None if self.spread is None else self.spread.white[first : first + len(raw)])

    @cached_property
    def _followed(self) -> tuple[White, dict[int, NoiseFollower]]:
        noise = follower(self.monitor.whiteners[self.output], self._period_s, self.before)
        parts, remembered = [], {}
        every = round(_REMEMBERED_S / self._period_s)
        for first in range(0, len(self.raw), every):
            remembered[first] = noise.copy()
            parts.append(self._pushed(noise, first, self.raw[first : first + every]))
        white = White.joined(parts)
        missing = White.steady(np.full(len(self.raw) - len(white), np.nan))
        return White.joined([white, missing]), remembered

    @property
    def _healthy(self) -> White:
        return White.steady(self.raw) if self.monitor.knows_noise else self._followed[0]

    @property
    def _remembered(self) -> dict[int, NoiseFollower]:
        return self._followed[1]

    def _first(self, row: int) -> int:
        """Return the first row that the statistics look at from one on: missing samples are passed over."""
        there = np.flatnonzero(np.isfinite(self._healthy.values[:row]))
        wanted = self._test.looks_back(self._period_s)
        return int(there[-wanted]) if len(there) > wanted else 0

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
    estimator : AttitudeEstimator or None
        What makes the attitude of the sensor, a gyro, so that the attitude follows its faults; None where it doesn't.
    """

    sensor: str
    record: Record = field(repr=False)
    residual: ChangedResidual = field(repr=False)
    armed: BoolArray = field(repr=False)
    estimator: AttitudeEstimator | None = None
    _followings: dict[range, Following] = field(default_factory=dict, init=False, repr=False)

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
        stop = self._stop(row, within_s)
        if not self.armed[row] or stop <= row:
            return None
        begin, changed = self._changed(fault, row, stop)
        rows, scores = self.residual.scores(begin, changed, range(begin, stop))
        above = np.flatnonzero((scores > 1.0) & self.armed[rows])
        return int(rows[above[0]]) if len(above) else None

    def is_quiet(self, row: int, within_s: float) -> bool:
        """Tell whether nothing raises an alarm within some seconds of a row where there is no fault."""
        stop = self._stop(row, within_s)
        if stop <= row:
            return True
        following = self._following(row, stop)
        rows, scores = self.residual.healthy_scores(range(row if following is None else following.begin, stop))
        return not bool(((scores > 1.0) & self.armed[rows]).any())

    def _stop(self, row: int, within_s: float) -> int:
        """Return one past the last row whose score can raise an alarm within some seconds of another."""
        return min(row + round(within_s / self.record.sample_period_s) - self.residual.ahead + 1, len(self.record))

    def _changed(self, fault: Fault, row: int, stop: int) -> tuple[int, FloatArray]:
        """Return the first row that a fault changes, and the residual from there on up to another row."""
        following = self._following(row, stop)
        if following is None:
            was, reads = fault.onwards(self.record, stop)
            return row, self.residual.raw[row:stop] + (reads - was)
        was, reads = fault.onwards(self.record, following.stop)
        change = following.change(reads - was)[: stop - following.begin]
        return following.begin, self.residual.raw[following.begin : stop] + change

    def _following(self, row: int, stop: int) -> Following | None:
        """Return how the attitude follows what is changed from one row up to another; None where it doesn't."""
        if self.estimator is None:
            return None
        rows = range(row, min(stop + self.residual.ahead, len(self.record)))
        if rows not in self._followings:
            self._followings[rows] = Following(self.residual.monitor, self.record, self.sensor, rows, self.estimator)
        return self._followings[rows]

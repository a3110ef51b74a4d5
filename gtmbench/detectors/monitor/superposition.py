"""What a fault put on a record would do to a residual, without watching the record again.

A sensor doesn't enter its own prediction, so what a fault changes in its readings is what it changes in its residual;
but for a gyro that drives the attitude, which bends the prediction, too (`Followed`).
Whitening passes that on from the onset, by the noise as it was learnt until then, and the scores after it follow from
the monitor's own statistic.

What a gyro's fault does to its own residual where an estimator makes the attitude of that gyro.

The residual is e = y - T(u), u pseudo inputs of the attitude. A change dy of the gyro bends the angles (`Bend`), which
changes u by du = (df/dx) dx + (df/dx') dx' of every angle x, so that

    de(k) = dy(k) - sum over inputs, j of T_j du(k + d - j).

Near wings level that leaves what the references contradict: dy low-passed with the estimator's time constant. It is
linear about what was read.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.isolation.effects import Bend
from gtmbench.detectors.monitor.scores import IntArray
from gtmbench.detectors.statistics.learnt_noise import NoiseFollower, follower
from gtmbench.detectors.statistics.statistic import Allowance, Spread, Statistic, over
from gtmbench.detectors.statistics.whitening import White
from gtmbench.faults.fault import Fault
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, raw_needs, sensitivities
from gtmbench.values.attitude_estimators import AttitudeEstimator, held
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import BoolArray, FloatArray, Record


@dataclass(frozen=True, kw_only=True, eq=False)
class _Way:
    """How an angle enters an input of the operator: du = of_value x + of_slope x', row by row; and the operator."""

    angle: str
    markov: FloatArray = field(repr=False)
    of_value: FloatArray = field(repr=False)
    of_slope: FloatArray | None = field(repr=False)


class Followed:
    """A gyro's own residual in the rows about a fault's onset, with an attitude that follows the fault.

    `record`: healthy, with the bank's channels. `sensor`: the gyro. `rows`: of the record: from the onset up to the
    last that a fault is asked about.
    """

    def __init__(
        self, monitor: CalibratedBank, record: Record, sensor: str, rows: range, estimator: AttitudeEstimator
    ) -> None:
        operator = monitor.operators[sensor]
        self._ahead, self._period_s = operator.noncausal_order, record.sample_period_s
        self.begin, self.stop = max(rows.start - self._ahead - 1, 0), rows.stop  # a derivative looks a row ahead, too
        part = record.part(range(self.begin, min(rows.stop, len(record))))
        self._before = rows.start - self.begin
        self._bend = Bend(estimator, part, self._before, sensor)
        self._ways = [
            _way(part, name, angle, operator.markov[:, 0, i])
            for i, name in enumerate(operator.inputs)
            for angle in ATTITUDE
            if angle in raw_needs(name)
        ]

    def change(self, fault: FloatArray) -> FloatArray:
        """Return what the residual changes by, from row `begin` on.

        `fault`, shape (rows,): what the fault adds to the gyro; missing where the gyro is. The last `ahead` rows of
        what is returned know the future not yet, as those of the residual.
        """
        known = held(fault[:, np.newaxis])[:, 0]
        bends = self._bend.of(known[np.newaxis])
        change = np.concatenate([np.zeros(self._before), fault])
        for way in self._ways:
            angle = np.concatenate([np.zeros(self._before), bends[way.angle][0]])
            entered = way.of_value * angle
            if way.of_slope is not None:
                entered[1:-1] += way.of_slope[1:-1] * (angle[2:] - angle[:-2]) / (2.0 * self._period_s)
            change -= np.convolve(entered, way.markov)[self._ahead :][: len(change)]
        return change


def _way(record: Record, name: str, angle: str, markov: FloatArray) -> _Way:
    if name not in PSEUDO_INPUTS:
        return _Way(angle=angle, markov=markov, of_value=np.ones(len(record)), of_slope=None)
    ((of_value, of_slope),) = np.nan_to_num(sensitivities(record, [name], angle))
    return _Way(angle=angle, markov=markov, of_value=of_value, of_slope=of_slope)


_REMEMBERED_S = 60.0  # every so often what follows the noise is kept, for trials to go on from


@dataclass(frozen=True, kw_only=True, eq=False)
class ChangedResidual:
    """A residual of a record that may be changed from some row on."""

    monitor: CalibratedBank
    output: str
    raw: FloatArray = field(repr=False)  # shape (samples,): as it is
    spread: Spread | None = field(repr=False)  # by which the residual is divided before it is judged
    # shape (rows,): on which the noise was learnt before the record began
    before: FloatArray | None = field(default=None, repr=False)

    def changed_from(self, begin: int) -> ChangingResidual:
        """Return the residual as it is up to a row, and to be given what it is instead from there on."""
        return ChangingResidual(self, begin)

    def healthy_scores(self, rows: range) -> tuple[IntArray, FloatArray]:
        """Return which of some rows have a score as the residual is, and the scores."""
        first = self.first_before(rows.start)
        own = slice(first, rows.stop)
        return self.scored(first, self.raw[own], self.healthy.between(own), rows)

    def scored(self, first: int, raw: FloatArray, white: White, rows: range) -> tuple[IntArray, FloatArray]:
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

    def noise_at(self, row: int) -> NoiseFollower:
        """Return what follows the noise, as it is before a row; that is remembered, for the next trial there."""
        if row not in self._remembered:
            known = max(each for each in self._remembered if each <= row)
            noise = self._remembered[known].copy()
            self.pushed(noise, known, self.raw[known:row])
            self._remembered[row] = noise
        return self._remembered[row].copy()

    def pushed(self, noise: NoiseFollower, first: int, raw: FloatArray) -> White:
        """Return what rows from `first` on make known to what follows the noise."""
        return noise.push(raw, None if self.spread is None else self.spread.white[first : first + len(raw)])

    @cached_property
    def _followed(self) -> tuple[White, dict[int, NoiseFollower]]:
        noise = follower(self.monitor.whiteners[self.output], self._period_s, self.before)
        parts, remembered = [], {}
        every = round(_REMEMBERED_S / self._period_s)
        for first in range(0, len(self.raw), every):
            remembered[first] = noise.copy()
            parts.append(self.pushed(noise, first, self.raw[first : first + every]))
        white = White.joined(parts)
        missing = White.steady(np.full(len(self.raw) - len(white), np.nan))
        return White.joined([white, missing]), remembered

    @property
    def healthy(self) -> White:
        """As it is, whitened."""
        return White.steady(self.raw) if self.monitor.knows_noise else self._followed[0]

    @property
    def _remembered(self) -> dict[int, NoiseFollower]:
        return self._followed[1]

    def first_before(self, row: int) -> int:
        """Return the first row that the statistics look at from one on: missing samples are passed over."""
        there = np.flatnonzero(np.isfinite(self.healthy.values[:row]))
        wanted = self._test.looks_back(self._period_s)
        return int(there[-wanted]) if len(there) > wanted else 0

    @property
    def _test(self) -> Statistic:
        return self.monitor.bank.statistic

    @property
    def _tolerance(self) -> Allowance:
        return self.monitor.tolerances[self.output]

    @property
    def _thresholds(self) -> Mapping[str, float]:
        return self.monitor.thresholds[self.output]

    @property
    def _period_s(self) -> float:
        return self.monitor.sample_period_s


class ChangingResidual:
    """A residual that is another from some row on, as its rows come in.

    It is whitened by the noise as it is known before that row, then as it is learnt.

    `residual`: as it is without. `begin`: the first row that is another.
    """

    def __init__(self, residual: ChangedResidual, begin: int) -> None:
        self._residual, self._first = residual, residual.first_before(begin)
        before = slice(self._first, begin)
        self._raw, self._white = residual.raw[before], residual.healthy.between(before)
        self._noise = None if residual.monitor.knows_noise else residual.noise_at(begin)

    @property
    def row(self) -> int:
        """The next that it is given."""
        return self._first + len(self._raw)

    def push(self, raw: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return which of the next rows, of which the residual is given, have a score, and the scores."""
        rows = range(self.row, self.row + len(raw))
        if not rows:
            return np.zeros(0, dtype=int), np.zeros(0)
        self._white = White.joined([self._white, self._whitened(raw)])
        self._raw = np.concatenate([self._raw, raw])
        return self._residual.scored(self._first, self._raw, self._white, rows)

    def _whitened(self, raw: FloatArray) -> White:
        if self._noise is None:
            return White.steady(raw)
        white = self._residual.pushed(self._noise, self.row, raw)
        if len(white) < len(raw):  # it is still learning
            return White.steady(np.full(len(raw), np.nan))
        return white.between(slice(len(white) - len(raw), None))


@dataclass(frozen=True, kw_only=True, eq=False)
class Superposition:
    """A sensor's own residual on a record that was watched."""

    sensor: str  # one with a residual of its own
    record: Record = field(repr=False)
    residual: ChangedResidual = field(repr=False)  # its own
    armed: BoolArray = field(repr=False)  # shape (samples,): where its score, once known, could have raised an alarm
    # what makes the attitude of the sensor, a gyro, so that the attitude follows its faults; None where it doesn't
    estimator: AttitudeEstimator | None = None
    _followings: dict[range, Followed] = field(default_factory=dict, init=False, repr=False)

    def alarm_row(self, fault: Fault, within_s: float) -> int | None:
        """Return a row whose score raises an alarm within some seconds of a fault's onset; None where none does.

        None, too, where the residual wasn't armed at the onset.

        `fault`: of the sensor. `within_s`: from the onset until the alarm could be raised: look-ahead counts.
        """
        row = fault.onset_row(self.record)
        stop = self._stop(row, within_s)
        if not self.armed[row] or stop <= row:
            return None
        begin, changed = self._changed(fault, row, stop)
        rows, scores = self.residual.changed_from(begin).push(changed)
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

    def _following(self, row: int, stop: int) -> Followed | None:
        """Return how the attitude follows what is changed from one row up to another; None where it doesn't."""
        if self.estimator is None:
            return None
        rows = range(row, min(stop + self.residual.ahead, len(self.record)))
        if rows not in self._followings:
            self._followings[rows] = Followed(self.residual.monitor, self.record, self.sensor, rows, self.estimator)
        return self._followings[rows]

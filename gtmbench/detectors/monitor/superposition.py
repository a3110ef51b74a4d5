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

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.isolation.effects import Bend, Path
from gtmbench.detectors.monitor.scores import IntArray, ScoreTrack
from gtmbench.detectors.statistics.learnt_noise import NoiseFollower
from gtmbench.detectors.statistics.statistic import Spread
from gtmbench.faults.fault import Fault
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, raw_needs, sensitivities
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.attitude_estimators import AttitudeEstimator, held
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import BoolArray, FloatArray, Record


class Followed:
    """A gyro's own residual in the rows about a fault's onset, with an attitude that follows the fault.

    `record`: healthy, with the bank's channels. `sensor`: the gyro. `rows`: of the record: from the onset up to the
    last that a fault is asked about.
    """

    def __init__(
        self, monitor: CalibratedBank, record: Record, sensor: str, rows: range, estimator: AttitudeEstimator
    ) -> None:
        operator = monitor.operators[sensor]
        self._period_s = record.sample_period_s
        ahead = operator.noncausal_order + 1  # a derivative looks a row ahead, too
        self.begin, self.stop = max(rows.start - ahead, 0), rows.stop
        part = record.part(range(self.begin, min(rows.stop, len(record))))
        self._before = rows.start - self.begin
        self._bend = Bend(estimator, part, self._before, sensor)
        self._ways = [
            _way(part, operator, place, angle)
            for place, name in enumerate(operator.inputs)
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
            angle = np.concatenate([np.zeros(self._before), bends[way.through][0]])
            entered = way.drive(angle[np.newaxis], self._period_s)[0]
            change += np.convolve(entered, way.kernel)[way.ahead :][: len(change)]
        return change


def _way(record: Record, operator: Transmissibility, place: int, angle: str) -> Path:
    """Return how an angle enters the residual by an input of its operator."""
    of_value, of_slope = 1.0, None
    if operator.inputs[place] in PSEUDO_INPUTS:
        ((of_value, of_slope),) = np.nan_to_num(sensitivities(record, [operator.inputs[place]], angle))
    return Path(
        output=operator.outputs[0],
        kernel=-operator.markov[:, 0, place],
        ahead=operator.noncausal_order,
        of_value=of_value,
        of_slope=of_slope,
        through=angle,
    )


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

    def changed_from(self, begin: int) -> ScoreTrack:
        """Return the residual's track as it is before a row, to be given what the residual is instead from there on.

        It is whitened by the noise as it is known before that row, then as it is learnt.
        """
        noise = self._noise_at(begin)
        held = slice(begin if noise is None else noise.row, begin)
        return self._healthy.until(begin, noise, self.raw[held], self._spread_of(held))

    def pushed(self, track: ScoreTrack, raw: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return which of a track's next rows, of which the residual is given, have a score, and the scores."""
        first = track.stop
        scores = track.push(raw, self._spread_of(slice(first, first + len(raw))))
        there = np.flatnonzero(~np.isnan(scores))
        return there + first, scores[there]

    @cached_property
    def healthy_scores(self) -> FloatArray:
        """The scores as the residual is, shape (samples,); NaN where there are none."""
        return self._healthy.known(self._healthy.ahead, len(self.raw) + self._healthy.ahead)

    @property
    def ahead(self) -> int:
        """How many rows after one its score is known."""
        return self._healthy.ahead

    def _noise_at(self, row: int) -> NoiseFollower | None:
        """Return what follows the noise, as it is before a row; that is remembered, for the next trial there."""
        remembered = self._followed[1]
        if not remembered:
            return None
        if row not in remembered:
            known = max(each for each in remembered if each <= row)
            noise, spread = remembered[known].copy(), self._spread_of(slice(known, row))
            noise.push(self.raw[known:row], None if spread is None else spread.white)
            remembered[row] = noise
        return remembered[row].copy()

    @cached_property
    def _followed(self) -> tuple[ScoreTrack, dict[int, NoiseFollower]]:
        """The track of all rows, which forgets none, and what followed the noise before some of them."""
        track, remembered = ScoreTrack.of(self.monitor, self.output, self.before, tells_spikes=False), {}
        every = round(_REMEMBERED_S / self.monitor.sample_period_s)
        for first in range(0, len(self.raw), every):
            if track.noise is not None:
                remembered[first] = track.noise.copy()
            track.extend(self.raw[first : first + every], self._spread_of(slice(first, first + every)))
        return track, remembered

    @property
    def _healthy(self) -> ScoreTrack:
        return self._followed[0]

    def _spread_of(self, rows: slice) -> Spread | None:
        return None if self.spread is None else self.spread.between(rows)


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
        rows, scores = self.residual.pushed(self.residual.changed_from(begin), changed)
        above = np.flatnonzero((scores > 1.0) & self.armed[rows])
        return int(rows[above[0]]) if len(above) else None

    def is_quiet(self, row: int, within_s: float) -> bool:
        """Tell whether nothing raises an alarm within some seconds of a row where there is no fault."""
        stop = self._stop(row, within_s)
        if stop <= row:
            return True
        following = self._following(row, stop)
        rows = slice(row if following is None else following.begin, stop)
        with np.errstate(invalid="ignore"):
            return not bool(((self.residual.healthy_scores[rows] > 1.0) & self.armed[rows]).any())

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

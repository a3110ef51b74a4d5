"""What a gyro's fault does to its own residual where an estimator makes the attitude of that gyro.

The residual is e = y - T(u), u pseudo inputs of the attitude. A change dy of the gyro bends the angles (`Bend`), which
changes u by du = (df/dx) dx + (df/dx') dx' of every angle x, so that

    de(k) = dy(k) - sum over inputs, j of T_j du(k + d - j).

Near wings level that leaves what the references contradict: dy low-passed with the estimator's time constant. It is
linear about what was read.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.isolation.bend import Bend
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, raw_needs, sensitivities
from gtmbench.values.attitude_estimators import AttitudeEstimator, held
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import FloatArray, Record


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

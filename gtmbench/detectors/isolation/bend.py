"""How an attitude that the gyros drive bends with one of them: linear, about what was read.

The estimator integrates the broken gyro, so a fault is in the attitude's rate at once, and what the two leave of it is
how the references pull the attitude back: of a change u of a gyro near wings level, u / (tau s + 1).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gtmbench.attitude import ATTITUDE, AttitudeEstimator
from gtmbench.record import FloatArray, Record

# what an estimator may be that nobody tells of: each a factor of two or so from the next, which few faults tell apart
CANDIDATES = (
    *(AttitudeEstimator(time_constant_s=tau) for tau in (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0)),
    *(AttitudeEstimator(time_constant_s=tau, bias_time_constant_s=4.0 * tau) for tau in (2.0, 5.0, 15.0)),
)
_TURNS = 3  # how often one angle's bend is passed on to the others


class Bend:
    """What changes of a gyro's readings do to the attitude.

    With B(k) how the gyro enters the angles' rates and A(k) what an error of the angles adds to them, d' = A d + B u
    through the estimator's response; A d is passed on three times, which is exact to third order in the turn.

    Parameters
    ----------
    estimator : AttitudeEstimator
    record : Record
        About what it is linear.
    start : int
        The record's row from which on there are changes.
    channel : str
        p, q or r.
    """

    def __init__(self, estimator: AttitudeEstimator, record: Record, start: int, channel: str) -> None:
        self.estimator, self.record, self._start, self._channel = estimator, record, start, channel
        self._period_s = record.sample_period_s
        phi, theta, q, r = (_radians(record, name)[start:] for name in ("phi", "theta", "q", "r"))
        sin, cos, tan, secant = np.sin(phi), np.cos(phi), np.tan(theta), 1.0 / np.cos(theta)
        turn, pitch = q * sin + r * cos, q * cos - r * sin
        none, all_of_it = np.zeros_like(phi), np.ones_like(phi)
        by_gyro = {
            "p": (all_of_it, none, none),
            "q": (sin * tan, cos, sin * secant),
            "r": (cos * tan, -sin, cos * secant),
        }
        self._enters = dict(zip(ATTITUDE, by_gyro[channel], strict=True))
        self._carries = {
            "phi": {"phi": tan * pitch, "theta": turn * secant * secant},
            "theta": {"phi": -turn},
            "psi": {"phi": pitch * secant, "theta": turn * tan * secant},
        }

    def of(self, changes: FloatArray) -> Mapping[str, FloatArray]:
        """Return what changes of the gyro, shape (changes, rows), add to each angle, in deg."""
        rates = {angle: by * changes for angle, by in self._enters.items()}
        bends = {angle: self._passed(rate) for angle, rate in rates.items()}
        for _ in range(_TURNS):
            bends = {
                angle: self._passed(rate + sum(by * bends[other] for other, by in self._carries[angle].items()))
                for angle, rate in rates.items()
            }
        return bends

    def straightened(self, change: FloatArray) -> Bend:
        """Return it about the record without a change of the gyro, shape (rows of the record,): by the whole equations.

        Raises
        ------
        InputError
            Where Euler angles end.
        """
        record = self.record
        straight = self.estimator.bent(record, record.replace(self._channel, record[self._channel] - change))
        return Bend(self.estimator, straight, self._start, self._channel)

    def _passed(self, rates: FloatArray) -> FloatArray:
        from scipy.signal import lfilter

        return np.asarray(lfilter(*self.estimator.response(self._period_s), rates, axis=-1))

    def response(self, frequency: FloatArray, angle: str, by: FloatArray) -> FloatArray:
        """Return what of a change of the gyro is in an angle, weighed row by row, at frequencies in rad a row."""
        over, under = self.estimator.response(self._period_s)
        turned = np.exp(-1j * frequency)
        return (
            float(np.mean(self._enters[angle] * by)) * np.polyval(over[::-1], turned) / np.polyval(under[::-1], turned)
        )


def undriven(estimator: AttitudeEstimator, residual: FloatArray, period_s: float) -> FloatArray:
    """Return what of a gyro's readings an estimator's references contradict: the change that leaves a residual so.

    u = e + tau e'' / (s + 1/tau_b), the inverse of what references leave of a change near wings level; the residual is
    to be smooth.
    """
    from scipy.signal import lfilter

    steep = np.gradient(residual, period_s)
    bias_s = estimator.bias_time_constant_s
    if np.isfinite(bias_s):  # what was learnt of it has passed from the slope
        kept = bias_s / (bias_s + period_s)
        steep = lfilter([kept, -kept], [1.0, -kept], steep)
    return np.asarray(residual + estimator.time_constant_s * steep)


def _radians(record: Record, name: str) -> FloatArray:
    return np.deg2rad(np.nan_to_num(record[name])) if name in record.channels else np.zeros(len(record))

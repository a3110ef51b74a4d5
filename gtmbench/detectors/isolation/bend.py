"""How an attitude that the gyros drive bends with one of them: linear, about what was read.

The estimator integrates the broken gyro, so a fault is in the attitude's rate at once, and what the two leave of it is
how the references pull the attitude back: of a change u of a gyro near wings level, u / (tau s + 1).
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.attitude_estimators import AttitudeEstimator, filtered
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record

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

    `record`: about what it is linear. `start`: the record's row from which on there are changes. `channel`: p, q or r.
    `sharpness`: how the gyros' samples are to be sharpened before they are integrated, as `sharpness_of` finds it.
    """

    def __init__(
        self, estimator: AttitudeEstimator, record: Record, start: int, channel: str, sharpness: float = 0.0
    ) -> None:
        self.estimator, self.record, self._start, self._channel = estimator, record, start, channel
        self._sharpness = sharpness
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
        sharp = sharpened(changes, self._sharpness)
        rates = np.array([by * sharp for by in self._enters.values()])
        bends = dict(zip(ATTITUDE, self._passed(rates), strict=True))
        for _ in range(_TURNS):
            carried = [sum(by * bends[other] for other, by in carries.items()) for carries in self._carries.values()]
            bends = dict(zip(ATTITUDE, self._passed(rates + np.array(carried)), strict=True))
        return bends

    def about(self, record: Record) -> Bend:
        """Return it about another record."""
        return Bend(self.estimator, record, self._start, self._channel, self._sharpness)

    def straightened(self, change: FloatArray) -> Bend:
        """Return it about the record without a change of the gyro, shape (rows of the record,): by the whole equations.

        InputError where Euler angles end.
        """
        record, healthy = self.record, self.record[self._channel] - change
        read = record
        for name in GYROS:
            if name in record.channels:
                read = read.replace(name, sharpened(record[name], self._sharpness))
        straight = self.estimator.bent(read, read.replace(self._channel, sharpened(healthy, self._sharpness)))
        for name in ATTITUDE:
            record = record.replace(name, straight[name]) if name in record.channels else record
        return self.about(record.replace(self._channel, healthy))

    def _passed(self, rates: FloatArray) -> FloatArray:
        return np.moveaxis(filtered(*self.estimator.response(self._period_s), np.moveaxis(rates, -1, 0)), 0, -1)

    def response(self, frequency: FloatArray, angle: str, by: FloatArray) -> FloatArray:
        """Return what of a change of the gyro is in an angle, weighed row by row, at frequencies in rad a row."""
        over, under = self.estimator.response(self._period_s)
        turned = np.exp(-1j * frequency)
        return (
            float(np.mean(self._enters[angle] * by)) * np.polyval(over[::-1], turned) / np.polyval(under[::-1], turned)
        )


def sharpened(values: FloatArray, sharpness: float) -> FloatArray:
    """Return rates, shape (..., rows), of which means over neighbours are what an attitude's steps are: u - c u''."""
    if not sharpness:
        return values
    sharp = values.copy()
    sharp[..., 1:-1] -= sharpness * (values[..., 2:] - 2.0 * values[..., 1:-1] + values[..., :-2])
    return sharp


def sharpness_of(operator: Transmissibility) -> float:
    """Return how a gyro's samples are to be sharpened, so that their integral is what the attitude made of them.

    An operator from an attitude's rate to the gyro that drives it is one over how the gyro enters that rate, by its
    trapezoids and the central difference: P = (1 - s)(1 + 4 c s), s = sin^2(w/2), w in rad a row. Samples taken at the
    estimator's own steps have T = 1 / (1 - s), c = 0; means over two steps, as of gyros that are integrated over a slow
    attitude's interval, T = 1, c = 1/4. So c = (1 - k) / 4 of T = 1 + k s, by least squares up to a sixth of the sample
    rate, within these two.
    """
    frequency = np.linspace(0.0, np.pi / 3.0, 30)[1:]
    rows = np.arange(operator.markov.shape[0]) - operator.noncausal_order
    response = np.abs(np.exp(-1j * np.outer(frequency, rows)) @ operator.markov[:, 0, 0])
    s = np.square(np.sin(0.5 * frequency))
    slope = float(s @ (response - 1.0)) / float(s @ s)
    return float(np.clip(0.25 * (1.0 - slope), 0.0, 0.25))


def undriven(estimator: AttitudeEstimator, residual: FloatArray, period_s: float) -> FloatArray:
    """Return what of a gyro's readings an estimator's references contradict: the change that leaves a residual so.

    u = e + tau e'' / (s + 1/tau_b), the inverse of what references leave of a change near wings level; the residual is
    to be smooth.
    """
    steep = np.gradient(residual, period_s)
    bias_s = estimator.bias_time_constant_s
    if np.isfinite(bias_s):  # what was learnt of it has passed from the slope
        kept = bias_s / (bias_s + period_s)
        steep = filtered([kept, -kept], [1.0, -kept], steep)
    return np.asarray(residual + estimator.time_constant_s * steep)


def _radians(record: Record, name: str) -> FloatArray:
    return np.deg2rad(np.nan_to_num(record[name])) if name in record.channels else np.zeros(len(record))

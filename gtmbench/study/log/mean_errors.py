"""Second by second, what each gyro reads more than the attitude turns, and how much every second tells of it.

Seconds differ by a hundred times in what they tell. Where the aircraft is calm, the mean of a second is known to some
hundredths of a deg/s. Where it is thrown about, samples that come seldom alias vibration, and an attitude that was a
little late, or clipped, is off by an angle that references pull back in the seconds after. So each second is weighted
with the inverse of its variance, the sum of

- what its samples scatter, over their number;
- (a turn)^2: axes and scales differ a little, and a heading is wrong by an angle that hangs on where it points;
- (angle / tau)^2, where the angle grows by b (rate)^2 in a second, as by a delay, and decays at the estimator's tau;
- an estimator's own wander.

What turning explains where healthy is taken away by a regression with these weights. How well its parameters are known
is part of what is known of a mean: a flight that was learnt while it circled says little of one that flies straight.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.study.log.seconds import FEWEST, SECOND_S, rows_by_second, trailing_means
from gtmbench.study.log.self_check.motion import attitude_rates
from gtmbench.study.log.vertical import up_of
from gtmbench.values.channels import GYROS
from gtmbench.values.record import BoolArray, FloatArray, Record

_STEEPEST_DEG = 75.0  # of pitch, for which Euler angles still tell rates
_GAIN = 0.02  # by which scale and direction of gyro and attitude differ: an a priori standard deviation
_OF_TURN = 0.05  # of a second's turn
_LATE, _MOST_DEG = 0.001, 10.0  # deg of attitude for each (deg/s)^2, in a second; what no second adds beyond
_TAU_S, _BEGINS_DEG = 5.0, 1.0  # an estimator's time constant; by what its attitude is off where the log begins
_SCATTERS_S = 3  # in which samples' scatter is estimated
_REMEMBERED = 40  # seconds
_WANDER_DEG_S = 0.2
_KNOWN = 0.8  # of a window


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorSeconds:
    """Seconds of a log; shapes are (seconds, 3), NaN where nothing is known.

    Attributes
    ----------
    error : FloatArray
        Gyros less the attitude's rates, in deg/s.
    motion : FloatArray
        What the gyros read, in deg/s.
    variance : FloatArray
        Of a second's mean error, as its samples scatter.
    up : FloatArray
        How much of the vertical lies along p's, q's and r's axis.
    """

    error: FloatArray
    motion: FloatArray
    variance: FloatArray
    up: FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class MeanErrors:
    """Errors beyond what turning explains where healthy, and how much each second tells.

    Attributes
    ----------
    error : FloatArray
        In deg/s, shape (seconds, 3); NaN where nothing is known.
    weight : FloatArray
        The inverse of each one's variance, shape (seconds, 3).
    motion : FloatArray
        Shape (seconds, 3).
    covariance : FloatArray
        Of the gains on p, q and r and of the offset that were learnt, an axis each, shape (3, 4, 4).
    """

    error: FloatArray
    weight: FloatArray
    motion: FloatArray
    covariance: FloatArray

    def mean(self, window: int) -> FloatArray:
        """Return weighted means over so many seconds up to each."""
        return weighted_means(self.error, self.weight, window)

    def deviation(self, window: int) -> FloatArray:
        """Return the standard deviations of these means: of the seconds', and of what was learnt."""
        deviations = np.empty(self.error.shape)
        whole = np.column_stack([self.motion, np.ones(len(self.motion))])
        for axis in range(3):
            known = np.where(np.isfinite(self.error[:, axis]), self.weight[:, axis], np.nan)[:, np.newaxis]
            weight = trailing_means(known, window, _KNOWN)
            turned = trailing_means(whole * known, window, _KNOWN) / weight
            learnt = np.einsum("ni,ij,nj->n", turned, self.covariance[axis], turned)
            deviations[:, axis] = np.sqrt(1.0 / (window * weight[:, 0]) + learnt)
        return deviations


def weighted_means(values: FloatArray, weight: FloatArray, window: int) -> FloatArray:
    """Return weighted means of so many seconds up to each; NaN where less than four fifths of them are known.

    >>> values, weight = np.array([0.0] * 5 + [4.0] * 5), np.array([1.0] * 5 + [3.0] * 5)
    >>> weighted_means(values, weight, 10)[-1], np.isnan(weighted_means(values, weight, 10)[-2])
    (np.float64(3.0), np.True_)
    """
    known = np.where(np.isfinite(values), weight, np.nan)
    return np.asarray(trailing_means(values * known, window, _KNOWN) / trailing_means(known, window, _KNOWN))


def error_seconds(records: Sequence[Record], start_s: float, excursions: Sequence[Excursion]) -> ErrorSeconds:
    """Return the seconds of records since a time; hard motion alone leaves none out, any other excursion does."""
    count = int((records[-1].end_s - start_s) / SECOND_S) + 1
    error, motion, variance, up = (np.full((count, 3), np.nan) for _ in range(4))
    for record in records:
        gyros, vertical = record.matrix(GYROS), up_of(record)
        differences = gyros - attitude_rates(record)
        steep = np.abs(record["theta"]) > _STEEPEST_DEG
        known = np.isfinite(differences).all(axis=1) & ~steep
        for second, rows in rows_by_second(record, start_s):
            there = known[rows]
            if np.count_nonzero(there) > 0.5 * len(there):
                part = differences[rows][there]
                error[second], motion[second] = part.mean(axis=0), gyros[rows][there].mean(axis=0)
                variance[second] = part.var(axis=0) / len(part)
                up[second] = np.abs(vertical[rows][there]).mean(axis=0)
    for each in excursions:
        if each.reason != MOTION and not each.is_judged:
            first, last = (int((time_s - start_s) // SECOND_S) for time_s in (each.start_s, each.end_s))
            error[max(first, 0) : max(last + 1, 0)] = np.nan
    return ErrorSeconds(error=error, motion=motion, variance=variance, up=up)


def weights(seconds: ErrorSeconds) -> FloatArray:
    """Return the inverse of each second's variance, shape (seconds, 3); NaN where nothing is known.

    A hard turn counts little, and so do the seconds after it, in which the attitude is pulled back.

    >>> motion = np.zeros((4, 3))
    >>> motion[1, 0] = 60.0
    >>> calm = ErrorSeconds(error=motion * 0.0, motion=motion, variance=motion * 0.0, up=motion)
    >>> weights(calm)[:, 0].round(2)
    array([12.5 ,  0.11,  1.73,  2.5 ])
    """
    turn = np.linalg.norm(seconds.motion, axis=1)
    # The angle's variance a before each second: a(k + 1) = exp(-2 / tau) a(k) + (late rate(k)^2)^2.
    left = np.exp(-2.0 * SECOND_S / _TAU_S * np.arange(_REMEMBERED))
    grown = np.nan_to_num(np.square(np.minimum(_LATE * np.square(turn), _MOST_DEG)))
    angle = np.convolve(np.concatenate([[_BEGINS_DEG**2], grown[:-1]]), left)[: len(grown)]
    pulled = np.square(_OF_TURN * turn) + angle / _TAU_S**2 + _WANDER_DEG_S**2
    # Ten samples may scatter little by chance; three seconds of them hardly do.
    scatter = np.fmax(seconds.variance, trailing_means(seconds.variance, _SCATTERS_S, 1.0 / _SCATTERS_S))
    return np.asarray(1.0 / (scatter + pulled[:, np.newaxis]))


def mean_errors(seconds: ErrorSeconds, healthy: BoolArray) -> MeanErrors | None:
    """Return errors beyond what turning explains in healthy seconds; None where these are too few.

    The regression y = c0 + c1 p + c2 q + c3 r + noise, by weighted least squares, of each axis; a priori the gains are
    0 within 0.02, for gyro and attitude differ by a percent or two, and their axes by a degree.

    Parameters
    ----------
    seconds : ErrorSeconds
    healthy : shape (seconds,)

    Examples
    --------
    >>> random = np.random.default_rng(1)
    >>> motion = random.standard_normal((60, 3)) * 20.0
    >>> error = 0.5 + 0.01 * motion + 0.05 * random.standard_normal((60, 3))
    >>> seconds = ErrorSeconds(error=error, motion=motion, variance=np.full((60, 3), 0.0025), up=motion)
    >>> left = mean_errors(seconds, np.arange(60) < 40)
    >>> float(np.std(error).round(2)), float(np.std(left.error).round(2)), left.deviation(10)[-1].round(1)
    (0.18, 0.08, array([0.4, 0.4, 0.4]))
    """
    rows = healthy & np.isfinite(seconds.error).all(axis=1)
    if np.count_nonzero(rows) < FEWEST:
        return None
    weight, error = weights(seconds), np.empty(seconds.error.shape)
    whole = np.column_stack([seconds.motion, np.ones(len(seconds.motion))])
    covariance = np.empty((3, 4, 4))
    a_priori = np.diag([_GAIN**-2.0] * 3 + [0.0])
    for axis in range(3):
        weighted = whole[rows] * weight[rows, axis, np.newaxis]
        covariance[axis] = np.linalg.inv(whole[rows].T @ weighted + a_priori)
        error[:, axis] = seconds.error[:, axis] - whole @ (covariance[axis] @ (weighted.T @ seconds.error[rows, axis]))
    return MeanErrors(error=error, weight=weight, motion=seconds.motion, covariance=covariance)

"""The estimator that makes an attitude of gyros and of references that correct it, and what a broken gyro does to it.

Most recorded attitudes are such an estimator's. It integrates the gyros, broken or not, so that a gyro's fault bends
the attitude at once; what shows of the fault is how the references pull the attitude back.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.checks import meant, number, shown
from gtmbench.errors import InputError
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record


def filtered(
    over: Sequence[float] | FloatArray,
    under: Sequence[float] | FloatArray,
    signal: FloatArray,
    before: tuple[float, float] = (0.0, 0.0),
) -> FloatArray:
    """Return a signal behind a recursive filter along its first axis, as `scipy.signal.lfilter` does.

    y(k) = sum_i b_i u(k - i) - sum_{j >= 1} a_j y(k - j), all k; with T the banded lower triangle of ones and a_j, T y
    is the first sum.

    `over`, `under`: b and a; a begins with 1. `signal`, shape (rows, ...): finite. `before`: u and y of the row before
    the first; before that all is zero. Returns the same shape.

    >>> filtered([1.0], [1.0, -0.5], np.array([1.0, 0.0, 0.0]))
    array([1.  , 0.5 , 0.25])
    """
    from scipy.linalg import blas

    rows = len(signal) + 1
    columns = np.concatenate([np.full((1, *signal.shape[1:]), before[0]), signal]).reshape(rows, -1).T
    driven = np.zeros(columns.shape)
    for late, weight in enumerate(over):
        driven[:, late:] += weight * columns[:, : rows - late]
    driven[:, 0] = before[1]
    order = min(len(under), rows) - 1
    if order > 0:
        bands = np.empty((order + 1, rows), order="F")
        bands[:] = np.asarray(under, dtype=float)[: order + 1, np.newaxis]
        for each in driven:
            blas.dtbsv(order, bands, each, lower=1, diag=1, overwrite_x=1)
    return driven[:, 1:].T.reshape(signal.shape)


STEEPEST_DEG = 85.0  # beyond, tan(theta) exceeds 11 and Euler angles turn faster than samples can follow
FASTEST_S, USUAL_S, SLOWEST_S = 1.0, 5.0, 20.0  # time constants of an estimator of which nothing is known
OWN, DRIVEN = "own", "driven"  # an attitude that no gyro enters; one that the gyros drive

_EVEN = 1e-9  # of a step
_ROUNDS, _SAME_DEG = 60, 1e-11  # of a fixed point, at most; up to rounding
_RAD = math.pi / 180.0  # of a degree


def to_earth(angles: FloatArray) -> FloatArray:
    """Return the matrices that turn body axes into the earth's, shape (3, 3, rows).

    `angles`, shape (3, rows): phi, theta and psi, in rad.

    >>> to_earth(np.array([[0.0], [0.0], [0.5 * math.pi]]))[:, 0, 0].round(9) + 0.0  # flying east, forward is east
    array([0., 1., 0.])
    """
    (sr, sp, sy), (cr, cp, cy) = np.sin(angles), np.cos(angles)
    return np.array(
        [
            [cp * cy, sr * sp * cy - cr * sy, cr * sp * cy + sr * sy],
            [cp * sy, sr * sp * sy + cr * cy, cr * sp * sy - sr * cy],
            [-sp, sr * cp, cr * cp],
        ]
    )


@dataclass(frozen=True, kw_only=True)
class AttitudeEstimator:
    """How an estimator weighs gyros against the references that correct it.

    With x = (phi, theta, psi), f the kinematics of Euler angles (`carried_on`), y the gyros and z the references,

        x'(t) = f(x(t), y(t) - b(t)) + (z(t) - x(t)) / tau,   b'(t) = -(z(t) - x(t)) / (tau tau_b),

    axis by axis; b, in deg/s, is its estimate of the gyros' bias.

    Attributes
    ----------
    time_constant_s : float
        tau, in seconds: how long it trusts the gyros.
    bias_time_constant_s : float
        tau_b, in seconds: how long it takes to learn a gyro's bias; inf if it learns none.

    Examples
    --------
    >>> import gtmbench as gb
    >>> level = {"p": 0.0, "q": 0.0, "r": 0.0, "phi": 0.0, "theta": 0.0, "psi": 45.0}
    >>> healthy = gb.Record([list(level.values())] * 2001, channels=list(level), sample_period_s=0.01)
    >>> broken = healthy.replace("p", healthy["p"] + 2.0)
    >>> bent = gb.AttitudeEstimator(time_constant_s=5.0).bent(healthy, broken)
    >>> bent["phi"][[0, 100, 2000]].round(2), bent["psi"][2000].round(2)  # 2 t at first, at last 2 tau
    (array([0.  , 1.81, 9.82]), np.float64(45.0))
    """

    time_constant_s: float
    bias_time_constant_s: float = math.inf

    def __post_init__(self) -> None:
        number("time_constant_s", self.time_constant_s, 0.0)
        if self.bias_time_constant_s != math.inf:
            number("bias_time_constant_s", self.bias_time_constant_s, 0.0, above=True)

    @classmethod
    def kalman(cls, *, gyro_noise: float, bias_walk: float, reference_noise: float) -> AttitudeEstimator:
        """Return the steady state of a Kalman filter with a state for the gyro's bias, axis by axis.

        1/tau = sqrt(w^2/n^2 + 2 v/n), 1/(tau tau_b) = v/n, by densities: of the gyro's noise w (deg/s/sqrt(Hz)), of
        its bias's walk v (deg/s/sqrt(s)) and of the references' noise n (deg/sqrt(Hz)).

        >>> AttitudeEstimator.kalman(gyro_noise=0.02, bias_walk=0.0, reference_noise=0.05).time_constant_s
        2.5
        """
        turn = bias_walk / reference_noise
        gain = math.sqrt((gyro_noise / reference_noise) ** 2 + 2.0 * turn)
        return cls(time_constant_s=1.0 / gain, bias_time_constant_s=gain / turn if turn else math.inf)

    def response(self, period_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the filter from a change of an angle's rate to that of the angle, near wings level: b and a.

        d(k) = a (d(k-1) + Ts (u(k-1) + u(k))/2 - Ts b_d(k-1)) with b_d as in `bent`, as a filter of the second order.

        >>> b, a = AttitudeEstimator(time_constant_s=5.0).response(0.01)
        >>> filtered(b, a, np.full(2000, 2.0))[[100, 1999]].round(1)
        array([1.8, 9.8])
        """
        kept = self.time_constant_s / (self.time_constant_s + period_s)
        learning = kept * period_s**2 / (self.time_constant_s * self.bias_time_constant_s)
        over = 0.5 * kept * period_s * np.array([1.0, 0.0, -1.0])
        if not learning:
            return over[:1] * np.ones(2), np.array([1.0, -kept])
        return over, np.array([1.0, learning - 1.0 - kept, kept])

    def bent(self, healthy: Record, broken: Record) -> Record:
        """Return a broken record with the attitude that the estimator would have made of its gyros.

        The references are unchanged: with d what a fault adds, x_d(k) = x(k) + a (g(x_d(k-1), y_d - b_d) - g(x(k-1),
        y)), g the attitude carried on by the gyros over a sample, a = tau / (tau + Ts), and b_d(k) = b_d(k-1) + Ts /
        (tau tau_b) (x_d(k) - x(k)).

        Parameters
        ----------
        healthy, broken : Record
            The same rows, except for the gyros; p, q, r in deg/s, the attitude in deg, unwrapped. A channel that isn't
            there counts as zero.

        Raises
        ------
        InputError
            If the bent attitude comes near a pitch of 90 deg, where Euler angles end.
        """
        period_s = healthy.sample_period_s
        steps = np.full(len(healthy) - 1, period_s)
        attitude = self.bent_path(
            steps, _columns(healthy, GYROS), _columns(broken, GYROS), _columns(healthy, ATTITUDE), healthy.time_s
        )
        for i, name in enumerate(ATTITUDE):
            broken = broken.replace(name, attitude[:, i]) if name in broken.channels else broken
        return broken

    def bent_path(
        self, steps_s: FloatArray, gyros: FloatArray, broken: FloatArray, attitude: FloatArray, time_s: FloatArray
    ) -> FloatArray:
        """Return the bent attitude, shape (rows, 3), for rows that are `steps_s` apart; see `bent`.

        A missing gyro sample holds the last one, or zero before the first. A missing angle leaves the bent one missing,
        and its bend goes on.
        """
        # bend(k) = kept (f(told(k-1) + bend(k-1), broken rates - bias) - f(told(k-1), rates)), f an attitude carried on
        # by a step: the estimator's references pull it back by 1 - kept a step
        rates, told = held(gyros), held(attitude)
        broken_rates = held(broken)
        changed = np.flatnonzero((rates != broken_rates).any(axis=1))
        bent = attitude.copy()
        if not len(changed):
            return bent
        first = max(int(changed[0]), 1)
        # even steps and a small bend: linear, all rows at once
        if np.ptp(steps_s) <= _EVEN * float(steps_s[0]):
            since = slice(first - 1, None)
            off = self._bend(float(steps_s[0]), rates[since], broken_rates[since], told[since])
            if off is not None:
                bent[since] += off
                return bent
        # else row by row, in rotations
        bend: Sequence[float] = (0.0, 0.0, 0.0)
        bias: Sequence[float] = (0.0, 0.0, 0.0)
        rows = range(first, len(rates))
        pairs, broken_pairs, path = rates.tolist(), broken_rates.tolist(), told.tolist()
        bends = []
        for k in rows:
            step = float(steps_s[k - 1])
            kept = self.time_constant_s / (self.time_constant_s + step)
            before = path[k - 1]
            was = [angle + off for angle, off in zip(before, bend, strict=True)]
            now, last = broken_pairs[k], broken_pairs[k - 1]
            reached = carried_on(before, pairs[k - 1], pairs[k], step)
            turned = carried_on(was, less(last, bias), less(now, bias), step)
            if abs(turned[1]) > STEEPEST_DEG or abs(path[k][1]) > STEEPEST_DEG:
                raise too_steep(max(turned[1], path[k][1], key=abs), float(time_s[k]))
            bend = [kept * (one - other) for one, other in zip(turned, reached, strict=True)]
            if math.isfinite(self.bias_time_constant_s):
                # one that learns the gyros' bias takes the bend for it: b' = bend / (tau tau_b)
                gain = step / (self.time_constant_s * self.bias_time_constant_s)
                bias = [learnt + gain * off for learnt, off in zip(bias, bend, strict=True)]
            bends.append(bend)
        bent[first:] += np.array(bends)
        return bent

    def _bend(self, step_s: float, rates: FloatArray, broken: FloatArray, path: FloatArray) -> FloatArray | None:
        """Return the bend d of evenly sampled rows, shape (rows, 3), for all rows at once; None where that isn't sure.

        It is linear but for f(d) = g(x + d, y_d - b_d) - g(x, y) - d + Ts b_d: d is filtered out of f of the last d,
        until it stays. What a turn carries from angle to angle is small beside what the references pull back.
        """
        kept = self.time_constant_s / (self.time_constant_s + step_s)
        gain = step_s / (self.time_constant_s * self.bias_time_constant_s)
        over, under = (
            ([kept, -kept], [1.0, kept * step_s * gain - 1.0 - kept, kept]) if gain else ([kept], [1.0, -kept])
        )
        healthy = _steps(path[:-1], rates[:-1], rates[1:], step_s)
        bend, bias = np.zeros_like(path), np.zeros_like(path)
        for _ in range(_ROUNDS):
            was = path[:-1] + bend[:-1]
            if np.abs(was[:, 1]).max() > STEEPEST_DEG:
                return None
            turned = _steps(was, broken[:-1] - bias[:-1], broken[1:] - bias[:-1], step_s)
            if np.abs(was[:, 1] + turned[:, 1]).max() > STEEPEST_DEG:
                return None
            before = bend.copy()
            bend[1:] = filtered(over, under, turned - healthy + step_s * bias[:-1])
            bias = gain * np.cumsum(bend, axis=0)
            if np.abs(bend - before).max() <= _SAME_DEG:
                return bend
        return None


# those that can be named: complementary filters by their time constants, and a Kalman filter with states for the gyros'
# biases, as autopilots have (it trusts the gyros for 6.7 s and learns their biases in 25 s)
ESTIMATORS: Mapping[str, AttitudeEstimator] = {
    "filter 1 s": AttitudeEstimator(time_constant_s=1.0),
    "filter 5 s": AttitudeEstimator(time_constant_s=5.0),
    "filter 20 s": AttitudeEstimator(time_constant_s=20.0),
    "kalman": AttitudeEstimator.kalman(gyro_noise=0.05, bias_walk=0.003, reference_noise=0.5),
}


def estimator_of(attitude: object) -> AttitudeEstimator | None:
    """Return the estimator of a name of `ESTIMATORS`, or the one that is given; None of "own".

    >>> estimator_of("filter 5 s").time_constant_s, estimator_of("own")
    (5.0, None)
    """
    if isinstance(attitude, AttitudeEstimator):
        return attitude
    names = (OWN, *ESTIMATORS)
    if not isinstance(attitude, str) or attitude not in names:
        raise InputError(f"no attitude {shown(attitude)}; there is {', '.join(names)}{meant(attitude, names)}")
    return ESTIMATORS.get(attitude)


def carried_on(
    attitude: Sequence[float], before: Sequence[float], now: Sequence[float], step_s: float
) -> tuple[float, float, float]:
    """Return an attitude carried on over a step, by the gyros at its beginning and at its end; deg, deg/s.

    phi' = p + tan(theta) (q sin(phi) + r cos(phi)), theta' = q cos(phi) - r sin(phi),
    psi' = (q sin(phi) + r cos(phi)) / cos(theta), by Heun's method: it is of second order and takes the mean of the
    gyros at both ends of a step, where the rectangle with either end would put it half a sample early or late.

    >>> [round(angle, 3) for angle in carried_on((0.0, 0.0, 45.0), (2.0, 0.0, 1.0), (2.0, 0.0, 1.0), 0.5)]
    [1.0, -0.004, 45.5]
    """
    phi, theta, psi = attitude
    first = _euler_rates(phi, theta, *before)
    second = _euler_rates(phi + step_s * first[0], theta + step_s * first[1], *now)
    half = 0.5 * step_s
    return (
        phi + half * (first[0] + second[0]),
        theta + half * (first[1] + second[1]),
        psi + half * (first[2] + second[2]),
    )


def _steps(attitude: FloatArray, before: FloatArray, now: FloatArray, step_s: float) -> FloatArray:
    """Return what `carried_on` adds to each of some attitudes, shape (rows, 3)."""
    first = _all_euler_rates(attitude, before)
    return np.asarray(0.5 * step_s * (first + _all_euler_rates(attitude + step_s * first, now)))


def _all_euler_rates(attitude_deg: FloatArray, rates: FloatArray) -> FloatArray:
    """Return `_euler_rates` of rows."""
    (phi, theta), (p, q, r) = attitude_deg.T[:2] * _RAD, rates.T
    sin_phi, cos_phi = np.sin(phi), np.cos(phi)
    turn = (q * sin_phi + r * cos_phi) / np.cos(theta)
    return np.column_stack([p + np.sin(theta) * turn, q * cos_phi - r * sin_phi, turn])


def _euler_rates(phi_deg: float, theta_deg: float, p: float, q: float, r: float) -> tuple[float, float, float]:
    """Return phi', theta', psi' in deg/s."""
    phi, theta = phi_deg * _RAD, theta_deg * _RAD
    sin_phi, cos_phi = math.sin(phi), math.cos(phi)
    turn = (q * sin_phi + r * cos_phi) / math.cos(theta)
    return p + math.sin(theta) * turn, q * cos_phi - r * sin_phi, turn


def less(rates: Sequence[float], bias: Sequence[float]) -> list[float]:
    """Return rates without a bias."""
    return [rate - each for rate, each in zip(rates, bias, strict=True)]


def held(values: FloatArray) -> FloatArray:
    """Return columns with their last value where a sample is missing, and zero before the first."""
    there = np.isfinite(values)
    last = np.maximum.accumulate(np.where(there, np.arange(len(values))[:, np.newaxis], -1), axis=0)
    return np.where(last < 0, 0.0, np.take_along_axis(values, np.maximum(last, 0), axis=0))


def _columns(record: Record, names: Sequence[str]) -> FloatArray:
    """Return channels, zeros where one isn't there."""
    none = np.zeros(len(record))
    return np.column_stack([record[name] if name in record.channels else none for name in names])


class SteepError(InputError):
    """Euler angles end where an estimator's theta comes near +-90 deg."""

    theta_deg: float


def too_steep(theta_deg: float, time_s: float) -> SteepError:
    """Say that Euler angles end."""
    error = SteepError(
        f"theta reaches {theta_deg:.4g} deg at {time_s:g} s; the attitude filter's Euler angles end near "
        f"+-90 deg (here at {STEEPEST_DEG:g}); take a shorter time constant or a milder fault"
    )
    error.theta_deg = theta_deg
    return error

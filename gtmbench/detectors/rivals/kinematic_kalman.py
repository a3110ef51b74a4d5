"""A kinematic Kalman filter: attitude carried on by gyros, corrected by what is measured; no model of the aircraft.

The residual is the filter's innovation, turned into the body's axes. Source: E. J. Lefferts, F. L. Markley and
M. D. Shuster, Kalman filtering for spacecraft attitude estimation, J. Guidance, Control, and Dynamics 5 (1982),
doi:10.2514/3.56190 (gyros in place of dynamics). Here the filter is the steady one of an axis; what a gyro does to the
attitude is a short FIR filter, identified, which takes up sampling, delays and gains.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import Generator, Lookback, body_increments
from gtmbench.method.filters import filtered
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray

_FEW = 1e-3  # the least gain


@dataclass(frozen=True, kw_only=True)
class KinematicKalmanFilter(Rival):
    """e(k) = (1 - K) e(k-1) + d(k), d(k) = o_att(k) Ts - sum over i = 0..n of h_i o(k-i) Ts - c, for o = p, q, r.

    K is the steady gain for the variances of gyro and attitude noise that d(k) has on healthy records.

    Parameters
    ----------
    past_s : float
        n sample periods; at 0 the gyro's reading is taken as it is, halfway between two samples.
    """

    name: str = "kinematic-kalman"
    past_s: float = 0.15
    settles_s: ClassVar[float] = 2.0
    channels: ClassVar[tuple[str, ...]] = (*GYROS, *ATTITUDE)

    @property
    def title(self) -> str:
        """What it is, in a line."""
        fir = "their FIR identified" if self.past_s else "as they are"
        return f"kinematic Kalman filter: attitude carried on by gyros, {fir}"

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return the FIR filters, shape (gyros, n + 1), constants in deg, and gains K."""
        lags = round(self.past_s / sample_period_s)
        increments = [body_increments(values[:, len(GYROS) :]) for values in records]
        taps, constants, gains = [], [], []
        for i in range(len(GYROS)):
            gyro = [values[:, i] * sample_period_s for values in records]
            own = [increment[:, i] for increment in increments]
            gain, tap, constant = 1.0, np.array([0.5, 0.5]), 0.0
            for _ in range(3 if lags else 1):  # the gain shapes the equations' noise, the equations the gain
                if lags:
                    tap, constant = _fir(gyro, own, lags, gain)
                else:
                    constant = float(
                        np.mean(np.concatenate([_misfit(*pair, tap, 0.0) for pair in zip(gyro, own, strict=True)]))
                    )
                gain = _gain([_misfit(*pair, tap, constant) for pair in zip(gyro, own, strict=True)])
            taps.append(tap)
            constants.append(constant)
            gains.append(gain)
        return {"taps": np.array(taps), "constant": np.array(constants), "gain": np.array(gains)}

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what makes the innovations, in deg."""
        return _Innovations(model, sample_period_s)


class _Innovations:
    """Increments that the gyros don't explain, and their leaky sums."""

    def __init__(self, model: Model, sample_period_s: float) -> None:
        taps, self._poles = model["taps"], 1.0 - model["gain"]
        gyros = len(GYROS)
        lags = taps.shape[1] - 1
        markov = np.zeros((lags + 1, gyros, gyros))
        markov[:, range(gyros), range(gyros)] = taps.T

        def increments(values: FloatArray) -> FloatArray:
            explained = np.full((len(values), gyros), np.nan)
            explained[lags:] = filtered(list(values[:, :gyros].T * sample_period_s), markov, np.zeros(gyros))
            return np.asarray(body_increments(values[:, gyros:]) - explained - model["constant"])

        self._increments = Lookback(max(lags, 1), 2 * gyros, increments)
        self._carried = np.zeros((gyros, 1))

    def push(self, values: FloatArray) -> FloatArray:
        """Return the innovations of the next rows; where an increment is missing they only fade."""
        from scipy.signal import lfilter

        increments = self._increments.push(values)
        innovations = np.empty_like(increments)
        for i, (column, pole) in enumerate(zip(increments.T, self._poles.tolist(), strict=True)):
            there = np.isfinite(column)
            leaky, self._carried[i] = lfilter([1.0], [1.0, -pole], np.where(there, column, 0.0), zi=self._carried[i])
            innovations[:, i] = np.where(there, leaky, np.nan)
        return innovations


def _misfit(gyro: FloatArray, increments: FloatArray, taps: FloatArray, constant: float) -> FloatArray:
    """Return what a gyro leaves of the attitude's increments, where all is there."""
    left = increments[len(taps) - 1 :] - np.convolve(gyro, taps, "valid") - constant
    return left[np.isfinite(left)]


def _fir(
    gyro: Sequence[FloatArray], increments: Sequence[FloatArray], lags: int, gain: float
) -> tuple[FloatArray, float]:
    """Return taps and constant by least squares of the innovations: both sides are summed as the filter does."""
    from scipy.signal import lfilter

    gram, right = np.zeros((lags + 2,) * 2), np.zeros(lags + 2)
    for one, own in zip(gyro, increments, strict=True):
        there = np.isfinite(own)
        past = np.column_stack([np.concatenate([np.full(i, np.nan), one[: len(one) - i]]) for i in range(lags + 1)])
        there &= np.isfinite(past).all(axis=1)
        equations = np.column_stack([past, np.ones(len(one)), own])[there]
        equations = lfilter([1.0], [1.0, gain - 1.0], equations, axis=0)
        gram += equations[:, :-1].T @ equations[:, :-1]
        right += equations[:, :-1].T @ equations[:, -1]
    scale = 1.0 / np.sqrt(np.maximum(np.diag(gram), 1e-300))
    found = np.linalg.lstsq(gram * np.outer(scale, scale), right * scale, rcond=1e-12)[0] * scale
    return found[:-1], float(found[-1])


def _gain(parts: Sequence[FloatArray]) -> float:
    """Return the steady Kalman gain of an axis: d = w + v(k) - v(k-1) has the covariances q + 2 r and -r."""
    count = sum(map(len, parts))
    power = sum(float(part @ part) for part in parts) / count
    beside = sum(float(part[1:] @ part[:-1]) for part in parts) / count
    r = max(-beside, 1e-3 * power)
    q = max(power - 2.0 * r, 1e-9 * power)
    p = (q + np.sqrt(q * q + 4.0 * q * r)) / 2.0
    return float(np.clip(p / (p + r), _FEW, 1.0))

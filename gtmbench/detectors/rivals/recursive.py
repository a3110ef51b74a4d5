"""Recursive least squares: each gyro as a linear function of what moves with it, learnt anew in every flight.

Source: A. Keipour, M. Mousaei and S. Scherer, Automatic real-time anomaly detection for autonomous aerial vehicles,
ICRA 2019, doi:10.1109/ICRA.2019.8794286, arXiv:1907.00511 (their data set: ALFA). The residual is the error before the
sample has been learnt.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import AIR, Generator, Scale, stacked, with_turns
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS
from gtmbench.values.record import FloatArray

_UNSURE = 10.0  # variance of a parameter before anything was seen, in standard units


@dataclass(frozen=True, kw_only=True)
class RecursiveLeastSquares(Rival):
    """e(k) = y(k) - theta(k-1)'x(k-1), theta by least squares that forget; x: the other channels, low-passed, and 1.

    Parameters
    ----------
    remembered_s, smoothed_s : float
        Time constants of forgetting and of the low-pass.
    """

    name: str = "rls"
    title: ClassVar[str] = "recursive least squares of each gyro on the other channels (ALFA)"
    remembered_s: float = 50.0
    smoothed_s: float = 0.1
    settles_s: ClassVar[float] = 20.0
    channels: ClassVar[tuple[str, ...]] = (*GYROS, *ATTITUDE, *AIR, *COMMANDS)

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return means and deviations; the rest is learnt in flight."""
        scale = Scale.of(stacked(with_turns(values, self.channels) for values in records))
        return {"mean": scale.mean, "deviation": scale.deviation}

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what learns and predicts."""
        pole = np.exp(-sample_period_s / self.smoothed_s)
        return _Learner(model, self.channels, float(pole), float(np.exp(-sample_period_s / self.remembered_s)))


class _Learner:
    """Least squares of all gyros side by side."""

    def __init__(self, model: Model, channels: Sequence[str], pole: float, forgetting: float) -> None:
        self._scale = Scale(mean=model["mean"], deviation=model["deviation"])
        self._channels, self._pole, self._forgetting = tuple(channels), pole, forgetting
        width = len(channels)
        self._before = np.full((1, width), np.nan)  # the row before, as it is
        self._smooth = np.zeros((1, width))  # the low-pass's state
        self._x = np.zeros(width + 1)  # regressors of the row before
        self._x[-1] = 1.0
        others = np.ones((len(GYROS), width + 1))
        others[range(len(GYROS)), range(len(GYROS))] = 0.0  # a gyro isn't predicted from itself
        self._others = others
        self._theta = np.zeros((len(GYROS), width + 1))
        self._covariance = _UNSURE * np.eye(width + 1) * others[:, :, np.newaxis] * others[:, np.newaxis, :]

    def push(self, values: FloatArray) -> FloatArray:
        """Return the errors of the next rows, in standard units; rows that miss something teach nothing."""
        from scipy.signal import lfilter

        signals = self._scale.standard(with_turns(np.concatenate([self._before, values]), self._channels)[1:])
        self._before = np.concatenate([self._before, values])[-1:]
        there = np.asarray(np.isfinite(signals).all(axis=1))
        signals = np.where(there[:, np.newaxis], signals, 0.0)
        smooth, self._smooth = lfilter([1.0 - self._pole], [1.0, -self._pole], signals, axis=0, zi=self._smooth)
        errors = np.full((len(values), len(GYROS)), np.nan)
        theta, covariance, x = self._theta, self._covariance, self._x
        for k in np.flatnonzero(there).tolist():
            own = self._others * x
            error = signals[k, : len(GYROS)] - np.einsum("ij,ij->i", theta, own)
            spread = np.matmul(covariance, own[:, :, np.newaxis])[:, :, 0]
            gain = spread / (self._forgetting + np.einsum("ij,ij->i", own, spread))[:, np.newaxis]
            theta = theta + gain * error[:, np.newaxis]
            covariance = (covariance - gain[:, :, np.newaxis] * spread[:, np.newaxis, :]) / self._forgetting
            errors[k] = error
            x = np.append(smooth[k], 1.0)
        self._theta, self._covariance, self._x = theta, covariance, x
        return errors

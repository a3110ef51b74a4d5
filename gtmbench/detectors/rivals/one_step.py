"""One-step prediction of each gyro by a linear model of the recent past of sensors and surface commands.

With its own past among the regressors the model is ARX, whose one-step errors are those of the observer of OKID:
J.-N. Juang, M. Phan, L. G. Horta and R. W. Longman, Identification of observer/Kalman filter Markov parameters: theory
and experiments, AIAA 1991, doi:10.2514/6.1991-2735. On a helicopter's sensors: G. Heredia and
A. Ollero, Detection of sensor faults in small helicopter UAVs using observer/Kalman filter identification, Mathematical
Problems in Engineering 2011, doi:10.1155/2011/174618. The observer is used as its predictor form; no state-space
realisation is made of it, for its residuals are the same.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import AIR, Generator, Lookback, Scale, stacked, with_turns
from gtmbench.method.filters import filtered
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS
from gtmbench.values.record import FloatArray

_BLOCK = 4096  # equations at a time
_COMMAND_NOISE = 0.1  # of a command's deviation: it has none, and its past alone would be all but collinear
_RIDGE = 1e-9  # of a regressor's power: one that stands still gets 0


@dataclass(frozen=True, kw_only=True)
class OneStepPrediction(Rival):
    """e(k) = y(k) - c - sum over i = 1..n of H_i u(k-i), H by least squares; u: sensors, and commands if wanted.

    Parameters
    ----------
    past_s : float
        n sample periods.
    commands : bool
        Whether surface and throttle commands are known.
    own_past : bool
        Whether a gyro is predicted from its own past, too. It then predicts better, and follows a slow fault.
    """

    name: str = "okid"
    past_s: float = 0.2
    commands: bool = True
    own_past: bool = True

    @property
    def title(self) -> str:
        """What it is, in a line."""
        by = "all sensors and itself (ARX, the observer of OKID)" if self.own_past else "the other sensors"
        return f"one-step prediction of each gyro by {by}, {'with' if self.commands else 'without'} commands"

    @property
    def channels(self) -> tuple[str, ...]:
        """Every sensor, and the commands."""
        return (*GYROS, *ATTITUDE, *AIR, *(COMMANDS if self.commands else ()))

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return Markov parameters, shape (n, gyros, channels), means of the channels and constants."""
        signals = [with_turns(values, self.channels) for values in records]
        scale = Scale.of(stacked(signals))
        lags, width = self._lags(sample_period_s), len(self.channels)
        gram, right = np.zeros((lags * width + 1,) * 2), np.zeros((lags * width + 1, len(GYROS)))
        for signal in signals:
            windows = sliding_window_view(scale.standard(signal), lags + 1, axis=0)  # (equations, channels, lags + 1)
            for first in range(0, len(windows), _BLOCK):
                part = windows[first : first + _BLOCK]
                part = part[np.isfinite(part).all(axis=(1, 2))]
                past = np.column_stack([part[:, :, :-1].reshape(len(part), -1), np.ones(len(part))])
                gram += past.T @ past
                right += past.T @ part[:, : len(GYROS), -1]
        is_command = np.repeat([name in COMMANDS for name in self.channels], lags)
        ridge = gram[-1, -1] * np.append(np.where(is_command, _COMMAND_NOISE**2, _RIDGE), _RIDGE)
        markov, constant = np.zeros((lags, len(GYROS), width)), np.zeros(len(GYROS))
        for i in range(len(GYROS)):
            used = np.ones(lags * width + 1, dtype=bool)
            used[i * lags : (i + 1) * lags] = self.own_past
            found = np.zeros(len(used))
            found[used] = np.linalg.solve((gram + np.diag(ridge))[np.ix_(used, used)], right[used, i])
            found *= scale.deviation[i]
            markov[:, i] = found[:-1].reshape(width, lags).T[::-1] / scale.deviation  # the newest first
            constant[i] = found[-1]
        return {"markov": markov, "mean": scale.mean, "constant": constant}

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what makes the errors of prediction."""
        lags, markov, mean = self._lags(sample_period_s), model["markov"], model["mean"]
        gyros = len(GYROS)

        def work(values: FloatArray) -> FloatArray:
            signals = with_turns(values, self.channels)
            predicted = np.full((len(values), gyros), np.nan)
            if len(values) > lags:
                predicted[lags:] = filtered(list(signals[:-1].T), markov, mean)
            return np.asarray(values[:, :gyros] - mean[:gyros] - model["constant"] - predicted)

        return Lookback(lags + 1, len(self.channels), work)

    def _lags(self, sample_period_s: float) -> int:
        return max(round(self.past_s / sample_period_s), 1)

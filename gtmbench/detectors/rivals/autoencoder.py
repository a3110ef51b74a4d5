"""An autoencoder on windows: a network passes their features through a narrow layer, and what it can't repeat is odd.

Source: M. Sakurada and T. Yairi, Anomaly detection using autoencoders with nonlinear dimensionality reduction, MLSDA
2014, doi:10.1145/2689746.2689747. scikit-learn trains the network; its weights are kept as tables.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import (
    CHANNELS,
    FEATURES,
    PER_SIGNAL,
    Generator,
    Lookback,
    Scale,
    features_of,
    stacked,
)
from gtmbench.imports import load_extra
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

_THINNED_S = 0.1  # a window is learnt from every so often
_LAYERS = 4  # of weights


@dataclass(frozen=True, kw_only=True)
class Autoencoder(Rival):
    """Squared errors of repetition over their healthy mean: of each gyro's own features, and of all others.

    Parameters
    ----------
    window_s : float
    wide, narrow : int
        Units of the layers: features - wide - narrow - wide - features, rectified.
    epochs : int
        At most; a tenth of the windows, kept apart, says when to stop.
    """

    name: str = "autoencoder"
    title: ClassVar[str] = "autoencoder on windows of all sensors"
    judge: str = "level"
    window_s: float = 0.5
    wide: int = 64
    narrow: int = 16
    epochs: int = 60
    channels: ClassVar[tuple[str, ...]] = CHANNELS
    outputs: ClassVar[tuple[str, ...]] = (*GYROS, "others")

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return means, deviations, weights and the mean squared error of each feature."""
        networks = load_extra("sklearn.neural_network", "rivals", f"'{self.name}' needs")
        step, rows = max(round(_THINNED_S / sample_period_s), 1), self._rows(sample_period_s)
        features = stacked(features_of(values, rows, sample_period_s)[::step] for values in records)
        scale = Scale.of(features)
        x = scale.standard(features)
        network = networks.MLPRegressor(
            hidden_layer_sizes=(self.wide, self.narrow, self.wide),
            max_iter=self.epochs,
            random_state=0,
            early_stopping=True,
        )
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # that the epochs ran out
            network.fit(x, x)
        model = {"mean": scale.mean, "deviation": scale.deviation}
        for i, (weights, biases) in enumerate(zip(network.coefs_, network.intercepts_, strict=True)):
            model |= {f"weights {i}": weights, f"biases {i}": biases}
        return model | {"usual": np.maximum(np.square(_repeated(model, x) - x).mean(axis=0), 1e-9)}

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what scores windows."""
        scale, rows = Scale(mean=model["mean"], deviation=model["deviation"]), self._rows(sample_period_s)
        gyros = len(GYROS)

        def work(values: FloatArray) -> FloatArray:
            x = scale.standard(features_of(values, rows, sample_period_s)[rows + 1 :])
            errors = np.square(_repeated(model, x) - x) / model["usual"]
            by_signal = errors.reshape(len(x), FEATURES // PER_SIGNAL, PER_SIGNAL).sum(axis=2)
            own = by_signal[:, :gyros] + by_signal[:, gyros : 2 * gyros]  # as it is, and less the attitude's rate
            return np.column_stack([own, by_signal[:, 2 * gyros :].sum(axis=1)])

        return Lookback(rows + 1, len(CHANNELS), work)

    def _rows(self, sample_period_s: float) -> int:
        return max(round(self.window_s / sample_period_s), 2)


def _repeated(model: Model, x: FloatArray) -> FloatArray:
    """Return what the network makes of features."""
    for i in range(_LAYERS):
        x = x @ model[f"weights {i}"] + model[f"biases {i}"]
        x = np.maximum(x, 0.0) if i < _LAYERS - 1 else x
    return x

"""Principal components of all sensors at once, or of their recent past too: T2 within the model, Q beyond it.

Sources: J. E. Jackson and G. S. Mudholkar, Control procedures for residuals associated with principal component
analysis, Technometrics 21 (1979), doi:10.1080/00401706.1979.10489779 (Q); W. Ku, R. H. Storer and C. Georgakis,
Disturbance detection and isolation by dynamic principal component analysis, Chemometrics and Intelligent Laboratory
Systems 30 (1995), doi:10.1016/0169-7439(95)00076-3 (lagged samples). It tells that something is odd, and not what.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import AIR, Generator, Lookback, Scale, stacked, with_turns
from gtmbench.imports import load_extra
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray

_THINNED = 5  # every so many samples are learnt from


@dataclass(frozen=True, kw_only=True)
class PrincipalComponents(Rival):
    """T2 = sum over i of t_i^2 / lambda_i of the components kept, Q = |x - P P'x|^2 of what they leave.

    Parameters
    ----------
    lags : int
        How many samples before the present one x holds, besides.
    lag_s : float
        How far they are apart.
    explained : float
        Share of the variance that the components kept explain.
    """

    name: str = "pca"
    judge: str = "level"
    lags: int = 0
    lag_s: float = 0.05
    explained: float = 0.95
    channels: ClassVar[tuple[str, ...]] = (*GYROS, *ATTITUDE, *AIR)
    outputs: ClassVar[tuple[str, ...]] = ("T2", "Q")

    @property
    def title(self) -> str:
        """What it is, in a line."""
        past = f" and of their past ({self.lags} samples)" if self.lags else ""
        return f"principal components of all sensors{past}: T2 and Q"

    def fit(self, records: Sequence[FloatArray], sample_period_s: float) -> Model:
        """Return means, deviations, loadings and variances of the components."""
        decomposition = load_extra("sklearn.decomposition", "rivals", f"'{self.name}' needs")
        x = stacked(self._lagged(values, sample_period_s)[::_THINNED] for values in records)
        scale = Scale.of(x)
        found = decomposition.PCA(n_components=self.explained, svd_solver="full").fit(scale.standard(x))
        return {
            "mean": scale.mean,
            "deviation": scale.deviation,
            "loadings": found.components_,
            "variances": found.explained_variance_,
        }

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what makes T2 and Q."""
        scale = Scale(mean=model["mean"], deviation=model["deviation"])
        loadings, variances = model["loadings"], model["variances"]

        def work(values: FloatArray) -> FloatArray:
            x = scale.standard(self._lagged(values, sample_period_s))
            t = x @ loadings.T
            return np.column_stack([np.sum(t * t / variances, axis=1), np.sum(np.square(x - t @ loadings), axis=1)])

        return Lookback(self.lags * self._step(sample_period_s) + 1, len(self.channels), work)

    def _lagged(self, values: FloatArray, sample_period_s: float) -> FloatArray:
        x, step = with_turns(values, self.channels), self._step(sample_period_s)
        parts = [x]
        for lag in range(1, self.lags + 1):
            before = np.full((min(lag * step, len(x)), x.shape[1]), np.nan)
            parts.append(np.concatenate([before, x[: len(x) - len(before)]]))
        return np.hstack(parts)

    def _step(self, sample_period_s: float) -> int:
        return max(round(self.lag_s / sample_period_s), 1)

"""Least squares of a suspect's residuals in a few shapes of faults."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.isolation.health import MOST
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.record import FloatArray

_OUTLIERS = 0.3
_RIDGE = 1e-9  # of the shapes' size: two may be the same on a short case


class Columns:
    """Shapes that a fault of a suspect may be made of, and least squares of its residuals in any few of them.

    Parameters
    ----------
    suspect : Suspect
    shapes : mapping of name to array of shape (rows,)
        What is added to the readings, per unit.
    """

    def __init__(self, suspect: Suspect, shapes: dict[str, FloatArray]) -> None:
        self.names = tuple(shapes)
        self._suspect = suspect
        self._fitted: dict[tuple[str, ...], tuple[FloatArray, FloatArray]] = {}
        self._y = np.nan_to_num(suspect.white).ravel()
        changes = np.array([shapes[name] for name in self.names])
        shown = (suspect.shown(changes) * suspect.there).reshape(len(self.names), -1)
        self._size = np.sqrt(np.square(shown).sum(axis=1)) + 1e-12
        self._shown = shown / self._size[:, np.newaxis]
        self._gram, self._with = self._shown @ self._shown.T, self._shown @ self._y

    def fit(self, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        """Return how much of each shape there is, and what is left of the residuals."""
        if names not in self._fitted:
            self._fitted[names] = self._fit(names)
        return self._fitted[names]

    def _fit(self, names: tuple[str, ...]) -> tuple[FloatArray, FloatArray]:
        suspect, chosen = self._suspect, [self.names.index(name) for name in names]
        if not chosen:
            return np.zeros(0), suspect.white
        gram, shown = self._gram[chosen][:, chosen], self._shown[chosen]
        weights = self._solved(gram, self._with[chosen])
        left = self._y - weights @ shown
        out = np.abs(left) > MOST
        if 0 < np.count_nonzero(out) < _OUTLIERS * len(left):  # once more without them
            few = shown[:, out]
            weights = self._solved(gram - few @ few.T, self._with[chosen] - few @ self._y[out])
            left = self._y - weights @ shown
        left = left.reshape(suspect.white.shape)
        return weights / self._size[chosen], left if suspect.is_whole else np.where(suspect.there, left, np.nan)

    def covariance(self, names: tuple[str, ...]) -> FloatArray:
        """Return the covariance of the weights of shapes, of residuals with unit noise."""
        chosen = [self.names.index(name) for name in names]
        size = self._size[chosen]
        return np.asarray(np.linalg.pinv(self._gram[np.ix_(chosen, chosen)]) / np.outer(size, size))

    @staticmethod
    def _solved(gram: FloatArray, right: FloatArray) -> FloatArray:
        return np.asarray(np.linalg.solve(gram + _RIDGE * np.eye(len(gram)), right), dtype=np.float64)

"""Least squares of a suspect's residuals in a few shapes of faults."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from gtmbench.detectors.isolation.health import MOST
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.method.convolution import gram, product
from gtmbench.values.record import BoolArray, FloatArray

_BLOCK = 65_536  # numbers at a time: fresh memory costs more than what is worked out in it
_OUTLIERS = 0.3  # of the rows: fewer that are clipped are left out once more, more are no outliers
_RIDGE = 1e-9  # of the shapes' size: two may be the same on a short case


class Columns:
    """Shapes that a fault of a suspect may be made of, and least squares of its residuals in any few of them.

    `shapes`, by name, shape (rows,): what is added to the readings, per unit.
    """

    def __init__(self, suspect: Suspect, shapes: Mapping[str, FloatArray]) -> None:
        self.names = tuple(shapes)
        self._place = {name: place for place, name in enumerate(self.names)}
        self._suspect = suspect
        self._fitted: dict[tuple[str, ...], tuple[FloatArray, float]] = {}
        self._y = np.nan_to_num(suspect.white).ravel()
        self._shown = suspect.shown(np.array([shapes[name] for name in self.names])).reshape(len(self.names), -1)
        if not suspect.is_whole:
            self._shown *= suspect.there.ravel()
        self._size = np.sqrt(np.einsum("ij,ij->i", self._shown, self._shown)) + 1e-12
        self._shown /= self._size[:, np.newaxis]
        self._gram = gram(self._shown)
        self._with = self._shown @ self._y

    def weights(self, names: tuple[str, ...]) -> FloatArray:
        """Return how much of each shape there is."""
        chosen = [self._place[name] for name in names]
        return np.asarray((self._of(names)[0] / self._size)[chosen])

    def deviances(self, sets: Iterable[tuple[str, ...]]) -> list[float]:
        """Return -2 log likelihood of what sets of shapes leave; they are solved together."""
        new = [names for names in dict.fromkeys(sets) if names not in self._fitted]
        block = max(_BLOCK // len(self._y), 1)
        for first in range(0, len(new), block):
            self._solve(new[first : first + block])
        return [self._fitted[names][1] for names in sets]

    def left(self, names: tuple[str, ...]) -> FloatArray:
        """Return what some shapes leave of the residuals."""
        return self._shaped(self._y - self._of(names)[0] @ self._shown)

    def _of(self, names: tuple[str, ...]) -> tuple[FloatArray, float]:
        if names not in self._fitted:
            self._solve([names])
        return self._fitted[names]

    def _solve(self, sets: Sequence[tuple[str, ...]]) -> None:
        chosen = np.array([[name in names for name in self.names] for names in sets])
        weights = _solved(self._gram, self._with, chosen)
        left = self._y - product(weights, self._shown)
        out = np.abs(left) > MOST
        few = np.count_nonzero(out, axis=1)
        for i in np.flatnonzero((few > 0) & (few < _OUTLIERS * left.shape[1])).tolist():  # once more without them
            far = self._shown[:, out[i]]
            with_far = self._with - far @ self._y[out[i]]
            weights[i] = _solved(self._gram - gram(far), with_far, chosen[i : i + 1])[0]
            left[i] = self._y - weights[i] @ self._shown
        deviances = self._suspect.deviances(self._shaped(left)).tolist()
        self._fitted |= zip(sets, zip(weights, deviances, strict=True), strict=True)

    def _shaped(self, left: FloatArray) -> FloatArray:
        suspect = self._suspect
        left = left.reshape(*left.shape[:-1], *suspect.white.shape)
        return left if suspect.is_whole else np.where(suspect.there, left, np.nan)

    def covariance(self, names: tuple[str, ...]) -> FloatArray:
        """Return the covariance of the weights of shapes, of residuals with unit noise."""
        chosen = [self._place[name] for name in names]
        size = self._size[chosen]
        return np.asarray(np.linalg.pinv(self._gram[np.ix_(chosen, chosen)]) / np.outer(size, size))


def _solved(gram: FloatArray, right: FloatArray, chosen: BoolArray) -> FloatArray:
    """Return the weights of all shapes, shape (sets, shapes), for sets of chosen ones; 0 of the others."""
    grams = np.where(chosen[:, :, np.newaxis] & chosen[:, np.newaxis], gram, 0.0)
    diagonal = np.arange(len(gram))
    grams[:, diagonal, diagonal] += np.where(chosen, _RIDGE, 1.0)
    return np.asarray(np.linalg.solve(grams, (chosen * right)[..., np.newaxis])[..., 0], dtype=np.float64)

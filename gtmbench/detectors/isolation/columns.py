"""Least squares of a suspect's residuals in a few shapes of faults; the parabola through three points."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from gtmbench.detectors.bank.calibrated import MOST
from gtmbench.detectors.isolation.suspect import Suspect
from gtmbench.method.filters import gram, product
from gtmbench.values.record import FloatArray, IntArray

_BLOCK = 65_536  # numbers at a time: fresh memory costs more than what is worked out in it
_OUTLIERS = 0.3  # of the rows: fewer that are clipped are left out once more, more are no outliers
_RIDGE = 1e-9  # of the shapes' size: two may be the same on a short case
_SHOWN = 1e-9  # of what shows most: what shows less shows by rounding alone, as a constant of a heading does


class Columns:
    """Shapes that a fault of a suspect may be made of, and least squares of its residuals in any few of them.

    `shapes`, by name, shape (rows,): what is added to the readings, per unit.
    """

    def __init__(self, suspect: Suspect, shapes: Mapping[str, FloatArray]) -> None:
        self.names = tuple(shapes)
        self._place = {name: place for place, name in enumerate(self.names)}
        self._suspect = suspect
        self._fitted: dict[tuple[str, ...], tuple[FloatArray, float]] = {}
        self._y = suspect.filled.ravel()
        self._shown = suspect.shown(np.array([shapes[name] for name in self.names])).reshape(len(self.names), -1)
        if not suspect.is_whole:
            self._shown *= suspect.there.ravel()
        size = np.sqrt(np.einsum("ij,ij->i", self._shown, self._shown))
        self._size = np.where(size > _SHOWN * size.max(initial=0.0), size, np.inf)
        self._shown /= self._size[:, np.newaxis]
        self._gram = np.pad(gram(self._shown), (0, 1))
        self._with = np.append(self._shown @ self._y, 0.0)

    def weights(self, names: tuple[str, ...]) -> FloatArray:
        """Return how much of each shape there is."""
        return (self._of(names)[0] / self._size)[self._places(names)]

    def deviances(self, sets: Sequence[tuple[str, ...]]) -> list[float]:
        """Return -2 log likelihood of what sets of shapes leave; they are solved together."""
        new = [names for names in dict.fromkeys(sets) if names not in self._fitted]
        block = max(_BLOCK // len(self._y), 1)
        for first in range(0, len(new), block):
            self._solve(new[first : first + block])
        return [self._fitted[names][1] for names in sets]

    def left(self, names: tuple[str, ...]) -> FloatArray:
        """Return what some shapes leave of the residuals."""
        return self._shaped(self._y - self._of(names)[0] @ self._shown)

    def _places(self, names: Sequence[str]) -> list[int]:
        return [self._place[name] for name in names]

    def _of(self, names: tuple[str, ...]) -> tuple[FloatArray, float]:
        if names not in self._fitted:
            self._solve([names])
        return self._fitted[names]

    def _solve(self, sets: Sequence[tuple[str, ...]]) -> None:
        most, none = max(map(len, sets)), len(self.names)
        places = np.array([[*self._places(names), *[none] * (most - len(names))] for names in sets], dtype=int)
        weights = _solved(self._gram, self._with, places)
        left = self._y - product(weights, self._shown)
        out = np.abs(left) > MOST
        few = np.count_nonzero(out, axis=1)
        for i in np.flatnonzero((few > 0) & (few < _OUTLIERS * left.shape[1])).tolist():  # once more without them
            far = np.pad(self._shown[:, out[i]], ((0, 1), (0, 0)))
            weights[i] = _solved(self._gram - gram(far), self._with - far @ self._y[out[i]], places[i : i + 1])[0]
            left[i] = self._y - weights[i] @ self._shown
        deviances = self._suspect.deviances(self._shaped(left)).tolist()
        self._fitted |= zip(sets, zip(weights, deviances, strict=True), strict=True)

    def _shaped(self, left: FloatArray) -> FloatArray:
        suspect = self._suspect
        left = left.reshape(*left.shape[:-1], *suspect.white.shape)
        return left if suspect.is_whole else np.where(suspect.there, left, np.nan)

    def covariance(self, names: tuple[str, ...]) -> FloatArray:
        """Return the covariance of the weights of shapes, of residuals with unit noise; NaN of what doesn't show."""
        chosen = self._places(names)
        size = np.where(np.isfinite(self._size), self._size, np.nan)[chosen]
        return np.asarray(np.linalg.pinv(self._gram[np.ix_(chosen, chosen)]) / np.outer(size, size))


def _solved(gram: FloatArray, right: FloatArray, places: IntArray) -> FloatArray:
    """Return the weights of all shapes, shape (sets, shapes), for sets of their places; the last place is none."""
    grams = gram[places[:, :, np.newaxis], places[:, np.newaxis]]
    diagonal = np.arange(places.shape[1])
    grams[:, diagonal, diagonal] += np.where(places < len(gram) - 1, _RIDGE, 1.0)
    weights = np.zeros((len(places), len(gram)))
    np.put_along_axis(weights, places, np.linalg.solve(grams, right[places][..., np.newaxis])[..., 0], axis=1)
    return weights[:, :-1]


def vertex(places: FloatArray, heights: FloatArray) -> tuple[float, float]:
    """Return where the parabola through three points is flat, and half its second derivative; NaN of a line.

    >>> import numpy as np
    >>> vertex(np.array([0.0, 1.0, 3.0]), np.array([8.0, 2.0, 2.0]))
    (2.0, 2.0)
    """
    (first, middle, last), (before, least, after) = places.tolist(), heights.tolist()
    slope = (least - before) / (middle - first)
    bend = ((after - least) / (last - middle) - slope) / (last - first)
    return 0.5 * (first + middle - slope / bend) if bend else float("nan"), bend


def spaced(low: float, high: float, count: int) -> FloatArray:
    """Return values evenly spaced in their logarithm; `numpy.geomspace` takes ten times as long.

    >>> spaced(1.0, 100.0, 3).tolist()
    [1.0, 10.0, 100.0]
    """
    return np.asarray(low * (high / low) ** (np.arange(count) / (count - 1)))

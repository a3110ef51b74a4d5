"""What relations between sensors show where all are healthy: their constants, and by how much they are off."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.crosscheck.relations import BLOCK_S, Relation
from gtmbench.values.record import FloatArray

WINDOWS = (1, 3, 10, 30, 100)  # blocks: 0.2 to 20 s
PER_HOUR = 3e-5  # false alarms of each mean of each axis, by as many independent ones as an hour holds
_FEWEST = 8  # healthy windows, before they bound anything
_ROUNDS, _SMALLEST = 4, 1e-12
_PRESENT = 0.6  # of a window's blocks have to be there


@dataclass(frozen=True, kw_only=True, eq=False)
class Learnt:
    """A relation's constants and bounds.

    Attributes
    ----------
    constants : shape (parameters,)
    covariance : shape (parameters, parameters)
        Theirs.
    noise : shape (axes,)
        Standard deviation of a healthy block.
    bounds : shape (windows, axes)
        What the mean of a healthy window doesn't exceed, where the constants are known; inf where that isn't known.
    least : shape (axes,)
        What of it is usual beside the noise.
    """

    constants: FloatArray = field(repr=False)
    covariance: FloatArray = field(repr=False)
    noise: FloatArray
    bounds: FloatArray
    least: FloatArray

    @classmethod
    def of(cls, parts: Sequence[Relation]) -> Learnt | None:
        """Return what healthy parts teach of one relation; None where they are too short."""
        y = np.concatenate([part.y for part in parts])
        design = np.concatenate([part.design for part in parts])
        known = np.isfinite(y).all(axis=1) & np.isfinite(design).all(axis=(1, 2))
        if np.count_nonzero(known) < _FEWEST:
            return None
        first = parts[0]
        constants, covariance = _fitted(y[known], design[known], first)
        least = np.array(first.least)
        raw = cls(
            constants=constants, covariance=covariance, noise=np.ones(y.shape[1]), bounds=np.zeros(0), least=least
        )
        errors = [raw.errors(part) for part in parts]
        noise = np.nanstd(np.concatenate(errors), axis=0)
        bounds = np.array([_bound(errors, window, first.least) for window in WINDOWS])
        bounds = np.minimum.accumulate(bounds, axis=0)  # a mean exceeds none that no part of it exceeds
        return cls(constants=constants, covariance=covariance, noise=noise, bounds=bounds, least=least)

    def with_margin(self, margin: float) -> Learnt:
        """Return the same with bounds so many times as large."""
        return self if margin == 1.0 else replace(self, bounds=margin * self.bounds, least=margin * self.least)

    def errors(self, relation: Relation) -> FloatArray:
        """Return e in the axes in which it is judged, shape (blocks, axes)."""
        left = relation.y - relation.design @ self.constants
        judged = (relation.frame @ left[:, :, np.newaxis])[:, :, 0]
        if relation.is_length:
            judged[:, 0] = np.hypot(1.0 + judged[:, 0], np.hypot(judged[:, 1], judged[:, 2])) - 1.0
        return np.asarray(judged)

    def widening(self, relation: Relation) -> FloatArray:
        """Return by how much less is known of e for what isn't known of the constants, shape (blocks, axes)."""
        seen = relation.frame @ relation.design
        doubt = np.sum((seen @ self.covariance) * seen, axis=2)
        return np.asarray(np.sqrt(1.0 + doubt / self.noise**2))

    def bounds_over(self, blocks: int) -> FloatArray:
        """Return what healthy means over so many blocks don't exceed, by axis."""
        return np.asarray(self.bounds[max(place for place, window in enumerate(WINDOWS) if window <= blocks)])

    def allowed(self, blocks: int, widening: FloatArray) -> FloatArray:
        """Return what means over so many blocks don't exceed: the noise's part of the bound, widened, and the rest."""
        return np.asarray(self.least + (self.bounds_over(blocks) - self.least) * widening)

    def beside_bounds(self, errors: FloatArray, widening: FloatArray) -> FloatArray:
        """Return how large means of errors are beside what is allowed, the largest of windows; NaN where unknown."""
        sums = running(errors)
        ratios = np.full(errors.shape, np.nan)
        for window in WINDOWS:
            allowed = np.nan_to_num(self.allowed(window, widening), nan=np.inf)
            np.fmax(ratios, np.abs(mean_of(sums, window)) / allowed, out=ratios)
        return ratios

    @property
    def table(self) -> dict[str, list[object]]:
        """As plain values; bounds that aren't known are None."""
        table: dict[str, list[object]] = {
            name: getattr(self, name).tolist() for name in ("constants", "covariance", "noise", "least")
        }
        bounds: list[object] = [[each if np.isfinite(each) else None for each in row] for row in self.bounds.tolist()]
        return {**table, "bounds": bounds}

    @classmethod
    def from_table(cls, table: Mapping[str, object]) -> Learnt:
        """Return what `table` gave."""
        arrays = {name: np.asarray(value, dtype=np.float64) for name, value in table.items()}
        return cls(**{**arrays, "bounds": np.nan_to_num(arrays["bounds"], nan=np.inf)})


def moving_mean(values: FloatArray, window: int) -> FloatArray:
    """Return means over the last blocks, NaN where more than 40 % of them are missing, shape (blocks, axes)."""
    return mean_of(running(values), window)


def running(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return how many values there are before each block and after the last, and their sums; (blocks + 1, axes)."""
    there = np.isfinite(values)
    counts, sums = np.zeros((2, len(values) + 1, values.shape[1]))
    np.cumsum(there, axis=0, out=counts[1:])
    np.cumsum(np.where(there, values, 0.0), axis=0, out=sums[1:])
    return counts, sums


def mean_of(running_sums: tuple[FloatArray, FloatArray], window: int) -> FloatArray:
    """Return means over the last blocks of what `running` gave."""
    counts, sums = running_sums
    means = np.full((len(sums) - 1, sums.shape[1]), np.nan)
    if len(means) >= window:
        known = counts[window:] - counts[:-window]
        means[window - 1 :] = (sums[window:] - sums[:-window]) / np.maximum(known, 1.0)
        means[window - 1 :][known < _PRESENT * window] = np.nan
    return means


def _fitted(y: FloatArray, design: FloatArray, of: Relation) -> tuple[FloatArray, FloatArray]:
    """Return a relation's constants by least squares with what is usual, and their covariance."""
    target = y - design @ of.usual
    flat = design.reshape(-1, design.shape[2])
    variance = float(np.var(target)) + _SMALLEST
    for _ in range(_ROUNDS):
        inverse = np.linalg.inv(flat.T @ flat / variance + np.diag(of.spread**-2.0))
        found = inverse @ (flat.T @ target.ravel()) / variance
        variance = max(of.lasts * float(np.mean((target.ravel() - flat @ found) ** 2)), _SMALLEST)
    return of.usual + found, np.asarray(inverse)


def _bound(parts: Sequence[FloatArray], window: int, least: Sequence[float]) -> FloatArray:
    """Return the bound of each axis, by Student's distribution of as many windows as are worth independent ones."""
    from scipy.stats import t as students  # takes longer to import than all of ours

    means = [moving_mean(part, window) for part in parts]
    bounds = np.full(means[0].shape[1], np.inf)
    for axis in range(len(bounds)):
        own = [each[:, axis][np.isfinite(each[:, axis])] for each in means]
        free = sum(map(worth, own))
        if free >= _FEWEST:
            deviation = float(np.sqrt(np.mean(np.concatenate(own) ** 2)))
            apart_s = BLOCK_S * sum(map(len, own)) / free  # from one independent mean to the next
            chance = PER_HOUR * apart_s / 3600.0
            bounds[axis] = float(students.isf(chance / 2.0, free)) * deviation + least[axis]
    return bounds


def worth(values: FloatArray) -> float:
    """Return as how many independent values a series tells its variance: n over the sum of squared correlations."""
    count = len(values)
    if count < 2 or not np.any(values):
        return 0.0
    spectrum = np.abs(np.fft.rfft(values, 2 * count)) ** 2
    products = np.fft.irfft(spectrum)[:count]
    return float(count / (2.0 * np.sum((products / products[0]) ** 2) - 1.0))

"""An equation of a relation with its constants and its noise, learnt from the whole log, made white."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.engine.constants import CHUNK_S, by_chunks, constants_of
from gtmbench.engine.flight import Flight
from gtmbench.engine.noise import CLIPPED, ORDER, filtered, level_of, regime_of, taps_of, unit_of, wander_of
from gtmbench.engine.relation import Relation
from gtmbench.values.record import BoolArray, FloatArray

_FEWEST = 60  # known blocks: a dozen seconds
_FULL = 0.25  # of a usual chunk's precision: a mean of less tells nothing of how means wander


@dataclass(frozen=True, kw_only=True, eq=False)
class Equation:
    """y = X theta + e of one channel, e = level * A(z)^-1 white noise, and a mean that wanders from chunk to chunk."""

    relation: Relation
    channel: int  # which of the relation's
    constants: FloatArray  # shape (constants,): theta
    level: FloatArray = field(repr=False)  # shape (blocks,): the standard deviation of e, up to its colour
    taps: FloatArray = field(repr=False)  # shape (ORDER + 1,): A(z)
    unit: float  # what is left of the deviation behind the filter
    # shape (blocks,): where the equation holds, and did for as long as the filter reaches back
    known: BoolArray = field(repr=False)
    left: FloatArray = field(repr=False)  # shape (blocks,): y - X theta, less what is explained
    wander: float = 0.0  # by how much means of chunks wander, in y's unit

    @property
    def name(self) -> str:
        """The relation's and the channel's."""
        return f"{self.relation.name} {self.relation.channels[self.channel]}"

    def whitened(self, columns: FloatArray) -> FloatArray:
        """Return columns of y's unit made white, zero where the equation isn't known; shape (blocks, ...)."""
        shape = (-1, *[1] * (columns.ndim - 1))
        gain = self.known / self.unit
        return filtered(self.taps, columns / self.level.reshape(shape)) * gain.reshape(shape)

    def whitened_decay(self, columns: FloatArray, factor: float) -> FloatArray:
        """Return the same of columns(t) * factor^(t - s) at each block s = t, for what fades by a factor a block."""
        fading = self.taps * factor ** -np.arange(len(self.taps))
        shape = (-1, *[1] * (columns.ndim - 1))
        gain = self.known / self.unit
        return filtered(fading, columns / self.level.reshape(shape)) * gain.reshape(shape)

    @property
    def regressors(self) -> FloatArray:
        """X made white, shape (blocks, constants)."""
        return self.whitened(np.nan_to_num(self.relation.regressors[:, self.channel]))

    @property
    def errors(self) -> FloatArray:
        """What is left, made white, shape (blocks,)."""
        return self.whitened(self.left)

    @property
    def mean(self) -> FloatArray:
        """What a mean that wanders by one adds, made white, shape (blocks,): more where the noise is louder."""
        return self.whitened(self.level / float(np.median(self.level[self.known])) if self.known.any() else self.level)


def learn(
    flight: Flight,
    relation: Relation,
    channel: int,
    *,
    explained: FloatArray | None = None,
    left_out: BoolArray | None = None,
) -> Equation | None:
    """Return an equation as the whole log has it; None where too little of it is known.

    `explained`, shape (blocks,): what findings account for. `left_out`, shape (blocks,): blocks that aren't asked, such
    as those of a gyro that stands still.
    """
    values, regressors = relation.values[:, channel], relation.regressors[:, channel]
    there = np.isfinite(values) & np.isfinite(regressors).all(axis=1) & relation.asked
    if left_out is not None:
        there = there & ~left_out
    if np.count_nonzero(there) < _FEWEST:
        return None
    # e = y - what findings explain - X theta, theta by most of the log rather than by the sum of all
    own = np.where(there, values, 0.0) - (0.0 if explained is None else explained * there)
    columns = np.nan_to_num(regressors)
    rows = rows_per_chunk(flight)
    constants = constants_of(own, columns, there, relation.prior, rows)
    left = np.where(np.isfinite(values), np.nan_to_num(values) - (0.0 if explained is None else explained), 0.0)
    left = left - columns @ constants * np.isfinite(values)
    # its noise: about each chunk's mean, as loud as how lively the motion is (and a second regime) says,
    beside = _beside_means(left, there, rows)
    level = level_of(beside, there, flight.lively)
    if relation.regime is not None:
        level = level * regime_of(beside / level, there, flight.lively, np.nan_to_num(relation.regime[:, channel]))
    level = np.maximum(level, relation.least)
    # made white by a filter of a second, over which a unit is the deviation that is left
    clipped = np.where(there, np.clip(beside / level, -CLIPPED, CLIPPED), 0.0)
    taps = taps_of(clipped)
    equation = Equation(
        relation=relation,
        channel=channel,
        constants=constants,
        level=level,
        taps=taps,
        unit=unit_of(filtered(taps, clipped)[there]),
        known=_with_past(there, np.isfinite(values)),
        left=left,
    )
    # and by how much chunks' means differ more than that noise makes them
    return replace(equation, wander=_wander(equation, rows))


def rows_per_chunk(flight: Flight) -> int:
    """Return how many blocks a chunk has: whole cells."""
    return ORDER * max(round(CHUNK_S / flight.blocks.period_s / ORDER), 1)


def _beside_means(left: FloatArray, there: BoolArray, rows: int) -> FloatArray:
    """Return what is left less the mean of its chunk, zero where it isn't known."""
    counts = by_chunks(there.astype(float), rows).sum(axis=1)
    means = by_chunks(left * there, rows).sum(axis=1) / np.maximum(counts, 1.0)
    return np.asarray((left - np.repeat(means, rows)[: len(left)]) * there)


def _with_past(there: BoolArray, finite: BoolArray) -> BoolArray:
    """Tell where something is there, and has been known for as long as the filter reaches back."""
    known = there.copy()
    for lag in range(1, min(ORDER + 1, len(known))):
        known[lag:] &= finite[:-lag]
    return known


def _wander(equation: Equation, rows: int) -> float:
    mean, errors = by_chunks(equation.mean, rows), by_chunks(equation.errors, rows)
    precisions = np.square(mean).sum(axis=1)
    usual = float(np.median(precisions[precisions > 0.0])) if (precisions > 0.0).any() else 1.0
    means = np.where(precisions > _FULL * usual, (mean * errors).sum(axis=1) / np.maximum(precisions, 1e-9), np.nan)
    return wander_of(means, np.maximum(precisions, 1e-9), equation.relation.wander)

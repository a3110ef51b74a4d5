"""Deviations over blocks of a tenth of a second, side by side with what was commanded."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gtmbench.detectors.surfaces.answer import Deviations
from gtmbench.values.record import BoolArray, FloatArray

BLOCK_S = 0.1  # between judgements, or a sample where there are fewer
ENOUGH = 0.8  # of blocks, or of a block's samples, that must be there


class DeviationBlocks(NamedTuple):
    """Means over blocks of 1, u, v and d."""

    # shape (blocks, series, 4): series: the surfaces; what is left, u and v being 0; and for every surface what is left
    # by its u and v
    means: FloatArray
    there: BoolArray  # shape (blocks,): whether enough samples of a block were
    surfaces: int  # how many there are
    block_s: float


def rows_of(sample_period_s: float) -> int:
    """Return the samples of a block."""
    return max(round(BLOCK_S / sample_period_s), 1)


def blocks_of(deviations: Deviations, there: BoolArray, sample_period_s: float) -> DeviationBlocks:
    """Return whole blocks; what is left over at the end isn't used.

    `there`, shape (samples,): where no channel misses its sample.
    """
    rows = rows_of(sample_period_s)
    count = len(there) // rows
    left, surfaces = deviations.left, deviations.off.shape[1]
    still, kinds = np.zeros_like(left), left.shape[1]
    d = np.column_stack([deviations.off, left, *[left] * surfaces])
    u, v = (
        np.column_stack([of, still, np.repeat(of, kinds, axis=1)]) for of in (deviations.commanded, deviations.slew)
    )
    x = np.stack([np.ones_like(d), u, v, d], axis=-1)[: count * rows]
    means = x.reshape(count, rows, d.shape[1], 4).mean(axis=1)
    enough = there[: count * rows].reshape(count, rows).mean(axis=1) >= ENOUGH
    return DeviationBlocks(means, enough, surfaces, rows * sample_period_s)

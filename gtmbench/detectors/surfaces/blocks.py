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

    means: FloatArray  # shape (blocks, surfaces, 4)
    there: BoolArray  # shape (blocks,): whether enough samples of a block were
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
    x = np.stack([np.ones_like(deviations.off), deviations.commanded, deviations.slew, deviations.off], axis=-1)
    means = x[: count * rows].reshape(count, rows, *x.shape[1:]).mean(axis=1)
    enough = there[: count * rows].reshape(count, rows).mean(axis=1) >= ENOUGH
    return DeviationBlocks(means, enough, rows * sample_period_s)

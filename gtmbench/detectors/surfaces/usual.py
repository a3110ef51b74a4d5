"""What changes are usual on healthy flight: how large, and how many deviations a change has to be to tell anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.surfaces.answer import ENOUGH, DeviationBlocks
from gtmbench.detectors.surfaces.deviation import ANSWER, KINDS, LEAST_BASE_S, Changes, changes, fitted
from gtmbench.detectors.surfaces.whitened import ORDER, BlockSums, whitening
from gtmbench.values.record import BoolArray, FloatArray

_COLOUR_BLOCKS = 600  # that a colour is learnt from: a minute's


@dataclass(frozen=True, kw_only=True, eq=False)
class Normal:
    """What changes are usual on healthy flight."""

    # shape (surfaces,): deviation of what a minute's fit leaves: what gusts and sensors amount to, in degrees or steps
    noise: FloatArray
    white: FloatArray  # shape (surfaces,): the same, made white
    colour: FloatArray  # shape (tests, surfaces): how many times the size that white noise would give changes have

    def nats(self, found: Changes) -> FloatArray:
        """Return T^2/2 of all tests, shape (blocks, tests, surfaces); NaN where a test tells nothing."""
        t = np.maximum(found.size - found.tolerated, 0.0) / self.colour
        return np.asarray(0.5 * np.square(np.minimum(t, 1e3)))

    def smallest(self, found: Changes, thresholds: FloatArray) -> FloatArray:
        """Return the least change that each test would alarm of, shape (blocks, tests, surfaces), in the test's unit.

        `thresholds`, shape (tests, surfaces): in nats.
        """
        return np.asarray((found.tolerated + np.sqrt(2.0 * thresholds) * self.colour) * found.error)


def normal_of(healthy: Sequence[DeviationBlocks]) -> Normal:
    """Return what is usual, of the blocks of healthy records."""
    powers = []
    for blocks in healthy:
        base = round(LEAST_BASE_S / blocks.block_s)
        for first in range(0, len(blocks.there) - base + 1, base):
            part = slice(first, first + base)
            if blocks.there[part].mean() >= ENOUGH:
                powers.append(_powers(blocks.means[part], blocks.there[part]))
    surfaces = healthy[0].means.shape[1]
    noise, floor = np.sqrt(np.median(np.array(powers or [np.ones((2, surfaces))]), axis=0))
    found = [changes(blocks, floor) for blocks in healthy]
    size, tolerated, _ = (np.concatenate(each) for each in zip(*found, strict=True))
    # where more is tolerated than a deviation, sizes are those of the aircraft's own small changes, not of noise
    of_noise = np.isfinite(size) & (tolerated < 1.0)
    seen = of_noise.sum(axis=0)
    degrees = np.array([2.0 if kind == ANSWER else 1.0 for kind in KINDS])[:, np.newaxis]
    squares = np.sum(np.square(size), axis=0, where=of_noise) / np.maximum(seen, 1) / degrees
    colour = np.sqrt(np.where(seen >= _COLOUR_BLOCKS, squares, 1.0))
    return Normal(noise=noise, white=floor, colour=np.maximum(colour, 1.0))


def _powers(means: FloatArray, there: BoolArray) -> FloatArray:
    """Return the power of what a fit of some blocks leaves, as it is and made white."""
    sums = BlockSums(means.shape[1], 4, len(means))
    sums.push(means, there)
    begin, end, held = np.array([0]), np.array([sums.count]), np.full((1, means.shape[1]), there.sum())
    taps = np.zeros((1, means.shape[1], ORDER + 1))
    taps[..., 0] = 1.0
    fit, plain, _ = fitted(sums.whitened(begin, end, taps), held)
    _, white, _ = fitted(sums.whitened(begin, end, whitening(sums.lagged(begin, end, fit))), held)
    return np.array([plain[0], white[0]])

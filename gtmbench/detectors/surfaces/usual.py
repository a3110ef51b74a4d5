"""What changes are usual on healthy flight: how large, and how many deviations a change has to be to tell anything."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.surfaces.blocks import ENOUGH, DeviationBlocks
from gtmbench.detectors.surfaces.deviation import (
    ANSWER,
    KINDS,
    LEAST_BASE_S,
    LEVEL,
    OFFSET,
    TOLERATED_DEG,
    Changes,
    changes,
    fitted,
    grouped,
    judged_series,
)
from gtmbench.detectors.surfaces.whitened import ORDER, BlockSums, whitening
from gtmbench.values.record import BoolArray, FloatArray

_LEFT_TOLERATED = 0.3  # deviations of what no surface explains
_LEAST_LEVEL = 0.1  # how much logarithms of squares vary at least
_COLOUR_BLOCKS = 600  # that a colour is learnt from: a minute's


@dataclass(frozen=True, kw_only=True, eq=False)
class Normal:
    """What changes are usual on healthy flight."""

    # shape (series,): deviation of what a minute's fit leaves: what gusts and sensors amount to, in the series' units
    noise: FloatArray
    white: FloatArray  # shape (series,): the same, made white
    colour: FloatArray  # shape (tests, series): how many times the size that white noise would give changes really have

    def nats(self, found: Changes, surfaces: int) -> FloatArray:
        """Return T^2/2 of all tests, shape (blocks, tests, series); NaN where a test tells nothing."""
        tolerated = found.tolerated.copy()
        of_offset = [kind == OFFSET for kind in KINDS]
        tolerated[:, of_offset, surfaces:] *= _LEFT_TOLERATED / TOLERATED_DEG
        t = np.maximum(found.size - tolerated, 0.0) / self.colour
        t[:, [kind == LEVEL for kind in KINDS], :surfaces] = np.nan
        t[:, [kind == ANSWER for kind in KINDS], surfaces:] = np.nan
        judged = judged_series(surfaces, t.shape[2])
        return np.asarray(0.5 * np.square(np.minimum(t[..., :judged], 1e3)))

    def smallest(self, found: Changes, thresholds: FloatArray) -> FloatArray:
        """Return the least change that each test would alarm of, shape (blocks, tests, series), in the test's unit.

        `thresholds`, shape (tests, series): in nats.
        """
        judged = thresholds.shape[1]
        beyond = np.sqrt(2.0 * thresholds) * self.colour[:, :judged]
        return np.asarray((found.tolerated[..., :judged] + beyond) * found.error[..., :judged])


def normal_of(healthy: Sequence[DeviationBlocks]) -> Normal:
    """Return what is usual, of the blocks of healthy records."""
    surfaces, series = healthy[0].surfaces, healthy[0].means.shape[1]
    noise: list[FloatArray] = []
    white: list[FloatArray] = []
    for blocks in healthy:
        base = round(LEAST_BASE_S / blocks.block_s)
        for first in range(0, len(blocks.there) - base + 1, base):
            part = slice(first, first + base)
            if blocks.there[part].mean() >= ENOUGH:
                groups = grouped(surfaces, series, base, blocks.block_s)
                both = [_powers(sums, blocks.means[part, own], blocks.there[part]) for own, sums in groups]
                for powers, of_groups in zip((noise, white), zip(*both, strict=True), strict=True):
                    powers.append(np.concatenate(of_groups))
    if not noise:
        noise = white = [np.ones(series)]
    floor = np.sqrt(np.median(np.array(white), axis=0))
    found = [changes(blocks, floor) for blocks in healthy]
    size, tolerated = (np.concatenate(each) for each in list(zip(*found, strict=True))[:2])
    # where more is tolerated than a deviation, sizes are those of the aircraft's own small changes, not of noise
    of_noise = np.isfinite(size) & (tolerated < 1.0)
    seen = of_noise.sum(axis=0)
    degrees = np.array([2.0 if kind == ANSWER else 1.0 for kind in KINDS])[:, np.newaxis]
    squares = np.sum(np.square(size), axis=0, where=of_noise) / np.maximum(seen, 1) / degrees
    colour = np.sqrt(np.where(seen >= _COLOUR_BLOCKS, squares, 1.0))
    least = np.array([[_LEAST_LEVEL if kind == LEVEL else 1.0] for kind in KINDS])
    return Normal(
        noise=np.sqrt(np.median(np.array(noise), axis=0)),
        white=floor,
        colour=np.maximum(colour, least),
    )


def _powers(sums: BlockSums, means: FloatArray, there: BoolArray) -> tuple[FloatArray, FloatArray]:
    """Return the power of what a fit of some blocks leaves, as it is and made white."""
    sums.push(means, there)
    begin, end, held = np.array([0]), np.array([sums.count]), np.full((1, means.shape[1]), there.sum())
    taps = np.zeros((1, means.shape[1], ORDER + 1))
    taps[..., 0] = 1.0
    fit, plain, _ = fitted(sums.whitened(begin, end, taps), held)
    _, white, _ = fitted(sums.whitened(begin, end, whitening(sums.lagged(begin, end, fit))), held)
    return plain[0], white[0]

"""What a residual's noise is, block by block: level, colour, tail, steadiness and slowness, from the blocks before.

A block is half a second. Each is measured once into a row of sums (`COUNT`, `SIZE`, ...), and what a block is whitened
by is worked out of sums over the rows before it, so that noise is followed at the price of a few additions.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from gtmbench.method.filters import levinson
from gtmbench.values.record import FloatArray

IntArray = np.ndarray[tuple[int], np.dtype[np.int_]]

NEIGHBOURS = 4  # blocks, whose powers tell how steady noise is
SUB = 5  # parts of a block, whose powers tell of bursts
MEANS = (1, 2, 4, 8, 16)  # blocks, whose means tell how slow noise is
CLIPS = np.array([2.5, 3.0, 3.5, 4.0])  # deviations
FIRST, _SPAN, MEMORY = 14, 40, 400  # blocks: learnt at first, followed over, remembered for steadiness
LATE = 16  # blocks that are too young to tell of steadiness: faults change that, too
_FLOOR = 0.0025  # of the calibrated variance: how quiet noise may get before it is taken for the sensor's
LEAST = 0.1 * math.sqrt(_FLOOR)  # of the calibrated deviation

# the tail: Gaussian noise clipped at four deviations has, in 95 % of 20 s at 100 Hz, a kurtosis of 2.8 to 3.2
_KURTOSIS, _PER_KURTOSIS = 3.2, 1.2  # from which on, and by how much, the clip is lowered

# steadiness, sigma^2: before anything is known, and after how many blocks a quarter of that is left
_UNSTEADY, _WORTH = 0.2, 20.0
_STEADIEST = 1e-3  # no noise is known better than to 3 %
_HEAVIEST, _TAILS = 3.0, 20.0  # excess kurtosis of short sums, at most, and how much of it makes sigma^2 = 1

# slowness: before anything is known, of a block's variance; what chance makes of the means' excess
_UNKNOWN_SLOW = 1.0
_CHANCE, _OF_BLOCKS = 2.5, 4  # deviations of it; times a mean's blocks that tell of it
_WANDERING = 4.0  # of sigma^2, by how much chance grows where power wanders

# columns of a table of measured blocks
COUNT, SIZE, SUM, FOURTH, SLOW, FAST, LOW, SQUARES, FOURTHS = range(9)
CLIPPED = slice(9, 9 + len(CLIPS))  # behind the nine above
SQUARED_MEANS = slice(CLIPPED.stop, CLIPPED.stop + len(MEANS))
LAGS = slice(SQUARED_MEANS.stop, None)


@dataclass(frozen=True, kw_only=True, eq=False)
class LearntNoiseModel:
    """What a block is whitened by, one row a block."""

    local: FloatArray  # deviation behind the calibrated filter, shape (blocks,)
    taps: FloatArray  # of the second filter, over its innovations' deviation: (blocks, order + 1)
    clip: FloatArray  # in deviations of what that gives
    scale: FloatArray  # to variance 1
    unsteady: FloatArray
    slow: FloatArray
    base: FloatArray  # mean of what is white

    def first(self, blocks: int) -> LearntNoiseModel:
        """Return the first so many of them."""
        return LearntNoiseModel(**{name: values[:blocks] for name, values in vars(self).items()})

    def repeated(self, blocks: int) -> LearntNoiseModel:
        """Return the last of them for so many blocks."""
        return LearntNoiseModel(**{name: np.repeat(values[-1:], blocks, axis=0) for name, values in vars(self).items()})


@dataclass(frozen=True, eq=False)
class Ends:
    """What of the blocks that were learnt last the next ones look back at."""

    clipped: FloatArray  # rows behind the calibrated filter
    powers: FloatArray  # less 1, of samples and of sums, shape (NEIGHBOURS, 2)
    burst: float  # of the last part of a block, less 1
    sums: FloatArray  # of the last blocks

    @classmethod
    def nothing(cls, order: int) -> Ends:
        """Return that of no blocks, for a second filter of so many coefficients."""
        return cls(np.zeros(order), np.zeros((NEIGHBOURS, 2)), 0.0, np.zeros(MEANS[-1] - 1))


class LearntBlocks:
    """What some blocks are whitened by, from the blocks before each: a step at a time, as they are measured.

    `ring`, shape (blocks before, columns). `blocks`: they are measured into `new`, shape (blocks, columns). `end`,
    shape (blocks,): how many blocks each may stand on. `rows`: of a block.
    """

    def __init__(self, ring: FloatArray, blocks: int, end: IntArray, rows: int) -> None:
        self._table = np.concatenate([ring, np.zeros((blocks, ring.shape[1]))])
        self.new = self._table[len(ring) :]
        self._end, self._rows = end, rows

    def _sums(self, columns: slice | list[int], first: IntArray, end: IntArray) -> FloatArray:
        """Return sums over the blocks from `first` on, up to `end`: a row for each of these."""
        begin = int(first[0])
        given = self._table[begin : int(end[-1]), columns]
        if len(end) == 1:
            return np.asarray(given.sum(axis=0, keepdims=True))
        sums = np.concatenate([np.zeros((1, given.shape[1])), np.cumsum(given, axis=0)])
        return np.asarray(sums[end - begin] - sums[first - begin])

    def _recent(self, columns: slice | list[int]) -> FloatArray:
        """Return means over the samples of the last blocks."""
        return self._sums(columns, self._first, self._end) / self._count

    @cached_property
    def _first(self) -> IntArray:
        return np.maximum(self._end - _SPAN, 0)

    @cached_property
    def _count(self) -> FloatArray:
        return np.maximum(self._sums([COUNT], self._first, self._end), 1.0)

    @cached_property
    def local(self) -> FloatArray:
        """The deviation behind the calibrated filter, shape (blocks,)."""
        return np.maximum(self._recent([SIZE])[:, 0] * math.sqrt(math.pi / 2.0), LEAST)

    @cached_property
    def taps(self) -> FloatArray:
        """The second filter over its innovations' deviation, shape (blocks, order + 1)."""
        covariance = self._recent(LAGS)
        covariance[:, 0] = covariance[:, 0] * (1.0 + 1e-4) + _FLOOR
        taps, variance = levinson(covariance)
        taps /= np.sqrt(variance)[:, np.newaxis]
        return taps

    @cached_property
    def tail(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Where to clip, by what to scale then, and how much of the power is noise and not the floor."""
        clipped, fourth = self._recent(CLIPPED), self._recent([FOURTH])[:, 0]
        kurtosis = fourth / np.maximum(clipped[:, -1], 1e-12) ** 2
        clip = np.maximum(CLIPS[-1] - _PER_KURTOSIS * np.maximum(kurtosis - _KURTOSIS, 0.0), CLIPS[0])
        at = np.minimum(np.searchsorted(CLIPS, clip, side="right") - 1, len(CLIPS) - 2)
        share = (clip - CLIPS[at]) / (CLIPS[at + 1] - CLIPS[at])
        blocks = np.arange(len(clip))
        power = clipped[blocks, at] * (1.0 - share) + clipped[blocks, at + 1] * share
        floored = np.maximum(power + _FLOOR * np.square(self.taps).sum(axis=1), 1e-12)
        return clip, 1.0 / np.sqrt(floored), np.maximum(power / floored, 1e-6)

    @cached_property
    def model(self) -> LearntNoiseModel:
        """All of it."""
        clip, scale, quiet = self.tail
        return LearntNoiseModel(
            local=self.local,
            taps=self.taps,
            clip=clip,
            scale=scale,
            unsteady=np.maximum(self._unsteady, np.square(0.5 * np.log(quiet))),
            slow=self._slow,
            base=self._recent([SUM])[:, 0],
        )

    @cached_property
    def _unsteady(self) -> FloatArray:
        """sigma^2: the greatest of three products of neighbouring powers, less what chance may make of it.

        To it comes what short sums have of a heavy tail, which a gyro's outliers leave there though no sample shows it,
        and what isn't known yet.
        """
        first, end = self._remembered
        blocks = end - first
        sums = self._sums([SLOW, FAST, LOW, SQUARES, FOURTHS], first, end)
        slow, fast, low, squares, fourths = (sums / blocks[:, np.newaxis]).T
        chance = 2.0 / np.sqrt(blocks)  # two deviations of it
        found = (slow - chance / self._rows, fast - 4.5 * chance / self._rows, low - 0.16 * chance)
        kurtosis = fourths / np.maximum(squares, 1e-12) ** 2 - math.sqrt(24.0 / SUB) * chance
        tail = np.minimum(np.maximum(kurtosis - 3.0, 0.0), _HEAVIEST) / _TAILS
        unknown = _UNSTEADY * np.square(_WORTH / (_WORTH + blocks))
        return np.asarray(np.maximum(np.maximum.reduce(found), 0.0) + tail + unknown + _STEADIEST)

    @property
    def _slow(self) -> FloatArray:
        """The variance of means that stays, however long they are: of some lengths the greatest excess over white's.

        Of M blocks of L rows it is mean(S^2) / (M L)^2 less 1 / (M L) and that of the straight line through all, S the
        blocks' sums: a drift is no noise. To it comes what isn't known yet.
        """
        first, end = self._remembered
        blocks = (end - first)[:, np.newaxis]
        lengths = np.array(MEANS)
        steady = np.square(self._sums([SUM], first, end) / blocks) + self._trend(first, end)[:, np.newaxis]
        excess = self._sums(SQUARED_MEANS, first, end) / blocks - lengths / self._rows * steady - 1.0
        chance = (1.0 + _WANDERING * self._unsteady[:, np.newaxis]) * np.sqrt(2.0 * lengths / blocks)
        tells = (excess > _CHANCE * chance) & (_OF_BLOCKS * lengths <= blocks)
        found = np.where(tells, excess / (lengths * self._rows), 0.0).max(axis=1)
        unknown = _UNKNOWN_SLOW / self._rows * np.power(_WORTH / (_WORTH + blocks[:, 0]), 4)
        return np.asarray(found + unknown)

    def _trend(self, first: IntArray, end: IntArray) -> FloatArray:
        """Return the variance of the straight line through the sums of some blocks."""
        begin, blocks = int(first[0]), (end - first).astype(float)
        own = self._table[begin : int(end[-1]), SUM]
        sums, moments = (np.concatenate([[0.0], np.cumsum(of)]) for of in (own, own * np.arange(len(own))))
        total, moment = (of[end - begin] - of[first - begin] for of in (sums, moments))
        along = moment - total * (0.5 * (first + end - 1.0) - begin)  # sums times how far they are from the middle
        return np.asarray(12.0 * np.square(along) / (blocks**2 * np.maximum(blocks**2 - 1.0, 1.0)))

    @property
    def _remembered(self) -> tuple[IntArray, IntArray]:
        """The first of the blocks that tell of steadiness, and the end of them."""
        end = np.maximum(self._end - LATE, np.minimum(self._end, FIRST))
        return np.maximum(end - MEMORY, 0), end

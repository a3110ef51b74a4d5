"""What a sensor shows by itself: that it repeats one reading, is silent, or that its noise has grown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.crosscheck.relations import BLOCK_S, CHANNELS
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, Record

IntArray = NDArray[np.int64]
_STUCK_S, _OF_USUAL = 2.0, 3.0  # seconds of one reading or of none, and times the longest healthy ones
_STUCK_READINGS = 5
_WINDOW = 10  # blocks over which noise is measured
_LOUDER, _BEYOND = 4.0, 2.0  # times the power, beside so many times what its logarithm exceeds its mean by
_FEWEST = 100  # blocks
_SHAKEN, _GYROS = 0.5, "gyros"  # of its bound: a noise that has grown


@dataclass(frozen=True, kw_only=True)
class OwnNoise:
    """What a channel's healthy readings are like.

    Attributes
    ----------
    held_s : float
        The longest time with one reading.
    silent_s : float
        The longest time without one.
    power : float
        Logarithm of the power of its second differences, in the mean.
    bound : float
        By how much that varies; inf where it isn't known.
    """

    held_s: float
    silent_s: float
    power: float
    bound: float

    @classmethod
    def of(cls, records: Sequence[Record], name: str) -> OwnNoise:
        """Return what healthy records teach of a channel."""
        read = [_Readings.of(record, name) for record in records]
        held = max((float(each.held_s(np.arange(each.count)).max(initial=0.0)) for each in read), default=0.0)
        silent = max((float(each.silent_s(np.arange(each.count)).max(initial=0.0)) for each in read), default=0.0)
        powers = [each.powers() for each in read]
        known = np.concatenate([each[np.isfinite(each)] for each in powers])
        if len(known) < _FEWEST:
            return cls(held_s=held, silent_s=silent, power=0.0, bound=np.inf)
        mean = float(known.mean())
        return cls(
            held_s=held, silent_s=silent, power=mean, bound=np.log(_LOUDER) + _BEYOND * (float(known.max()) - mean)
        )

    def stuck(self, read: _Readings) -> FloatArray:
        """Return for how long a channel has repeated one reading, or had none, beside what is too long; (blocks,)."""
        held = read.held_s(read.ends) / max(_STUCK_S, _OF_USUAL * self.held_s)
        return np.maximum(held, read.silent_s(read.ends) / max(_STUCK_S, _OF_USUAL * self.silent_s))

    def louder(self, read: _Readings) -> FloatArray:
        """Return by how much its noise has grown, beside the bound, shape (blocks,)."""
        return (read.powers() - self.power) / self.bound


def own_ratios(record: Record, usual: Mapping[str, OwnNoise], blocks: int) -> dict[str, FloatArray]:
    """Return by sensor what it shows by itself, beside the bounds, shape (blocks,).

    Noise of a sensor counts only while no other one's grows: gusts and vibration shake several, which is no fault.
    """
    read = {name: _Readings.of(record, name) for name in usual}
    louder = {
        sensor: _largest([usual[name].louder(read[name]) for name in channels if name in usual], blocks)
        for sensor, channels in {**CHANNELS, _GYROS: GYROS}.items()
    }
    found = {}
    for sensor, channels in CHANNELS.items():
        own = [name for name in channels if name in usual]
        if own:
            others = _largest([ratio for other, ratio in louder.items() if other != sensor], blocks)
            stuck = _largest([usual[name].stuck(read[name]) for name in own], blocks)
            found[sensor] = np.maximum(stuck, np.where(others < _SHAKEN, louder[sensor], 0.0))
    return found


def _largest(ratios: Sequence[FloatArray], blocks: int) -> FloatArray:
    """Return the largest of some ratios, zero where none is known."""
    return np.asarray(np.max([np.zeros(blocks), *map(np.nan_to_num, ratios)], axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Readings:
    """What a channel of a record reads, and in which of its rows; so many rows are a block."""

    rows: IntArray
    values: FloatArray
    count: int
    block: int
    period_s: float

    @classmethod
    def of(cls, record: Record, name: str) -> _Readings:
        values = record[name]
        rows = np.flatnonzero(np.isfinite(values))
        own = max(round(BLOCK_S / record.sample_period_s), 1)
        return cls(rows=rows, values=values[rows], count=len(record), block=own, period_s=record.sample_period_s)

    @property
    def ends(self) -> IntArray:
        """The last rows of the blocks."""
        return np.arange(self.block, self.count + 1, self.block) - 1

    def held_s(self, at: IntArray) -> FloatArray:
        """Return for how long it has read the same at some rows, of the last readings; zero before there are five."""
        if not len(self.rows):
            return np.zeros(len(at))
        starts = np.concatenate([[0], 1 + np.flatnonzero(self.values[1:] != self.values[:-1])])  # of one reading
        last = np.searchsorted(self.rows, at, side="right") - 1
        first = starts[np.searchsorted(starts, np.maximum(last, 0), side="right") - 1]
        held_s = (self.rows[last] - self.rows[first]) * self.period_s
        return np.where((last >= 0) & (last - first >= _STUCK_READINGS - 1), held_s, 0.0)

    def silent_s(self, at: IntArray) -> FloatArray:
        """Return how long before some rows it was read; zero before its first reading."""
        if not len(self.rows):
            return np.zeros(len(at))
        last = np.searchsorted(self.rows, at, side="right") - 1
        return np.where(last < 0, 0.0, (at - self.rows[last]) * self.period_s)

    def powers(self) -> FloatArray:
        """Return the logarithm of the power of second differences over the last blocks, shape (blocks,)."""
        blocks = self.count // self.block
        block = self.rows[2:] // self.block
        squares = np.square(np.diff(self.values, 2))
        counts = np.bincount(block, minlength=blocks)[:blocks]
        sums = np.bincount(block, squares, minlength=blocks)[:blocks]
        means = np.where(counts > 0, sums / np.maximum(counts, 1), np.nan)
        power = np.full(blocks, np.nan)
        if blocks >= _WINDOW:  # medians: a bump is no noise
            windows = np.sort(np.lib.stride_tricks.sliding_window_view(means, _WINDOW), axis=1)  # what is missing, last
            known = np.isfinite(windows).sum(axis=1)
            row = np.arange(len(windows))
            medians = (windows[row, np.maximum(known - 1, 0) // 2] + windows[row, known // 2]) / 2.0
            power[_WINDOW - 1 :] = np.where(known > _WINDOW // 2, medians, np.nan)
        return np.log(np.where(power > 0.0, power, np.nan))

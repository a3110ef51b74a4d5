"""What a sensor shows by itself: that it repeats one reading, is silent, or that its noise has grown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.crosscheck.relations import BLOCK_S, CHANNELS
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, Record

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
        held = max((float(np.nanmax(_held_s(record, name), initial=0.0)) for record in records), default=0.0)
        silent = max((float(_silent_s(record, name).max(initial=0.0)) for record in records), default=0.0)
        powers = [_powers(record, name) for record in records]
        known = np.concatenate([each[np.isfinite(each)] for each in powers])
        if len(known) < _FEWEST:
            return cls(held_s=held, silent_s=silent, power=0.0, bound=np.inf)
        mean = float(known.mean())
        return cls(
            held_s=held, silent_s=silent, power=mean, bound=np.log(_LOUDER) + _BEYOND * (float(known.max()) - mean)
        )

    def stuck(self, record: Record, name: str, blocks: int) -> FloatArray:
        """Return for how long a channel has repeated one reading, or had none, beside what is too long; (blocks,)."""
        held = _held_s(record, name) / max(_STUCK_S, _OF_USUAL * self.held_s)
        return _at_ends(
            np.maximum(held, _silent_s(record, name) / max(_STUCK_S, _OF_USUAL * self.silent_s)), record, blocks
        )

    def louder(self, record: Record, name: str) -> FloatArray:
        """Return by how much its noise has grown, beside the bound, shape (blocks,)."""
        return (_powers(record, name) - self.power) / self.bound


def own_ratios(record: Record, usual: Mapping[str, OwnNoise], blocks: int) -> dict[str, FloatArray]:
    """Return by sensor what it shows by itself, beside the bounds, shape (blocks,).

    Noise of a sensor counts only while no other one's grows: gusts and vibration shake several, which is no fault.
    """
    louder = {
        sensor: _largest([usual[name].louder(record, name) for name in channels if name in usual], blocks)
        for sensor, channels in {**CHANNELS, _GYROS: GYROS}.items()
    }
    found = {}
    for sensor, channels in CHANNELS.items():
        own = [name for name in channels if name in usual]
        if own:
            others = _largest([ratio for other, ratio in louder.items() if other != sensor], blocks)
            stuck = _largest([usual[name].stuck(record, name, blocks) for name in own], blocks)
            found[sensor] = np.maximum(stuck, np.where(others < _SHAKEN, louder[sensor], 0.0))
    return found


def _largest(ratios: Sequence[FloatArray], blocks: int) -> FloatArray:
    """Return the largest of some ratios, zero where none is known."""
    return np.asarray(np.max([np.zeros(blocks), *map(np.nan_to_num, ratios)], axis=0))


def _held_s(record: Record, name: str) -> FloatArray:
    """Return at each row for how long a channel has read the same, of its last readings; zero before there are five."""
    values = record[name]
    rows = np.flatnonzero(np.isfinite(values))
    held = np.zeros(len(values))
    if len(rows) < 2:
        return held
    read = values[rows]
    changed = np.concatenate([[True], read[1:] != read[:-1]])
    since = np.maximum.accumulate(np.where(changed, np.arange(len(rows)), 0))
    long_enough = np.arange(len(rows)) - since >= _STUCK_READINGS - 1
    held[rows] = np.where(long_enough, (rows - rows[since]) * record.sample_period_s, 0.0)
    last = np.maximum.accumulate(np.where(np.isfinite(values), np.arange(len(values)), 0))
    return held[last]


def _silent_s(record: Record, name: str) -> FloatArray:
    """Return at each row how long ago a channel was read; zero before its first reading."""
    rows = np.arange(len(record))
    last = np.maximum.accumulate(np.where(np.isfinite(record[name]), rows, -1))
    return np.where(last < 0, 0.0, (rows - last) * record.sample_period_s)


def _powers(record: Record, name: str) -> FloatArray:
    """Return the logarithm of the power of second differences over the last blocks, shape (blocks,)."""
    rows = max(round(BLOCK_S / record.sample_period_s), 1)
    blocks = len(record) // rows
    values = record[name]
    at = np.flatnonzero(np.isfinite(values))
    squares = np.full(len(values), np.nan)
    squares[at[2:]] = np.diff(values[at], 2) ** 2
    shaped = squares[: blocks * rows].reshape(blocks, rows)
    counts = np.isfinite(shaped).sum(axis=1)
    means = np.where(counts > 0, np.nansum(shaped, axis=1) / np.maximum(counts, 1), np.nan)
    power = np.full(blocks, np.nan)
    if blocks >= _WINDOW:  # medians: a bump is no noise
        windows = np.lib.stride_tricks.sliding_window_view(means, _WINDOW)
        known = np.isfinite(windows).sum(axis=1) > _WINDOW // 2
        power[_WINDOW - 1 :][known] = np.nanmedian(windows[known], axis=1)
    return np.log(np.where(power > 0.0, power, np.nan))


def _at_ends(values: FloatArray, record: Record, blocks: int) -> FloatArray:
    """Return values of the blocks' last rows."""
    rows = max(round(BLOCK_S / record.sample_period_s), 1)
    return values[rows - 1 : blocks * rows : rows]

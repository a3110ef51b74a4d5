"""What a sensor's own readings tell, without any other sensor: noise that comes or goes, repeats, straight lines.

An aircraft moves slowly beside its sensors' samples, so the fourth differences of readings are the sensor's own noise.
A fault of a gyro leaves the attitude sensors' alone, and the other way round: where one residual holds both, this tells
them apart. What is usual is learnt just before the fault, on the same flight with the same sensors; motion that should
have been as sudden as noise is discounted (`Habit.motion`), and counts of a converter tell by repeating only what is
far from usual.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from gtmbench.method.filters import innovations
from gtmbench.values.record import BoolArray, FloatArray, runs

_DIFFERENCE = np.array([1.0, -4.0, 6.0, -4.0, 1.0])  # the fourth: 2 Hz in 100 are a thousandth of what noise is
ALIKE = 2.0  # its samples aren't independent: about half of them count
_ROWS = 3000  # learnt from, at most
_LEAST = 200  # rows that tell a habit: two blocks
_BLOCK = 100  # rows, of which a mean square is known to a seventh
_UNSTEADY = 1.7  # times the variance: blocks of a steady noise stay below
_STRAIGHT = 1e-9  # of the readings' size
_STRAIGHTER = 0.005  # of the rows, more than before
_AROUND = 25  # rows
_DISCOUNT = 16.0  # of what should have been sudden: a model of motion is good to a quarter
_STEADY = 1.5  # a sensor's noise may change by that factor and tell nothing
_QUIETEST = 1e-3  # of the usual power: less is as good as stuck
_DISTINCT = 0.9  # of the readings, where they are no counts
_OFTEN, _FEW = 4.0, 5  # times the straight rows of before, and so many, are no surprise of counts
_LONGER = 2  # times the most in a row of before: a run of counts that is no surprise
_OF_LONGEST = 4.0  # of -2 log likelihood: of N exponential runs the longest is log(N) means long, and 2 is a mean's
_SELDOM, _EVER = 0.15, 0.3  # of the rows, and of any hundred, that counts run straight at most: noise above a count
_COARSE = 0.8  # of the rows run straight
_EVERY_DAY = 0.01  # added to the share of straight rows before: what is that rare is no surprise

ROWS_BEFORE = _ROWS + 4  # with those that the fourth difference takes


@dataclass(frozen=True, kw_only=True, eq=False)
class Habit:
    """How a healthy sensor reads."""

    # shape (5,): of the filter from its readings to its noise, over more than the deviation of that, so that two
    # samples count for one
    taps: FloatArray = field(repr=False)
    quietest: float  # the least mean square of that over a block, of its own; 0 where being quiet tells nothing
    straight: float  # share of rows whose second difference is zero: it repeats itself, or runs dead straight
    reach: float  # its greatest magnitude
    before: FloatArray = field(repr=False)  # shape (rows,): what it read
    is_steady: bool = True  # whether its noise is as loud at all times, so that a little more or less of it tells
    is_counted: bool = False  # whether its readings are counts of a converter, which may repeat where nothing moves
    is_fine: bool = True  # whether its noise is above a count
    longest: int = 0  # how many rows in a row ran dead straight at most

    @property
    def variance(self) -> float:
        """Of its noise, in the channel's unit squared, were that white."""
        return 1.0 / (ALIKE * float(np.sum(np.square(self.taps))))

    @property
    def is_coarse(self) -> bool:
        """Whether its readings are counts that are far above its noise, and above its motion between samples."""
        return self.is_counted and self.straight > _COARSE

    def innovations(self, readings: FloatArray) -> FloatArray:
        """Return its noise, in deviations; NaN where a reading that it needs is missing."""
        there = readings[np.isfinite(readings)]
        return innovations(readings - (there[0] if len(there) else 0.0), self.taps)  # smaller numbers, same steps

    def motion(self, expected: FloatArray) -> FloatArray:
        """Return by what innovations are to be divided where the sensor should have moved too suddenly to predict."""
        sudden = np.square(np.convolve(expected - expected[0], self.taps)[: len(expected)])
        sudden[: len(self.taps)] = 0.0
        around = np.convolve(sudden, np.ones(_AROUND) / _AROUND, mode="same")
        return np.sqrt(1.0 + _DISCOUNT * around)

    def deviance(self, squares: FloatArray, count: int) -> FloatArray:
        """Return -2 log likelihood of `count` samples of noise by their sum of squares, which may be less than ever."""
        if not self.quietest:
            return squares
        samples = max(count, 1) / ALIKE
        level = np.clip(squares / samples * _STEADY / self.quietest, _QUIETEST, 1.0)
        return np.asarray(samples * np.log(level) + squares / level)

    def standing(self, readings: FloatArray) -> FloatArray:
        """Return how many rows run dead straight together, of each run that is longer than usual."""
        return self._longer(straight_rows(readings))

    def _longer(self, straight: BoolArray) -> FloatArray:
        lengths = _lengths(straight)
        return np.asarray(lengths[lengths > self._usual], dtype=float)

    @property
    def _usual(self) -> int:
        return _LONGER * self.longest + _FEW

    def surprise(self, readings: FloatArray) -> float:
        """Return -2 log likelihood of straight rows, were the sensor healthy; of counts, of more than is usual.

        These are more than usual in all, or in a row: a while of standing still stays one, whatever comes after. Counts
        that are coarser than their noise tell only by runs, whose lengths fall off as the longest before says.
        """
        rows = straight_rows(readings)
        straight = int(rows.sum())
        each = -2.0 * float(np.log(min(self.straight + _EVERY_DAY, 1.0))) if self.is_fine else 0.0
        if not self.is_counted:
            return each * straight
        standing = self._longer(rows)
        beyond = float((standing - self._usual).sum()) / max(self.longest, 1)
        straight = max(straight - round(_OFTEN * self.straight * len(readings)) - _FEW, int(standing.sum()))
        return max(each * straight, _OF_LONGEST * beyond)


def habit_of(readings: FloatArray) -> Habit | None:
    """Learn how a sensor reads from rows before a fault; None where they are too few, or all alike."""
    if len(readings) < _LEAST:
        return None
    last = readings[-ROWS_BEFORE:]
    left = innovations(last, _DIFFERENCE)
    left = left[np.isfinite(left)]
    if len(left) < _LEAST:
        return None
    blocks = np.square(left[: len(left) // _BLOCK * _BLOCK]).reshape(-1, _BLOCK).mean(axis=1)
    variance = float(np.mean(np.square(left)))
    is_steady = bool(blocks.max() <= _UNSTEADY * variance)
    if not is_steady:  # gusts, vibration: only what is more than all of that tells of the sensor
        variance = float(blocks.max())
    if not variance > (1e-9 * max(float(np.nanmax(np.abs(last))), 1e-12)) ** 2:
        return None
    there = last[np.isfinite(last)]
    rows = straight_rows(last)
    straight, quietest = float(np.mean(rows[np.isfinite(last)])), float(blocks.min()) / variance
    is_counted = len(np.unique(there)) < _DISTINCT * len(there)
    is_fine = True
    if is_counted:  # counts repeat whenever little moves, unless their noise is above a count
        most = float(rows[: len(rows) // _BLOCK * _BLOCK].reshape(-1, _BLOCK).mean(axis=1).max())
        is_fine, quietest = straight <= _SELDOM and most <= _EVER, 0.0
    quietest = min(quietest, 1.0)
    taps = _DIFFERENCE / np.sqrt(ALIKE * variance)
    reach = float(np.nanmax(np.abs(last)))
    return Habit(
        taps=taps,
        quietest=quietest,
        straight=straight,
        reach=reach,
        before=last,
        is_steady=is_steady,
        is_counted=is_counted,
        is_fine=is_fine,
        longest=int(_lengths(rows).max(initial=0)),
    )


def is_straighter(readings: FloatArray, habit: Habit | None) -> bool:
    """Tell whether readings are dead straight more often than is usual: they are held, clipped or rounded."""
    if habit is not None and habit.is_counted:  # counts are, wherever it is calm, but not for long
        return len(habit.standing(readings)) > 0
    straight = float(straight_rows(readings).mean()) if len(readings) else 0.0
    return straight > _STRAIGHTER + (0.0 if habit is None else habit.straight)


def steps(readings: FloatArray) -> float:
    """Return the mean step from one reading to the next; NaN where there are none."""
    found = np.abs(np.diff(readings))
    found = found[np.isfinite(found)]
    return float(found.mean()) if len(found) else float("nan")


def _lengths(rows: BoolArray) -> NDArray[np.int64]:
    """Return how many rows in a row there are each time."""
    starts, ends = runs(rows)
    return ends - starts


def straight_rows(readings: FloatArray) -> BoolArray:
    """Tell which rows continue the two before them dead straight.

    >>> straight_rows(np.array([1.0, 2.0, 3.0, 3.0, 3.0, 2.5]))
    array([False, False,  True, False,  True, False])
    """
    found = np.zeros(len(readings), dtype=bool)
    if len(readings) > 2:
        size = float(np.nanmax(np.abs(readings), initial=0.0))
        found[2:] = np.abs(np.diff(readings, 2)) <= _STRAIGHT * size
    return found

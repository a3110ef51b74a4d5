"""A guard between alarms: what no gyro of this flight has read so far.

A monitor's test needs the attitude, which is late, and means over tens of milliseconds; a damper that a broken gyro
drives throws the aircraft in two tenths of a second. Two things are seen at once: a reading that jumps within a sample,
and one far beyond any before. How far both went on this flight until a second ago is learnt, and several times as far
is beyond it; so what grows within a second isn't taken for what is usual. A guard names nobody: a gyro that is beyond
is heard, for half a second, only as far as the attitude agrees.
"""

from __future__ import annotations

from gtmbench.detectors.accommodation.stand_in import COLUMNS, Readings
from gtmbench.values.channels import GYROS

_LEARNT_S = 10.0  # at least, before anything is beyond it
_BLOCK_S = 1.0  # what came within the last one or two isn't learnt yet
_JUMP_TIMES, _LEVEL_TIMES = 4.0, 2.5  # the greatest so far
_LEAST_JUMP_DEG_S, _LEAST_LEVEL_DEG_S = 5.0, 8.0  # where a flight has hardly moved so far
_COLUMNS = [(name, COLUMNS[name]) for name in GYROS]


class Guard:
    """The guard of one flight, sample by sample.

    >>> guard = Guard(sample_period_s=0.01)
    >>> calm = [0.5, -0.5, 0.2] + [0.0] * 10
    >>> any(guard.take(calm, is_learning=True) for _ in range(1100))
    False
    >>> guard.take([0.5, 100.0, 0.2] + [0.0] * 10, is_learning=True)
    {'q'}
    """

    def __init__(self, sample_period_s: float) -> None:
        self._learning, self._block = round(_LEARNT_S / sample_period_s), round(_BLOCK_S / sample_period_s)
        self._last = dict.fromkeys(GYROS, 0.0)
        self._learnt, self._before, self._now = (_Most() for _ in range(3))
        self._in_block = 0

    def take(self, readings: Readings, *, is_learning: bool) -> set[str]:
        """Take the next sample, and return the gyros beyond what they did; learn of it where nothing is distrusted."""
        beyond: set[str] = set()
        for name, column in _COLUMNS:
            reading = readings[column]
            if reading != reading:  # missing
                continue
            level, jump = abs(reading), abs(reading - self._last[name])
            self._last[name] = reading
            if self._learning <= 0 and (
                jump > max(_LEAST_JUMP_DEG_S, _JUMP_TIMES * self._learnt.jumps[name])
                or level > max(_LEAST_LEVEL_DEG_S, _LEVEL_TIMES * self._learnt.levels[name])
            ):
                beyond.add(name)
            self._now.take(name, jump, level)
        if beyond or not is_learning:
            self._before, self._now, self._in_block = _Most(), _Most(), 0
            return beyond
        self._in_block += 1
        if self._in_block == self._block:
            self._learning -= self._block
            for name in GYROS:
                self._learnt.take(name, self._before.jumps[name], self._before.levels[name])
            self._before, self._now, self._in_block = self._now, _Most(), 0
        return beyond


class _Most:
    """The greatest jump and level of every gyro."""

    def __init__(self) -> None:
        self.jumps, self.levels = dict.fromkeys(GYROS, 0.0), dict.fromkeys(GYROS, 0.0)

    def take(self, name: str, jump: float, level: float) -> None:
        """Take a jump and a level of a gyro."""
        if jump > self.jumps[name]:
            self.jumps[name] = jump
        if level > self.levels[name]:
            self.levels[name] = level

"""Whether a residual can raise an alarm: by the arming rule of `method.alarms`, row by row; see `monitor.alarms`."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.monitor.scores import IntArray, ScoreTrack
from gtmbench.values.record import FloatArray


@dataclass(kw_only=True)
class Arming:
    """Whether a residual can raise an alarm."""

    output: str
    # whose residual its alarms are put down to: its own, or, of an early one, that of the sensor it is about
    source: str
    track: ScoreTrack
    # whether it has been known at or below 1 since watching it began, or what was before is known to be healthy
    came_down: bool = False
    low: bool = False  # whether it was when last known, or since it was disarmed: a rise is news
    disarmed_row: int | None = None  # since when it is disarmed
    # from which row on an alarm was possible, or wasn't; kept where somebody will ask
    changes: list[tuple[int, bool]] | None = None

    @property
    def armed(self) -> bool:
        """Whether its next row could raise an alarm."""
        return self.came_down and self.disarmed_row is None

    def take(self, score: float, row: int) -> bool:
        """Take the score that is known with a row; return whether it is an alarm. A missing one is passed over."""
        if score <= 1.0:
            self.low = True
            if not self.came_down:
                self.came_down = True
                self._note(row)
        elif score > 1.0 and self.disarmed_row is None:
            rose, self.low = self.low, False
            return rose
        return False

    def news(self, scores: FloatArray) -> IntArray:
        """Return at which of the next scores one is above 1 that wasn't when last known, or the other way round.

        Those between change nothing, but for what a judgement makes of them.
        """
        if self.low and not (scores > 1.0).any():  # so it is nearly always
            return np.zeros(0, dtype=int)
        known = np.flatnonzero(~np.isnan(scores))
        high = scores[known] > 1.0
        return known[np.diff(high, prepend=not self.low)]

    def disarm(self, row: int, since: int) -> None:
        """Raise no alarm with a row and after; what disarms it came `since`."""
        if self.disarmed_row is None:
            self.disarmed_row = since
            self._note(row)

    def rearm(self, row: int) -> None:
        """Alarms are possible again with a row."""
        if self.disarmed_row is not None:
            self.disarmed_row = None
            self._note(row)

    def begin_anew(self, row: int) -> None:
        """Forget that it came down."""
        self.came_down = self.low = False
        self._note(row)

    def _note(self, row: int) -> None:
        if self.changes is not None:
            self.changes.append((row, self.armed))

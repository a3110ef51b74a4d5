"""When a GPS loses its fix at once: a receiver that restarts, or is cut off, and not one whose sky is hidden.

A sky that is hidden takes satellite after satellite. A receiver that still sends, and from one message to the next has
none of its five satellites or more, has lost its power, its antenna, or its link.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from gtmbench.values.record import BoolArray, FloatArray, runs

_ENOUGH = 5  # satellites: fewer may be hidden between two messages


class LostFix(NamedTuple):
    """A fix that was lost at once: since the last message with one, until the next with one, or the last message."""

    start_s: float
    end_s: float
    satellites: int


def lost_fixes(time_s: FloatArray, has_fix: BoolArray, satellites: FloatArray) -> tuple[LostFix, ...]:
    """Return when a GPS lost all of its satellites between two messages.

    >>> time_s = np.arange(8.0)
    >>> at_once = np.array([9, 9, 9, 0, 0, 0, 9, 9])
    >>> lost_fixes(time_s, at_once > 4, at_once)
    (LostFix(start_s=2.0, end_s=6.0, satellites=9),)
    >>> one_by_one = np.array([9, 7, 5, 3, 2, 0, 0, 0])
    >>> lost_fixes(time_s, one_by_one > 4, one_by_one)
    ()
    """
    known = np.isfinite(time_s)
    time_s, has_fix, satellites = time_s[known], has_fix[known], satellites[known]
    starts, stops = runs(np.asarray(~has_fix))
    return tuple(
        LostFix(float(time_s[start - 1]), float(time_s[min(stop, len(time_s) - 1)]), int(satellites[start - 1]))
        for start, stop in zip(starts.tolist(), stops.tolist(), strict=True)
        if start > 0 and satellites[start - 1] >= _ENOUGH and satellites[start] == 0
    )

"""Crashes: hard contacts with the ground, and failures that an autopilot tells of, after which nothing flies on.

The ground pushes in a way that no monitor has learnt, so residuals rise, and say nothing of a sensor. Where the
aircraft didn't fly on, nothing after a crash tells of a sensor.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import FAILURE, IMPACT, TOUCHDOWN
from gtmbench.detectors.protocol import Watch
from gtmbench.study.log.records import LIVELY_DEG_S, turning_by_second
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray

CONTACTS = (TOUCHDOWN, IMPACT)  # reasons
_FLIES_ON_S = 10  # seconds in which it turns, watched and without an alarm


def crash_of(watches: Sequence[Watch], excursions: Sequence[Excursion]) -> Excursion | None:
    """Return the first hard contact, or failure, after which the aircraft doesn't fly on; None where it always does."""
    return min(_crashes(watches, excursions), key=lambda each: each.start_s, default=None)


def _crashes(watches: Sequence[Watch], excursions: Sequence[Excursion]) -> list[Excursion]:
    """Return the hard contacts, and the failures that an autopilot tells of, after which the aircraft doesn't fly."""
    hard = [each for each in excursions if each.reason == FAILURE or (each.is_hard and each.reason in CONTACTS)]
    flown_s = _flown_s(watches) if hard else np.zeros(0)
    return [each for each in hard if np.count_nonzero(flown_s >= each.end_s) < _FLIES_ON_S]


def _flown_s(watches: Sequence[Watch]) -> FloatArray:
    """Return the seconds of watches in which the aircraft turned, and an alarm was possible."""
    times_s = [np.zeros(0)]
    for watch in watches:
        if {*GYROS, *ATTITUDE} <= set(watch.record.channels):
            seconds_s, turning = turning_by_second([watch.record])
            rows = np.searchsorted(watch.record.time_s, seconds_s)
            times_s.append(seconds_s[(turning > LIVELY_DEG_S) & watch.armed[rows]])
    return np.concatenate(times_s)

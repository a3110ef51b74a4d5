"""A pitot tube that is blocked: its pressure stays, and the airspeed follows the altitude, v^2 - 2 g h = const.

In flight that sum changes by thrust, drag and every gust; it stands still where the tube does.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.values.channels import G_M_S2
from gtmbench.values.record import Span, runs

BLOCKED = "its tube is blocked: it follows the altitude"
_WINDOW_S, LEAST_S = 10.0, 20.0  # over which it is told that something stands, and for how long at least
_OF_USUAL = 0.1  # of how much the sum changes elsewhere
_OF_HEIGHT = 0.5  # of how much it would by the altitude alone
_USUAL = 0.75  # of a flight's windows: half of it may be broken
_CLIMBS_M = 0.25  # a deviation of the altitude that is more than its noise
_MOST = 0.7  # of the flight: what never moved tells nothing


def blocked(course: Course) -> tuple[Span, float] | None:
    """Return where an airspeed follows the altitude, and what it read when that began; None for nowhere."""
    if not course.has("tas", "altitude"):
        return None
    flight, width = course.flight, round(_WINDOW_S / course.flight.blocks.period_s)
    # a blocked tube keeps its total pressure: what is read is v^2 = 2 g h + constant, whatever the aircraft does
    speed, height = course.read["tas"], 2.0 * G_M_S2 * course.read["altitude"]
    there = flight.flown & np.isfinite(speed) & np.isfinite(height)
    if np.count_nonzero(there) < 3 * width:
        return None
    rows = np.flatnonzero(there)
    energy, climbed = (
        np.lib.stride_tricks.sliding_window_view(each[rows], width).std(axis=1) for each in (speed**2 - height, height)
    )
    # so v^2 - 2 g h stands still while h climbs: stiller than it usually is, and than h by far
    stands = (energy < _OF_USUAL * np.quantile(energy, _USUAL)) & (energy < _OF_HEIGHT * climbed)
    stands &= climbed > 2.0 * G_M_S2 * _CLIMBS_M
    starts, ends = runs(stands)
    if not len(starts) or stands.mean() > _MOST:
        return None
    longest = int(np.argmax(ends - starts))
    first, last = rows[starts[longest]], rows[min(ends[longest] - 1 + width, len(rows) - 1)]
    span = float(flight.blocks.time_s[first]), float(flight.blocks.time_s[last])
    return (span, float(speed[first]) * abs(course.unit_of("tas"))) if span[1] - span[0] >= LEAST_S else None

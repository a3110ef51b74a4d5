"""Round values on an axis: of numbers, and of times, which are hours, minutes and seconds beyond an hour."""

from __future__ import annotations

import math

from gtmbench.report.words.times import HOUR_S, clock_text
from gtmbench.values.record import Span

_TICKS = 3  # at least, on an axis
_STEPS_S = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400)  # as clocks have


def round_values(span: Span, step: float = 0.0) -> list[float]:
    """Return round values within a span, three to eight of them, or those a step apart.

    >>> round_values((0.0, 60.0)), round_values((-0.31, 0.28))
    ([0.0, 20.0, 40.0, 60.0], [-0.3, -0.2, -0.1, 0.0, 0.1, 0.2])
    """
    if not step:
        apart = (span[1] - span[0]) / _TICKS
        unit = 10.0 ** math.floor(math.log10(apart))
        step = max(each * unit for each in (1.0, 2.0, 5.0) if each * unit <= apart)
    first, last = math.ceil(span[0] / step - 1e-9), math.floor(span[1] / step + 1e-9)
    return [float(f"{count * step:.10g}") for count in range(first, last + 1)]


def round_times(span: Span) -> list[tuple[float, str]]:
    """Return round times within a span, and how each is called.

    >>> round_times((0.0, 60.0))
    [(0.0, '0'), (20.0, '20'), (40.0, '40'), (60.0, '60')]
    >>> round_times((600.0, 7300.0))
    [(1800.0, '0:30:00'), (3600.0, '1:00:00'), (5400.0, '1:30:00'), (7200.0, '2:00:00')]
    """
    if not is_long(span):
        return [(time_s, f"{time_s:g}") for time_s in round_values(span)]
    step_s = max((each for each in _STEPS_S if each <= (span[1] - span[0]) / _TICKS), default=0)
    digits = 0 if step_s else 1
    return [(time_s, clock_text(time_s, digits, hours=True)) for time_s in round_values(span, step_s)]


def is_long(span: Span) -> bool:
    """Tell whether a span ends beyond an hour, so that its times are written in hours."""
    return span[1] >= HOUR_S


def time_title(span: Span) -> str:
    """Say in what an axis of time is."""
    return f"time ({'h:mm:ss' if is_long(span) else 's'})"

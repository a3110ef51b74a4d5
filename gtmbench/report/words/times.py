"""Times of a log as one reads them: seconds on its clock, beside them hours, and UTC where the log tells it."""

from __future__ import annotations

import numpy as np

from gtmbench.intake.flight_log import FlightLog
from gtmbench.verdict.verdict import LogVerdict

_HOUR_S = 3600.0
_MOST = 3  # failures whose date is told


def clock_text(time_s: float, digits: int = 1) -> str:
    """Write a time in short: seconds, or hours, minutes and seconds from an hour on.

    >>> clock_text(60.04), clock_text(5025.26), clock_text(-2.0), clock_text(3599.96)
    ('60.0 s', '1:23:45.3', '-2.0 s', '1:00:00.0')
    """
    seconds = round(time_s, digits)
    if abs(seconds) < _HOUR_S:
        return f"{seconds:.{digits}f} s"
    minutes, rest = divmod(abs(seconds), 60.0)
    return f"{'-' * (seconds < 0)}{minutes // 60:.0f}:{minutes % 60:02.0f}:{rest:0{digits + 3}.{digits}f}"


def time_text(time_s: float, digits: int = 1) -> str:
    """Write a time in seconds, as it is typed, and from an hour on in hours, too.

    >>> time_text(60.04), time_text(5025.26)
    ('60.0 s', '5025.3 s (1:23:45)')
    """
    long = f" ({clock_text(time_s, digits).partition('.')[0]})" if abs(round(time_s, digits)) >= _HOUR_S else ""
    return f"{time_s:.{digits}f} s{long}"


def utc_text(log: FlightLog, time_s: float) -> str:
    """Write a time of a log as a date; "" where the log doesn't tell it."""
    zero = log.zero_utc
    return "" if zero is None else f"{zero + np.timedelta64(round(1e3 * time_s), 'ms')}".replace("T", " ")[:-2] + " UTC"


def dated_text(log: FlightLog, verdict: LogVerdict) -> list[str]:
    """Say when it was, where the log tells dates: of each failure when it began, else of the log's beginning."""
    if log.zero_utc is None:
        return []
    begins = dict.fromkeys(span.start_s for _, span in verdict.failed[:_MOST]) or [log.span_s[0]]
    return [f"{', '.join(f'{time_text(time_s)} is {utc_text(log, time_s)}' for time_s in begins)}."]

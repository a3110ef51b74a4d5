"""Times of a log as one reads them: seconds on its clock, beside them hours, and its own stamps or UTC."""

from __future__ import annotations

import re

import numpy as np

from gtmbench.intake.flight_log import FlightLog
from gtmbench.verdict.verdict import LogVerdict

HOUR_S = 3600.0
_DAY = re.compile(r"^\S+ (?=\d)")
_MOST = 3  # failures whose stamps are told
_LATE_S = 10.0  # of a first sample: sooner it is nearly 0 s


def clock_text(time_s: float, digits: int = 1, *, hours: bool = False) -> str:
    """Write a time in short: seconds, or hours, minutes and seconds from an hour on, or wherever they are wanted.

    >>> clock_text(60.04), clock_text(5025.26), clock_text(-2.0), clock_text(3599.96)
    ('60.0 s', '1:23:45.3', '-2.0 s', '1:00:00.0')
    """
    seconds = round(time_s, digits)
    if abs(seconds) < HOUR_S and not hours:
        return f"{seconds:.{digits}f} s"
    minutes, rest = divmod(abs(seconds), 60.0)
    width = digits + 3 if digits else 2
    return f"{'-' * (seconds < 0)}{minutes // 60:.0f}:{minutes % 60:02.0f}:{rest:0{width}.{digits}f}"


def time_text(time_s: float, digits: int = 1) -> str:
    """Write a time in seconds, as it is typed, and from an hour on in hours, too.

    >>> time_text(60.04), time_text(5025.26)
    ('60.0 s', '5025.3 s (1:23:45)')
    """
    long = f" ({clock_text(time_s, digits).partition('.')[0]})" if abs(round(time_s, digits)) >= HOUR_S else ""
    return f"{time_s:.{digits}f} s{long}"


def stamp_text(zero_stamp: str, time_s: float, digits: int = 1) -> str:
    """Write a time as a log's own stamps do, by what they read at 0 s; "" where they are no dates or times of day.

    >>> stamp_text("2026-05-04 23:59:59.500 UTC", 1.0), stamp_text("23:59:59.500", 1.0), stamp_text("", 1.0)
    ('2026-05-05 00:00:00.5 UTC', '00:00:00.5', '')
    """
    zero, utc, _ = zero_stamp.partition(" UTC")
    if not zero:
        return ""
    day = "" if " " in zero else "1970-01-01 "
    stamp = f"{np.datetime64(day + zero) + np.timedelta64(round(1e3 * time_s), 'ms')}".replace("T", " ")
    return f"{stamp[11 * bool(day) : len(stamp) - 3 + digits]}{utc}"


def beside_text(zero_stamp: str, *times_s: float) -> str:
    """Write in brackets what stands beside seconds: the time of day that a log stamps, else hours beyond an hour.

    >>> beside_text("11:59:10.020", 3.0, 4000.0), beside_text("", 3.0, 4000.0), beside_text("", 3.0)
    (' (11:59:13.0 to 13:05:50.0)', ' (0:00:03 to 1:06:40)', '')
    """
    told = [_DAY.sub("", stamp_text(zero_stamp, time_s)) for time_s in times_s]
    if not zero_stamp:
        told = [clock_text(time_s, 0, hours=True) for time_s in times_s if max(times_s) >= HOUR_S]
    return f" ({' to '.join(told)})" if told else ""


def stamped_text(log: FlightLog, verdict: LogVerdict) -> list[str]:
    """Say when it was, by the log's stamps: of each failure when it began, else of the log's beginning.

    Stamps that count from when a logger was switched on are the times themselves: then how long after the first.
    """
    first_s = log.span_s[0]
    begins = dict.fromkeys(span.start_s for _, span in verdict.failed[:_MOST])
    if log.zero_stamp:
        is_ = "is" if log.zero_stamp.endswith("UTC") else "is stamped"
        told = [f"{time_text(time_s)} {is_} {stamp_text(log.zero_stamp, time_s)}" for time_s in begins or [first_s]]
    elif first_s >= _LATE_S:
        told = [f"{time_text(time_s)} is {time_text(time_s - first_s)} after the first sample" for time_s in begins]
    else:
        told = []
    return [f"{', '.join(told)}."] if told else []

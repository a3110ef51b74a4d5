"""Numbers and times with their units as one reads them, and round ones for an axis."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from gtmbench.intake.flight_log import FlightLog
    from gtmbench.values.record import Span
    from gtmbench.verdict.verdict import LogVerdict

_SURE = 0.995  # above, whole percents say 100, which nothing is


def capitalised(text: str) -> str:
    """Write a sentence's beginning with a capital; the rest stays as it is."""
    return text[:1].upper() + text[1:]


def per_second(unit: str) -> str:
    """Write a unit per second."""
    return "deg/s²" if unit == "deg/s" else f"{unit}/s" if unit else "per s"


def with_unit(what: str, unit: str) -> str:
    """Write a unit behind what it is of, where there is one."""
    return f"{what} ({unit})" if unit else what


def with_interval(value: float, interval: tuple[float, float] | None) -> str:
    """Write a value with the interval that holds it, to the first digit of its width; without one, to three digits.

    An interval about the value is written as ±, one that is lopsided by its ends, a bound as that.

    >>> with_interval(4.4786, (4.449, 4.508)), with_interval(-9.4325, None), with_interval(1.0, (1.0, math.inf))
    ('4.48 ± 0.03', '-9.43', 'at least 1')
    >>> with_interval(4.4786, (4.1, 4.5)), with_interval(0.01, (0.0, 0.01))
    ('4.5 (4.1 to 4.5)', 'at most 0.01')
    """
    low, high = (value, value) if interval is None else interval
    if math.isinf(high):
        return f"at least {low:.3g}"
    if low == 0.0 < high == value:
        return f"at most {high:.3g}"
    half = 0.5 * (high - low)
    if not (math.isfinite(half) and half > 1e-5 * abs(value)):
        return f"{value:.3g}"
    digits = min(max(-math.floor(math.log10(half * (1.0 + 1e-9))), 0), 9)
    # a value so near to an interval's middle is in the middle
    if abs(value - 0.5 * (low + high)) <= 0.2 * half:
        return f"{value:.{digits}f} ± {half:.{digits}f}"
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def percent_text(probability: float) -> str:
    """Write a probability as one reads it."""
    return "over 99 %" if probability > _SURE else f"{100.0 * probability:.2g} %"


def duration_text(hours: float) -> str:
    """Write a span of hours as one reads it."""
    return f"{hours:.2f} h" if hours >= 0.1 else f"{3600.0 * hours:.1f} s"


def or_dash(value: float | None, form: str) -> str:
    """Write a figure, or a dash where there is none."""
    return "-" if value is None else f"{value:{form}}"


def two_digits(value: float | None) -> str:
    """Write the two digits of a figure that count, or a dash where there is none."""
    return "-" if value is None else f"{float(f'{value:.2g}'):g}"


def counted(count: int, what: str, several: str = "") -> str:
    """Write how many there are."""
    return f"{count:,} {what if count == 1 else several or what + 's'}"


def first_few(told: Sequence[str], most: int) -> str:
    """Write a list; of a long one the first, and how many more there are."""
    more = f" and {len(told) - most} more" if len(told) > most else ""
    return f"{', '.join(told[:most])}{more}"


def padded(table: Sequence[Sequence[str]]) -> list[list[str]]:
    """Return the rows of a table, the cells of a column of one width."""
    widths = [max(map(len, column)) for column in zip(*table, strict=True)]
    return [[cell.ljust(width) for cell, width in zip(line, widths, strict=True)] for line in table]


HOUR_S = 3600.0  # by definition
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
    """Write a time in seconds, as it is typed, and from an hour on in hours, too."""
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
    import numpy as np

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
    """Say by the log's stamps, or since its first sample, when each failure began, else when the log did."""
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


_TICKS = 3  # at least, on an axis
_STEPS_S = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 10800, 21600, 43200, 86400)  # as clocks have


def round_values(span: Span, step: float = 0.0) -> list[float]:
    """Return round values within a span, three to eight of them, or those a step apart."""
    if not step:
        apart = (span[1] - span[0]) / _TICKS
        unit = 10.0 ** math.floor(math.log10(apart))
        step = max(each * unit for each in (1.0, 2.0, 5.0) if each * unit <= apart)
    first, last = math.ceil(span[0] / step - 1e-9), math.floor(span[1] / step + 1e-9)
    return [float(f"{count * step:.10g}") for count in range(first, last + 1)]


def round_times(span: Span) -> list[tuple[float, str]]:
    """Return round times within a span, and how each is called."""
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

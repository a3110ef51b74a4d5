"""Numbers with their units, as one reads them."""

from __future__ import annotations

import math

_SURE = 0.995  # above, whole percents say 100, which nothing is
_LOPSIDED = 0.2  # of an interval's half width: a value so near to its middle is in the middle


def capitalised(text: str) -> str:
    """Write a sentence's beginning with a capital; the rest stays as it is.

    >>> capitalised("no GPS"), capitalised("")
    ('No GPS', '')
    """
    return text[:1].upper() + text[1:]


def per_second(unit: str) -> str:
    """Write a unit per second.

    >>> per_second("deg/s"), per_second("g"), per_second("")
    ('deg/s²', 'g/s', 'per s')
    """
    return "deg/s²" if unit == "deg/s" else f"{unit}/s" if unit else "per s"


def with_unit(what: str, unit: str) -> str:
    """Write a unit behind what it is of, where there is one.

    >>> with_unit("p", "deg/s"), with_unit("strain_3", "")
    ('p (deg/s)', 'strain_3')
    """
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
    if abs(value - 0.5 * (low + high)) <= _LOPSIDED * half:
        return f"{value:.{digits}f} ± {half:.{digits}f}"
    return f"{value:.{digits}f} ({low:.{digits}f} to {high:.{digits}f})"


def percent_text(probability: float) -> str:
    """Write a probability as one reads it.

    >>> percent_text(0.873), percent_text(0.9987)
    ('87 %', 'over 99 %')
    """
    return "over 99 %" if probability > _SURE else f"{100.0 * probability:.2g} %"


def duration_text(hours: float) -> str:
    """Write a span of hours as one reads it.

    >>> duration_text(2.0), duration_text(0.21), duration_text(0.0083)
    ('2.00 h', '0.21 h', '29.9 s')
    """
    return f"{hours:.2f} h" if hours >= 0.1 else f"{3600.0 * hours:.1f} s"


def or_dash(value: float | None, form: str) -> str:
    """Write a figure, or a dash where there is none.

    >>> or_dash(0.125, ".2f"), or_dash(None, ".2f")
    ('0.12', '-')
    """
    return "-" if value is None else f"{value:{form}}"


def counted(count: int, what: str, several: str = "") -> str:
    """Write how many there are.

    >>> counted(1, "false alarm"), counted(0, "false alarm")
    ('1 false alarm', '0 false alarms')
    """
    return f"{count:,} {what if count == 1 else several or what + 's'}"

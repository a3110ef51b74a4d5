"""Numbers with their units, as one reads them."""

from __future__ import annotations

import math


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


def with_error(value: float, error: float) -> str:
    """Write a value to the first digit of its error; without an error, or with next to none, to three digits.

    >>> with_error(4.4786, 0.0297), with_error(123.4, 20.0), with_error(-9.4325, 2e-17)
    ('4.48 ± 0.03', '123 ± 20', '-9.43')
    """
    if not (math.isfinite(error) and error > 1e-6 * abs(value)):
        return f"{value:.3g}"
    digits = min(max(-math.floor(math.log10(error)), 0), 9)
    return f"{value:.{digits}f} ± {error:.{digits}f}"


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

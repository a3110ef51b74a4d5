"""Units as logs write them, and what they are in the channel table's."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass, replace

from gtmbench.values.channels import CHANNELS, G_M_S2, M_PER_FT

_DEG = math.degrees(1.0)  # a radian
_KT = 1852.0 / 3600.0  # m/s, by definition
_FT = M_PER_FT
_ALIKE = 0.1  # of factors that were measured
THROW = "throw"  # an autopilot's -1 to 1 of a surface: 45 deg, as ArduPilot counts, whatever the linkage makes of it


def _same(factor: float, spellings: str) -> dict[str, float]:
    return dict.fromkeys(spellings.split(), factor)


# dimension: the table's unit, two that a message may propose, and spelling: how many of the table's unit one is
_UNITS: dict[str, tuple[str, tuple[str, str], dict[str, float]]] = {
    "angular rate": (
        "deg/s",
        ("rad/s", "deg/s"),
        _same(1.0, "deg/s degs-1 dps")
        | _same(_DEG, "rad/s radps rads-1")
        | {"mrad/s": _DEG / 1e3, "ddeg/s": 0.1, "cdeg/s": 0.01}
        | _same(1e-3, "mdeg/s mdps"),
    ),
    "angle": (
        "deg",
        ("rad", "deg"),
        _same(1.0, "deg degheading")
        | {"rad": _DEG, "mrad": _DEG / 1e3, "ddeg": 0.1, "cdeg": 0.01, "mdeg": 1e-3, THROW: 45.0},
    ),
    "acceleration": (
        "g",
        ("m/s2", "g"),
        _same(1.0, "g gs gee g0")
        | {"mg": 1e-3}
        | _same(1 / G_M_S2, "m/s2 m/s/s ms-2 mps2 mss")
        | {"cm/s2": 0.01 / G_M_S2}
        | _same(_FT / G_M_S2, "ft/s2 ft/s/s fps2"),
    ),
    "speed": (
        "kt",
        ("m/s", "kt"),
        _same(1.0, "kt kts knot knots")
        | _same(1 / _KT, "m/s ms-1 mps")
        | _same(1 / 1.852, "km/h kmh kph kmph")
        | {"cm/s": 0.01 / _KT}
        | _same(_FT / _KT, "ft/s fps")
        | {"mph": 1.609344 / 1.852},
    ),
    "length": ("ft", ("m", "ft"), {"ft": 1.0, "m": 1 / _FT, "km": 1e3 / _FT, "cm": 0.01 / _FT, "mm": 1e-3 / _FT}),
    "share": ("%", ("%", "norm"), _same(1.0, "% percent pct") | {"norm": 100.0}),
    # how many are a second: a division is exact
    "time": ("s", ("s", "us"), {"s": 1.0, "ms": 1e3, "us": 1e6, "ns": 1e9, "d": 1 / 86400.0}),
}
_BY_SPELLING = {
    spelling: (dimension, factor) for dimension, (_, _, units) in _UNITS.items() for spelling, factor in units.items()
}
_DIMENSION_OF = {unit: dimension for dimension, (unit, _, _) in _UNITS.items()}
_WORDS = (
    (r"[°º]", "deg"),
    (r"[µμ]", "u"),
    ("²", "2"),
    (r"⁻¹", "-1"),
    (r"⁻", "-"),
    (r"[\s_]+per[\s_]+", "/"),
    (r"degrees|degree|degs\b", "deg"),
    (r"radians|radian|rads\b", "rad"),
    (r"milliseconds?|msecs?\b", "ms"),
    (r"microseconds?|usecs?\b", "us"),
    (r"nanoseconds?|nsecs?\b", "ns"),
    (r"seconds?|secs?\b", "s"),
    (r"^days?$", "d"),
    (r"metres?|meters?", "m"),
    (r"feet|foot", "ft"),
)

_COUNT = re.compile(r"(?=[\d.e-]*[1-9])(\d+\.?\d*|\.\d+)(e[-+]?\d+)?\s+(?=[^\d\s])")  # so many of a unit


@dataclass(frozen=True, kw_only=True)
class Unit:
    """A unit that is known: what it measures, and how many of the table's units (of time: a second) it is."""

    dimension: str
    factor: float


def unit(text: str) -> Unit | None:
    """Return what a unit means, None where it isn't known.

    >>> unit("rad_s").dimension, unit("m/s^2").dimension, unit("°/s").factor, unit("furlong")
    ('angular rate', 'acceleration', 1.0, None)
    >>> unit("0.061 deg/s").factor, unit("100 us").factor  # of raw counts
    (0.061, 10000.0)
    """
    plain = text.strip().lower()
    count = _COUNT.match(plain)
    if count:
        of = unit(plain[count.end() :])
        by = float(count[0])
        return of and replace(of, factor=of.factor / by if of.dimension == "time" else of.factor * by)
    for pattern, word in _WORDS:
        plain = re.sub(pattern, word, plain)
    plain = re.sub(r"\*\*|[\^*·()\[\]]", "", plain)
    for spelling in (re.sub(r"[\s_]+", "/", plain), re.sub(r"[\s_.]+", "", plain)):
        if spelling in _BY_SPELLING:
            dimension, factor = _BY_SPELLING[spelling]
            return Unit(dimension=dimension, factor=factor)
    return None


def dimension_of(channel: str) -> str:
    """Return what a channel of the table, or the time, measures."""
    return "time" if channel == "time" else _DIMENSION_OF[CHANNELS[channel].unit]


def alike_unit(text: str, factor: float) -> str | None:
    """Return the unit that values are in which read in another one are so many times too small; None for no usual one.

    >>> alike_unit("deg/s", 57.3), alike_unit("rad", 1 / 57.3), alike_unit("s", 1000.0), alike_unit("deg", 3.0)
    ('rad/s', 'deg', 'ms', None)
    """
    known = unit(text)
    if known is None:
        return None
    for spelling, of in _UNITS[known.dimension][2].items():
        if spelling != THROW and abs(of / (known.factor * factor) - 1.0) < _ALIKE:
            return spelling
    return None


def hint(channel: str) -> tuple[str, str]:
    """Return two units that a message may propose for a channel."""
    return _UNITS[dimension_of(channel)][1]

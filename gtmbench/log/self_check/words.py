"""Causes in words, and what to type: the mapping under which a log reads as it is."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence

from gtmbench.checks import listed
from gtmbench.intake.flight_log import Source
from gtmbench.intake.units import alike_unit
from gtmbench.log.self_check.causes import WiringChange, WiringGuess
from gtmbench.values.channels import ATTITUDE, GYROS


def cause_text(changes: Sequence[WiringChange]) -> str:
    """Say what would have to be undone.

    >>> cause_text([WiringChange(kind="sign", channels=("p",)), WiringChange(kind="late", channels=("psi",), size=0.5)])
    'the sign of p is turned and psi is 0.50 s late'
    """
    signs = [name for change in changes if change.kind == "sign" for name in change.channels]
    said = [f"the sign{'s' if len(signs) > 1 else ''} of {listed(signs)} {_are(signs)} turned"] if signs else []
    text = " and ".join([*said, *(_TEXTS[change.kind](change) for change in changes if change.kind != "sign")])
    return f"{text}, or so it seems: a common scale hardly changes how they fit" if is_common_scale(changes) else text


def is_common_scale(changes: Sequence[WiringChange]) -> bool:
    """Tell whether all gyros and all angles would have to be so many times larger: nearly the same motion.

    >>> is_common_scale([WiringChange(kind="unit", channels=(*GYROS, *ATTITUDE), size=57.3)])
    True
    """
    scaled = {name for change in changes if change.kind == "unit" for name in change.channels}
    sizes = {round(change.size, 6) for change in changes if change.kind == "unit"}
    return scaled == {*GYROS, *ATTITUDE} and len(sizes) == 1


def fits_text(fits: Mapping[str, float]) -> str:
    """Say how much of the gyros' motion is explained.

    >>> fits_text({"p": 0.963, "q": -0.98})
    'p 96 %, q 0 %'
    """
    return ", ".join(f"{name} {100.0 * max(share, 0.0):.0f} %" for name, share in fits.items())


def nothing_found_text() -> str:
    """Say that no cause was found, and what was tried."""
    return (
        "no cause was found that makes every gyro fit (tried: turned signs of gyros and angles, rad for deg and deg "
        "for rad, swapped gyros, phi and theta swapped, angles' rates for gyros, up to 1 s late (all, each by itself), "
        "held readings, a wrong time base)"
    )


def mapping_for(guess: WiringGuess, sources: Mapping[str, Source]) -> str:
    """Return the options under which a log reads as a guess says; "" where none would do.

    `sources`: which column each channel is read from, and how; ``time``, too, where a column tells it.
    """
    if any(change.kind in ("held", "euler") for change in guess.changes):
        return ""
    target = {name: name for name in (*GYROS, *ATTITUDE)}
    for change in guess.changes:
        if change.kind == "swap":
            target |= dict(zip(change.channels, (*change.channels[1:], change.channels[0]), strict=True))
    options = [_option(target.get(name, name), sources.get(name), guess.changes, name) for name in _touched(guess)]
    return "" if None in options else " ".join(option for option in options if option is not None)


def _touched(guess: WiringGuess) -> list[str]:
    return list(dict.fromkeys(name for change in guess.changes for name in change.channels))


def _option(channel: str, source: Source | None, changes: Sequence[WiringChange], read_as: str) -> str | None:
    """Return the option that maps the column of one channel; None where none can."""
    if source is None:
        return None
    own = [change for change in changes if read_as in change.channels]
    sign, factor, late_s = source.sign, 1.0, 0.0
    for change in own:
        if change.kind == "sign":
            sign = -sign
        elif change.kind in ("unit", "clock"):
            factor *= change.size
        elif change.kind == "late":
            late_s = change.size
    unit = alike_unit(source.unit, factor)
    if unit is None:
        return None
    late = f"@{late_s:.2f}" if late_s else ""
    turned = "-" if sign < 0 else ""
    return "--map " + shlex.quote(f"{channel}={turned}{source.column}:{unit}{late}")


def _unit_text(change: WiringChange) -> str:
    small, large = ("rad/s", "deg/s") if change.channels[0] in GYROS else ("rad", "deg")
    if change.size > 1.0:
        return f"{listed(change.channels)} {_are(change.channels)} 57 times too small: {small} taken for {large}"
    return f"{listed(change.channels)} {_are(change.channels)} 57 times too large: {large} taken for {small}"


def _swap_text(change: WiringChange) -> str:
    if len(change.channels) == 2:
        return f"{listed(change.channels)} are swapped"
    others = (*change.channels[1:], change.channels[0])
    places = ", ".join(f"{name} reads {other}" for name, other in zip(change.channels, others, strict=True))
    return f"gyros have changed places: {places}"


def _late_text(change: WiringChange) -> str:
    against = ""
    if len(change.channels) > 1:
        against = " against the gyros" if change.channels[0] in ATTITUDE else " against the attitude"
    return f"{listed(change.channels)} {_are(change.channels)} {change.size:.2f} s late{against}"


def _clock_text(change: WiringChange) -> str:
    factor = change.size if change.size > 1.0 else 1.0 / change.size
    way = "long" if change.size > 1.0 else "short"
    digits = max(0, 1 - math.floor(math.log10(factor)))
    return f"the time base is wrong: steps of the clock are {factor:.{digits}f} times too {way}"


def _held_text(change: WiringChange) -> str:
    return f"{listed(change.channels)} {_are(change.channels)} held: one fresh reading in {change.size:.2g} s"


def _euler_text(change: WiringChange) -> str:
    return (
        f"{listed(change.channels)} are the rates of {listed(ATTITUDE)}, made of the attitude, and no gyros of the body"
    )


_TEXTS = {
    "euler": _euler_text,
    "held": _held_text,
    "unit": _unit_text,
    "swap": _swap_text,
    "late": _late_text,
    "clock": _clock_text,
}


def _are(names: Sequence[str]) -> str:
    return "is" if len(names) == 1 else "are"

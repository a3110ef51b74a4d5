"""What ArduPilot drove its surfaces to: pulses of servo outputs (RCOU), by the functions and limits that PARM tells.

Without AETR, which holds the demands themselves, a surface is worked out of its servo, and aileron and elevator (or
rudder and elevator) out of the two that mix them. Signs are AETR's.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.formats.raw import Meaning, RawSeries
from gtmbench.intake.units import THROW

TOPIC = "RCOU"
_SURFACES = {4: "aileron", 19: "elevator", 21: "rudder"}  # SERVOn_FUNCTION
_THROTTLE = 70
# of two servos (a, b) = gain (e - x, e + x): their functions, and the channel that x is; e is the elevator
_MIXED = {(77, 78): "aileron", (80, 79): "rudder"}  # elevons left and right, V-tail right and left
_SERVOS = 16
_LEAST_US = 500.0  # less is no pulse
_GAIN = 0.5  # MIXING_GAIN where it isn't told
_LIMITS = {"MIN": 1100.0, "MAX": 1900.0, "TRIM": 1500.0, "REVERSED": 0.0}  # where they aren't told
Values = NDArray[np.float64]


def servo_series(settings: Mapping[str, float], outputs: Mapping[str, RawSeries]) -> list[RawSeries]:
    """Return the surfaces and the throttle that servos were driven to, each as a column.

    Parameters
    ----------
    settings : mapping
        Parameters of the autopilot by name.
    outputs : mapping
        Columns of the servos' pulses in us, as ``C1``.
    """
    servos = {
        int(settings.get(f"SERVO{number}_FUNCTION", 0)): number
        for number in range(_SERVOS, 0, -1)
        if f"C{number}" in outputs
    }
    throw = {number: partial(_throw, outputs[f"C{number}"], settings, number) for number in servos.values()}
    found = [
        _column(outputs, channel, throw[servos[function]], servos[function])
        for function, channel in _SURFACES.items()
        if function in servos
    ]
    for (first, second), channel in _MIXED.items():
        if first in servos and second in servos:
            pair = servos[first], servos[second]
            loads = throw[pair[0]], throw[pair[1]]
            found.append(_column(outputs, channel, partial(_difference, *loads, settings), *pair))
            found.append(_column(outputs, "elevator", partial(_sum, *loads, settings), *pair))
    if _THROTTLE in servos:
        number = servos[_THROTTLE]
        found.append(_column(outputs, "throttle", partial(_opened, outputs[f"C{number}"], settings, number), number))
    return found


def _column(
    outputs: Mapping[str, RawSeries], channel: str, load: Callable[[], NDArray[Any]], *numbers: int
) -> RawSeries:
    names = tuple(outputs[f"C{number}"].name for number in numbers)
    is_surface = channel != "throttle"
    meaning = Meaning(channel=channel, unit=THROW if is_surface else "norm", sign=-1.0 if is_surface else 1.0)
    name = f"{TOPIC}.{channel}" if len(names) > 1 else names[0]
    return RawSeries(name=name, load=load, clock=outputs[f"C{numbers[0]}"].clock, meaning=meaning, made_of=names)


def _limits(settings: Mapping[str, float], number: int) -> list[float]:
    return [settings.get(f"SERVO{number}_{name}", value) for name, value in _LIMITS.items()]


def _pulses(output: RawSeries) -> Values:
    pulses = output.values()
    return np.where(pulses >= _LEAST_US, pulses, np.nan)


def _throw(output: RawSeries, settings: Mapping[str, float], number: int) -> Values:
    """Return from -1 to 1 what a surface's servo was asked for, from its trim to its limits."""
    least, most, trim, is_reversed = _limits(settings, number)
    pulses = _pulses(output)
    span = np.where(pulses >= trim, max(most - trim, 1.0), max(trim - least, 1.0))
    return np.asarray((pulses - trim) / span * (-1.0 if is_reversed else 1.0))


def _opened(output: RawSeries, settings: Mapping[str, float], number: int) -> Values:
    """Return from 0 to 1 what the throttle's servo was asked for."""
    least, most, _, is_reversed = _limits(settings, number)
    share = (_pulses(output) - least) / max(most - least, 1.0)
    return np.asarray(1.0 - share if is_reversed else share)


def _difference(a: Callable[[], Values], b: Callable[[], Values], settings: Mapping[str, float]) -> Values:
    """Return x of two servos (a, b) = gain (e - x, e + x)."""
    return (b() - a()) / (2.0 * _gain(settings)) / (1.0 + 0.01 * max(settings.get("MIXING_OFFSET", 0.0), 0.0))


def _sum(a: Callable[[], Values], b: Callable[[], Values], settings: Mapping[str, float]) -> Values:
    """Return e of two servos (a, b) = gain (e - x, e + x)."""
    return (b() + a()) / (2.0 * _gain(settings)) / (1.0 - 0.01 * min(settings.get("MIXING_OFFSET", 0.0), 0.0))


def _gain(settings: Mapping[str, float]) -> float:
    return settings.get("MIXING_GAIN", _GAIN) or _GAIN

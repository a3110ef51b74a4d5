"""What MAVLink's messages read: which field is which channel, in which unit, by whose clock.

Integers have each autopilot's scale: of RAW_IMU only ArduPilot's is documented, so others' is left out.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gtmbench.intake.formats.dialects import MAVLINK
from gtmbench.intake.formats.raw import ANGLES, euler_deg
from gtmbench.intake.units import unit
from gtmbench.values.channels import ATTITUDE, GYROS

_QUATERNION = "ATTITUDE_QUATERNION"
_PER_SECOND = {"time_boot_ms": 1e3, "time_usec": 1e6}
_STAMPED = {
    "HIGHRES_IMU": "time_usec",
    "RAW_IMU": "time_usec",
    "SCALED_IMU": "time_boot_ms",
    "ATTITUDE": "time_boot_ms",
    _QUATERNION: "time_boot_ms",
    "GLOBAL_POSITION_INT": "time_boot_ms",
}
TOPICS = tuple(_STAMPED)
"""The messages that are read: those that tell when they were measured."""
MOTION = ("HIGHRES_IMU", "RAW_IMU", "SCALED_IMU", "ATTITUDE", _QUATERNION)
"""Those among them that only something sends that turns."""
_ARDUPILOT = 3  # MAV_AUTOPILOT

Get = Callable[[Any], float]


@dataclass(frozen=True, kw_only=True)
class LinkSample:
    """What one message, or one line, read at a time."""

    topic: str  # the message's name; "" of a line
    time_s: float  # by the sender's clock
    values: tuple[float, ...]  # in the units of the channel table; NaN where there is none


def _getters() -> dict[str, dict[str, Get]]:
    """Return what gets each channel of each message, in the channel's unit."""
    getters: dict[str, dict[str, Get]] = {topic: {} for topic in _STAMPED}
    for (topic, name), meaning in MAVLINK.items():
        known = unit(meaning.unit)
        if topic in getters and known is not None:
            getters[topic][meaning.channel] = partial(_field, name, meaning.sign * known.factor)
    getters[_QUATERNION] |= dict(zip(ATTITUDE, (partial(_turned, angle) for angle in ANGLES), strict=True))
    return getters


def _field(name: str, factor: float, message: Any) -> float:
    return factor * float(getattr(message, name))


def _turned(angle: str, message: Any) -> float:
    parts = [np.array([part]) for part in (message.q1, message.q2, message.q3, message.q4)]
    return float(euler_deg(parts, angle)[0])


_GETTERS = _getters()


def stamp_s(topic: str, message: Any) -> float:
    """Return when a message was measured, in seconds of its sender's clock."""
    field = _STAMPED[topic]
    return float(getattr(message, field)) / _PER_SECOND[field]


def channels_of(topic: str, autopilot: int | None) -> tuple[str, ...]:
    """Return the channels that a message tells, of an autopilot as its heartbeat names it.

    >>> channels_of("ATTITUDE", None), channels_of("RAW_IMU", 12)
    (('p', 'q', 'r', 'phi', 'theta', 'psi'), ())
    """
    return () if topic == "RAW_IMU" and autopilot != _ARDUPILOT else tuple(_GETTERS[topic])


def sample_of(topic: str, time_s: float, channels: Sequence[str], message: Any) -> LinkSample:
    """Return what a message of a time reads of some channels."""
    getters = _GETTERS[topic]
    values = tuple(getters[name](message) for name in channels)
    return LinkSample(topic=topic, time_s=time_s, values=values)


def chosen(rates_hz: dict[str, float], needs: Iterable[str], autopilot: int | None, least_hz: float) -> dict[str, str]:
    """Return the message that each needed channel is read from, of those that come; none for one that none tells.

    >>> chosen({"ATTITUDE": 100.0, "HIGHRES_IMU": 4.0}, ["p", "phi"], None, 45.0)
    {'p': 'ATTITUDE', 'phi': 'ATTITUDE'}
    """
    told = {topic: channels_of(topic, autopilot) for topic in _STAMPED if topic in rates_hz}
    by_channel = {}
    for name in needs:
        group = [each for each in needs if each in GYROS] if name in GYROS else [name]
        telling = [topic for topic, channels in told.items() if {*group} <= {*channels}]
        fast = [topic for topic in telling if rates_hz[topic] >= least_hz]
        best = fast or sorted(telling, key=lambda topic: -rates_hz[topic])
        if best:
            by_channel[name] = best[0]
    return by_channel


def is_finite(sample: LinkSample) -> bool:
    """Tell whether a sample's stamp is a time at all."""
    return math.isfinite(sample.time_s) and abs(sample.time_s) < 1e11

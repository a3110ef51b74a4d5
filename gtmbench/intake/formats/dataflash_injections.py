"""What ArduPilot's simulation was told to break of its gyros: changes of the SIM_GYR parameters and of its drift.

Their meaning is that of SITL.cpp and AP_InertialSensor_SITL.cpp; the first parameter of all is what a log begins with.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import replace
from math import degrees

from gtmbench.intake.formats.dataflash_events import MessageTable, rows_of
from gtmbench.intake.injections import GYRO, Injection, injected, spells
from gtmbench.values.channels import GYROS

TOLD_BY = ("PARM",)
_OF_AXIS = re.compile(r"SIM_GYR(\d?)_(BIAS|SCALE)_([XYZ])")
_NOISE = re.compile(r"SIM_GYR(\d?)_RND")
_STOPPED, _DRIFT = "SIM_GYR_FAIL_MSK", "SIM_DRIFT_SPEED"  # a bit a gyro; deg/s a minute, of all gyros and axes
_MOST_GYROS = 5
_PER_MINUTE = 1.0 / 60.0
Changes = list[tuple[float, float]]


def dataflash_injections(told: Mapping[str, MessageTable]) -> list[Injection]:
    """Return the faults that a simulation was told to put into its gyros."""
    settings: dict[str, Changes] = {}
    for time_s, name, value in rows_of(told, "PARM", "Name", "Value", texts=["Name"]):
        settings.setdefault(name.split(b"\0")[0].decode("latin-1"), []).append((time_s, float(value)))
    return [each for name, changes in settings.items() for each in _of(name, changes)]


def _of(name: str, changes: Changes) -> Iterator[Injection]:
    of_axis, noise = _OF_AXIS.fullmatch(name), _NOISE.fullmatch(name)
    if of_axis:
        channels = (GYROS["XYZ".index(of_axis[3])],)
        number = int(of_axis[1] or 1)
        for onset_s, end_s, value in spells(changes, 0.0):
            text = f"{name} = {value:g}"
            if of_axis[2] == "BIAS":
                yield _injection("bias", number, channels, (degrees(value), "deg/s"), (onset_s, end_s), text)
            else:
                yield _injection("scale factor", number, channels, (value / 100.0, ""), (onset_s, end_s), text)
    elif noise:
        for onset_s, end_s, value in spells(changes, 0.0):
            size = (value, "deg/s, times throttle")
            yield _injection("noise", int(noise[1] or 1), GYROS, size, (onset_s, end_s), f"{name} = {value:g}")
    elif name == _STOPPED:
        yield from _stopped(changes)
    elif name == _DRIFT:
        for onset_s, end_s, value in spells(changes, changes[0][1]):
            size = (value * _PER_MINUTE, "deg/s per s")
            yield _injection("drift", None, GYROS, size, (onset_s, end_s), f"{name} = {value:g}")


def _stopped(changes: Changes) -> Iterator[Injection]:
    """Give the gyros that are no longer read: their last reading stands."""
    for number in range(1, _MOST_GYROS + 1):
        bits = [
            (time_s, float(int(mask) >> (number - 1) & 1)) for time_s, mask in changes if abs(mask) < 2**_MOST_GYROS
        ]
        for span in spells(bits, 0.0):
            yield _injection("stuck", number, GYROS, (None, ""), span[:2], f"{_STOPPED} has bit {number - 1}")


def _injection(
    kind: str,
    number: int | None,
    channels: tuple[str, ...],
    size: tuple[float | None, str],
    span: tuple[float, float | None],
    text: str,
) -> Injection:
    return replace(injected(GYRO, number, kind, span, text), channels=channels, size=size[0], unit=size[1])

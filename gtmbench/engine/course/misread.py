"""Sensors whose readings are whole, and in another unit or frame than they are taken for: asked for, and never judged.

What one sensor tells of a motion is held against what another does: how a GPS and a force change the velocity, how an
altitude and a GPS climb, how air and ground go by. A sensor that tells so many times more, or turned axes, as another
unit or frame would make of it isn't broken.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.values.channels import ACCELEROMETERS, FT_S_PER_KT, G_M_S2, GPS_VELOCITY, M_PER_FT
from gtmbench.values.record import FloatArray

_KT = FT_S_PER_KT * M_PER_FT  # in m/s
# how many times too much is read, by what is read as what
_SPEED: Mapping[float, str] = {
    1.0 / _KT: "kt for m/s",
    1.0 / M_PER_FT: "ft/s for m/s",
    3.6: "km/h for m/s",
    _KT: "m/s for kt",
}
# by the factor that each mistake makes
_HEIGHT: Mapping[float, str] = {1.0 / M_PER_FT: "ft for m", M_PER_FT: "m for ft", -1.0: "depth for height"}
# which axis is read as north, east and down, and with which sign
_FRAMES = {"east, north and up": ((1, 1.0), (0, 1.0), (2, -1.0)), "north, east and up": ((0, 1.0), (1, 1.0), (2, -1.0))}
_ALIKE, _BETTER = 0.7, 1.0  # correlations of what changes; by how much their sum has to be larger
_NEAR = 0.12  # of a factor, in its logarithm: half as far as kt and km/h are apart
_FEWEST = 100  # blocks
_VARIES_M_S = 2.0  # of an airspeed, along turning axes
_WIND_M_S, _LESS = 12.0, 3.0  # the least that is hardly ever flown in; so many times less in another unit
_UPRIGHT = 0.5  # of gravity


def misread(course: Course) -> Iterator[tuple[str, str]]:
    """Give which sensors read another unit or frame than is thought, and which."""
    told = dict(_accelerometers(course))
    if course.has(*GPS_VELOCITY) and not told:
        told |= dict(_gps(course))
        if "gps" not in told:
            told |= {**dict(_altitude(course)), **dict(_airspeed(course))}
    yield from told.items()


def _accelerometers(course: Course) -> Iterator[tuple[str, str]]:
    if course.has(*ACCELEROMETERS):
        (rows,) = _there(course, course.columns(ACCELEROMETERS))
        if len(rows) < _FEWEST:
            return
        size, down = (float(np.median(each)) / G_M_S2 for each in (np.linalg.norm(rows, axis=1), -rows[:, 2]))
        if not _UPRIGHT < size < 1.0 / _UPRIGHT:
            yield "accelerometers", f"they read {size:.2g} g where gravity is one"
        elif down < -_UPRIGHT:
            yield "accelerometers", "nz reads -1 g where level flight reads 1"


def _gps(course: Course) -> Iterator[tuple[str, str]]:
    if not course.has(*ACCELEROMETERS):
        return
    told, felt = _there(course, course.rates(course.velocity), course.over_second(course.pulled))
    if len(told) < _FEWEST:
        return
    alike = np.corrcoef(told.T, felt.T)[:3, 3:]
    own = float(np.trace(alike))
    for frame, axes in _FRAMES.items():
        there = [sign * alike[axis, of] for of, (axis, sign) in enumerate(axes)]
        if min(there) > _ALIKE and sum(there) > own + _BETTER:
            yield "gps", f"its velocity reads {frame}, and is taken for north, east and down"
            return
    factor = _unit_of(_factor(told.ravel(), felt.ravel()), _SPEED)
    if factor:
        yield "gps", f"its velocity reads {factor}"


def _altitude(course: Course) -> Iterator[tuple[str, str]]:
    if course.has("altitude"):
        climb = course.rates(course.read["altitude"][:, np.newaxis])
        told, felt = _there(course, climb, -course.over_second(course.velocity[:, 2:]))
        factor = _unit_of(_factor(told.ravel(), felt.ravel()), _HEIGHT)
        if factor:
            yield "altitude", f"it reads {factor}"


def _airspeed(course: Course) -> Iterator[tuple[str, str]]:
    if not course.has("tas"):
        return
    told, flown = _there(course, course.through, course.velocity)
    if len(told) < _FEWEST:
        return
    apart = told - told.mean(axis=0)
    if np.sqrt(np.mean(np.square(apart).sum(axis=1))) > _VARIES_M_S:
        factor = _unit_of(_factor(apart.ravel(), (flown - flown.mean(axis=0)).ravel()), _SPEED)
    else:
        winds = {unit: _wind(told / by, flown) for by, unit in _SPEED.items()}
        likely = min(winds, key=lambda unit: winds[unit])
        wind = _wind(told, flown)
        factor = likely if wind > max(_WIND_M_S, _LESS * winds[likely]) else ""
    if factor:
        yield "tas", f"it reads {factor}"


def _wind(through: FloatArray, over: FloatArray) -> float:
    return float(np.linalg.norm(np.mean(over - through, axis=0)))


def _there(course: Course, *columns: FloatArray) -> list[FloatArray]:
    """Return the rows of columns in flight in which all are there."""
    rows = course.flight.flown & np.all([np.isfinite(each).all(axis=1) for each in columns], axis=0)
    return [each[rows] for each in columns]


def _factor(told: FloatArray, felt: FloatArray) -> float:
    """Return how many times more one tells than another: by both fits, for either is noisy; NaN where they differ."""
    if len(told) < _FEWEST or not (told.std() > 0.0 and felt.std() > 0.0):
        return float("nan")
    alike = float(np.corrcoef(told, felt)[0, 1])
    return float(np.sign(alike) * told.std() / felt.std()) if abs(alike) > _ALIKE else float("nan")


def _unit_of(factor: float, units: Mapping[float, str]) -> str:
    """Return by which of some units a factor is explained best; "" for none."""
    apart = {unit: abs(np.log(factor / by)) for by, unit in units.items() if by * factor > 0.0}
    return min((unit for unit in apart if apart[unit] < _NEAR), key=lambda unit: apart[unit], default="")

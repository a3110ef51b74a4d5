"""How noisy sensors are from reading to reading: y = the logarithm of their noise's power.

No aircraft moves so: a noise of 1 m/s in a GPS that reads five times a second would be forces of one g, to and fro. Nor
does the air: gusts are known by the airspeed and the vanes, where they grow for longer than from reading to reading.
What shakes the aircraft shakes more than one accelerometer, so each is held against the louder one of the other two.
What reads less than four times a second isn't told, for a turn then looks like noise. What is quieter than a fifth of
the least noise that is a failure counts as if it were as loud: twice as loud as next to nothing is nothing.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, Relation
from gtmbench.values.channels import ACCELEROMETERS, G_M_S2, GPS_VELOCITY, MAGNETOMETER
from gtmbench.values.record import FloatArray

NAME = "roughness"
# the least noise of each that is a failure, in m/s, m and a share of the field: motors' currents make up to 60 % of the
# field (ArduPilot's limit), and three deviations of twice this share are as much
LEAST = dict.fromkeys(GPS_VELOCITY, 1.0) | {"altitude": 5.0} | dict.fromkeys(MAGNETOMETER, 0.1)
# half of what our users ask for, in m/s, deg and m/s2
LEAST |= {"tas": 2.5, "alpha": 1.5, "beta": 1.5} | dict.fromkeys(ACCELEROMETERS, 0.1 * G_M_S2)
QUIET = 0.2  # of the least noise that is a failure: see the module's text
_SLOWEST_S = 0.25  # between readings: a turn of 90 deg/s moves a field's second difference by 14 % of it
_PRIOR, _FLOOR = np.array([10.0, 1.0]), np.array([0.2, 0.08])  # a level, a power of the liveliness
_WANDER = 0.3  # of logarithms: by a third
_LEAST = 0.1  # of noise


def rough_of(channel: str) -> str:
    """Return what the logarithm of a channel's noise is called in effects."""
    return f"roughness of {channel}"


def noise_channels(course: Course) -> tuple[str, ...]:
    """Return the channels whose noise is told; accelerometers only where all three are there."""
    told = [name for name in LEAST if name in course.noise and course.steps_s[name] <= _SLOWEST_S]
    return tuple(name for name in told if name not in ACCELEROMETERS or {*ACCELEROMETERS} <= {*told})


def relation(course: Course) -> Relation:
    """Return the relation of those of a course's sensors whose noise is told."""
    names = noise_channels(course)
    values = _beside_each_other(names, np.column_stack([_log_power(course, name) for name in names]))
    columns = np.column_stack([np.ones(len(values)), np.log(course.flight.lively)])

    def response(_: Flight, effect: Effect) -> FloatArray | None:
        told, none = effect.channels or {}, np.zeros(len(values))
        found = np.column_stack([told.get(rough_of(name), none) for name in names])
        return _beside_each_other(names, found) if found.any() else None

    return Relation(
        name=NAME,
        channels=names,
        said="noise of {}, as a logarithm",
        unit="",
        values=values,
        regressors=np.repeat(columns[:, np.newaxis, :], len(names), axis=1),
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER,
        least=_LEAST,
        asked=course.flight.flown,
        response=response,
    )


def _beside_each_other(names: Sequence[str], values: FloatArray) -> FloatArray:
    """Return accelerometers' noise less that of the louder one of the other two; the rest as it is."""
    shaken = [at for at, name in enumerate(names) if name in ACCELEROMETERS]
    found = values.copy()
    for at in shaken:
        found[:, at] -= values[:, [other for other in shaken if other != at]].max(axis=1)
    return found


def _log_power(course: Course, name: str) -> FloatArray:
    """Return the logarithm of one plus a noise's power beside that of a quiet one."""
    unit = course.strength if name in MAGNETOMETER else 1.0
    return np.asarray(np.log1p(course.noise[name] / (unit * QUIET * LEAST[name]) ** 2))

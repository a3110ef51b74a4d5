"""The GPS against the accelerometers: y = by how much its velocity changes over a second, less what the force makes.

Biases of accelerometers, turned by the attitude, and a constant of each axis are the constants. An attitude that is off
turns gravity: five degrees make 0.9 m/s2.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.between import FORCE_FLOOR, FORCE_PRIOR, FORCE_WANDER_M_S2, between
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY
from gtmbench.values.record import FloatArray

NEEDS = (*GPS_VELOCITY, *ACCELEROMETERS)
_LEAST_M_S2 = 0.05  # of noise


def relation(course: Course) -> Relation:
    """Return the relation of a course's GPS and accelerometers, an axis each of north, east and down."""
    biases = course.over_second(course.matrices)
    ones = np.ones((len(course.flight), 3, 1))
    return between(
        course,
        _values,
        name="gps and force",
        channels=("north", "east", "down"),
        regressors=np.concatenate([np.nan_to_num(biases), ones], axis=2),
        said="acceleration {} by the GPS, less by the accelerometers",
        unit="m/s2",
        prior=FORCE_PRIOR,
        floor=FORCE_FLOOR,
        wander=FORCE_WANDER_M_S2,
        least=_LEAST_M_S2,
    )


def _values(course: Course) -> FloatArray:
    return course.rates(course.velocity) - course.over_second(course.pulled)

"""The GPS against the altitude: y = by how much the altitude changes over a second, and the velocity down."""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.between import between
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import GPS_VELOCITY
from gtmbench.values.record import FloatArray

NAME = "gps and altitude"
NEEDS = (*GPS_VELOCITY, "altitude")
_PRIOR, _FLOOR, _WANDER_M_S = np.array([0.3]), np.array([0.05]), 0.2  # by pressure that follows the way of the air
_LEAST_M_S = 0.05  # of noise


def relation(course: Course) -> Relation:
    """Return the relation of a course's GPS and altitude."""
    return between(
        course,
        _values,
        name=NAME,
        channels=("up",),
        regressors=np.ones((len(course.flight), 1, 1)),
        said="how fast it goes {} by the altitude, less by the GPS",
        unit="m/s",
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER_M_S,
        least=_LEAST_M_S,
    )


def _values(course: Course) -> FloatArray:
    return course.rates(course.read["altitude"][:, np.newaxis]) + course.over_second(course.velocity[:, 2:])

"""The magnetometer against the attitude: y = what it reads along each axis, as a share of the field.

C turns the field into body axes, and iron makes anything linear of it: nine constants an axis, and an offset.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.between import between
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import MAGNETOMETER
from gtmbench.values.record import FloatArray

NEEDS = MAGNETOMETER
_PRIOR, _FLOOR = np.full(10, 1.0), np.full(10, 0.01)
_WANDER = 0.02  # by currents, and an attitude that leans
_LEAST = 0.005  # of noise


def relation(course: Course) -> Relation:
    """Return the relation of a course's magnetometer and attitude."""
    count = len(course.flight)
    columns = np.column_stack([course.matrices.reshape(count, 9), np.ones(count)])

    def values(of: Course) -> FloatArray:
        turned = of.matrices is not course.matrices
        return of.field / course.strength - (_turned(of, course) if turned else 0.0)

    return between(
        course,
        values,
        name="field",
        channels=("forward", "right", "down"),
        regressors=np.repeat(columns[:, np.newaxis, :], 3, axis=1),
        said="the field {}, as a share of it",
        unit="",
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER,
        least=_LEAST,
    )


def _turned(of: Course, course: Course) -> FloatArray:
    """Return by how much the field would read otherwise in body axes, were the attitude what it is in another course.

    An attitude that is off leaves the readings as they are, and what they are compared with turns.
    """
    north = np.einsum("nij,nj->ni", course.matrices, np.nan_to_num(course.field)) / course.strength
    return np.asarray(np.einsum("nji,nj->ni", of.matrices - course.matrices, north))

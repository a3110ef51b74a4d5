"""The magnetometer against the attitude: y = what it reads along each axis, as a share of the field.

C turns the field into body axes, and iron makes anything linear of it. Of each axis that is: the field north, east and
down, an offset, and a share of what the other two axes read of it, which is small. Those shares are taken of the field
as the attitude turns it, so that no axis' error stands in another's regressors.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.between import between
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import MAGNETOMETER
from gtmbench.values.record import FloatArray

NEEDS = MAGNETOMETER
# the field north, east and down, shares of two axes that iron bends and an offset, as shares of the field
_PRIOR, _FLOOR = np.array([1.0, 1.0, 1.0, 0.2, 0.2, 1.0]), np.array([0.01, 0.01, 0.01, 0.01, 0.01, 0.01])
_WANDER = 0.02  # by currents, and an attitude that leans
_LEAST = 0.005  # of noise


def relation(course: Course) -> Relation:
    """Return the relation of a course's magnetometer and attitude."""
    turned = _as_turned(course)
    one = np.ones(len(turned))
    columns = [
        np.column_stack([course.matrices[:, :, axis], np.delete(turned, axis, axis=1), one]) for axis in range(3)
    ]

    def values(of: Course) -> FloatArray:
        is_turned = of.matrices is not course.matrices
        return of.field / course.strength - (_turned(of, course) if is_turned else 0.0)

    return between(
        course,
        values,
        name="field",
        channels=("forward", "right", "down"),
        regressors=np.stack(columns, axis=1),
        said="the field {}, as a share of it",
        unit="",
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER,
        least=_LEAST,
    )


def _as_turned(course: Course) -> FloatArray:
    """Return the field in body axes as the attitude turns it, as a share of it: C'B, B by least squares beside offsets.

    An error that begins amid the log bends B a bit; it is no more than the direction that shares are taken of.
    """
    read, count = course.field / course.strength, len(course.flight)
    there = np.isfinite(read).all(axis=1) & np.isfinite(course.matrices).all(axis=(1, 2))
    if not there.any():
        return np.zeros((count, 3))
    design = np.concatenate([course.matrices.transpose(0, 2, 1), np.broadcast_to(np.eye(3), (count, 3, 3))], axis=2)
    whole, _, _, _ = np.linalg.lstsq(design[there].reshape(-1, 6), read[there].ravel(), rcond=None)
    return np.asarray(np.einsum("nji,j->ni", np.nan_to_num(course.matrices), whole[:3]))


def _turned(of: Course, course: Course) -> FloatArray:
    """Return by how much the field would read otherwise in body axes, were the attitude what it is in another course.

    An attitude that is off leaves the readings as they are, and what they are compared with turns.
    """
    north = np.einsum("nij,nj->ni", course.matrices, np.nan_to_num(course.field)) / course.strength
    return np.asarray(np.einsum("nji,nj->ni", of.matrices - course.matrices, north))

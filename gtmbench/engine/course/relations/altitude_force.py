"""The altitude against the accelerometers: y = by how much the climb changes in a second, less what the force makes."""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.between import FORCE_FLOOR, FORCE_PRIOR, FORCE_WANDER_M_S2, between
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import ACCELEROMETERS
from gtmbench.values.record import FloatArray

NEEDS = ("altitude", *ACCELEROMETERS)
_LEAST_M_S2 = 0.1  # of noise


def relation(course: Course) -> Relation:
    """Return the relation of a course's altitude and accelerometers."""
    biases = course.over_second(course.over_second(course.matrices[:, 2]))
    columns = np.column_stack([np.nan_to_num(biases), np.ones(len(biases))])
    return between(
        course,
        _values,
        name="altitude and force",
        channels=("down",),
        regressors=columns[:, np.newaxis, :],
        said="acceleration {} by the altitude, less by the accelerometers",
        unit="m/s2",
        prior=FORCE_PRIOR,
        floor=FORCE_FLOOR,
        wander=FORCE_WANDER_M_S2,
        least=_LEAST_M_S2,
    )


def _values(course: Course) -> FloatArray:
    fallen = course.rates(course.rates(-course.read["altitude"][:, np.newaxis]))
    return fallen - course.over_second(course.over_second(course.pulled[:, 2:]))

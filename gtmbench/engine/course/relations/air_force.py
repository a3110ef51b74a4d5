"""The air data against the accelerometers: y = by how much the velocity through the air changes, less what forces make.

It is told over a second, along, across and normal to the way. Gusts change the first alone, and turn the aircraft
besides: a share of each change is a constant, so that no gust is taken for a scale of the airspeed.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.between import FORCE_FLOOR, FORCE_PRIOR, between, rotated
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import ACCELEROMETERS
from gtmbench.values.record import FloatArray

NEEDS = ("tas", *ACCELEROMETERS)
_PRIOR, _FLOOR = np.append(FORCE_PRIOR, 0.5), np.append(FORCE_FLOOR, 0.2)  # and a share of the change
_WANDER_M_S2 = 0.5  # by gusts, and an attitude that leans
_LEAST_M_S2 = 0.2  # of noise


def relation(course: Course) -> Relation:
    """Return the relation of a course's air data and accelerometers."""
    biases = rotated(course.air_axes, np.nan_to_num(course.over_second(course.matrices)))
    ones = np.ones((len(course.flight), 3, 1))
    changes = np.nan_to_num(np.einsum("nai,ni->na", course.air_axes, course.rates(course.through)))
    return between(
        course,
        _values,
        name="air and force",
        channels=("along", "across", "normal to"),
        regressors=np.concatenate([biases, ones, changes[:, :, np.newaxis]], axis=2),
        said="acceleration {} the way by the air data, less by the accelerometers",
        unit="m/s2",
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER_M_S2,
        least=_LEAST_M_S2,
    )


def _values(course: Course) -> FloatArray:
    apart = course.rates(course.through) - course.over_second(course.pulled)
    return np.asarray(np.einsum("nai,ni->na", course.air_axes, apart))

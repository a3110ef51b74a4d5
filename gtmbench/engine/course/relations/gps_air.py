"""The GPS against the air data: y = its velocity less that through the air, along, across and normal to the way.

What is left is the wind: three constants. A scale of the airspeed is one more. Without a vane, across and normal tell
what the aircraft slips, and only its mean is known.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations.between import between
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import GPS_VELOCITY
from gtmbench.values.record import FloatArray

NEEDS = (*GPS_VELOCITY, "tas")
# the wind north, east and down, in m/s; a scale of the airspeed
_PRIOR, _FLOOR = np.array([15.0, 15.0, 1.0, 0.05]), np.array([0.7, 0.7, 0.2, 0.01])
_WANDER_M_S = 1.0  # by gusts that last
_LEAST_M_S = 0.3  # of noise


def relation(course: Course) -> Relation:
    """Return the relation of a course's GPS and air data."""
    scale = np.einsum("nai,ni->na", course.air_axes, course.through)
    return between(
        course,
        _values,
        name="gps and air",
        channels=("along", "across", "normal to"),
        regressors=np.concatenate([course.air_axes, scale[:, :, np.newaxis]], axis=2),
        said="velocity over ground less through the air, {} the way",
        unit="m/s",
        prior=_PRIOR,
        floor=_FLOOR,
        wander=_WANDER_M_S,
        least=_LEAST_M_S,
    )


def _values(course: Course) -> FloatArray:
    return np.asarray(np.einsum("nai,ni->na", course.air_axes, course.velocity - course.through))

"""What every relation of a course has: its answer to an error is what the error changes in it."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Effect, Relation
from gtmbench.values.record import FloatArray

_SHARE = 1e-3  # of an error of one, by which what it changes is worked out: few relations are curved
_KEPT = 100  # answers: one an explanation, and it is asked for by every channel in every round
_STILL = 1e-9  # a change that is rounding
# of forces: biases of three accelerometers, turned by the attitude, and a constant, in m/s2
FORCE_PRIOR, FORCE_FLOOR = np.array([0.5, 0.5, 0.5, 0.3]), np.array([0.05, 0.05, 0.05, 0.05])
FORCE_WANDER_M_S2 = 0.3  # by an attitude that leans


def between(course: Course, values: Callable[[Course], FloatArray], **about: Any) -> Relation:
    """Return a relation of a course.

    `values`: from a course to y, shape (blocks, channels). `about`: what else `Relation` has.
    """
    own = values(course)

    @lru_cache(maxsize=_KEPT)
    def response(_: Flight, effect: Effect) -> FloatArray | None:
        if effect.channels is None and effect.turned is None:
            return None
        changed = np.nan_to_num((values(course.off_by(effect, _SHARE)) - own) / _SHARE)
        return changed if np.abs(changed).max(initial=0.0) > _STILL else None

    return Relation(values=own, asked=course.flight.flown, response=response, **about)


def rotated(matrices: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns (blocks, 3, n) turned by matrices (blocks, 3, 3)."""
    return np.asarray(np.einsum("nij,njk->nik", matrices, columns))

"""What every relation of a course has: its answer to an error is what the error changes in it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import lru_cache

import numpy as np

from gtmbench.engine.course.course import Course
from gtmbench.engine.effect import Effect
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import Relation
from gtmbench.values.record import FloatArray

_SHARE = 1e-3  # of an error of one, by which what it changes is worked out: few relations are curved
_KEPT = 100  # answers: one an explanation, and it is asked for by every channel in every round
_STILL = 1e-9  # a change that is rounding


def between(
    course: Course,
    name: str,
    channels: Sequence[str],
    values: Callable[[Course], FloatArray],
    regressors: FloatArray,
    *,
    said: str,
    unit: str,
    prior: FloatArray,
    floor: FloatArray,
    wander: float,
    least: float,
) -> Relation:
    """Return a relation of a course.

    Parameters
    ----------
    course : Course
    name, channels, said, unit, prior, floor, wander, least
        As `Relation` has them.
    values : callable
        From a course to y, shape (blocks, channels).
    regressors : shape (blocks, channels, constants)
    """
    own = values(course)

    @lru_cache(maxsize=_KEPT)
    def response(_: Flight, effect: Effect) -> FloatArray | None:
        if effect.channels is None and effect.turned is None:
            return None
        changed = np.nan_to_num((values(course.off_by(effect, _SHARE)) - own) / _SHARE)
        return changed if np.abs(changed).max(initial=0.0) > _STILL else None

    return Relation(
        name=name,
        channels=tuple(channels),
        said=said,
        unit=unit,
        values=own,
        regressors=regressors,
        prior=prior,
        floor=floor,
        wander=wander,
        least=least,
        asked=course.flown,
        response=response,
        is_shared=True,
    )


def rotated(matrices: FloatArray, columns: FloatArray) -> FloatArray:
    """Return columns (blocks, 3, n) turned by matrices (blocks, 3, 3)."""
    return np.asarray(np.einsum("nij,njk->nik", matrices, columns))


def eyes(count: int) -> FloatArray:
    """Return unit matrices, shape (count, 3, 3)."""
    return np.tile(np.eye(3), (count, 1, 1))

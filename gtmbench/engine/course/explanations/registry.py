"""All explanations of a course that compete."""

from __future__ import annotations

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.explanations import healthy, noise, sensor
from gtmbench.engine.explanation import Explanation

KINDS = (sensor, noise, healthy)


def explanations_of(course: Course) -> tuple[Explanation, ...]:
    """Return the explanations of a course."""
    return tuple(each for kind in KINDS for each in kind.explanations(course))

"""The relations that a course's channels allow."""

from __future__ import annotations

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations import (
    air_force,
    altitude_force,
    field,
    gps_air,
    gps_altitude,
    gps_force,
)
from gtmbench.engine.relation import Relation

RELATIONS = (gps_force, gps_air, gps_altitude, air_force, altitude_force, field)


def relations_of(course: Course) -> tuple[Relation, ...]:
    """Return the relations of a course."""
    return tuple(each.relation(course) for each in RELATIONS if course.has(*each.NEEDS))

"""The relations that a course's channels allow."""

from __future__ import annotations

from collections.abc import Collection

from gtmbench.engine.course.course import Course
from gtmbench.engine.course.relations import (
    air_force,
    altitude_force,
    field,
    gps_air,
    gps_altitude,
    gps_force,
    roughness,
)
from gtmbench.engine.relation import Relation
from gtmbench.values.channels import names_of

RELATIONS = (gps_force, gps_air, gps_altitude, air_force, altitude_force, field)


_VANES = ("alpha", "beta")  # they turn the way of the air, where they are


def compared(channels: Collection[str]) -> list[tuple[str, ...]]:
    """Return which sensors enter each relation that some channels allow, those of several channels as one.

    >>> compared(["altitude", "gps_north", "gps_east", "gps_down", "alpha"])
    [('gps', 'altitude')]
    """
    held = [each.NEEDS for each in RELATIONS if {*each.NEEDS} <= {*channels}]
    beside = [(*needs, *(name for name in _VANES if name in channels and "tas" in needs)) for needs in held]
    return [tuple(dict.fromkeys(names_of(name)[-1] for name in each)) for each in beside]


def relations_of(course: Course) -> tuple[Relation, ...]:
    """Return the relations of a course."""
    found = tuple(each.relation(course) for each in RELATIONS if course.has(*each.NEEDS))
    return (*found, roughness.relation(course)) if roughness.noise_channels(course) else found

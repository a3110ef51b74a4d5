"""The relations that a flight's channels allow."""

from __future__ import annotations

from gtmbench.engine.flight import Flight
from gtmbench.engine.imus import between
from gtmbench.engine.imus import roughness as roughness_of_imus
from gtmbench.engine.relation import Relation
from gtmbench.engine.relations import attitude, gravity, rest, roughness

RELATIONS = (attitude.relation, gravity.relation, rest.relation, roughness.relation)


def relations_of(flight: Flight) -> tuple[Relation, ...]:
    """Return the relations of a flight.

    >>> import numpy as np
    >>> from gtmbench.engine.blocks import blocks_of
    >>> from gtmbench.values.record import Record
    >>> level = Record(np.zeros((100, 6)), channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.1)
    >>> [relation.name for relation in relations_of(Flight(blocks=blocks_of([level])))]
    ['attitude', 'roughness']
    """
    own = tuple(relation for make in RELATIONS if (relation := make(flight)) is not None)
    return (*own, *between.relations(flight), *roughness_of_imus.relations(flight))

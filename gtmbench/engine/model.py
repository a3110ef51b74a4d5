"""All equations of a flight, learnt from the whole log with what was found so far taken away."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np

from gtmbench.engine.constants import by_chunks
from gtmbench.engine.equation import Equation, learn
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.flight import Flight
from gtmbench.engine.relation import BETWEEN, Relation
from gtmbench.engine.sums import CELL, Products, SignatureSet, WindowSums, products_of, running
from gtmbench.values.channels import ATTITUDE
from gtmbench.values.record import BoolArray, FloatArray, IntArray

Key = tuple[str, int]  # a relation's name and its channel
_UNSURE = 0.2  # of what was found before: it may be so much larger or smaller


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """What a finding accounts for: its size and its signature of size one, by equation, shape (blocks,)."""

    size: float
    signatures: Mapping[Key, FloatArray] = field(repr=False)


class Edge(NamedTuple):
    """Blocks [first, last) in which no equation is asked of relations whose names begin so; -1: about any axis."""

    begins: str
    axis: int
    first: int
    last: int


@dataclass(frozen=True, kw_only=True, eq=False)
class Model:
    """The equations of a flight."""

    flight: Flight
    relations: tuple[Relation, ...] = field(repr=False)
    signatures: SignatureSet = field(repr=False)  # of all explanations that compete
    products: tuple[Products, ...] = field(repr=False)  # one an equation that is known
    explained: tuple[Explained, ...] = ()  # what was taken away

    @property
    def explanations(self) -> tuple[Explanation, ...]:
        """Those that compete."""
        return self.signatures.explanations

    @property
    def cells(self) -> int:
        """How many the log has."""
        return self.signatures.cells

    @property
    def cell_s(self) -> float:
        """How long a cell is."""
        return CELL * self.flight.blocks.period_s

    @property
    def without_signatures(self) -> Model:
        """The same once nothing more is searched: signatures are most of its memory."""
        return replace(self, products=tuple(each.without_signatures for each in self.products))

    @cached_property
    def sums(self) -> tuple[WindowSums, ...]:
        """Of each equation."""
        return tuple(map(WindowSums, self.products))

    @cached_property
    def is_witness(self) -> BoolArray:
        """Which equations have no say in a size, shape (equations,)."""
        return np.array([each.equation.relation.is_witness for each in self.products], dtype=bool)

    def own_axis(self, axis: int) -> WindowSums | None:
        """Return the sums of a gyro and its attitude; None where too little of them is known."""
        for sums in self.sums:
            equation = sums.products.equation
            if equation.relation.name == "attitude" and equation.channel == axis:
                return sums
        return None

    def of_explanations(self, name: str) -> FloatArray:
        """Return an attribute of all explanations, shape (explanations,)."""
        return np.array([float(getattr(each, name)) for each in self.explanations])

    @cached_property
    def _moved(self) -> FloatArray:
        """Running sums over cells of the attitude's rates, their squares and their number, shape (cells + 1, 3, 3)."""
        rates = self.flight.blocks.rates
        there = np.asarray(np.isfinite(rates).all(axis=1))
        rates = np.where(there[:, np.newaxis], rates, 0.0)
        each = np.stack([rates, rates**2, np.repeat(there[:, np.newaxis].astype(float), 3, axis=1)], axis=1)
        return running(by_chunks(each, CELL).sum(axis=1))

    def turns_deg_s(self, first: IntArray, last: IntArray) -> FloatArray:
        """Return the standard deviation of the attitude's rate about each axis, over cells, shape (windows, 3)."""
        sums, squares, counts = np.moveaxis(self._moved[last] - self._moved[first], 1, 0)
        counts = np.maximum(counts, 1.0)
        return np.asarray(np.sqrt(np.maximum(squares / counts - (sums / counts) ** 2, 0.0)))

    def known_share(self, first: IntArray, last: IntArray) -> FloatArray:
        """Return which share of cells is judged, shape (windows,)."""
        counts = self._moved[last, 2, 0] - self._moved[first, 2, 0]
        return np.asarray(counts / np.maximum((last - first) * CELL, 1))


def learnt(
    flight: Flight,
    relations: Sequence[Relation],
    signatures: SignatureSet,
    *,
    explained: Sequence[Explained] = (),
    frozen: Sequence[tuple[str, int, int]] = (),
    edges: Sequence[Edge] = (),
) -> Model:
    """Return the model of a flight.

    `explained`: what is taken away before anything is learnt. `frozen`: blocks in which a sensor stands still: no
    equation that it enters is asked there. `edges`: blocks in which some equations aren't asked.
    """
    equations = []
    for relation in relations:
        for channel in range(len(relation.channels)):
            key = (relation.name, channel)
            taken = [each.size * each.signatures[key] for each in explained if key in each.signatures]
            equation = learn(
                flight,
                relation,
                channel,
                explained=sum(taken[1:], taken[0]) if taken else None,
                left_out=_left_out(flight, relation, channel, frozen, edges),
            )
            if equation is not None:
                equations.append(equation)
    products = []
    answers = signatures.answers(equations)[::-1]
    for equation in equations:  # each lets go of what was worked out of its columns
        beside = _beside(explained, (equation.relation.name, equation.channel), flight)
        products.append(products_of(signatures, equation, answers.pop(), beside))
    return Model(
        flight=flight,
        relations=tuple(relations),
        signatures=signatures,
        products=tuple(products),
        explained=tuple(explained),
    )


def unsure(explained: Sequence[Explained], equation: Equation) -> FloatArray:
    """Return the standard deviations of how much larger or smaller what was found may be."""
    key = (equation.relation.name, equation.channel)
    return np.array([max(_UNSURE * abs(each.size), 1e-3) for each in explained if key in each.signatures])


def _beside(explained: Sequence[Explained], key: Key, flight: Flight) -> FloatArray:
    """Return the signatures of what was found, shape (blocks, findings that this equation feels)."""
    felt = [each.signatures[key] for each in explained if key in each.signatures]
    return np.column_stack(felt) if felt else np.zeros((len(flight), 0))


def _left_out(
    flight: Flight,
    relation: Relation,
    channel: int,
    frozen: Sequence[tuple[str, int, int]],
    edges: Sequence[Edge],
) -> BoolArray | None:
    if not frozen and not edges:
        return None
    found = np.zeros(len(flight), dtype=bool)
    for sensor, first, last in frozen:
        is_attitude = sensor in ATTITUDE and not relation.name.startswith(BETWEEN)
        if is_attitude or sensor == relation.channels[channel] or sensor in relation.enters:
            found[first:last] = True
    for edge in edges:
        if relation.name.startswith(edge.begins) and edge.axis in (-1, channel):
            found[edge.first : edge.last] = True
    return found

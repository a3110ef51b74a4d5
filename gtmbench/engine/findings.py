"""All findings of a flight: the strongest is explained, taken out, the rest learnt anew; then each is judged again."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gtmbench.engine.evidence import axes_of, axis_number
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.explanations.registry import explanations_of
from gtmbench.engine.finding import NOISE, Finding
from gtmbench.engine.flight import Flight
from gtmbench.engine.frozen import frozen_sensors
from gtmbench.engine.model import Edge, Explained, Key, Model, learnt
from gtmbench.engine.relation import BETWEEN, Relation
from gtmbench.engine.relations.registry import relations_of
from gtmbench.engine.search import BOUND, EXPECTED, MISFIT, Scan, WindowSearch
from gtmbench.engine.sides import side_of
from gtmbench.engine.sums import CELL, SignatureSet
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

_BESIDE = 2  # cells, as well as an onset is known
_MOST = 3  # findings that are searched for
_FIRST = 1.25  # times the bound, while nothing is known of what chance makes
_ROUNDS = 2  # what was dropped in one is what is left in the next


@dataclass(frozen=True, kw_only=True, eq=False)
class Findings:
    """What was found on a flight."""

    model: Model  # with everything that was found taken away
    found: tuple[Finding, ...]  # in order of time
    whole: Scan = field(repr=False)  # the model with nothing taken away, all its windows looked at once


class _Bench:
    """A flight's relations and signatures, from which models are learnt."""

    def __init__(self, flight: Flight, relations: Sequence[Relation], explanations: Sequence[Explanation]) -> None:
        self.flight = flight
        self.relations = tuple(relations)
        self.signatures = SignatureSet(flight, explanations)
        self._last: tuple[tuple[Finding, ...], Scan] = ((), self.whole)

    def without(self, found: Sequence[Finding]) -> Scan:
        """Return the model with some findings taken away, all its windows looked at once."""
        if not found:
            return self.whole
        if tuple(found) != self._last[0]:
            self._last = (tuple(found), Scan(model=self._model(found)))
        return self._last[1]

    @cached_property
    def whole(self) -> Scan:
        """The model with nothing taken away."""
        return Scan(model=self._model(()))

    def _model(self, found: Sequence[Finding]) -> Model:
        frozen = [(each.best.suspect, each.first * CELL, each.last * CELL) for each in found if each.is_frozen]
        return learnt(
            self.flight,
            self.relations,
            self.signatures,
            explained=[self._explained(each) for each in found if not each.is_frozen],
            frozen=frozen,
            edges=[edge for each in found for edge in _edges(each)],
        )

    def _explained(self, finding: Finding) -> Explained:
        """Return the signature of a finding in every equation, over its span."""
        place = self.signatures.place_of(finding.best)
        answers = {
            (relation.name, channel): self.signatures.over(
                relation, channel, constants, place, finding.first, finding.last
            )
            for relation in self.relations
            for channel in range(len(relation.channels))
            if (constants := self._constants.get((relation.name, channel))) is not None
        }
        return Explained(
            size=finding.size, signatures={key: answer for key, answer in answers.items() if answer is not None}
        )

    @cached_property
    def _constants(self) -> dict[Key, FloatArray]:
        """Constants of the whole log, nothing taken away."""
        equations = [each.equation for each in self.whole.model.products]
        return {(each.relation.name, each.channel): each.constants for each in equations}


def _edges(finding: Finding) -> list[Edge]:
    """Return blocks about the onset and the end of a finding, and in which equations they aren't asked.

    An onset is known to a second, in which the sensor is off by all of the finding's size: what that leaves is no
    chance, and a finding would fall by it. What bends other axes is dated by them.
    """
    if finding.is_healthy or finding.best.kind == NOISE:
        return []
    axis = axis_number(finding.best.suspect)
    where, only = (BETWEEN, -1) if finding.parts_imus else ("attitude", axis) if axis >= 0 else ("", -1)
    return [
        Edge(begins=where, axis=only, first=max(cell - _BESIDE, 0) * CELL, last=(cell + _BESIDE) * CELL)
        for cell in (finding.first, finding.last)
    ]


def findings_of(flight: Flight) -> Findings:
    """Return everything that explanations of gyros and attitude find on a flight."""
    return found_by(flight, relations_of(flight), explanations_of(flight), frozen_sensors(flight))


def found_by(
    flight: Flight,
    relations: Sequence[Relation],
    explanations: Sequence[Explanation],
    frozen: Sequence[Finding] = (),
) -> Findings:
    """Return everything that some explanations find in some relations of a flight.

    `frozen`: what is known before anything is searched.
    """
    bench = _Bench(flight, relations, explanations)
    one = np.ones(len(bench.signatures.explanations))
    found = list(frozen)
    for _ in range(_MOST):
        strongest = WindowSearch(scan=bench.without(found), tempers=one, found=tuple(found)).strongest(_FIRST * BOUND)
        if strongest is None:
            break
        found.append(strongest)
    tempers = one
    for _ in range(_ROUNDS):
        tempers = tempers_of(bench.without(found), found)
        kept = _each_again(bench, found, tempers)
        is_settled = len(kept) == len(found)
        found = kept
        if is_settled:
            break
    model = bench.without(found).model
    sided = [replace(each, side=side_of(model, each)) for each in found]
    in_time = sorted(sided, key=lambda each: each.onset_s)
    return Findings(model=model, found=tuple(in_time), whole=bench.whole)


def _each_again(bench: _Bench, found: Sequence[Finding], tempers: FloatArray) -> list[Finding]:
    """Return findings as they are with all others taken away, one after another.

    What no longer stands is put back at once, before the next is judged: two that explain one change would else both
    fall by each other.
    """
    kept = list(found)
    for finding in found:
        if finding.is_frozen:
            continue
        place = kept.index(finding)
        others = (*kept[:place], *kept[place + 1 :])
        again = WindowSearch(scan=bench.without(others), tempers=tempers, found=others).again(finding, BOUND)
        kept[place : place + 1] = [] if again is None else [again]
    return kept


def tempers_of(scan: Scan, found: Sequence[Finding] = ()) -> FloatArray:
    """Return the most that is left anywhere, over what chance makes of it; what a misfit of findings leaves aside.

    A logarithm of noise that rises tenfold, and is known to a twentieth, leaves as much again of itself.
    """
    seen, left = scan.seen, scan.left.copy()
    kinds = np.array([each.kind for each in scan.model.explanations])
    suspects = np.array([each.suspect for each in scan.model.explanations])
    for each in found:
        if not each.is_frozen:
            meets = (np.minimum(each.last, seen.last) > np.maximum(each.first, seen.onset))[:, np.newaxis]
            left -= 2.0 * MISFIT * each.evidence * meets
            if each.best.kind == NOISE and each.best.suspect not in GYROS:  # theirs is relative to each other's
                own = (kinds == NOISE) & (suspects == each.best.suspect)
                left = np.where(meets & own, -np.inf, left)
            if each.parts_imus:
                own = axes_of(scan.model) == axis_number(each.best.suspect)
                left = np.where(meets & own, -np.inf, left)
    return np.asarray(np.maximum(1.0, left.max(axis=0, initial=0.0) / EXPECTED))

"""What shows a finding: relations as they are, and as a finding predicts them."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.engine.equation import Equation
from gtmbench.engine.finding import Finding
from gtmbench.engine.model import Model
from gtmbench.engine.named import judgement_of
from gtmbench.values.record import FloatArray

_MOST = 3  # of a finding


@dataclass(frozen=True, kw_only=True, eq=False)
class ErrorCurve:
    """What a relation is off by beside its constants, and what a finding makes of it."""

    # sensor, kind: what the finding makes of it: which fault of whom
    sensor: str
    kind: str
    # said, unit: what the relation is off by, in words, and in which unit
    said: str
    unit: str
    # time_s, measured, predicted, shape (blocks,)
    time_s: FloatArray = field(repr=False)
    measured: FloatArray = field(repr=False)
    predicted: FloatArray = field(repr=False)


def curves_of(
    model: Model, found: Sequence[Finding], unit_of: Callable[[Finding], float] = lambda _: 1.0
) -> tuple[ErrorCurve, ...]:
    """Return what shows that somebody may have failed, an equation each; those that accuse come first.

    `model`: with the findings taken away. `unit_of`: from a finding to what an error of one in its relations is in the
    finding's unit.
    """
    faults = [each for each in found if not (each.best.is_healthy or each.is_frozen)]
    return tuple(
        curve
        for each in sorted(faults, key=lambda each: not each.accuses)
        for curve in _curves(model, each, each.size / unit_of(each))
    )


def _curves(model: Model, finding: Finding, size: float) -> Iterator[ErrorCurve]:
    equations = {(each.equation.relation.name, each.equation.channel): each.equation for each in model.products}
    for name, channel, _ in finding.shown_by[:_MOST]:
        equation = equations.get((name, channel))
        curve = None if equation is None else _curve(model, finding, equation, size)
        if curve is not None:
            yield curve


def _curve(model: Model, finding: Finding, equation: Equation, size: float) -> ErrorCurve | None:
    relation, channel, signatures = equation.relation, equation.channel, model.signatures
    place = signatures.place_of(finding.best)
    shape = signatures.over(relation, channel, equation.constants, place, finding.first, finding.last)
    if shape is None:
        return None
    there = np.isfinite(relation.values[:, channel])
    return ErrorCurve(
        sensor=finding.best.suspect,
        kind=judgement_of(finding, finding.end_s).kind or finding.best.kind,
        said=relation.title(channel),
        unit=relation.unit,
        time_s=model.flight.blocks.start_s + model.flight.time_s,
        measured=np.where(there, equation.left + size * shape, np.nan),
        predicted=size * shape,
    )

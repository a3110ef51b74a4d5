"""Which side of a change is the broken one, by what constants a healthy gyro has."""

from __future__ import annotations

import numpy as np

from gtmbench.engine.finding import DECISIVE, NOISE, Finding, Side
from gtmbench.engine.model import Model
from gtmbench.engine.sums import CELL
from gtmbench.values.channels import GYROS

_FAILS = 3.0  # nats: sensors fail in flight more often than they heal
_OFFSET_DEG_S, _GAIN = 0.3, 0.05  # of a healthy gyro: standard deviations
_USUAL_S = 10.0  # that tell a gyro's own noise; what is named lasts as long
_DEGREES = 3.0  # of Student's law


def side_of(model: Model, finding: Finding) -> Side:
    """Return which side of a finding is broken; after it, but of a bias or a scale whose other side is less usual."""
    best = finding.best
    if best.suspect in GYROS and best.kind == NOISE and _is_first(model, finding):
        return Side.OPEN  # noisy until then, or quiet from then on, as one that lags: nothing tells its usual noise
    if best.suspect not in GYROS or best.kind not in ("bias", "scale"):
        return Side.AFTER
    axis = GYROS.index(best.suspect)
    offsets = _constants(model, 0)
    own = _constants(model, 0 if best.kind == "bias" else 1 + axis).get(axis)
    if own is None:
        return Side.AFTER
    if best.kind == "bias":
        others = [value for other, value in offsets.items() if other != axis]
        variance = (_OFFSET_DEG_S**2 + sum(value**2 for value in others)) / (1.0 + len(others))
    else:
        variance = _GAIN**2
    odds = _log_odds(own, variance) - _log_odds(own + finding.size, variance) + _FAILS
    if odds > DECISIVE:
        return Side.AFTER
    return Side.BEFORE if odds < -DECISIVE else Side.OPEN


def _is_first(model: Model, finding: Finding) -> bool:
    """Tell whether a finding ends within a flight of which hardly anything is known before it."""
    blocks = model.flight.judged[: finding.first * CELL]
    before_s = float(np.count_nonzero(blocks)) * model.flight.blocks.period_s
    return before_s < _USUAL_S and (model.cells - finding.last) * model.cell_s > _USUAL_S


def constants_of_gyro(model: Model, axis: int) -> tuple[float, float, float, float] | None:
    """Return a gyro's offset and gain against the attitude over the whole log, and how far each may be off.

    The gain is k of y - w = k y; the errors are standard deviations. None where the attitude tells nothing of it.
    """
    sums = model.own_axis(axis)
    if sums is None:
        return None
    equation = sums.products.equation
    first, last = np.array([0], dtype=np.int64), np.array([sums.cells], dtype=np.int64)
    known = 1 + len(equation.constants)
    squares = sums.known(first, last)[0, 1:known, 1:known]
    spread = np.linalg.inv(squares + np.diag(equation.relation.prior**-2.0))
    offset, gain = equation.constants[0], equation.constants[1 + axis]
    return float(offset), float(gain), float(spread[0, 0] ** 0.5), float(spread[1 + axis, 1 + axis] ** 0.5)


def _constants(model: Model, place: int) -> dict[int, float]:
    """Return a constant of gyros and attitude, by axis."""
    equations = [each.equation for each in model.products]
    return {each.channel: float(each.constants[place]) for each in equations if each.relation.name == "attitude"}


def _log_odds(value: float, variance: float) -> float:
    """Return the log of Student's law, up to a constant."""
    return float(-0.5 * (_DEGREES + 1.0) * np.log1p(value**2 / (_DEGREES * variance)))

"""Searches: kinds of faults with one parameter that isn't linear, tried on the fault's own class."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np

from gtmbench.detectors.isolation.fitter import Fit, Fitter, Parameters
from gtmbench.detectors.isolation.parabola import spaced, vertex
from gtmbench.faults.fault import Fault
from gtmbench.faults.shape import Shape
from gtmbench.values.record import FloatArray

_GRID = 12
_TURNS = 5
_FINER = 4
_BETWEEN = np.arange(1, _FINER + 1) / (_FINER + 1)
_AT_LIMIT = 1.0 - 1e-6
_SHOWN = 1e-6  # of a parameter that readings show, its error
_BELOW, _ABOVE = 0.7, 1.4  # times the usual step of readings that run straight: their slew rate
_NOTHING = 1e-12
_SETTLED = 0.5  # of -2 log likelihood, between neighbours: no finer search is worth it


@dataclass(frozen=True, kw_only=True)
class Search:
    """A kind with one parameter, searched between two values; not where the readings show it (0 where they don't)."""

    cls: type[Fault]
    shape: Shape
    low: float
    high: float
    shown: float = 0.0

    @classmethod
    def of(cls, fitter: Fitter, fault: type[Fault], shape: Shape) -> Search:
        """Return the search of a kind for a suspect."""
        virtual = fitter.virtual[fitter.suspect.sure :]
        step = fitter.straight_step / fitter.period_s
        shown = fitter.limit if shape.read == "limit" else step if shape.read == "step" else 0.0
        if shape.read == "step" and step:
            return cls(cls=fault, shape=shape, low=_BELOW * step, high=_ABOVE * step, shown=shown)
        times = 1.0
        if shape.of == "reach":
            times = float(np.max(np.abs(virtual), initial=0.0))
        elif shape.of == "slew":
            times = 2.0 * float(np.max(np.abs(np.diff(virtual)), initial=0.0)) / fitter.period_s
        return cls(cls=fault, shape=shape, low=shape.low * times, high=shape.high * times, shown=shown)

    def fits(self, fitter: Fitter) -> Iterator[Fit]:
        """Give the best fit: of values evenly spaced in their logarithm, then of the best neighbourhood."""
        if not 0.0 < self.low < self.high:
            return
        suspect, name = fitter.suspect, self.shape.parameter

        def tried(values: FloatArray) -> FloatArray:
            changes = np.array([self._changes(fitter, value)[0] for value in values.tolist()])
            return suspect.deviances(fitter.left_of(changes))

        if self.low < self.shown < self.high:
            value, error = self.shown, partial(dict[str, float], {name: _SHOWN * self.shown})
        else:
            value = _least(tried, spaced(self.low, self.high, _GRID), fitter.half_explained)
            unit = next(each.unit for each in self.cls.parameters() if each.name == name)
            wander = suspect.wander if unit is None else 0.0
            error = partial(self._error, tried, value, wander)
        changes, sizes = self._changes(fitter, value)
        found = {name: value, **sizes}
        yield fitter.fixed(self.cls.kind, self.shape.family, changes, found, len(found), error)

    def _error(self, tried: Callable[[FloatArray], FloatArray], value: float, wander: float) -> Parameters:
        """Return the parameter's standard error, or that its value is a bound: the search's own end."""
        name = self.shape.parameter
        if value >= self.high * _AT_LIMIT:
            return {name: math.inf}
        if value * _AT_LIMIT <= self.low:
            return {name: -math.inf}
        return _curved(name, tried, value, wander)

    def _changes(self, fitter: Fitter, value: float) -> tuple[FloatArray, Parameters]:
        """Return what a value adds to the readings, and the size that goes with it, where the kind has one."""
        name, size = self.shape.parameter, self.shape.size
        if not size:
            return fitter.added(self.cls, {name: value}), {}
        suspect, change = fitter.suspect, fitter.added(self.cls, {name: value, size: 1.0})
        wave = np.where(suspect.there, suspect.shown(change[np.newaxis])[0], 0.0)
        weight = float(np.sum(wave * np.nan_to_num(suspect.white)) / max(np.sum(np.square(wave)), _NOTHING))
        return weight * change, {size: weight}


def _least(tried: Callable[[FloatArray], FloatArray], values: FloatArray, worth: float) -> float:
    """Return where a function is least: of some values, and ever finer around the best where that is `worth` it.

    A few at once: values evenly between the best one's neighbours, and the bottom of the parabola through the three.
    """
    scores = tried(values)
    for _ in range(_TURNS):
        best, least = int(np.argmin(scores)), float(scores.min())
        three = slice(best - 1, best + 2)
        if not 0 < best < len(values) - 1 or least > worth or scores[three].max() - least < _SETTLED:
            break
        between = values[best - 1] + (values[best + 1] - values[best - 1]) * _BETWEEN
        at, bend = vertex(values[three], scores[three])
        finer = np.append(between, at if bend > 0.0 else values[best])
        values, order = np.unique(np.append(values[three], finer), return_index=True)
        scores = np.append(scores[three], tried(finer))[order]
    return float(values[np.argmin(scores)])


def _curved(name: str, tried: Callable[[FloatArray], FloatArray], value: float, wander: float) -> Parameters:
    """Return the distance at which -2 log likelihood has risen by 1, from a parabola; NaN where it doesn't rise.

    What the sensor should have read wanders, and with it any limit of that.
    """
    steps = 0.002 * value * 2.0 ** np.arange(9)
    scores = tried(np.concatenate([[value], value + steps, value - steps]))
    rises = 0.5 * (scores[1 : 1 + len(steps)] + scores[1 + len(steps) :]) - scores[0]
    for step, rise in zip(steps.tolist(), rises.tolist(), strict=True):
        if rise > 0.5:
            return {name: float(np.hypot(step / np.sqrt(rise), wander))}
    return {name: float("nan")}

"""Searches: kinds of faults with one parameter that isn't linear, tried on the fault's own class."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from gtmbench.detectors.isolation.fitter import WORTH, Fit, Fitter, Parameters
from gtmbench.detectors.isolation.parabola import spaced, vertex
from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import grows
from gtmbench.faults.shape import Shape
from gtmbench.values.record import FloatArray

_GRID, _COARSE = 12, 6  # values at first; of what grows, whose every value takes twice the work
_TURNS = 5  # of the search, at most
_FINER = 4  # values between neighbours, in every turn
_BETWEEN = np.arange(1, _FINER + 1) / (_FINER + 1)
_AT_LIMIT = 1.0 - 1e-6  # of a bound: up to rounding
_SHOWN = 1e-6  # of a parameter that readings show, its error
_BELOW, _ABOVE = 0.7, 1.4  # times the usual step of readings that run straight: their slew rate
_NOTHING = 1e-12  # a division's guard
_LATER_S = 0.1  # over which what is later is told
_MOST_LATE_S = 5.0  # than the test's estimate of an onset
_SETTLED = 0.5  # of -2 log likelihood, between neighbours: no finer search is worth it


@dataclass(frozen=True, kw_only=True)
class ParameterSearch:
    """A kind with one parameter, searched between two values; not where the readings show it (0 where they don't)."""

    cls: type[Fault]
    shape: Shape
    low: float
    high: float
    shown: float = 0.0
    is_dated: bool = False  # whether the onset is found beside, where the test's doesn't explain as much

    @classmethod
    def of(cls, fitter: Fitter, fault: type[Fault], shape: Shape) -> ParameterSearch:
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
        """Give the best fit: of values evenly spaced in their logarithm, then of the best neighbourhood.

        What changes with the time since its onset is tried about the test's estimate of that.
        """
        if not 0.0 < self.low < self.high:
            return
        suspect, name = fitter.suspect, self.shape.parameter
        late_s, worth = 0.0, fitter.half_explained
        grid = spaced(self.low, self.high, _COARSE if grows(self.cls) else _GRID)
        if grows(self.cls):
            late_s = float(suspect.time_s[suspect.sure] - suspect.time_s[suspect.onset])
            worth = min(worth, fitter.plain("1", "t").deviance)  # what a drift explains as well
        if grows(self.cls) and not self.is_dated:
            dated = replace(self, is_dated=True)
            least = [float(each._deviances(fitter, grid, late_s).min()) for each in (self, dated)]
            if least[1] < least[0] - WORTH:
                yield from dated.fits(fitter)
                return
        tried = partial(self._deviances, fitter, late_s=late_s)
        if self.low < self.shown < self.high:
            value, error = self.shown, partial(dict[str, float], {name: _SHOWN * self.shown})
        else:
            value = _least(tried, grid, worth)
            unit = next(each.unit for each in self.cls.parameters() if each.name == name)
            error = partial(self._error, tried, value, suspect.wander if unit is None else 0.0)
        changes, beside = self._changes(fitter, value, late_s)
        found = {name: value, **beside}

        def errors() -> Parameters:
            told, size = error(), self.shape.size
            if not size or not math.isfinite(told[name]):
                return told
            beyond = self._changes(fitter, value + told[name], late_s)[1][size]  # it hangs on the other parameter
            of_noise = abs(found[size]) / max(float(np.linalg.norm(_shown(fitter, changes))), _NOTHING)
            return told | {size: float(np.hypot(beyond - found[size], of_noise))}

        yield fitter.fixed(self.cls.kind, self.shape.family, changes, found, len(found), errors)

    def _deviances(self, fitter: Fitter, values: FloatArray, late_s: float) -> FloatArray:
        """Return -2 log likelihood of what some values leave."""
        changes = np.array([self._changes(fitter, value, late_s)[0] for value in values.tolist()])
        return fitter.suspect.deviances(fitter.left_of(changes))

    def _error(self, tried: Callable[[FloatArray], FloatArray], value: float, wander: float) -> Parameters:
        """Return the parameter's standard error, or that its value is a bound: the search's own end."""
        name = self.shape.parameter
        if value >= self.high * _AT_LIMIT:
            return {name: math.inf}
        if value * _AT_LIMIT <= self.low:
            return {name: -math.inf}
        return _curved(name, tried, value, wander)

    def _changes(self, fitter: Fitter, value: float, late_s: float) -> tuple[FloatArray, Parameters]:
        """Return what a value adds to the readings, and what was found beside: its size, since when it is there.

        Both are linear: a size is a factor, and what it does a little later is what it does now and so much of the
        difference.
        """
        shape = self.shape
        parameters = {shape.parameter: value} | ({shape.size: 1.0} if shape.size else {})
        change = fitter.added(self.cls, parameters, late_s=late_s)
        onset = {}
        if grows(self.cls):
            later = (fitter.added(self.cls, parameters, late_s=late_s + _LATER_S) - change) / _LATER_S
            moved_s = self._moved_s(fitter, change, later) if self.is_dated else 0.0
            moved_s = min(max(moved_s, -late_s), _MOST_LATE_S)
            change = change + moved_s * later
            onset = {"onset_s": float(fitter.suspect.time_s[fitter.suspect.sure]) - late_s - moved_s}
        if not shape.size:
            return change, onset
        wave = _shown(fitter, change)[0]
        size = float(wave @ _white(fitter) / max(wave @ wave, _NOTHING))
        return size * change, {shape.size: size} | onset

    def _moved_s(self, fitter: Fitter, change: FloatArray, later: FloatArray) -> float:
        """Return how much earlier the fault began than was taken, by least squares."""
        waves, white = _shown(fitter, change, later), _white(fitter)
        if self.shape.size:
            size, moved = np.linalg.lstsq(waves.T, white, rcond=_NOTHING)[0].tolist()
            return float(moved / size) if size else 0.0
        return float(waves[1] @ (white - waves[0]) / max(waves[1] @ waves[1], _NOTHING))


def _shown(fitter: Fitter, *changes: FloatArray) -> FloatArray:
    """Return what changes show in the residuals, shape (changes, samples)."""
    return np.asarray((fitter.suspect.shown(np.array(changes)) * fitter.suspect.there).reshape(len(changes), -1))


def _white(fitter: Fitter) -> FloatArray:
    return np.nan_to_num(fitter.suspect.white).ravel()


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

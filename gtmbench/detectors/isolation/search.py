"""Searches: kinds of faults with one parameter that isn't linear, tried on the fault's own class."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import partial

import numpy as np

from gtmbench.detectors.isolation.columns import spaced, vertex
from gtmbench.detectors.isolation.fitter import WORTH, Fit, Fitter, Parameters
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


# what values show in the residuals, shape (values, outputs, rows), and what is found beside each, by name
_Waves = tuple[FloatArray, dict[str, FloatArray]]


class ParameterSearch:
    """A kind with one parameter, searched between two values; not where the readings show it (0 where they don't).

    What changes with the time since its onset has been there for `_late_s` by the test's estimate.
    """

    def __init__(self, fitter: Fitter, cls: type[Fault], shape: Shape) -> None:
        self._fitter, self._cls, self._shape, self._grows = fitter, cls, shape, grows(cls)
        suspect, virtual = fitter.suspect, fitter.virtual[fitter.suspect.sure :]
        step = fitter.straight_step / fitter.period_s
        self._shown = fitter.limit if shape.read == "limit" else step if shape.read == "step" else 0.0
        self._low, self._high = shape.low, shape.high
        if shape.read == "step" and step:
            self._low, self._high = _BELOW * step, _ABOVE * step
        elif shape.of:
            reach = np.abs(virtual) if shape.of == "reach" else 2.0 * np.abs(np.diff(virtual)) / fitter.period_s
            most = float(reach.max(initial=0.0))
            self._low, self._high = shape.low * most, shape.high * most
        self._late_s = float(suspect.time_s[suspect.sure] - suspect.time_s[suspect.onset]) if self._grows else 0.0

    def fits(self) -> Iterator[Fit]:
        """Give the best fit: of values evenly spaced in their logarithm, then of the best neighbourhood.

        What changes with the time since its onset is dated beside, where that explains far more.
        """
        if not 0.0 < self._low < self._high:
            return
        suspect, name, fitter = self._fitter.suspect, self._shape.parameter, self._fitter
        value, dated = self._shown, False
        error = partial(dict[str, float], {name: _SHOWN * self._shown})
        if not self._low < self._shown < self._high:
            worth = fitter.half_explained
            if self._grows:
                worth = min(worth, fitter.plain("1", "t").deviance)  # what a drift explains as well
            value, dated = self._best(worth)
            unit = next(each.unit for each in self._cls.parameters() if each.name == name)
            error = partial(self._error, dated, value, suspect.wander if unit is None else 0.0)
        shown, beside = self._waves(np.array([value]), dated)
        found = {name: value, **{each: float(values[0]) for each, values in beside.items()}}

        def errors() -> Parameters:
            told, size = error(), self._shape.size
            if not size or not math.isfinite(told[name]):
                return told
            beyond = float(self._waves(np.array([value + told[name]]), dated)[1][size][0])  # it hangs on the other one
            of_noise = abs(found[size]) / max(float(np.linalg.norm(shown)), _NOTHING)
            return told | {size: float(np.hypot(beyond - found[size], of_noise))}

        left = suspect.plain(suspect.white - shown[0])
        yield Fit(
            kind=self._cls.kind, family=self._shape.family, left=left, parameters=found, free=len(found), errors=errors
        )

    def _best(self, worth: float) -> tuple[float, bool]:
        """Return the value that leaves least, and whether with an onset of its own."""
        grid = spaced(self._low, self._high, _COARSE if self._grows else _GRID)
        suspect, shown = self._fitter.suspect, self._seen(grid, later=self._grows)
        ways = [False, True] if self._grows else [False]
        scores = [suspect.deviances(suspect.white - self._sized(*shown, dated=dated)[0]) for dated in ways]
        dated = len(scores) > 1 and bool(scores[1].min() < scores[0].min() - WORTH)
        return _least(partial(self._deviances, dated), grid, scores[dated], worth), dated

    def _deviances(self, dated: bool, values: FloatArray) -> FloatArray:
        """Return -2 log likelihood of what some values leave."""
        return self._fitter.suspect.deviances(self._fitter.suspect.white - self._waves(values, dated)[0])

    def _error(self, dated: bool, value: float, wander: float) -> Parameters:
        """Return the parameter's standard error, or that its value is a bound: the search's own end.

        It is the distance at which -2 log likelihood has risen by 1, from a parabola; NaN where it doesn't rise. What
        the sensor should have read wanders, and with it any limit of that.
        """
        name = self._shape.parameter
        if value >= self._high * _AT_LIMIT:
            return {name: math.inf}
        if value * _AT_LIMIT <= self._low:
            return {name: -math.inf}
        steps = 0.002 * value * 2.0 ** np.arange(9)
        scores = self._deviances(dated, np.concatenate([[value], value + steps, value - steps]))
        rises = 0.5 * (scores[1 : 1 + len(steps)] + scores[1 + len(steps) :]) - scores[0]
        enough = np.flatnonzero(rises > 0.5)
        far = float(steps[enough[0]] / np.sqrt(rises[enough[0]])) if len(enough) else math.nan
        return {name: math.hypot(far, wander)}

    def _waves(self, values: FloatArray, dated: bool) -> _Waves:
        return self._sized(*self._seen(values, later=dated), dated=dated)

    def _seen(self, values: FloatArray, *, later: bool) -> tuple[FloatArray, FloatArray]:
        """Return what values show at size one, and by how much more a second later, if that is asked."""
        beside = {self._shape.size: 1.0} if self._shape.size else {}
        given = [{self._shape.parameter: value} | beside for value in values.tolist()]
        at_once = self._fitter.shown(self._cls, given, self._late_s)
        if not later:
            return at_once, np.zeros(())
        return at_once, (self._fitter.shown(self._cls, given, self._late_s + _LATER_S) - at_once) / _LATER_S

    def _sized(self, shown: FloatArray, later: FloatArray, *, dated: bool) -> _Waves:
        """Return what is shown with the best size, and from the best onset on.

        Both are linear: a size is a factor, and what it does a little later is what it does now and so much of the
        difference.
        """
        beside, white = {}, self._fitter.suspect.filled
        if self._grows:
            moved_s = self._moved_s(shown, later, white) if dated else np.zeros(len(shown))
            moved_s = np.clip(moved_s, -self._late_s, _MOST_LATE_S)
            shown = shown + moved_s[:, np.newaxis, np.newaxis] * later
            suspect = self._fitter.suspect
            beside["onset_s"] = float(suspect.time_s[suspect.sure]) - self._late_s - moved_s
        if self._shape.size:
            size = _along(shown, white) / np.maximum(_along(shown, shown), _NOTHING)
            shown = size[:, np.newaxis, np.newaxis] * shown
            beside = {self._shape.size: size} | beside
        return shown, beside

    def _moved_s(self, shown: FloatArray, later: FloatArray, white: FloatArray) -> FloatArray:
        """Return how much earlier the fault began than was taken, by least squares."""
        if not self._shape.size:
            return _along(later, white - shown) / np.maximum(_along(later, later), _NOTHING)
        power = np.maximum(_along(shown, shown), _NOTHING)
        share = _along(shown, later) / power  # of the first, in the second
        beside = later - share[:, np.newaxis, np.newaxis] * shown
        moved = _along(beside, white) / np.maximum(_along(beside, beside), _NOTHING)
        size = _along(shown, white) / power - share * moved
        return np.divide(moved, size, out=np.zeros_like(moved), where=size != 0.0)


def _along(one: FloatArray, other: FloatArray) -> FloatArray:
    """Return the products of residuals, shape (..., outputs, rows)."""
    return np.asarray(np.einsum("...or,...or->...", one, other))


def _least(tried: Callable[[FloatArray], FloatArray], values: FloatArray, scores: FloatArray, worth: float) -> float:
    """Return where a function is least: of some values' scores, and ever finer around the best where it is `worth` it.

    A few at once: values evenly between the best one's neighbours, and the bottom of the parabola through the three.
    """
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

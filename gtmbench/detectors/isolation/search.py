"""Searches: kinds of faults with one parameter that isn't linear, tried on the fault's own class."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from gtmbench.detectors.isolation.fitter import Fit, Fitter, Parameters
from gtmbench.detectors.isolation.parabola import spaced, vertex
from gtmbench.faults.kinds import FAULTS
from gtmbench.values.record import FloatArray

_GRID = 12
_TURNS = 5
_FINER = 4
_BETWEEN = np.arange(1, _FINER + 1) / (_FINER + 1)
_AT_LIMIT = 1.0 - 1e-6
_SHOWN = 1e-6  # of a parameter that readings show, its error
_SETTLED = 0.5  # of -2 log likelihood, between neighbours: no finer search is worth it


@dataclass(frozen=True, kw_only=True)
class Search:
    """A kind with one parameter, searched between two values; not where the readings show it (0 where they don't).

    What it reads is said by the fault's own class, from where the fault is surely there and from the sensor's own
    reading there. Where errors would add up from sample to sample, `step` says it of every sample from its reading
    before: a function of the parameter, what it should read, what it read before, and the sample period. Where the
    attitude bends with the sensor, it is hardly known what that should read, and `undone` tells of the readings what it
    is: a function of the parameter, what it read, and what it should have.
    """

    kind: str
    family: str
    name: str
    low: float
    high: float
    shown: float = 0.0
    step: Callable[[float, FloatArray, FloatArray, float], FloatArray] | None = None
    undone: Callable[[float, FloatArray, FloatArray], FloatArray] | None = None

    def fits(self, fitter: Fitter) -> Iterator[Fit]:
        """Give the best fit: of values evenly spaced in their logarithm, then of the best neighbourhood."""
        if not 0.0 < self.low < self.high:
            return
        suspect = fitter.suspect

        def tried(values: FloatArray) -> FloatArray:
            changes = np.array([self._changes(fitter, value) for value in values.tolist()])
            return suspect.deviances(fitter.left_of(changes))

        if self.low < self.shown < self.high:
            value, error = self.shown, partial(dict[str, float], {self.name: _SHOWN * self.shown})
        else:
            value = _least(tried, spaced(self.low, self.high, _GRID), fitter.half_explained)
            wander = 0.0 if self.name.endswith("_s") else suspect.wander
            error = partial(self._error, tried, value, wander)
        yield fitter.fixed(self.kind, self.family, self._changes(fitter, value), {self.name: value}, 1, error)

    def _error(self, tried: Callable[[FloatArray], FloatArray], value: float, wander: float) -> Parameters:
        """Return the parameter's standard error, or that its value is a bound: the search's own end."""
        if value >= self.high * _AT_LIMIT:
            return {self.name: math.inf}
        if value * _AT_LIMIT <= self.low:
            return {self.name: -math.inf}
        return _curved(self.name, tried, value, wander)

    def _changes(self, fitter: Fitter, value: float) -> FloatArray:
        suspect, virtual = fitter.suspect, fitter.virtual
        sure, onset_s = suspect.sure, float(suspect.time_s[suspect.sure])
        before = fitter.measured[sure - 1 : -1]
        added, elapsed_s = np.zeros_like(virtual), suspect.time_s[sure:] - onset_s
        if fitter.is_driven and self.undone is not None:
            added[sure:] = fitter.measured[sure:] - self.undone(value, fitter.measured[sure:], virtual[sure:])
            return added
        if self.step is not None:
            reads = self.step(value, virtual[sure:], before, fitter.period_s)
        else:
            figure: dict[str, Any] = {self.name: value}
            fault = FAULTS[self.kind](channel=suspect.channel, onset_s=onset_s, **figure)
            carried = fault.begin(before[:1])
            reads, _ = fault.distort(virtual[sure:, np.newaxis], elapsed_s, fitter.period_s, carried)
        added[sure:] = reads - virtual[sure:]
        return added


def before_deadzone(half_width: float, measured: FloatArray, virtual: FloatArray) -> FloatArray:
    """Return what a sensor with a deadzone should have read: where it reads nothing, it isn't told."""
    told = measured + half_width * np.sign(measured)
    return np.where(measured == 0.0, np.clip(virtual, -half_width, half_width), told)


def before_saturation(limit: float, measured: FloatArray, virtual: FloatArray) -> FloatArray:
    """Return what a sensor that is held within limits should have read: where it is at one, it isn't told."""
    beyond = np.sign(measured) * np.maximum(np.sign(measured) * virtual, limit)
    return np.where(np.abs(measured) < limit * _AT_LIMIT, measured, beyond)


def rate_limited_step(rate_limit: float, y: FloatArray, before: FloatArray, sample_period_s: float) -> FloatArray:
    """Return what a sensor with a rate limit makes of samples, each from what it read before."""
    return before + np.clip(y - before, -rate_limit * sample_period_s, rate_limit * sample_period_s)


def hysteresis_step(width: float, y: FloatArray, before: FloatArray, _: float) -> FloatArray:
    """Return what a sensor with backlash makes of samples, each from what it read before."""
    return np.clip(before, y - 0.5 * width, y + 0.5 * width)


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

"""Fault hypotheses: that a sensor has a kind of fault, and how the fault's parameters are searched.

What a broken sensor would read, given what it should have read, the fault's own class says (`gtmbench.faults`). A new
hypothesis is an entry in `HYPOTHESES`; a kind that is searched in another way is one class more.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtmbench.faults.fault import Fault
from gtmbench.faults.kinds import Deadzone, Drift, Jam, RateSaturation, Saturation
from gtmbench.record import FloatArray

_GRID = 14  # trial values of a parameter, evenly spaced in its logarithm
_TURNS = 12

Parameters = dict[str, float]  # by name, in the channel's unit (per second for slopes; times in seconds)
Deviance = Callable[[FloatArray], float]  # of what the broken sensor reads: -2 log likelihood, to a constant


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """The rows that a diagnosis stands on, from where the fault is surely there.

    Attributes
    ----------
    channel : str
        The suspect.
    measured, virtual : shape (rows,)
        What it read, and what it should have read.
    before : float
        Its last reading before these rows.
    time_s : shape (rows,)
    earliest_s : float
        When the fault may have begun, at the earliest.
    sample_period_s : float
    """

    channel: str
    measured: FloatArray = field(repr=False)
    virtual: FloatArray = field(repr=False)
    before: float
    time_s: FloatArray = field(repr=False)
    earliest_s: float
    sample_period_s: float


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A kind of fault fitted to a stretch.

    Attributes
    ----------
    kind : str
    deviance : float
    parameters : dict
    """

    kind: str
    deviance: float
    parameters: Parameters


class Hypothesis:
    """That a sensor has a kind of fault: what it would read, and how the fault's parameters are found.

    Parameters
    ----------
    fault : type of Fault
        Its severities are parameters. An onset is one where it is searched; what the fault carries over from the
        sample before it is where `carried` says so.
    """

    def __init__(self, fault: type[Fault]) -> None:
        self._fault = fault
        self.kind = fault.kind
        self._severities = tuple(each.name for each in fault.parameters() if each.is_severity)

    def reads(self, stretch: Stretch, parameters: Parameters) -> FloatArray:
        """Return what a sensor with this fault reads over a stretch."""
        onset_s = parameters.get("onset_s", stretch.earliest_s)
        severities: dict[str, Any] = {name: parameters[name] for name in self._severities}
        fault = self._fault(channel=stretch.channel, onset_s=onset_s, **severities)
        readings, elapsed_s = stretch.virtual[:, np.newaxis], stretch.time_s - onset_s
        carried = self.carried(fault, stretch, parameters)
        return fault.distort(readings, elapsed_s, stretch.sample_period_s, carried)[0]

    def carried(self, fault: Fault, stretch: Stretch, parameters: Parameters) -> Any:
        """Return what the fault carries into a stretch."""
        return fault.begin(np.array([stretch.before]))

    def fit(self, stretch: Stretch, deviance: Deviance) -> Fit | None:
        """Return the best parameters, or None where the stretch allows none."""
        raise NotImplementedError

    def errors(self, stretch: Stretch, deviance: Deviance, fit: Fit) -> Parameters:
        """Return standard errors of the parameters: how far each may go until -2 log likelihood has risen by 1."""
        raise NotImplementedError

    def _fitted(self, stretch: Stretch, deviance: Deviance, parameters: Parameters) -> Fit:
        return Fit(kind=self.kind, deviance=deviance(self.reads(stretch, parameters)), parameters=parameters)


class Ramp(Hypothesis):
    """A fault that adds a slope, its onset not after the stretch begins."""

    def fit(self, stretch: Stretch, deviance: Deviance) -> Fit | None:
        """Fit a line; its onset is held to its range."""
        added = stretch.measured - stretch.virtual
        there = np.isfinite(added)
        if there.sum() < 3:
            return None
        begin_s = float(stretch.time_s[0])
        middle, span = float(stretch.time_s.mean()), max(float(np.ptp(stretch.time_s)), 1e-9)
        slope, offset = np.polyfit(stretch.time_s[there] - middle, added[there], 1)

        def onset_s(line: FloatArray) -> float:
            wanted = middle - line[0] * span / line[1] if line[1] else begin_s
            return float(np.clip(wanted, stretch.earliest_s, begin_s))

        def tried(line: FloatArray) -> float:
            return deviance(self.reads(stretch, {"slope": line[1] / span, "onset_s": onset_s(line)}))

        line = self._searched(tried, np.array([offset, slope * span]))
        return self._fitted(stretch, deviance, {"slope": float(line[1] / span), "onset_s": onset_s(line)})

    def _searched(self, tried: Callable[[FloatArray], float], line: FloatArray) -> FloatArray:
        """Return the best line, as its middle and its rise: least squares begins, the likelihood decides.

        Other residuals that the suspect enters may know far better than the virtual sensor does.
        """
        from scipy.optimize import minimize

        size = max(float(np.abs(line).max()), 1e-9)
        simplex = line + 0.3 * size * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options = {"initial_simplex": simplex, "maxfev": 60, "xatol": 1e-3 * size, "fatol": 0.05}
        return np.asarray(minimize(tried, line, method="Nelder-Mead", options=options).x)

    def errors(self, stretch: Stretch, deviance: Deviance, fit: Fit) -> Parameters:
        """Turn the line about its middle, so that the onset moves along."""
        slope, onset_s = fit.parameters["slope"], fit.parameters["onset_s"]
        middle = float(stretch.time_s.mean())

        def tried(trial: float) -> float:
            begun_s = middle - (middle - onset_s) * slope / trial if trial else middle
            return deviance(self.reads(stretch, {"slope": trial, "onset_s": begun_s}))

        error = _standard_error(tried, slope)
        return {"slope": error, "onset_s": abs(error / slope) * (middle - onset_s) if slope else float("nan")}


class Constant(Hypothesis):
    """A fault that repeats a value which it carries over."""

    def carried(self, fault: Fault, stretch: Stretch, parameters: Parameters) -> Any:
        """Return the value: it is searched, for the last reading before the stretch may be another."""
        return parameters["value"]

    def fit(self, stretch: Stretch, deviance: Deviance) -> Fit | None:
        """Take the median."""
        there = stretch.measured[np.isfinite(stretch.measured)]
        return self._fitted(stretch, deviance, {"value": float(np.median(there))}) if len(there) else None

    def errors(self, stretch: Stretch, deviance: Deviance, fit: Fit) -> Parameters:
        """Return the error of the mean reading: 0 where the sensor reads the same all the time."""
        there = stretch.measured[np.isfinite(stretch.measured)]
        return {"value": float(np.std(there) / np.sqrt(len(there)))}


class Scale(Hypothesis):
    """A fault with one positive severity.

    Parameters
    ----------
    fault : type of Fault
    largest : callable
        From a stretch to the greatest value worth trying.
    """

    def __init__(self, fault: type[Fault], largest: Callable[[Stretch], float]) -> None:
        super().__init__(fault)
        (self._severity,) = self._severities
        self._largest = largest

    def fit(self, stretch: Stretch, deviance: Deviance) -> Fit | None:
        """Try a grid down to a hundredth of the largest, then refine the best neighbourhood."""
        from scipy.optimize import minimize_scalar

        largest = self._largest(stretch)
        if not largest > 0.0:
            return None

        def tried(value: float) -> float:
            return deviance(self.reads(stretch, {self._severity: value}))

        grid = np.geomspace(largest / 100.0, largest, _GRID)
        scores = [tried(value) for value in grid.tolist()]
        best = int(np.argmin(scores))
        value = float(grid[best])
        if 0 < best < _GRID - 1:
            bounds = (float(grid[best - 1]), float(grid[best + 1]))
            refined = minimize_scalar(tried, bounds=bounds, method="bounded", options={"maxiter": _TURNS})
            value = float(refined.x) if refined.fun < scores[best] else value
        return self._fitted(stretch, deviance, {self._severity: value})

    def errors(self, stretch: Stretch, deviance: Deviance, fit: Fit) -> Parameters:
        """Move the severity to both sides."""

        def tried(trial: float) -> float:
            return deviance(self.reads(stretch, {self._severity: trial}))

        return {self._severity: _standard_error(tried, fit.parameters[self._severity], low=0.0)}


def _reach(stretch: Stretch) -> float:
    """Return the greatest magnitude that the sensor should have read."""
    return float(np.nanmax(np.abs(stretch.virtual), initial=0.0))


def _slew(stretch: Stretch) -> float:
    """Return twice the greatest slope of the virtual sensor, which is smoother than the real one; per second."""
    return 2.0 * float(np.nanmax(np.abs(np.diff(stretch.virtual)), initial=0.0)) / stretch.sample_period_s


HYPOTHESES: dict[str, Hypothesis] = {
    hypothesis.kind: hypothesis
    for hypothesis in (
        Ramp(Drift),
        Scale(Deadzone, _reach),
        Scale(Saturation, _reach),
        Scale(RateSaturation, _slew),
        Constant(Jam),
    )
}


def _standard_error(tried: Callable[[float], float], value: float, *, low: float = -np.inf) -> float:
    """Return the distance at which -2 log likelihood has risen by 1, from a parabola; NaN where it doesn't rise."""
    least = tried(value)
    step = 0.002 * abs(value) or 1e-6
    for _ in range(12):
        rise = 0.5 * (tried(value + step) + tried(max(value - step, low))) - least
        if rise > 0.5:
            return float(step / np.sqrt(rise))
        step *= 2.0
    return float("nan")

"""Kinds of faults as a diagnosis knows them: what a broken sensor would read, given what it should have read."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from gtmbench.faults.distortions import deadzone, rate_saturation, saturation
from gtmbench.record import FloatArray

_GRID = 14  # trial values of a parameter, evenly spaced in its logarithm
_TURNS = 12

Score = Callable[[FloatArray], float]  # of what the broken sensor reads: -2 log likelihood, to a constant


@dataclass(frozen=True, kw_only=True, eq=False)
class Stretch:
    """The rows that a diagnosis stands on, from where the fault is surely there.

    Attributes
    ----------
    measured, virtual : shape (rows,)
        What the suspect read, and what it should have read.
    before : float
        Its last reading before these rows.
    time_s : shape (rows,)
    earliest_s : float
        When the fault may have begun, at the earliest.
    sample_period_s : float
    """

    measured: FloatArray = field(repr=False)
    virtual: FloatArray = field(repr=False)
    before: float
    time_s: FloatArray = field(repr=False)
    earliest_s: float
    sample_period_s: float

    @property
    def reach(self) -> float:
        """The greatest magnitude that the sensor should have read."""
        return float(np.nanmax(np.abs(self.virtual), initial=0.0))

    @property
    def slew(self) -> float:
        """The greatest slope that it should have read, per second."""
        return float(np.nanmax(np.abs(np.diff(self.virtual)), initial=0.0)) / self.sample_period_s


@dataclass(frozen=True, kw_only=True)
class Fit:
    """A kind of fault fitted to a stretch.

    Attributes
    ----------
    kind : str
    score : float
        -2 log likelihood to a constant.
    parameters : dict
        By name, in the channel's unit (per second for slopes; times in seconds).
    """

    kind: str
    score: float
    parameters: dict[str, float]


class Kind:
    """A kind of fault: what it makes of a signal, and how its parameters are found.

    A new one: `name`, `reads` and `fit`, and its place in `KINDS`.
    """

    name: str

    def reads(self, stretch: Stretch, parameters: dict[str, float]) -> FloatArray:
        """Return what a sensor with this fault reads over a stretch."""
        raise NotImplementedError

    def fit(self, stretch: Stretch, score: Score) -> Fit | None:
        """Return the best parameters, or None where the stretch allows none."""
        raise NotImplementedError

    def errors(self, stretch: Stretch, score: Score, fit: Fit) -> dict[str, float]:
        """Return standard errors of the parameters: how far each may go until -2 log likelihood has risen by 1."""
        raise NotImplementedError

    def _fitted(self, stretch: Stretch, score: Score, parameters: dict[str, float]) -> Fit:
        return Fit(kind=self.name, score=score(self.reads(stretch, parameters)), parameters=parameters)


class DriftKind(Kind):
    """y + slope (t - onset), the onset not after the stretch begins."""

    name = "drift"

    def reads(self, stretch: Stretch, parameters: dict[str, float]) -> FloatArray:
        """Add the ramp."""
        return np.asarray(stretch.virtual + parameters["slope"] * (stretch.time_s - parameters["onset_s"]))

    def fit(self, stretch: Stretch, score: Score) -> Fit | None:
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
            return score(self.reads(stretch, {"slope": line[1] / span, "onset_s": onset_s(line)}))

        found = self._searched(tried, np.array([offset, slope * span]))
        return self._fitted(stretch, score, {"slope": float(found[1] / span), "onset_s": onset_s(found)})

    def _searched(self, tried: Callable[[FloatArray], float], line: FloatArray) -> FloatArray:
        """Return the best line, as its middle and its rise: least squares begins, the likelihood decides.

        Other residuals that the suspect enters may know far better than the virtual sensor does.
        """
        from scipy.optimize import minimize

        size = max(float(np.abs(line).max()), 1e-9)
        simplex = line + 0.3 * size * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
        options = {"initial_simplex": simplex, "maxfev": 60, "xatol": 1e-3 * size, "fatol": 0.05}
        return np.asarray(minimize(tried, line, method="Nelder-Mead", options=options).x)

    def errors(self, stretch: Stretch, score: Score, fit: Fit) -> dict[str, float]:
        """Turn the line about its middle, so that the onset moves along."""
        slope, onset_s = fit.parameters["slope"], fit.parameters["onset_s"]
        middle = float(stretch.time_s.mean())

        def tried(trial: float) -> float:
            begun_s = middle - (middle - onset_s) * slope / trial if trial else middle
            return score(self.reads(stretch, {"slope": trial, "onset_s": begun_s}))

        error = _standard_error(tried, slope)
        return {"slope": error, "onset_s": abs(error / slope) * (middle - onset_s) if slope else float("nan")}


class JamKind(Kind):
    """A constant."""

    name = "jam"

    def reads(self, stretch: Stretch, parameters: dict[str, float]) -> FloatArray:
        """Repeat it."""
        return np.full(len(stretch.measured), parameters["value"])

    def fit(self, stretch: Stretch, score: Score) -> Fit | None:
        """Take the median."""
        seen = stretch.measured[np.isfinite(stretch.measured)]
        return self._fitted(stretch, score, {"value": float(np.median(seen))}) if len(seen) else None

    def errors(self, stretch: Stretch, score: Score, fit: Fit) -> dict[str, float]:
        """Return the error of the mean reading: 0 where the sensor reads the same all the time."""
        seen = stretch.measured[np.isfinite(stretch.measured)]
        return {"value": float(np.std(seen) / np.sqrt(len(seen)))}


class ScaleKind(Kind):
    """A kind with one positive parameter."""

    parameter: str

    def largest(self, stretch: Stretch) -> float:
        """Return the greatest value worth trying."""
        return stretch.reach

    def fit(self, stretch: Stretch, score: Score) -> Fit | None:
        """Try a grid down to a hundredth of the largest, then refine the best neighbourhood."""
        from scipy.optimize import minimize_scalar

        largest = self.largest(stretch)
        if not largest > 0.0:
            return None

        def tried(value: float) -> float:
            return score(self.reads(stretch, {self.parameter: value}))

        grid = np.geomspace(largest / 100.0, largest, _GRID)
        scores = [tried(value) for value in grid.tolist()]
        best = int(np.argmin(scores))
        value = float(grid[best])
        if 0 < best < _GRID - 1:
            bounds = (float(grid[best - 1]), float(grid[best + 1]))
            refined = minimize_scalar(tried, bounds=bounds, method="bounded", options={"maxiter": _TURNS})
            value = float(refined.x) if refined.fun < scores[best] else value
        return self._fitted(stretch, score, {self.parameter: value})

    def errors(self, stretch: Stretch, score: Score, fit: Fit) -> dict[str, float]:
        """Move the parameter to both sides."""
        value = fit.parameters[self.parameter]

        def tried(trial: float) -> float:
            return score(self.reads(stretch, {self.parameter: trial}))

        return {self.parameter: _standard_error(tried, value, low=0.0)}


class DeadzoneKind(ScaleKind):
    """sign(y) max(|y| - half_width, 0)."""

    name = "deadzone"
    parameter = "half_width"

    def reads(self, stretch: Stretch, parameters: dict[str, float]) -> FloatArray:
        """Shrink towards zero."""
        return deadzone(stretch.virtual, parameters["half_width"])


class SaturationKind(ScaleKind):
    """Y held within +-limit."""

    name = "saturation"
    parameter = "limit"

    def reads(self, stretch: Stretch, parameters: dict[str, float]) -> FloatArray:
        """Clip."""
        return saturation(stretch.virtual, parameters["limit"])


class RateSaturationKind(ScaleKind):
    """Y followed no faster than rate_limit."""

    name = "rate_saturation"
    parameter = "rate_limit"

    def largest(self, stretch: Stretch) -> float:
        """Return twice the greatest slope of the virtual sensor, which is smoother than the real one."""
        return 2.0 * stretch.slew

    def reads(self, stretch: Stretch, parameters: dict[str, float]) -> FloatArray:
        """Follow the signal from the last reading on."""
        step = parameters["rate_limit"] * stretch.sample_period_s
        return rate_saturation(stretch.virtual, step, stretch.before)


KINDS: dict[str, Kind] = {
    kind.name: kind for kind in (DriftKind(), DeadzoneKind(), SaturationKind(), RateSaturationKind(), JamKind())
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

"""A throttle told from sensors that look like one: nx by the airspeed, alpha and the airspeed by what is left.

All are a forward acceleration that drag doesn't explain. A wrong nx contradicts the airspeed, which no force enters: in
still air

    V' = g ((nx - sin theta) cos alpha cos beta + (ny + sin phi cos theta) sin beta
            + (cos phi cos theta - nz) sin alpha cos beta),

whatever the engine does; and what is left of it is wind. So since the fault began

    E = V - integral of V' by accelerometers

has wandered as wind does if the throttle failed, and by what the throttle seems to be off, integrated, if nx did. Wind
comes back within seconds and that grows, so time decides. A wrong alpha or airspeed leaves other equations wrong, in
proportion to what the throttle seems to be off at every moment, where a throttle leaves little.

Either is a likelihood ratio, its logarithm in nats: the noise is a first-order Gauss-Markov process of the size that it
had in the minute before. Where E wanders as no wind does, the airspeed may be wrong itself, and nothing is told.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping, Sequence
from math import ceil

import numpy as np

from gtmbench.values.channels import FT_S_PER_KT, G_FT_S2
from gtmbench.values.record import FloatArray

KT_S_PER_G = G_FT_S2 / FT_S_PER_KT
_STEP_S = 0.5  # between two values that are compared
_BEFORE_S, _LEAST_BEFORE_S, _MOST_S = 60.0, 30.0, 120.0  # the minute before, and how long a fault is looked at
_WIND_S, _LEFT_S = 4.0, 2.0  # how long wind lasts, and what no surface explains
_LEAST_WIND_KT, _LEAST_LEFT = 2.0, 0.5  # no smaller deviation is believed, however calm a minute was
_DRIFT_KT_S = 0.1  # how far E's slope of a minute may be from the next one's
_NX_KNOWN_TO, _KNOWN_TO = 0.1, 0.2  # of what a sensor would do: by kinematics, and by effects that vary
_MISFIT, _FAR = 2.0, 4.5  # of E a value, and deviations of its farthest: more is no wind


def speeding(read: Mapping[str, FloatArray]) -> FloatArray:
    """Return V' in kt/s, by accelerometers and vanes.

    >>> level = dict.fromkeys(("alpha", "beta", "phi", "theta", "ny"), np.zeros(1))
    >>> speeding(level | {"nx": np.array([0.1]), "nz": np.ones(1)}).round(2)  # forward by a tenth of g
    array([1.91])
    """
    alpha, beta, phi, theta = (np.radians(read[name]) for name in ("alpha", "beta", "phi", "theta"))
    forward = (read["nx"] - np.sin(theta)) * np.cos(alpha)
    down = (np.cos(phi) * np.cos(theta) - read["nz"]) * np.sin(alpha)
    right = (read["ny"] + np.sin(phi) * np.cos(theta)) * np.sin(beta)
    return np.asarray(KT_S_PER_G * ((forward + down) * np.cos(beta) + right))


class ThrottleHistory:
    """What is remembered of the last minutes, by blocks.

    `per_step`: what a step of the throttle changes of nx, in g. `rho`, shape (sensors, left): what each sensor that
    could be wrong, but nx, changes of what is left by a step that the throttle seems off.
    """

    def __init__(self, block_s: float, per_step: float, rho: FloatArray) -> None:
        self._rows = max(round(_STEP_S / block_s), 1)  # blocks a step
        self._block_s, self._per_step, self._rho = block_s, per_step, rho
        self._kept: deque[Sequence[float]] = deque(maxlen=ceil((_BEFORE_S + _MOST_S) / block_s))
        self._count = 0

    def push(self, block: Sequence[float]) -> None:
        """Take a block: by how much E grew in it, in kt; by how many steps the throttle seems off; what is left."""
        self._kept.append(block)
        self._count += 1

    def margin(self, onset: int) -> float:
        """Return by how many nats a failed throttle explains what happened since a block better than any sensor does.

        `onset`: the first block of the fault, counted since the start. Returns float: 0, which decides nothing, where
        too little was seen before; minus infinity where neither explains it.
        """
        first = max(onset - (self._count - len(self._kept)), 0)
        known = np.array(self._kept).reshape(len(self._kept), -1)
        before, since = known[max(first - round(_BEFORE_S / self._block_s), 0) : first], known[first:]
        if len(before) < _LEAST_BEFORE_S / self._block_s or len(since) < self._rows:
            return 0.0
        before, since = before - before.mean(axis=0), since - before.mean(axis=0)
        left = [self._of_left(self._steps(before), self._steps(since), sensor) for sensor in self._rho]
        return min(self._of_nx(before, since), *left)

    def _steps(self, blocks: FloatArray) -> FloatArray:
        count = len(blocks) // self._rows
        return np.asarray(blocks[: count * self._rows].reshape(count, self._rows, -1).mean(axis=1))

    def _of_nx(self, before: FloatArray, since: FloatArray) -> float:
        """Return the margin over a wrong nx."""
        wind_kt = max(float(np.std(np.cumsum(before[:, 0]))), _LEAST_WIND_KT)
        seen, off = np.cumsum(since[:, :2], axis=0)[self._rows - 1 :: self._rows].T
        wrong = -KT_S_PER_G * self._per_step * self._block_s * off
        times_s, lasting = self._times(len(seen), _WIND_S)
        wind = wind_kt**2 * (lasting + 1.0)  # and what it was at the onset
        wind += np.outer(_DRIFT_KT_S * times_s, _DRIFT_KT_S * times_s)
        wind += np.outer(_NX_KNOWN_TO * wrong, _NX_KNOWN_TO * wrong)
        misfit = _misfit(seen, wind)
        if misfit > _MISFIT * len(seen) or np.any(np.abs(seen) > _FAR * np.sqrt(np.diag(wind))):
            return -np.inf
        return 0.5 * (_misfit(seen - wrong, wind) - misfit)

    def _of_left(self, before: FloatArray, since: FloatArray, rho: FloatArray) -> float:
        """Return the margin over a sensor, by what is left."""
        _, lasting = self._times(len(since), _LEFT_S)
        margin = 0.0
        for seen, usual, ratio in zip(since[:, 2:].T, before[:, 2:].T, rho, strict=True):
            wrong = ratio * since[:, 1]
            noise = max(float(np.std(usual)), _LEAST_LEFT) ** 2 * lasting
            noise += np.outer(_KNOWN_TO * wrong, _KNOWN_TO * wrong)
            margin += 0.5 * (_misfit(seen - wrong, noise) - _misfit(seen, noise))
        return margin

    def _times(self, count: int, lasts_s: float) -> tuple[FloatArray, FloatArray]:
        """Return the time of every step, and how alike noise is between two of them."""
        times_s = self._rows * self._block_s * np.arange(1, count + 1)
        return np.asarray(times_s), np.asarray(np.exp(-np.abs(np.subtract.outer(times_s, times_s)) / lasts_s))


def _misfit(values: FloatArray, covariance: FloatArray) -> float:
    return float(values @ np.linalg.solve(covariance, values))

"""A throttle told from a wrong nx, by the airspeed, which no force enters.

Both are a forward acceleration that drag doesn't explain. In still air the airspeed changes by

    V' = g ((nx - sin theta) cos alpha cos beta + (ny + sin phi cos theta) sin beta
            + (cos phi cos theta - nz) sin alpha cos beta),

whatever the engine does; and what is left of it is wind. So since the fault began

    E = V - integral of V' by accelerometers

has wandered as wind does if the throttle failed, and by what the throttle seems to be off, integrated, if nx did. Wind
comes back within seconds and that grows, so time decides. The margin is the logarithm of the likelihood ratio, in nats,
wind being a first-order Gauss-Markov process of the size that it had in the minute before. Where E wanders as no wind
does, the airspeed may be wrong itself, and nothing is told.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping
from math import ceil

import numpy as np

from gtmbench.values.channels import FT_S_PER_KT, G_FT_S2
from gtmbench.values.record import FloatArray

KT_S_PER_G = G_FT_S2 / FT_S_PER_KT
_STEP_S = 0.5  # between two values that are compared
_BEFORE_S, _LEAST_BEFORE_S, _MOST_S = 60.0, 30.0, 120.0  # the minute before, and how long a fault is looked at
_WIND_S = 4.0  # how long wind lasts
_LEAST_WIND_KT = 1.0
_DRIFT_KT_S = 0.1  # how far E's slope of a minute may be from the next one's
_KNOWN_TO = 0.1  # of what nx is off by
_MISFIT, _FAR = 2.0, 3.5  # of E a value, and deviations of its farthest: more is no wind


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


class AirspeedHistory:
    """What the airspeed did beside its accelerometers, and what nx would have made of it, by blocks.

    Parameters
    ----------
    block_s : float
    """

    def __init__(self, block_s: float) -> None:
        self._rows = max(round(_STEP_S / block_s), 1)  # blocks a step
        self._step_s = self._rows * block_s
        self._block_s, self.count = block_s, 0
        steps = ceil((_BEFORE_S + _MOST_S) / block_s)
        self._kept: deque[tuple[float, float]] = deque(maxlen=steps)

    def push(self, wind_kt: float, unexplained_g: float) -> None:
        """Take a block: by how much E grew, and the forward acceleration that is put down to the throttle."""
        self._kept.append((wind_kt, unexplained_g))
        self.count += 1

    def margin(self, onset: int) -> float:
        """Return by how many nats a failed throttle explains the airspeed since a block better than a wrong nx.

        Parameters
        ----------
        onset : int
            The first block of the fault, counted since the start.

        Returns
        -------
        float
            0, which decides nothing, where too little was seen before; minus infinity where neither explains it.
        """
        first = max(onset - (self.count - len(self._kept)), 0)
        known = np.array(self._kept).reshape(-1, 2)
        before, since = known[max(first - round(_BEFORE_S / self._block_s), 0) : first], known[first:]
        if len(before) < _LEAST_BEFORE_S / self._block_s or len(since) < self._rows:
            return 0.0
        usual = before.mean(axis=0)
        wandered = np.cumsum(before[:, 0] - usual[0])
        wind_kt = max(float(np.std(wandered)), _LEAST_WIND_KT)
        grown = np.cumsum(since - usual, axis=0)[self._rows - 1 :: self._rows]
        seen, wrong = grown[:, 0], -KT_S_PER_G * self._block_s * grown[:, 1]
        times_s = self._step_s * np.arange(1, len(seen) + 1)
        apart_s = np.abs(np.subtract.outer(times_s, times_s))
        wind = wind_kt**2 * (np.exp(-apart_s / _WIND_S) + 1.0)  # and what it was at the onset
        wind += np.outer(_DRIFT_KT_S * times_s, _DRIFT_KT_S * times_s)
        told = np.outer(_KNOWN_TO * wrong, _KNOWN_TO * wrong)
        misfit = _misfit(seen, wind + told)
        if misfit > _MISFIT * len(seen) or np.any(np.abs(seen) > _FAR * np.sqrt(np.diag(wind + told))):
            return -np.inf
        return 0.5 * (_misfit(seen - wrong, wind + told) - misfit)


def _misfit(values: FloatArray, covariance: FloatArray) -> float:
    return float(values @ np.linalg.solve(covariance, values))

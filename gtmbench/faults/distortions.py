"""What sensors make of a signal: formulas that faults and healthy imperfections share."""

from __future__ import annotations

import math

import numpy as np

from gtmbench.clock import FloatArray


def rate_limited(values: FloatArray, step: float, start: float) -> tuple[FloatArray, float]:
    """Return y_b(k) = y_b(k-1) + clip(y(k) - y_b(k-1), +-step), from y_b(-1) = start, and its last value.

    NaN stays and is passed over; a start that is NaN lets the first value pass.

    >>> rate_limited(np.array([0.0, 3.0, 3.0]), 2.0, 0.0)
    (array([0., 2., 3.]), 3.0)
    """
    at = start
    limited = []
    for y in values.tolist():
        move = y - at
        if -step <= move <= step:
            at = y
        elif move == move:  # it is a number
            at = at + step if move > 0.0 else at - step
        elif y == y:  # the first value that is there
            at = y
        else:
            limited.append(y)
            continue
        limited.append(at)
    return np.array(limited), at


def lagged(values: FloatArray, lag_s: float, sample_period_s: float) -> FloatArray:
    """Return a signal behind a first-order lag tau y' + y = u, in rest at the first sample.

    The signal runs straight from sample to sample, and on these ramps (so on held signals, too) the solution is exact:
    with a = exp(-Ts/tau) and g = (1 - a) tau/Ts,

        y(k) = a y(k-1) + (1 - g) u(k) + (g - a) u(k-1).

    Holding u(k-1) over the step instead would add half a sample of delay, as much as a lag of 5 ms does at 100 Hz.
    Missing samples are passed over.

    >>> lagged(np.arange(4.0), 1e-4, 1.0).round(4)
    array([0.    , 0.9999, 1.9999, 2.9999])
    """
    from scipy.signal import lfilter

    there = np.isfinite(values)
    behind = values.copy()
    if there.any():
        kept = values[there]
        a = math.exp(-sample_period_s / lag_s)
        g = -math.expm1(-sample_period_s / lag_s) * lag_s / sample_period_s
        # the filter starts from zero, and so at rest, when it sees what has changed since the first sample
        behind[there] = kept[0] + lfilter([1.0 - g, g - a], [1.0, -a], kept - kept[0])
    return behind


def quantised(values: FloatArray, quantum: float) -> FloatArray:
    """Return values rounded to whole multiples of a quantum.

    >>> quantised(np.array([-0.2, 0.3, 0.9]), 0.5)
    array([0. , 0.5, 1. ])
    """
    return np.asarray(np.rint(values / quantum) * quantum + 0.0)  # a sensor doesn't read -0


def random_walk(draws: FloatArray, gain: float, sample_period_s: float) -> FloatArray:
    """Return a random walk from 0, of deviation gain sqrt(t), from a standard normal draw a sample, the first unused.

    >>> random_walk(np.ones(3), 2.0, 0.25)
    array([0., 1., 2.])
    """
    steps = draws.copy()
    steps[:1] = 0.0  # no time has passed at the first sample
    return np.asarray(gain * math.sqrt(sample_period_s) * np.cumsum(steps))

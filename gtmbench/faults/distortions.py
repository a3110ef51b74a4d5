"""What the kinds of faults make of a signal: the formulas that injection (bench) and diagnosis (method) share."""

from __future__ import annotations

import math

import numpy as np

from gtmbench.clock import FloatArray


def deadzone(values: FloatArray, half_width: float) -> FloatArray:
    """Return sign(y) max(|y| - half_width, 0).

    >>> deadzone(np.array([-3.0, 0.5, 3.0]), 1.0)
    array([-2.,  0.,  2.])
    """
    return values - np.clip(values, -half_width, half_width)


def saturation(values: FloatArray, limit: float) -> FloatArray:
    """Return y held within +-limit.

    >>> saturation(np.array([-3.0, 0.5, 3.0]), 1.0)
    array([-1. ,  0.5,  1. ])
    """
    return np.clip(values, -limit, limit)


def rate_saturation(values: FloatArray, step: float, start: float) -> FloatArray:
    """Return y_b(k) = y_b(k-1) + clip(y(k) - y_b(k-1), +-step), from y_b(-1) = start; NaN stays and is passed over.

    >>> rate_saturation(np.array([0.0, 3.0, 3.0]), 2.0, 0.0)
    array([0., 2., 3.])
    """
    at = start
    limited = []
    for y in values.tolist():
        if not math.isnan(y):
            at = y if math.isnan(at) or abs(y - at) <= step else at + math.copysign(step, y - at)
            limited.append(at)
        else:
            limited.append(y)
    return np.array(limited)

"""Intervals that hold the parameters of a fault with a probability of 95 %, a model's error included."""

from __future__ import annotations

import math

import numpy as np

from gtmbench.detectors.isolation.fitter import Fit
from gtmbench.faults.registry import shape_of
from gtmbench.values.record import FloatArray, Span

TAIL = 0.025  # of the probability, on either side of an interval
QUANTILE = 1.96  # deviations on either side: 95 % of a normal distribution
MODEL_ERROR = 1.3  # times the error by residuals of unit noise, as `experiments/believed_names.py` finds it


def intervals_of(fit: Fit) -> dict[str, Span]:
    """Return the interval of each parameter of a fit that the rows tell; a search that ended at a bound has one side.

    An error of +inf says that the parameter is at least its value, one of -inf that it is at most that.
    """
    shape = shape_of(fit.kind)
    more = 1.0 if shape is None else shape.spread
    return {
        name: interval(fit.parameters[name], more * error)
        for name, error in fit.errors().items()
        if not math.isnan(error)
    }


def rows_between(deviances: FloatArray, kappa: float) -> tuple[int, int, int]:
    """Return the row before which a change came in 2.5, 50 and 97.5 %, by -2 log likelihood D of each row.

    With a flat prior p ~ exp(-(D - min D) / (2 kappa)), kappa for the model's error.

    >>> rows_between(np.array([90.0, 60.0, 0.0, 0.0, 80.0]), 1.0)
    (2, 2, 3)
    """
    share = np.cumsum(np.exp(-0.5 * (deviances - deviances.min()) / kappa))
    low, row, high = np.searchsorted(share / share[-1], [TAIL, 0.5, 1.0 - TAIL]).tolist()
    return low, row, high


def interval(value: float, error: float) -> Span:
    """Return the interval about a value, by its standard error by residuals of unit noise.

    >>> interval(2.0, 0.0), interval(2.0, math.inf), interval(2.0, -math.inf)
    ((2.0, 2.0), (2.0, inf), (0.0, 2.0))
    """
    if math.isinf(error):
        return (float(value), math.inf) if error > 0.0 else (0.0, float(value))
    half = QUANTILE * MODEL_ERROR * error
    return (float(value - half), float(value + half))

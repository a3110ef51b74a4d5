"""What a detector would find at other thresholds: the receiver operating characteristic, from scores' peaks.

A record alarms at a threshold if the greatest score in it is above, so peaks of healthy and broken records, over the
detector's own threshold, tell for every factor what share of trials would be detected, and in what share of healthy
records there would be an alarm; of records of T hours that share is 1 - exp(-rate T). It is exact for scores that are
held against a threshold sample by sample. What happens in time isn't in a peak: a score that is above from the start
isn't armed, and here counts. The rows of a campaign have the delays at some factors, too: what a sooner alarm costs.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gtmbench.values.record import FloatArray

_MOST = 200  # points of a curve


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Detection against false alarms, over factors on the thresholds, from the greatest on; 1 is always among them.

    Attributes
    ----------
    factors : shape (points,)
    alarmed : shape (points,)
        Share of healthy records.
    per_hour : shape (points,)
        The rate of false alarms which that comes to; infinite where all alarm.
    detected : shape (points,)
        Share of trials.
    """

    factors: FloatArray
    alarmed: FloatArray
    per_hour: FloatArray
    detected: FloatArray

    @property
    def own(self) -> int:
        """Which point is that of the detector's own thresholds."""
        return int(np.flatnonzero(self.factors == 1.0)[0])


def characteristic(healthy: FloatArray, hours: float, broken: FloatArray) -> Curve | None:
    """Return a detector's curve; None where it shows no scores.

    Parameters
    ----------
    healthy, broken : shape (records,), shape (trials,)
        Peaks over the threshold; NaN where there is no score.
    hours : float
        Watched of a healthy record, in the mean.

    Examples
    --------
    >>> curve = characteristic(np.array([0.4, 0.8]), 0.1, np.array([0.5, 3.0]))
    >>> curve.factors.tolist(), curve.alarmed.tolist(), curve.detected.tolist()
    ([3.0, 1.0, 0.8, 0.5, 0.4], [0.0, 0.0, 0.0, 0.5, 0.5], [0.0, 0.5, 0.5, 0.5, 1.0])
    """
    quiet, loud = np.sort(healthy[np.isfinite(healthy)]), np.sort(broken[np.isfinite(broken)])
    if not len(quiet) or not len(loud) or not quiet[-1] > 0.0 or hours <= 0.0:
        return None
    factors = np.unique([*quiet, *loud])[::-1]
    factors = factors[np.unique(np.linspace(0, len(factors) - 1, _MOST).astype(int))]
    factors = np.unique([*factors, 1.0])[::-1]
    alarmed = 1.0 - np.searchsorted(quiet, factors, side="right") / len(quiet)
    detected = 1.0 - np.searchsorted(loud, factors, side="right") / len(loud)
    with np.errstate(divide="ignore"):
        per_hour = -np.log1p(-alarmed) / hours
    return Curve(factors=factors, alarmed=alarmed, per_hour=np.abs(per_hour), detected=detected)


@dataclass(frozen=True, kw_only=True, eq=False)
class Price:
    """Delay against false alarms, at some factors on the thresholds, the smallest first.

    Attributes
    ----------
    factors : shape (points,)
    per_hour : shape (points,)
        As of a `Curve`.
    delays_s : shape (points,)
        By when half of all faults are detected; infinite where fewer ever are.
    """

    factors: FloatArray
    per_hour: FloatArray
    delays_s: FloatArray


def price(healthy: FloatArray, hours: float, delays_s: Mapping[float, FloatArray]) -> Price | None:
    """Return what a detector's delays cost in false alarms; None where nobody asked how they would be.

    Parameters
    ----------
    healthy : shape (records,)
        Peaks over the threshold; NaN where there is no score.
    hours : float
        Watched of a healthy record, in the mean.
    delays_s : mapping of factor to array of shape (trials,)
        NaN where a fault isn't detected.

    Examples
    --------
    >>> found = price(np.array([0.4, 0.8]), 0.1, {0.5: np.array([0.2, 1.0, np.nan]), 1.0: np.array([0.3, 3.0, np.nan])})
    >>> found.per_hour.round(1).tolist(), found.delays_s.tolist()
    ([6.9, 0.0], [1.0, 3.0])
    """
    quiet = np.sort(healthy[np.isfinite(healthy)])
    if not len(quiet) or hours <= 0.0 or all(np.isnan(delays).all() for delays in delays_s.values()):
        return None
    factors = np.array(sorted(delays_s))
    alarmed = 1.0 - np.searchsorted(quiet, factors, side="right") / len(quiet)
    with np.errstate(divide="ignore"):
        per_hour = np.abs(np.log1p(-alarmed)) / hours
    halves = [np.quantile(np.nan_to_num(delays_s[factor], nan=np.inf), 0.5, method="higher") for factor in factors]
    return Price(factors=factors, per_hour=per_hour, delays_s=np.array(halves))

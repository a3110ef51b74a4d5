"""What a detector's scores owe to the luck of its calibration: other flights would have set other thresholds.

Calibration draws its thresholds anew from its flights, with replacement, and says within how many times 95 % of them
stay (`detectors/statistics/thresholds.py`). A campaign's rows have every delay at some factors on the thresholds. So it
can be read off what would have become of delays, false alarms and places, had all thresholds of a detector been lower
or higher by that much. That is more than luck does: thresholds of several tests don't all move together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from gtmbench.study.scores.intervals import IntArray
from gtmbench.study.scores.ranking import Comparison, Rank, moved_rank
from gtmbench.values.record import FloatArray


@dataclass(frozen=True, kw_only=True)
class ScoreLuck:
    """Figures with all thresholds of a detector as low, and as high, as other calibrations would have set them.

    Attributes
    ----------
    within : float
        Thresholds over `within`, and times it: 95 % of them stay in between.
    median_s : (float, float)
        By when half of all faults are detected; infinite where fewer are.
    detected : (int, int)
        Trials, with the higher thresholds and with the lower ones.
    alarmed : (int, int)
        Healthy records with an alarm, with the higher thresholds and with the lower ones.
    place : Rank or None
        From the best place with the lower thresholds to the worst with the higher ones, the other detectors' as they
        are; None of a single one.
    """

    within: float
    median_s: tuple[float, float]
    detected: tuple[int, int]
    alarmed: tuple[int, int]
    place: Rank | None = None


def delays_at(ladder: Mapping[float, FloatArray], factor: float) -> FloatArray:
    """Return delays at a factor on the thresholds, from those at some; infinite where a fault isn't detected.

    Between two factors it is interpolated, in the logarithm of the factor. A fault that is detected at the lower one
    alone isn't, between them; beyond the last factors it is as at these.

    Parameters
    ----------
    ladder : mapping of factor to array of shape (trials,)
        NaN or infinity where a fault isn't detected.
    factor : float

    Examples
    --------
    >>> delays_at({1.0: np.array([0.2, 3.0]), 1.2: np.array([0.4, np.nan])}, 1.1).round(2).tolist()
    [0.3, inf]
    """
    factors = np.array(sorted(ladder))
    place = float(np.interp(np.log(factor), np.log(factors), np.arange(len(factors))))
    below, share = int(place), place - int(place)
    low_s, high_s = (
        np.nan_to_num(ladder[float(factors[min(i, len(factors) - 1)])], nan=np.inf) for i in (below, below + 1)
    )
    if share == 0.0:
        return np.asarray(low_s)
    between_s = np.full(len(low_s), np.inf)
    both = np.isfinite(low_s) & np.isfinite(high_s)
    between_s[both] = (1.0 - share) * low_s[both] + share * high_s[both]
    return between_s


def luck_of(within: float, ladder: Mapping[float, FloatArray], healthy: FloatArray) -> ScoreLuck | None:
    """Return what a detector's scores owe to luck; None where it wasn't asked what delays would be.

    Parameters
    ----------
    within : float
        Times that 95 % of its thresholds stay within.
    ladder : mapping of factor to array of shape (trials,)
        Delays at factors on the thresholds; NaN where a fault isn't detected.
    healthy : shape (records,)
        Greatest scores over their thresholds of healthy records.
    """
    if all(np.isnan(delays_s).all() for delays_s in ladder.values()) or not np.isfinite(within):
        return None
    ends = [delays_at(ladder, factor) for factor in (1.0 / within, within)]
    lower_s, higher_s = (float(np.quantile(delays_s, 0.5, method="higher")) for delays_s in ends)
    fewer, more = (int(np.isfinite(delays_s).sum()) for delays_s in reversed(ends))
    quiet, loud = (int(np.sum(healthy > factor)) for factor in (within, 1.0 / within))
    return ScoreLuck(within=within, median_s=(lower_s, higher_s), detected=(fewer, more), alarmed=(quiet, loud))


def place_of(
    name: str,
    rank: Rank,
    delays_s: Mapping[str, FloatArray],
    ends_s: tuple[FloatArray, FloatArray],
    flights: IntArray,
    pairs: tuple[Comparison, ...],
) -> Rank:
    """Return the places that a detector may have by luck, its own among them.

    Parameters
    ----------
    name : str
    rank : Rank
        Its own.
    delays_s : mapping of detector to array of shape (trials,)
    ends_s : (shape (trials,), shape (trials,))
        Its delays with lower and with higher thresholds.
    flights : shape (trials,)
    pairs : tuple of Comparison
    """
    lower, higher = (moved_rank(name, {**delays_s, name: moved_s}, flights, len(pairs)) for moved_s in ends_s)
    return Rank(detector=name, best=min(rank.best, lower.best), worst=max(rank.worst, higher.worst))

"""What a detector would find at other thresholds, by luck of its calibration too; and the smallest fault that it sees.

A record alarms at a threshold if the greatest score in it is above, so peaks of healthy and broken records, over the
detector's own threshold, tell for every factor what share of trials would be detected, and in what share of healthy
records there would be an alarm; of records of T hours that share is 1 - exp(-rate T). It is exact for scores that are
held against a threshold sample by sample. What happens in time isn't in a peak: a score that is above from the start
isn't armed, and here counts. The rows of a campaign have the delays at some factors, too: what a sooner alarm costs.

Calibration draws its thresholds anew from its flights, with replacement, and says within how many times 95 % of them
stay (`detectors/statistics/thresholds.py`). A campaign's rows have every delay at some factors on the thresholds. So it
can be read off what would have become of delays, false alarms and places, had all thresholds of a detector been lower
or higher by that much. That is more than luck does: thresholds of several tests don't all move together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.study.scores.intervals import Estimate, IntArray, Share, quantile, share
from gtmbench.study.scores.ranking import Comparison, Rank, moved_rank
from gtmbench.values.record import FloatArray

if TYPE_CHECKING:
    import pandas as pd


_MOST = 200  # points of a curve


@dataclass(frozen=True, kw_only=True, eq=False)
class Curve:
    """Detection against false alarms, over factors on the thresholds, from the greatest on; 1 is always among them."""

    factors: FloatArray  # shape (points,)
    alarmed: FloatArray  # shape (points,); share of healthy records
    per_hour: FloatArray  # shape (points,); the rate of false alarms which that comes to; infinite where all alarm
    detected: FloatArray  # shape (points,); share of trials

    @property
    def own(self) -> int:
        """Which point is that of the detector's own thresholds."""
        return int(np.flatnonzero(self.factors == 1.0)[0])


def characteristic(healthy: FloatArray, hours: float, broken: FloatArray) -> Curve | None:
    """Return a detector's curve; None where it shows no scores.

    `healthy`, `broken`: shape (records,), shape (trials,); peaks over the threshold; NaN where there is no score.
    `hours`: watched of a healthy record, in the mean.

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
    """Delay against false alarms, at some factors on the thresholds, the smallest first."""

    factors: FloatArray  # shape (points,)
    per_hour: FloatArray  # shape (points,); as of a `Curve`
    delays_s: FloatArray  # shape (points,); by when half of all faults are detected; infinite where fewer ever are


def price(healthy: FloatArray, hours: float, delays_s: Mapping[float, FloatArray]) -> Price | None:
    """Return what a detector's delays cost in false alarms; None where nobody asked how they would be.

    `healthy`: shape (records,); peaks over the threshold; NaN where there is no score. `hours`: watched of a healthy
    record, in the mean. `delays_s`: mapping of factor to array of shape (trials,); NaN where a fault isn't detected.

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


@dataclass(frozen=True, kw_only=True)
class ScoreLuck:
    """Figures with all thresholds of a detector as low, and as high, as other calibrations would have set them."""

    within: float  # thresholds over `within`, and times it: 95 % of them stay in between
    median_s: tuple[float, float]  # by when half of all faults are detected; infinite where fewer are
    detected: tuple[int, int]  # trials, with the higher thresholds and with the lower ones
    alarmed: tuple[int, int]  # healthy records with an alarm, with the higher thresholds and with the lower ones
    # place: from the best place with the lower thresholds to the worst with the higher ones, the other detectors' as
    # they are; None of a single one
    place: Rank | None = None


def delays_at(ladder: Mapping[float, FloatArray], factor: float) -> FloatArray:
    """Return delays at a factor on the thresholds, from those at some; infinite where a fault isn't detected.

    Between two factors it is interpolated, in the logarithm of the factor. A fault that is detected at the lower one
    alone isn't, between them; beyond the last factors it is as at these.

    `ladder`: mapping of factor to array of shape (trials,); NaN or infinity where a fault isn't detected.

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

    `within`: times that 95 % of its thresholds stay within. `ladder`: mapping of factor to array of shape (trials,);
    delays at factors on the thresholds; NaN where a fault isn't detected. `healthy`: shape (records,); greatest scores
    over their thresholds of healthy records.
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

    `rank`: its own. `ends_s`: (shape (trials,), shape (trials,)); its delays with lower and with higher thresholds.
    """
    lower, higher = (moved_rank(name, {**delays_s, name: moved_s}, flights, len(pairs)) for moved_s in ends_s)
    return Rank(detector=name, best=min(rank.best, lower.best), worst=max(rank.worst, higher.worst))


SHARE = 0.9  # of the searches, one a flight and onset


@dataclass(frozen=True, kw_only=True)
class Smallest:
    """From which severity on a kind of fault of a channel is detected in 90 % of the searches."""

    fault: str
    channel: str
    parameter: str
    # share_of: of what severities are shares: "rms", "peak", "slew"; None: they are figures in the parameter's unit
    share_of: str | None
    mildest: float  # mildest, severest: what was searched between
    severest: float
    found: Share  # of the searches, those that found any; a detector that alarms without the fault isn't asked
    severity: Estimate  # infinite: beyond the severest; at the mildest: there, or below. So its bounds, too

    @property
    def is_beyond(self) -> bool:
        """Whether even the severest isn't detected so often."""
        return not np.isfinite(self.severity.value)


def smallest(searches: pd.DataFrame) -> tuple[Smallest, ...]:
    """Return them, a kind and channel each, in the order in which they come.

    `searches`: a detector's rows of searches, with a column `flight`, those that couldn't be asked left out.
    """
    keys = ["fault", "channel", "severity_name", "severity_of", "mildest", "severest"]
    return tuple(_smallest(own) for _, own in searches.groupby(keys, sort=False, dropna=False))


def _smallest(rows: pd.DataFrame) -> Smallest:
    first = rows.iloc[0]
    mildest, severest = float(first["mildest"]), float(first["severest"])
    turn = 1.0 if severest > mildest else -1.0  # a limit is severer the smaller it is
    flights, found = rows["flight"].to_numpy(), rows["smallest"].notna().to_numpy()
    severities = np.where(found, turn * rows["smallest"].to_numpy(dtype=float, na_value=np.nan), np.inf)
    turned = quantile(severities, SHARE, flights)

    def back(value: float | None) -> float | None:
        return None if value is None else turn * value if np.isfinite(value) else np.inf

    value = back(turned.value)
    assert value is not None
    return Smallest(
        fault=str(first["fault"]),
        channel=str(first["channel"]),
        parameter=str(first["severity_name"]),
        share_of=str(first["severity_of"]) if isinstance(first["severity_of"], str) else None,
        mildest=mildest,
        severest=severest,
        found=share(found, flights),
        severity=Estimate(value=value, low=back(turned.low), high=back(turned.high)),
    )

"""What a campaign's rows say of every detector, and of each against the others; the words stand in `study/score.py`.

Two rules come before all figures:

- *No score without quiet.* A detector whose false alarms are certainly more than the target, by the lower bound of
  their rate on healthy records, gets none: whoever alarms all the time detects everything.
- *Who fails has missed.* A trial that a detector broke down in counts as missed by it; one that broke down for every
  detector (it couldn't be flown, or broken so) counts for none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.errors import InputError
from gtmbench.study.campaign.rows import LADDER
from gtmbench.study.scores.curves import (
    Curve,
    Price,
    ScoreLuck,
    Smallest,
    characteristic,
    delays_at,
    luck_of,
    place_of,
    price,
    smallest,
)
from gtmbench.study.scores.intervals import Estimate, Rate, Share, mean, quantile, rate, share
from gtmbench.study.scores.ranking import Comparison, Rank, compared, ranks

if TYPE_CHECKING:
    import pandas as pd

TARGET_PER_HOUR = 1.0  # where a campaign calibrates for none
DEADLINE_S = 10.0  # unless somebody states another one
CANT_TELL, MISSED, NO_KIND = "can't tell", "missed", "no kind"
# what tells flights apart, and all the columns that scores stand on
FLIGHT = ("aircraft", "excitation", "altitude_ft", "tas_kt", "duration_s", "closed_loop", "seed")
READ = (
    *("task", *FLIGHT, "noise_seed", "detector", "fault", "channel", "error", "false_alarms", "armed_hours"),
    *("detected", "detection_delay_s", "look_ahead_s", "peak_ratio", "isolated", "named_wrong", "axis_right"),
    *("sensor", "kind", "kind_right", "severity_name", "severity_of", "mildest", "severest", "smallest"),
    *("window_s", *LADDER.values()),
)


@dataclass(frozen=True, kw_only=True)
class Delays:
    """Of the trials that were detected, in seconds since the onset, look-ahead and windows counted."""

    mean: Estimate  # mean, median, most: most: 95 % of them are no longer
    median: Estimate
    most: Estimate
    worst: float
    look_ahead: float  # the part of every delay that the detector waits for samples to come
    # windows: the part, in the mean, in which windows fill: from the onset or a window's beginning, whichever is later,
    # to the alarm, less the look-ahead. None of a detector that doesn't say how far it looks back
    windows: float | None


@dataclass(frozen=True, kw_only=True)
class Naming:
    """Shares of all trials: the four that add up to them, and two that stand beside."""

    right: Share  # right, wrong, undecided, missed: right and wrong are names of one sensor
    wrong: Share
    undecided: Share
    missed: Share
    axis_right: Share  # all that it leaves possible lies on the axis that failed
    kind_right: Share  # physically the kind of fault that was injected


@dataclass(frozen=True, kw_only=True)
class Merits:
    """What a detector made of some trials."""

    trials: int  # trials, flights, failed: failed: broken down, and counted as missed
    flights: int
    failed: int
    detected: Share  # detected, in_time: in time: by the deadline
    in_time: Share
    delays: Delays | None  # None where nothing was detected
    naming: Naming | None  # None where the detector names no sensors, or wasn't asked


@dataclass(frozen=True, kw_only=True)
class Confusion:
    """How often what was told of what was."""

    injected: tuple[str, ...]  # injected, told: what rows and columns are
    told: tuple[str, ...]
    counts: tuple[tuple[int, ...], ...]  # a row each of `injected`


@dataclass(frozen=True, kw_only=True)
class DetectorScores:
    """A detector's scores."""

    name: str
    false_alarms: Rate  # on healthy records
    healthy_records: int
    no_score: str = ""  # why there are none; then all that follows is None or empty
    merits: Merits | None = None  # of all trials
    faults: Mapping[str, Merits] = field(default_factory=dict)  # faults, channels: of each kind and of each channel
    channels: Mapping[str, Merits] = field(default_factory=dict)
    sensors: Confusion | None = None
    kinds: Confusion | None = None
    curve: Curve | None = None  # None of a detector that shows no scores
    # price: None of a detector that shows no scores, or where it was only asked whether and when it alarms
    price: Price | None = None
    smallest: tuple[Smallest, ...] = ()
    # luck: of its calibration; None where that wasn't drawn anew, or it was only asked whether and when it alarms
    luck: ScoreLuck | None = None

    @property
    def is_quiet(self) -> bool:
        """Whether there is a score."""
        return not self.no_score


@dataclass(frozen=True, kw_only=True)
class Scores:
    """All of a campaign's."""

    target_per_hour: float
    deadline_s: float
    detectors: tuple[DetectorScores, ...]  # in the campaign's order
    comparisons: tuple[Comparison, ...]  # of every pair of those with a score
    ranks: tuple[Rank, ...]  # of those; best first
    # delays_s: mapping of detector to array of shape (trials,); of those; infinite where one was missed
    delays_s: Mapping[str, np.ndarray] = field(repr=False)


def scored(
    rows: pd.DataFrame,
    *,
    target_per_hour: float = TARGET_PER_HOUR,
    deadline_s: float = DEADLINE_S,
    spreads: Mapping[str, float] = MappingProxyType({}),
) -> Scores:
    """Score a campaign.

    `rows`: as `gb.campaign` returns them. `target_per_hour`: false alarms; who certainly raises more gets no score.
    `deadline_s`: by when a fault is to be detected. `spreads`: within how many times other calibrations set 95 % of its
    thresholds.

    >>> import pandas as pd
    >>> from gtmbench.study.campaign.rows import table_of
    >>> healthy = [{"seed": seed, "detector": "C", "armed_hours": 0.1, "false_alarms": 0} for seed in range(8)]
    >>> broken = [
    ...     {"seed": seed, "detector": "C", "fault": "jam", "channel": "p", "detected": True,
    ...      "detection_delay_s": 0.1 * seed, "look_ahead_s": 0.05, "peak_ratio": 3.0}
    ...     for seed in range(8)
    ... ]
    >>> (found,) = scored(table_of(healthy + broken).to_pandas()).detectors
    >>> found.merits.detected.value, round(found.merits.detected.low, 2), round(found.merits.delays.median.value, 3)
    (1.0, 0.63, 0.3)
    >>> found.false_alarms.value, round(found.false_alarms.high, 1)
    (0.0, 4.6)
    """
    if not len(rows):
        raise InputError("there are no rows to score: nothing of it is finished; go on with --resume")
    missing = next((name for name in READ if name not in rows), None)
    if missing is not None:
        raise InputError(
            f"the rows have no column '{missing}', so another version made them; run the campaign anew, "
            "into another folder"
        )
    table = _scoreable(rows)
    found = [
        _detector(str(name), own, target_per_hour, deadline_s, spreads.get(str(name)))
        for name, own in table.groupby("detector", sort=False)
    ]
    quiet = [one.name for one in found if one.is_quiet]
    paired = _paired(table[_is_trial(table)], quiet)
    delays_s = {name: paired[name].to_numpy() for name in quiet} if len(paired) else {}
    flights = paired.index.get_level_values("flight").to_numpy()
    pairs = compared(delays_s, flights) if len(delays_s) > 1 else ()
    places = sorted(ranks(list(delays_s), pairs), key=lambda rank: (rank.best + rank.worst, rank.best))
    found = [_with_places(one, places, table, delays_s, flights, pairs) for one in found]
    return Scores(
        target_per_hour=target_per_hour,
        deadline_s=deadline_s,
        detectors=tuple(found),
        comparisons=pairs,
        ranks=tuple(places),
        delays_s=delays_s,
    )


def _with_places(
    one: DetectorScores,
    places: Sequence[Rank],
    rows: pd.DataFrame,
    delays_s: Mapping[str, np.ndarray],
    flights: np.ndarray,
    pairs: tuple[Comparison, ...],
) -> DetectorScores:
    """Return a detector's scores with the places that it may have by the luck of its calibration."""
    rank = next((rank for rank in places if rank.detector == one.name), None)
    if one.luck is None or rank is None or len(delays_s) < 2:
        return one
    trials = rows[_is_trial(rows)]
    at = {
        factor: _paired(trials.assign(detection_delay_s=trials[name]), list(delays_s))[one.name].to_numpy()
        for factor, name in LADDER.items()
    }
    ends_s = delays_at(at, 1.0 / one.luck.within), delays_at(at, one.luck.within)
    return replace(one, luck=replace(one.luck, place=place_of(one.name, rank, delays_s, ends_s, flights, pairs)))


def _scoreable(rows: pd.DataFrame) -> pd.DataFrame:
    """Give flights and trials numbers, and leave out the trials that failed for every detector."""
    numbered = rows.assign(
        flight=rows.groupby(list(FLIGHT), dropna=False, sort=False).ngroup(),
        trial=rows.groupby(["task", "noise_seed", "detector"], dropna=False, sort=False).cumcount(),
        failed=rows["error"].notna(),
    )
    everywhere = numbered.groupby(["task", "noise_seed", "trial"], dropna=False)["failed"].transform("all")
    return numbered[~everywhere]


def _is_trial(rows: pd.DataFrame) -> pd.Series:
    return rows["fault"].notna() & rows["mildest"].isna()


def _paired(trials: pd.DataFrame, detectors: Sequence[str]) -> pd.DataFrame:
    """Return delays, a row a trial and a column a detector, infinite where missed; trials that all of them had."""
    own = trials[trials["detector"].isin(detectors)]
    delays = own.assign(delay=own["detection_delay_s"].fillna(np.inf))
    keys = ["flight", "task", "noise_seed", "trial"]
    told = delays.fillna({"task": -1, "noise_seed": -1}).set_index([*keys, "detector"])["delay"]
    return told.unstack().dropna()  # noqa: PD010  a pivot table would aggregate


def _detector(
    name: str, rows: pd.DataFrame, target_per_hour: float, deadline_s: float, within: float | None
) -> DetectorScores:
    healthy = rows[rows["fault"].isna() & ~rows["failed"]]
    hours = healthy["armed_hours"].to_numpy(dtype=float)
    alarms = rate(healthy["false_alarms"].to_numpy(dtype=int), hours, healthy["flight"].to_numpy())
    known = DetectorScores(name=name, false_alarms=alarms, healthy_records=len(healthy))
    if alarms.low > target_per_hour:
        why = f"more than {alarms.low:.2g} false alarms an hour, by the lower bound; {target_per_hour:g} is the target"
        return replace(known, no_score=why)
    trials = rows[_is_trial(rows)]
    if not len(trials):
        return replace(known, smallest=_smallest(rows))
    peaks = healthy["peak_ratio"].to_numpy(dtype=float, na_value=np.nan)
    broken = trials["peak_ratio"].to_numpy(dtype=float, na_value=np.nan)
    hours_each = float(np.mean(hours)) if len(hours) else 0.0
    at_factors = {factor: trials[name].to_numpy(dtype=float, na_value=np.nan) for factor, name in LADDER.items()}
    names = _names(trials)
    return replace(
        known,
        merits=merits(trials, deadline_s),
        faults={str(kind): merits(own, deadline_s) for kind, own in trials.groupby("fault", sort=False)},
        channels={str(channel): merits(own, deadline_s) for channel, own in trials.groupby("channel", sort=False)},
        sensors=_confusion(trials, "channel", "sensor", CANT_TELL) if names else None,
        kinds=_confusion(trials, "fault", "kind", NO_KIND) if names else None,
        curve=characteristic(peaks, hours_each, broken),
        price=price(peaks, hours_each, at_factors),
        smallest=_smallest(rows),
        luck=None if within is None else luck_of(within, at_factors, peaks),
    )


def _smallest(rows: pd.DataFrame) -> tuple[Smallest, ...]:
    return smallest(rows[rows["mildest"].notna() & rows["detected"].notna()])


def merits(trials: pd.DataFrame, deadline_s: float) -> Merits:
    """Return what a detector made of some of its trials."""
    flights = trials["flight"].to_numpy()
    delay_s = trials["detection_delay_s"].to_numpy(dtype=float, na_value=np.nan)
    detected = _true(trials["detected"])
    return Merits(
        trials=len(trials),
        flights=len(np.unique(flights)),
        failed=int(trials["failed"].sum()),
        detected=share(detected, flights),
        in_time=share(detected & (np.nan_to_num(delay_s, nan=np.inf) <= deadline_s + 1e-9), flights),
        delays=_delays(trials[detected], flights[detected]) if detected.any() else None,
        naming=_naming(trials, detected, flights) if _names(trials) else None,
    )


def _delays(found: pd.DataFrame, flights: np.ndarray) -> Delays:
    delay_s, look_ahead_s, window_s = (
        found[name].to_numpy(dtype=float, na_value=np.nan) for name in ("detection_delay_s", "look_ahead_s", "window_s")
    )
    filling_s = np.minimum(np.maximum(delay_s - look_ahead_s, 0.0), window_s)
    return Delays(
        mean=mean(delay_s, flights),
        median=quantile(delay_s, 0.5, flights),
        most=quantile(delay_s, 0.95, flights),
        worst=float(delay_s.max()),
        look_ahead=float(look_ahead_s.max()),
        windows=None if np.isnan(window_s).any() else float(filling_s.mean()),
    )


def _names(trials: pd.DataFrame) -> bool:
    """Whether a detector names sensors, and was asked."""
    return bool(trials["isolated"].notna().any())


def _naming(trials: pd.DataFrame, detected: np.ndarray, flights: np.ndarray) -> Naming:
    right, wrong = _true(trials["isolated"]) & detected, _true(trials["named_wrong"]) & detected
    return Naming(
        right=share(right, flights),
        wrong=share(wrong, flights),
        undecided=share(detected & ~right & ~wrong, flights),
        missed=share(~detected, flights),
        axis_right=share(_true(trials["axis_right"]) & detected, flights),
        kind_right=share(_true(trials["kind_right"]) & detected, flights),
    )


def _true(cells: pd.Series) -> np.ndarray:
    return np.asarray(cells.eq(True).fillna(False), dtype=bool)


def _confusion(trials: pd.DataFrame, injected: str, told: str, nothing: str) -> Confusion:
    """Return what was told of which that failed; of several faults in one record, of the first."""
    said = trials[told].where(trials[told].notna() & (trials[told] != "unknown"), nothing)
    said = said.where(_true(trials["detected"]), MISSED)
    was = tuple(dict.fromkeys(trials[injected]))
    others = sorted({*said} - {*was, nothing, MISSED})
    columns = (*was, *others, nothing, MISSED)
    counts = {key: len(own) for key, own in trials.groupby([trials[injected], said])}
    table = tuple(tuple(counts.get((row, column), 0) for column in columns) for row in was)
    return Confusion(injected=was, told=columns, counts=table)

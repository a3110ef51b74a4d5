"""How a rival's residual becomes a score: whitened or as it is, a statistic over its thresholds, rows as they come."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.bank.parsing import judging_table, thresholds_from, tolerance_from, whitener_from
from gtmbench.detectors.rivals.level import Level
from gtmbench.detectors.statistics.noise import NoiseFollower, followed
from gtmbench.detectors.statistics.statistic import Carried, Given, Statistic, Tolerance, over, tolerance_of
from gtmbench.detectors.statistics.thresholds import Luck, healthy_maxima
from gtmbench.detectors.statistics.whitening import White, Whitener, fit_whitener
from gtmbench.detectors.tables import keys
from gtmbench.record import FloatArray

IntArray = NDArray[np.int_]
_WHITENING_S = 0.3  # the banks'
_AS_IT_IS = Whitener(coefficients=np.ones(1), mean=0.0, deviation=1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Judging:
    """What one residual is judged by.

    Attributes
    ----------
    whitener : Whitener
        One that changes nothing, for a level.
    tolerance : Tolerance
    thresholds : mapping of label to float
    """

    whitener: Whitener = field(repr=False)
    tolerance: Tolerance
    thresholds: Mapping[str, float]

    def table(self) -> dict[str, Any]:
        """Return it as plain values."""
        return judging_table(self.whitener, self.tolerance, self.thresholds)

    @classmethod
    def of(cls, where: str, table: Any, statistic: Statistic, sample_period_s: float) -> Judging:
        """Return that of a table, every key checked."""
        table = keys(where, table, ("whitener", "tolerance", "thresholds"))
        tolerance = tolerance_from(f"{where}.tolerance", table["tolerance"])
        return cls(
            whitener=whitener_from(f"{where}.whitener", table["whitener"]),
            tolerance=tolerance,
            thresholds=thresholds_from(
                f"{where}.thresholds", table["thresholds"], statistic, tolerance, sample_period_s
            ),
        )


def judgings(
    statistic: Statistic,
    learnt: Mapping[str, Sequence[FloatArray]],
    judged: Mapping[str, Sequence[FloatArray]],
    sample_period_s: float,
    rate: float,
) -> tuple[dict[str, Judging], Luck]:
    """Return what residuals are judged by, for a false-alarm rate an hour, as banks are calibrated, and its luck.

    Parameters
    ----------
    statistic : Statistic
    learnt, judged : mapping of output to one array a record
        Residuals of the records that the model stands on, which give the whitening, and of others, which give
        tolerances and thresholds.
    sample_period_s, rate : float
        The rate is shared evenly by all scores.
    """
    order = round(_WHITENING_S / sample_period_s)
    is_level = isinstance(statistic, Level)
    whiteners = {name: _AS_IT_IS if is_level else fit_whitener(parts, order=order) for name, parts in learnt.items()}
    healthy = {
        name: [
            (raw, White.steady(raw) if is_level else followed(whiteners[name], raw, sample_period_s), None)
            for raw in parts
        ]
        for name, parts in judged.items()
    }
    tolerances = {
        name: Tolerance()
        if is_level
        else tolerance_of([white.values for _, white, _ in parts], statistic, sample_period_s)
        for name, parts in healthy.items()
    }
    seen = healthy_maxima(statistic, healthy, tolerances, sample_period_s)
    thresholds = seen.thresholds(rate)
    by = {
        name: Judging(whitener=whiteners[name], tolerance=tolerances[name], thresholds=thresholds[name])
        for name in learnt
    }
    return by, seen.luck(rate)


class Judge:
    """The score of one residual, as its rows come in: the greatest of a statistic's tests over their thresholds.

    It keeps the samples that the statistic looks back at; missing ones are passed over. The noise is learnt on what
    comes in, as a bank's is.

    Parameters
    ----------
    statistic : Statistic
    judging : Judging
    sample_period_s : float
    """

    def __init__(self, statistic: Statistic, judging: Judging, sample_period_s: float) -> None:
        self._statistic, self._judging, self._period_s = statistic, judging, sample_period_s
        is_level = isinstance(statistic, Level)
        self._noise = None if is_level else NoiseFollower(judging.whitener, sample_period_s)
        self._row = 0  # the next
        self._samples = np.zeros((0, 2))  # and how steady their noise is
        self._carried: Carried = {}

    def push(self, raw: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the scores of the next rows of the residual, NaN where there are none; an alarm above 1.

        Beside them, where they are above 1, how many rows back the greatest test looks; elsewhere 0.
        """
        scores, looks_back = np.full(len(raw), np.nan), np.zeros(len(raw), dtype=int)
        first, self._row = self._row, self._row + len(raw)
        white = White.steady(raw) if self._noise is None else self._noise.push(raw)
        own = np.full(len(white), np.nan)  # of the residual, for levels, which are judged as they are
        own[max(len(white) - len(raw), 0) :] = raw[max(len(raw) - len(white), 0) :]
        there, new = self._statistic.given(own, white)
        rows = there + self._row - len(white)
        told = int(np.searchsorted(rows, first))
        before = len(self._samples) + told
        samples = np.concatenate([self._samples, np.column_stack([new.values, new.unsteady])])
        self._samples = samples[max(len(samples) - self._statistic.looks_back(self._period_s), 0) :]
        at, rows = range(before, len(samples)), rows[told:] - first
        if not at:
            return scores, looks_back
        values, unsteady = np.ascontiguousarray(samples.T)
        given = Given(values=values, plain=values, means={}, uncertain=values, unsteady=unsteady)
        greatest = np.full(len(at), -math.inf)
        for test in self._statistic.of(given, self._period_s, self._judging.tolerance, at=at, carried=self._carried):
            over_one = over(test.values, self._judging.thresholds[test.label])
            higher = np.flatnonzero((over_one > 1.0) & (over_one > greatest))
            looks_back[rows[higher]] = test.reach if isinstance(test.reach, int) else test.reach[higher]
            np.fmax(greatest, over_one, out=greatest)
        greatest[greatest == -math.inf] = np.nan
        scores[rows] = greatest
        for late in () if self._noise is None else self._noise.first_rows:
            scores[max(late.start - first, 0) : max(late.stop - first, 0)] = np.nan
        if self._noise is not None:
            self._noise.drop_before(self._row)
        return scores, looks_back

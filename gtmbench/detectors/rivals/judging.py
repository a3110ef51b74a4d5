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
from gtmbench.detectors.statistics.statistic import Carried, Given, Statistic, Tolerance, over, tolerance_of
from gtmbench.detectors.statistics.thresholds import thresholds_of
from gtmbench.detectors.statistics.whitening import Whitener, fit_whitener
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
        return cls(
            whitener=whitener_from(f"{where}.whitener", table["whitener"]),
            tolerance=tolerance_from(f"{where}.tolerance", table["tolerance"]),
            thresholds=thresholds_from(f"{where}.thresholds", table["thresholds"], statistic, sample_period_s),
        )


def judgings(
    statistic: Statistic,
    learnt: Mapping[str, Sequence[FloatArray]],
    judged: Mapping[str, Sequence[FloatArray]],
    sample_period_s: float,
    rate: float,
) -> dict[str, Judging]:
    """Return what residuals are judged by, for a false-alarm rate an hour, as banks are calibrated.

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
        name: [(raw, raw if is_level else whiteners[name].whiten(raw), None) for raw in parts]
        for name, parts in judged.items()
    }
    tolerances = {
        name: Tolerance() if is_level else tolerance_of([white for _, white, _ in parts], statistic, sample_period_s)
        for name, parts in healthy.items()
    }
    thresholds, _ = thresholds_of(statistic, healthy, tolerances, sample_period_s, rate)
    return {
        name: Judging(whitener=whiteners[name], tolerance=tolerances[name], thresholds=thresholds[name])
        for name in learnt
    }


class Judge:
    """The score of one residual, as its rows come in: the greatest of a statistic's tests over their thresholds.

    It keeps the samples that the statistic looks back at; missing ones are passed over.

    Parameters
    ----------
    statistic : Statistic
    judging : Judging
    sample_period_s : float
    """

    def __init__(self, statistic: Statistic, judging: Judging, sample_period_s: float) -> None:
        self._statistic, self._judging, self._period_s = statistic, judging, sample_period_s
        self._raw = np.full(judging.whitener.order, np.nan)  # what the whitening filter looks back at
        self._samples = np.zeros(0)
        self._carried: Carried = {}

    def push(self, raw: FloatArray) -> tuple[FloatArray, IntArray]:
        """Return the scores of the next rows of the residual, NaN where there are none; an alarm above 1.

        Beside them, where they are above 1, how many rows back the greatest test looks; elsewhere 0.
        """
        order, before = len(self._raw), len(self._samples)
        joined = np.concatenate([self._raw, raw])
        self._raw = joined[len(joined) - order :]
        there, new = self._statistic.given(raw, self._judging.whitener.whiten(joined)[order:])
        samples = np.concatenate([self._samples, new.values])
        given = Given(values=samples, plain=samples, means={}, uncertain=np.broadcast_to(0.0, len(samples)))
        greatest, looks_back = np.full(len(there), -math.inf), np.zeros(len(raw), dtype=int)
        at = range(before, len(samples))
        tests = self._statistic.of(given, self._period_s, self._judging.tolerance, at=at, carried=self._carried)
        for test in tests if len(there) else ():
            own = over(test.values, self._judging.thresholds[test.label])
            higher = np.flatnonzero((own > 1.0) & (own > greatest))
            looks_back[there[higher]] = test.reach if isinstance(test.reach, int) else test.reach[higher]
            np.fmax(greatest, own, out=greatest)
        greatest[greatest == -math.inf] = np.nan
        self._samples = samples[max(len(samples) - self._statistic.looks_back(self._period_s), 0) :]
        scores = np.full(len(raw), np.nan)
        scores[there] = greatest
        return scores, looks_back

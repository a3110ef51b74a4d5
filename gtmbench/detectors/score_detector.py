"""A detector that scores samples and leaves the thresholds to gtmbench: the rule that score files have, too."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.detectors.base import SimpleDetector, SimpleMonitor
from gtmbench.detectors.statistics.thresholds import BLOCK_S, RATE, HealthyMaxima, ScoreMaxima, block_maxima
from gtmbench.errors import InputError
from gtmbench.files.plain import exact
from gtmbench.jobs.progress import Progress, silent
from gtmbench.method.problem import taught_records
from gtmbench.values.record import FloatArray, Record

_FEWEST = 2  # records: one to learn on, one for the thresholds


class ScoreDetector(SimpleDetector):
    """A detector of two functions whose scores have no threshold: large is bad, and calibration finds how large.

    A subclass defines `name`, `channels`, `learn` and `scores`, as of a `SimpleDetector`. `calibrate` learns on the
    first half of the records and sets thresholds on the second half, which `learn` never sees: from the greatest scores
    of blocks of a minute, whose tail is extrapolated to the false alarm rate (all scores share it evenly). A tail that
    is about exponential is extrapolated best: a squared distance or a log-likelihood, rather than a probability.

    Attributes
    ----------
    bound : float
        What no score can reach, such as 1 for a probability. The tail then ends there, and a threshold that nothing
        could pass isn't set.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> class Squared(gb.ScoreDetector):
    ...     name, channels, memory_s = "squared", ("p",), 0.0
    ...     def learn(self, records):
    ...         return {"deviation": float(np.std(np.concatenate([record["p"] for record in records])))}
    ...     def scores(self, record, learned):
    ...         return {"p": (record["p"] / learned["deviation"]) ** 2}
    >>> draw = np.random.default_rng(1)
    >>> healthy = [gb.Record(draw.normal(size=6000), channels=["p"], sample_period_s=0.01) for _ in range(40)]
    >>> monitor = Squared().calibrate(healthy, false_alarms_per_hour=1.0)
    >>> broken = gb.inject(healthy[0], gb.Bias(channel="p", onset_s=30.0, size=9.0))
    >>> monitor.watch(healthy[0]).alarms, monitor.watch(broken).alarm_s
    ((), 30.0)
    """

    bound: float = math.inf

    def calibrate(
        self, records: Sequence[Record], false_alarms_per_hour: float | None = None, *, progress: Progress = silent
    ) -> SimpleMonitor:
        """Return a monitor with thresholds for a false alarm rate; 0.002 an hour where none is given.

        Raises
        ------
        InputError
            If there is one record alone, or no score at all.
        """
        healthy = [record.select(self.channels) for record in taught_records(records)]
        if len(healthy) < _FEWEST:
            raise InputError(f"'{self.name}' learns on some records and sets thresholds on others; give two at least")
        half = (len(healthy) + 1) // 2
        progress("learn", 0, 1)
        own = exact(dict(self.learn(healthy[:half])))
        maxima = self._maxima(healthy[half:], own)
        rate = RATE if false_alarms_per_hour is None else false_alarms_per_hour
        thresholds = {name: of[""] for name, of in maxima.thresholds(rate).items()}
        learned = {"own": own, "low": self._lowest(maxima), "threshold": thresholds}
        return SimpleMonitor(detector=self, learned=exact(learned), sample_period_s=healthy[0].sample_period_s)

    def _maxima(self, records: Sequence[Record], own: Mapping[str, Any]) -> HealthyMaxima:
        """Return the greatest scores of healthy blocks."""
        period_s = records[0].sample_period_s
        rows = max(round(BLOCK_S / period_s), 1)
        tests: dict[tuple[str, str], ScoreMaxima] = {}
        for record in records:
            for name, given in self.scores(record, own).items():
                values = _finite(given)
                if not len(values):
                    raise InputError(f"'{self.name}' gives no score '{name}' on a healthy record; give longer records")
                new = ScoreMaxima(reach=1.0, least=lambda _: -math.inf, in_nats=False, most=self.bound)
                test = tests.setdefault((name, ""), new)
                test.maxima.append(block_maxima(values, rows))
                test.greatest.append(float(values.max()))
        if not tests:
            raise InputError(f"'{self.name}' gives no scores; return at least one, by its name")
        return HealthyMaxima(tests=tests, rows=rows, sample_period_s=period_s)

    @staticmethod
    def _lowest(maxima: HealthyMaxima) -> dict[str, float]:
        """Return what counts as nothing: a score is shown as a share of the way from there to its threshold."""
        lowest = {}
        for (name, _), test in maxima.tests.items():
            values = np.concatenate(test.maxima)
            low, high = float(values.min()), float(values.max())
            lowest[name] = low - ((high - low) or max(abs(high), 1.0))
        return lowest

    def _ratios(self, record: Record, learned: Mapping[str, Any]) -> Mapping[str, ArrayLike]:
        low, threshold = learned["low"], learned["threshold"]
        return {
            name: (np.asarray(values, dtype=np.float64) - low[name]) / (threshold[name] - low[name])
            for name, values in self.scores(record, learned["own"]).items()
        }


def _finite(given: ArrayLike) -> FloatArray:
    values = np.asarray(given, dtype=np.float64)
    return np.asarray(values[np.isfinite(values)])

"""How a rival's residual becomes a score: whitened or as it is, a statistic over its thresholds, rows as they come."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.alarm import TIMES_LOUDER
from gtmbench.detectors.bank.parsing import judging_table, thresholds_from, tolerance_from, whitener_from
from gtmbench.detectors.monitor.scores import ScoreTrack
from gtmbench.detectors.statistics.learnt_noise import NoiseFollower, followed
from gtmbench.detectors.statistics.statistic import (
    Allowance,
    Carried,
    Given,
    RawScore,
    Spread,
    Statistic,
    tolerance_of,
)
from gtmbench.detectors.statistics.thresholds import Luck, healthy_maxima
from gtmbench.detectors.statistics.whitening import White, Whitener, fit_whitener
from gtmbench.detectors.tables import keys
from gtmbench.method.residual import moving_sum
from gtmbench.values.record import FloatArray

_MOST = 1e150  # so that sums stay finite
WINDOWS_S = (0.0, *Statistic().windows_s)  # a sample, and those of the banks


@dataclass(frozen=True, kw_only=True)
class Level(Statistic):
    """Means of a score, at least 0, over windows; 0 s is a single sample. Nothing is whitened.

    Examples
    --------
    >>> from gtmbench.detectors.statistics.whitening import White
    >>> nothing = White.steady(np.zeros(4))
    >>> score, = Level(windows_s=(0.2,)).scores(np.array([1.0, 3.0, np.nan, 5.0]), nothing, 0.1, Allowance())
    >>> score.label, score.values
    ('mean 0.2 s', array([nan,  2., nan,  4.]))
    """

    name: str = "level"
    windows_s: tuple[float, ...] = WINDOWS_S

    def given(self, raw: FloatArray, white: White, spread: Spread | None = None) -> tuple[NDArray[np.int_], Given]:
        """Return the rows where there is a value, and the values."""
        there = np.flatnonzero(~np.isnan(raw))
        values = np.clip(raw[there], 0.0, _MOST)
        noise = dict.fromkeys(("uncertain", "unsteady", "slow", "loud"), values)
        return there, Given(values=values, plain=values, means={}, **noise)

    def of(
        self,
        given: Given,
        sample_period_s: float,
        tolerance: Allowance,
        *,
        at: range | None = None,
        carried: Carried | None = None,
    ) -> Iterator[RawScore]:
        """Yield the mean over each window up to some values; NaN where there aren't so many."""
        some = range(len(given.values)) if at is None else at
        for rows in self.rows(sample_period_s):
            first = max(some.start - rows + 1, 0)
            values = given.values[first : some.stop]
            means = np.full(len(values), np.nan)
            if len(values) >= rows:
                means[rows - 1 :] = moving_sum(values, rows)[: len(values) - rows + 1] / rows
            label = f"mean {rows * sample_period_s:g} s" if rows > 1 else "sample"
            yield RawScore(label=label, values=means[some.start - first :], reach=rows)

    def looks_back(self, sample_period_s: float) -> int:
        """Return how many values before one it looks at."""
        return self.rows(sample_period_s)[-1]

    def rows(self, sample_period_s: float) -> list[int]:
        """Return the windows' lengths in samples, each once."""
        return sorted({max(round(window_s / sample_period_s), 1) for window_s in self.windows_s})


IntArray = NDArray[np.int_]
_WHITENING_S = 0.3  # the banks'
_FEWEST = 4  # samples that tell of their noise
_SILENT = 0.01  # of the power that was learnt: a sensor that is stuck leaves the other one's
_SHIFTED, _MEAN_S = 12.0, 0.16  # nats; over what is a mean
_APART_S, _ALIKE = 0.04, 0.5  # the correlation of rows so far apart that noise doesn't reach
# a distance is judged as it comes, in its own unit
_AS_IT_IS = Whitener(coefficients=np.ones(1), mean=0.0, deviation=1.0)


@dataclass(frozen=True, kw_only=True, eq=False)
class Judging:
    """What one residual is judged by.

    Attributes
    ----------
    whitener : Whitener
        One that changes nothing, for a level.
    tolerance : Allowance
    thresholds : mapping of label to float
    """

    whitener: Whitener = field(repr=False)
    tolerance: Allowance
    thresholds: Mapping[str, float]

    def table(self) -> dict[str, object]:
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
        name: Allowance()
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
    """The score of one residual, as its rows come in; its noise is learnt on what comes in, as a bank's is."""

    def __init__(self, statistic: Statistic, judging: Judging, sample_period_s: float) -> None:
        self._baseline, self._period_s = max(round(statistic.baseline_s / sample_period_s), 1), sample_period_s
        self._is_level = isinstance(statistic, Level)
        noise = None if self._is_level else NoiseFollower(judging.whitener, sample_period_s)
        by = (judging.whitener, judging.tolerance, judging.thresholds)
        self._track = ScoreTrack(statistic, sample_period_s, *by, noise)

    def push(self, raw: FloatArray) -> FloatArray:
        """Return the scores of the next rows of the residual, NaN where there are none; an alarm above 1."""
        return self._track.push(raw)

    def onset_row(self, row: int) -> int:
        """Return where the change began that the greatest test tells of at a row of the last chunk, above 1."""
        return self._track.origins.of(row)[1]

    def is_noise(self, rows: range) -> bool:
        """Tell whether nothing but noise of another level is in some rows, the last of which came with the last chunk.

        It isn't where power passes nine times what was learnt, or there is next to none; where the rows are alike that
        are 0.04 s apart, for motion is in them; nor where the mean m is off by more than noise would have it whose
        means over 0.16 s have the variance v: n m^2 / 2v in nats, n being how many of these there are.
        """
        values, before = self._track.samples(rows, self._baseline)
        if self._is_level or len(values) < _FEWEST or not len(before):
            return False
        off = values - before.mean()
        power, mean = float(np.mean(np.square(off))), float(off.mean())
        left = off - mean
        variance = max(float(np.mean(np.square(left))), 1e-12)
        lag, rows_each = (max(round(span_s / self._period_s), 1) for span_s in (_APART_S, _MEAN_S))
        alike = float(np.mean(left[lag:] * left[:-lag])) / variance if len(left) > lag else 0.0
        count = len(left) / rows_each
        means = left[: int(count) * rows_each].reshape(-1, rows_each).mean(axis=1)
        varied = max(float(np.mean(np.square(means))) if len(means) > 1 else 0.0, variance / rows_each)
        shift = 0.5 * count * mean**2 / varied
        return _SILENT < power < TIMES_LOUDER**2 and alike < _ALIKE and shift < _SHIFTED

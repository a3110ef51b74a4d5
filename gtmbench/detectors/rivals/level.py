"""The statistic of what is a distance already: its mean over windows, too high."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtmbench.detectors.statistics.statistic import Allowance, Carried, Given, RawScore, Spread, Statistic
from gtmbench.detectors.statistics.whitening import White
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

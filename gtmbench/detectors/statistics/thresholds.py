"""Thresholds: from healthy residuals to levels that are passed as rarely as wanted."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from gtmbench.detectors.statistics.spread import Spread
from gtmbench.detectors.statistics.statistic import Statistic, Tolerance
from gtmbench.detectors.statistics.tails import block_maxima, tail_threshold
from gtmbench.record import FloatArray

_BLOCK_S = 60.0  # longer than any correlation; shorter where there is little data
_BLOCKS = 40  # wanted for a tail
Residual = tuple[FloatArray, FloatArray, Spread | None]  # raw and whitened
Seen = Mapping[str, Sequence[Residual]]  # of an output: one a record


def thresholds_of(
    test: Statistic, seen: Seen, tolerances: Mapping[str, Tolerance], sample_period_s: float, rate: float
) -> tuple[dict[str, dict[str, float]], float]:
    """Return the thresholds of all series for a false-alarm rate an hour, shared evenly, and the blocks' length in s.

    Parameters
    ----------
    test : Statistic
    seen : mapping of output to list of (raw, whitened, spread)
        Healthy residuals.
    tolerances : mapping of output to Tolerance
    sample_period_s, rate : float
    """
    hours = sum(len(raw) for raw, *_ in next(iter(seen.values()))) * sample_period_s / 3600.0
    rows = max(round(float(np.clip(hours * 3600.0 / _BLOCKS, 1.0, _BLOCK_S)) / sample_period_s), 1)
    maxima: dict[tuple[str, str], list[FloatArray]] = {}
    greatest: dict[tuple[str, str], float] = {}
    least: dict[tuple[str, str], Callable[[float], float]] = {}
    for output, pairs in seen.items():
        for raw, white, spread in pairs:
            for series in test.series(raw, white, sample_period_s, tolerances[output], spread):
                key = output, series.label
                maxima.setdefault(key, []).append(block_maxima(series.values, rows))
                # also of blocks that aren't complete
                greatest[key] = float(np.fmax.reduce(series.values, initial=greatest.get(key, -np.inf)))
                least[key] = series.least_threshold
    share = rate / len(maxima) * rows * sample_period_s / 3600.0
    thresholds: dict[str, dict[str, float]] = {output: {} for output in seen}
    for key, parts in maxima.items():
        output, label = key
        thresholds[output][label] = max(_threshold(parts, share), greatest[key], least[key](share / rows))
    return thresholds, rows * sample_period_s


def _threshold(parts: list[FloatArray], share: float) -> float:
    maxima = np.concatenate(parts)
    if not len(maxima):
        return float("inf")  # the records are shorter than this window: it can't be judged, so it doesn't alarm
    return tail_threshold(maxima, crossings_per_block=share)

"""Spikes: a test of its own for samples that are rare and large, which no window's mean or energy sees for long.

Counted are whitened samples beyond four deviations, those within a tenth of a second as one. With m counted in the T
seconds before a window of W, and a prior of half a one in 10 s (noise that is normal has one in 160 s), n of them in
the window are as likely as

    P(N >= n) = I(W / (W + T + 10 s); n, m + 1/2),

a negative binomial distribution's tail, I the regularised incomplete beta function: a sensor whose tail is heavy has
them all the time, and then they tell nothing. The score is -log P, in nats.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtmbench.detectors.statistics.statistic import RawScore
from gtmbench.values.record import BoolArray, FloatArray

THRESHOLD = 18.0  # nats: by chance once in exp(18) looks, of which normal noise has some twenty an hour
_WINDOWS_S, _APART_S = (10.0, 40.0), 0.1  # see the module's text
_PRIOR, _PRIOR_S = 0.5, 10.0  # see the module's text
_LEAST_S = 30.0  # of T: until then nobody knows how many there usually are
_FEWEST = 4  # of them: fewer pass for chance


def spike_scores(loud: FloatArray, sample_period_s: float, looks_back: int, at: range) -> Iterator[RawScore]:
    """Give the scores of some samples, by those before: one of each window.

    `loud`, shape (samples,): of those that exist, 1 where one is beyond four deviations, otherwise 0. `looks_back`: at
    how many samples before one. `at`: of which samples.
    """
    apart = max(round(_APART_S / sample_period_s), 1)
    spikes = np.flatnonzero(_firsts(loud[: at.stop] > 0.5, apart))
    for window_s in _WINDOWS_S:
        score, reach = np.full(len(at), np.nan), np.zeros(len(at), dtype=int)  # it exists where one comes
        for row in spikes[spikes >= at.start].tolist():
            start, since = (max(row + 1 - rows, 0) for rows in (looks_back - apart, round(window_s / sample_period_s)))
            before, first, last = np.searchsorted(spikes, [start, since, row + 1]).tolist()
            if last - first >= _FEWEST and (since - start) * sample_period_s >= _LEAST_S:
                spans_s = ((row + 1 - since) * sample_period_s, (since - start) * sample_period_s)
                score[row - at.start] = _surprise(last - first, first - before, *spans_s)
                reach[row - at.start] = row - int(spikes[first])
        yield RawScore(label=f"spikes {window_s:g} s", values=score, reach=reach)


def _firsts(loud: BoolArray, apart: int) -> BoolArray:
    """Return which are the first after so many rows without any.

    >>> _firsts(np.array([0, 1, 1, 0, 1, 0, 0, 0, 1], dtype=bool), 2).astype(int).tolist()
    [0, 1, 0, 0, 0, 0, 0, 0, 1]
    """
    rows = np.flatnonzero(loud)
    first = np.zeros(len(loud), dtype=bool)
    first[rows[np.diff(rows, prepend=-apart - 1) > apart]] = True
    return first


def _surprise(count: int, before: int, window_s: float, length_s: float) -> float:
    """Return -log P(N >= count) in a window, after so many in a time before it.

    >>> bool(_surprise(8, 0, 10.0, 60.0) > 15.0 > _surprise(8, 8, 10.0, 60.0))
    True
    """
    from scipy.special import betainc

    share = window_s / (window_s + length_s + _PRIOR_S)
    return float(-np.log(max(float(betainc(count, before + _PRIOR, share)), 1e-300)))

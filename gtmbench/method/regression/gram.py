"""The Gram matrix of lagged channels, from their correlations: the regressor is never formed.

A window of L = r + d + 1 samples begins at every sample t = 0..n-1 of a stretch. With z(t) the channels' values,

    G[i, j] = sum over t = 0..n-1 of z(t+i) z(t+j)',    i, j = 0..L-1: position i is lag r - i.

The first block row is a correlation, by FFT. The others follow along the block diagonals, where a window's first sample
leaves and the sample after its last one enters:

    G[i+1, j+1] = G[i, j] + z(n+i) z(n+j)' - z(i) z(j)'.

So do the sums over t of z(t+i), the products with a column of ones.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from gtmbench.method.regression.stretches import CHUNK, Run, Stretch, runs
from gtmbench.values.record import FloatArray

ROWS = 1 << 11  # equations that are written out at a time


def gram(
    stretches: Sequence[Stretch], lagged: int, causal_order: int, noncausal_order: int
) -> tuple[FloatArray, FloatArray]:
    """Return the Gram matrix of ``[z at positions 0..L-1 | targets at position r]``, and its products with ones.

    Both are sums over all equations.

    `stretches`: channels: first the `lagged` ones, then the targets. `causal_order`, `noncausal_order`: r and d.
    Returns shape (L lagged + targets,) twice, shape (L lagged + targets,): columns of z: position by position, channel
    by channel within. Only the upper triangle counts.
    """
    lags = causal_order + noncausal_order + 1
    alike: list[Run] = []
    others: list[Run] = []
    for run in runs(stretches, causal_order, noncausal_order):
        (others if run.weight is None else alike).append(run)
    total, sums = _from_correlations(alike, lagged, stretches[0].channels - lagged, lags, causal_order)
    for run in others:
        for start in range(0, run.equations, ROWS):
            block = rows(run, start, min(start + ROWS, run.equations), lagged, lags, causal_order)
            total += block[:, :-1].T @ block[:, :-1]
            sums += block[:, -1] @ block[:, :-1]
    return total, sums


def rows(run: Run, start: int, stop: int, lagged: int, lags: int, causal_order: int) -> FloatArray:
    """Return equations start..stop-1, times the root of their weight: ``[z(t)' ... z(t+L-1)' | targets | 1]``."""
    block = run.stretch.read(run.first + start, run.first + stop + lags - 1)
    regressor, targets = written_out(block, lagged, lags, causal_order)
    return (
        np.hstack([regressor, targets, np.ones((stop - start, 1))])
        * np.sqrt(run.weights(start, stop, causal_order))[:, np.newaxis]
    )


def written_out(block: FloatArray, lagged: int, lags: int, causal_order: int) -> tuple[FloatArray, FloatArray]:
    """Return ``z(t)' ... z(t+L-1)'`` and the targets at t+r, for every complete window of a block of channels."""
    windows = np.lib.stride_tricks.sliding_window_view(block[:lagged], lags, axis=1)
    count = windows.shape[1]
    return windows.transpose(1, 2, 0).reshape(count, -1), block[lagged:, causal_order : causal_order + count].T


def _from_correlations(
    parts: Sequence[Run], lagged: int, targets: int, lags: int, causal_order: int
) -> tuple[FloatArray, FloatArray]:
    """Return the Gram matrix and the sums of runs of 2 L equations and more, each of one weight."""
    size, width = lags * lagged, lags * lagged + max(targets, 1)  # the recursion needs a column behind z
    row, power = np.zeros((lagged + targets, lagged, lags)), np.zeros((targets, targets))
    first_sums = np.zeros(lagged + targets)
    entering, leaving = np.zeros((2, len(parts), width))  # each sample at the position that it steps to
    for number, run in enumerate(parts):
        weight = run.weight or 0.0
        for start in range(0, run.equations, CHUNK):
            stop = min(start + CHUNK, run.equations)
            block = run.stretch.read(run.first + start, run.first + stop + lags - 1)
            now = block[lagged:, causal_order : causal_order + stop - start]
            row += weight * _correlations(block[:lagged], now, lags)
            power += weight * (now @ now.T)
            first_sums += weight * np.concatenate([block[:lagged, : stop - start].sum(axis=1), now.sum(axis=1)])
        for edge, first in ((entering, run.first + run.equations), (leaving, run.first)):
            edge[number, lagged:size] = np.sqrt(weight) * run.stretch.read(first, first + lags - 1)[:lagged].T.ravel()
    steps = np.array([np.sqrt(run.weight or 0.0) for run in parts]) @ (entering - leaving)[:, :size]
    steps[:lagged] = first_sums[:lagged]
    sums = np.concatenate([np.cumsum(steps.reshape(lags, lagged), axis=0).ravel(), first_sums[lagged:]])
    total = np.vstack([entering, -leaving]).T @ np.vstack([entering, leaving])
    products = row.transpose(0, 2, 1).reshape(len(row), size)
    total[:lagged, :size] = products[:lagged]
    # A block down and to the right is equally far from everywhere; past a row's end begins the next one's lower part.
    for before, after in pairwise(total.reshape(-1)[: size * (width + 1)].reshape(lags, -1)):
        after += before
    total = np.ascontiguousarray(total[: size + targets, : size + targets])  # no copy unless there is no target
    total[:size, size:] = products[lagged:].T
    total[size:, size:] = power
    return total, sums


def _correlations(signals: FloatArray, targets: FloatArray, lags: int) -> FloatArray:
    """Return sum over t of h[a, t] signals[b, t+s], s = 0..lags-1, shape (signals + targets, signals, lags).

    h: signals, then targets, at as many t as there are targets' samples. Segment by segment: a head of
    ``length - lags + 1`` samples, reversed, is convolved with the `length` samples that it meets.
    """
    length = max(1 << 10, 1 << (8 * lags - 1).bit_length())
    hop, count = length - lags + 1, targets.shape[1]
    segments = -(-count // hop)
    padded = np.zeros((len(signals) + len(targets), segments * hop + lags - 1))
    padded[: len(signals), : signals.shape[1]] = signals
    padded[len(signals) :, :count] = targets
    channel, sample = padded.strides
    windows = np.ndarray((len(padded), segments, length), buffer=padded, strides=(channel, hop * sample, sample))
    heads = np.zeros(windows.shape)
    heads[:, :, :hop] = windows[:, :, hop - 1 :: -1]
    heads[:, -1, : segments * hop - count] = 0.0
    met = np.fft.rfft(windows[: len(signals)])
    products = [[np.add.reduce(head * signal) for signal in met] for head in np.fft.rfft(heads)]
    return np.asarray(np.fft.irfft(products, length)[..., hop - 1 :])

"""The Gram matrix of lagged channels, from their correlations: the regressor is never formed.

A window of L = r + d + 1 samples begins at every sample t = 0..n-1 of a stretch. With z(t) the channels' values,

    G[i, j] = sum over t = 0..n-1 of z(t+i) z(t+j)',    i, j = 0..L-1: position i is lag r - i.

The first block row is a correlation, by FFT. The others follow along the block diagonals, where a window's first sample
leaves and the sample after its last one enters:

    G[i+1, j+1] = G[i, j] + z(n+i) z(n+j)' - z(i) z(j)'.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.method.regression.stretches import CHUNK, Span, Stretch, spans
from gtmbench.record import FloatArray

ROWS = 1 << 11  # equations that are written out at a time


def gram(stretches: Sequence[Stretch], lagged: int, causal_order: int, noncausal_order: int) -> FloatArray:
    """Return the Gram matrix of ``[z at positions 0..L-1 | targets at position r]``, summed over all equations.

    Parameters
    ----------
    stretches : sequence of Stretch
        Channels: first the `lagged` ones, then the targets.
    lagged : int
    causal_order, noncausal_order : int
        r and d.

    Returns
    -------
    shape (L lagged + targets,) twice
        Columns of z: position by position, channel by channel within. Only the upper triangle is filled in.
    """
    lags = causal_order + noncausal_order + 1
    alike: list[Span] = []
    others: list[Span] = []
    for span in spans(stretches, causal_order, noncausal_order):
        (alike if span.weight is not None and span.equations >= 2 * lags else others).append(span)
    total = _from_correlations(alike, lagged, stretches[0].channels - lagged, lags, causal_order)
    for span in others:
        for start in range(0, span.equations, ROWS):
            block = rows(span, start, min(start + ROWS, span.equations), lagged, lags, causal_order)
            total += block.T @ block
    return total


def rows(span: Span, start: int, stop: int, lagged: int, lags: int, causal_order: int) -> FloatArray:
    """Return equations start..stop-1 of a span, times the root of their weight: ``[z(t)' ... z(t+L-1)' | targets]``."""
    block = span.stretch.read(span.first + start, span.first + stop + lags - 1)
    windows = np.lib.stride_tricks.sliding_window_view(block[:lagged], lags, axis=1)
    regressor = windows.transpose(1, 2, 0).reshape(stop - start, lags * lagged)
    targets = block[lagged:, causal_order : causal_order + stop - start].T
    return np.hstack([regressor, targets]) * np.sqrt(span.weights(start, stop, causal_order))[:, np.newaxis]


def _from_correlations(parts: Sequence[Span], lagged: int, targets: int, lags: int, causal_order: int) -> FloatArray:
    """Return the Gram matrix of spans of 2 L equations and more, each of one weight.

    The recursion is linear, so it runs once for all of them.
    """
    size, ends = lags * lagged, lags - 1
    row = np.zeros((lagged + targets, lagged, lags))
    edges: list[FloatArray] = []
    total = np.zeros((size + targets, size + targets))
    for span in parts:
        weight = span.weight or 0.0
        for start in range(0, span.equations, CHUNK):
            stop = min(start + CHUNK, span.equations)
            block = span.stretch.read(span.first + start, span.first + stop + ends)
            now = block[lagged:, causal_order : causal_order + stop - start]
            row += weight * _correlations([block[:lagged, : stop - start], now], block[:lagged], lags)
            total[size:, size:] += weight * (now @ now.T)
        edges += [
            np.sqrt(weight) * span.stretch.read(first, first + ends)[:lagged].T.ravel()
            for first in (span.first + span.equations, span.first)  # what enters, what leaves
        ]
    if edges:
        ends_of_all = np.stack(edges, axis=1)
        steps = (ends_of_all * np.resize([1.0, -1.0], len(edges))) @ ends_of_all.T
        products = row.transpose(0, 2, 1).reshape(len(row), size)
        total[:size, size:] = products[lagged:].T
        total[:lagged, :size] = products[:lagged]
        for i in range(lagged, size, lagged):
            before, above = slice(i - lagged, i), slice(i - lagged, size - lagged)
            np.add(total[before, above], steps[before, above], out=total[i : i + lagged, i:size])
    return total


def _correlations(heads: Sequence[FloatArray], signals: FloatArray, lags: int) -> FloatArray:
    """Return sum over t of heads[a, t] signals[b, t+s], s = 0..lags-1, shape (heads, signals, lags).

    Segment by segment: a head of ``length - lags + 1`` samples against the `length` samples that it meets.
    """
    import scipy.fft

    length = max(1 << 10, 1 << (8 * lags - 1).bit_length())
    hop = length - lags + 1
    segments = -(-heads[0].shape[1] // hop)
    edges = np.cumsum([0, *map(len, heads)])
    pieces, met = np.zeros((edges[-1], segments * hop)), np.zeros((len(signals), segments * hop + lags - 1))
    for head, first, last in zip(heads, edges, edges[1:], strict=False):
        pieces[first:last, : head.shape[1]] = head
    met[:, : signals.shape[1]] = signals
    windows = np.lib.stride_tricks.sliding_window_view(met, length, axis=1)[:, ::hop]
    one = scipy.fft.rfft(pieces.reshape(edges[-1], segments, hop), length)
    other = scipy.fft.rfft(windows)
    np.conjugate(one, out=one)
    products = np.empty((len(one), len(other), one.shape[-1]), dtype=complex)
    for a, b in np.ndindex(products.shape[:2]):
        np.sum(one[a] * other[b], axis=0, out=products[a, b])
    return np.asarray(scipy.fft.irfft(products, length)[..., :lags])

"""Means over seconds."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gtmbench.values.record import FloatArray, Record

IntArray = npt.NDArray[np.int_]

SECOND_S = 1.0  # by definition
_COVERED = 0.7  # of a second
_BLOCK = 1000  # seconds that are taken at a time


def rows_by_second(record: Record, start_s: float) -> Iterator[tuple[int, slice]]:
    """Give the seconds since a time that a record covers, with the rows of each.

    >>> record = Record(np.zeros((7, 1)), channels=["p"], sample_period_s=0.25, start_s=10.0)
    >>> list(rows_by_second(record, 9.0))
    [(1, slice(0, 4, None)), (2, slice(4, 7, None))]
    """
    seconds = np.floor((record.time_s - start_s) / SECOND_S + 1e-9).astype(int)
    firsts = np.flatnonzero(np.diff(seconds, prepend=-1)).tolist()
    for first, stop in zip(firsts, [*firsts[1:], len(seconds)], strict=True):
        if (stop - first) * record.sample_period_s > _COVERED * SECOND_S:
            yield int(seconds[first]), slice(first, stop)


@dataclass(frozen=True, kw_only=True, eq=False)
class Seconds:
    """What rows come to, second by second; NaN where a sample is missing, or a second isn't covered."""

    at: IntArray  # shape (seconds,); numbers of the seconds, counted from a time
    # first_row, stop_row: shape (seconds,)
    first_row: IntArray
    stop_row: IntArray
    # means, deviations: shape (seconds, columns)
    means: FloatArray
    deviations: FloatArray


def of_seconds(record: Record, start_s: float, columns: Callable[[Record], FloatArray]) -> Seconds:
    """Return means and deviations of columns that are made of a record, of every second of it that is covered.

    A long record is taken some minutes at a time.

    >>> record = Record(np.arange(8.0)[:, np.newaxis], channels=["p"], sample_period_s=0.25, start_s=10.0)
    >>> found = of_seconds(record, 9.0, lambda part: part.values)
    >>> found.at.tolist(), found.means[:, 0].tolist(), found.deviations[:, 0].round(2).tolist()
    ([1, 2], [1.5, 5.5], [1.12, 1.12])
    """
    bounds = [(second, rows.start, rows.stop) for second, rows in rows_by_second(record, start_s)]
    at, first_row, stop_row = np.array(bounds, dtype=int).reshape(-1, 3).T
    means: list[FloatArray] = []
    deviations: list[FloatArray] = []
    for begin in range(0, len(at), _BLOCK):
        first, stop = first_row[begin : begin + _BLOCK], stop_row[begin : begin + _BLOCK]
        values = columns(record.part(range(int(first[0]), int(stop[-1]))))
        edges = np.column_stack([first, stop]).ravel() - first[0]
        counts = (stop - first)[:, np.newaxis]
        padded = np.concatenate([values, np.zeros((1, values.shape[1]))])  # an edge may be the end
        own = np.add.reduceat(padded, edges)[::2] / counts
        square = np.add.reduceat(np.square(padded), edges)[::2] / counts - np.square(own)
        means.append(own)
        deviations.append(np.sqrt(np.maximum(square, 0.0)))
    none = np.zeros((0, 0))
    return Seconds(
        at=at,
        first_row=first_row,
        stop_row=stop_row,
        means=np.concatenate(means) if means else none,
        deviations=np.concatenate(deviations) if deviations else none,
    )


def trailing_means(values: FloatArray, window: int, known: float = 1.0) -> FloatArray:
    """Return means of so many seconds up to each, along the first axis; NaN where too few of them are known.

    >>> trailing_means(np.array([1.0, 3.0, np.nan, 5.0]), 2)
    array([nan,  2., nan, nan])
    >>> trailing_means(np.array([1.0, 3.0, np.nan, 5.0]), 2, known=0.5)
    array([nan,  2.,  3.,  5.])
    """
    means = np.full(values.shape, np.nan)
    if len(values) < window:
        return means
    there = np.isfinite(values)
    sums = np.lib.stride_tricks.sliding_window_view(np.where(there, values, 0.0), window, axis=0).sum(axis=-1)
    counts = np.lib.stride_tricks.sliding_window_view(there, window, axis=0).sum(axis=-1)
    enough = counts >= max(1.0, known * window - 1e-9)
    means[window - 1 :] = np.where(enough, sums / np.maximum(counts, 1), np.nan)
    return means

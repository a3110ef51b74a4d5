"""Means over seconds: what two sensors of one rotation differ by, without what two healthy ones differ by."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from gtmbench.values.record import BoolArray, FloatArray, Record, Span

IntArray = npt.NDArray[np.int_]

SECOND_S = 1.0
FEWEST = 15  # seconds that are healthy: with fewer, nothing is known of a difference
_COVERED = 0.7  # of a second
_BLOCK = 1000  # seconds that are taken at a time
_GAIN = 0.02  # by which scale and direction of two gyros differ: an a priori standard deviation


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
    """What rows come to, second by second; NaN where a sample is missing, or a second isn't covered.

    Attributes
    ----------
    at : shape (seconds,)
        Numbers of the seconds, counted from a time.
    first_row, stop_row : shape (seconds,)
    means, deviations : shape (seconds, columns)
    """

    at: IntArray
    first_row: IntArray
    stop_row: IntArray
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


def seconds_in(spans: Sequence[Span], start_s: float, count: int) -> BoolArray:
    """Tell which of so many seconds since a time have their middle in any of some spans.

    >>> seconds_in([(0.0, 1.0), (2.5, 9.0)], start_s=0.0, count=3)
    array([ True, False,  True])
    """
    middle_s = start_s + (np.arange(count, dtype=np.float64) + 0.5) * SECOND_S
    within = np.zeros(count, dtype=np.bool_)
    for first_s, last_s in spans:
        within |= (middle_s >= first_s) & (middle_s <= last_s)
    return within


def beyond_gains(difference: FloatArray, motion: FloatArray, healthy: BoolArray) -> FloatArray:
    """Return a difference without its median where healthy, and without what turning explains there.

    Two healthy gyros differ by a bias, a scale of a percent or two, and an angle between their axes.

    Parameters
    ----------
    difference, motion : shape (seconds, 3)
        In deg/s; NaN where nothing is known.
    healthy : shape (seconds,)

    Returns
    -------
    shape (seconds, 3)
        NaN throughout where less than `FEWEST` seconds are healthy.

    Examples
    --------
    >>> motion = np.random.default_rng(1).standard_normal((40, 3)) * 20.0
    >>> difference = 0.5 + 0.02 * motion
    >>> left = beyond_gains(difference, motion, np.ones(40, dtype=bool))
    >>> float(np.std(difference).round(2)), float(np.std(left).round(2))
    (0.34, 0.02)
    """
    rows = healthy & np.isfinite(difference).all(axis=1) & np.isfinite(motion).all(axis=1)
    if np.count_nonzero(rows) < FEWEST:
        return np.full(difference.shape, np.nan)
    middle = np.median(difference[rows], axis=0)
    turned, left = motion[rows] - motion[rows].mean(axis=0), difference[rows] - middle
    noise = 1.4826 * np.median(np.abs(left), axis=0) + 1e-9
    gains = np.column_stack(
        [
            np.linalg.solve(turned.T @ turned + np.eye(3) * (noise[axis] / _GAIN) ** 2, turned.T @ left[:, axis])
            for axis in range(3)
        ]
    )
    return np.asarray(difference - middle - (motion - motion[rows].mean(axis=0)) @ gains)


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

"""Pieces: a day's columns are gone through a stretch of rows at a time, so that what is worked out of them stays small.

A record that is shorter is one piece: there is one way, whatever the length.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

from gtmbench.values.clock import FloatArray

ROWS = 1 << 17  # of a piece: 22 minutes at 100 Hz, 1 MB a column


def rows_of_piece() -> int:
    """Return how many rows a piece has."""
    return ROWS


def pieces(rows: int, of: int | None = None) -> Iterator[slice]:
    """Give the rows of a column, so many at a time.

    >>> list(pieces(5, 2))
    [slice(0, 2, None), slice(2, 4, None), slice(4, 5, None)]
    """
    most = rows_of_piece() if of is None else of
    for first in range(0, rows, most):
        yield slice(first, min(first + most, rows))


def joined(parts: Sequence[NDArray[Any]], empty: DTypeLike) -> NDArray[Any]:
    """Return parts that follow each other as one array; the one where there is only one, without a copy."""
    if len(parts) == 1:
        return parts[0]
    return np.concatenate(parts) if parts else np.zeros(0, dtype=empty)


def beside(parts: Sequence[NDArray[Any]]) -> NDArray[Any]:
    """Return columns beside each other, as a matrix nobody can write to; without a copy where they lie so already.

    >>> whole = np.zeros((100, 3), order="F")
    >>> np.shares_memory(beside([whole[10:, :2], whole[10:, 2:]]), whole), beside([whole[:, :1], whole[:, 2:]]).shape
    (True, (100, 2))
    """
    count = sum(part.shape[1] for part in parts)
    matrix = parts[0] if len(parts) == 1 else _as_they_lie(parts, count)
    if matrix is None:
        matrix = np.empty((len(parts[0]), count), dtype=parts[0].dtype, order="F")
        first = 0
        for part in parts:
            matrix[:, first : first + part.shape[1]] = part
            first += part.shape[1]
    matrix.setflags(write=False)
    return matrix


def _as_they_lie(parts: Sequence[NDArray[Any]], count: int) -> NDArray[Any] | None:
    """Return the columns of one matrix that some parts of it are, one after the other; None where they aren't."""
    base = parts[0].base
    if not isinstance(base, np.ndarray) or base.ndim != 2 or not base.flags.f_contiguous:
        return None
    places = [divmod((_address(part) - _address(base)) // base.itemsize, len(base)) for part in parts]
    (first, row), column = places[0], places[0][0]
    for part, place in zip(parts, places, strict=True):
        if part.base is not base or place != (column, row) or part.strides != base.strides:
            return None
        column += part.shape[1]
    return base[row : row + len(parts[0]), first : first + count]


def _address(array: NDArray[Any]) -> int:
    return int(array.__array_interface__["data"][0])


def deviation(columns: Iterable[FloatArray]) -> float:
    """Return the standard deviation of columns that follow each other, their missing samples left out; NaN of none.

    >>> deviation([np.array([1.0, 2.0]), np.array([np.nan, 3.0])]) == float(np.std([1.0, 2.0, 3.0]))
    True
    """
    parts = _parts(columns)
    count = sum(len(_there(part)) for part in parts)
    if not count:
        return math.nan
    mean = sum(float(_there(part).sum()) for part in parts) / count
    return math.sqrt(sum(float(np.square(_there(part) - mean).sum()) for part in parts) / count)


def rms(columns: Iterable[FloatArray]) -> float:
    """Return the root mean square of columns, their missing samples left out; NaN of none.

    >>> rms([np.array([3.0, np.nan])])
    3.0
    """
    squares, count = 0.0, 0
    for there in (_there(column[rows]) for column in columns for rows in pieces(len(column))):
        squares, count = squares + float(np.square(there).sum()), count + len(there)
    return math.sqrt(squares / count) if count else math.nan


def _parts(columns: Iterable[FloatArray]) -> list[FloatArray]:
    return [column[rows] for column in columns for rows in pieces(len(column))]


def _there(values: FloatArray) -> FloatArray:
    return values[np.isfinite(values)]

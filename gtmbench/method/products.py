"""Products of matrices that leave the other cores alone."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from gtmbench.values.record import FloatArray

_ALONE = 250_000  # multiplications: OpenBLAS (0.3) shares products of more than 262,144 among threads


def product(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return left @ right, worked out in parts that are too small for several threads.

    Threads wait for each other, on busy cores twenty times as long as the product takes; parts cost a tenth more.

    `left`, shape (m, k). `right`, shape (k, n).

    >>> product(np.ones((1, 2)), np.array([[1.0, 2.0], [3.0, 4.0]]))
    array([[4., 6.]])
    """
    rows, columns = len(left), right.shape[1]
    found = np.empty((rows, columns))
    if rows < columns:
        for part in _parts(columns, left.size):
            np.matmul(left, right[:, part], out=found[:, part])
    else:
        for part in _parts(rows, right.size):
            np.matmul(left[part], right, out=found[part])
    return found


def gram(rows: FloatArray) -> FloatArray:
    """Return rows @ rows.T, likewise.

    >>> gram(np.array([[1.0, 2.0], [0.0, 3.0]]))
    array([[5., 6.],
           [6., 9.]])
    """
    parts = (rows[:, part] for part in _parts(rows.shape[1], len(rows) ** 2))
    return np.asarray(sum((part @ part.T for part in parts), start=np.zeros((len(rows), len(rows)))))


def _parts(count: int, each: int) -> Iterator[slice]:
    """Give parts of so many rows or columns, each of which is multiplied so often."""
    step = max(_ALONE // max(each, 1), 1)
    return (slice(first, first + step) for first in range(0, count, step))

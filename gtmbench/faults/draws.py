"""Random numbers by their place in a sequence: the same whatever else was drawn, in whatever order.

What a fault draws at a sample depends on its seed and on the sample's number since the onset, and on nothing else: not
on the record's length, nor on where it is cut, nor on whether an array or a stream asks.
"""

from __future__ import annotations

from functools import lru_cache
from typing import Literal

import numpy as np

from gtmbench.values.clock import FloatArray, Value

Distribution = Literal["standard_normal", "random"]  # by the name of a generator's method; random: uniform on [0, 1)

_BLOCK = 1024


def drawn(distribution: Distribution, seed: int, name: str, places: Value) -> Value:
    """Return the numbers at some places, 0, 1, ..., of the sequence of a seed and a name.

    `places`: whole numbers, not negative, in rising order.

    >>> whole = drawn("random", 7, "noise of p", np.arange(3000.0))
    >>> drawn("random", 7, "noise of p", 2500.0) == whole[2500].item()
    True
    """
    if isinstance(places, float):
        number, row = divmod(int(places), _BLOCK)
        return _block(distribution, seed, name, number).item(row)
    if not len(places):
        return np.zeros(0)
    numbers, rows = np.divmod(places.astype(np.int64), _BLOCK)
    first = np.searchsorted(numbers, np.unique(numbers))
    parts = np.split(rows, first[1:])
    return np.concatenate(
        [_block(distribution, seed, name, int(numbers[at]))[part] for at, part in zip(first, parts, strict=True)]
    )


@lru_cache(maxsize=64)
def _block(distribution: Distribution, seed: int, name: str, number: int) -> FloatArray:
    generator = np.random.default_rng([seed, number, *name.encode()])
    return np.asarray(getattr(generator, distribution)(_BLOCK))

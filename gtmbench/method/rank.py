"""Why the data don't determine an operator, in words."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.method.regression.triangle import rounding
from gtmbench.record import FloatArray


def cause(root: FloatArray, channels: Sequence[str], equations: int) -> str:
    """Return which channels leave Markov parameters undetermined, and how.

    Parameters
    ----------
    root : shape (lags channels,) twice
        R of the regressor, columns lag by lag, channel by channel within.
    channels : sequence of str
    equations : int

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal((500, 3))
    >>> u[:, 2] = u[:, 0] + u[:, 1]
    >>> cause(np.linalg.qr(u, mode="r"), ["p", "q", "s"], 500)
    "'s' follows from p, q"
    """
    size, count = len(root), len(channels)
    lags = size // count
    by_channel = root.reshape(size, lags, count)
    tolerance = rounding(equations, size) * float(np.linalg.norm(root, 2))

    def rank(numbers: Sequence[int]) -> int:
        return int(np.linalg.matrix_rank(by_channel[:, :, numbers].reshape(size, -1), tolerance))

    alone = [(name, rank([i])) for i, name in enumerate(channels)]
    poor = [f"'{name}' ({found} of its {lags} lags)" for name, found in alone if found < lags]
    if poor:
        return f"too few frequencies in {', '.join(poor)}"
    for last in range(1, count):
        if rank(range(last + 1)) < (last + 1) * lags:
            pairs = [channels[i] for i in range(last) if rank([i, last]) < 2 * lags]
            return f"'{channels[last]}' follows from {', '.join(pairs or channels[:last])}"
    return "the channels hardly move apart"

"""The parabola through three points, and where a search begins: values evenly spaced in their logarithm."""

from __future__ import annotations

import numpy as np

from gtmbench.values.record import FloatArray


def vertex(places: FloatArray, heights: FloatArray) -> tuple[float, float]:
    """Return where the parabola through three points is flat, and half its second derivative; NaN of a line.

    >>> import numpy as np
    >>> vertex(np.array([0.0, 1.0, 3.0]), np.array([8.0, 2.0, 2.0]))
    (2.0, 2.0)
    """
    (first, middle, last), (before, least, after) = places.tolist(), heights.tolist()
    slope = (least - before) / (middle - first)
    bend = ((after - least) / (last - middle) - slope) / (last - first)
    return 0.5 * (first + middle - slope / bend) if bend else float("nan"), bend


def spaced(low: float, high: float, count: int) -> FloatArray:
    """Return values evenly spaced in their logarithm; `numpy.geomspace` takes ten times as long.

    >>> spaced(1.0, 100.0, 3).tolist()
    [1.0, 10.0, 100.0]
    """
    return np.asarray(low * (high / low) ** (np.arange(count) / (count - 1)))

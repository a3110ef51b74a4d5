"""The parabola through three points."""

from __future__ import annotations

import numpy as np

from gtmbench.record import FloatArray


def vertex(places: FloatArray, heights: FloatArray) -> tuple[float, float]:
    """Return where the parabola through three points is flat, and half its second derivative; NaN of a line.

    >>> vertex(np.array([0.0, 1.0, 3.0]), np.array([8.0, 2.0, 2.0]))
    (2.0, 2.0)
    """
    slopes = np.diff(heights) / np.diff(places)
    bend = float(slopes[1] - slopes[0]) / float(places[2] - places[0])
    at = 0.5 * (float(places[0] + places[1]) - float(slopes[0]) / bend) if bend else float("nan")
    return at, bend

"""Bursts: moments in which gyro and attitude part by far more than noise, and nothing that was found explains it.

They are too short for a finding, so nobody is named; but nothing is clear in them either.
"""

from __future__ import annotations

import numpy as np

from gtmbench.engine.model import Model
from gtmbench.intake.tracks import union
from gtmbench.values.record import FloatArray, Span, runs

_OVER_S = 1.0  # a root mean square of
# times its usual level at such motion, and deg/s: on healthy logs that is seldom, where an attitude is set anew
_LOUD, _LEAST_DEG_S = 8.0, 1.0
_BESIDE_S = 0.5  # of a burst, which smears it


def bursts_of(model: Model, axis: int) -> list[Span]:
    """Return the spans in which a gyro and the attitude part for a moment, in time.

    Beyond are sqrt(mean(e^2)) > 1 deg/s and sqrt(mean((e / level)^2)) > 8, means over the second about a block.
    """
    sums = model.own_axis(axis)
    if sums is None:
        return []
    equation, blocks = sums.products.equation, model.flight.blocks
    over = np.ones(max(round(_OVER_S / blocks.period_s), 1))
    counts = np.convolve(equation.known, over, "same")

    def spread(errors: FloatArray) -> FloatArray:
        squares = np.convolve(np.where(equation.known, errors, 0.0) ** 2, over, "same")
        return np.asarray(np.sqrt(squares / np.maximum(counts, 1.0)))

    is_beyond = (spread(equation.left / equation.level) > _LOUD) & (spread(equation.left) > _LEAST_DEG_S)
    starts, ends = runs(np.asarray(is_beyond & (2.0 * counts > len(over))))
    edges = blocks.start_s + blocks.period_s * np.column_stack([starts, ends])
    return union([(start_s - _BESIDE_S, end_s + _BESIDE_S) for start_s, end_s in edges.tolist()])

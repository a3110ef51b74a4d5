"""The FIR product (temporary; the fast one is on its way)."""

from __future__ import annotations

import numpy as np

from gtmbench.record import FloatArray


def filtered(values: FloatArray, markov: FloatArray) -> FloatArray:
    """Return sum over i of H_i u(k - i) for every k whose window is complete."""
    return np.stack(
        [
            sum(np.convolve(values[:, i], markov[:, o, i], mode="valid") for i in range(values.shape[1]))
            for o in range(markov.shape[1])
        ],
        axis=1,
    )

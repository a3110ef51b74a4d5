"""Information criteria of least squares."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.values.record import FloatArray


def information(power: FloatArray, equations: float, rank: ArrayLike) -> tuple[FloatArray, FloatArray]:
    """Return AIC and BIC of models with `rank` determined parameters an output.

    Residuals are taken as white, Gaussian and independent from output to output; constants are left out.

    `power`, shape (..., outputs): mean squares of the residuals, each over its output's mean square. `rank`, shape
    (...).

    >>> aic, bic = information(np.array([0.01]), 1000.0, 5)
    >>> round(float(aic), 6)  # 1000 log(0.01) + 2 * 5
    -4595.170186
    """
    fit = equations * np.sum(np.log(power), axis=-1)
    count = np.asarray(rank) * power.shape[-1]
    return fit + 2.0 * count, fit + np.log(equations) * count

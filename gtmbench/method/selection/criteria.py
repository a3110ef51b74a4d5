"""Information criteria of least squares."""

from __future__ import annotations

import numpy as np

from gtmbench.record import FloatArray


def information(squares: FloatArray, equations: float, rank: int) -> tuple[float, float]:
    """Return AIC and BIC of a model with `rank` determined parameters an output.

    Residuals are taken as white, Gaussian and independent from output to output; constants are left out.

    Parameters
    ----------
    squares : shape (outputs,)
        Residual sums of squares, each over its output's mean square.
    equations : float
    rank : int

    Examples
    --------
    >>> aic, bic = information(np.array([10.0]), 1000.0, 5)
    >>> round(aic, 6)  # 1000 log(0.01) + 2 * 5
    -4595.170186
    """
    fit = float(equations * np.sum(np.log(squares / equations)))
    count = rank * len(squares)
    return fit + 2.0 * count, fit + float(np.log(equations)) * count

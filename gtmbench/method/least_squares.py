"""The solver of the identification: one seam, so that a faster one can take its place.

Rows of the regressor are samples k, columns are lags -d..r of every input:

    [ u(r+d)   ... u(0)      ] [ H_-d' ]   [ y(r)     ]
    [ u(r+d+1) ... u(1)      ] [  ...  ] = [ y(r+1)   ]
    [   ...          ...     ] [  ...  ]   [  ...     ]
    [ u(l)     ... u(l-r-d)  ] [ H_r'  ]   [ y(l-d)   ]
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """Coefficients (lags, inputs, outputs) with the rank and the condition number of the scaled regressor."""

    coefficients: FloatArray
    rank: int
    condition: float


def solve(inputs: FloatArray, outputs: FloatArray, causal_order: int, noncausal_order: int) -> Solution:
    """Return the least-squares coefficients of outputs on lagged inputs.

    Parameters
    ----------
    inputs : shape (samples, inputs)
    outputs : shape (samples, outputs)
    causal_order, noncausal_order : int
        r and d.

    Notes
    -----
    An orthogonal method (singular values, LAPACK gelsd): where the regressor lacks rank, the smallest solution.
    """
    r, d = causal_order, noncausal_order
    lags, count = r + d + 1, inputs.shape[1]
    scale = np.sqrt(np.mean(inputs**2, axis=0))
    # windows[k] holds u(k)..u(k+r+d), oldest first: reversed, newest (lag -d) first
    windows = np.lib.stride_tricks.sliding_window_view(inputs / scale, lags, axis=0)[:, :, ::-1]
    regressor = windows.transpose(0, 2, 1).reshape(len(windows), lags * count)
    target = outputs[r : len(outputs) - d]
    theta, _, rank, singular = np.linalg.lstsq(regressor, target, rcond=None)
    smallest = float(singular[-1])
    return Solution(
        coefficients=theta.reshape(lags, count, -1) / scale[:, np.newaxis],
        rank=int(rank),
        condition=float(singular[0]) / smallest if smallest > 0 else float("inf"),
    )

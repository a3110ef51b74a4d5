"""The noise model of prediction-error methods: what colours the residual, and the innovations that are left."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.errors import InputError
from gtmbench.record import FloatArray


@dataclass(frozen=True, kw_only=True, eq=False)
class NoiseModel:
    """A(q) e(k) = epsilon(k): an autoregressive inverse of G_w in equation (3.64), one an output.

    Attributes
    ----------
    autoregressive : shape (outputs, order + 1)
        1, a_1, ..., a_n: epsilon(k) = e(k) + a_1 e(k-1) + ... + a_n e(k-n).
    innovation_std : shape (outputs,)
        Standard deviation of epsilon, in the outputs' units.
    converged : bool
        Whether the criterion (3.88) had settled before iterations ran out.
    criterion : shape (iterations, outputs)
        Mean square of the innovations after each iteration, in the outputs' units squared.
    """

    autoregressive: FloatArray
    innovation_std: FloatArray
    converged: bool
    criterion: FloatArray

    def innovations(self, residuals: FloatArray) -> FloatArray:
        """Return epsilon, equation (3.67), shape as the one-step residuals (samples, outputs); NaN where unknown."""
        order = self.autoregressive.shape[1] - 1
        if np.shape(residuals)[1:] != (len(self.autoregressive),):
            raise InputError(
                f"residuals of shape {np.shape(residuals)} for {len(self.autoregressive)} outputs; give (samples, "
                "outputs)"
            )
        found = np.full(residuals.shape, np.nan)
        if len(residuals) > order:
            for o, taps in enumerate(self.autoregressive):
                found[order:, o] = np.convolve(residuals[:, o], taps, mode="valid")
        return found

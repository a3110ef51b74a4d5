"""Limit, rate-of-change and flat-line check of each gyro: what air data and engine computers have always done.

Source: R. Isermann, Fault-Diagnosis Systems, Springer 2006, chapter 7 (limit and trend checking),
doi:10.1007/3-540-30368-5.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import Generator, Lookback, windows
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

_LEAST_RANGE = 1e-6  # deg/s


@dataclass(frozen=True, kw_only=True)
class LimitChecks(Rival):
    """|y|, |y'| and 1 / (max y - min y) over a short window: each sample against a limit of its own.

    Parameters
    ----------
    flat_s : float
        The window in which a gyro that lives shows noise.
    """

    name: str = "limits"
    title: ClassVar[str] = "limit, rate-of-change and flat-line check of each gyro"
    judge: str = "sample"
    flat_s: float = 0.25
    channels: ClassVar[tuple[str, ...]] = GYROS
    outputs: ClassVar[tuple[str, ...]] = tuple(
        f"{gyro} {check}" for check in ("limit", "rate", "flat") for gyro in GYROS
    )

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what makes the nine checks."""
        rows = max(round(self.flat_s / sample_period_s), 2)

        def work(values: FloatArray) -> FloatArray:
            rates = np.abs(np.diff(values, axis=0, prepend=np.nan)) / sample_period_s
            recent = windows(values, rows)
            spans = recent.max(axis=2) - recent.min(axis=2)
            return np.hstack([np.abs(values), rates, 1.0 / (spans + _LEAST_RANGE)])

        return Lookback(rows, len(GYROS), work)

"""Cumulative sums of each gyro's own readings, whitened: a change of mean or variance, no other sensor asked.

Source: E. S. Page, Continuous inspection schemes, Biometrika 41 (1954), doi:10.1093/biomet/41.1-2.100; as a sum of
log-likelihood ratios M. Basseville and I. Nikiforov, Detection of Abrupt Changes, Prentice Hall 1993, section 2.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from gtmbench.detectors.rivals.rival import Model, Rival
from gtmbench.detectors.rivals.signals import Generator, Lookback
from gtmbench.values.channels import GYROS


@dataclass(frozen=True, kw_only=True)
class RawCusum(Rival):
    """The gyros as they are, judged by Page's cumulative sums (`statistic.py`)."""

    name: str = "cusum"
    title: ClassVar[str] = "cumulative sums of each gyro's own readings"
    judge: str = "cusum"
    channels: ClassVar[tuple[str, ...]] = GYROS

    def generator(self, model: Model, sample_period_s: float) -> Generator:
        """Return what hands the readings on."""
        return Lookback(0, len(GYROS), lambda values: values)

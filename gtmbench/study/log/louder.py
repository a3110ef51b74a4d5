"""Residuals that stand far above what they were, though no test could make an alarm of it.

Where samples are lost all the time, windows stay short; where the noise has a heavy tail, what is large counts as an
outlier; and the noise may be of another level. Each of these is allowed for, and together they may hide what a reader
of the plot sees at once. Silence says nothing then.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.bank_detector import BankMonitor
from gtmbench.detectors.protocol import Watch
from gtmbench.values.record import FloatArray

TIMES = 5.0  # the largest of 30 public logs that end with 0 is 3.9
_WINDOW_S, _KNOWN = 20.0, 0.25  # of a window, may be judged


@dataclass(frozen=True)
class Louder:
    """A residual that stood so many times above what it was where learnt; from when to when that was most."""

    sensor: str
    times: float
    start_s: float
    end_s: float


def louder_than_learnt(watches: Sequence[Watch], times: float = TIMES) -> tuple[Louder, ...]:
    """Return the residuals whose RMS over 20 s, of samples that could have raised an alarm, is far above what it was.

    Parameters
    ----------
    watches : sequence of Watch
        Of a monitor that was identified on the same log, so that motion and noise are alike.
    times : float
        How far above, of RMS to RMS.
    """
    found: dict[str, Louder] = {}
    for watch in watches:
        monitor = watch.monitor
        if not isinstance(monitor, BankMonitor):
            continue
        window = max(round(_WINDOW_S / watch.record.sample_period_s), 1)
        for sensor, residual in watch.residuals.items():
            usual = float(monitor.operators[sensor].rms_residual[0])
            judged = np.where(watch.scores[sensor].armed, residual, np.nan)
            powers = _trailing_powers(judged, window)
            if not np.isfinite(powers).any():
                continue
            row = int(np.nanargmax(powers))
            far = float(np.sqrt(powers[row])) / usual if usual > 0.0 else 0.0
            if far > max(times, found[sensor].times if sensor in found else 0.0):
                end_s = watch.record.time_at(row)
                found[sensor] = Louder(sensor, far, max(end_s - _WINDOW_S, watch.record.start_s), end_s)
    return tuple(found.values())


def _trailing_powers(values: FloatArray, window: int) -> FloatArray:
    """Return mean squares over so many rows up to each; NaN where too few of them are known."""
    there = np.isfinite(values)
    sums, counts = (
        np.cumsum(np.concatenate([np.zeros(window), each])) for each in (np.square(np.where(there, values, 0.0)), there)
    )
    count = counts[window:] - counts[:-window]
    enough = count >= _KNOWN * window
    return np.where(enough, (sums[window:] - sums[:-window]) / np.maximum(count, 1.0), np.nan)

"""How healthy whitened residuals are: how much there is of them, and by the monitor's own calibrated test."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.statistics.statistic import Steadiness, glr
from gtmbench.values.record import FloatArray

MOST = 20.0  # deviations that one sample may count for


def energy(white: FloatArray) -> float:
    """Return a sum of squares in which no sample counts for more than `MOST` deviations; NaN is passed over."""
    return float(np.sum(np.square(np.clip(white[np.isfinite(white)], -MOST, MOST))))


def greatest(
    monitor: CalibratedBank, output: str, white: FloatArray, *, is_corrected: bool = False, enough: float = np.inf
) -> float:
    """Return how far a whitened residual gets towards its thresholds, 1 being there, over windows laid end to end.

    It stops at the first window that is beyond `enough`, where nobody asks how far the others are.

    The mean before is taken to be known, as the calibrated test knows it from the minute before an alarm. One that is
    corrected for a fault may be quiet: what was stuck had no noise. Of statistics other than the likelihood ratios the
    mean square is judged, by six deviations of chance.
    """
    whitener = monitor.whiteners[output]
    there = np.clip(white[np.isfinite(white)], -MOST, MOST)
    test, tolerance = monitor.bank.statistic, monitor.tolerances[output]
    period_s = monitor.sample_period_s
    if test.name != "glr":
        over = float(np.mean(np.square(there))) - tolerance.high if len(there) else 0.0
        return float(over / (6.0 * np.sqrt(2.0 / max(len(there), 1))))
    least = 0.0
    sums, squares = (np.concatenate([[0.0], np.cumsum(values)]) for values in (there, there * there))
    baseline, steadiness = test.baseline_s / period_s, Steadiness.of(whitener.unsteady)
    for rows in test.rows(period_s):
        ends = np.arange(len(there), rows - 1, -rows)
        if not len(ends):
            break
        mean = (sums[ends] - sums[ends - rows]) / rows
        power = np.maximum((squares[ends] - squares[ends - rows]) / rows, 1e-12)
        low = tolerance.low if test.two_sided and not is_corrected else 0.0
        chance = 1.0 / rows + 1.0 / baseline + 2.0 * whitener.slow
        of_mean, of_energy = glr(mean, power, rows, chance, tolerance.mean, low, tolerance.high, steadiness)
        window = f"{rows * period_s:g} s"
        limits = monitor.thresholds[output]
        least = max(least, float(of_mean.max()) / limits[f"mean {window}"])
        least = max(least, float(of_energy.max()) / limits[f"energy {window}"])
        if least > enough:
            break
    return least

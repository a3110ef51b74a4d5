"""What a monitor's tolerances and thresholds come to, in the unit of the sensor."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.bank.calibrated import CalibratedBank


def tolerated_shift(monitor: CalibratedBank, output: str) -> float:
    """Return the tolerated change of a residual's mean in the output's unit; inf where whitening removes means."""
    gain = _gain(monitor, output)
    return monitor.tolerances[output].mean / gain if gain else float("inf")


def slowest_drift(monitor: CalibratedBank, output: str) -> float:
    """Return the slope, in the output's unit per second, below which the tests of the mean never see a drift of it.

    A drift of slope b that has lasted shifts a window of L samples against the M of the baseline before it by
    b (L + M)/2 Ts; whitening takes that times sum(a)/deviation. Held against tolerance and threshold (noise left
    out); NaN for statistics without a mean.
    """
    test, period_s = monitor.bank.statistic, monitor.sample_period_s
    tolerance, thresholds = monitor.tolerances[output].mean, monitor.thresholds[output]
    gain = _gain(monitor, output)
    baseline = max(round(test.baseline_s / period_s), 6)
    least = []
    if not gain:
        return float("inf")
    if test.name == "glr":
        for rows in test.rows(period_s):
            threshold = max(thresholds[f"mean {rows * period_s:g} s"], 0.0)
            beyond = np.sqrt(2.0 * threshold * (1.0 / rows + 1.0 / baseline))
            least.append((tolerance + beyond) / ((rows + baseline) / 2.0 * period_s * gain))
    elif test.name == "cusum":
        least.append((tolerance + test.shift / 2.0) / (baseline / 2.0 * period_s * gain))
    return float(min(least, default=np.nan))


def _gain(monitor: CalibratedBank, output: str) -> float:
    """Return what a constant residual of 1 becomes, whitened: deviations over unit."""
    whitener = monitor.whiteners[output]
    return abs(float(np.sum(whitener.coefficients))) / whitener.deviation

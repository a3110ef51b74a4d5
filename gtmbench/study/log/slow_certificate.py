"""The smallest biases and drifts that means over tens of seconds would have shown: what a certificate promises of them.

Means are linear in what is added to a gyro, so the size that reaches a bound follows at once, from every second.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from gtmbench.faults.additive import Bias, Drift
from gtmbench.study.log.certificate import HALF, SHARE, Certificate, Smallest
from gtmbench.study.log.seconds import SECOND_S
from gtmbench.study.log.slow_means import WINDOWS, SlowMeans
from gtmbench.values.attitude import FASTEST_S, SLOWEST_S
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

_WITHIN_S = 60  # of its onset


def with_slow(certificate: Certificate, means: SlowMeans | None) -> Certificate:
    """Return a certificate whose biases and drifts are as small as slow means show them, where these are better.

    Parameters
    ----------
    certificate : Certificate
    means : SlowMeans or None
    """
    if means is None or not certificate.rows:
        return certificate
    within = min(_WITHIN_S, int(HALF * np.count_nonzero(means.is_watched)))
    rows = []
    for row in certificate.rows:
        slow = _smallest(means, row, within) if row.sensor in GYROS and row.kind in _INTEGRALS and within else None
        rows.append(slow if slow is not None and slow.hardness < row.hardness else row)
    return replace(certificate, rows=tuple(rows))


def _smallest(means: SlowMeans, row: Smallest, within: int) -> Smallest | None:
    """Return a row of the size that shows from most of the seconds, through the worse of the plausible estimators."""
    axis = GYROS.index(row.sensor)
    constants = (FASTEST_S, SLOWEST_S) if means.is_driven else (None,)
    found = [(_size(means, axis, row.kind, within, tau), tau) for tau in constants]
    size, tau = max(found, key=lambda each: each[0])
    if not np.isfinite(size):
        return None
    return Smallest(
        sensor=row.sensor, kind=row.kind, size=size, share=SHARE, within_s=within * SECOND_S, time_constant_s=tau
    )


def _size(means: SlowMeans, axis: int, kind: str, within: int, tau_s: float | None) -> float:
    """Return the size that shows from `SHARE` of the seconds on which anything could begin; infinite where none does.

    A fault may turn against what is there already.
    """
    elapsed = np.arange(within + 1, dtype=np.float64) * SECOND_S
    summed = _INTEGRALS[kind](elapsed, tau_s)
    least = np.full(len(means.error), np.inf)
    for window in WINDOWS:
        needed = np.nan_to_num(means.bounds[window] + np.abs(means.mean(window)), nan=np.inf)[:, axis]
        needed = np.concatenate([needed, np.full(within, np.inf)])
        shown = (summed[1:] - summed[np.maximum(np.arange(1, within + 1) - window, 0)]) / (window * SECOND_S)
        for later, share in enumerate(shown.tolist()):
            if share > 0.0:
                least = np.minimum(least, needed[later : later + len(least)] / share)
    begins = least[: len(least) - within][means.is_watched[: len(least) - within]]
    return float(np.quantile(begins, SHARE, method="higher")) if len(begins) else np.inf


def _bias(elapsed_s: FloatArray, tau_s: float | None) -> FloatArray:
    """Return the integral of what a bias of 1 leaves of a gyro less the attitude's rate."""
    if tau_s is None:
        return elapsed_s
    return np.asarray(elapsed_s - tau_s * (1.0 - np.exp(-elapsed_s / tau_s)))


def _drift(elapsed_s: FloatArray, tau_s: float | None) -> FloatArray:
    """Return the same of a drift of 1 a second."""
    if tau_s is None:
        return np.asarray(0.5 * np.square(elapsed_s))
    return np.asarray(0.5 * np.square(elapsed_s) - tau_s * _bias(elapsed_s, tau_s))


_INTEGRALS = {Bias.kind: _bias, Drift.kind: _drift}

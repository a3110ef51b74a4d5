"""The smallest biases and drifts that means over tens of seconds would have shown: what a certificate promises of them.

Means are linear in what is added to a gyro, so the size that reaches a bound follows at once, from every second.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.faults.additive import Bias, Drift
from gtmbench.study.log.seconds import SECOND_S, IntArray, trailing_means
from gtmbench.study.log.slow_means import WINDOWS, SlowMeans
from gtmbench.values.attitude import FASTEST_S, SLOWEST_S
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

_WITHIN_S = 60  # of its onset
_BLOCK = 4096  # onsets that are worked out at a time
_NOTHING = 1e-12  # of a weighted sum


@dataclass(frozen=True, kw_only=True)
class SlowSize:
    """A size that means would have shown, how long after its onset, and through which estimator, the worse one.

    Attributes
    ----------
    size : float
    within_s : float
    time_constant_s : float or None
    """

    size: float
    within_s: float
    time_constant_s: float | None


def slow_size(means: SlowMeans, sensor: str, kind: str, share: float) -> SlowSize | None:
    """Return the size that shows from a share of the seconds; None where none does, or of another kind of fault.

    Parameters
    ----------
    means : SlowMeans
    sensor, kind : str
    share : float
        Of the seconds that are logged and watched.

    Examples
    --------
    >>> from gtmbench.study.log.slow_means import slow_means
    >>> from gtmbench.values.record import Record
    >>> level = Record(np.zeros((3000, 6)), channels=[*GYROS, "phi", "theta", "psi"], sample_period_s=0.1)
    >>> means = slow_means([level], healthy=[(0.0, 100.0)], is_driven=False)
    >>> shown = slow_size(means, "q", "bias", 0.9)
    >>> round(shown.size, 6), shown.within_s, shown.time_constant_s
    (0.3, 60.0, None)
    """
    if sensor not in GYROS or kind not in _RATES:
        return None
    axis = GYROS.index(sensor)
    begins = _begins(means, axis)
    if not len(begins):
        return None
    constants = (FASTEST_S, SLOWEST_S) if means.is_driven else (None,)
    found = [(_size(means, axis, kind, begins, share, tau), tau) for tau in constants]
    size, tau = max(found, key=lambda each: each[0])
    return SlowSize(size=size, within_s=_WITHIN_S * SECOND_S, time_constant_s=tau) if np.isfinite(size) else None


def _begins(means: SlowMeans, axis: int) -> IntArray:
    """Return the seconds on which a fault is put: those that are watched and known, but for the last of them.

    What wasn't logged, or nobody can tell of, isn't watched: it counts for nothing. A fault that begins before what
    was identified on is learnt as healthy.
    """
    learnt = np.flatnonzero(~means.is_watched)
    seconds = np.flatnonzero(means.is_watched & np.isfinite(means.error[:, axis]))
    seconds = seconds[seconds > (learnt[-1] if len(learnt) else -1)]
    return seconds[: len(seconds) - min(_WITHIN_S, len(seconds) // 2)]


def _size(means: SlowMeans, axis: int, kind: str, begins: IntArray, share: float, tau_s: float | None) -> float:
    """Return the size that shows from a share of the seconds on which it begins; infinite where none does.

    A fault may turn against what is there already. Where the monitor was identified, no mean alarms.
    """
    errors = _RATES[kind](np.asarray((np.arange(_WITHIN_S) + 0.5) * SECOND_S), tau_s)
    known = np.where(np.isfinite(means.error[:, axis]), means.weight[:, axis], 0.0)
    ahead = np.lib.stride_tricks.sliding_window_view(np.append(known, np.zeros(_WITHIN_S)), _WITHIN_S)
    needs = [_needs(means, axis, window, known) for window in WINDOWS]
    least: list[FloatArray] = []
    for part in np.split(begins, range(_BLOCK, len(begins), _BLOCK)):
        # What of an error of 1 the seconds since its onset hold up to each, shape (begins, seconds since).
        summed = np.cumsum(ahead[part] * errors, axis=1)
        until, smallest = part[:, np.newaxis] + np.arange(_WITHIN_S), np.full(len(part), np.inf)
        for window, needed in zip(WINDOWS, needs, strict=True):
            shown = summed.copy()
            shown[:, window:] -= summed[:, :-window]
            sizes = needed[until] / np.maximum(shown, _NOTHING)
            smallest = np.minimum(smallest, sizes.min(axis=1))
        least.append(smallest)
    return float(np.quantile(np.concatenate(least), share, method="higher"))


def _needs(means: SlowMeans, axis: int, window: int, known: FloatArray) -> FloatArray:
    """Return the weighted sum of an error that reaches a window's bound up to each second; infinite where none does."""
    needed = (means.bounds[window] + np.abs(means.mean(window)))[:, axis] * window * trailing_means(known, window)
    needed = np.where(means.is_watched & np.isfinite(needed), needed, np.inf)
    return np.append(needed, np.full(_WITHIN_S, np.inf))


def _bias(elapsed_s: FloatArray, tau_s: float | None) -> FloatArray:
    """Return what a bias of 1 leaves of a gyro less the attitude's rate."""
    return np.ones(len(elapsed_s)) if tau_s is None else np.asarray(1.0 - np.exp(-elapsed_s / tau_s))


def _drift(elapsed_s: FloatArray, tau_s: float | None) -> FloatArray:
    """Return the same of a drift of 1 a second."""
    return elapsed_s if tau_s is None else np.asarray(elapsed_s - tau_s * _bias(elapsed_s, tau_s))


_RATES = {Bias.kind: _bias, Drift.kind: _drift}

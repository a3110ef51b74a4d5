"""Gyros integrated over the attitude's interval, where the attitude is logged more slowly than they are.

An attitude that is logged at 10 Hz has turned by all that the gyros measured in between, vibration and fast motion
included; a low-pass takes that from the gyros alone, for nothing can take it from samples that are so far apart. So
the gyros' integral is read at the attitude's stamps and laid on the record's clock exactly as the attitude is; its
central difference, a mean rate over two intervals, is to the gyro what the attitude's derivative is to the attitude.
What is constant stays constant, and a sample of the gyro moves readings no more than an interval away.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.intake.lattice import JITTER
from gtmbench.intake.resampling import HOLE, PAUSE, resampled
from gtmbench.values.clock import FloatArray
from gtmbench.values.record import BoolArray

_FASTER = 1.96  # times: an interval has to hold two samples to be integrated over; periods are measured
_LOST = HOLE + 1.0  # periods of the gyros, at least: a line over one lost sample, and jitter, is within the noise
_EXACT = 7  # decimals that an integral keeps of a rate, in deg/s
_SAME = 0.1  # of the record's period: the attitude comes at its rate


def is_integrated(gyros_s: Sequence[float], attitude_s: float, period_s: float) -> bool:
    """Tell by their periods whether a record's gyros are integrated over the attitude's intervals.

    >>> is_integrated([0.02], 0.1, 0.1), is_integrated([0.1], 0.1, 0.1), is_integrated([0.02], 0.02, 0.1)
    (True, False, False)
    """
    slow = abs(attitude_s / period_s - 1.0) <= _SAME
    return bool(gyros_s) and slow and all(_FASTER * gyro_s <= period_s for gyro_s in gyros_s)


def mean_rates(
    time_s: FloatArray, rates: FloatArray, attitude_s: FloatArray, first_s: float, period_s: float, count: int
) -> tuple[FloatArray, BoolArray]:
    """Return gyros' means over two intervals of the attitude at ``first_s + k period_s``, and where a sample is there.

    `time_s`, `rates`: the gyros: stamps in seconds, and samples, shape (samples, channels). `attitude_s`: the
    attitude's stamps. While it pauses, the integral is read at the record's own times. `first_s`, `period_s`, `count`:
    the record's clock. Shape (count, channels); NaN where samples are missing within the intervals. Whether a sample is
    there, if not known.

    >>> time_s = np.arange(100) * 0.01
    >>> mean_rates(time_s, time_s[:, np.newaxis], time_s[::10], 0.1, 0.1, 3)[0].ravel().round(9)
    array([0.1, 0.2, 0.3])
    """
    at_s = first_s + np.arange(-1, count + 1, dtype=np.float64) * period_s
    typical_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else period_s
    places = (attitude_s - first_s) / period_s
    beside_s = 0.0 if np.all(np.abs(places - np.rint(places)) <= JITTER) else period_s  # laid out by splines else
    paused = _without_samples(time_s, PAUSE * max(typical_s, period_s))
    away = _met(at_s[1:-1], at_s[1:-1], *paused)
    means, there = np.full((count, rates.shape[1]), np.nan), np.zeros((count, rates.shape[1]), dtype=bool)
    for column, values in enumerate(rates.T):
        known = np.isfinite(values)
        if np.count_nonzero(known) < 2:
            continue
        of_s, of = time_s[known], values[known]
        turned = integral(of_s, of, attitude_s)[:, np.newaxis]
        laid, _ = resampled(attitude_s, turned, at_s[0], period_s, len(at_s), filtered=False)
        like_attitude, own = _slope(laid[:, 0], period_s), _slope(integral(of_s, of, at_s), period_s)
        before_s, after_s = _without_samples(of_s, max(_LOST * typical_s, period_s))
        lost = _met(at_s[:-2] - beside_s, at_s[2:] + beside_s, before_s[1:-1], after_s[1:-1])
        slopes = np.where(np.isfinite(like_attitude), like_attitude, own)
        means[:, column] = np.where(lost, np.nan, slopes.round(_EXACT))  # a stuck gyro reads one value
        there[:, column] = np.isfinite(means[:, column]) | (~away & known.all())
    return means, there


def integral(time_s: FloatArray, values: FloatArray, at_s: FloatArray) -> FloatArray:
    """Return the integral of samples on straight lines from their first stamp to some times, NaN outside of them.

    >>> integral(np.array([0.0, 1.0, 2.0]), np.array([0.0, 2.0, 2.0]), np.array([0.5, 2.0]))
    array([0.25, 3.  ])
    """
    steps_s = np.diff(time_s)
    whole = np.concatenate([[0.0], np.cumsum(0.5 * steps_s * (values[1:] + values[:-1]))])
    place = np.clip(np.searchsorted(time_s, at_s, side="right") - 1, 0, len(time_s) - 2)
    since_s = at_s - time_s[place]
    risen = (values[place + 1] - values[place]) / steps_s[place]
    within = whole[place] + since_s * (values[place] + 0.5 * risen * since_s)
    near_s = 1e-6 * float(steps_s.min())
    return np.where((at_s >= time_s[0] - near_s) & (at_s <= time_s[-1] + near_s), within, np.nan)


def _slope(values: FloatArray, period_s: float) -> FloatArray:
    return np.asarray((values[2:] - values[:-2]) / (2.0 * period_s))


def _without_samples(time_s: FloatArray, longest_s: float) -> tuple[FloatArray, FloatArray]:
    """Return from when until when there is none: before the first, over steps that are longer, after the last."""
    if not len(time_s):
        return np.array([-np.inf]), np.array([np.inf])
    long = np.flatnonzero(np.diff(time_s) > longest_s)
    return np.concatenate([[-np.inf], time_s[long], time_s[-1:]]), np.concatenate(
        [time_s[:1], time_s[long + 1], [np.inf]]
    )


def _met(from_s: FloatArray, to_s: FloatArray, starts_s: FloatArray, ends_s: FloatArray) -> BoolArray:
    """Tell which spans meet the inside of any of some others, which are in time."""
    if not len(ends_s):
        return np.zeros(len(from_s), dtype=bool)
    place = np.searchsorted(ends_s, from_s, side="right")
    there = place < len(ends_s)
    return np.asarray(there & (starts_s[np.minimum(place, len(ends_s) - 1)] < to_s))

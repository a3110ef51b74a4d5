"""Threshold and alarms: when the windowed norm says that something broke."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.method.residual import WindowedNorm
from gtmbench.values.record import BoolArray, FloatArray, frozen


@dataclass(frozen=True, kw_only=True, eq=False)
class Alarms:
    """Upward crossings of a threshold.

    Attributes
    ----------
    time_s : shape (alarms,)
        When each alarm could be raised: (k + w + d) Ts for a crossing at window k.
    armed_s : float
        When the norm was first known to be at or below the threshold: from then on alarms are possible. NaN if never.
    threshold : float
        In the norm's unit.
    look_ahead_s, window_s : float
        d Ts and (w + 1) Ts: the spans of samples after k and from k on that an alarm at k has seen.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> norm = gb.WindowedNorm(
    ...        values=np.array([0.1, 0.2, 3.0]), time_s=np.arange(3.0), window=0, look_ahead_s=0.5, sample_period_s=1.0
    ... )
    >>> found = gb.alarms(norm, threshold=1.0)
    >>> found.time_s.tolist(), found.armed_s
    ([2.5], 0.5)
    """

    time_s: FloatArray
    armed_s: float
    threshold: float
    look_ahead_s: float
    window_s: float


def threshold(norm: WindowedNorm, *, start_s: float, end_s: float, factor: float = 1.5) -> float:
    """Return a threshold from a healthy record: `factor` times the greatest E(k) with start_s <= k Ts <= end_s.

    Parameters
    ----------
    norm : WindowedNorm
        Of a healthy record.
    start_s, end_s : float
        The span of k Ts to use, in seconds.
    factor : float
        Times the greatest E(k).

    Raises
    ------
    InputError
        If no complete window begins in that span.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> norm = gb.WindowedNorm(values=np.array([9.0, 1.0, 2.0]), time_s=np.arange(3.0), window=0,
    ...                        look_ahead_s=0.0, sample_period_s=1.0)
    >>> gb.threshold(norm, start_s=1.0, end_s=2.0, factor=1.5)
    3.0
    """
    factor = number("factor", factor, 0.0, above=True)
    inside = (norm.time_s >= start_s - 1e-9) & (norm.time_s <= end_s + 1e-9) & np.isfinite(norm.values)
    if not inside.any():
        raise InputError(
            f"no complete window begins in {start_s:g}..{end_s:g} s, so there is no threshold; choose another span, "
            "a shorter window or a longer record"
        )
    return float(factor * norm.values[inside].max())


def check_start(start_s: float) -> None:
    """Refuse a time to watch from that isn't one; -inf means from the first window on."""
    if not isinstance(start_s, Real) or isinstance(start_s, bool) or not start_s < np.inf:
        raise InputError(f"start_s is {start_s!r}; give seconds")


def came_down(values: FloatArray, threshold: float) -> BoolArray:
    """Return where a score is armed, shape (samples,): it exists, and it or one before was at or below the threshold.

    The one arming rule: what stands above from the start has to come down before it can alarm.

    >>> came_down(np.array([3.0, np.nan, 1.0, 4.0, np.nan]), 2.0).tolist()
    [False, False, True, True, False]
    """
    there = ~np.isnan(values)
    with np.errstate(invalid="ignore"):
        low = there & (values <= threshold)
    return np.asarray(there & np.logical_or.accumulate(low))


def rising(values: FloatArray, threshold: float) -> NDArray[np.int_]:
    """Return the rows where a score rises above its threshold, having been at or below it; NaN is passed over.

    >>> rising(np.array([3.0, 1.0, np.nan, 4.0, 5.0, 1.0, 6.0]), 2.0).tolist()
    [3, 6]
    """
    there = np.flatnonzero(~np.isnan(values))
    above = values[there] > threshold
    return np.asarray(there[above & ~np.concatenate([[True], above])[:-1]])


def alarms(norm: WindowedNorm, threshold: float, *, start_s: float = -np.inf) -> Alarms:
    """Return the alarms of windows that begin at or after `start_s`.

    An alarm is a window above the threshold after one at or below it. A norm that is above from the start (a flight's
    transient) must come down first. Windows with missing samples are passed over.

    Parameters
    ----------
    norm : WindowedNorm
    threshold : float
        In the norm's unit.
    start_s : float
        k Ts of the first window that is watched, in seconds, by default all.

    Raises
    ------
    InputError
        If the threshold isn't a positive number.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> norm = gb.WindowedNorm(values=np.array([0.0, 2.0, 2.0, 0.0, 2.0]), time_s=np.arange(5.0), window=0,
    ...                        look_ahead_s=0.5, sample_period_s=1.0)
    >>> gb.alarms(norm, 1.0).time_s
    array([1.5, 4.5])
    """
    threshold = number("threshold", threshold, 0.0, above=True)
    check_start(start_s)
    watched = norm.time_s >= start_s - 1e-9
    values, known_s = norm.values[watched], norm.known_s[watched]
    armed = came_down(values, threshold)
    return Alarms(
        time_s=frozen(known_s[rising(values, threshold)]),
        armed_s=float(known_s[np.argmax(armed)]) if armed.any() else float("nan"),
        threshold=threshold,
        look_ahead_s=norm.look_ahead_s,
        window_s=(norm.window + 1) * norm.sample_period_s,
    )

"""Threshold and alarms: when the windowed norm says that something broke."""

from __future__ import annotations

from dataclasses import dataclass
from numbers import Real

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.method.residual import WindowedNorm
from gtmbench.record import FloatArray, frozen


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
    """

    time_s: FloatArray
    armed_s: float
    threshold: float
    look_ahead_s: float
    window_s: float


def threshold(norm: WindowedNorm, *, start_s: float, end_s: float, factor: float = 1.5) -> float:
    """Return a threshold from a healthy record: `factor` times the greatest E(k) with start_s <= k Ts <= end_s.

    Raises
    ------
    InputError
        Where no complete window begins in that span.

    Examples
    --------
    >>> norm = WindowedNorm(values=np.array([9.0, 1.0, 2.0]), time_s=np.arange(3.0), window=0,
    ...                     look_ahead_s=0.0, sample_period_s=1.0)
    >>> threshold(norm, start_s=1.0, end_s=2.0, factor=1.5)
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


def alarms(norm: WindowedNorm, threshold: float, *, start_s: float = -np.inf) -> Alarms:
    """Return the alarms of windows that begin at or after `start_s`.

    An alarm is a window above the threshold after one at or below it; a norm that is above from the start (a
    flight's transient) has to come down first. Windows with missing samples are passed over.

    Raises
    ------
    InputError
        Where the threshold isn't a positive number.

    Examples
    --------
    >>> norm = WindowedNorm(values=np.array([0.0, 2.0, 2.0, 0.0, 2.0]), time_s=np.arange(5.0), window=0,
    ...                     look_ahead_s=0.5, sample_period_s=1.0)
    >>> alarms(norm, 1.0).time_s
    array([1.5, 4.5])
    """
    threshold = number("threshold", threshold, 0.0, above=True)
    check_start(start_s)
    watched = np.flatnonzero((norm.time_s >= start_s - 1e-9) & ~np.isnan(norm.values))
    above = norm.values[watched] > threshold
    rising = above & ~np.concatenate([[True], above])[:-1]
    known_s = norm.known_s[watched]
    return Alarms(
        time_s=frozen(known_s[rising]),
        armed_s=float(known_s[~above][0]) if not above.all() else float("nan"),
        threshold=threshold,
        look_ahead_s=norm.look_ahead_s,
        window_s=(norm.window + 1) * norm.sample_period_s,
    )

"""Even clocks behind stamps that are rounded, jitter a little or leave samples out: which period, which samples."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from gtmbench.values.clock import FloatArray
from gtmbench.values.pieces import joined, pieces

JITTER = 0.02  # of a period, either way: an interpolation's error would be greater
_EXACT_S = 2e-9  # stamps of an exact clock are rounded to the nanosecond
_DISTINCT = 0.9  # of the samples: with more stamps than that, equal ones are doubles and not rounded
GRAINS_S = (0.1, 0.01, 1e-3, 1e-4, 1e-5, 1e-6)  # to which loggers round stamps


@dataclass(frozen=True, kw_only=True, eq=False)
class Lattice:
    """An even clock."""

    period_s: float
    times: tuple[FloatArray, ...]  # one a span: its samples' times on the even clock, of which some may be left out
    jitter_s: float  # how far the stamps are from it, at most


def find_lattice(spans: Sequence[FloatArray]) -> Lattice | None:
    """Return the even clock of some spans' stamps, each span with its own start; None where there isn't one.

    >>> stamps = np.round(np.arange(200) / 60, 3)  # 60 Hz, rounded to the millisecond
    >>> round(1 / find_lattice([stamps]).period_s, 9)
    60.0
    """
    period_s = typical_period(joined([np.diff(span) for span in spans], np.float64))
    if period_s is None:
        return None
    places = [_places(span, period_s) for span in spans]
    if any(np.any(np.diff(place) < 1) for place in places):
        return None
    period_s = _fitted(spans, places, period_s)
    tolerance_s = _tolerance(spans, period_s)
    jitter_s = _jitter(spans, places, period_s)
    for candidate in (1.0 / max(round(1.0 / period_s), 1), round(period_s, 6), round(period_s, 9)):
        if candidate > 0 and _jitter(spans, places, candidate) <= max(
            1.05 * jitter_s, _EXACT_S + _grain_of_doubles(spans)
        ):
            period_s = candidate
            jitter_s = _jitter(spans, places, candidate)
            break
    if jitter_s > tolerance_s:
        return None
    exact = jitter_s <= _EXACT_S + _grain_of_doubles(spans)
    times = tuple(
        span if exact else place * period_s + _middle(span - place * period_s)
        for span, place in zip(spans, places, strict=True)
    )
    return Lattice(period_s=period_s, times=times, jitter_s=0.0 if exact else jitter_s)


def typical_period(steps: FloatArray) -> float | None:
    """Return the mean of the steps that are one or two of the median; None where there are none.

    >>> round(typical_period(np.array([0.01, 0.0101, 0.0099, 0.0199, 0.5])), 6)
    0.00998
    """
    if not len(steps):
        return None
    few = steps / float(np.median(steps))
    np.rint(few, out=few)
    near = (few >= 1) & (few <= 2)
    if near.all():
        return float(steps.sum() / few.sum())
    return float(steps[near].sum() / few[near].sum()) if near.any() else None


def _places(span: FloatArray, period_s: float) -> FloatArray:
    """Return how many periods after the first each stamp is."""
    places = np.empty_like(span)
    places[0] = 0.0
    steps = np.subtract(span[1:], span[:-1], out=places[1:])
    steps /= period_s
    np.rint(steps, out=steps)
    np.cumsum(steps, out=steps)
    return places


def rounded_coarsely(time_s: FloatArray) -> FloatArray | None:
    """Return the even times of samples whose stamps are rounded to more than their period, None where they aren't.

    >>> spread = rounded_coarsely(np.floor(np.arange(1000) * 0.01 * 10) / 10)  # 100 Hz, tenths of a second
    >>> np.allclose(np.diff(spread), 0.01)
    True
    """
    steps = np.diff(time_s)
    grain_s = float(steps[steps > 0].min(initial=np.inf))
    distinct = np.count_nonzero(steps > 0) + 1
    block = min(int(20 * len(time_s) / distinct) + 1, len(time_s) // 2)
    if distinct < 10 or distinct > _DISTINCT * len(time_s):
        return None
    period_s = float(np.median(time_s[block:] - time_s[:-block])) / block
    cuts = np.flatnonzero(steps > period_s + grain_s * 1.001) + 1
    if period_s <= 0.0 or grain_s < 0.4 * period_s or len(cuts) > 100:
        return None
    spans = np.split(time_s, cuts)
    places = [np.arange(len(span), dtype=np.float64) for span in spans]
    candidates = (period_s, 1.0 / max(round(1.0 / period_s), 1), _fitted(spans, places, period_s))
    period_s = min(candidates, key=lambda candidate: _jitter(spans, places, candidate))
    if _jitter(spans, places, period_s) > 0.51 * grain_s:
        return None
    return np.concatenate([p * period_s + _middle(s - p * period_s) for s, p in zip(spans, places, strict=True)])


def _fitted(spans: Sequence[FloatArray], places: Sequence[FloatArray], guess_s: float) -> float:
    """Return the period that fits best, every span with its own start."""
    above, below = 0.0, 0.0
    for span, place in zip(spans, places, strict=True):
        centred = place - place.mean()
        above += float(centred @ (span - span.mean()))
        below += float(centred @ centred)
    return above / below if below > 0 and above > 0 else guess_s


def _jitter(spans: Sequence[FloatArray], places: Sequence[FloatArray], period_s: float) -> float:
    worst = 0.0
    for span, place in zip(spans, places, strict=True):
        parts = [span[rows] - place[rows] * period_s for rows in pieces(len(span))]
        worst = max(worst, (max(float(part.max()) for part in parts) - min(float(part.min()) for part in parts)) / 2)
    return worst


def _middle(values: NDArray[np.float64]) -> float:
    return 0.5 * float(values.min() + values.max())


def _tolerance(spans: Sequence[FloatArray], period_s: float) -> float:
    """Return how far stamps may be from an even clock: rounding, where all are rounded, and a little jitter."""
    for grain_s in GRAINS_S:
        if grain_s <= 0.4 * period_s and all(
            is_rounded(span[rows], grain_s) for span in spans for rows in pieces(len(span))
        ):
            return max(0.51 * grain_s, JITTER * period_s)
    return JITTER * period_s


def is_rounded(time_s: FloatArray, grain_s: float) -> bool:
    """Tell whether stamps are whole numbers of a grain."""
    stamps = time_s / grain_s
    return bool(np.all(np.abs(stamps - np.rint(stamps)) < 1e-3))


def _grain_of_doubles(spans: Sequence[FloatArray]) -> float:
    return 2.0 * float(np.spacing(max(abs(edge) for span in spans for edge in (span.min(), span.max()))))

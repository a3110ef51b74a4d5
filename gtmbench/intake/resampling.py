"""Another sample rate: values at even times, cubic splines between stamps, and one low-pass for all channels."""

from __future__ import annotations

import itertools
import math

import numpy as np

from gtmbench.checks import whole
from gtmbench.clock import FloatArray
from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import check_values
from gtmbench.intake.lattice import JITTER
from gtmbench.pieces import pieces
from gtmbench.record import BoolArray, Record, check_record

HALF = 13  # half of the low-pass's length, in samples of the result
_CUTOFF = 0.8  # of the new Nyquist frequency
_KAISER = 7.86  # beta of a ripple of 1e-4
PAUSE = 2.5  # periods, its own or the record's: a step that is longer is a pause; shorter ones miss a sample or two
HOLE = 1.75  # periods: between stamps that are further apart nothing is interpolated
_SAME_RATE = 0.1  # of the median steps of rounded stamps


def decimate(record: Record, factor: int) -> Record:
    """Return every `factor`-th sample of all channels, low-pass filtered before.

    The filter (Kaiser, 26 factor + 1 taps, zero phase) is flat within 1e-4 up to 60 % of the new Nyquist frequency and
    leaves less than 1e-4 of what lies above it. It is the same for every channel, so the operator between them stays
    the same. Only complete results are kept: 13 new samples go at either end. A missing sample makes those missing that
    need it, and no others.

    Parameters
    ----------
    record : Record
    factor : int
        1 leaves the record as it is.

    Raises
    ------
    InputError
        Where the factor isn't a whole number of 1 or more, or the record is too short.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> record = gb.Record(np.ones(1001), channels=["p"], sample_period_s=0.01)
    >>> gb.decimate(record, 10)
    Record(75 samples, 1.3..8.7 s, every 0.1 s: p)
    """
    check_record(record)
    factor = whole("factor", factor, 1)
    if factor == 1:
        return record
    half = HALF * factor
    if len(record) < 2 * half + 1:
        raise InputError(
            f"{len(record)} samples are too few to keep one in {factor}: the filter takes {2 * half + 1}; choose a "
            "smaller factor or a longer record"
        )
    # result m stands at sample m factor - half and is complete from m = 2 half / factor on
    kept = slice(2 * HALF, (len(record) - 1) // factor + 1)
    return Record(
        _low_passed(record.values, factor, kept),
        channels=record.channels,
        sample_period_s=record.sample_period_s * factor,
        start_s=record.start_s + round(half * record.sample_period_s, 9),
    )


def oversampling(period_s: float, wanted_s: float) -> int:
    """Return how many times finer than wanted a channel has to be laid out to be filtered: 1 where it isn't filtered.

    >>> oversampling(0.004, 0.02), oversampling(0.02, 0.02), oversampling(0.019, 0.02), oversampling(0.0066, 0.02)
    (5, 1, 1, 4)
    """
    return 1 if period_s >= _CUTOFF * wanted_s else math.ceil(wanted_s / period_s * (1.0 - 1e-3))


def resampled(
    time_s: FloatArray, values: FloatArray, first_s: float, period_s: float, count: int, *, filtered: bool
) -> tuple[FloatArray, BoolArray]:
    """Return values at ``first_s + k period_s``, shape (count, channels), and where a sample is there, if not known.

    The low-pass is the same for every channel, also for those that come at the wanted rate, so the operator between
    channels stays the same; it needs `HALF` samples more at either end. As many beside a pause are there, but aren't
    known (NaN): whatever a filter made of one side alone would let vibration pass, and that looks like a fault. So it
    is with a single sample that was left out, which is no pause, and those about it.
    """
    typical_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else period_s
    finer = oversampling(typical_s, period_s)
    margin = HALF if filtered else 0
    laid_out = (count - 1 + 2 * margin) * finer + 1
    check_values(laid_out * values.shape[1], "laying out the channels evenly")
    rows = None if filtered else _in_place(time_s, first_s, period_s, count)
    if rows is not None:
        return values[rows], np.isfinite(values[rows])
    hole_s = max(HOLE * typical_s, period_s if finer > 1 else 0.0)
    at_s = first_s - margin * period_s + np.arange(laid_out, dtype=np.float64) * (period_s / finer)
    laid = np.full((laid_out, values.shape[1]), np.nan)
    there = np.zeros(laid.shape, dtype=bool)
    cuts = np.flatnonzero(np.diff(time_s) > PAUSE * max(typical_s, period_s)) + 1
    for first, last in itertools.pairwise([0, *cuts.tolist(), len(time_s)]):
        if first < last:
            _lay(laid, at_s, period_s / finer, time_s[first:last], values[first:last], typical_s, hole_s)
            lives = slice(*np.searchsorted(at_s, [time_s[first], time_s[last - 1]]))
            there[lives] |= np.isfinite(values[first:last]).all(axis=0)
    there |= np.isfinite(laid)
    if not filtered:
        return laid, there
    return _low_passed(laid, finer, slice(2 * HALF, 2 * HALF + count)), there[HALF * finer :: finer][:count]


def _in_place(time_s: FloatArray, first_s: float, period_s: float, count: int) -> slice | None:
    """Return the rows that are the samples of an even clock, one by one; None where they aren't."""
    begin = int(np.searchsorted(time_s, first_s - JITTER * period_s))
    if begin + count > len(time_s):
        return None
    for rows in pieces(count):
        places = (time_s[begin + rows.start : begin + rows.stop] - first_s) / period_s
        if np.any(np.abs(places - np.arange(rows.start, rows.stop)) > JITTER):
            return None
    return slice(begin, begin + count)


def _lay(
    laid: FloatArray,
    at_s: FloatArray,
    step_s: float,
    time_s: FloatArray,
    values: FloatArray,
    typical_s: float,
    hole_s: float,
) -> None:
    """Lay samples between two pauses out at even times: as they are where they stand on that clock, else by splines."""
    places = (time_s - at_s[0]) / step_s
    nearest = np.rint(places).astype(np.int64)
    same_rate = abs(typical_s / step_s - 1.0) <= _SAME_RATE and np.all(np.diff(nearest) > 0)
    if same_rate and np.all(np.abs(places - nearest) <= JITTER):
        inside = (nearest >= 0) & (nearest < len(laid))
        laid[nearest[inside]] = values[inside]
        return
    near_s = 1e-6 * step_s
    rows = slice(*np.searchsorted(at_s, [time_s[0] - near_s, time_s[-1] + near_s]))
    there = np.isfinite(values)
    if there.all():
        laid[rows] = _spline(time_s, values, at_s[rows], hole_s, near_s)
        return
    for column, own, known in zip(laid.T, values.T, there.T, strict=True):
        column[rows] = _spline(time_s[known], own[known], at_s[rows], hole_s, near_s)


def _low_passed(values: FloatArray, factor: int, kept: slice) -> FloatArray:
    """Return those of every `factor`-th value, low-pass filtered, that are `kept`: where the filter is complete."""
    from scipy.signal import firwin, upfirdn

    taps = firwin(2 * HALF * factor + 1, _CUTOFF / factor, window=("kaiser", _KAISER))
    return np.column_stack([upfirdn(taps / taps.sum(), column, down=factor)[kept] for column in values.T])


def _spline(time_s: FloatArray, values: FloatArray, at_s: FloatArray, hole_s: float, near_s: float) -> FloatArray:
    """Return a cubic spline's values, NaN outside the samples and where the nearest two are too far apart."""
    from scipy.interpolate import CubicSpline

    if len(time_s) < 2:
        return np.full((len(at_s), *values.shape[1:]), np.nan)
    # times are counted from the span's start: cubes of large numbers lose digits
    spline: FloatArray = CubicSpline(time_s - time_s[0], values)(at_s - time_s[0])
    after = np.clip(np.searchsorted(time_s, at_s, side="right"), 1, len(time_s) - 1)
    left_s, right_s = at_s - time_s[after - 1], time_s[after] - at_s
    beside = (np.abs(left_s) <= near_s) | (np.abs(right_s) <= near_s)
    between = (left_s >= 0) & (right_s >= 0) & (left_s + right_s <= hole_s)
    spline[~(beside | between)] = np.nan
    return spline

"""Samples laid on an even clock: as they are where they stand on it, cubics between stamps, one low-pass for all.

What is laid at a place depends on a few samples before and after it and on nothing else (`laid`). So a stream that
waits for these gives what a log gives, wherever its pieces end; both go through here.

A lost sample is no hole. Where a step misses a sample or two, it is told by its neighbours if those just before are
told by theirs to within their noise; where motion is faster than that, it stays missing rather than wrong.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.intake.formats.limits import check_values
from gtmbench.intake.lattice import JITTER
from gtmbench.values.clock import FloatArray
from gtmbench.values.pieces import pieces
from gtmbench.values.record import BoolArray, Record, check_record, sealed

HALF = 13  # half of the low-pass's length, in samples of the result
PAUSE = 3.5  # periods, its own or the record's: a step that is longer is a pause; shorter ones miss a sample or two
HOLE = 1.75  # periods: a step that is longer misses a sample
AFTER = 6  # samples after a place that what is laid there depends on: an interval's end, its slope, and `_ROUNDS`
_ROUNDS = AFTER - 2  # of slopes towards the spline's
_CUTOFF = 0.8  # of the new Nyquist frequency
_KAISER = 7.86  # beta of a ripple of 1e-4
_FASTER = 0.77  # of the wanted period: what comes more often is filtered; off the usual ratios (4/5, 5/6, 3/4)
_SLACK = 0.25  # in how many times faster: periods are measured
_LOOK = 48  # samples before a lost one, by every other of which its neighbours are tried: those between say the same
_FEWEST = 8  # tried
_SPARSE = (
    1.33  # times as long as they should take: where a quarter is lost, a sensor fails, and what it lost is missing
)
_BEYOND = 1.5  # times the noise's variance, told by others
_LOOSER = 1.7  # times that: by others further apart, where noise differs more; and where a low-pass spreads an error
_SMALL = 1e-4  # of the variance in that look: an error that is no matter, were there no noise at all
_SECONDS = 0.12  # a step that is longer lost more than can be told: motion that is sampled so seldom looks like noise
_AT_ONCE = 512  # lost samples

_Rows = NDArray[np.int64]


def decimate(record: Record, factor: int) -> Record:
    """Low-pass filter all channels and return every `factor`-th sample.

    The filter (Kaiser, 26 factor + 1 taps, zero phase) is flat within 1e-4 up to 60 % of the new Nyquist frequency and
    leaves less than 1e-4 of what lies above it. It is the same for every channel, so the operator between them stays
    the same. Only complete results are kept: 13 new samples go at either end. A missing sample makes only those missing
    that need it.

    Parameters
    ----------
    record : Record
    factor : int
        1 leaves the record as it is.

    Raises
    ------
    InputError
        If the factor isn't a whole number of 1 or more, or the record is too short.

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
    return Record(
        low_passed(record.values, factor)[: (len(record) - 1 - 2 * half) // factor + 1],
        channels=record.channels,
        sample_period_s=record.sample_period_s * factor,
        start_s=record.start_s + round(half * record.sample_period_s, 9),
    )


def oversampling(period_s: float, wanted_s: float) -> int:
    """Return how many times finer than wanted a channel has to be laid out to be filtered: 1 where it isn't filtered.

    >>> oversampling(0.004, 0.02), oversampling(0.02, 0.02), oversampling(0.016, 0.02), oversampling(0.0062, 0.02)
    (5, 1, 1, 3)
    """
    return 1 if period_s >= _FASTER * wanted_s else math.ceil(wanted_s / period_s - _SLACK)


def nominal(typical_s: float, period_s: float) -> float:
    """Return what a source's measured period is meant to be: the wanted one where it is near, so that all agree on it.

    >>> nominal(0.01004, 0.01), nominal(0.008, 0.01)
    (0.01, 0.008)
    """
    # a source's period that is so close to the wanted one is meant to be that
    return period_s if abs(typical_s / period_s - 1.0) <= 0.02 else typical_s


@dataclass(frozen=True, kw_only=True)
class Places:
    """Even times on which a track's samples are laid: place i is at ``start_s + i step_s``."""

    start_s: float  # start_s, period_s: place 0, and the wanted period
    period_s: float
    typical_s: float  # the period of the samples
    finer: int = 1  # places in a wanted period: more than one only where a low-pass follows

    @property
    def step_s(self) -> float:
        """From place to place."""
        return self.period_s / self.finer

    @property
    def longest_s(self) -> float:
        """The longest step between two samples that isn't a pause."""
        return PAUSE * max(self.typical_s, self.period_s)

    @property
    def lost_s(self) -> float:
        """A step that is longer has lost samples that matter: their neighbours are tried."""
        return max(HOLE * self.typical_s, self.period_s if self.finer > 1 else 0.0)

    @property
    def near_s(self) -> float:
        """How close to a place a sample has to stand to be laid there as it is."""
        return 1e-3 * self.step_s  # a sample that is closer to a place stands on it

    @property
    def before(self) -> int:
        """How many samples before a place may tell what is laid there."""
        return 2 * (_LOOK + 4 * self._apart(self.longest_s) + 8)  # every other one may be missing

    def _apart(self, step_s: float) -> int:
        """Return how many samples apart others have to be to be missed like those that a step lost."""
        return max(math.ceil(step_s / (2.0 * self.typical_s) - 0.25), 1)

    def apart(self, steps_s: FloatArray) -> _Rows:
        """Return how many samples apart others have to be to be missed like those that steps lost."""
        return np.array([self._apart(step_s) for step_s in steps_s.tolist()], dtype=np.int64)

    def times_s(self, first: int, stop: int) -> FloatArray:
        """Return the times of some places."""
        return self.start_s + np.arange(first, stop, dtype=np.float64) * self.step_s


def resampled(
    time_s: FloatArray,
    values: FloatArray,
    first_s: float,
    period_s: float,
    count: int,
    *,
    filtered: bool,
    typical_s: float | None = None,
) -> tuple[FloatArray, BoolArray]:
    """Return values at ``first_s + k period_s``, shape (count, channels), and where a sample is there, if not known.

    The low-pass is the same for every channel, also for those that come at the wanted rate, so the operator between
    channels stays the same; it needs `HALF` samples more at either end. As many beside a pause are there, but aren't
    known (NaN): whatever a filter made of one side alone would let vibration pass, and that looks like a fault.
    """
    if typical_s is None:
        typical_s = float(np.median(np.diff(time_s))) if len(time_s) > 1 else period_s
    typical_s = nominal(typical_s, period_s)
    finer = oversampling(typical_s, period_s) if filtered else 1
    margin = HALF if filtered else 0
    stop = (count - 1 + 2 * margin) * finer + 1
    check_values(stop * values.shape[1], "laying out the channels evenly")
    rows = None if filtered else _in_place(time_s, first_s, period_s, count)
    if rows is not None and np.isfinite(values[rows]).all():
        return values[rows], np.ones((count, values.shape[1]), dtype=bool)
    places = Places(start_s=first_s - margin * period_s, period_s=period_s, typical_s=typical_s, finer=finer)
    out, there = np.empty((stop, values.shape[1])), np.empty((stop, values.shape[1]), dtype=bool)
    for part in pieces(stop):
        near_s = places.times_s(part.start, part.stop)[[0, -1]]
        first, last = np.searchsorted(time_s, near_s)
        used = slice(max(int(first) - places.before, 0), int(last) + 4 * AFTER)
        out[part], there[part] = laid(places, time_s[used], values[used], part.start, part.stop)
    if not filtered:
        return out, there
    return low_passed(out, finer), there[HALF * finer :: finer][:count]


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


def low_passed(values: FloatArray, factor: int) -> FloatArray:
    """Return every `factor`-th value, low-pass filtered, where the filter is complete: from `HALF` of them on."""
    from scipy.signal import upfirdn

    kept = slice(2 * HALF, (len(values) - 1) // factor + 1)
    return np.column_stack([upfirdn(_taps(factor), column, down=factor)[kept] for column in values.T])


@cache
def _taps(factor: int) -> FloatArray:
    from scipy.signal import firwin

    taps: FloatArray = firwin(2 * HALF * factor + 1, _CUTOFF / factor, window=("kaiser", _KAISER))
    return sealed(taps / taps.sum())


def laid(places: Places, time_s: FloatArray, values: FloatArray, first: int, stop: int) -> tuple[FloatArray, BoolArray]:
    """Return values at some places, shape (places, channels), NaN where they aren't known; and where a sample is there.

    A sample is there, if not known, where those beside the place are.

    `time_s`, `values`: samples: increasing stamps, shape (samples,), and values, shape (samples, channels), NaN where
    one is missing. Those that tell: `Places.before` of them before the first place, `AFTER` of them after the last.
    `first`, `stop`: the places.

    >>> places = Places(start_s=0.0, period_s=0.1, typical_s=0.1)
    >>> time_s = np.arange(60) * 0.1 + 0.05
    >>> laid(places, time_s, time_s[:, np.newaxis] ** 2, 20, 23)[0].ravel().round(9)
    array([4.  , 4.41, 4.84])
    """
    at_s = places.times_s(first, stop)
    if not len(time_s):
        return np.full((len(at_s), values.shape[1]), np.nan), np.zeros((len(at_s), values.shape[1]), dtype=bool)
    known = np.isfinite(values)
    before, after = _beside(time_s, at_s)
    left_s, right_s = at_s - time_s[before], time_s[after] - at_s
    on = np.minimum(np.abs(left_s), np.abs(right_s)) <= places.near_s
    stands = np.where(left_s <= right_s, before, after)[on]
    between = ~on & (left_s >= 0.0) & (right_s >= 0.0) & (left_s + right_s <= places.longest_s)
    out = np.full((len(at_s), values.shape[1]), np.nan)
    out[on] = values[stands]
    if known.all():
        if between.any():
            out[between] = _between(places, time_s, values, at_s[between], before[between])
        return out, np.broadcast_to((on | between)[:, np.newaxis], out.shape).copy()
    there = between[:, np.newaxis] & known[before] & known[after]
    there[on] = known[stands]
    for column, own, known_one in zip(out.T, values.T, known.T, strict=True):
        own_s, wanted_s = time_s[known_one], at_s[np.isnan(column)]
        if len(own_s) and len(wanted_s):
            of, own = _beside(own_s, wanted_s)[0], own[known_one, np.newaxis]
            column[np.isnan(column)] = _between(places, own_s, own, wanted_s, of)[:, 0]
    return out, there | np.isfinite(out)


def _beside(time_s: FloatArray, at_s: FloatArray) -> tuple[_Rows, _Rows]:
    """Return the samples before and after some times; the nearest two beyond either end."""
    after = np.clip(np.searchsorted(time_s, at_s, side="right"), min(1, len(time_s) - 1), len(time_s) - 1)
    return np.maximum(after - 1, 0), after


def _between(places: Places, time_s: FloatArray, values: FloatArray, at_s: FloatArray, before: _Rows) -> FloatArray:
    """Return a cubic's values between samples, NaN beyond them, in pauses and where lost samples can't be told."""
    after = np.minimum(before + 1, len(time_s) - 1)
    steps_s, since_s = time_s[after] - time_s[before], at_s - time_s[before]
    inside = (since_s >= 0.0) & (since_s <= steps_s) & (steps_s > 0.0) & (steps_s <= places.longest_s)
    if not inside.all():
        apart = np.full((len(at_s), values.shape[1]), np.nan)
        if inside.any():
            apart[inside] = _between(places, time_s, values, at_s[inside], before[inside])
        return apart
    is_first = np.append(True, before[1:] != before[:-1])
    starts, which = before[is_first], np.cumsum(is_first) - 1
    step = (time_s[starts + 1] - time_s[starts])[:, np.newaxis]
    lefts, rises = values[starts], values[starts + 1] - values[starts]
    slopes = _slopes(time_s, values, starts, places.longest_s)
    # Hermite's cubic, u from 0 to 1: y_0 + u (dy + (1 - u) ((1 - u) (m_0 h - dy) + u (dy - m_1 h)))
    bends = slopes[0] * step - rises, rises - slopes[1] * step
    # over lost samples it is told only where those before would have been told so
    lost = np.flatnonzero(step[:, 0] > places.lost_s)
    if len(lost):
        lefts[lost] = np.where(_are_predictable(places, time_s, values, starts[lost]), lefts[lost], np.nan)
    u = (since_s / steps_s)[:, np.newaxis]
    out: FloatArray = bends[0][which]
    out += u * (bends[1][which] - out)
    out *= 1.0 - u
    out += rises[which]
    out *= u
    out += lefts[which]
    return out


def _slopes(time_s: FloatArray, values: FloatArray, starts: _Rows, longest_s: float) -> tuple[FloatArray, FloatArray]:
    """Return the slopes at either end of some intervals: nearly the cubic spline's, of `AFTER` samples either way.

    They begin as the parabolas' through three samples, and a spline's equations take them on, round by round; each
    looks a sample further. Pauses end a spline.
    """
    taken = _about(starts, len(time_s))
    own_s, own = (time_s, values) if len(taken) == len(time_s) else (time_s[taken], values[taken])
    steps = np.diff(own_s)[:, np.newaxis]
    rates = np.diff(own, axis=0) / steps
    weight = steps[1:] / (steps[1:] + steps[:-1])
    rises = rates[1:] + weight * (rates[:-1] - rates[1:])
    joined = (np.diff(taken) == 1) & (steps[:, 0] <= longest_s)
    left, right = np.append(False, joined), np.append(joined, False)
    edges = np.flatnonzero(~(left & right))
    slopes = np.zeros(own.shape)
    slopes[1:-1] = rises
    ends = _end_slopes(slopes, rates, left, right, edges)
    slopes[edges] = ends
    rises *= 1.5
    weight *= 0.5
    for _ in range(_ROUNDS):
        slopes[1:-1] = rises - slopes[2:] * (0.5 - weight) - slopes[:-2] * weight
        slopes[edges] = ends
    place = starts if len(taken) == len(time_s) else np.searchsorted(taken, starts)
    return slopes[place], slopes[place + 1]


def _end_slopes(slopes: FloatArray, rates: FloatArray, left: BoolArray, right: BoolArray, edges: _Rows) -> FloatArray:
    """Return the slopes of samples that lack one beside them: of the parabola, the line, or none at all."""
    ends = np.zeros((len(edges), rates.shape[1]))
    for has, towards in ((left, -1), (right, 1)):
        those = has[edges]
        inner = edges[those] + towards
        line = rates[np.minimum(edges[those], inner)]
        is_longer = (left[inner] & right[inner])[:, np.newaxis]
        ends[those] = np.where(is_longer, 2.0 * line - slopes[inner], line)
    return ends


def _about(starts: _Rows, count: int) -> _Rows:
    """Return the samples, of so many, that the slopes about some intervals depend on."""
    if 2 * len(starts) > count:
        return np.arange(count)
    change = np.bincount(np.maximum(starts - AFTER, 0), minlength=count + 1)
    change -= np.bincount(np.minimum(starts + 2 + AFTER, count), minlength=count + 1)
    return np.flatnonzero(np.cumsum(change[:-1]) > 0)


def _are_predictable(places: Places, time_s: FloatArray, values: FloatArray, lost: _Rows) -> BoolArray:
    """Tell whether neighbours tell what was lost after some samples to within the noise, shape (lost, channels).

    Tried on the samples just before: each is told by the four about it that are as far away as those about the lost
    ones, and by its eight nearest. The second leaves the noise, however the motion is, and the first no more, where the
    motion is slow.
    """
    steps_s = time_s[lost + 1] - time_s[lost]
    apart = places.apart(steps_s)
    edges = np.flatnonzero(np.diff(time_s) > places.longest_s) + 1
    begins = np.append(0, edges)[np.searchsorted(edges, lost, side="right")]
    told = np.zeros((len(lost), values.shape[1]), dtype=bool)
    for few in np.unique(apart).tolist():
        own = np.flatnonzero(apart == few)
        for part in np.split(own, range(_AT_ONCE, len(own), _AT_ONCE)):
            far, most = max(2 * few, 4), _BEYOND * _LOOSER ** ((few > 1) + (places.finer > 1))
            rows = lost[part, np.newaxis] - far - np.arange(0, _LOOK, 2)
            tried = rows - far >= begins[part, np.newaxis]
            rows = np.where(tried, rows, lost[part, np.newaxis])
            count = np.count_nonzero(tried, axis=1)
            span_s = time_s[rows[:, 0]] - time_s[rows[np.arange(len(part)), np.maximum(count - 1, 0)]]
            enough = (
                (count >= _FEWEST) & (steps_s[part] <= _SECONDS) & (span_s <= _SPARSE * 2 * count * places.typical_s)
            )
            part, rows, tried = part[enough], rows[enough], tried[enough]
            rows = np.where(tried, rows, rows[:, :1])  # the first again, for what isn't there
            missed = _missed(time_s, values, rows, few * np.array([-2, -1, 1, 2]), tried)
            noise = _missed(time_s, values, rows, np.array([-4, -3, -2, -1, 1, 2, 3, 4]), tried)
            look = np.where(tried[..., np.newaxis], values[rows], np.nan)
            told[part] = missed <= np.maximum(most * noise, _SMALL * np.nanvar(look, axis=1))
    return told


def _missed(time_s: FloatArray, values: FloatArray, rows: _Rows, others: _Rows, tried: BoolArray) -> FloatArray:
    """Return by how much samples are missed by the polynomial through others, squared, at the mean of those tried.

    Divided by what it would be of white noise of unit variance; shape (rows, channels).
    """
    to_s = time_s[rows + others[:, np.newaxis, np.newaxis]] - time_s[rows]
    whole = np.prod(to_s, axis=0)
    errors, gain = values[rows], np.ones(rows.shape)
    for i, other in enumerate(others):
        below = to_s[i].copy()
        for j in range(len(others)):
            if j != i:
                below *= to_s[j] - to_s[i]
        weight = whole / below
        gain += weight**2
        errors -= weight[..., np.newaxis] * values[rows + other]
    squared = np.where(tried[..., np.newaxis], errors**2 / gain[..., np.newaxis], 0.0)
    total: FloatArray = squared.sum(axis=1) / np.count_nonzero(tried, axis=1)[:, np.newaxis]
    return total

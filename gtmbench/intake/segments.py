"""From channels with stamps of their own to records of one even clock, split at gaps, never bridged over one.

A step of a track that is longer than usual is a pause; one that only misses a sample or two isn't (`resampling`). While
another track lives on, the record goes on and the paused channels are missing; where all pause there is a gap, and the
record is split. A log begins when the last of its tracks does; one that ends, or is back after a gap, no more than
`SHORTEST_S` apart from the others cuts the record there.
Where a track comes slower than usual for long, nothing is missing: there is no record of that rate, as in a gap.
"""

from __future__ import annotations

import itertools
from bisect import bisect_left
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from gtmbench.errors import InputError
from gtmbench.intake.delta_angle import is_integrated, mean_rates
from gtmbench.intake.flight_log import Remark, Unread, remark
from gtmbench.intake.formats.limits import check_values
from gtmbench.intake.lattice import find_lattice
from gtmbench.intake.resampling import HALF, HOLE, PAUSE, oversampling, resampled
from gtmbench.intake.stamps import FAR_S
from gtmbench.intake.tracks import FEWEST, SHORTEST_S, Track, end_of, met, overlaps, union, without
from gtmbench.intake.unread import GapReasons, unread_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.clock import FloatArray, same_period
from gtmbench.values.pieces import beside, joined
from gtmbench.values.record import BoolArray, Record, Span

_RATE = 5  # steps before a long one or after it: where they are as long, it is another rate and no pause
_BESIDE = 30  # samples: what is further away doesn't move a spline


@dataclass(frozen=True, kw_only=True, eq=False)
class _Parts:
    """A track between its pauses; of an even clock, times are that clock's."""

    track: Track
    parts: tuple[Track, ...]
    even_s: float | None
    jitter_s: float
    limit_s: float  # a step that is longer is a pause
    slow: list[Span]  # where it comes slower than usual

    @cached_property
    def spans(self) -> list[Span]:
        """Where it lives: a span a part."""
        return [(float(part.time_s[0]), float(part.time_s[-1])) for part in self.parts]

    @property
    def period_s(self) -> float:
        return self.track.period_s if self.even_s is None else self.even_s

    @property
    def patience_s(self) -> float:
        """How much later than others it may begin or end without being missed."""
        return max(SHORTEST_S, self.limit_s)

    def is_integrated(self, attitude: _Parts | None) -> bool:
        """Tell whether these are gyros that are integrated over an attitude's intervals."""
        return attitude is not None and set(self.track.channels) <= set(GYROS)

    def within(self, span: Span) -> list[Span]:
        """Return where it lives in a span."""
        return overlaps(self.spans, span)

    def absences(self, spans: Sequence[Span]) -> list[Span]:
        """Return where it doesn't, though it had begun."""
        starts_s, ends_s = zip(*self.spans, strict=True)
        pauses = list(zip(ends_s, (*starts_s[1:], np.inf), strict=True))
        return [part for span in spans for part in overlaps(pauses, span) if part[1] - part[0] > self.limit_s]

    def laid(
        self, span: Span, first_s: float, period_s: float, count: int, *, filtered: bool
    ) -> tuple[FloatArray, BoolArray]:
        """Return the values on another clock, made of the samples in a span, and where a sample is there."""
        used = self.around(*span)
        return resampled(used.time_s, used.values, first_s, period_s, count, filtered=filtered, typical_s=self.period_s)

    def around(self, start_s: float, end_s: float) -> Track:
        """Return the samples from start to end and some beside them, none of them beyond a pause."""
        around = list(self.parts[met(self.spans, (start_s, end_s))])
        if not around:
            return self.track.part(0, 0)
        first = int(np.searchsorted(around[0].time_s, start_s))
        last = int(np.searchsorted(around[-1].time_s, end_s))
        around[-1] = around[-1].part(0, last + _BESIDE)
        around[0] = around[0].part(max(first - _BESIDE, 0), len(around[0].time_s))
        return replace(
            self.track,
            time_s=joined([part.time_s for part in around], np.float64),
            values=joined([part.values for part in around], np.float64),
        )

    def first_from(self, start_s: float, period_s: float) -> float:
        """Return the time of the first sample from a time on; of one that would be there, while it pauses."""
        part = self.parts[min(bisect_left(self.spans, start_s, key=end_of), len(self.parts) - 1)]
        if part.time_s[0] <= start_s <= part.time_s[-1]:
            return float(part.time_s[np.searchsorted(part.time_s, start_s)])
        beside_s = float(part.time_s[0] if part.time_s[0] > start_s else part.time_s[-1])
        return beside_s + float(np.ceil((start_s - beside_s) / period_s - 1e-6)) * period_s


@dataclass(kw_only=True, eq=False)
class Cut:
    """What became of the tracks; gyros are integrated `by_attitude`, where that is given, over its intervals."""

    records: list[Record]
    remarks: list[Remark]
    method: list[str]
    filtered: bool
    periods_s: dict[str, float]  # of the samples, by channel
    by_attitude: _Parts | None = None
    short: list[Span] = field(default_factory=list)  # what was too short to become a record
    unread: tuple[Unread, ...] = ()

    @property
    def margin(self) -> int:
        """How many samples go at either end of a segment."""
        return HALF if self.filtered else 0 if self.by_attitude is None else 1


def cut(tracks: Sequence[Track], *, breaks_s: Sequence[float], rate_hz: float | None) -> Cut:
    """Return the records between gaps; where some channels pause and others don't, those are missing."""
    for track in tracks:
        _check_long(track)
    slowest = max(tracks, key=lambda track: (track.slowness_s, -track.logged_s))
    rough_s = slowest.period_s if rate_hz is None else 1.0 / rate_hz
    attitude = _attitude_for_gyros(tracks, rough_s)
    if attitude is not None:
        tracks = [apart for track in tracks for apart in track.split(GYROS)]
    laid = {id(track): _between_pauses(track, rough_s, breaks_s) for track in tracks}
    reference, all_parts = laid[id(slowest)], list(laid.values())
    period_s = _common_period(reference, rate_hz)
    by = None if attitude is None else laid[id(attitude)]
    filtered = any(oversampling(parts.period_s, period_s) > 1 for parts in all_parts if not parts.is_integrated(by))
    periods_s = {channel: parts.period_s for parts in all_parts for channel in parts.track.channels}
    made = Cut(records=[], remarks=[], method=[], filtered=filtered, periods_s=periods_s, by_attitude=by)
    made.method += [_described(parts) for parts in all_parts] + _method(all_parts, period_s, made)
    if rate_hz is None and (filtered or by is not None):
        made.method.append(
            f"that is the rate of {slowest.label}: name the channels that are needed, or a rate, for more"
        )
    spans = _between_gaps(all_parts, breaks_s, PAUSE * rough_s)
    made.method += _latecomers(all_parts, spans)
    made.remarks += [remark for parts in all_parts for remark in _remarks(parts, spans, breaks_s)]
    for span in spans:
        _add_record(made, all_parts, span, reference, period_s)
    if not made.records:
        names = "; ".join(track.label for track in tracks)
        raise InputError(
            f"no stretch of {SHORTEST_S:g} s and {FEWEST} samples at {1 / period_s:.4g} Hz that begins with all of "
            f"them and has no gap: {names}; leave out a channel, or give a lower rate"
        )
    made.unread = unread_of(
        GapReasons(
            tracks=[parts.track for parts in all_parts],
            spans=[parts.spans for parts in all_parts],
            slow=[parts.slow for parts in all_parts],
            read=[(record.start_s, record.end_s) for record in made.records],
            short=made.short,
            breaks_s=breaks_s,
            period_s=period_s,
            join_s=PAUSE * rough_s,
        )
    )
    return made


def _attitude_for_gyros(tracks: Sequence[Track], period_s: float) -> Track | None:
    """Return the attitude over whose intervals the gyros are integrated, None where they aren't."""
    attitude = next((track for track in tracks if {*ATTITUDE} <= {*track.channels}), None)
    gyros_s = [track.period_s for track in tracks if {*GYROS} & {*track.channels}]
    if attitude is None or not is_integrated(gyros_s, attitude.period_s, period_s):
        return None
    return attitude


def _check_long(track: Track) -> None:
    if len(track.time_s) < FEWEST:
        raise InputError(f"{track.label}: {len(track.time_s)} samples; give at least {FEWEST}")


def _between_pauses(track: Track, common_s: float, breaks_s: Sequence[float]) -> _Parts:
    limit_s = PAUSE * max(track.period_s, common_s)
    steps = np.diff(track.time_s)
    apart, slow = steps > limit_s, np.flatnonzero(_slow(steps, limit_s))
    del steps
    for place in _places(track, breaks_s):
        apart[place] = True
    bounds = [0, *(np.flatnonzero(apart) + 1).tolist(), len(track.time_s)]
    parts = [track.part(first, last) for first, last in itertools.pairwise(bounds)]
    lattice = find_lattice([part.time_s for part in parts])
    if lattice is not None:
        parts = [replace(part, time_s=time_s) for part, time_s in zip(parts, lattice.times, strict=True)]
    return _Parts(
        track=track,
        parts=tuple(parts),
        even_s=None if lattice is None else lattice.period_s,
        jitter_s=0.0 if lattice is None else lattice.jitter_s,
        limit_s=limit_s,
        slow=union([(float(track.time_s[place]), float(track.time_s[place + 1])) for place in slow]),
    )


def _places(track: Track, breaks_s: Sequence[float]) -> list[int]:
    """Return the steps over which its clock was set."""
    places = [int(np.searchsorted(track.time_s, break_s)) - 1 for break_s in breaks_s]
    return [place for place in places if 0 <= place < len(track.time_s) - 1]


def _slow(steps: FloatArray, limit_s: float) -> BoolArray:
    """Tell which long steps are no pauses: those before or after them are as long."""
    long = steps > limit_s
    if np.count_nonzero(long) <= _RATE // 2 or len(steps) < _RATE:
        return np.zeros(len(steps), dtype=bool)
    usual = np.median(np.lib.stride_tricks.sliding_window_view(steps, _RATE), axis=1)
    beside = np.zeros(len(steps))
    beside[_RATE:] = usual[: len(steps) - _RATE]
    beside[:-_RATE] = np.maximum(beside[:-_RATE], usual[1:])
    slow: BoolArray = long & (steps <= PAUSE * beside)
    return slow


def _between_gaps(all_parts: Sequence[_Parts], breaks_s: Sequence[float], join_s: float) -> list[Span]:
    """Return where any track lives, from where all have begun; where its clock was set, a log begins anew."""
    spans = []
    slow = union([span for parts in all_parts for span in parts.slow])
    for start_s, end_s in itertools.pairwise([-np.inf, *breaks_s, np.inf]):
        own = [parts.within((start_s, end_s)) for parts in all_parts]
        if not all(own):
            continue
        begin_s = max(living[0][0] for living in own)
        alive = without(union([span for living in own for span in living], join_s), slow)
        spans += [_trimmed(all_parts, span) for span in overlaps(alive, (begin_s, end_s))]
    return spans


def _trimmed(all_parts: Sequence[_Parts], span: Span) -> Span:
    """Return a span from where tracks that come a moment later are there, to where the first ends a moment earlier."""
    start_s, end_s = span
    living = [(parts.within(span), parts.patience_s) for parts in all_parts]
    firsts = [own[0][0] for own, patience_s in living if own and own[0][0] - start_s <= patience_s]
    lasts = [own[-1][1] for own, patience_s in living if own and end_s - own[-1][1] <= patience_s]
    return max(firsts, default=start_s), min(lasts, default=end_s)


def _remarks(parts: _Parts, spans: Sequence[Span], breaks_s: Sequence[float]) -> list[Remark]:
    """Return remarks on where a track is missing while others live on, and on its other pauses: they are gaps."""
    track = parts.track
    often = f"one sample every {track.period_s:.4g} s else"
    told = dict.fromkeys(parts.absences(spans))
    remarks = [
        remark("missing", *absence, f"nothing for {_length(absence)} while others live on; {often}", channel)
        for absence in told
        for channel in track.channels
    ]
    for (_, start_s), (end_s, _) in itertools.pairwise(parts.spans):
        was_set = bisect_left(breaks_s, start_s) < bisect_left(breaks_s, end_s)
        if not was_set and (start_s, end_s) not in told:
            is_far = end_s - start_s > FAR_S
            kind, what = ("clock jump", "the clock jumps on by") if is_far else ("gap", "nothing for")
            text = f"{track.label}: {what} {_length((start_s, end_s))}; {often}"
            remarks.append(remark(kind, start_s, end_s, text))
    return remarks


def _length(span: Span) -> str:
    return f"{span[1] - span[0]:.4g} s"


def _common_period(reference: _Parts, rate_hz: float | None) -> float:
    own_s = reference.even_s
    if rate_hz is not None:
        return own_s if own_s is not None and same_period(own_s, 1.0 / rate_hz) else 1.0 / rate_hz
    return own_s if own_s is not None else 1.0 / float(f"{1.0 / reference.period_s:.3g}")


def _latecomers(parts: Sequence[_Parts], spans: Sequence[Span]) -> list[str]:
    """Return who begins last, where that costs the others more than a moment."""
    last = max(parts, key=lambda track: track.spans[0][0])
    begin_s = last.spans[0][0]
    if not spans or begin_s - min(track.spans[0][0] for track in parts) <= SHORTEST_S:
        return []
    return [f"all are there from {begin_s:.6g} s on, when {last.track.label} begins"]


def _add_record(made: Cut, parts: Sequence[_Parts], span: Span, reference: _Parts, period_s: float) -> None:
    start_s, end_s = span
    first_s = reference.first_from(start_s, period_s) if same_period(reference.period_s, period_s) else start_s
    first_s += made.margin * period_s
    count = int(np.floor((end_s - first_s) / period_s + 1e-6)) + 1 - made.margin
    check_values(max(count, 0) * sum(len(part.track.channels) for part in parts), "the record")
    if count < FEWEST or count * period_s < SHORTEST_S:
        made.short.append((start_s, max(start_s, end_s)))
        text = f"{max(end_s - start_s, 0.0):.4g} s between gaps: too short to be used, dropped"
        made.remarks.append(remark("short", start_s, end_s, text))
        return
    values, there = zip(*(_laid(made, part, span, first_s, period_s, count) for part in parts), strict=True)
    record = Record(
        beside(values),
        channels=[channel for part in parts for channel in part.track.channels],
        sample_period_s=period_s,
        start_s=first_s,
        there=beside(there),
    )
    made.records.append(record)


def _laid(
    made: Cut, parts: _Parts, span: Span, first_s: float, period_s: float, count: int
) -> tuple[FloatArray, BoolArray]:
    """Return the values on a record's clock, and where a sample is there; angles as they are, beside their gyros."""
    by = made.by_attitude
    if by is None or not parts.is_integrated(by):
        filtered = made.filtered and parts is not by
        return parts.laid(span, first_s, period_s, count, filtered=filtered)
    gyros, attitude = parts.around(*span), by.around(*span)
    check_values(count * len(gyros.channels), "integrating the gyros")
    return mean_rates(gyros.time_s, gyros.values, attitude.time_s, first_s, period_s, count)


def laid_beside(track: Track, record: Record, *, breaks_s: Sequence[float], filtered: bool) -> FloatArray:
    """Return a track's values on a record's clock, shape (samples, channels), NaN where there are none."""
    _check_long(track)
    period_s = record.sample_period_s
    parts = _between_pauses(track, period_s, breaks_s)
    filtered = filtered or oversampling(parts.period_s, period_s) > 1
    margin_s = HALF * period_s if filtered else 0.0
    span = record.start_s - margin_s, record.end_s + margin_s
    return parts.laid(span, record.start_s, period_s, len(record), filtered=filtered)[0]


def _described(parts: _Parts) -> str:
    track, steps = parts.track, np.diff(parts.track.time_s)
    lost = np.count_nonzero((steps > HOLE * parts.period_s) & (steps <= parts.limit_s))
    told = (
        f"; {lost} times a sample or two are lost: laid where those beside tell them within the noise" if lost else ""
    )
    if parts.even_s is None:
        low, high = np.quantile(steps, [0.05, 0.95])
        apart = f"{low:.4g} to {high:.4g} s apart, {track.period_s:.4g} s at the median"
        return f"{track.label}: uneven stamps, {apart}{told}"
    said = f", stamps within {parts.jitter_s:.2g} s of an even clock: taken as even" if parts.jitter_s else ""
    return f"{track.label}: {1 / parts.even_s:.6g} Hz{said}{told}"


def _method(parts: Sequence[_Parts], period_s: float, made: Cut) -> list[str]:
    rate = f"{1 / period_s:.6g} Hz"
    slower = [part for part in parts if part.period_s > 1.05 * period_s]
    lines = [f"{part.track.label}: interpolated from {1 / part.period_s:.4g} Hz, no more is in it" for part in slower]
    if made.by_attitude is not None:
        gyros = ", ".join(
            name for part in parts if part.is_integrated(made.by_attitude) for name in part.track.channels
        )
        lines.append(
            f"{gyros}: integrated over the attitude's intervals, means over {2 * period_s:.4g} s at {rate}, as its "
            "derivatives are; the attitude stands as it is"
        )
    if made.filtered:
        lines.append(
            f"resampled at {rate}: cubics between stamps, then one low-pass for every "
            f"{'channel' if made.by_attitude is None else 'other channel'} (flat up to "
            f"{0.3 / period_s:.4g} Hz, 1e-4 of what lies above {0.5 / period_s:.4g} Hz is left); "
            f"{HALF} samples go at either end of a segment"
        )
    elif len(parts) > 1 or slower or parts[0].even_s is None:
        lines.append(f"one record at {rate}: samples on its clock as they are, others by cubics between them")
    return lines

"""From channels with stamps of their own to records of one even clock, split at gaps, never bridged over one."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.clock import FloatArray, same_period
from gtmbench.errors import InputError
from gtmbench.intake.flight_log import Remark, remark
from gtmbench.intake.formats.limits import check_values
from gtmbench.intake.lattice import find_lattice
from gtmbench.intake.resampling import HALF, oversampling, resampled
from gtmbench.intake.stamps import FAR_S
from gtmbench.record import Record, Span

_GAP = 2.5  # periods: a step that is longer is a gap; one sample that is left out stands as missing
SHORTEST_S, FEWEST = 2.0, 20  # of a segment
_BESIDE = 30  # samples: what is further away doesn't move a spline


@dataclass(frozen=True, kw_only=True, eq=False)
class Track:
    """Channels that share their stamps.

    Attributes
    ----------
    channels : tuple of str
    time_s : FloatArray
        Increasing, shape (samples,).
    values : FloatArray
        Shape (samples, channels).
    """

    channels: tuple[str, ...]
    time_s: FloatArray
    values: FloatArray

    @property
    def period_s(self) -> float:
        """The median step."""
        return float(np.median(np.diff(self.time_s)))

    @property
    def label(self) -> str:
        """Its channels, as a message names them."""
        more = f" and {len(self.channels) - 4} more" if len(self.channels) > 4 else ""
        return ", ".join(self.channels[:4]) + more

    def part(self, first: int, last: int) -> Track:
        """Return the samples from first to before last."""
        return replace(self, time_s=self.time_s[first:last], values=self.values[first:last])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Parts:
    """A track between its gaps; of an even clock, times are that clock's."""

    track: Track
    parts: tuple[Track, ...]
    even_s: float | None
    jitter_s: float

    @property
    def spans(self) -> list[Span]:
        return [(float(part.time_s[0]), float(part.time_s[-1])) for part in self.parts]

    @property
    def period_s(self) -> float:
        return self.track.period_s if self.even_s is None else self.even_s

    def around(self, start_s: float, end_s: float) -> Track:
        """Return the samples from start to end and some beside them, none of them beyond a gap."""
        part = next(part for part in self.parts if part.time_s[0] <= start_s and part.time_s[-1] >= end_s)
        first, last = np.searchsorted(part.time_s, [start_s, end_s])
        return part.part(max(int(first) - _BESIDE, 0), int(last) + _BESIDE)

    def first_from(self, start_s: float) -> float:
        """Return the time of the first sample from a time on."""
        return next(float(part.time_s[part.time_s >= start_s][0]) for part in self.parts if part.time_s[-1] >= start_s)


@dataclass(kw_only=True, eq=False)
class Cut:
    """What became of the tracks."""

    records: list[Record]
    remarks: list[Remark]
    method: list[str]


def cut(tracks: Sequence[Track], *, breaks_s: Sequence[float], rate_hz: float | None) -> Cut:
    """Return the records between gaps.

    Raises
    ------
    InputError
        Where no stretch is long enough.
    """
    for track in tracks:
        if len(track.time_s) < FEWEST:
            raise InputError(f"{track.label}: {len(track.time_s)} samples; give at least {FEWEST}")
    made = Cut(records=[], remarks=[], method=[])
    slowest = max(tracks, key=lambda track: track.period_s)
    rough_s = slowest.period_s if rate_hz is None else 1.0 / rate_hz
    laid = {id(track): _between_gaps(track, rough_s, breaks_s, made.remarks) for track in tracks}
    reference, all_parts = laid[id(slowest)], list(laid.values())
    period_s = _common_period(reference, rate_hz)
    filtered = any(oversampling(parts.period_s, period_s) > 1 for parts in all_parts)
    made.method += [_described(parts) for parts in all_parts] + _method(all_parts, period_s, filtered=filtered)
    if rate_hz is None and filtered:
        made.method.append(
            f"that is the rate of {slowest.label}: name the channels that are needed, or a rate, for more"
        )
    common = _common([parts.spans for parts in all_parts])
    made.method += _latecomers(all_parts, common)
    for span in common:
        _add_record(made, all_parts, span, reference, period_s, filtered=filtered)
    if not made.records:
        names = "; ".join(track.label for track in tracks)
        raise InputError(
            f"no stretch of {SHORTEST_S:g} s and {FEWEST} samples at {1 / period_s:.4g} Hz in which all are there "
            f"without a gap: {names}; leave out a channel, or give a lower rate"
        )
    return made


def _between_gaps(track: Track, common_s: float, breaks_s: Sequence[float], remarks: list[Remark]) -> _Parts:
    parts = _parts(track, _GAP * max(track.period_s, common_s), breaks_s, remarks)
    lattice = find_lattice([part.time_s for part in parts])
    if lattice is None:
        return _Parts(track=track, parts=tuple(parts), even_s=None, jitter_s=0.0)
    evened = [replace(part, time_s=time_s) for part, time_s in zip(parts, lattice.times, strict=True)]
    return _Parts(track=track, parts=tuple(evened), even_s=lattice.period_s, jitter_s=lattice.jitter_s)


def _parts(track: Track, limit_s: float, breaks_s: Sequence[float], remarks: list[Remark]) -> list[Track]:
    """Return what lies between gaps, and note the gaps."""
    steps = np.diff(track.time_s)
    broken = np.zeros(len(steps), dtype=bool)
    for break_s in breaks_s:
        place = int(np.searchsorted(track.time_s, break_s)) - 1
        broken[place : place + 1] |= 0 <= place < len(steps)
    gaps = np.flatnonzero((steps > limit_s) & ~broken)
    for gap in gaps:
        start_s, end_s = float(track.time_s[gap]), float(track.time_s[gap + 1])
        kind, what = ("clock jump", "the clock jumps on by") if end_s - start_s > FAR_S else ("gap", "nothing for")
        text = f"{track.label}: {what} {end_s - start_s:.4g} s; one sample every {track.period_s:.4g} s else"
        remarks.append(remark(kind, start_s, end_s, text))
    cuts = np.flatnonzero((steps > limit_s) | broken) + 1
    bounds = [0, *cuts.tolist(), len(track.time_s)]
    return [track.part(first, last) for first, last in itertools.pairwise(bounds)]


def _common_period(reference: _Parts, rate_hz: float | None) -> float:
    own_s = reference.even_s
    if rate_hz is not None:
        return own_s if own_s is not None and same_period(own_s, 1.0 / rate_hz) else 1.0 / rate_hz
    return own_s if own_s is not None else 1.0 / float(f"{1.0 / reference.period_s:.3g}")


def _common(spans: Sequence[Sequence[Span]]) -> list[Span]:
    """Return where all have a span."""
    common = list(spans[0])
    for others in spans[1:]:
        both = []
        place = 0
        for start_s, end_s in common:
            while place < len(others) and others[place][1] < start_s:
                place += 1
            for other in others[place:]:
                if other[0] > end_s:
                    break
                both.append((max(start_s, other[0]), min(end_s, other[1])))
        common = both
    return common


def _latecomers(parts: Sequence[_Parts], common: Sequence[Span]) -> list[str]:
    """Return who begins last and who ends first, where that costs the others more than a moment."""
    if not common:
        return []
    first, last = max(parts, key=lambda track: track.spans[0][0]), min(parts, key=lambda track: track.spans[-1][1])
    lines = []
    if first.spans[0][0] - min(track.spans[0][0] for track in parts) > SHORTEST_S:
        lines.append(f"all are there from {first.spans[0][0]:.6g} s on, when {first.track.label} begins")
    if max(track.spans[-1][1] for track in parts) - last.spans[-1][1] > SHORTEST_S:
        lines.append(f"all are there up to {last.spans[-1][1]:.6g} s, when {last.track.label} ends")
    return lines


def _add_record(
    made: Cut, parts: Sequence[_Parts], span: Span, reference: _Parts, period_s: float, *, filtered: bool
) -> None:
    start_s, end_s = span
    first_s = reference.first_from(start_s) if same_period(reference.period_s, period_s) else start_s
    margin = HALF if filtered else 0
    first_s += margin * period_s
    count = int(np.floor((end_s - first_s) / period_s + 1e-6)) + 1 - margin
    check_values(max(count, 0) * sum(len(part.track.channels) for part in parts), "the record")
    if count < FEWEST or count * period_s < SHORTEST_S:
        text = f"{max(end_s - start_s, 0.0):.4g} s between gaps: too short to be used, dropped"
        made.remarks.append(remark("short", start_s, end_s, text))
        return
    used = [part.around(start_s, end_s) for part in parts]
    values = [resampled(part.time_s, part.values, first_s, period_s, count, filtered=filtered) for part in used]
    channels = [channel for part in used for channel in part.channels]
    made.records.append(Record(np.hstack(values), channels=channels, sample_period_s=period_s, start_s=first_s))


def _described(parts: _Parts) -> str:
    track = parts.track
    if parts.even_s is None:
        low, high = np.quantile(np.diff(track.time_s), [0.05, 0.95])
        return f"{track.label}: uneven stamps, {low:.4g} to {high:.4g} s apart, {track.period_s:.4g} s at the median"
    said = f", stamps within {parts.jitter_s:.2g} s of an even clock: taken as even" if parts.jitter_s else ""
    return f"{track.label}: {1 / parts.even_s:.6g} Hz{said}"


def _method(parts: Sequence[_Parts], period_s: float, *, filtered: bool) -> list[str]:
    rate = f"{1 / period_s:.6g} Hz"
    slower = [part for part in parts if part.period_s > 1.05 * period_s]
    lines = [f"{part.track.label}: interpolated from {1 / part.period_s:.4g} Hz, no more is in it" for part in slower]
    if filtered:
        lines.append(
            f"resampled at {rate}: cubic splines between stamps, then one low-pass for every channel (flat up to "
            f"{0.3 / period_s:.4g} Hz, 1e-4 of what lies above {0.5 / period_s:.4g} Hz is left); "
            f"{HALF} samples go at either end of a segment"
        )
    elif len(parts) > 1 or slower or parts[0].even_s is None:
        lines.append(f"one record at {rate}: samples that stand on its clock as they are, others by cubic splines")
    return lines

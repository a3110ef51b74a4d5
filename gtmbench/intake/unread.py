"""Which spans of a log are in no segment, and why: together with the segments they cover it without a hole."""

from __future__ import annotations

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain, pairwise

import numpy as np

from gtmbench.intake.flight_log import Unread
from gtmbench.intake.stamps import FAR_S
from gtmbench.intake.tracks import Track, holds, overlaps, union, without
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.record import Span

_SENSORS = {"gyros": GYROS, "attitude": ATTITUDE, "accelerometers": ACCELEROMETERS}
_MARGIN = "margin of the resampling"


@dataclass(frozen=True, kw_only=True, eq=False)
class GapReasons:
    """All that says why a moment isn't in a segment."""

    tracks: Sequence[Track]
    spans: Sequence[list[Span]]  # of each track where it is there, between its pauses, in time
    slow: Sequence[list[Span]]  # of each track where its samples come slower than usual, in time
    read: list[Span]  # the segments, from their first sample to their last
    short: list[Span]  # what was too short to become one
    breaks_s: Sequence[float]  # where the log's clock was set back
    period_s: float  # of the segments
    join_s: float  # no gap is shorter

    @cached_property
    def alive(self) -> list[Span]:
        """Where any track is there."""
        return union(list(chain(*self.spans)), self.join_s)

    @cached_property
    def stretches(self) -> list[list[list[Span]]]:
        """Where each track is there, between settings of the log's clock; a step that is no pause counts."""
        between = pairwise([-np.inf, *self.breaks_s, np.inf])
        return [[union(overlaps(spans, span), self.join_s) for spans in self.spans] for span in between]

    @cached_property
    def gaps(self) -> list[Span]:
        """Where no track is there."""
        return without([(self.alive[0][0], self.alive[-1][1])], self.alive)

    def edges(self) -> list[float]:
        """Return the times at which a reason may begin or end."""
        spans = [*self.alive, *self.short, *chain(*self.slow)]
        ends = [(own[0][0], own[-1][1]) for living in self.stretches for own in living if own]
        return sorted({edge for span in (*spans, *ends) for edge in span} | {*self.breaks_s})

    def reason(self, at_s: float) -> str:
        """Return why a moment is in no segment."""
        slow = {i: spans[place] for i, spans in enumerate(self.slow) if (place := holds(spans, at_s)) is not None}
        if slow:
            first, span = next(iter(slow.items()))
            rates = _rates(self.tracks[first], span)
            return rates if len(slow) == len(self.tracks) else f"{self._names([first])}: {rates}"
        gap = holds(self.gaps, at_s)
        if gap is not None:
            return self._gap(self.gaps[gap])
        own = self.stretches[bisect_right(self.breaks_s, at_s)]
        late = [i for i, spans in enumerate(own) if not spans or at_s < spans[0][0]]
        if late:
            return f"{self._names(late)} not logged yet"
        if holds(self.short, at_s) is not None:
            return "too short between gaps"
        ended = [i for i, spans in enumerate(own) if at_s > spans[-1][1]]
        if ended:
            return f"{self._names(ended)} not logged any more"
        paused = [i for i, spans in enumerate(own) if holds(spans, at_s) is None]
        return f"{self._names(paused)} paused" if paused else _MARGIN

    def _gap(self, gap: Span) -> str:
        """Say which kind of a gap it is in which all pause."""
        start_s, end_s = gap
        if any(start_s <= break_s <= end_s for break_s in self.breaks_s):
            return "clock set back"
        return "clock jump" if end_s - start_s > FAR_S else "gap"

    def _names(self, which: Sequence[int]) -> str:
        return " and ".join(dict.fromkeys(_sensor(self.tracks[i]) for i in which))


def _sensor(track: Track) -> str:
    """Return the sensor whose channels a track holds, else the channels."""
    of = [sensor for sensor, channels in _SENSORS.items() if {*track.channels} <= {*channels}]
    return of[0] if of else track.label


def _rates(track: Track, slow: Span) -> str:
    """Say at which rate samples come in a slow span, and at which they usually do."""
    first, last = np.searchsorted(track.time_s, slow)
    hz = 1.0 / float(np.median(np.diff(track.time_s[first : last + 1])))
    return f"samples come at {hz:.3g} Hz instead of {1.0 / track.period_s:.3g}"


def unread_of(layout: GapReasons) -> tuple[Unread, ...]:
    """Return the spans of a log that are in no segment, in time, with a reason each."""
    first_s = min(spans[0][0] for spans in layout.spans)
    last_s = max(spans[-1][1] for spans in layout.spans)
    edges = np.array(layout.edges())
    found: list[Unread] = []
    for start_s, end_s in without([(first_s, last_s)], layout.read):
        inside = edges[np.searchsorted(edges, start_s, "right") : np.searchsorted(edges, end_s, "left")]
        pieces = list(pairwise([start_s, *inside.tolist(), end_s]))
        found += _joined([(*piece, layout.reason(0.5 * (piece[0] + piece[1]))) for piece in pieces], layout.period_s)
    return tuple(found)


def _joined(pieces: Sequence[tuple[float, float, str]], period_s: float) -> list[Unread]:
    """Return pieces in a row as spans: margins, and what is shorter than a sample, join their neighbours."""
    if pieces[-1][1] - pieces[0][0] <= period_s * (1.0 + 1e-6):
        return []
    long = [each for each in pieces if each[1] - each[0] > period_s and each[2] != _MARGIN]
    kept = long or [max(pieces, key=lambda each: each[1] - each[0])]
    found: list[Unread] = []
    for _, end_s, reason in kept:
        if found and found[-1].reason == reason:
            found[-1] = Unread(start_s=found[-1].start_s, end_s=end_s, reason=reason)
        else:
            start_s = found[-1].end_s if found else pieces[0][0]
            found.append(Unread(start_s=start_s, end_s=end_s, reason=reason))
    found[-1] = Unread(start_s=found[-1].start_s, end_s=pieces[-1][1], reason=found[-1].reason)
    return found

"""A timeline for every sensor of a log: clear, failed, suspected or not judged, from its first sample to its last.

A timeline is laid out once, of claims: spans in which some evidence says something of a sensor. Where claims meet, a
failure stands over a suspicion, a suspicion over a reason not to judge, and that over an all-clear. What no claim
covers isn't judged. Nothing writes to a timeline afterwards.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from heapq import heappop, heappush
from itertools import pairwise
from types import MappingProxyType

from gtmbench.detectors.alarm import Judgement
from gtmbench.values.record import Span

NOTHING_PREDICTS = "nothing predicts it here"


class State(StrEnum):
    """What is known of a sensor over a span.

    >>> [state.value for state in State]  # the weightier first
    ['failed', 'suspected', 'not judged', 'clear']
    """

    FAILED = "failed"
    SUSPECTED = "suspected"
    NOT_JUDGED = "not judged"
    CLEAR = "clear"


@dataclass(frozen=True, kw_only=True)
class Sizes:
    """The smallest faults that would have been found, had they begun in a span and stayed.

    Attributes
    ----------
    error : float
        An error that stays, in the sensor's unit, found from 95 % of the onsets in the span.
    within_s : float
        How long after its onset.
    factors : (float, float) or None
        A factor at or below the first, or at or above the second; None where a wrong factor would not show.
    noise : float or None
        The standard deviation of noise that is added, in the sensor's unit; None where it would not show.

    Examples
    --------
    >>> Sizes(error=0.5, within_s=60.0, factors=(0.7, 1.4)).factors
    (0.7, 1.4)
    """

    error: float
    within_s: float
    factors: tuple[float, float] | None = None
    noise: float | None = None


@dataclass(frozen=True, kw_only=True)
class SensorSpan:
    """A span in which a sensor is in one state.

    Attributes
    ----------
    start_s, end_s : float
        On the log's clock.
    state : State
    reason : str
        Why it isn't judged, or what is suspected; of one that is clear, why no smaller error would show, if that has a
        reason.
    suspects : tuple of str
        Of a suspicion: the sensors of which one failed, itself among them.
    judgement : Judgement or None
        Of a failure or a suspicion: kind, size and who else was thought of.
    sizes : Sizes or None
        Of a span that is clear, and of one that isn't judged for its size alone.
    """

    start_s: float
    end_s: float
    state: State
    reason: str = ""
    suspects: tuple[str, ...] = ()
    judgement: Judgement | None = field(default=None, repr=False)
    sizes: Sizes | None = None

    @property
    def duration_s(self) -> float:
        """How long it lasts."""
        return self.end_s - self.start_s

    def meets(self, start_s: float, end_s: float) -> bool:
        """Tell whether it shares time with a span."""
        return self.start_s < end_s and start_s < self.end_s

    def covers(self, time_s: float) -> bool:
        """Tell whether a time lies in it; its end belongs to the next."""
        return self.start_s <= time_s < self.end_s


def unjudged(span_s: Span, reason: str) -> SensorSpan:
    """Return a span in which a sensor isn't judged, and why."""
    return SensorSpan(start_s=span_s[0], end_s=span_s[1], state=State.NOT_JUDGED, reason=reason)


Claim = tuple[str, SensorSpan]  # a sensor, and a span of it


@dataclass(frozen=True, kw_only=True, eq=False)
class Timeline:
    """The timeline of a log.

    Attributes
    ----------
    span_s : (start, end)
        Of the log, from its first sample to its last, whether they were read or not.
    sensors : mapping of sensor to tuple of SensorSpan
        In time, without a hole.
    motion_s : tuple of (start, end)
        Where the aircraft moves, and gaps with motion on both sides.
    told : tuple of str
        What holds for the whole log and counts in no span, such as which sensors nothing judges.

    Examples
    --------
    >>> shown = Sizes(error=0.5, within_s=60.0)
    >>> clear = SensorSpan(start_s=0.0, end_s=40.0, state=State.CLEAR, sizes=shown)
    >>> failed = SensorSpan(start_s=30.0, end_s=50.0, state=State.FAILED)
    >>> timeline = laid_out((0.0, 60.0), {"q": [clear, failed]}, motion_s=[(10.0, 60.0)])
    >>> [(each.start_s, each.end_s, each.state.value) for each in timeline.sensors["q"]]
    [(0.0, 30.0, 'clear'), (30.0, 50.0, 'failed'), (50.0, 60.0, 'not judged')]
    >>> timeline.at("q", 55.0).reason, timeline.motion_in("q", State.CLEAR)
    ('nothing predicts it here', 20.0)
    """

    span_s: Span
    sensors: Mapping[str, tuple[SensorSpan, ...]] = field(repr=False)
    motion_s: tuple[Span, ...] = field(default=(), repr=False)
    told: tuple[str, ...] = ()

    def at(self, sensor: str, time_s: float) -> SensorSpan:
        """Return the span of a sensor that a time lies in; the last one at the log's end.

        Raises
        ------
        KeyError
            Where the log has no such sensor.
        ValueError
            Where the time lies outside of the log.
        """
        if not self.span_s[0] <= time_s <= self.span_s[1]:
            raise ValueError(f"{time_s:g} s lies outside of the log, {self.span_s[0]:g} to {self.span_s[1]:g} s")
        spans = self.sensors[sensor]
        return next((span for span in spans if span.covers(time_s)), spans[-1])

    def of(self, sensor: str, *states: State) -> tuple[SensorSpan, ...]:
        """Return the spans of a sensor in some states; none of a sensor that the log hasn't."""
        return tuple(span for span in self.sensors.get(sensor, ()) if span.state in states)

    @cached_property
    def motion_total_s(self) -> float:
        """How long the aircraft moves."""
        return sum(end_s - start_s for start_s, end_s in self.motion_s)

    def motion_in(self, sensor: str, *states: State) -> float:
        """Return for how long of its motion a sensor is in some states."""
        return sum(map(self.moving_s, self.of(sensor, *states)))

    def moving_s(self, span: SensorSpan) -> float:
        """Return for how long the aircraft moves in a span."""
        return sum(overlap_s(span, motion) for motion in self.motion_s)

    def judged_share(self, sensor: str) -> float:
        """Return in which share of the time in motion a sensor is judged; 0 where nothing moves."""
        if self.motion_total_s <= 0.0 or sensor not in self.sensors:
            return 0.0
        return 1.0 - self.motion_in(sensor, State.NOT_JUDGED) / self.motion_total_s


def overlap_s(span: SensorSpan, other: Span) -> float:
    """Return for how long a span and another one overlap."""
    return max(0.0, min(span.end_s, other[1]) - max(span.start_s, other[0]))


def laid_out(
    span_s: Span,
    claims: Mapping[str, Iterable[SensorSpan]],
    *,
    motion_s: Sequence[Span] = (),
    told: Sequence[str] = (),
    otherwise: str = NOTHING_PREDICTS,
) -> Timeline:
    """Return the timeline of a log, of what is claimed of each of its sensors.

    Parameters
    ----------
    span_s : (start, end)
        Of the log.
    claims : mapping of sensor to iterable of SensorSpan
        Every sensor of the log, those of which nothing is claimed among them. Of two claims of one state the first
        stands.
    motion_s : sequence of (start, end)
    told : sequence of str
    otherwise : str
        Why what no claim covers isn't judged.
    """
    sensors = {sensor: _merged(span_s, tuple(own), otherwise) for sensor, own in claims.items()}
    return Timeline(
        span_s=span_s, sensors=MappingProxyType(sensors), motion_s=tuple(motion_s), told=tuple(dict.fromkeys(told))
    )


_RANK = {state: rank for rank, state in enumerate(State)}


def _merged(span_s: Span, claims: Sequence[SensorSpan], otherwise: str) -> tuple[SensorSpan, ...]:
    """Return the weightiest claim of every instant, in time and without a hole."""
    start_s, end_s = span_s
    own = [each for each in claims if each.end_s > each.start_s]
    inside = {time_s for each in own for time_s in (each.start_s, each.end_s) if start_s < time_s < end_s}
    begun = sorted(range(len(own)), key=lambda place: own[place].start_s, reverse=True)  # the next one last
    there: list[tuple[int, int]] = []  # a heap of what has begun: by weight, then as it was claimed
    merged: list[SensorSpan] = []
    for first_s, last_s in pairwise([start_s, *sorted(inside), end_s]):
        middle_s = 0.5 * (first_s + last_s)
        while begun and own[begun[-1]].start_s <= middle_s:
            place = begun.pop()
            heappush(there, (_RANK[own[place].state], place))
        while there and own[there[0][1]].end_s < middle_s:
            heappop(there)
        nothing = SensorSpan(start_s=first_s, end_s=last_s, state=State.NOT_JUDGED, reason=otherwise)
        part = replace(own[there[0][1]] if there else nothing, start_s=first_s, end_s=last_s)
        if merged and _goes_on(merged[-1], part):
            merged[-1] = replace(merged[-1], end_s=last_s)
        else:
            merged.append(part)
    return tuple(merged)


def _goes_on(before: SensorSpan, part: SensorSpan) -> bool:
    return replace(before, start_s=part.start_s, end_s=part.end_s) == part

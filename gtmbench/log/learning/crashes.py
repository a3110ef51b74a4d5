"""A flight that ends in a crash teaches nothing from there on: what is learnt from ends before it, or begins behind it.

An autopilot tells of a failure. Accelerometers tell that the aircraft lies on its side or its back: the specific force
points elsewhere than in this log's flights, and keeps pointing there. So does an inverted pass; leaving it out of what
is learnt from costs nothing, for it is watched.

The ground pushes in a way that no monitor has learnt, so residuals rise, and say nothing of a sensor. Where the
aircraft didn't fly on after a hard contact, nothing behind it tells of a sensor.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import FAILURE, IMPACT, TOUCHDOWN
from gtmbench.detectors.protocol import Watch
from gtmbench.intake.events import Event, EventKind, of_kind
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.tracks import overlaps, union, without
from gtmbench.log.opening.records import LIVELY_DEG_S, flying_part, lively_seconds, turning_by_second, within
from gtmbench.log.opening.seconds import SECOND_S, of_seconds
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record, Span, runs

CONTACTS = (TOUCHDOWN, IMPACT)  # reasons
_FLIES_ON_S = 10  # seconds in which it turns, watched and without an alarm
_LIES_DEG, _LIES_S = 35.0, 5  # from where the specific force points in flight; for so many seconds
_BEFORE_S, _AFTER_S = 5.0, 2.5  # of a mishap: what led to it, and what it left
_LEAST_S, _FEWEST_LIVELY = 20.0, 10  # logged, and of these in motion: enough to learn from
_MARGIN_S = 2.0  # about what is broken: an onset is known no better
_FLOWN_S = 5  # of motion, before which no flight can have failed


@dataclass(frozen=True, kw_only=True)
class Mishap:
    """When a flight comes to grief, with some seconds about it, and what shows it."""

    span: Span
    text: str
    is_told: bool  # whether the autopilot tells of it: nobody may just have carried the aircraft


def mishaps(events: Sequence[Event], moving: Sequence[Record]) -> tuple[Mishap, ...]:
    """Return the mishaps of a log, in time; those that meet are one, told by the first.

    What an autopilot finds before it takes off, as an estimator that isn't ready, is none.

    `moving`: the log with gyros and attitude; without accelerometers nothing tells that it lies.

    >>> force = np.array([[0.0, 0.0, 1.0]] * 600 + [[0.0, -1.0, 0.0]] * 100)
    >>> record = Record(force, channels=["nx", "ny", "nz"], sample_period_s=0.1)
    >>> [(each.span, each.text) for each in mishaps([], [record])]
    [((55.0, 72.5), 'the aircraft lies on its side from 60.0 s on')]
    """
    told = [
        (event.time_s, event.time_s, f"the autopilot reports a failure at {event.time_s:.1f} s", True)
        for event in of_kind(events, EventKind.FAILURE)
        if _moves_before(event.time_s, moving)
    ]
    found: list[Mishap] = []
    for first_s, last_s, text, is_told in sorted([*told, *((*each, False) for each in _lying(moving))]):
        span = first_s - _BEFORE_S, last_s + _AFTER_S
        if found and span[0] <= found[-1].span[1]:
            before = found.pop()
            span, text = (before.span[0], max(before.span[1], span[1])), before.text
            is_told = is_told or before.is_told
        found.append(Mishap(span=span, text=text, is_told=is_told))
    return tuple(found)


def part_without_mishap(log: FlightLog, moving: Sequence[Record]) -> tuple[Span, str]:
    """Return the span that is taken as healthy where nobody says what is, and why silence then says nothing, or "".

    It is the log's `flying_part`. Where that holds a mishap, it is what comes before, or, where that is too little, the
    flying part of what comes after; then the flight that failed is not watched. That is so, too, where an autopilot
    tells of a failure before what is taken.
    """
    usual = part = flying_part(log, moving)
    lively_s, doubt, held = lively_seconds(moving), "", ""
    for mishap in mishaps(log.events, moving):
        start_s, end_s = mishap.span
        if start_s > part[1]:
            break
        before = part[0], min(part[1], start_s)
        if is_enough(log, lively_s, before):
            return before, doubt
        was_flown = np.count_nonzero(lively_s < start_s + _BEFORE_S) >= _FLOWN_S
        if was_flown and (mishap.is_told or end_s >= part[0]):
            doubt = doubt or f"{mishap.text}, and the flight until then is too short to learn from, so it is not judged"
        if end_s >= part[0]:
            held = held or mishap.text
            part = flying_part(log, moving, since_s=end_s)
            if part[0] < end_s:  # hardly any motion is left
                return usual, _want_text(held)
    return (usual, _want_text(held)) if held and not is_enough(log, lively_s, part) else (part, doubt)


def clear_parts(log: FlightLog, moving: Sequence[Record], part: Span, broken: Sequence[Span]) -> tuple[Span, ...]:
    """Return a part of a log without what is broken of it, and as much motion more behind it as it lost by that.

    `part`: what would be taken if nothing were broken. `broken`: where a sensor failed. It returns no spans where what
    is left is too little to learn from.
    """
    touching = [span for span in broken if span[0] < part[1] and span[1] > part[0]]
    if not touching:
        return (part,)
    crashes_s = [mishap.span[0] for mishap in mishaps(log.events, moving) if mishap.span[0] >= part[1]]
    lively_s, until_s = lively_seconds(moving), min(crashes_s, default=np.inf)
    wanted = np.count_nonzero((lively_s >= part[0]) & (lively_s <= part[1]))
    spans = left_of((part[0], np.inf), broken)
    clear = np.zeros(len(lively_s), dtype=bool)
    for start_s, end_s in spans:
        clear |= (lively_s >= start_s) & (lively_s + SECOND_S <= end_s)
    whole_s = lively_s[clear & (lively_s < until_s)][:wanted]
    if not len(whole_s):
        return ()
    end_s = min(max(part[1], float(whole_s[-1]) + SECOND_S), until_s)
    left = tuple(span for span in overlaps(spans, (part[0], end_s)) if span[0] < span[1])
    return left if any(is_enough(log, lively_s, span) for span in left) else ()


def left_of(part: Span, broken: Sequence[Span]) -> list[Span]:
    """Return what is left of a part outside of what is broken, and of a margin about that.

    >>> left_of((0.0, 60.0), [(20.0, 30.0), (90.0, 95.0)])
    [(0.0, 18.0), (32.0, 60.0)]
    """
    margins = union([(start_s - _MARGIN_S, end_s + _MARGIN_S) for start_s, end_s in broken])
    return [span for span in without([part], margins) if span[0] < span[1]]


def _want_text(mishap: str) -> str:
    return f"{mishap}, in what had to be learnt from for want of other flights"


def _moves_before(time_s: float, moving: Sequence[Record]) -> bool:
    """Tell whether the aircraft moves in the seconds before a time."""
    lively_s = lively_seconds(moving)
    return bool(np.any((lively_s >= time_s - _BEFORE_S) & (lively_s <= time_s)))


def is_enough(log: FlightLog, lively_s: FloatArray, span: Span) -> bool:
    """Tell whether a span holds enough to learn from."""
    logged_s = sum(len(record) * record.sample_period_s for record in within(log, [span]))
    return bool(
        logged_s >= _LEAST_S and np.count_nonzero((lively_s >= span[0]) & (lively_s <= span[1])) >= _FEWEST_LIVELY
    )


def _lying(moving: Sequence[Record]) -> list[tuple[float, float, str]]:
    """Return when the aircraft lies on its side or its back, and what to say of it."""
    told = [record for record in moving if {*ACCELEROMETERS} <= set(record.channels)]
    if not told:
        return []
    start_s = told[0].start_s
    force = np.full((int((told[-1].end_s - start_s) / SECOND_S) + 1, 3), np.nan)
    for record in told:
        seconds = of_seconds(record, start_s, lambda part: part.matrix(ACCELEROMETERS))
        force[seconds.at] = seconds.means
    with np.errstate(invalid="ignore"):
        units = force / np.linalg.norm(force, axis=1)[:, np.newaxis]
    known = units[np.isfinite(units).all(axis=1)]
    if not len(known):
        return []
    usual = np.median(known, axis=0)
    tilt_deg = np.degrees(np.arccos(np.clip(units @ (usual / np.linalg.norm(usual)), -1.0, 1.0)))
    starts, ends = runs(np.asarray(tilt_deg > _LIES_DEG))
    return [
        (start_s + first * SECOND_S, start_s + stop * SECOND_S, _lying_text(tilt_deg[first:stop], start_s + first))
        for first, stop in zip(starts.tolist(), ends.tolist(), strict=True)
        if stop - first >= _LIES_S
    ]


def _lying_text(tilt_deg: FloatArray, at_s: float) -> str:
    side = "back" if float(np.median(tilt_deg)) > 135.0 else "side"
    return f"the aircraft lies on its {side} from {at_s:.1f} s on"


def crash_of(watches: Sequence[Watch], excursions: Sequence[Excursion]) -> Excursion | None:
    """Return the first hard contact, or failure, after which the aircraft doesn't fly on; None where it always does."""
    return min(_crashes(watches, excursions), key=lambda each: each.start_s, default=None)


def _crashes(watches: Sequence[Watch], excursions: Sequence[Excursion]) -> list[Excursion]:
    """Return the hard contacts, and the failures that an autopilot tells of, after which the aircraft doesn't fly."""
    hard = [each for each in excursions if each.reason == FAILURE or (each.is_hard and each.reason in CONTACTS)]
    flown_s = _flown_s(watches) if hard else np.zeros(0)
    return [each for each in hard if np.count_nonzero(flown_s >= each.end_s) < _FLIES_ON_S]


def _flown_s(watches: Sequence[Watch]) -> FloatArray:
    """Return the seconds of watches in which the aircraft turned, and an alarm was possible."""
    times_s = [np.zeros(0)]
    for watch in watches:
        if {*GYROS, *ATTITUDE} <= set(watch.record.channels):
            seconds_s, turning = turning_by_second([watch.record])
            rows = np.searchsorted(watch.record.time_s, seconds_s)
            times_s.append(seconds_s[(turning > LIVELY_DEG_S) & watch.armed[rows]])
    return np.concatenate(times_s)

"""Which sensors of a course failed, by the engine, and why nobody is named where nobody can be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.alarm import Judgement
from gtmbench.engine.course.course import UNITS, Course, course_of
from gtmbench.engine.course.explanations.registry import explanations_of
from gtmbench.engine.course.relations import gps_altitude
from gtmbench.engine.course.relations.registry import relations_of
from gtmbench.engine.course.standing import LEAST_S, standing
from gtmbench.engine.finding import DECISIVE, FROZEN, Finding
from gtmbench.engine.findings import found_by
from gtmbench.engine.flight import Flight
from gtmbench.engine.samples import Samples
from gtmbench.engine.sums import CELL
from gtmbench.values.channels import MAGNETOMETER, WHOLE, names_of
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import Claim, SensorSpan, State, unjudged

_SHORTEST_S = 15.0  # gusts and contacts with the ground last less
_LANDING_S = 20.0  # before motion ends: what begins so late may be a landing
_PASSES_S = 25.0  # a sensor that fails seldom heals so soon
_WITNESSES = 2  # relations that have to show an error of a sensor that is named
_MOST = 2  # suspects that are told
_OF_REST, _MOST_LIVELY = 1.5, 0.9  # by how much it may turn more there than elsewhere; of the liveliest blocks
_BESIDE = 0.3  # of the evidence of a finding
_MOVES_DEG_S, _AS_LIVELY = 1.5, 0.5  # while a sensor stands still; of what is usual
_MAG = "magnetometer"


@dataclass(frozen=True, kw_only=True, eq=False)
class CourseJudged:
    """Which sensors of a course failed.

    Attributes
    ----------
    found : tuple of Finding
        With doubts.
    course : Course
    stands : tuple of (channel, span, reading)
        Which channels read one value.
    """

    found: tuple[Finding, ...]
    course: Course = field(repr=False)
    stands: tuple[tuple[str, Span, float], ...] = ()

    @property
    def claims(self) -> tuple[Claim, ...]:
        """All that is claimed of sensors that no gyro enters."""
        return (*self.standing, *self.accused, *self.unjudged)

    def explains(self, span: Span) -> bool:
        """Tell whether somebody is accused of something that goes on in a span."""
        return any(each.meets(*span) for _, each in (*self.standing, *self.accused))

    @property
    def standing(self) -> tuple[Claim, ...]:
        """Which sensors stand still while the aircraft flies."""
        return tuple(self._stands(*each) for each in self.stands)

    def _stands(self, channel: str, span: Span, reads: float) -> Claim:
        sensor = names_of(channel)[-1]
        judgement = Judgement(
            time_s=span[0] + LEAST_S,
            sensor=sensor,
            candidates=(sensor,),
            kind=FROZEN,
            parameters={"value": reads, "onset_s": span[0]},
            axis=channel if sensor != channel else "",
        )
        return sensor, SensorSpan(start_s=span[0], end_s=span[1], state=State.FAILED, judgement=judgement)

    @property
    def accused(self) -> tuple[Claim, ...]:
        """Whom findings accuse: the one sensor that is left, or each of two."""
        return tuple(claim for each in self.found if each.accuses for claim in self._of(each))

    @property
    def unjudged(self) -> tuple[Claim, ...]:
        """Where something shows and nobody is accused: those that may be behind it."""
        return tuple(
            (sensor, unjudged((each.onset_s, each.end_s), each.doubt or f"{each.best.suspect} may do the same"))
            for each in self.found
            if not each.accuses
            for sensor in sensors_of(each)
        )

    def _of(self, finding: Finding) -> Iterator[Claim]:
        suspects = sensors_of(finding)
        state = State.FAILED if len(suspects) == 1 else State.SUSPECTED
        for sensor in suspects:
            yield (
                sensor,
                SensorSpan(
                    start_s=finding.onset_s,
                    end_s=finding.end_s,
                    state=state,
                    suspects=() if state is State.FAILED else suspects,
                    reason="" if state is State.FAILED else f"{' or '.join(suspects)} explains it",
                    judgement=self._judgement(finding, suspects),
                ),
            )

    def _judgement(self, finding: Finding, suspects: tuple[str, ...]) -> Judgement:
        best = finding.best
        unit = _unit(self.course, best.suspect)
        name = {"bias": "size", "drift": "slope"}[best.kind]
        low, high = finding.interval
        return Judgement(
            time_s=max(finding.shows_s, finding.onset_s),
            sensor=suspects[0] if len(suspects) == 1 else None,
            candidates=suspects,
            kind=best.kind,
            parameters={name: unit * finding.size, "onset_s": finding.onset_s},
            errors={
                name: 0.25 * abs(unit) * (high - low),
                "onset_s": 0.25 * (finding.onset_range_s[1] - finding.onset_range_s[0]),
            },
            reason="" if len(suspects) == 1 else f"{' or '.join(suspects)} explains it",
            axis=best.suspect if names_of(best.suspect)[-1] in WHOLE else "",
        )


def sensors_of(finding: Finding) -> tuple[str, ...]:
    """Return the sensors that may be behind a finding, those of several channels as one; causes that fail not are left.

    >>> from gtmbench.engine.effect import Effect
    >>> from gtmbench.engine.explanation import Explanation
    >>> kinds = [Explanation(suspect=each, kind="bias", effect=lambda _: Effect()) for each in ("nx", "nz", "tas")]
    >>> about = dict(first=0, last=9, onset_s=4.0, end_s=9.0, onset_range_s=(3.0, 5.0), evidence=50.0)
    >>> sensors_of(Finding(ranked=tuple((each, 0.0) for each in kinds), size=1.0, interval=(0.9, 1.1), **about))
    ('accelerometers', 'tas')
    """
    own = [each.suspect for each, _ in finding.ranked if not each.is_healthy]
    return tuple(dict.fromkeys(names_of(name)[-1] for name in (*own, *finding.others)))


def course_judged(flight: Flight, sensors: Mapping[str, Samples]) -> CourseJudged:
    """Return which of a flight's other sensors failed.

    Parameters
    ----------
    flight : Flight
    sensors : mapping of channel to Samples
        As `course_of` takes them.
    """
    held = standing(sensors, course_of(flight, {}).flown_s)
    stands = tuple((name, span, reads) for name, span, reads in held if _moves(flight, span))
    still = {names_of(name)[-1] for name, _, _ in stands}
    course = course_of(flight, {name: each for name, each in sensors.items() if names_of(name)[-1] not in still})
    relations = relations_of(course)
    found = found_by(flight, relations, explanations_of(course)).found if relations else ()
    return CourseJudged(found=tuple(_doubted(course, found)), course=course, stands=stands)


def _moves(flight: Flight, span: Span) -> bool:
    """Tell whether the aircraft moves in a span as elsewhere: what stands on the ground reads one value."""
    time_s = flight.blocks.start_s + flight.time_s
    inside = (time_s >= span[0]) & (time_s <= span[1]) & flight.judged
    rest = ~inside & flight.judged
    if not inside.any() or not rest.any():
        return False
    usual = float(np.median(flight.lively[rest]))
    return bool(np.median(flight.lively[inside]) > max(_MOVES_DEG_S, _AS_LIVELY * usual))


def _doubted(course: Course, found: Sequence[Finding]) -> Iterator[Finding]:
    for each in found:
        others = _others(each)
        reasons = [*_few(each, others), *_short(course, each), *_livelier(course, each), *_field(each)]
        yield replace(each, others=others, doubt="; ".join([*reasons, *_beside(each, found)]))


def _others(finding: Finding) -> tuple[str, ...]:
    """Return who else enters the one comparison that shows a finding: what that doesn't know of may be theirs."""
    shown = {name for name, _, nats in finding.shown_by if nats > DECISIVE}
    return {frozenset({gps_altitude.NAME}): ("gps", "altitude")}.get(frozenset(shown), ())


def _few(finding: Finding, others: tuple[str, ...]) -> list[str]:
    """Name nobody whom one relation alone shows: what it doesn't know of would be told as a fault."""
    suspects = sensors_of(replace(finding, others=others))
    if len(suspects) > _MOST:
        return [f"{', '.join(suspects[:-1])} or {suspects[-1]} explains it"]
    shown = {name for name, _, nats in finding.shown_by if nats > DECISIVE}
    return ["one comparison alone shows it"] if len(shown) < _WITNESSES and not others else []


def _short(course: Course, finding: Finding) -> list[str]:
    rows = np.flatnonzero(course.flown)
    if not len(rows):
        return ["nothing flies"]
    end_s = course.flight.blocks.start_s + (int(rows[-1]) + 1) * course.flight.blocks.period_s
    if finding.onset_s > end_s - _LANDING_S:
        return ["it begins as the motion ends"]
    lasts_s = min(finding.end_s, end_s) - finding.onset_s
    if lasts_s < _SHORTEST_S:
        return [f"it lasts {lasts_s:.0f} s"]
    ends = finding.end_s < end_s - _LANDING_S
    if ends and (lasts_s < _PASSES_S or finding.best.kind == "drift"):
        return [f"it passes after {lasts_s:.0f} s"]
    return []


def _livelier(course: Course, finding: Finding) -> list[str]:
    """Judge nothing in motion that the rest of the log hasn't seen."""
    lively, inside = course.flight.lively, np.zeros(len(course.flight), dtype=bool)
    inside[finding.first * CELL : finding.last * CELL] = True
    there, rest = inside & course.flown, ~inside & course.flown
    if not there.any() or not rest.any():
        return ["nothing is known beside it"]
    most = (float(np.quantile(lively[rows], _MOST_LIVELY)) for rows in (there, rest))
    return ["it moves more there than anywhere else"] if next(most) > _OF_REST * next(most) else []


def _field(finding: Finding) -> list[str]:
    """Name no magnetometer: iron at headings that are new, and what motors draw, do the same."""
    return ["motors' currents and iron do the same"] if _MAG in sensors_of(finding) else []


def _beside(finding: Finding, found: Sequence[Finding]) -> list[str]:
    """Name nobody beside a healthy cause that is as strong: two that cancel each other explain anything."""
    for other in found:
        if other is not finding and other.is_healthy and other.meets(finding.first, finding.last):
            shared = {name for name, _, _ in finding.shown_by} & {name for name, _, _ in other.shown_by}
            if shared and other.evidence > _BESIDE * finding.evidence:
                return [f"{other.best.suspect} explains as much beside it"]
    return []


def _unit(course: Course, channel: str) -> float:
    """Return what one of a channel's explanation is in the channel's unit."""
    if channel in MAGNETOMETER:
        return float(np.nanmedian(np.linalg.norm(course.field, axis=1)))
    return 1.0 / UNITS.get(channel, 1.0)

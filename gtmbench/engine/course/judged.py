"""Which sensors of a course failed, by the engine, and why nobody is named where nobody can be."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.engine.course.blocked import BLOCKED, blocked
from gtmbench.engine.course.blocked import LEAST_S as LEAST_TUBE_S
from gtmbench.engine.course.cleared import cleared
from gtmbench.engine.course.course import Course, course_of
from gtmbench.engine.course.explanations.registry import explanations_of
from gtmbench.engine.course.jumps import STAYS_S, gps_jumps, jumps
from gtmbench.engine.course.misread import misread
from gtmbench.engine.course.relations import gps_altitude
from gtmbench.engine.course.relations.registry import compared, relations_of
from gtmbench.engine.course.standing import LEAST_S, Stands, standing
from gtmbench.engine.curves import ErrorCurve, curves_of
from gtmbench.engine.doubts import BENT_DEG
from gtmbench.engine.finding import FROZEN, NOISE, Finding
from gtmbench.engine.findings import found_by
from gtmbench.engine.flight import Flight
from gtmbench.engine.hindsight.cleared_sensors import JUDGED
from gtmbench.engine.judged import Judged
from gtmbench.engine.model import Model
from gtmbench.engine.named import WHOLE as WHOLE_LOG
from gtmbench.engine.named import claims_of, judgement_of
from gtmbench.engine.samples import Samples
from gtmbench.engine.search import BOUND
from gtmbench.engine.sums import blocks_of_cells
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS, WHOLE, names_of
from gtmbench.values.record import Span
from gtmbench.verdict.timeline import Claim, unjudged

if TYPE_CHECKING:
    from gtmbench.engine.commands import CommandsJudged

_SHORTEST_S = 15.0  # gusts and contacts with the ground last less
_LANDING_S = 20.0  # before motion ends: what begins so late may be a landing
_JUST_THEN_S = 5.0  # between a jump and what relations date by it
_PASSES_S = 25.0  # a sensor that fails seldom heals so soon
_LEVEL, _STAYS_M = "altitude drift", 25.0  # by so much no healthy pressure drifts in half a minute
_WITNESSES = 2  # relations that have to show an error of a sensor that is named
_MOST = 2  # suspects that are told
_OF_REST, _MOST_LIVELY = 1.5, 0.9  # by how much it may turn more there than elsewhere; of the liveliest blocks
_BESIDE = 0.3  # of the evidence of a finding
_MOVES_DEG_S, _AS_LIVELY = 1.5, 0.5  # while a sensor stands still; of what is usual
_MAG, _BENDS = "magnetometer", "error"  # which change of a gyro may bend an attitude
# of the field: the most that motors' currents add, by ArduPilot's limit of what can be flown with; in a tenth of a span
_BY_CURRENTS, _MOST_OF_IT = 0.6, 0.9
# who else enters the one comparison that shows a finding: what that doesn't know of may be theirs
_OF_ONE = {frozenset({gps_altitude.NAME}): ("gps", "altitude")}


@dataclass(frozen=True, kw_only=True, eq=False)
class CourseJudged:
    """Which sensors of a course failed."""

    found: tuple[Finding, ...]  # with doubts
    course: Course = field(repr=False)
    stands: tuple[Stands, ...] = ()  # which channels read one value
    jumped: tuple[tuple[str, float, float], ...] = ()  # which channels jump, when and by how much
    # which sensors read another unit or frame than is thought, so that they aren't judged
    asked: tuple[tuple[str, str], ...] = ()
    # the course's equations, with everything that was found taken away; None where no relation holds
    model: Model | None = field(default=None, repr=False)
    clear: tuple[Claim, ...] = field(default=(), repr=False)  # where sensors are clear
    # what the answer to commands says of surfaces; None where it isn't known
    commands: CommandsJudged | None = field(default=None, repr=False)

    @property
    def curves(self) -> tuple[ErrorCurve, ...]:
        """What shows that somebody may have failed, an equation each, beside what a finding makes of it."""
        return () if self.model is None else curves_of(self.model, self.found, partial(_unit_of, self.course))

    @property
    def claims(self) -> tuple[Claim, ...]:
        """All that is claimed of sensors that no gyro enters."""
        return (*self.standing, *self.accused, *self.unjudged, *self.clear, *self.of_surfaces)

    @property
    def of_surfaces(self) -> tuple[Claim, ...]:
        """What is claimed of surfaces."""
        return () if self.commands is None else tuple(self.commands.claims)

    @property
    def compared(self) -> tuple[str, ...]:
        """The sensors that some relation holds."""
        return tuple(dict.fromkeys(sensor for each in compared(self.course.read) for sensor in each))

    @property
    def standing(self) -> tuple[Claim, ...]:
        """Which sensors show by themselves that they failed: they stand still in flight, jump, or are blocked."""
        end_s = self.course.flight.flown_s[1]
        tube = blocked(self.course)
        failed = [each for each in self.stands if not each.doubt]
        return (
            *((_blocked(tube[0]),) if tube else ()),
            *(_own(each.channel, each.span_s, FROZEN, "value", each.reads, LEAST_S) for each in failed),
            *(_own(channel, (at_s, end_s), "bias", "size", size, STAYS_S) for channel, at_s, size in self.jumped),
        )

    @property
    def accused(self) -> tuple[Claim, ...]:
        """Whom findings accuse: the one sensor that is left, or each of two; nobody else where one of them jumped."""
        jumps = [(names_of(channel)[-1], at_s) for channel, at_s, _ in self.jumped]
        own = [each for each in self.found if each.accuses and not _is_jump(each, jumps)]
        return tuple(claim for each in own for claim in self._of(each))

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The same as alarms: one each failure, or suspicion, in time."""
        claimed = (*self.standing, *self.accused, *self.of_surfaces)
        told = {id(span.judgement): (sensor, span, span.judgement) for sensor, span in claimed if span.judgement}
        in_time = sorted(told.values(), key=lambda each: each[1].start_s)
        return tuple(
            Alarm(
                number=number,
                time_s=max(judgement.time_s, span.start_s),
                onset_s=span.start_s,
                source=sensor,
                test=WHOLE_LOG,
                judgements=(judgement,),
                ended_s=span.end_s,
            )
            for number, (sensor, span, judgement) in enumerate(in_time)
        )

    @property
    def unjudged(self) -> tuple[Claim, ...]:
        """Where something shows and nobody is accused: those that may be behind it."""
        blocks = self.course.flight.blocks
        held = [(each.sensor, unjudged(each.span_s, each.doubt)) for each in self.stands if each.doubt]
        misread = [
            (sensor, unjudged((blocks.start_s, blocks.end_s), f"{why}: give its columns and units with --map"))
            for sensor, why in self.asked
        ]
        open_to = [
            (sensor, unjudged((each.onset_s, each.end_s), each.doubt or f"{each.best.suspect} may do the same"))
            for each in self.found
            if not each.accuses
            for sensor in sensors_of(each)
        ]
        return (*held, *misread, *open_to)

    def _of(self, finding: Finding) -> Iterator[Claim]:
        suspects, shows_s = sensors_of(finding), max(finding.shows_s, finding.onset_s)
        sensor = suspects[0] if len(suspects) == 1 else None
        reason = f"{' or '.join(suspects)} explains it"
        judgement = replace(
            judgement_of(finding, shows_s),
            sensor=sensor,
            candidates=suspects,
            axis=_axis_of(finding.best.suspect),
            reason="" if sensor else reason,
        )
        yield from claims_of(judgement, suspects, (finding.onset_s, finding.end_s), reason)


def _own(channel: str, span: Span, kind: str, name: str, size: float, shows_s: float) -> Claim:
    """Return a claim of a sensor that shows by itself that it failed."""
    sensor = names_of(channel)[-1]
    judgement = Judgement(
        time_s=span[0] + shows_s,
        sensor=sensor,
        candidates=(sensor,),
        kind=kind,
        parameters={name: size, "onset_s": span[0]},
        axis=_axis_of(channel),
    )
    return next(claims_of(judgement, (sensor,), span))


def _blocked(span: Span) -> Claim:
    """Return a claim of an airspeed whose tube is blocked."""
    judgement = Judgement(
        time_s=span[0] + LEAST_TUBE_S,
        sensor="tas",
        candidates=("tas",),
        parameters={"onset_s": span[0]},
        reason=BLOCKED,
    )
    sensor, told = next(claims_of(judgement, ("tas",), span))
    return sensor, replace(told, reason=BLOCKED)


def _is_jump(finding: Finding, jumps: Sequence[tuple[str, float]]) -> bool:
    """Tell whether a finding that has several suspects is what the jump of one of them does in relations."""
    suspects = sensors_of(finding)
    jumped = any(name in suspects and abs(finding.onset_s - at_s) < _JUST_THEN_S for name, at_s in jumps)
    return jumped and len(suspects) > 1


def sensors_of(finding: Finding) -> tuple[str, ...]:
    """Return the sensors that may be behind a finding, those of several channels as one; causes that fail not are left.

    >>> from gtmbench.engine.relation import Effect
    >>> from gtmbench.engine.explanation import Explanation
    >>> kinds = [Explanation(suspect=each, kind="bias", effect=lambda _: Effect()) for each in ("nx", "nz", "tas")]
    >>> about = dict(first=0, last=9, onset_s=4.0, end_s=9.0, onset_range_s=(3.0, 5.0), evidence=50.0)
    >>> sensors_of(Finding(ranked=tuple((each, 0.0) for each in kinds), size=1.0, interval=(0.9, 1.1), **about))
    ('accelerometers', 'tas')
    """
    own = [each.suspect for each, _ in finding.ranked if not each.is_healthy]
    return tuple(dict.fromkeys(names_of(name)[-1] for name in (*own, *finding.others)))


def course_judged(flight: Flight, sensors: Mapping[str, Samples], bent: Sequence[str] = ()) -> CourseJudged:
    """Return which of a flight's other sensors failed.

    `sensors`, by channel: as `course_of` takes them. `bent`: why the attitude may be bent, by which every relation
    turns what sensors read.
    """
    sensors = {name: each for name, each in sensors.items() if name not in (*GYROS, *COMMANDS)}
    stands = tuple(each for each in standing(sensors, flight.flown_s) if _moves(flight, each.span_s))
    still = {each.sensor for each in stands if not each.doubt}
    course = course_of(flight, {name: each for name, each in sensors.items() if names_of(name)[-1] not in still})
    asked = tuple(misread(course))
    if asked:
        still |= {sensor for sensor, _ in asked}
        course = course_of(flight, {name: each for name, each in sensors.items() if names_of(name)[-1] not in still})
    own = (*jumps(sensors, flight.flown_s), *gps_jumps(course))
    jumped = tuple(each for each in own if names_of(each[0])[-1] not in still)
    relations = relations_of(course)
    if not relations:
        return CourseJudged(found=(), course=course, stands=stands, jumped=jumped, asked=asked)
    findings = found_by(flight, relations, explanations_of(course))
    doubted = tuple(_with_doubts(course, findings.found, bent))
    return CourseJudged(
        found=tuple(_in_units(course, each) for each in doubted),
        course=course,
        stands=stands,
        jumped=jumped,
        asked=asked,
        model=findings.model,
        clear=tuple(cleared(course, findings, sensors, doubted)),
    )


def course_beside(whole: Judged, sensors: Mapping[str, Samples]) -> CourseJudged:
    """Return which of a flight's other sensors failed, where no gyro did and no angle may, as `course_judged` does.

    `whole`: what is said of the flight's gyros and attitude. `sensors`, by channel.
    """
    broken = [
        (span.start_s, span.end_s)
        for sensor, span in whole.accused
        if sensor in JUDGED and {*span.suspects} <= {*JUDGED}  # where another IMU may be it, the attitude isn't bent
    ]
    broken += [(each.onset_s, each.end_s) for each in whole.found if each.doubt and {*each.suspects} & {*ATTITUDE}]
    bent = [each.text for each in whole.cleared.changes if each.of == _BENDS]  # by a gyro that nobody names
    bent += _far_off(whole)
    beside = course_judged(whole.flight.without(broken), sensors, bent)
    if not {*COMMANDS} <= sensors.keys():
        return beside
    from gtmbench.engine.commands import commands_judged  # few logs tell commands

    claims = [(sensor, span) for sensor, spans in whole.claims.items() for span in spans]
    found = [*whole.found, *beside.found]
    return replace(beside, commands=commands_judged(beside.course.flight, sensors, [*claims, *beside.claims], found))


def _far_off(whole: Judged) -> Iterator[str]:
    """Say which of bank and pitch may be off so far that the specific force seems to."""
    for angle in ATTITUDE[:2]:
        may_be_deg = max((span.sizes.error for span in whole.cleared.claims[angle] if span.sizes), default=0.0)
        if may_be_deg > BENT_DEG:
            yield f"{angle} may be off by {may_be_deg:.0f} deg"


def _in_units(course: Course, finding: Finding) -> Finding:
    """Return a finding whose size is in its channel's unit."""
    unit = _unit_of(course, finding)
    low, high = sorted(unit * bound for bound in finding.interval)
    return replace(finding, size=unit * finding.size, interval=(low, high))


def _unit_of(course: Course, finding: Finding) -> float:
    """Return what an error of one is in a finding's unit; a noise's is a logarithm."""
    return 1.0 if finding.best.kind == NOISE else course.unit_of(finding.best.suspect)


def _moves(flight: Flight, span: Span) -> bool:
    """Tell whether the aircraft moves in a span as elsewhere: what stands on the ground reads one value."""
    inside = flight.blocks.within([span]) & flight.judged
    rest = ~inside & flight.judged
    if not inside.any() or not rest.any():
        return False
    usual = float(np.median(flight.lively[rest]))
    return bool(np.median(flight.lively[inside]) > max(_MOVES_DEG_S, _AS_LIVELY * usual))


def _with_doubts(course: Course, found: Sequence[Finding], bent: Sequence[str]) -> Iterator[Finding]:
    flight = course.flight
    for each in found:
        told = replace(each, others=_OF_ONE.get(frozenset(_shown_by(each)), ()))
        rest = [other for other in found if other is not each]
        is_own = _is_its_own(course, told)
        own = [] if is_own else [*_few(told, rest), *_field(told)]
        reasons = [*own, *_short(flight, told), *_livelier(flight, told), *_beside(told, rest)]
        yield replace(told, doubt="; ".join(reasons or ([] if is_own else bent[:1])))


def _shown_by(finding: Finding) -> set[str]:
    """Return the relations that show a finding."""
    return {name for name, _, _ in finding.shown_by}


def _nats(finding: Finding) -> dict[str, float]:
    """Return how much each relation shows of a finding."""
    names = dict.fromkeys(name for name, _, _ in finding.shown_by)
    return {name: sum(nats for other, _, nats in finding.shown_by if other == name) for name in names}


def _is_its_own(course: Course, finding: Finding) -> bool:
    """Tell whether nothing but the one sensor that is left makes what a single comparison shows.

    A noise from reading to reading, or a field that is read so much stronger than anywhere else that no attitude, no
    iron and no motor's current can be behind it.
    """
    if len(sensors_of(finding)) > 1 or finding.is_healthy:
        return False
    if finding.best.kind == NOISE:
        return True
    if _MAG not in sensors_of(finding):
        return False
    inside = blocks_of_cells(finding.first, finding.last, len(course.flight))
    read = np.linalg.norm(course.field, axis=1)
    there, rest = (read[rows & np.isfinite(read)] for rows in (inside, ~inside & course.flight.flown))
    if not len(there) or not len(rest):
        return False
    return bool(np.quantile(there, _MOST_OF_IT) - rest.max() > _BY_CURRENTS * course.strength)


def _few(finding: Finding, rest: Sequence[Finding]) -> list[str]:
    """Name nobody whom one relation alone shows: what it doesn't know of would be told as a fault.

    A relation that shows more of another finding is none that shows this one: it may be what is left of the other. Nor
    is one of which it wouldn't be a finding by itself.
    """
    suspects = sensors_of(finding)
    if len(suspects) > _MOST:
        return [f"{', '.join(suspects[:-1])} or {suspects[-1]} explains it"]
    beside = [_nats(other) for other in rest if other.meets(finding.first, finding.last)]
    strong = {name: nats for name, nats in _nats(finding).items() if nats >= BOUND}
    showing = [name for name, nats in strong.items() if all(each.get(name, 0.0) <= nats for each in beside)]
    is_alone = len(showing) < _WITNESSES and not finding.others
    return ["one comparison alone shows it"] if is_alone else []


def _short(flight: Flight, finding: Finding) -> list[str]:
    start_s, end_s = flight.flown_s
    if not flight.flown.any():
        return ["nothing flies"]
    if finding.onset_s < start_s + _SHORTEST_S:
        return ["too little is known before it"]
    if finding.onset_s > end_s - _LANDING_S:
        return ["it begins as the motion ends"]
    lasts_s = min(finding.end_s, end_s) - finding.onset_s
    if lasts_s < _SHORTEST_S:
        return [f"it lasts {lasts_s:.0f} s"]
    ends = finding.end_s < end_s - _LANDING_S
    if ends and finding.best.name == _LEVEL and abs(finding.size) * lasts_s > _STAYS_M:
        return []  # a level that was left stays off, though it drifts no more
    if ends and (lasts_s < _PASSES_S or finding.best.kind == "drift"):
        return [f"it passes after {lasts_s:.0f} s"]
    return []


def _livelier(flight: Flight, finding: Finding) -> list[str]:
    """Judge nothing in motion that the rest of the log hasn't seen."""
    inside = blocks_of_cells(finding.first, finding.last, len(flight))
    there, rest = inside & flight.flown, ~inside & flight.flown
    if not there.any() or np.count_nonzero(rest) * flight.blocks.period_s < _SHORTEST_S:
        return ["too little is known beside it"]
    most, elsewhere = (float(np.quantile(flight.lively[rows], _MOST_LIVELY)) for rows in (there, rest))
    return ["it moves more there than anywhere else"] if most > _OF_REST * elsewhere else []


def _field(finding: Finding) -> list[str]:
    """Name no magnetometer: iron at headings that are new, and what motors draw, do the same."""
    return ["motors' currents and iron do the same"] if _MAG in sensors_of(finding) else []


def _beside(finding: Finding, found: Sequence[Finding]) -> list[str]:
    """Name nobody beside a healthy cause that is as strong: two that cancel each other explain anything.

    What begins when the finding has long shown doesn't make it. Nor by one comparison what may be left of a stronger
    error in it.
    """
    others = [other for other in found if other.meets(finding.first, finding.last)]
    alike = [other for other in others if _shown_by(finding) & _shown_by(other)]
    before = [other for other in alike if other.onset_s < finding.shows_s]
    shown = sum(_nats(finding).values())
    strong = [other for other in before if other.is_healthy and sum(_nats(other).values()) > _BESIDE * shown]
    more = [other for other in alike if finding.others and other.evidence > finding.evidence]
    return [f"{other.best.suspect} explains as much beside it" for other in (*strong, *more)[:1]]


def _axis_of(channel: str) -> str:
    """Return a channel that is one of a sensor's several; "" of a sensor of its own."""
    return channel if names_of(channel)[-1] in WHOLE else ""

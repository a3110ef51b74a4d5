"""The timeline of a watched log, of all that is claimed of its sensors: the one place where they are put together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.protocol import Detector, Monitor, Watch, suspects_of
from gtmbench.engine.finding import FROZEN
from gtmbench.engine.hindsight.cleared_sensors import JUDGED, Failure, Hindsight
from gtmbench.engine.judged import Judged, failure_of
from gtmbench.faults.kinds.replacing import Dropout
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.tracks import without
from gtmbench.log.judging.claims import (
    UNHELD,
    motion_spans,
    of_alarm,
    of_certificate,
    of_check,
    of_excursions,
    of_out_of_range,
    of_unread,
    of_watches,
)
from gtmbench.log.judging.imus import imu_claims
from gtmbench.log.opening.records import lively_seconds
from gtmbench.log.self_check.refusal import SelfCheck
from gtmbench.values.channels import WHOLE, axis_of
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Record, Span
from gtmbench.verdict.timeline import Claim, SensorSpan, State, Timeline, laid_out, unjudged

if TYPE_CHECKING:
    from gtmbench.engine.course.judged import CourseJudged
    from gtmbench.history.standing import Standing
    from gtmbench.log.judging.certificate import Certificate

_SOON_S = 15.0  # between the onsets of one failure
_BLOCKS = 3  # of the engine, within which a log ends behind the last that is whole
_COMPARED = "compared with others, and nothing was found; no size is promised here"


@dataclass(frozen=True, kw_only=True, eq=False)
class Certified:
    """A certificate, and the stretches that it holds for."""

    certificate: Certificate
    watches: tuple[Watch, ...] = field(repr=False)


@dataclass(frozen=True, kw_only=True, eq=False)
class LogEvidence:
    """All that is known of a log when its timeline is laid out."""

    log: FlightLog
    sensors: tuple[str, ...]  # the sensors that the log has
    monitor: Monitor | Detector
    # the log with gyros and attitude; none where the monitor doesn't compare these, or the log hasn't them
    moving: tuple[Record, ...] = field(repr=False)
    has_heading: bool  # whether its heading is a sensor's
    # what the engine says of gyros and attitude over the whole log
    judged: Judged | None = field(default=None, repr=False)
    course: CourseJudged | None = field(default=None, repr=False)  # what it says of the others
    alarms: tuple[Alarm, ...]  # of all others
    watches: tuple[Watch, ...] = field(repr=False)
    check: SelfCheck
    excursions: tuple[Excursion, ...] = field(repr=False)
    unwatched: tuple[tuple[str, str], ...]
    certified: tuple[Certified, ...]  # of a monitor that rests on no motion: what clears the sensors that it predicts
    watched_imu: str
    reasons: tuple[str, ...] = ()  # what limits the verdict, where nothing could have alarmed
    out_of_range: tuple[OutOfRange, ...] = ()  # of all that was read
    beside: Standing | None = field(default=None, repr=False)  # what the flight is beside those of its airframe before


def timeline_of(evidence: LogEvidence) -> Timeline:
    """Return the timeline of a watched log."""
    span_s, unread = evidence.log.span_s, evidence.log.unread
    claims = _accused(evidence, span_s)
    claims += _of_course(evidence)
    whole = () if evidence.judged is None else JUDGED
    claims += of_check(evidence.check, span_s, evidence.sensors, whole)
    claims += [(sensor, unjudged(span_s, reason)) for sensor, reason in evidence.unwatched]
    if not evidence.has_heading and not evidence.unwatched:
        claims += [(sensor, unjudged(span_s, "the log is read without a heading")) for sensor in axis_of("psi")]
    claims += of_excursions(evidence.excursions, evidence.sensors)
    claims += of_watches(evidence.watches)
    if not evidence.check.causes:
        claims += _cleared(evidence, claims)
    told = [*_held_lines(evidence), *_silence_lines(evidence, claims)]
    if evidence.judged is not None and not evidence.check.stops:
        of_imus = imu_claims(evidence.judged, claims)
        claims += of_imus.claims
        told += of_imus.lines
    claims += _left_open(evidence, claims)
    if evidence.beside is not None and not evidence.check.stops:
        claims += evidence.beside.claims(span_s)
    by_sensor: dict[str, list[SensorSpan]] = {sensor: [] for sensor in evidence.sensors}
    for sensor, span in [*of_unread(unread, evidence.sensors), *claims]:
        by_sensor.setdefault(sensor, []).append(span)
    for sensor, span in of_out_of_range(evidence.out_of_range, by_sensor):
        by_sensor[sensor].insert(0, span)  # the reason that is told
    told += [f"{each.text}." for each in evidence.out_of_range]
    moving = evidence.moving
    motion = motion_spans(lively_seconds(moving).tolist(), span_s, unread) if moving else (span_s,)
    return laid_out(span_s, by_sensor, motion_s=motion, told=told)


def _of_course(evidence: LogEvidence) -> list[Claim]:
    """Return what the engine claims of sensors that no gyro enters, by the rows that the log has for them."""
    found: list[Claim] = []
    for sensor, span in () if evidence.course is None else evidence.course.claims:
        rows, judged = rows_of(sensor, evidence.sensors), span.judgement
        if judged is not None and judged.axis in rows:
            rows, judged = [judged.axis], replace(judged, sensor=judged.sensor and judged.axis, axis="")
        found += [(row, replace(span, judgement=judged)) for row in rows]
    return found


def rows_of(sensor: str, there: Sequence[str]) -> list[str]:
    """Return the rows of a sensor in a timeline: its channels that a log has by themselves, or else its name.

    >>> rows_of("accelerometers", ["p", "nx", "ny", "nz"]), rows_of("gps", ["p"])
    (['nx', 'ny', 'nz'], ['gps'])
    """
    return [name for name in WHOLE.get(sensor, (sensor,)) if name in there] or [sensor]


def _left_open(evidence: LogEvidence, claims: Sequence[Claim]) -> Iterator[Claim]:
    """Give where the other sensors that some relation holds aren't clear, and nobody says why."""
    for row in _compared(evidence):
        clear = [(span.start_s, span.end_s) for sensor, span in claims if (sensor, span.state) == (row, State.CLEAR)]
        yield from ((row, unjudged(left, _COMPARED)) for left in without([evidence.log.span_s], clear))


def _compared(evidence: LogEvidence) -> list[str]:
    """Return the rows of the other sensors that some relation holds."""
    held = () if evidence.course is None else evidence.course.compared
    return [row for sensor in held for row in rows_of(sensor, evidence.sensors)]


def _accused(evidence: LogEvidence, span_s: Span) -> list[Claim]:
    """Return whom the engine accuses, or alarms of what it doesn't judge."""
    alarmed = [
        claim
        for each in evidence.alarms
        for claim in of_alarm(each, span_s[1], _concerned(evidence, each), evidence.watched_imu, evidence.excursions)
    ]
    judged = evidence.judged
    if judged is None:
        return alarmed
    own = [(sensor, _to_the_end(judged, span, span_s)) for sensor, span in judged.accused]
    return [*((sensor, _as_alarmed(sensor, span, alarmed)) for sensor, span in own), *_beside(judged, alarmed)]


def _beside(judged: Judged, alarmed: Sequence[Claim]) -> Iterator[Claim]:
    """Give what alarms claim beside the engine; not judged is whom it would have to name, and doesn't."""
    for sensor, span in alarmed:
        is_its_own = _is_judged(sensor, span)
        if is_its_own and judged.names(sensor, span.start_s, span.end_s):
            continue
        is_held = span.state is State.FAILED and judged.holds(sensor, span.start_s, span.end_s)
        is_open = is_its_own and not is_held
        yield sensor, replace(span, state=State.NOT_JUDGED, reason=UNHELD, suspects=()) if is_open else span


def _is_judged(sensor: str, span: SensorSpan) -> bool:
    """Tell whether an alarm accuses whom the engine alone does: a gyro or an angle, unless its samples are missing."""
    is_missing = span.judgement is not None and span.judgement.kind == Dropout.kind
    return span.state in (State.FAILED, State.SUSPECTED) and sensor in JUDGED and not is_missing


def _as_alarmed(sensor: str, span: SensorSpan, alarmed: Sequence[Claim]) -> SensorSpan:
    """Return what the engine claims, with how and since when by the alarm of the same failure: it reads each sample."""
    for name, other in alarmed:
        if name == sensor and _is_judged(sensor, other) and _is_same(span, other):
            stands = span.judgement is not None and span.judgement.kind == FROZEN  # since when, readings tell exactly
            start_s = span.start_s if stands else other.start_s
            return replace(other, start_s=start_s, end_s=max(span.end_s, start_s))
    return span


def _to_the_end(judged: Judged, span: SensorSpan, span_s: Span) -> SensorSpan:
    """Return what the engine claims until its last whole block as claimed until the log's last sample."""
    blocks = judged.flight.blocks
    lasts = span.end_s >= blocks.end_s - blocks.period_s and span_s[1] - span.end_s < _BLOCKS * blocks.period_s
    return replace(span, end_s=max(span.end_s, span_s[1])) if lasts else span


def _is_same(span: SensorSpan, other: SensorSpan) -> bool:
    both = span.state is other.state is State.FAILED
    return both and span.meets(other.start_s, other.end_s) and abs(span.start_s - other.start_s) < _SOON_S


def _cleared(evidence: LogEvidence, claims: Sequence[Claim]) -> Iterator[Claim]:
    """Give where sensors are clear, by what the monitor rests on."""
    if evidence.judged is not None:
        said = _hindsight(evidence.judged, claims)
        left = JUDGED if evidence.has_heading else tuple(name for name in JUDGED if name not in axis_of("psi"))
        spans = evidence.judged.beside(said)
        yield from (
            (sensor, _to_the_end(evidence.judged, span, evidence.log.span_s))
            for sensor in left
            for span in spans[sensor]
        )
    elif any(each.certificate.rows for each in evidence.certified):
        for each in evidence.certified:
            yield from of_certificate(each.certificate, each.watches)
    elif not evidence.moving:
        silent = f"{evidence.monitor.name} states no size that it would find, so its silence says nothing"
        reason = (
            silent if any(watch.armed_hours for watch in evidence.watches) else next(iter(evidence.reasons), silent)
        )
        yield from ((sensor, unjudged(evidence.log.span_s, reason)) for sensor in _spoken_for(evidence))


def _hindsight(judged: Judged, claims: Sequence[Claim]) -> Hindsight:
    """Return what gyros and attitude say of each other over the whole log, but for what failed."""
    failures: dict[str, list[Failure]] = {}
    for sensor, span in claims:
        if span.state in (State.FAILED, State.SUSPECTED):
            failures.setdefault(sensor, []).append(failure_of(span))
    return judged.hindsight(failures)


def _spoken_for(evidence: LogEvidence) -> tuple[str, ...]:
    monitor = evidence.monitor
    return suspects_of(monitor) or basis_of(monitor).predicts or monitor.channels or evidence.log.channels


def _concerned(evidence: LogEvidence, alarm: Alarm) -> tuple[str, ...]:
    """Return the sensors that an alarm's statistic depends on."""
    for watch in evidence.watches:
        if any(alarm is each for each in watch.alarms) and alarm.source in watch.scores:
            return watch.scores[alarm.source].channels or _spoken_for(evidence)
    return _spoken_for(evidence)


def _held_lines(evidence: LogEvidence) -> list[str]:
    """Say in a line each which other sensors read one value, where it may be the log that does."""
    stands = () if evidence.course is None else evidence.course.stands
    return [
        f"{each.channel if each.channel in evidence.sensors else each.sensor} is not judged from {each.span_s[0]:.1f} "
        f"to {each.span_s[1]:.1f} s: {each.doubt}."
        for each in stands
        if each.doubt
    ]


def _silence_lines(evidence: LogEvidence, claims: Sequence[Claim]) -> list[str]:
    """Say in a line which sensors of the log nothing clears, and who compares some of them."""
    heard = {sensor for sensor, _ in claims}
    silent = [name for name in evidence.sensors if name not in heard]
    if not silent:
        return []
    compared = [name for name in silent if name in _compared(evidence)]
    told = f"; compared, with nothing found: {', '.join(compared)}" if compared else ""
    return [f"No verdict on {', '.join(silent)}{told}."]

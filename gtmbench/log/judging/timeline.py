"""The timeline of a watched log, of all that is claimed of its sensors: the one place where they are put together."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.protocol import Detector, Monitor, Watch, suspects_of
from gtmbench.engine.finding import FROZEN, NOISE
from gtmbench.engine.hindsight.cleared_sensors import JUDGED, Failure, Hindsight, LevelChange, agrees_from_s, shows
from gtmbench.engine.judged import Judged, failure_of, leaning, parting
from gtmbench.faults.kinds.replacing import Dropout
from gtmbench.faults.registry import how_of, whole_log_of
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.tracks import without
from gtmbench.log.judging.claims import (
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
from gtmbench.values.channels import ATTITUDE, GYROS, WHOLE, axis_of
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Record, Span
from gtmbench.verdict.timeline import Claim, SensorSpan, State, Timeline, laid_out, unjudged

if TYPE_CHECKING:
    from gtmbench.engine.course.judged import CourseJudged
    from gtmbench.history.standing import Standing
    from gtmbench.log.judging.certificate import Certificate

_LASTS_S = 10.0  # of what the whole log shows of a gyro
_BLOCKS = 3  # of the engine, within which a log ends behind the last that is whole
_COMPARED = "compared with others, and nothing was found; no size is promised here"
_SOON_S = 15.0  # between the onsets of one failure


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
    is_driven: bool  # whether the gyros drive the attitude
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
    """Return whom engine and alarms accuse; of failures that overlap and share a residual each is suspected."""
    alarmed = list(_alarmed(evidence, span_s))
    judged = evidence.judged
    accused = [] if judged is None else [(sensor, _to_the_end(judged, span, span_s)) for sensor, span in judged.accused]
    own = [_unless_unlike(*claim, alarmed) for claim in accused]
    claims = _as_one(own, list(_beside_engine(evidence, alarmed)))
    return [(sensor, _joint(sensor, span, claims)) for sensor, span in claims]


def _to_the_end(judged: Judged, span: SensorSpan, span_s: Span) -> SensorSpan:
    """Return what the engine claims until its last whole block as claimed until the log's last sample."""
    blocks = judged.flight.blocks
    lasts = span.end_s >= blocks.end_s - blocks.period_s and span_s[1] - span.end_s < _BLOCKS * blocks.period_s
    return replace(span, end_s=max(span.end_s, span_s[1])) if lasts else span


def _needs_motion(kind: str | None) -> bool:
    """Tell whether a kind shows in motion alone."""
    whole = whole_log_of(kind)
    return whole is not None and whole.is_gain


def _may_last(kind: str | None) -> bool:
    """Tell whether a kind shows as well as its own size does, however the aircraft moves."""
    whole = whole_log_of(kind)
    return how_of(kind) == "sign" or kind == NOISE or (whole is not None and not whole.of_motion)


def _unless_unlike(sensor: str, span: SensorSpan, alarmed: Sequence[Claim]) -> Claim:
    """Return what the engine claims; not a wrong gain where a residual rose that no gain of the sensor explains."""
    if span.judgement is None or not _needs_motion(span.judgement.kind):
        return sensor, span
    unlike = [
        other
        for name, other in alarmed
        if name == sensor and other.state is State.NOT_JUDGED and abs(other.start_s - span.start_s) < _SOON_S
    ]
    return sensor, replace(span, state=State.NOT_JUDGED, reason=unlike[0].reason) if unlike else span


def _as_one(own: Sequence[Claim], alarmed: Sequence[Claim]) -> list[Claim]:
    """Return claims of engine and alarms; of one failure the alarm says how and since when, the engine until when."""
    found = list(alarmed)
    for sensor, span in own:
        same = [place for place, (name, other) in enumerate(found) if name == sensor and _is_same(span, other)]
        if not same:
            found.append((sensor, span))
        for place in same[:1]:
            other = found[place][1]
            stands = span.judgement is not None and span.judgement.kind == FROZEN  # since when, readings tell exactly
            start_s = span.start_s if stands else other.start_s
            found[place] = sensor, replace(other, start_s=start_s, end_s=max(span.end_s, start_s))
    return found


def _is_same(span: SensorSpan, other: SensorSpan) -> bool:
    both = span.state is other.state is State.FAILED
    return both and span.meets(other.start_s, other.end_s) and abs(span.start_s - other.start_s) < _SOON_S


def _beside_engine(evidence: LogEvidence, claims: Sequence[Claim]) -> Iterator[Claim]:
    """Give claims of alarms; nobody is named against the engine, which has seen the whole log."""
    judged = evidence.judged
    if judged is None:
        yield from claims
        return
    is_accusing = any(span.state is State.FAILED and sensor in JUDGED for sensor, span in claims)
    changed = _hindsight(judged, claims).changes if is_accusing else ()
    for sensor, span in claims:
        is_named = span.state is State.FAILED and sensor in JUDGED
        reason = _at_odds(judged, sensor, span, changed) if is_named else ""
        yield sensor, replace(span, state=State.NOT_JUDGED, reason=reason) if reason else span


def _at_odds(judged: Judged, sensor: str, span: SensorSpan, changed: Sequence[LevelChange]) -> str:
    """Say why an alarm doesn't name a sensor: the whole log names another, or shows nothing of what it says.

    An attitude that follows the gyros is bent by whichever failed: there nobody is named while another parts from it.
    One of its own that leans further and further tells wrong turns about the other axes.
    """
    meeting = {name for name, other in judged.accused if span.meets(other.start_s, other.end_s)}
    if sensor in meeting:
        return ""
    others = sorted(meeting) or sorted({GYROS[each.axis] for each in changed} - {sensor})
    bending = {*meeting, *parting(changed)} - {sensor}
    kind = None if span.judgement is None else span.judgement.kind
    lasts = sensor in GYROS and _may_last(kind) and span.duration_s >= _LASTS_S
    if not (others or lasts):
        return ""
    if not shows(judged.flight.blocks, sensor, failure_of(span)):
        told = f"; what parts from the attitude is {', '.join(others)}" if others else ""
        return f"an alarm names {sensor}, of which the whole log shows no such error{told}"
    if judged.flight.is_driven and bending:
        return f"an alarm names {sensor}, but {' and '.join(sorted(bending))} may bend the attitude"
    leans = [] if judged.flight.is_driven else sorted({*leaning(changed, span.end_s)} - {sensor})
    return f"an alarm names {sensor}, but the attitude leans further and further about {leans[0]}" if leans else ""


def _joint(sensor: str, span: SensorSpan, claims: Sequence[Claim]) -> SensorSpan:
    """Return a failure as a suspicion where another sensor of its residual fails at the same time."""
    if span.state is not State.FAILED or _is_missing(span):
        return span
    others = [
        other
        for other, its in claims
        if other != sensor
        and its.state is State.FAILED
        and not _is_missing(its)
        and span.meets(its.start_s, its.end_s)
        and _share_a_residual(sensor, other)
    ]
    if not others:
        return span
    suspects = tuple(dict.fromkeys([sensor, *others]))
    return replace(span, state=State.SUSPECTED, suspects=suspects, reason="they fail together, and share a residual")


def _is_missing(span: SensorSpan) -> bool:
    """Tell whether a sensor fails by having no samples, which no other sensor's fault looks like."""
    return span.judgement is not None and span.judgement.kind == Dropout.kind


def _share_a_residual(sensor: str, other: str) -> bool:
    """Tell whether a residual rests on both: an angle enters those of all gyros and angles, a gyro its own alone."""
    return {sensor, other} <= {*JUDGED} and bool({sensor, other} & {*ATTITUDE})


def _alarmed(evidence: LogEvidence, span_s: Span) -> Iterator[Claim]:
    """Give what alarms claim; a failure without an end is over where the sensor reads again as it did before."""
    for alarm in evidence.alarms:
        concerned = _concerned(evidence, alarm)
        for sensor, span in of_alarm(alarm, span_s[1], concerned, evidence.watched_imu, evidence.excursions):
            agrees_s = None
            is_open = sensor in JUDGED and span.state is State.FAILED and alarm.ended_s is None
            if evidence.judged is not None and is_open:
                agrees_s = agrees_from_s(evidence.judged.flight.blocks, sensor, failure_of(span))
            span = span if agrees_s is None else replace(span, end_s=agrees_s)
            yield sensor, _dated_by_engine(evidence, alarm, sensor, span)


def _dated_by_engine(evidence: LogEvidence, alarm: Alarm, sensor: str, span: SensorSpan) -> SensorSpan:
    """Return what an alarm claims, as the engine dates it where that is when it was raised and its own fit long before.

    Behind an estimator a bias looks like a drift from half a minute before; the engine has the estimator's answer.
    """
    if span.state is not State.FAILED or evidence.judged is None or alarm.time_s - span.start_s < _SOON_S:
        return span
    for name, other in evidence.judged.accused:
        if (name, other.state) == (sensor, State.FAILED) and abs(other.start_s - alarm.time_s) < _SOON_S:
            return replace(span, start_s=other.start_s, judgement=other.judgement)
    return span


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


def shifted_gyros(evidence: LogEvidence) -> dict[str, list[float]]:
    """Return when gyros part from the attitude that nobody has named, by gyro."""
    shifted_s: dict[str, list[float]] = {}
    if evidence.judged is not None:
        for change in _hindsight(evidence.judged, _accused(evidence, evidence.log.span_s)).changes:
            shifted_s.setdefault(GYROS[change.axis], []).append(change.time_s)
    return shifted_s


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

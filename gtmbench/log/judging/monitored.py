"""What a monitor says of a log: it listens to all that it wasn't learnt on, then what others contradict is doubted.

What looks at the log as a whole comes after listening: the engine, by gyros, attitude and further IMUs, and what the
residuals explain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import takewhile
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.bank_detector import AutoDetector
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import Regime
from gtmbench.detectors.predicting import predicts
from gtmbench.detectors.protocol import Monitor, Watch, is_ready
from gtmbench.engine.imus.beside import with_imus
from gtmbench.engine.judged import Judged, judged
from gtmbench.jobs.progress import Progress
from gtmbench.log.judging.claims import began_s, excused_s
from gtmbench.log.judging.imus import SAME, is_contradicted
from gtmbench.log.learning.crashes import crash_of
from gtmbench.log.learning.learnt_monitor import Learnt
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.log.opening.records import without
from gtmbench.log.self_check.refusal import WATCHED, Part, SelfCheck, check_watched, check_wiring
from gtmbench.values.channels import ATTITUDE, axis_of
from gtmbench.values.record import Record, Span

if TYPE_CHECKING:
    from gtmbench.detectors.installation.installation import Installation
    from gtmbench.engine.course.judged import CourseJudged

LOST = "its messages are missing: the link lost them, or it stopped"
BENT = "a gyro that drives the attitude may have bent it, and the monitor was calibrated for one of its own"
ALONE = "gyros alone tell no fault from a new motion: an attitude beside them would"
_WIDE = 3.0  # spread of a residual beyond which little shows
_MUCH = 0.1  # of the time
_SOON_S = 15.0  # within which two tell of one fault
_OTHER_NOISE = 3.0  # times the calibrated level, or a part of it, that is worth a word


@dataclass(frozen=True, kw_only=True, eq=False)
class Monitored:
    """What a monitor said."""

    learnt: Learnt
    # one a stretch that was watched, in time; none where the check stops
    watches: tuple[Watch, ...] = field(default=(), repr=False)
    excursions: tuple[Excursion, ...] = field(default=(), repr=False)  # the stretches in which nothing can be told
    check: SelfCheck = field(repr=False)
    # lag, clocks, scales and axes of gyros and attitude that were undone before the monitor heard them
    installation: Installation | None = None
    # what the engine says of gyros and attitude over the whole log; None where the log hasn't both, is misread, or
    # nothing rests on them
    judged: Judged | None = field(default=None, repr=False)
    # what the engine says of the sensors that no gyro enters, by the attitude where nobody broke it
    course: CourseJudged | None = field(default=None, repr=False)
    findings: tuple[str, ...]  # why it can't be told, where it can't; what limits what was said, where it can


def first_alarms(watches: Sequence[Watch], judged: Judged | None) -> tuple[Alarm, ...]:
    """Return the first alarm of each fault that is said of a log, in order of time."""
    told = [alarm for watch in watches for alarm in watch.faults]
    told += beyond(told, () if judged is None else judged.alarms)
    return tuple(sorted(told, key=lambda alarm: alarm.time_s))


def beyond(told: Sequence[Alarm], others: Sequence[Alarm]) -> tuple[Alarm, ...]:
    """Return those of other alarms whose sensor isn't named yet at about that time."""
    return tuple(each for each in others if not any(_is_same(each, alarm) for alarm in told))


def _is_same(each: Alarm, alarm: Alarm) -> bool:
    until_s = np.inf if alarm.ended_s is None else alarm.ended_s
    named = () if alarm.last is None else alarm.last.failed
    return each.sensor in named and alarm.onset_s - _SOON_S <= each.time_s <= until_s


def listened(learnt: Learnt, progress: Progress) -> Monitored:
    """Let a monitor listen to every segment of a log but the spans that it was learnt on.

    Of a log that it wasn't learnt on, the wiring is checked first, and the installation undone.
    """
    said = Monitored(learnt=learnt, check=learnt.check, findings=learnt.findings)
    monitor = learnt.monitor
    if learnt.check.stops or not is_ready(monitor):
        return said
    rest = learnt.opened.own.part(_left_s(learnt))
    if not learnt.identified_s:
        from gtmbench.detectors.installation.learner import corrected, expected_of, has_motion

        if rest.records and has_motion(monitor):
            parts, installation = corrected(rest.records, expected_of(monitor))
            rest = replace(rest, records=parts, motion=parts if rest.motion else ())
            said = replace(said, installation=installation)
        wired = check_wiring(monitor, [rest], WATCHED)
        said = replace(said, check=replace(wired, explained=learnt.check.explained))
    said = replace(said, excursions=excursions_of(monitor, rest))
    if said.check.stops:
        return said
    return replace(said, watches=tuple(_watches(monitor, rest.records, said.excursions, learnt.before, progress)))


def doubted(said: Monitored, progress: Progress) -> Monitored:
    """Judge gyros and attitude over the whole log; doubt what other IMUs contradict; say what limits what was said."""
    learnt, monitor = said.learnt, said.learnt.monitor
    whole = _judged(said)
    course = course_of(said, whole)
    said = replace(said, judged=None if basis_of(monitor).is_whole else whole, course=course)
    if said.check.stops or not is_ready(monitor):
        return replace(said, findings=(*map(str, said.check.stops), *_installed(said.installation), *said.findings))
    log, watches = learnt.opened.log, said.watches
    watched_s = round(sum(len(watch.record) for watch in watches) * log.sample_period_s)
    progress("compare", watched_s, watched_s)
    watches = _contradicted_doubted(watches, whole)
    watches = _of_twin_doubted(watches, (learnt.opened.judged, whole))
    if learnt.opened.bends:
        watches = _bent_doubted(watches)
    if log.is_received:
        watches = _missing_disbelieved(watches)
    if isinstance(learnt.opened.asked.watcher, AutoDetector) and learnt.opened.attitude is None:
        watches = _gyros_alone_doubted(watches)
    check = check_watched(said.check, monitor, watches, log, _left_s(learnt), said.excursions)
    findings = (*map(str, check.doubts), *_limits(watches), *_installed(said.installation), *said.findings)
    return replace(said, watches=watches, check=check, findings=findings)


def _changed(watches: Sequence[Watch], change: Callable[[Alarm], Alarm]) -> tuple[Watch, ...]:
    """Return watches with each alarm changed."""
    return tuple(replace(watch, alarms=tuple(map(change, watch.alarms))) for watch in watches)


def with_doubt(alarm: Alarm, doubt: str) -> Alarm:
    """Return an alarm that may be no fault after all, and why."""
    judged = alarm.judgements[-1].naming_nobody(doubt)
    return replace(alarm, judgements=(*alarm.judgements, judged), ended_s=None, end_known_s=None)


def _contradicted_doubted(watches: Sequence[Watch], whole: Judged | None) -> tuple[Watch, ...]:
    """Return watches that doubt of a gyro what the other IMUs contradict."""
    return _changed(watches, lambda each: with_doubt(each, SAME) if is_contradicted(each, whole) else each)


def _of_twin_doubted(watches: Sequence[Watch], engines: Sequence[Judged | None]) -> tuple[Watch, ...]:
    """Return watches that doubt a gyro where the engine finds its angle likelier, or the other way round.

    `engines`: what it says of all that was flown, and without what a monitor excuses, such as a touchdown: then it may
    see too little.
    """
    found = [finding for engine in engines if engine is not None for finding in engine.found]

    def doubtful(alarm: Alarm) -> Alarm:
        failed = () if alarm.last is None or not alarm.accuses else alarm.last.failed
        start_s, until_s = began_s(alarm), np.inf if alarm.ended_s is None else alarm.ended_s
        there = [each.suspects for each in found if each.onset_s < until_s and each.end_s > start_s]
        first = {suspects[0] for suspects in there}
        twins = [
            name
            for gyro in failed
            if gyro not in first
            for name in axis_of(gyro)
            if any(name in takewhile(gyro.__ne__, suspects) for suspects in there)
        ]
        return with_doubt(alarm, f"over the whole flight {' and '.join(twins)} explains it") if twins else alarm

    return _changed(watches, doubtful)


def are_bent(faults: Sequence[Alarm]) -> list[bool]:
    """Tell of all faults of a flight so far, by their first alarms, which accuse a sensor but may not be believed.

    An estimator turns a gyro's error into all three angles. A monitor that was calibrated for an attitude of its own
    takes that for faults of other sensors: so the first fault is believed only, and of an angle none.

    >>> first, second = (Alarm(number=k, time_s=10.0 + k, onset_s=10.0 + k, source="pq"[k]) for k in (0, 1))
    >>> are_bent([first, second])
    [False, True]
    """
    left = [alarm for alarm in faults if not alarm.has_passed and alarm.test != MISSING]
    first_s = min((alarm.time_s for alarm in left), default=0.0)
    return [
        alarm.accuses and alarm.test != MISSING and (alarm.time_s > first_s or alarm.sensor in ATTITUDE)
        for alarm in faults
    ]


def _bent_doubted(watches: Sequence[Watch]) -> tuple[Watch, ...]:
    """Return watches that doubt what a bent attitude may have raised, as `are_bent` tells."""
    told = [alarm for watch in watches for alarm in watch.faults]
    bent = {id(alarm) for alarm, is_bent in zip(told, are_bent(told), strict=True) if is_bent and alarm.judgements}
    return _changed(watches, lambda each: with_doubt(each, BENT) if id(each) in bent else each)


def _gyros_alone_doubted(watches: Sequence[Watch]) -> tuple[Watch, ...]:
    """Return watches of gyros alone: operators hold for the motion that they were learnt from, so nobody is accused."""
    return _changed(watches, lambda each: with_doubt(each, ALONE) if each.accuses and each.test != MISSING else each)


def _missing_disbelieved(watches: Sequence[Watch]) -> tuple[Watch, ...]:
    """Return watches of a log that a radio received: what is missing may be lost."""
    return _changed(watches, lambda each: each.disbelieved(LOST) if each.test == MISSING else each)


def _judged(said: Monitored) -> Judged | None:
    """Return what the engine says; None where there is nothing to judge, or the log isn't what it is taken for."""
    opened = said.learnt.opened
    if opened.flight is None or said.check.causes:
        return None
    flight = opened.flight
    if said.installation is not None and said.installation.said and said.watches:
        records = [watch.record for watch in said.watches]
        again = flight_of_records(records, is_driven=flight.is_driven, is_assumed=flight.is_assumed)
        flight = with_imus(again, opened.imus)
    crash = crash_of(said.watches, said.excursions)
    after = [(crash.start_s, np.inf)] if crash else []
    flown = flight.without([*excused_s(said.excursions), *after])
    return opened.judged if opened.judged is not None and flown is opened.flight else judged(flown)


def course_of(said: Monitored, whole: Judged | None) -> CourseJudged | None:
    """Return what the engine says of the log's other sensors; None where no attitude tells how they turn."""
    readings = said.learnt.opened.readings
    if whole is None or not readings or said.check.stops:
        return None
    from gtmbench.engine.course.judged import course_beside  # many logs have no other sensor

    return course_beside(whole, readings)


def _left_s(learnt: Learnt) -> list[Span]:
    """Return the spans of a log that its monitor wasn't learnt on.

    Where it chose itself what is healthy, it hears nothing before: there the log stands, or lacks a heading.
    """
    is_chosen = not learnt.opened.asked.says_healthy
    first_s = learnt.identified_s[0][0] if is_chosen and learnt.identified_s else -np.inf
    left = without(learnt.opened.log, learnt.identified_s)
    return [(each.start_s, each.end_s) for each in left if each.end_s > first_s]


def _watches(
    monitor: Monitor,
    parts: Sequence[Record],
    excursions: Sequence[Excursion],
    before: Record | None,
    progress: Progress,
) -> list[Watch]:
    done_s, total_s = 0.0, sum(len(part) * part.sample_period_s for part in parts)
    watches: list[Watch] = []
    for part in parts:
        tell = _seconds(progress, done_s, total_s, part.sample_period_s)
        tell("watch", 0, len(part))
        if predicts(monitor):
            watches.append(monitor.watch(part, outside=excursions, before=before, progress=tell))
        else:
            watches.append(monitor.watch(part))
        done_s += len(part) * part.sample_period_s
    progress("watched", round(total_s), round(total_s))
    return watches


def _seconds(progress: Progress, before_s: float, total_s: float, period_s: float) -> Progress:
    """Return a function to be told rows of a part of a log; `progress` hears seconds of all that is watched."""

    def tell(step: str, rows: int, _of: int) -> None:
        progress(step, round(before_s + rows * period_s), round(total_s))

    return tell


def excursions_of(monitor: Monitor, left: Part) -> tuple[Excursion, ...]:
    """Return the stretches that are beyond what a bank was identified on, and those that are watched, in time."""
    if not predicts(monitor):
        return ()
    regime = Regime.from_provenance(monitor.provenance)
    return tuple(excursion for record in left.motion for excursion in regime.excursions(record, left.log.events))


def _installed(installation: Installation | None) -> tuple[str, ...]:
    if installation is None or not installation.said:
        return ()
    said = ", ".join(installation.said)
    return (
        f"{said}: taken for how the sensors are installed, and undone; a fault from the first sample on is part of it",
    )


def _other_noise(watches: Sequence[Watch]) -> list[str]:
    """Say whose noise is far from what the monitor was calibrated for."""
    far: dict[str, float] = {}
    for watch in watches:
        for name, level in watch.noise_levels.items():
            if not 1.0 / _OTHER_NOISE < level < _OTHER_NOISE:
                far.setdefault(name, level)
    if not far:
        return []
    levels = ", ".join(f"{name} {level:.2g}" for name, level in far.items())
    return [
        f"the noise is another one than calibrated for ({levels} times as strong); it is judged as it was learnt here"
    ]


def _limits(watches: Sequence[Watch]) -> list[str]:
    """Say why nothing was seen, or what limits what was."""
    if not watches:
        return ["nothing of the log is left to watch"]
    reasons = [
        f"the score of {name} stood above its threshold from {watch.record.start_s:.2f} s on and never came down, so "
        "it has no verdict: a fault from the beginning, or sensors that it wasn't calibrated for"
        for watch in watches
        for name, score in watch.scores.items()
        if score.is_stuck_above
    ]
    if not reasons and not any(watch.armed_hours for watch in watches):
        return ["what is left to watch is too short"]
    reasons += _other_noise(watches)
    wide = [np.logical_or.reduce([of > _WIDE for of in watch.widening.values()]) for watch in watches if watch.widening]
    share = float(np.concatenate(wide).mean()) if wide else 0.0
    if share >= _MUCH:
        reasons.append(
            f"{100.0 * share:.0f} % of the time the motion was beyond what identification held; faults show less there"
        )
    return reasons

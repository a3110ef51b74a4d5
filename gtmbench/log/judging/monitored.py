"""What a monitor says of a log: it listens to all that it wasn't learnt on, then whom nobody else names is doubted.

What looks at the log as a whole comes after listening: the engine, by gyros, attitude and further IMUs, and what the
residuals explain.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.bank_detector import AutoDetector
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import Regime
from gtmbench.detectors.predicting import predicts
from gtmbench.detectors.protocol import Monitor, Watch, is_ready
from gtmbench.engine.hindsight.cleared_sensors import JUDGED
from gtmbench.engine.imus.beside import with_imus
from gtmbench.engine.judged import Judged, judged
from gtmbench.jobs.progress import Progress
from gtmbench.log.judging.claims import UNHELD, began_s, excused_s
from gtmbench.log.learning.crashes import crash_of
from gtmbench.log.learning.learnt_monitor import Learnt
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.log.opening.records import without
from gtmbench.log.self_check.refusal import WATCHED, Part, SelfCheck, check_watched, check_wiring
from gtmbench.values.record import Record, Span

if TYPE_CHECKING:
    from gtmbench.detectors.installation.installation import Installation
    from gtmbench.engine.course.judged import CourseJudged

LOST = "its messages are missing: the link lost them, or it stopped"
ALONE = "gyros alone tell no fault from a new motion: an attitude beside them would"
_SOON_S = 15.0  # before its onset, what tells of the same fault may have been raised
_WIDE = 3.0  # spread of a residual beyond which little shows
_MUCH = 0.1  # of the time
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
    """Judge gyros and attitude over the whole log; doubt whom that doesn't name; say what limits what was said."""
    learnt, monitor = said.learnt, said.learnt.monitor
    whole = _judged(said)
    course = course_of(said, whole)
    said = replace(said, judged=None if basis_of(monitor).is_whole else whole, course=course)
    if said.check.stops or not is_ready(monitor):
        return replace(said, findings=(*map(str, said.check.stops), *_installed(said.installation), *said.findings))
    log, watches = learnt.opened.log, said.watches
    watched_s = round(sum(len(watch.record) for watch in watches) * log.sample_period_s)
    progress("compare", watched_s, watched_s)
    if whole is not None:
        watches = _unheld_doubted(watches, whole)
    if log.is_received:
        watches = _missing_disbelieved(watches)
    if isinstance(learnt.opened.asked.watcher, AutoDetector) and learnt.opened.attitude is None:
        watches = _gyros_alone_doubted(watches)
    accused = () if whole is None else [sensor for sensor, _ in whole.accused]
    check = check_watched(said.check, monitor, watches, log, _left_s(learnt), said.excursions, accused)
    findings = (*map(str, check.doubts), *_limits(watches), *_installed(said.installation), *said.findings)
    return replace(said, watches=watches, check=check, findings=findings)


def _changed(watches: Sequence[Watch], change: Callable[[Alarm], Alarm]) -> tuple[Watch, ...]:
    """Return watches with each alarm changed."""
    return tuple(replace(watch, alarms=tuple(map(change, watch.alarms))) for watch in watches)


def _unheld_doubted(watches: Sequence[Watch], engine: Judged) -> tuple[Watch, ...]:
    """Return watches that doubt whomever the engine, which has seen the whole log, doesn't name: it alone does."""
    return _changed(watches, lambda each: each if is_held(each, engine) else each.disbelieved(UNHELD))


def is_held(alarm: Alarm, engine: Judged) -> bool:
    """Tell whether the engine names the gyros and angles that an alarm does, while that lasts, or can't tell yet.

    Of what an alarm says of other sensors, or of missing samples, the engine knows nothing.
    """
    if alarm.test == MISSING or alarm.last is None or not {*JUDGED} & {*alarm.candidates}:
        return True
    until_s = np.inf if alarm.ended_s is None else alarm.ended_s
    named = [engine.holds(name, began_s(alarm), until_s) for name in alarm.last.failed if name in JUDGED]
    return bool(named) and all(named)


def _gyros_alone_doubted(watches: Sequence[Watch]) -> tuple[Watch, ...]:
    """Return watches of gyros alone: operators hold for the motion that they were learnt from, so nobody is accused."""
    return _changed(watches, lambda each: each.disbelieved(ALONE) if each.accuses and each.test != MISSING else each)


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

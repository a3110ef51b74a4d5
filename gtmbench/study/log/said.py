"""What a monitor says of a log: it listens to all that it wasn't learnt on, then what hangs on chance is doubted.

What looks at the log as a whole comes after listening: whether an alarm is raised again where watching begins
elsewhere, whether several IMUs agree, and what the residuals explain.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.basis import basis_of
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.installation import Installation
from gtmbench.detectors.installing import corrected, expected_of, has_motion
from gtmbench.detectors.monitor.regime import Regime
from gtmbench.detectors.predicting import predicts
from gtmbench.detectors.protocol import Monitor, Watch, is_ready
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.mapping import NONE
from gtmbench.jobs.progress import Progress
from gtmbench.study.log.bent import BENT, are_bent, but_behind, doubt_behind
from gtmbench.study.log.contacts import but_after_crashes, crash_of
from gtmbench.study.log.corrections import Corrections, corrections
from gtmbench.study.log.field_witnesses import Witness, field_witnesses, settled
from gtmbench.study.log.force_witnesses import force_witnesses, found_by_forces
from gtmbench.study.log.frozen import frozen_gyros
from gtmbench.study.log.gains import Gains, gains
from gtmbench.study.log.imu_comparison import Comparison, beside, compare, further, of_watched, with_doubt
from gtmbench.study.log.learnt import Learnt
from gtmbench.study.log.mean_errors import error_seconds
from gtmbench.study.log.records import first_part, outside, whole_s, within, without
from gtmbench.study.log.rests import found_at_rest, rests_of, settled_at_rest
from gtmbench.study.log.self_check.outcome import WATCHED, Doubt, Part, SelfCheck, check_watched, check_wiring
from gtmbench.study.log.slow_means import SlowMeans, beyond, but_beside, mean_error_deg_s, slow_means
from gtmbench.study.log.standing import but_of_others, standing_gyros
from gtmbench.study.log.starts import steady
from gtmbench.study.log.vertical import contradiction
from gtmbench.values.channels import GYROS
from gtmbench.values.record import Record, Span

_WIDE = 3.0  # spread of a residual beyond which little shows
_MUCH = 0.1  # of the time
_BEGINNING_S = 30.0  # how IMUs differ, where nothing could be learnt
_OTHER_NOISE = 3.0  # times the calibrated level, or a part of it, that is worth a word


@dataclass(frozen=True, kw_only=True, eq=False)
class Said:
    """What a monitor said.

    Attributes
    ----------
    learnt : Learnt
    watches : tuple of Watch
        One a stretch that was watched, in time; none where the check stops.
    excursions : tuple of Excursion
        The stretches in which nothing can be told.
    check : SelfCheck
    installation : Installation or None
        Lag, clocks, scales and axes of gyros and attitude that were undone before the monitor heard them.
    comparison : Comparison or None
        What several IMUs say of each other.
    means : SlowMeans or None
        What gyros and attitude say of each other over tens of seconds; None where the monitor wasn't learnt on this
        log, or the log hasn't both.
    gains : Gains or None
        How far gyros and attitude turn over tens of seconds; None as `means` is.
    corrections : Corrections or None
        What references take back of turns; None as `means` is, and where the gyros don't drive the attitude.
    witnesses : tuple of Witness
        The magnetometers and accelerometers that were asked where a gyro or its angle was left open.
    standing : tuple of Alarm
        Gyros that read a turn while the aircraft stands.
    frozen : tuple of Alarm
        Gyros that stand still while others move; none where nothing of the log was learnt from.
    findings : tuple of str
        Why it can't be told, where it can't; what limits what was said, where it can.
    """

    learnt: Learnt
    watches: tuple[Watch, ...] = field(default=(), repr=False)
    excursions: tuple[Excursion, ...] = field(default=(), repr=False)
    check: SelfCheck = field(repr=False)
    installation: Installation | None = None
    comparison: Comparison | None = field(default=None, repr=False)
    means: SlowMeans | None = field(default=None, repr=False)
    gains: Gains | None = field(default=None, repr=False)
    corrections: Corrections | None = field(default=None, repr=False)
    witnesses: tuple[Witness, ...] = field(default=(), repr=False)
    standing: tuple[Alarm, ...] = field(default=(), repr=False)
    frozen: tuple[Alarm, ...] = field(default=(), repr=False)
    findings: tuple[str, ...]


def first_alarms(
    watches: Sequence[Watch],
    standing: Sequence[Alarm],
    comparison: Comparison | None,
    frozen: Sequence[Alarm],
    slow: Sequence[SlowMeans | Gains | Corrections | None],
) -> tuple[Alarm, ...]:
    """Return the first alarm of each fault that is said of a log, in order of time."""
    told = [alarm for watch in watches for alarm in watch.faults]
    told += [*standing, *further(told, comparison)]
    told += beyond(told, frozen)
    for each in slow:
        told += beyond(told, () if each is None else each.alarms)
    return tuple(sorted(told, key=lambda alarm: alarm.time_s))


def listened(learnt: Learnt, progress: Progress) -> Said:
    """Let a monitor listen to every segment of a log but the spans that it was learnt on.

    Of a log that it wasn't learnt on, the wiring is checked first, and the installation undone.
    """
    said = Said(learnt=learnt, check=learnt.check, findings=learnt.findings)
    monitor = learnt.monitor
    if learnt.check.stops or not is_ready(monitor):
        return said
    rest = learnt.opened.own.part(_left_s(learnt))
    if not learnt.identified_s:
        if rest.records and has_motion(monitor):
            parts, installation = corrected(rest.records, expected_of(monitor))
            rest = replace(rest, records=parts, motion=parts if rest.motion else ())
            said = replace(said, installation=installation)
        wired = check_wiring(monitor, [rest], WATCHED)
        said = replace(said, check=replace(wired, explained=learnt.check.explained))
    said = replace(said, excursions=_excursions(monitor, rest))
    if said.check.stops:
        return said
    return replace(said, watches=tuple(_watches(monitor, rest.records, said.excursions, learnt.before, progress)))


def doubted(said: Said, progress: Progress) -> Said:
    """Doubt what isn't said again elsewhere, and what other IMUs contradict; say what limits what was said."""
    learnt, monitor = said.learnt, said.learnt.monitor
    said = _beside_accelerometers(said)
    if said.check.stops or not is_ready(monitor):
        said = replace(said, comparison=_compared(said, [_beginning(learnt.opened.log)]))
        return replace(said, findings=(*map(str, said.check.stops), *_installed(said.installation), *said.findings))
    log, before = learnt.opened.log, learnt.before
    watches = [steady(monitor, watch, before) for watch in said.watches] if predicts(monitor) else list(said.watches)
    watched_s = round(sum(len(watch.record) for watch in watches) * log.sample_period_s)
    progress("compare", watched_s, watched_s)
    comparison = _compared(said, learnt.identified_s or (first_part(log),))
    watches = beside(watches, comparison)
    watches = [_but_small(watch, learnt) for watch in watches]
    if learnt.opened.bends:
        watches = _but_bent(watches)
    crash = crash_of(watches, said.excursions)
    check = check_watched(said.check, monitor, watches, log, _left_s(learnt), said.excursions, crash)
    findings = (*map(str, check.doubts), *_limits(watches), *_installed(said.installation), *said.findings)
    explained = tuple(but_of_others(watch, said.standing) for watch in watches)
    means, turns, pulls = _slow(said)

    def told(slow: Sequence[Alarm]) -> tuple[Alarm, ...]:
        beside = but_beside(slow, [alarm for watch in explained for alarm in watch.faults])
        return but_after_crashes(beside, explained, said.excursions)

    return _settled(
        replace(
            said,
            watches=explained,
            check=check,
            comparison=comparison,
            means=means and replace(means, alarms=told(means.alarms)),
            gains=turns and replace(turns, alarms=told(turns.alarms)),
            corrections=pulls and replace(pulls, alarms=_of_imu(told(pulls.alarms), comparison)),
            frozen=_of_imu(_frozen(learnt), comparison),
            findings=findings,
        )
    )


def _of_imu(alarms: Sequence[Alarm], comparison: Comparison | None) -> tuple[Alarm, ...]:
    return tuple(of_watched(alarm, comparison) for alarm in alarms)


def _compared(said: Said, healthy: Sequence[Span]) -> Comparison | None:
    """Return what several IMUs say of each other; None where there is one, or too little to compare."""
    opened = said.learnt.opened
    if opened.imus is None:
        return None
    return compare(opened.log, opened.imus, healthy=healthy, excursions=said.excursions)


def _beginning(log: FlightLog) -> Span:
    """Return the log's first seconds: how its IMUs differ, where nothing was learnt."""
    start_s, _ = whole_s(log)
    return start_s, start_s + _BEGINNING_S


def _beside_accelerometers(said: Said) -> Said:
    """Return what is said with what accelerometers contradict, in all of a log; as it is where the log is misread."""
    motion = said.learnt.opened.own.motion
    if motion is None or said.check.causes:
        return said
    wrong = contradiction(motion.segments)
    doubts = (*said.check.doubts, *([Doubt(text=wrong)] if wrong else []))
    return replace(said, standing=standing_gyros(motion.segments), check=replace(said.check, doubts=doubts))


def _slow(said: Said) -> tuple[SlowMeans | None, Gains | None, Corrections | None]:
    """Return what gyros and attitude of a log say of each other over tens of seconds, where it was learnt from."""
    learnt = said.learnt
    opened, motion = learnt.opened, learnt.opened.own.motion
    if not (learnt.identified_s and motion is not None and basis_of(learnt.monitor).kinematic):
        return None, None, None
    heading = () if f"psi={NONE}" in opened.asked.mapping else ("psi",)
    if not {*GYROS, "phi", "theta", *heading} <= set(learnt.monitor.channels):  # what it doesn't read, it doesn't doubt
        return None, None, None
    healthy = _healthy_spans(learnt)
    seconds = error_seconds(motion.segments, motion.segments[0].start_s, said.excursions)
    means = slow_means(
        motion.segments,
        healthy=healthy,
        excursions=said.excursions,
        is_driven=opened.is_driven,
        least_deg_s=opened.asked.least_error_deg_s,
        seconds=seconds,
    )
    turns = gains(
        motion.segments,
        healthy=healthy,
        excursions=said.excursions,
        is_driven=opened.is_driven,
        names=opened.imus is None,
    )
    pulls = None
    if opened.is_driven:
        watched = _left_s(learnt)
        pulls = corrections(
            motion.segments,
            healthy=healthy,
            watched=watched,
            excursions=said.excursions,
            is_alone=opened.imus is None,
            seconds=seconds,
        )
    return means, turns, pulls


def _frozen(learnt: Learnt) -> tuple[Alarm, ...]:
    """Return an alarm of each gyro that stands still while others move, where something of the log was learnt from."""
    return frozen_gyros(learnt.opened.log.segments, _healthy_spans(learnt))


def _healthy_spans(learnt: Learnt) -> list[Span]:
    return [(each.start_s, each.end_s) for each in healthy_of(learnt, learnt.opened.log)]


def healthy_of(learnt: Learnt, log: FlightLog) -> list[Record]:
    """Return the stretches of a log that its monitor was learnt on."""
    left_out = [each.span for each in learnt.left_out if each.log == learnt.opened.log.path]
    return outside(within(log, learnt.identified_s), left_out)


def _settled(said: Said) -> Said:
    """Ask the log's magnetometers, accelerometers and gyros at rest where a gyro or its angle is left open."""
    learnt, means = said.learnt, said.means
    motion = learnt.opened.own.motion
    if means is None or motion is None:  # r and psi aren't compared
        return said
    healthy = healthy_of(learnt, motion)
    fields = field_witnesses(learnt.opened.magnetometers, motion.segments, healthy)
    forces = force_witnesses(learnt.opened.sensors, motion.segments, healthy)
    witnesses: tuple[Witness, ...] = (*fields, *forces)
    crash, last_s = crash_of(said.watches, said.excursions), learnt.identified_s[-1][1]
    stands = rests_of(motion.segments, learnt.opened.sensors, np.inf if crash is None else crash.start_s)

    def asked(alarm: Alarm) -> Alarm:
        return settled_at_rest(settled(alarm, witnesses, means), stands, means, last_s)

    watches = [replace(watch, alarms=tuple(map(asked, watch.alarms))) for watch in said.watches]
    told = replace(means, alarms=tuple(map(asked, means.alarms)))
    others = first_alarms(watches, said.standing, said.comparison, said.frozen, (told, said.gains, said.corrections))
    found = found_by_forces(forces, told, others, last_s)
    found += found_at_rest(stands, told, (*others, *found), last_s)
    found = but_after_crashes(found, watches, said.excursions)
    told = replace(told, alarms=(*told.alarms, *found))
    if learnt.opened.is_driven:
        watches = [_but_behind(watch, told.alarms) for watch in watches]
    named = first_alarms(watches, said.standing, said.comparison, said.frozen, (told, said.gains, said.corrections))
    pulls = said.corrections and replace(said.corrections, alarms=but_behind(said.corrections.alarms, named))
    turns = said.gains
    if turns is not None and learnt.opened.is_driven:
        turns = replace(turns, alarms=but_behind(turns.alarms, named))
    return replace(said, watches=tuple(watches), means=told, gains=turns, corrections=pulls, witnesses=witnesses)


def _but_behind(watch: Watch, named: Sequence[Alarm]) -> Watch:
    """Return a watch that doubts whom it accuses after means over tens of seconds named another gyro."""
    doubts = [doubt_behind(alarm, named) for alarm in watch.alarms]
    pairs = zip(watch.alarms, doubts, strict=True)
    return replace(watch, alarms=tuple(with_doubt(alarm, doubt) if doubt else alarm for alarm, doubt in pairs))


def _but_small(watch: Watch, learnt: Learnt) -> Watch:
    """Return a watch whose alarms doubt mean errors that an estimator has of its own, where the gyros drive one."""
    if not learnt.opened.is_driven:
        return watch
    least_deg_s = learnt.opened.asked.least_error_deg_s
    return replace(watch, alarms=tuple(_or_small(alarm, least_deg_s) for alarm in watch.alarms))


def _or_small(alarm: Alarm, least_deg_s: float) -> Alarm:
    last, off_deg_s = alarm.last, mean_error_deg_s(alarm)
    if last is None or off_deg_s is None or off_deg_s >= least_deg_s or not alarm.accuses:
        return alarm
    return with_doubt(alarm, f"a mean error of {off_deg_s:.2g} deg/s, which an estimator's attitude has of its own")


def _but_bent(watches: Sequence[Watch]) -> list[Watch]:
    """Return watches that doubt what a bent attitude may have raised, as `are_bent` tells."""
    told = [alarm for watch in watches for alarm in watch.faults]
    bent = {id(alarm) for alarm, is_bent in zip(told, are_bent(told), strict=True) if is_bent and alarm.judgements}
    return [
        replace(watch, alarms=tuple(with_doubt(each, BENT) if id(each) in bent else each for each in watch.alarms))
        for watch in watches
    ]


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


def _excursions(monitor: Monitor, left: Part) -> tuple[Excursion, ...]:
    """Return the stretches that are beyond what a bank was identified on, and those that are watched, in time."""
    if not predicts(monitor):
        return ()
    regime = Regime.told(monitor.provenance)
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

"""A log that was watched: what the monitor was, what it said of it, and what that comes to."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING

from gtmbench.detectors.alarm import ALARM_COLUMNS, Alarm, rows_of_alarms
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.protocol import Detector, Monitor, Watch, suspects_of
from gtmbench.engine.curves import ErrorCurve
from gtmbench.engine.hindsight.cleared_sensors import JUDGED
from gtmbench.engine.imus.imu import FlightImu
from gtmbench.engine.judged import Judged
from gtmbench.engine.named import WHOLE
from gtmbench.intake.estimator_words import EstimatorWord
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.mapping import NONE
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.log.judging.gps_itself import gps_alarms
from gtmbench.log.judging.learnt_part import SwapCheck
from gtmbench.log.judging.monitored import Monitored, first_alarms
from gtmbench.log.judging.timeline import Certified, LogEvidence, rows_of, timeline_of
from gtmbench.log.learning.undisturbed import LeftOut
from gtmbench.log.self_check.refusal import SelfCheck
from gtmbench.method.driven_attitude import Origin
from gtmbench.values.channels import axis_of
from gtmbench.values.notebook import card
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Record, Span
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import Timeline
from gtmbench.verdict.verdict import LogVerdict, Outcome, verdict_of

if TYPE_CHECKING:
    from gtmbench.detectors.installation.installation import Installation
    from gtmbench.engine.course.judged import CourseJudged
    from gtmbench.history.next_motion import NextMotion
    from gtmbench.history.standing import Standing
    from gtmbench.log.judging.certificate import Certificate


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedLog:
    """The result of a monitor on a log.

    Attributes
    ----------
    log : FlightLog
    monitor : Monitor or Detector
        The given detector, if the self-check stopped it before calibration.
    identified_s : tuple of (start, end)
        The spans of this log that the monitor was identified and calibrated on, in seconds; empty for a ready monitor.
    watches : tuple of Watch
        One a watched stretch, in order of time.
    reasons : tuple of str
        Why it can't tell, or what limits the verdict.
    is_named : bool
        Whether the certificate is to say, too, which faults would have been named.
    check : SelfCheck
        Whether the log is what the monitor expects.
    excursions : tuple of Excursion
        The stretches without a verdict, because the motion is beyond that of identification.
    left_out : tuple of LeftOut
        The parts of the healthy spans, and of other logs, that weren't identified on.
    judged : Judged or None
        The verdict of the engine on gyros and attitude over the whole log; None if the log hasn't both, is misread, or
        the monitor rests on no attitude.
    course : CourseJudged or None
        Which sensors that no gyro enters failed, by the engine, over the whole log.
    sensors : tuple of SensorReadings
        The log's sensors that no gyro enters; none where the log has no heading.
    gps : tuple of Alarm
        What a GPS shows by itself, in time; a doubt says why one may be no fault.
    estimator : tuple of EstimatorWord
        The gyro biases of the log's estimator and its test ratios: reported, never used.
    installation : Installation or None
        Lag, clocks, scales and axes of gyros and attitude that were corrected before the monitor read them; None if it
        was identified on this log, or doesn't read them all.
    attitude : Origin or None
        Whether the attitude was taken for one that the gyros drive, and why; None if the monitor doesn't use one.
    unwatched : mapping of str to str
        Why gyros aren't watched that the log's channels give no relation, or one that doesn't fit.
    is_assumed_healthy : bool
        Whether `identified_s` is the log's first part, taken for healthy because nobody said what is.
    moving : tuple of Record
        The log with gyros and attitude, as the monitor read them; none where it doesn't compare these.
    has_heading : bool
        Whether the log's heading is a sensor's.
    there : tuple of str
        The sensors that the log has.
    out_of_range : tuple of OutOfRange
        The readings of the log that no sensor reads, a channel each.
    watched_imu : str
        The IMU whose gyros p, q and r are; "" where a log has one, or none of its IMUs is.
    swap : SwapCheck or None
        What judges the part that the monitor was identified on, where no relation of gyros and attitude does.
    scope : Scope
        What the verdict is asked.
    airframe, hardware : str
        Whose log it is, by what it says itself, else by its folder; the autopilot's identifier, "" where it has none.
    temperature_c : float
        Its IMU's; NaN where it isn't logged.
    beside : Standing or None
        What it is beside the flights of its airframe before; None where no history was given.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((1500, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> broken = gb.inject(record, gb.Noise(channel="q", onset_s=45.0, deviation=3.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(broken, f"{folder}/flight.csv")
    ...     watched = gb.watch_log(f"{folder}/flight.csv", gb.bank_between(["p"], ["q"]), healthy=[(0.0, 30.0)])
    >>> watched.outcome.name, watched.alarms[0].doubt  # an operator between gyros may not know this motion
    ('UNKNOWN', 'motion or model')
    """

    log: FlightLog
    monitor: Monitor | Detector
    identified_s: tuple[Span, ...]
    watches: tuple[Watch, ...] = field(repr=False)
    reasons: tuple[str, ...]
    is_named: bool = field(default=False, repr=False)
    check: SelfCheck = field(default=SelfCheck(), repr=False)
    excursions: tuple[Excursion, ...] = field(default=(), repr=False)
    left_out: tuple[LeftOut, ...] = ()
    judged: Judged | None = field(default=None, repr=False)
    course: CourseJudged | None = field(default=None, repr=False)
    sensors: tuple[SensorReadings, ...] = field(default=(), repr=False)
    gps: tuple[Alarm, ...] = field(default=(), repr=False)
    estimator: tuple[EstimatorWord, ...] = field(default=(), repr=False)
    installation: Installation | None = field(default=None, repr=False)
    attitude: Origin | None = field(default=None, repr=False)
    unwatched: Mapping[str, str] = field(default_factory=dict, repr=False)
    is_assumed_healthy: bool = False
    moving: tuple[Record, ...] = field(default=(), repr=False)
    has_heading: bool = True
    there: tuple[str, ...] = ()
    out_of_range: tuple[OutOfRange, ...] = ()
    watched_imu: str = ""
    swap: SwapCheck | None = field(default=None, repr=False)
    scope: Scope = field(default=Scope(sensors=()), repr=False)
    airframe: str = ""
    hardware: str = ""
    temperature_c: float = float("nan")
    beside: Standing | None = field(default=None, repr=False)

    def _repr_html_(self) -> str:
        facts = {
            "outcome": self.outcome.name.lower(),
            "watched by": self.monitor.name,
            "watched": f"{3600.0 * self.armed_hours:.1f} s",
            **{f"reason {number}": reason for number, reason in enumerate(self.reasons, 1)},
        }
        return card(f"WatchedLog {self.log.path.name}", facts, columns=ALARM_COLUMNS, rows=rows_of_alarms(self.alarms))

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """The first alarm of each fault, in order of time."""
        return first_alarms(self._all_watches, self.judged)

    @property
    def _all_watches(self) -> tuple[Watch, ...]:
        """Of what was learnt from, too."""
        return (*(() if self.swap is None else self.swap.watches), *self.watches)

    @property
    def raised(self) -> list[tuple[Alarm, Watch]]:
        """The first alarm of each fault that a bank raised, with what it looked at, in order of time."""
        own = [(alarm, watch) for watch in self._all_watches for alarm in watch.faults]
        return sorted(own, key=lambda told: told[0].time_s)

    @property
    def whole_alarms(self) -> tuple[Alarm, ...]:
        """Those of them that only the engine raised, by the whole log."""
        return tuple(alarm for alarm in self.alarms if alarm.test == WHOLE)

    @property
    def of_others(self) -> tuple[Alarm, ...]:
        """The alarms of sensors that no gyro enters: the engine's, and what a GPS shows by itself."""
        return (*(() if self.course is None else self.course.alarms), *self.failed_gps)

    @property
    def curves(self) -> tuple[ErrorCurve, ...]:
        """What shows the engine's findings: relations as they are, and as findings predict them."""
        return tuple(curve for each in (self.judged, self.course) if each is not None for curve in each.curves)

    @property
    def further_imus(self) -> tuple[FlightImu, ...]:
        """The IMUs beside the one that is watched, as the engine compared them; none where the log has one."""
        return () if self.judged is None else self.judged.flight.imus

    @property
    def compared_imus(self) -> list[str]:
        """The names of all IMUs that were compared."""
        return [name for name in (self.watched_imu, *(imu.name for imu in self.further_imus)) if name]

    @property
    def armed_hours(self) -> float:
        """Hours in which an alarm was possible."""
        return sum(watch.armed_hours for watch in self.watches)

    @property
    def stuck_above(self) -> tuple[str, ...]:
        """The test statistics that stayed above their thresholds throughout a stretch, and so give no verdict."""
        scores = [score for watch in self.watches for score in watch.scores.values() if score.is_stuck_above]
        return tuple(dict.fromkeys(score.name for score in scores))

    @property
    def failed_gps(self) -> tuple[Alarm, ...]:
        """What a GPS shows by itself that must be a failure, in time."""
        return tuple(alarm for alarm in self.gps if not alarm.doubt)

    @cached_property
    def timeline(self) -> Timeline:
        """What is known of every sensor, from the log's first sample to its last, as far as it is asked."""
        return self.verdict.timeline

    @cached_property
    def verdict(self) -> LogVerdict:
        """The verdict: what the timeline comes to for the sensors that are asked."""
        return verdict_of(timeline_of(self.evidence), self.scope)

    @cached_property
    def next_motions(self) -> tuple[NextMotion, ...]:
        """What to fly next, so that the sensors are judged which this log leaves open; some tenths of a second."""
        if self.judged is None or self.check.stops or not self.verdict.unjudged:
            return ()
        from gtmbench.history.next_motion import next_motions

        return next_motions(self.judged.flight, self.verdict)

    @property
    def outcome(self) -> Outcome:
        """The verdict's outcome; its value is the exit code."""
        return self.verdict.outcome

    @property
    def _certified(self) -> tuple[Certified, ...]:
        own = Certified(certificate=self.certificate, watches=self.watches)
        if self.swap is None:
            return (own,)
        from gtmbench.log.judging.certificate import certificate_of

        certificate = certificate_of(self.swap.monitor, self.swap.watches)
        return own, Certified(certificate=certificate, watches=self.swap.watches)

    @property
    def evidence(self) -> LogEvidence:
        """All that its timeline is laid out of."""
        return LogEvidence(
            log=self.log,
            sensors=self.there or self.log.channels,
            monitor=self.monitor,
            moving=self.moving,
            has_heading=self.has_heading,
            judged=self.judged,
            course=self.course,
            alarms=(*first_alarms(self._all_watches, None), *self.failed_gps),
            watches=self._all_watches,
            check=self.check,
            excursions=self.excursions,
            unwatched=tuple((each, why) for name, why in self.unwatched.items() for each in axis_of(name)),
            certified=() if self.moving else self._certified,
            watched_imu=self.watched_imu,
            reasons=self.reasons,
            out_of_range=self.out_of_range,
            beside=self.beside,
        )

    @cached_property
    def certificate(self) -> Certificate:
        """The smallest faults that would have been detected: most of the work, done when they are first asked for."""
        from gtmbench.log.judging.certificate import certificate_of

        return certificate_of(self.monitor, self.watches, named=self.is_named)

    def with_names(self) -> WatchedLog:
        """Return the same with a certificate that also says which faults would have been named; takes seconds."""
        return replace(self, is_named=True)


def concluded(said: Monitored, swap: SwapCheck | None = None) -> WatchedLog:
    """Conclude what was said of a log, and of the part that its monitor was learnt from."""
    learnt = said.learnt
    opened = learnt.opened
    return WatchedLog(
        log=opened.log,
        monitor=learnt.monitor,
        identified_s=learnt.identified_s,
        watches=said.watches,
        reasons=said.findings,
        check=said.check,
        excursions=said.excursions,
        left_out=learnt.left_out,
        judged=said.judged,
        course=said.course,
        sensors=opened.sensors,
        gps=gps_of(said),
        estimator=opened.estimator,
        installation=said.installation,
        attitude=opened.attitude,
        unwatched=opened.unwatched,
        is_assumed_healthy=bool(learnt.identified_s) and not opened.asked.says_healthy,
        moving=moving_of(said),
        has_heading=f"psi={NONE}" not in opened.asked.mapping,
        there=there_of(said),
        watched_imu=opened.watched_imu,
        out_of_range=opened.out_of_range,
        swap=swap,
        scope=opened.asked.scope(there_of(said), usual_of(said), held_of(said)),
        airframe=opened.airframe,
        hardware=opened.hardware,
        temperature_c=opened.temperature_c,
    )


def moving_of(said: Monitored) -> tuple[Record, ...]:
    """Return a log with gyros and attitude, as its monitor read them; none where it doesn't compare these."""
    opened = said.learnt.opened
    if opened.own.motion is None or not basis_of(said.learnt.monitor).kinematic:
        return ()
    installed = said.installation is not None and bool(said.installation.said)
    return tuple(watch.record for watch in said.watches) if installed else opened.own.motion.segments


def there_of(said: Monitored) -> tuple[str, ...]:
    """Return the sensors that a log has, and what else its monitor may name, such as surfaces."""
    return tuple(dict.fromkeys([*said.learnt.opened.there, *suspects_of(said.learnt.monitor)]))


def usual_of(said: Monitored) -> tuple[str, ...]:
    """Return the sensors that are asked where nobody says which: those that the monitor speaks for."""
    monitor = said.learnt.monitor
    if basis_of(monitor).is_whole:
        return others_of(said)
    if moving_of(said):
        return JUDGED
    return basis_of(monitor).predicts or suspects_of(monitor) or monitor.channels or said.learnt.opened.log.channels


def others_of(said: Monitored) -> tuple[str, ...]:
    """Return the sensors that no gyro enters and that some relation holds, by the rows of the log's timeline."""
    there = there_of(said)
    compared = () if said.course is None else said.course.compared
    return tuple(row for sensor in compared for row in rows_of(sensor, there))


def held_of(said: Monitored) -> tuple[str, ...]:
    """Return the sensors that some relation holds, further IMUs' among them: what ``--judge all`` asks for."""
    there, others = there_of(said), others_of(said)
    imus = () if said.judged is None else said.judged.flight.imus
    usual = [name for name in usual_of(said) if name in there or name in others]
    commands = None if said.course is None else said.course.commands
    surfaces = () if commands is None else commands.surfaces
    return tuple(dict.fromkeys([*usual, *others, *surfaces, *(name for imu in imus for name in imu.channels)]))


def gps_of(said: Monitored) -> tuple[Alarm, ...]:
    """Return what a log's GPS shows by itself."""
    opened = said.learnt.opened
    moving = () if opened.own.motion is None else opened.own.motion.segments
    return gps_alarms(opened.sensors, moving, said.excursions)

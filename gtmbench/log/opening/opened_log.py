"""A log as it is opened to be watched: each file is read once, whatever is wanted of it.

Its channels on one clock, its gyros and attitude where something rests on them, its IMUs side by side; the healthy logs
likewise; and the bank as all of them allow it, which knows whether the gyros drive the attitude.
"""

from __future__ import annotations

import contextlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import chain

from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.bank_detector import AutoDetector
from gtmbench.detectors.isolation.case import ACCELEROMETERS
from gtmbench.detectors.protocol import Detector, Monitor, is_ready, is_recipe
from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.beside import with_imus
from gtmbench.engine.imus.imu import gyro_of
from gtmbench.engine.judged import Judged, judged
from gtmbench.engine.samples import Samples
from gtmbench.errors import InputError
from gtmbench.intake.contents import log_contents, log_samples
from gtmbench.intake.estimator_words import EstimatorWord, estimator_words_of
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.imus import Imu as LoggedImu
from gtmbench.intake.mapping import NONE
from gtmbench.intake.open import open_log
from gtmbench.intake.other_sensors import SensorReadings, other_sensors_of
from gtmbench.intake.read import ReadLog, airframe_of, read_log, temperature_c
from gtmbench.intake.row_by_row import check_rate
from gtmbench.jobs.progress import Progress, silent
from gtmbench.log.opening.auto_bank import bank_for_logs
from gtmbench.log.opening.driven_attitude import FROM_LOG, origin_in_log, origin_in_logs, rests_on_attitude, with_origin
from gtmbench.log.opening.engine_flight import flight_of_log, others_of_log
from gtmbench.log.opening.question import Asked
from gtmbench.log.opening.records import open_for, within
from gtmbench.log.opening.without_heading import no_heading, with_heading
from gtmbench.log.self_check.refusal import Part, rests_on_motion
from gtmbench.method.driven_attitude import Origin
from gtmbench.values.channels import ATTITUDE, COMMANDS, GYROS
from gtmbench.values.ranges import OutOfRange
from gtmbench.values.record import Span

_FEWEST_IMUS, _MOST_IMUS = 2, 3  # that are compared, the watched one among them
_LONGEST_S = 2e4  # of a log whose IMUs are compared
_WITHOUT = ", so the log is watched without a heading"
_FASTEST_HZ = 100.0  # at which anything is identified: faster logs are brought to it

ImuSamples = Mapping[str, Sequence[Samples]]


def watched_imu(log: FlightLog) -> LoggedImu | None:
    """Return the IMU whose gyros are a log's p, q and r; None where none of them is, or the log has one."""
    columns = {source.column for source in log.sources if source.channel in GYROS}
    found = next((imu for imu in log.imus if set(imu.columns) & columns), None)
    return found if len(log.imus) >= _FEWEST_IMUS else None


def imu_samples(read: ReadLog, log: FlightLog, mapping: Sequence[str]) -> tuple[ImuSamples, list[OutOfRange]]:
    """Return what the gyros of a log's other IMUs read, by the IMU's name, in deg/s; none of a log that is too long.

    And what no gyro reads, which isn't among it.
    """
    span_s = log.span_s
    if len(log.imus) < _FEWEST_IMUS or span_s[1] - span_s[0] > _LONGEST_S:
        return {}, []
    watched, found, beyond = watched_imu(log), {}, []
    rest = [text for text in mapping if text.partition("=")[0].strip() not in GYROS]
    for imu in log.imus[:_MOST_IMUS]:
        if watched is None or imu.name != watched.name:
            with contextlib.suppress(InputError):
                samples = log_samples(read, GYROS, [*rest, *imu.mapping])
                found[imu.name] = [Samples(samples[gyro].time_s, samples[gyro].values) for gyro in GYROS]
                beyond += [
                    replace(each, channel=gyro_of(gyro, imu.name))
                    for gyro in GYROS
                    if (each := samples[gyro].out_of_range) is not None
                ]
    return found, beyond


@dataclass(frozen=True, kw_only=True, eq=False)
class OpenedLog:
    """A log with a watcher's channels."""

    log: FlightLog
    # the same with its gyros and whole attitude, on the same clock, the heading by r where the log has none; None where
    # the watcher rests on no motion, or the log hasn't all of it
    motion: FlightLog | None = field(repr=False)

    def part(self, spans: Sequence[Span]) -> Part:
        """Return what of it lies in some spans."""
        records = within(self.log, spans)
        if self.motion is None:
            return Part(log=self.log, records=records, spans=spans)
        motion = records if self.motion is self.log else within(self.motion, spans)
        return Part(log=self.log, records=records, spans=spans, motion=motion, sources=self.motion.sources)


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened:
    """A log and the healthy ones, opened for who watches."""

    asked: Asked
    watcher: Detector | Monitor  # as the logs allow it and their attitude wants it
    own: OpenedLog  # the log that is watched
    others: tuple[OpenedLog, ...]  # healthy ones, at its rate
    imus: ImuSamples = field(repr=False)  # what the gyros of its IMUs read beside the one that is watched
    watched_imu: str  # the name of that; "" where a log has one, or p, q and r are none of theirs
    # those of the log that no gyro enters; none where the log has no heading, or nothing rests on motion
    sensors: tuple[SensorReadings, ...] = field(repr=False)
    # what the log's estimator says of gyros and sensors; it is reported and never used
    estimator: tuple[EstimatorWord, ...] = field(repr=False)
    attitude: Origin | None  # whether the gyros drive the attitude; None where nothing rests on that
    findings: tuple[str, ...]  # what is worth a word
    # whether the gyros may drive the attitude, while the monitor was calibrated for one of its own: then a gyro's fault
    # shows in other residuals, too
    bends: bool
    unwatched: Mapping[str, str]  # why gyros aren't watched that the channels give no relation
    there: tuple[str, ...]  # the sensors that the log has, whoever watches them
    # what these sensors and vanes read, each on its own stamps
    readings: Mapping[str, Samples] = field(default_factory=dict, repr=False)
    # gyros, attitude and accelerometers as the engine reads them; None where nothing rests on motion
    flight: Flight | None = field(default=None, repr=False)
    # what the engine says of that flight, before anything is learnt; None where nothing has to be
    judged: Judged | None = field(default=None, repr=False)
    # the readings of the log that no sensor reads, but for those of the channels that it was opened with
    beyond: tuple[OutOfRange, ...] = field(default=(), repr=False)
    # airframe, hardware: whose log it is, by what it says itself, else by its folder; the autopilot's identifier, ""
    # where it has none
    airframe: str = ""
    hardware: str = ""
    temperature_c: float = float("nan")  # its IMU's; NaN where it isn't logged

    @property
    def is_driven(self) -> bool:
        """Whether the gyros drive the attitude; False where nothing rests on that."""
        return self.attitude is not None and self.attitude.is_driven

    @property
    def log(self) -> FlightLog:
        """The log that is watched."""
        return self.own.log

    @property
    def out_of_range(self) -> tuple[OutOfRange, ...]:
        """The readings of the log that no sensor reads, a channel each."""
        logs = [log.out_of_range for log in (self.own.motion, self.own.log) if log is not None]
        found: dict[str, OutOfRange] = {}
        for each in chain(*logs, self.beyond):
            found.setdefault(each.channel, each)
        return tuple(found.values())


def opened(asked: Asked, progress: Progress = silent) -> Opened:
    """Read the logs that are asked about, and open them; say what the engine finds in the one that is watched."""
    progress("read", 0, 1)
    read, *others = [read_log(path) for path in (asked.path, *asked.others)]
    asked, without = _without_useless_heading(asked, read)
    watcher: Detector | Monitor
    attitude: Origin | None
    bends = False
    findings: tuple[str, ...]
    unwatched: dict[str, str] = {}
    if is_ready(asked.watcher):
        watcher, log = asked.watcher, _at_own_rate(asked, read, asked.watcher)
        attitude, shown, bends = _as_calibrated(asked.watcher, log, asked.attitude)
        findings = () if attitude is None or shown is None else (_other_text(attitude, shown),)
    else:
        watcher, attitude, unwatched = _recipe(asked, [read, *others])
        findings = (*without, *unwatched.values())
        if without and "r" in unwatched:
            unwatched = {**unwatched, "r": without[0].removesuffix(_WITHOUT)}
        log = _at_most(read, watcher, asked)
    rate_hz = 1.0 / log.sample_period_s
    own = _with_motion(read, log, watcher, asked)
    has_heading = own.motion is not None and f"psi={NONE}" not in asked.mapping
    beside = [(other, open_for(other, watcher, mapping=asked.mapping, rate_hz=rate_hz)) for other in others]
    logged = other_sensors_of(read, asked.mapping) if has_heading else ()
    sensors = tuple(each for each in logged if each.is_read)
    imus, of_imus = imu_samples(read, log, asked.mapping) if own.motion is not None else ({}, [])
    watched = watched_imu(log)
    readings, of_others = (
        others_of_log(read, asked.mapping, logged, commands=asked.asks_surfaces) if logged else ({}, [])
    )
    flight = None
    if own.motion is not None and attitude is not None:
        origin = replace(attitude, is_driven=attitude.is_driven or bends)
        flight = with_imus(flight_of_log(read, asked.mapping, own.motion, readings, origin), imus)
    is_judged = flight is not None and not is_ready(watcher)
    if is_judged:
        progress("search the whole log", 0, 1)
    return Opened(
        asked=asked,
        watcher=watcher,
        own=own,
        others=tuple(_with_motion(other, its, watcher, asked) for other, its in beside),
        imus=imus,
        watched_imu="" if watched is None else watched.name,
        sensors=sensors,
        readings=readings,
        estimator=estimator_words_of(read),
        attitude=attitude,
        findings=findings,
        bends=bends,
        unwatched=unwatched,
        there=_there(read, asked, log),
        flight=flight,
        judged=judged(flight) if flight is not None and is_judged else None,
        beyond=(*of_others, *of_imus),
        airframe=airframe_of(read),
        hardware=read.raw.hardware,
        temperature_c=temperature_c(read),
    )


def _there(read: ReadLog, asked: Asked, log: FlightLog) -> tuple[str, ...]:
    """Return the sensors that a log has: those that were opened, then the others that could be."""
    usable: tuple[str, ...] = ()
    with contextlib.suppress(InputError):
        mapping = [text for text in asked.mapping if text.partition("=")[2].strip() != NONE]
        usable = log_contents(read, mapping=mapping).usable
    return tuple(name for name in dict.fromkeys([*log.channels, *usable]) if name not in COMMANDS)


def _without_useless_heading(asked: Asked, read: ReadLog) -> tuple[Asked, tuple[str, ...]]:
    """Return what is asked without a heading that is of no use, and why, where the bank is chosen by the channels."""
    if not isinstance(asked.watcher, AutoDetector):
        return asked, ()
    why = ""
    with contextlib.suppress(InputError):  # whoever opens it to watch it says why
        if {*GYROS, *ATTITUDE} <= set(log_contents(read, mapping=asked.mapping).usable):
            why = no_heading(open_log(read, mapping=asked.mapping, needs=ATTITUDE))
    return (without_heading(asked), (f"{why}{_WITHOUT}",)) if why else (asked, ())


def without_heading(asked: Asked) -> Asked:
    """Return what is asked of a log without its heading."""
    return asked.mapped([f"psi={NONE}"])


def _at_own_rate(asked: Asked, read: ReadLog, monitor: Monitor) -> FlightLog:
    """Open a log at the rate of a monitor that is ready."""
    period_s = monitor.sample_period_s
    log = open_for(
        read, monitor, mapping=asked.mapping, rate_hz=asked.rate_hz or (None if period_s is None else 1.0 / period_s)
    )
    for source in log.sources:
        if period_s and source.period_s and source.channel in monitor.channels:
            check_rate(source.period_s, period_s, f"{read.path}: samples of {source.channel}")
    return log


def _at_most(read: ReadLog, detector: Detector | Monitor, asked: Asked) -> FlightLog:
    """Open a log at the rate that is asked for; without one at its own, 100 Hz at most."""
    log = open_for(read, detector, mapping=asked.mapping, rate_hz=asked.rate_hz)
    if asked.rate_hz is None and log.sample_period_s < 0.99 / _FASTEST_HZ:
        log = open_for(read, detector, mapping=asked.mapping, rate_hz=_FASTEST_HZ)
    return log


def _recipe(asked: Asked, reads: Sequence[ReadLog]) -> tuple[Detector | Monitor, Origin | None, dict[str, str]]:
    """Return a recipe as logs allow it and their attitude wants it, what that is, and which gyros aren't watched."""
    watcher = asked.watcher
    assert is_recipe(watcher)
    if asked.attitude == FROM_LOG and not (isinstance(watcher, AutoDetector) or rests_on_attitude(watcher)):
        return watcher, None, {}
    spans = asked.spans if asked.says_healthy else None
    origin = origin_in_logs(reads, asked.mapping, attitude=asked.attitude, spans=spans)
    unwatched: dict[str, str] = {}
    if isinstance(watcher, AutoDetector):
        watcher, unwatched = bank_for_logs(reads, asked.mapping, origin)
    if not rests_on_attitude(watcher):
        return watcher, None, unwatched
    return with_origin(watcher, origin), origin, unwatched


def _as_calibrated(monitor: Monitor, log: FlightLog, said: str) -> tuple[Origin | None, Origin | None, bool]:
    """Return whose attitude a monitor was calibrated for; the log's, where it shows another; whether it may bend."""
    calibrated_for = basis_of(monitor).attitude_from_gyros
    if calibrated_for is None:
        return None, None, False
    seen = origin_in_log(log, said)
    is_other = seen.is_driven != calibrated_for
    told = Origin(is_driven=calibrated_for, why="as the monitor was calibrated")
    return told, seen if is_other and not seen.is_assumed else None, is_other and seen.may_bend


def _other_text(told: Origin, seen: Origin) -> str:
    names = {True: "one that the gyros drive", False: "one of its own"}
    return (
        f"the log's attitude is {names[seen.is_driven]} ({seen.why}), and the monitor was calibrated for "
        f"{names[told.is_driven]}: calibrate one for such logs"
    )


def _with_motion(read: ReadLog, log: FlightLog, watcher: Detector | Monitor, asked: Asked) -> OpenedLog:
    """Return a log with its gyros and whole attitude, opened anew where its watcher doesn't take all of them."""
    if not rests_on_motion(watcher):
        return OpenedLog(log=log, motion=None)
    if {*GYROS, *ATTITUDE} <= set(log.channels):
        return OpenedLog(log=log, motion=log)
    if {*GYROS, "phi", "theta"} <= set(log.channels) and f"psi={NONE}" in asked.mapping:
        return OpenedLog(log=log, motion=replace(log, segments=tuple(map(with_heading, log.segments))))
    with contextlib.suppress(InputError):
        rate_hz, needs = 1.0 / log.sample_period_s, (*GYROS, *ATTITUDE)
        moving = open_log(read, mapping=asked.mapping, rate_hz=rate_hz, needs=needs, witnesses=ACCELEROMETERS)
        return OpenedLog(log=log, motion=moving)
    return OpenedLog(log=log, motion=None)

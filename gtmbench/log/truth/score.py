"""Scoring on a log's own truth: failures that it says were injected, held against what monitor and autopilot said.

As in `gtmbench.study.score`, without a healthy record to compare with:

- *window*: from a failure's onset until 10 s after its end, or the next onset of another.
- *found*: an alarm was raised within the window. Its *delay* is from the onset.
- *named*: in the end the alarm's sensor is one that had failed, and of no other IMU; *either-or*: it is among the
  candidates; *can't tell*: the alarm may be no fault's; *wrong*: another sensor, or an either-or without it; *passed*:
  nothing is left to explain.
- *others*: further alarms within the window that are named wrong.
- *false alarm*: an alarm outside of all windows that accuses a sensor. A *false word* is the autopilot's, of a gyro or
  accelerometer.
- *watched*: failures of gyros that were watched, begun while watched. Others are told, and not scored.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Detector, Monitor, is_ready
from gtmbench.detectors.registry import prepared
from gtmbench.errors import InputError
from gtmbench.intake.events import Event
from gtmbench.intake.flight_log import FlightLog
from gtmbench.intake.open import open_log
from gtmbench.intake.published_failures import GYRO, Injection
from gtmbench.jobs.progress import Progress, silent
from gtmbench.log.opening.driven_attitude import FROM_LOG
from gtmbench.log.opening.records import whole_s
from gtmbench.log.truth.autopilot_messages import first_between, of_sensors, words_of
from gtmbench.log.watch import watch_log
from gtmbench.log.watched_log import WatchedLog
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import Span

NAMED, EITHER_OR, CANT_TELL, WRONG, PASSED = "named", "either-or", "can't tell", "named wrong", "passed"
_AFTER_S = 10.0  # a failure: what is said until then counts to it
_MARGIN_S, _SHORTEST_S, _LONGEST_S = 6.0, 15.0, 300.0  # of what is healthy before the first failure: tests arm in it


@dataclass(frozen=True, kw_only=True)
class Scored:
    """A failure that was injected, and what was said of it."""

    injection: Injection
    why_not: str  # why it isn't scored; empty where it is
    alarm: Alarm | None  # the first within its window
    said: str  # what that alarm comes to: named, either-or, can't tell, named wrong, passed; empty without one
    others: tuple[Alarm, ...]  # further ones within its window that are named wrong
    # the autopilot's first within its window: of a gyro or accelerometer, else of an estimator or the flight
    word: Event | None

    @property
    def delay_s(self) -> float | None:
        """From the onset to our alarm."""
        return None if self.alarm is None else self.alarm.time_s - self.injection.onset_s

    @property
    def named_delay_s(self) -> float | None:
        """From the onset to when the sensor could be named; None while none is."""
        known_s = None if self.alarm is None else self.alarm.isolated_s
        return None if known_s is None else known_s - self.injection.onset_s

    @property
    def word_delay_s(self) -> float | None:
        """From the onset to the autopilot's word."""
        return None if self.word is None else self.word.time_s - self.injection.onset_s


@dataclass(frozen=True, kw_only=True, eq=False)
class ScoredLog:
    """A log with injected failures, watched and scored.

    Attributes
    ----------
    watched : WatchedLog
    rows : tuple of Scored
        One a failure, in time.
    false_alarms : tuple of Alarm
        Our alarms that accuse a sensor outside of all windows.
    false_words : tuple of Event
        The autopilot's messages on a gyro or accelerometer outside of all windows.

    Examples
    --------
    >>> import tempfile
    >>> from dataclasses import replace
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> from gtmbench.log.truth.score import scored
    >>> noise = np.random.default_rng(1).standard_normal((1500, 2))
    >>> record = gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)
    >>> broken = gb.inject(record, gb.Noise(channel="q", onset_s=45.0, deviation=3.0))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     gb.write_log(broken, f"{folder}/flight.csv")
    ...     watched = gb.watch_log(f"{folder}/flight.csv", gb.bank_between(["p"], ["q"]), healthy=[(0.0, 30.0)])
    >>> told = gb.Injection(
    ...     sensor="gyro", number=None, channels=("q",), kind="noise", onset_s=45.0, end_s=None, text="noise of q"
    ... )
    >>> found = scored(replace(watched, log=replace(watched.log, injections=(told,))))  # as if the log had told of it
    >>> len(found.trials), 0.0 < found.trials[0].delay_s < 2.0, found.false_alarms
    (1, True, ())
    """

    watched: WatchedLog
    rows: tuple[Scored, ...]
    false_alarms: tuple[Alarm, ...]
    false_words: tuple[Event, ...]

    @property
    def trials(self) -> tuple[Scored, ...]:
        """The rows that are scored."""
        return tuple(row for row in self.rows if not row.why_not)


def score_log(
    path: str | Path,
    detector: Detector | Monitor | Bank | str | Path = AUTO,
    *,
    healthy: Sequence[Span | str | Path] = (),
    mapping: Sequence[str] = (),
    rate_hz: float | None = None,
    attitude: str = FROM_LOG,
    judge: str | Sequence[str] | None = None,
    limits: Sequence[str] = (),
    progress: Progress = silent,
) -> ScoredLog:
    r"""Watch a log and score the verdicts on the injected failures that it records.

    Parameters
    ----------
    path, detector, mapping, rate_hz, attitude, judge, limits, progress
        As `watch_log` takes them.
    healthy : sequence of (start, end), str or Path
        As in `watch_log`; by default the log before the first failure, 300 s at most.

    Raises
    ------
    InputError
        If the log records no failure, can't be watched, or a healthy span holds a failure.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> import gtmbench as gb
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     log = Path(folder, "flight.csv")
    ...     _ = log.write_text("t [s],gyro_x (rad/s)\n" + "".join(f"{k / 100},0.5\n" for k in range(500)))
    ...     try:
    ...         gb.score_log(log)
    ...     except gb.InputError as error:
    ...         print(str(error).partition(": ")[2][:44])
    the log records no failure that was injected
    """
    path = Path(path)
    log = _opened(path, mapping)
    if not log.injections:
        raise InputError(
            f"{path}: the log records no failure that was injected (PX4: vehicle_command 420 or failure_injection, "
            "ArduPilot: changes of SIM_GYR... parameters); watch it with gtmbench monitor"
        )
    watcher = prepared(detector)
    spans = tuple(healthy)
    if not is_ready(watcher):
        start_s, _ = whole_s(log)
        spans = spans or (_before(log.injections, start_s, path),)
        _check_healthy(spans, log.injections)
    return scored(
        watch_log(
            path,
            watcher,
            healthy=spans,
            mapping=mapping,
            rate_hz=rate_hz,
            attitude=attitude,
            judge=judge,
            limits=limits,
            progress=progress,
        )
    )


def _opened(path: Path, mapping: Sequence[str]) -> FlightLog:
    """Return a log by its gyros and attitude, so that no slower channel cuts it short; with all channels otherwise."""
    try:
        return open_log(path, mapping=mapping, needs=[*GYROS, *ATTITUDE])
    except InputError:
        return open_log(path, mapping=mapping)


def _before(injections: Sequence[Injection], start_s: float, path: Path) -> Span:
    end_s = min(each.onset_s for each in injections) - _MARGIN_S
    if end_s - start_s < _SHORTEST_S:
        raise InputError(
            f"{path}: the first failure begins {max(end_s - start_s, 0.0) + _MARGIN_S:.1f} s after the log does, and "
            f"{_SHORTEST_S + _MARGIN_S:g} s are wanted to identify on; give --healthy T0:T1, or a ready monitor"
        )
    return start_s, min(end_s, start_s + _LONGEST_S)


def _check_healthy(spans: Iterable[Span | str | Path], injections: Sequence[Injection]) -> None:
    for span in spans:
        if isinstance(span, (str, Path)):
            continue
        for each in injections:
            end_s = float("inf") if each.end_s is None else each.end_s
            if each.onset_s < span[1] and end_s > span[0]:
                raise InputError(
                    f"{span[0]:g}..{span[1]:g} s are given as healthy, and {each.text} from {each.onset_s:.2f} s on; "
                    "give a span without a failure"
                )


def scored(watched: WatchedLog) -> ScoredLog:
    """Score a watched log on the failures that it says were injected."""
    injections, words = watched.log.injections, words_of(watched.log.events)
    windows = list(_windows(injections, whole_s(watched.log)[1]))
    rows = tuple(
        _scored(watched, injection, window, words) for injection, window in zip(injections, windows, strict=True)
    )
    accusing = [alarm for alarm in watched.alarms if alarm.accuses]
    return ScoredLog(
        watched=watched,
        rows=rows,
        false_alarms=tuple(alarm for alarm in accusing if not _within(alarm.time_s, windows)),
        false_words=tuple(word for word in of_sensors(words) if not _within(word.time_s, windows)),
    )


def _windows(injections: Sequence[Injection], end_s: float) -> Iterable[Span]:
    """Give every failure's window; what begins at once shares its alarms."""
    later = [each.onset_s for each in injections]
    for each in injections:
        over_s = end_s if each.end_s is None else min(each.end_s + _AFTER_S, end_s)
        following_s = min((onset_s for onset_s in later if onset_s > each.onset_s), default=end_s)
        yield each.onset_s, max(min(over_s, following_s), each.onset_s)


def _within(time_s: float, windows: Iterable[Span]) -> bool:
    return any(start_s <= time_s <= end_s for start_s, end_s in windows)


def _scored(watched: WatchedLog, injection: Injection, window: Span, words: Sequence[Event]) -> Scored:
    alarms = [alarm for alarm in watched.alarms if window[0] <= alarm.time_s <= window[1]]
    alarm = next(iter(alarms), None)
    return Scored(
        injection=injection,
        why_not=_why_not(watched, injection),
        alarm=alarm,
        said="" if alarm is None else _alarm_text(alarm, watched),
        others=tuple(other for other in alarms[1:] if _alarm_text(other, watched) == WRONG),
        word=first_between(words, *window),
    )


def _why_not(watched: WatchedLog, injection: Injection) -> str:
    """Say why a failure can't be scored; nothing where it can."""
    if injection.sensor != GYRO:
        return f"no {injection.sensor} is watched"
    seen = _watched_number(watched)
    compared = {imu.number for imu in watched.log.imus if imu.name in watched.compared_imus}
    if injection.number is not None and seen is not None and injection.number not in {seen, *compared}:
        return f"gyro {injection.number} isn't watched"
    records = [watch.record for watch in watched.watches]
    if not any(record.start_s <= injection.onset_s <= record.end_s for record in records):
        return "it began while nothing was watched"
    return ""


def _watched_number(watched: WatchedLog) -> int | None:
    """Return which gyro the channels are of; None where the autopilot chose."""
    columns = {source.column for source in watched.log.sources if source.channel in ("p", "q", "r")}
    return next((imu.number for imu in watched.log.imus if set(imu.columns) & columns), None)


def _alarm_text(alarm: Alarm, watched: WatchedLog) -> str:
    """Say what an alarm comes to, by what had failed when it was raised."""
    if alarm.has_passed:
        return PASSED
    if alarm.doubt:
        return CANT_TELL
    numbers = {imu.name: imu.number for imu in watched.log.imus}
    told = numbers.get(alarm.last.imu) if alarm.last is not None and alarm.last.imu else _watched_number(watched)
    failed = {
        name
        for each in watched.log.injections
        if each.onset_s <= alarm.time_s <= (math.inf if each.end_s is None else each.end_s + _AFTER_S)
        and (None in (told, each.number) or told == each.number)
        for name in each.channels
    }
    named = () if alarm.last is None else alarm.last.failed
    if named:
        return NAMED if {*named} <= failed else WRONG
    return EITHER_OR if set(alarm.candidates) & failed else WRONG

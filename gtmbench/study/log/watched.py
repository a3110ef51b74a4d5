"""A recorded flight, watched: what the monitor was, what it said, what that means."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from gtmbench.deprecation import renamed
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Monitor, Watch
from gtmbench.intake.flight_log import FlightLog
from gtmbench.record import Span


class Outcome(IntEnum):
    """What a log comes to; the value is the command's exit code."""

    HEALTHY = 0
    FAILED = 1
    UNKNOWN = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedLog:
    """What a monitor said of a log.

    Attributes
    ----------
    log : FlightLog
    monitor : Monitor
    identified_s : tuple of (start, end)
        The spans of this log that the monitor was identified and calibrated on; empty where it came ready.
    watches : tuple of Watch
        One a stretch that was watched, in time.
    reasons : tuple of str
        Why it can't be told, where it can't; what limits what was said, where it can.
    """

    log: FlightLog
    monitor: Monitor
    identified_s: tuple[Span, ...]
    watches: tuple[Watch, ...] = field(repr=False)
    reasons: tuple[str, ...]

    @property
    def alarms(self) -> tuple[Alarm, ...]:
        """Every alarm that first told of a fault, in time; those that count to another's fault are left out."""
        return tuple(alarm for watch in self.watches for alarm in watch.faults)

    @property
    def armed_hours(self) -> float:
        """Hours watched: how long an alarm was possible."""
        return sum(watch.armed_hours for watch in self.watches)

    @property
    def stuck_above(self) -> tuple[str, ...]:
        """The scores that stood above their thresholds all through a stretch: nothing is told of them."""
        scores = [score for watch in self.watches for score in watch.scores.values() if score.is_stuck_above]
        return tuple(dict.fromkeys(score.name for score in scores))

    @property
    def outcome(self) -> Outcome:
        """Failed where an alarm is left to explain; unknown where nothing could have alarmed, or a score couldn't."""
        if any(not alarm.has_passed for alarm in self.alarms):
            return Outcome.FAILED
        return Outcome.HEALTHY if self.armed_hours > 0.0 and not self.stuck_above else Outcome.UNKNOWN

    findings = renamed("WatchedLog.findings", "alarms")

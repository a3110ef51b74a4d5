"""A recorded flight, watched: what the monitor was, what it saw, what that means."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import IntEnum

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.detector import BankMonitor
from gtmbench.detectors.protocol import Watch
from gtmbench.intake.flight_log import FlightLog
from gtmbench.record import Span


class Outcome(IntEnum):
    """What a log comes to; the value is the command's exit code."""

    HEALTHY = 0
    FAILED = 1
    UNKNOWN = 3


@dataclass(frozen=True, kw_only=True, eq=False)
class WatchedLog:
    """What a monitor saw on a log.

    Attributes
    ----------
    log : FlightLog
    monitor : BankMonitor
    identified_s : tuple of (start, end)
        The spans of this log that the monitor was identified and calibrated on; empty where it came ready.
    watches : tuple of Watch
        One a stretch that was watched, in time.
    reasons : tuple of str
        Why it can't be told, where it can't; what limits what was said, where it can.
    """

    log: FlightLog
    monitor: BankMonitor
    identified_s: tuple[Span, ...]
    watches: tuple[Watch, ...] = field(repr=False)
    reasons: tuple[str, ...]

    @property
    def findings(self) -> tuple[Finding, ...]:
        """Every finding, in time."""
        return tuple(finding for seen in self.watches for finding in seen.findings)

    @property
    def armed_hours(self) -> float:
        """How long an alarm was possible."""
        return sum(seen.armed_hours for seen in self.watches)

    @property
    def outcome(self) -> Outcome:
        """Failed where a finding is left to explain; unknown where nothing could have alarmed."""
        if any(finding.last.candidates for finding in self.findings):
            return Outcome.FAILED
        return Outcome.HEALTHY if self.armed_hours > 0.0 else Outcome.UNKNOWN

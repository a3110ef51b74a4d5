"""What a watched log shows: which faults, since when, and where to look at them."""

from __future__ import annotations

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Watch
from gtmbench.record import Span
from gtmbench.report.style import colour
from gtmbench.study.watched_log import WatchedLog

_BEFORE_S, _AFTER_S, _LONGEST_S = 5.0, 15.0, 90.0  # about a fault, shown large


def faults_of(watched: WatchedLog) -> dict[str, list[Finding]]:
    """Return the findings that something explains, by their verdict: a fault that lasts is found in every segment."""
    found: dict[str, list[Finding]] = {}
    for finding in watched.findings:
        if finding.last.candidates:
            found.setdefault(finding.verdict, []).append(finding)
    return found


def began_s(finding: Finding) -> float:
    """Return when a fault began: as its kind's fit tells, or else the alarm's test."""
    return finding.last.parameters.get("onset_s", finding.onset_s)


def given_up_by(finding: Finding, seen: Watch) -> list[str]:
    """Return the residuals that are no longer watched since a finding."""
    given_up = seen.given_up
    return [output for output in seen.levels if given_up.get(output) == finding.alarm_s]


def about(fault: Finding, whole: Span) -> Span:
    """Return the span about a fault: from before it began until after it was told."""
    first_s = max(min(began_s(fault), fault.alarm_s) - _BEFORE_S, fault.alarm_s - _LONGEST_S)
    last_s = min(max(fault.alarm_s, fault.isolated_s or fault.alarm_s) + _AFTER_S, fault.alarm_s + _LONGEST_S)
    return max(first_s, whole[0]), min(last_s, whole[1])


def whole_of(watched: WatchedLog) -> Span:
    """Return the log's span."""
    return watched.log.segments[0].start_s, watched.log.segments[-1].end_s


def tints_of(watched: WatchedLog) -> dict[str, str]:
    """Return every channel's colour, in figure and recording."""
    names = dict.fromkeys([*watched.monitor.operators, *watched.log.channels])
    return {name: colour(name, i) for i, name in enumerate(names)}


def signals_of(watched: WatchedLog) -> list[str]:
    """Return the sensors worth looking at: those that are predicted, and those that failed."""
    failed = [finding.sensor for finding in watched.findings if finding.sensor is not None]
    return list(dict.fromkeys([*(spec.output for spec in watched.monitor.bank.residuals), *failed]))

"""What a watched log shows: faults and where to look, alarms, which sensors have something to tell."""

from __future__ import annotations

from collections.abc import Iterable

from gtmbench.detectors.alarm import MISSING, Alarm
from gtmbench.detectors.protocol import Watch
from gtmbench.detectors.statistics.thresholds import rate_bound
from gtmbench.log.judging.claims import began_s
from gtmbench.log.watched_log import WatchedLog
from gtmbench.report.style import colours
from gtmbench.values.record import Span
from gtmbench.verdict.verdict import LogVerdict

_BEFORE_S, _AFTER_S, _LONGEST_S = 5.0, 15.0, 90.0  # about a fault, shown large
_MOST_SIGNALS = 6  # that are drawn where nobody is predicted


def faults_of(watched: WatchedLog) -> dict[str, list[Alarm]]:
    """Return the alarms that tell of a fault, by their verdict; those of failed sensors first: they are shown large."""
    faults: dict[str, list[Alarm]] = {}
    for alarm in failed_first(watched.verdict, watched.alarms):
        if not alarm.has_passed:
            faults.setdefault(alarm.verdict, []).append(alarm)
    return faults


def failed_first(verdict: LogVerdict, alarms: Iterable[Alarm]) -> list[Alarm]:
    """Return alarms in time, those of failed sensors before all others."""
    failed = {sensor for sensor, _ in verdict.failed}
    return sorted(alarms, key=lambda alarm: alarm.sensor not in failed)


def disarmed_by(alarm: Alarm, watch: Watch) -> list[str]:
    """Return the scores that can't alarm any more since an alarm: its judgement is that the fault lasts."""
    return [name for name, time_s in watch.disarmed.items() if _disarming(time_s, watch) is alarm]


def _disarming(time_s: float, watch: Watch) -> Alarm | None:
    """Return the alarm that was judged at a time, or else the last one before it."""
    told = [alarm for alarm in watch.faults if alarm.time_s <= time_s + 1e-9 and alarm.test != MISSING]
    at_it = [alarm for alarm in told if any(abs(judged.time_s - time_s) < 1e-9 for judged in alarm.judgements)]
    return next(reversed(at_it or told), None)


def about(fault: Alarm, whole: Span) -> Span:
    """Return the span about a fault: from before it began until after it was told."""
    first_s = max(min(began_s(fault), fault.time_s) - _BEFORE_S, fault.time_s - _LONGEST_S)
    last_s = min(max(fault.time_s, fault.isolated_s or fault.time_s) + _AFTER_S, fault.time_s + _LONGEST_S)
    return max(first_s, whole[0]), min(last_s, whole[1])


def scores_of(watched: WatchedLog) -> list[str]:
    """Return the names of the scores; none where the monitor shows none, or nothing was watched."""
    return list(dict.fromkeys(name for watch in watched.watches for name in watch.scores))


def residuals_of(watched: WatchedLog) -> list[str]:
    """Return the outputs with residuals; none where the monitor has none, or nothing was watched."""
    return list(dict.fromkeys(name for watch in watched.watches for name in watch.residuals))


def tints_of(watched: WatchedLog) -> dict[str, str]:
    """Return every score's and channel's colour, in figure and recording."""
    return colours([*scores_of(watched), *residuals_of(watched), *watched.log.channels])


def signals_of(watched: WatchedLog) -> list[str]:
    """Return the sensors worth looking at: those that are predicted, and those that failed; or else those used."""
    failed = [name for alarm in watched.alarms if alarm.last is not None for name in alarm.last.failed]
    predicted = [name for watch in watched.watches for name in watch.predictions]
    used = [name for name in watched.monitor.channels or watched.log.channels if name in watched.log.channels]
    return list(dict.fromkeys([*predicted, *failed] or used[:_MOST_SIGNALS]))


def reported_sensors(verdict: LogVerdict) -> tuple[str, ...]:
    """Return the sensors that have something to tell: those that are asked, and others that failed or are suspected."""
    accused = [sensor for sensor, _ in (*verdict.failed, *verdict.suspected)]
    shown = dict.fromkeys([*verdict.scope.sensors, *accused])
    return tuple(sensor for sensor in shown if sensor in verdict.timeline.sensors)


def passed_alarms(watched: WatchedLog) -> int:
    """Return how many alarms had nothing left to explain: false ones."""
    return sum(alarm.has_passed for alarm in watched.alarms)


def alarm_bound(watched: WatchedLog) -> float | None:
    """Return the upper 95 % bound of false alarms an hour that the log shows; None where nothing was watched."""
    return rate_bound(passed_alarms(watched), watched.armed_hours)

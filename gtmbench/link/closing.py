"""The closing word on a link: what arrived is a log, and judged as one, by the same function; until then, its alarms.

While it flies, an alarm accuses; nobody is clear before the flight is over, for only all of it tells what is usual.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.bank.composed import AUTO
from gtmbench.detectors.protocol import Monitor
from gtmbench.errors import InputError
from gtmbench.jobs.progress import Progress
from gtmbench.log.judging.claims import began_s, of_alarm
from gtmbench.log.watch import watch_log
from gtmbench.log.watched_log import WatchedLog
from gtmbench.values.record import Span
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import SensorSpan, laid_out
from gtmbench.verdict.verdict import LogVerdict, verdict_of

_ABOUT_S = 15.0  # of its onset: what a verdict dates so is the failure that an alarm told of
FLYING = "who is clear is told when the flight is over"


@dataclass(frozen=True, kw_only=True, eq=False)
class ClosingWord:
    """What a flight comes to once it is over."""

    verdict: LogVerdict
    # the log of what arrived, as `gtmbench monitor` watches it; None where that can't be judged
    watched: WatchedLog | None = field(default=None, repr=False)
    unconfirmed: tuple[Alarm, ...] = ()  # those that accused a sensor while it flew, and that the verdict doesn't hold


def verdict_so_far(sensors: Sequence[str], span_s: Span, alarms: Sequence[Alarm], why: str = FLYING) -> LogVerdict:
    """Return a verdict that knows the alarms alone: nobody is clear.

    `alarms`: the first of each fault.
    """
    claims: dict[str, list[SensorSpan]] = {sensor: [] for sensor in sensors}
    for alarm in alarms:
        for sensor, span in of_alarm(alarm, span_s[1], sensors, ""):
            claims.setdefault(sensor, []).append(span)
    return verdict_of(laid_out(span_s, claims, motion_s=(span_s,), otherwise=why), Scope(sensors=tuple(sensors)))


def closed(
    log: Path,
    monitor: Monitor | None,
    alarms: Sequence[Alarm],
    *,
    mapping: Sequence[str],
    attitude: str,
    progress: Progress,
) -> ClosingWord:
    """Judge what has arrived, as ``gtmbench monitor LOG --detector FILE`` does; without a monitor, as ``auto``.

    `monitor`: the one that was given; None where it was learnt from the link: knowing all of it, another may be better.
    `alarms`: the first of each fault, as they were told while it flew.
    """
    watched = watch_log(log, monitor or AUTO, mapping=mapping, attitude=attitude, progress=progress)
    doubtful = tuple(alarm for alarm in alarms if alarm.accuses and not _is_held(alarm, watched.verdict))
    return ClosingWord(verdict=watched.verdict, watched=watched, unconfirmed=doubtful)


def why_not(error: InputError, log: Path) -> str:
    """Return why what was kept can't be judged, for who doesn't know the file."""
    return str(error).replace(f"{log}: ", "").replace(str(log), "the link")


def _is_held(alarm: Alarm, verdict: LogVerdict) -> bool:
    """Tell whether a verdict accuses somebody of whom an alarm told, at about that time."""
    start_s = min(began_s(alarm), alarm.onset_s) - _ABOUT_S
    end_s = math.inf if alarm.ended_s is None else max(alarm.ended_s, alarm.time_s)
    named = {*alarm.candidates, *([] if alarm.sensor is None else [alarm.sensor])}
    accused = [*verdict.failed, *verdict.suspected]
    return any((not named or sensor in named) and span.meets(start_s, end_s) for sensor, span in accused)

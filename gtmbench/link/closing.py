"""The closing word on a link: the verdict of what was watched while it flew, by the same function as a log's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.predicting import predicts
from gtmbench.detectors.protocol import Monitor
from gtmbench.study.log.claims import of_alarm
from gtmbench.values.record import Span
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import SensorSpan, State, Timeline, laid_out, unjudged
from gtmbench.verdict.verdict import LogVerdict, verdict_of

_UNARMED = "a test could not have alarmed here"


def closing_verdict(
    monitor: Monitor, heard_s: Sequence[Span], armed_s: Sequence[Span], alarms: Sequence[Alarm], why_not: str = ""
) -> LogVerdict:
    """Return the verdict so far on a link.

    A monitor was calibrated elsewhere, and states its sizes there: spans are clear without any.

    Parameters
    ----------
    monitor : Monitor
    heard_s, armed_s : sequence of (start, end)
        Where rows were read, and where every test of the monitor could have alarmed.
    alarms : sequence of Alarm
        The first of each fault.
    why_not : str
        Why nothing of it can be judged; "" where it can.
    """
    sensors = monitor.suspects or monitor.channels
    timeline = _timeline(monitor, sensors, heard_s, armed_s, alarms, why_not)
    return verdict_of(timeline, Scope(sensors=sensors))


def _timeline(
    monitor: Monitor,
    sensors: Sequence[str],
    heard_s: Sequence[Span],
    armed_s: Sequence[Span],
    alarms: Sequence[Alarm],
    why_not: str,
) -> Timeline:
    if not heard_s:
        return laid_out((0.0, 0.0), dict.fromkeys(sensors, ()))
    span_s = min(start_s for start_s, _ in heard_s), max(end_s for _, end_s in heard_s)
    claims: dict[str, list[SensorSpan]] = {sensor: [] for sensor in sensors}
    for alarm in alarms:
        for sensor, span in of_alarm(alarm, span_s[1], sensors, ""):
            claims.setdefault(sensor, []).append(span)
    for sensor in sensors:
        claims[sensor] += _of_silence(monitor, span_s, armed_s, why_not)
    return laid_out(span_s, claims, motion_s=tuple(heard_s), otherwise=_UNARMED)


def _of_silence(monitor: Monitor, span_s: Span, armed_s: Sequence[Span], why_not: str) -> Iterator[SensorSpan]:
    silent = f"{monitor.name} states no size that it would find, so its silence says nothing"
    why = why_not or ("" if predicts(monitor) else silent)
    if why:
        yield unjudged(span_s, why)
    for start_s, end_s in armed_s:
        yield SensorSpan(start_s=start_s, end_s=end_s, state=State.CLEAR)

"""A watched log in words: what it is, what watched it, what was found, and what was not watched."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.assumptions import basis_of
from gtmbench.detectors.bank.calibrated import CalibratedBank
from gtmbench.detectors.bank.detectability import isolability
from gtmbench.detectors.protocol import Watch, is_ready, suspects_of
from gtmbench.intake.events import Event, EventKind
from gtmbench.intake.flight_log import FlightLog, Remark
from gtmbench.log.judging.claims import began_s
from gtmbench.log.self_check.explained_motion import ExplainedMotion
from gtmbench.log.watched_log import WatchedLog
from gtmbench.method.driven_attitude import Origin
from gtmbench.report.log_findings import alarm_bound, disarmed_by, passed_alarms
from gtmbench.report.words.found import certificate_lines, finding_lines
from gtmbench.report.words.judgement import alarm_text, source_text, whole_text
from gtmbench.report.words.monitor import facts, isolation_lines, origin_text
from gtmbench.report.words.others import (
    autopilot_lines,
    estimator_lines,
    gps_lines,
    imu_lines,
    injection_lines,
    sensor_lines,
)
from gtmbench.report.words.timeline import span_lines
from gtmbench.report.words.units import counted, duration_text, first_few, per_second, with_unit
from gtmbench.report.words.verdict import summary_lines
from gtmbench.values.channels import unit_of
from gtmbench.values.pieces import deviation, rms
from gtmbench.values.record import Span
from gtmbench.verdict.verdict import Outcome

_MOST = 12  # of remarks, of alarms
_MOST_EVENTS = 8  # that are told one by one
_PARTS = {"identified": "part learnt from", "watched": "part watched"}
_TOLD = (EventKind.RESET, EventKind.FAILURE)  # events that say more than that they were


def log_report(watched: WatchedLog, width: int = 80) -> list[str]:
    """Return the verdict and what follows it (`summary_lines`), then every detail, line by line."""
    return [*summary_lines(watched, width, None), "", *detail_lines(watched)]


def detail_lines(watched: WatchedLog) -> list[str]:
    """Return everything that is known of a watched log beside its verdict."""
    return [
        *_log_lines(watched.log),
        *_remark_lines(watched.log.remarks),
        *events_lines(watched.log.events),
        "",
        *_monitor_lines(watched),
        "",
        *_alarms_lines(watched),
        *finding_lines(watched.judged, watched.course),
        *imu_lines(watched),
        *autopilot_lines(watched),
        *injection_lines(watched),
        *span_lines(watched.timeline, watched.log.zero_stamp),
        *_excursion_lines(watched),
        *(f"note: {reason}" for reason in watched.reasons),
        *(f"note: {note}" for note in watched.check.notes),
        *certificate_lines(watched.certificate),
        *sensor_lines(watched.sensors),
        *gps_lines(watched.gps),
        *estimator_lines(watched.estimator),
        *_worth_lines(watched),
    ]


def _log_lines(log: FlightLog) -> list[str]:
    first, last = log.segments[0], log.segments[-1]
    length_s = sum(segment.end_s - segment.start_s for segment in log.segments)
    options = [source.option for source in log.sources if source.guessed and source.column]
    parts = f", {len(log.segments)} segments of {length_s:.2f} s in all" if len(log.segments) > 1 else ""
    return [
        f"{log.path.name}: {_span((first.start_s, last.end_s))}, every {log.sample_period_s:g} s{parts}",
        f"channels: {', '.join(with_unit(name, unit_of(name)) for name in log.channels)}",
        *log.method,
        *([f"to state what was guessed: gtmbench monitor {log.path} {' '.join(options)}"] if options else []),
    ]


def _remark_lines(remarks: Sequence[Remark]) -> list[str]:
    """Return a line a remark; of a long list the first, and how many of which kind there are more."""
    lines = [f"remark: {remark_text(remark)}" for remark in remarks[:_MOST]]
    more = Counter(remark.kind for remark in remarks[_MOST:])
    if more:
        last_s = max(remark.end_s for remark in remarks[_MOST:])
        kinds = ", ".join(f"{kind} ({count})" for kind, count in more.most_common())
        lines.append(f"{more.total()} remarks more, up to {last_s:.2f} s: {kinds}")
    return lines


def events_lines(events: Sequence[Event]) -> list[str]:
    """Return what a log says of its flight in a line; of many events, a kind's first and last.

    >>> events_lines([Event(kind=EventKind.RESET, time_s=3.0, text="attitude by 2 deg")])
    ['the log reports: reset at 3.00 s (attitude by 2 deg)']
    """
    events = [event for event in events if event.kind is not EventKind.COMPLAINT]  # the autopilot's word is told apart
    if not events:
        return []
    if len(events) <= _MOST_EVENTS:
        return [f"the log reports: {', '.join(map(event_text, events))}"]
    by_kind: dict[str, list[Event]] = {}
    for event in events:
        by_kind.setdefault(event.kind, []).append(event)
    told = [
        event_text(same[0])
        if len(same) == 1
        else f"{same[0].kind} {len(same)} times from {same[0].time_s:.2f} to {same[-1].time_s:.2f} s"
        for same in by_kind.values()
    ]
    return [f"the log reports: {', '.join(told)}"]


def event_text(event: Event) -> str:
    """Write an event: what, when, and in the log's words where they say more."""
    return f"{event.kind} at {event.time_s:.2f} s{_own_words(event)}"


def event_name(event: Event) -> str:
    """Write an event without its time."""
    return f"{event.kind}{_own_words(event)}"


def _own_words(event: Event) -> str:
    return f" ({event.text})" if event.kind in _TOLD else ""


def remark_text(remark: Remark) -> str:
    """Write a remark: when, what, about which channel.

    >>> remark_text(Remark(kind="gap", channel=None, start_s=3.0, end_s=5.0, text="no samples for 2 s"))
    '3.00 to 5.00 s  gap: no samples for 2 s'
    """
    what = remark.kind if remark.channel is None else f"{remark.kind}, {remark.channel}"
    return f"{_span((remark.start_s, remark.end_s))}  {what}: {remark.text}"


def _span(span: Span) -> str:
    return f"{span[0]:z.2f} to {span[1]:z.2f} s"


def _spans(spans: Sequence[Span]) -> str:
    """Write spans, of many the first, and how long they are in all."""
    total = f"; {sum(end_s - start_s for start_s, end_s in spans):.2f} s in all" if len(spans) > 1 else ""
    return first_few([_span(span) for span in spans], 3) + total


def _monitor_lines(watched: WatchedLog) -> list[str]:
    monitor, on = watched.monitor, watched.identified_s
    known = facts(monitor)
    if basis_of(monitor).is_whole:
        return [f"{basis_of(monitor).title}: other sensors are judged over the whole log, and nothing is learnt"]
    if not is_ready(monitor):
        return [f"{basis_of(monitor).title}: not calibrated, nothing is watched"]
    title = f"{basis_of(monitor).title}: {known['title']}" if "title" in known else f"detector {monitor.name}"
    origin = [f"learnt from this log: {_spans(on)}"] if on else origin_text(monitor)
    origin += attitude_lines(watched.attitude)
    told = isolation_lines(isolability(monitor.bank)) if isinstance(monitor, CalibratedBank) else []
    return [title, *origin, *told, *_score_lines(watched, known), *_explained_lines(watched.check.explained)]


def attitude_lines(origin: Origin | None) -> list[str]:
    """Say whether the gyros drive the attitude, and what that stands on."""
    if origin is None:
        return []
    taken = "assumed to be computed from the gyros" if origin.is_assumed else "computed from the gyros"
    return [f"attitude: {taken if origin.is_driven else 'of its own'} ({origin.why})"]


def _explained_lines(explained: Sequence[ExplainedMotion]) -> list[str]:
    """Say how much of the slow motion is explained, a line a place."""
    lines = []
    for where in dict.fromkeys(each.where for each in explained):
        shares = ", ".join(
            f"{each.output} {f'{100.0 * max(each.share, 0.0):.0f} %' if np.isfinite(each.share) else 'none'}"
            for each in explained
            if each.where == where
        )
        lines.append(f"slow motion explained in the {_PARTS.get(where, where)}: {shares}")
    return lines


def _score_lines(watched: WatchedLog, known: Mapping[str, Any]) -> list[str]:
    """Say of a bank's residuals how large they are and what drift stays unseen, of other scores their thresholds."""
    if "residuals" in known:
        return [
            f"{output} from {', '.join(residual['inputs'])}: {_residual_text(output, residual, watched.watches)}"
            for output, residual in known["residuals"].items()
        ]
    lines = []
    if "operator" in known:
        operator = known["operator"]
        for output, identified in zip(operator["outputs"], operator["rms_residual"], strict=True):
            said = _sizes_text(output, identified, unit_of(output), watched.watches)
            lines.append(f"{output} from {', '.join(operator['inputs'])}: {said}")
    for name, score in (watched.watches[0].scores if watched.watches else {}).items():
        threshold = f"{name}: alarm above {score.threshold:.3g} {score.unit}".rstrip()
        lines.append(f"{threshold}; {_watched_text(name, watched.watches)}; latency {known['look_ahead_s']:g} s")
    return lines


def _residual_text(output: str, known: Mapping[str, Any], watches: Sequence[Watch]) -> str:
    """Say how large a residual is, when it is known, and what drift stays unseen."""
    unit, drift = known["unit"], known["slowest_drift_per_s"]
    parts = [_sizes_text(output, known["rms_residual"], unit, watches)]
    if watches:
        parts.append(_watched_text(output, watches))
    parts.append(f"latency {known['look_ahead_s']:g} s")
    if drift is not None:
        parts.append(f"drifts slower than {drift:.2g} {per_second(unit)} are not detected")
    return "; ".join(parts)


def _sizes_text(output: str, identified: float, unit: str, watches: Sequence[Watch]) -> str:
    said = "residual " + f"{identified:.3g} {unit}".rstrip() + " RMS in the part learnt from"
    if not watches:
        return said
    residual = rms(watch.residuals[output] for watch in watches)
    said += f", {residual:.3g} in the part watched"
    if output not in watches[0].record:  # no sensor's
        return said
    return f"{said}, signal {deviation([watch.record[output] for watch in watches]):.3g}"


def _watched_text(name: str, watches: Sequence[Watch]) -> str:
    armed = sum(np.count_nonzero(watch.scores[name].armed) * watch.record.sample_period_s for watch in watches)
    return f"watched for {duration_text(armed / 3600.0)}"


def _alarms_lines(watched: WatchedLog) -> list[str]:
    told = watched.raised
    lines = [line for alarm, watch in told[:_MOST] for line in _alarm_lines(alarm, watch)]
    lines += [line for alarm in watched.whole_alarms for line in _whole_lines(alarm)]
    return [*lines, f"{len(told) - _MOST} alarms more"] if told[_MOST:] else lines


def _whole_lines(alarm: Alarm) -> list[str]:
    ended = "its end was not seen" if alarm.ended_s is None else f"gone since {alarm.ended_s:.2f} s"
    return [
        f"{alarm.time_s:.2f} s  {alarm_text(alarm)}",
        f"    {whole_text(alarm)}; since about {alarm.onset_s:.2f} s; {ended}",
    ]


def _alarm_lines(alarm: Alarm, watch: Watch) -> list[str]:
    what, known = alarm_text(alarm), []
    if source := source_text(alarm, watch):
        known.append(f"alarm of the {source}" if alarm.source in watch.residuals else f"alarm of {source}")
    is_told = alarm.last is not None and "onset_s" in alarm.last.parameters
    if not is_told and (alarm.last is not None or began_s(alarm) < alarm.time_s):
        known.append(f"since about {began_s(alarm):.2f} s")
    if alarm.isolated_s is not None:
        known.append(f"named at {alarm.isolated_s:.2f} s")
    elif alarm.last is not None and alarm.last.time_s > alarm.time_s:
        known.append(f"as known at {alarm.last.time_s:.2f} s")
    if alarm.ended_s is not None:
        known.append(f"{'calm' if alarm.doubt else 'gone'} since {alarm.ended_s:.2f} s")
    elif alarm.candidates:
        known.append("its end was not seen")
    if disarmed := disarmed_by(alarm, watch):
        known.append(f"no longer watched: {', '.join(disarmed)}")
    return [f"{alarm.time_s:.2f} s  {what}", *([f"    {'; '.join(known)}"] if known else [])]


def _excursion_lines(watched: WatchedLog) -> list[str]:
    """Say where motion, or what the log tells of, lets nothing be told, a line a reason."""
    silent = [excursion for excursion in watched.excursions if not excursion.is_judged]
    total_s = sum(len(watch.record) * watch.record.sample_period_s for watch in watched.watches)
    lines = []
    for reason in dict.fromkeys(excursion.reason for excursion in silent):
        own = [(excursion.start_s, excursion.end_s) for excursion in silent if excursion.reason == reason]
        share = 100.0 * sum(end_s - start_s for start_s, end_s in own) / max(total_s, 1e-9)
        lines.append(f"not judged, {reason}: {_spans(own)} ({share:.2g} % of what was left to watch)")
    return lines


def _worth_lines(watched: WatchedLog) -> list[str]:
    """Say how few false alarms the length watched shows, and what a silence doesn't tell."""
    bound, passed = alarm_bound(watched), passed_alarms(watched)
    if bound is None:
        return ["no false alarm rate is bounded: at no time was an alarm possible"]
    alarms = f"{counted(passed, 'alarm')} that nothing explains" if passed else "no false alarm"
    told = f"{alarms} in {duration_text(watched.armed_hours)} watched"
    if not watched.check.passed:
        return [f"{told}, which says nothing"]
    lines = [f"{told}: at most {bound:.{int(bound < 10.0)}f} false alarms an hour at 95 %"]
    if watched.verdict.outcome is Outcome.HEALTHY and not suspects_of(watched.monitor):
        lines.append("a fault that it cannot detect, or that was there before, is not found")
    return lines

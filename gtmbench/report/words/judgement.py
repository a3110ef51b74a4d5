"""Faults, alarms and judgements in words, and what happened when: the log of events of a recording."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence

from gtmbench.channels import unit_of
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.protocol import Watch
from gtmbench.faults.fault import Fault
from gtmbench.faults.registry import loaded_faults
from gtmbench.report.scores import norm_of
from gtmbench.report.words.units import per_second, with_error
from gtmbench.study.score import first_after
from gtmbench.study.trial import Injection, Trial

Event = tuple[float, str, str]  # time in seconds, severity, text
MOST_ALARMS = 100  # that are told: a function may call every sample above a threshold one


def severity_text(trial: Injection) -> str:
    """Write a trial's severity with its unit: ``0.05 deg/s²``; empty for a fault without one."""
    return _severities(trial.injected)


def fault_text(fault: Fault) -> str:
    """Name a fault with its channel and its severity.

    >>> from gtmbench.faults.kinds import Drift, Jam
    >>> fault_text(Drift(channel="p", onset_s=300, slope=0.05)), fault_text(Jam(channel="q", onset_s=300))
    ('drift of p, 0.05 deg/s²', 'jam of q')
    """
    what = f"{fault.kind.replace('_', ' ')} of {fault.channel}"
    return ", ".join(part for part in (what, _severities(fault)) if part)


def _severities(fault: Fault) -> str:
    unit, values = unit_of(fault.channel), fault.severities
    of = {item.name: per_second(unit) if item.per_second else unit for item in fault.parameters()}
    return ", ".join(f"{value:.3g} {of[name]}".rstrip() for name, value in values.items())


def trial_label(trial: Injection) -> str:
    """Name a trial among those of its scenario: ``q, 0.05 deg/s²``."""
    severity = severity_text(trial)
    return f"{trial.channel}, {severity}" if severity else trial.channel


def repetitions(trials: Sequence[Injection]) -> list[int]:
    """Return for every trial of a detector how many before it broke the same channel in the same scenario."""
    often = Counter[tuple[str, str]]()
    counts = []
    for trial in trials:
        counts.append(often[trial.scenario, trial.channel])
        often[trial.scenario, trial.channel] += 1
    return counts


def estimate_text(
    kind: str,
    parameters: Mapping[str, float],
    errors: Mapping[str, float],
    unit: str,
    injected: Fault | None = None,
) -> str:
    """Write the parameters of a kind of fault with their standard errors; times are left out.

    Of a kind that only the `injected` fault knows, its declaration tells the units; otherwise there are none.

    >>> estimate_text("drift", {"slope": 0.04991, "onset_s": 299.9}, {"slope": 0.00012}, "deg/s")
    '0.0499 ± 0.0001 deg/s²'
    >>> estimate_text("wobble", {"depth": 2.0}, {}, "deg/s")
    '2'
    """
    known = injected if injected is not None and injected.kind == kind else loaded_faults().get(kind)
    slopes = {item.name for item in known.parameters() if item.per_second} if known else set()
    parts = []
    for name, value in parameters.items():
        if not name.endswith("_s"):
            of = per_second(unit) if name in slopes else unit if known else ""
            parts.append(f"{with_error(value, errors.get(name, math.nan))} {of}".rstrip())
    return ", ".join(parts)


def judgement_text(judged: Judgement) -> str:
    """Say what a judgement says: who, and what kind of fault with which parameters."""
    if judged.sensor is not None:
        who = f"{judged.sensor} failed"
    else:
        who = f"undecided: {' or '.join(judged.candidates)}" if judged.candidates else "nothing is left to explain"
    if judged.kind is None:
        return who
    likeliest = judged.candidates[0] if judged.candidates else ""
    estimate = estimate_text(judged.kind, judged.parameters, judged.errors, unit_of(likeliest))
    return f"{who}; {judged.kind.replace('_', ' ')} {estimate}".rstrip()


def alarm_text(alarm: Alarm) -> str:
    """Say what is known of an alarm at the end: as its last judgement does, or that it is one."""
    return "alarm" if alarm.last is None else judgement_text(alarm.last)


def source_text(alarm: Alarm, watch: Watch) -> str:
    """Say what rose: ``residual of p, mean 0.16 s``; nothing of a detector with one score, or none, and one test."""
    if len(watch.scores) < 2 and not alarm.test:
        return ""
    source = f"residual of {alarm.source}" if alarm.source in watch.residuals else alarm.source
    return f"{source}, {alarm.test}" if alarm.test else source


def counting_alarm(trial: Trial) -> Alarm | None:
    """Return the alarm that counts: the first after the onset, or the one that first told of the same fault."""
    told = first_after(trial.watch.alarms, trial.onset_s)
    return None if told is None else next(alarm for alarm in trial.watch.alarms if alarm.number == told.fault)


def trial_events(trial: Trial) -> list[Event]:
    """Return a trial's onset, alarms with what became of them, ends, and misses.

    A detector that names no sensor says the same again with every alarm, so of those after the onset one is told.
    """
    what, onset_s = f"{trial.fault.replace('_', ' ')} of {trial_label(trial)}", trial.onset_s
    events: list[Event] = [(onset_s, "WARN", f"onset: {what}")]
    if trial.injected.duration_s is not None:
        events.append((onset_s + trial.injected.duration_s, "WARN", f"end of the {what}"))
    counting = counting_alarm(trial)
    told = [
        alarm
        for alarm in trial.watch.faults
        if trial.watch.monitor.suspects or alarm.time_s < onset_s - 1e-9 or alarm is counting
    ]
    for alarm in told[:MOST_ALARMS]:
        early = alarm.time_s < onset_s - 1e-9
        alarmed = f"alarm: {what}" if norm_of(trial.watch) else "alarm"  # norms of all trials share a log
        late = f"{alarmed}, {alarm.time_s - onset_s:.2f} s after the onset"
        events += alarm_events(alarm, trial.watch, "false alarm" if early else late)
    if trial.detected and counting is not None and counting.time_s < onset_s - 1e-9:
        late = f"{trial.detection_delay_s:.2f} s after the onset, counted to the false alarm of {counting.time_s:.2f} s"
        events.append((onset_s + (trial.detection_delay_s or 0.0), "ERROR", f"alarm: {what}, {late}"))
    if not trial.detected:
        events.append((trial.record.end_s, "CRITICAL", f"missed: {what}; {trial.reason}"))
    return events


def watch_events(watches: Sequence[Watch], what: str = "alarm") -> list[Event]:
    """Return the alarms of watches that first told of a fault, with what became of them."""
    told = [(alarm, watch) for watch in watches for alarm in watch.faults]
    return [event for alarm, watch in told[:MOST_ALARMS] for event in alarm_events(alarm, watch, what)]


def alarm_events(alarm: Alarm, watch: Watch, what: str) -> list[Event]:
    """Return an alarm, every change of judgement after it, and the fault's end."""
    source = source_text(alarm, watch)
    events: list[Event] = [(alarm.time_s, "ERROR", f"{what}: {source}" if source else what)]
    before = None
    for judged in alarm.judgements:
        now = judged.sensor, judged.candidates, judged.kind
        if now != before:
            events.append((judged.time_s, "INFO", judgement_text(judged)))
        before = now
    if alarm.last is not None and events[-1][0] < alarm.last.time_s:
        events.append((alarm.last.time_s, "INFO", f"last word: {alarm_text(alarm)}"))
    if alarm.ended_s is not None and alarm.end_known_s is not None:
        events.append((alarm.end_known_s, "INFO", f"the fault has gone, since {alarm.ended_s:.2f} s"))
    return events

"""What happened when, in words: the log of events of a recording."""

from __future__ import annotations

from collections.abc import Sequence

from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Watch
from gtmbench.report.scores import norm_of
from gtmbench.report.words.study import alarm_text, counting_alarm, judgement_text, trial_label
from gtmbench.study.trial import Trial

Event = tuple[float, str, str]  # time in seconds, level, text
MOST_ALARMS = 100  # that are told: a function may call every sample above a threshold one


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


def source_text(alarm: Alarm, watch: Watch) -> str:
    """Say what rose: ``residual of p, mean 0.16 s``; nothing of a detector with one score, or none, and one test."""
    if len(watch.scores) < 2 and not alarm.test:
        return ""
    source = f"residual of {alarm.source}" if alarm.source in watch.residuals else alarm.source
    return f"{source}, {alarm.test}" if alarm.test else source

"""What happened when: onsets, alarms, ends and misses, as a recording's log of events tells them."""

from __future__ import annotations

from collections.abc import Sequence

from gtmbench.bench.loop_flight import DEPARTURE, ENVELOPE, OUT_OF_LOOP, LoopEvent
from gtmbench.detectors.accommodation.without_sensor import GIVEN_BACK, OUT_OF_DATE, REPLACED, SUSPECTED, UNCERTAIN
from gtmbench.detectors.alarm import Alarm
from gtmbench.detectors.protocol import Watch
from gtmbench.faults.fault import Fault
from gtmbench.report.style import norm_of
from gtmbench.report.words.judgement import alarm_text, fault_text, judgement_text, source_text
from gtmbench.study.score import first_after
from gtmbench.study.trial import Trial
from gtmbench.values.channels import unit_of

Event = tuple[float, str, str]  # time in seconds, severity, text
MOST_ALARMS = 100  # that are told: a function may call every sample above a threshold one
_FLOWN_ON = {
    SUSPECTED: "suspected: flown on only as far as the other sensors agree",
    REPLACED: "flown without: the others stand in for it",
    GIVEN_BACK: "flown on again",
    OUT_OF_DATE: "its stand-in is out of date: zero is flown",
    UNCERTAIN: "its stand-in may be off by so much",
}


def counting_alarm(trial: Trial) -> Alarm | None:
    """Return the alarm that counts: the first after the onset, or the one that first told of the same fault."""
    told = first_after(trial.watch.alarms, trial.onset_s)
    return None if told is None else next(alarm for alarm in trial.watch.alarms if alarm.number == told.fault)


def trial_events(trial: Trial) -> list[Event]:
    """Return a trial's onsets, alarms, ends and misses; of alarms that name no sensor one after the onset is told."""
    what, onset_s = fault_text(trial.injected), trial.onset_s
    events = _fault_events(what, trial.injected)
    for fault in trial.also:
        events += _fault_events(fault_text(fault), fault)
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
    events += [(event.time_s, "WARN", loop_text(event)) for event in trial.events]
    if not trial.detected:
        events.append((trial.record.end_s, "CRITICAL", f"missed: {what}; {trial.reason}"))
    return events


def loop_text(event: LoopEvent) -> str:
    """Say what happened in a loop.

    >>> loop_text(LoopEvent(time_s=20.4, kind="departure", channel="alpha", value=15.2))
    'departure: alpha is 15.2 deg'
    """
    if event.kind == OUT_OF_LOOP:
        return f"the autopilot doesn't read {event.channel}: the fault changes no flight"
    if event.kind in _FLOWN_ON:
        return f"{event.channel} is {_FLOWN_ON[event.kind]}"
    what = {DEPARTURE: "departure", ENVELOPE: "end of the flight, out of the envelope"}.get(event.kind, event.kind)
    value = "" if event.value is None else f" is {event.value:.4g} {unit_of(event.channel)}".rstrip()
    return f"{what}: {event.channel}{value}"


def _fault_events(what: str, fault: Fault) -> list[Event]:
    events: list[Event] = [(fault.onset_s, "WARN", f"onset: {what}")]
    if fault.duration_s is not None:
        events.append((fault.onset_s + fault.duration_s, "WARN", f"end of the {what}"))
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
        now = judged.sensor, judged.candidates, judged.kind, judged.partner, judged.reason, judged.doubt
        if now != before:
            events.append((judged.time_s, "INFO", judgement_text(judged)))
        before = now
    if alarm.last is not None and events[-1][0] < alarm.last.time_s:
        events.append((alarm.last.time_s, "INFO", f"at the end: {alarm_text(alarm)}"))
    if alarm.ended_s is not None and alarm.end_known_s is not None:
        what = "it is calm again" if alarm.doubt else "the fault has gone"
        events.append((alarm.end_known_s, "INFO", f"{what}, since {alarm.ended_s:.2f} s"))
    return events

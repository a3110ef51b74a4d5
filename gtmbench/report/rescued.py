"""What figure and recording of a rescue share: what is shown of it, in which colours, and its moments in words."""

from __future__ import annotations

from gtmbench.bench.loop_flight import DEPARTURE, ENVELOPE
from gtmbench.detectors.accommodate import REPLACED, SUSPECTED
from gtmbench.report.words.judgement import fault_text
from gtmbench.study.rescue import Rescue
from gtmbench.values.record import Record, Span

TINTS = {"unaided": "#d62728", "rescued": "#1f77b4"}
_BEFORE_S = 5.0  # the onset: where what is shown begins

Moment = tuple[float, str]  # a time in seconds, and what happened then


def shown_s(rescue: Rescue) -> Span:
    """Return the span that is shown: from just before the onset on."""
    return max(rescue.onset_s - _BEFORE_S, 0.0), rescue.rescued.truth.end_s


def shown_flight(rescue: Rescue, name: str) -> Record:
    """Return the truth of one of the flights, over that span, as far as it was flown."""
    (start_s, end_s), truth = shown_s(rescue), rescue.flights[name].truth
    return truth.between(start_s, min(end_s, truth.end_s))


def moments(rescue: Rescue) -> dict[str, list[Moment]]:
    """Return of either flight what is marked on its way: how it ends, and when the broken sensor was told.

    Times are told after the onset.
    """
    broken, since = {fault.channel for fault in rescue.faults}, rescue.onset_s
    words = {SUSPECTED: "alarm: {} is suspected", REPLACED: "{} is flown without", DEPARTURE: "departure"}
    told: dict[str, list[Moment]] = {name: [] for name in rescue.flights}
    for name, flight in rescue.flights.items():
        seen = set()
        for event in flight.events:
            is_told = event.kind in (DEPARTURE, ENVELOPE) or (event.channel in broken and event.kind in words)
            if is_told and event.kind not in seen:
                seen.add(event.kind)
                text = words.get(event.kind, "end of the model's range").format(event.channel)
                told[name].append((event.time_s, f"{text}, {event.time_s - since:.2f} s"))
    told["unaided"].insert(0, (since, "; ".join(fault_text(fault) for fault in rescue.faults)))
    return told

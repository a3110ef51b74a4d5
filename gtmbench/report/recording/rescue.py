"""The recording of a rescue: two aircraft with the same fault, one of them flown without the sensor that is named.

==========================================  ===========================================================
entity, of ``unaided`` and ``rescued``      holds
==========================================  ===========================================================
``/path/NAME``, ``/attitude/NAME``          the way flown in ft (north, east, down), the aircraft, moments
``/broken/CHANNEL/NAME``                    the true value of a broken channel
``/broken/CHANNEL/read``                    what its sensor read on the rescued flight
``/bank/NAME``, ``/altitude/NAME``          deg, ft
``/levels/SCORE``, ``/threshold``           of the monitor, on the rescued flight
``/events``                                 onsets, alarms, judgements, what was done, departures
==========================================  ===========================================================
"""

from __future__ import annotations

from pathlib import Path

import rerun.blueprint as rrb

from gtmbench.report.figures.rescue import TINTS, moments, shown_flight, shown_s
from gtmbench.report.recording.blueprint import event_log, opened, plot
from gtmbench.report.recording.entities import entity, in_unit, lighter, recorded
from gtmbench.report.recording.flight import log_scene
from gtmbench.report.scene import Scene
from gtmbench.report.style import SHOWN_LEVELS, part, tints
from gtmbench.report.words.judgement import Event, fault_text, loop_text, watch_events
from gtmbench.study.rescue import Rescue


def write_rescue_recording(rescue: Rescue, path: Path) -> None:
    """Write both flights with a blueprint; every viewer of the same rerun version opens them beside each other."""
    broken = ", ".join(fault_text(fault) for fault in rescue.faults)
    span, marked = shown_s(rescue), moments(rescue)
    with recorded(path, f"gtmbench fly --rescue: {broken}", _blueprint(rescue)) as recording:
        scenes = [
            Scene(flight=shown_flight(rescue, name), name=name, tint=TINTS[name], moments=marked[name])
            for name in rescue.flights
        ]
        log_scene(recording, *scenes)
        for root, channel in _plotted(rescue).items():
            for scene in scenes:
                line, label = (scene.flight.time_s, scene.flight[channel]), in_unit(f"{scene.name}: {channel}", channel)
                recording.log_line(entity(root, scene.name), line, label, scene.tint, channel=channel)
        sensed = rescue.rescued.sensed
        for channel in _broken(rescue):
            read, label = part(sensed.time_s, sensed[channel], span), in_unit(f"rescued: {channel} as read", channel)
            recording.log_line(f"/broken/{channel}/read", read, label, lighter(TINTS["rescued"]), channel=channel)
        colours = tints(rescue.watch)
        recording.log_judged("", [rescue.watch], {name: colours[name] for name in rescue.watch.scores}, span=span)
        recording.log_threshold(span)
        recording.log_events("/events", _events(rescue))


def _plotted(rescue: Rescue) -> dict[str, str]:
    """Return the channels that both flights are compared by, and where they stand."""
    return {f"/broken/{channel}": channel for channel in _broken(rescue)} | {"/bank": "phi", "/altitude": "altitude"}


def _broken(rescue: Rescue) -> list[str]:
    return list(dict.fromkeys(fault.channel for fault in rescue.faults))


def _events(rescue: Rescue) -> list[Event]:
    events: list[Event] = [(fault.onset_s, "WARN", f"onset: {fault_text(fault)}") for fault in rescue.faults]
    for name, flight in rescue.flights.items():
        level = "CRITICAL" if name == "unaided" else "WARN"
        events += [(event.time_s, level, f"{name}: {loop_text(event)}") for event in flight.events]
    return events + watch_events([rescue.watch])


def _blueprint(rescue: Rescue) -> rrb.Blueprint:
    span = shown_s(rescue)
    plots = [plot(in_unit(channel, channel), [f"{root}/**"], span) for root, channel in _plotted(rescue).items()]
    plots.append(plot("test statistics: an alarm above 1", ["/levels/**", "/threshold"], span, top=SHOWN_LEVELS))
    path = rrb.Spatial3DView(name="flight path (ft), the aircraft drawn large", origin="/path")
    attitude = rrb.Spatial3DView(name="attitude: unaided red, rescued blue", origin="/attitude")
    seen = rrb.Vertical(path, rrb.Horizontal(attitude, event_log("/events")), row_shares=[3, 2])
    return opened(rrb.Horizontal(seen, rrb.Vertical(*plots), column_shares=[3, 2], name="Rescue"))

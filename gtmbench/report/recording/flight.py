"""A flight's channels, the way flown, and the aircraft on it and from near by; and the recording of a rescue.

A rescue is two aircraft with the same fault, one of them flown without the sensor that is named.

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

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gtmbench.report.figures.rescue import AIRCRAFT, TINTS, Scene, moments, shown_flight, shown_s
from gtmbench.report.recording.blueprint import event_log, opened, plot
from gtmbench.report.recording.entities import GROUPS, Recording, entity, in_unit, lighter, recorded, rgb, times
from gtmbench.report.style import SHOWN_LEVELS, colour, part, tints
from gtmbench.report.words.events import Event, loop_text, watch_events
from gtmbench.report.words.judgement import fault_text
from gtmbench.study.run import Rescue
from gtmbench.values.channels import ATTITUDE, SURFACES
from gtmbench.values.record import Record

_STEP = 10  # samples between two poses: 10 a second
_AXES = [150, 150, 150]  # grey
_TINTS = {"fuselage": [170, 180, 190], "wing": [255, 170, 60], "fin": [214, 39, 40]}  # red, green, blue


def log_sensors(recording: Recording, flight: Record, healthy: Record) -> None:
    """Log ``/truth/GROUP``, ``/sensors/GROUP`` and ``/surfaces``."""
    for group, members in GROUPS.items():
        _log_group(recording, f"/truth/{group}", flight, members, " true")
        _log_group(recording, f"/sensors/{group}", healthy, members, " measured", pale=True)
    _log_group(recording, "/surfaces", flight, SURFACES)


def _log_group(
    recording: Recording, entity: str, record: Record, members: Sequence[str], suffix: str = "", *, pale: bool = False
) -> None:
    channels = [name for name in members if name in record]
    if channels:
        tints = [lighter(colour(name, i)) if pale else colour(name, i) for i, name in enumerate(channels)]
        names = [in_unit(f"{name}{suffix}", name) for name in channels]
        recording.log_lines(entity, record.time_s, record.matrix(channels), names, tints, channels=channels)


def log_scene(recording: Recording, *scenes: Scene) -> None:
    """Log ``/path`` (north, east and down in ft, with the aircraft on it) and ``/attitude`` (the aircraft alone).

    Of several scenes each has its own, ``/path/NAME``, and the aircraft stand beside each other in ``/attitude``.
    """
    # the aircraft's size on the path, so that it is seen where the whole path fits
    size = max(0.12 * max(float(np.ptp(scene.place_ft, axis=0).max()) for scene in scenes), 1.0)
    for root in ("/path", "/attitude"):
        recording.stream.log(root, rr.ViewCoordinates.RIGHT_HAND_Z_DOWN, static=True)
    _log_axes(recording, "/path/axes", 0.8 * size)
    _log_axes(recording, "/attitude/axes", 0.8)
    for i, scene in enumerate(scenes):
        below, shown = f"/{scene.name}" * bool(scene.name), slice(None, None, _STEP)
        when, place = times(scene.flight.time_s[shown]), scene.place_ft[shown]
        turn = scene.turned(shown)
        way = rr.LineStrips3D([place], colors=[rgb(scene.tint)], radii=rr.Radius.ui_points(1.5))
        recording.stream.log(f"/path{below}/flown", way, static=True)
        _log_moments(recording, f"/path{below}/moments", scene, 0.7 * size * (1.0 if i % 2 == 0 else -1.0))
        heading = np.deg2rad(scene.flight["psi"][0])
        beside = 1.3 * (i - (len(scenes) - 1) / 2.0) * np.array([-np.sin(heading), np.cos(heading), 0.0])
        tints = _TINTS | ({"wing": rgb(scene.tint), "fin": rgb(scene.tint)} if scene.name else {})
        for root, scale, moved in (("/path", size, place), ("/attitude", 1.0, np.zeros_like(place) + beside)):
            entity = f"{root}{below}/aircraft"
            recording.stream.log(entity, _aircraft(scale, tints), static=True)
            poses = rr.Transform3D.columns(translation=moved, quaternion=turn)
            recording.stream.send_columns(entity, indexes=[when], columns=poses)


def _log_moments(recording: Recording, entity: str, scene: Scene, apart_ft: float) -> None:
    """Log points on the way, each from its time on; what happened then stands in lines so far apart, downwards."""
    tint = rgb(scene.tint)
    for i, (time_s, text) in enumerate(scene.moments, 1):
        place = scene.place_ft[scene.row(time_s)]
        words = place + i * np.array([0.0, 0.0, apart_ft])
        recording.set_time(time_s)
        recording.stream.log(f"{entity}/{i}", rr.Points3D([place], colors=[tint], radii=rr.Radius.ui_points(5.0)))
        told = rr.Points3D([words], labels=[text], colors=[tint], radii=rr.Radius.ui_points(0.5), show_labels=True)
        recording.stream.log(f"{entity}/{i}/told", told)


def log_attitude(recording: Recording, segments: Sequence[Record]) -> None:
    """Log ``/attitude``, the aircraft of a log as it is turned, as far as the log has phi, theta and psi."""
    recording.stream.log("/attitude", rr.ViewCoordinates.RIGHT_HAND_Z_DOWN, static=True)
    recording.stream.log("/attitude/aircraft", _aircraft(1.0, _TINTS), static=True)
    _log_axes(recording, "/attitude/axes", 0.8)
    samples = sum(map(len, segments))
    for flight in segments:
        step = max(round(0.1 / flight.sample_period_s), samples // 20_000, 1)
        shown = slice(None, None, step)
        known = np.isfinite(flight.matrix(ATTITUDE)[shown]).all(axis=1)
        if known.any():
            poses = rr.Transform3D.columns(quaternion=Scene(flight=flight).turned(shown)[known])
            recording.stream.send_columns(
                "/attitude/aircraft", indexes=[times(flight.time_s[shown][known])], columns=poses
            )


def _log_axes(recording: Recording, entity: str, length: float) -> None:
    """Log which way is north, east and down."""
    arrows = rr.Arrows3D(
        vectors=length * np.eye(3), labels=["north", "east", "down"], colors=[_AXES], radii=rr.Radius.ui_points(1.0)
    )
    recording.stream.log(entity, arrows, static=True)


def _aircraft(scale: float, tints: Mapping[str, list[int]]) -> rr.Mesh3D:
    triangles = np.concatenate(list(AIRCRAFT.values()))
    corners = scale * triangles.reshape(-1, 3)
    normals = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    lengths = np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-12)
    return rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=np.arange(len(corners)).reshape(-1, 3),
        vertex_normals=np.repeat(normals / lengths, 3, axis=0),
        vertex_colors=[tints[part] for part, of in AIRCRAFT.items() for _ in range(3 * len(of))],
    )


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

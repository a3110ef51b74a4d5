"""A flight's channels, the way flown, and the aircraft on it and from near by."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import rerun as rr

from gtmbench.report.recording.entities import GROUPS, Recording, in_unit, lighter, rgb, times
from gtmbench.report.scene import AIRCRAFT, Scene
from gtmbench.report.style import colour
from gtmbench.values.channels import ATTITUDE, SURFACES
from gtmbench.values.record import Record

_STEP = 10  # samples between two poses: 10 a second
_SHARE_OF_PATH = 0.12  # the aircraft's size on the path, so that it is seen where the whole path fits
_POSE_S, _MOST_POSES = 0.1, 20_000  # of a log
_AXES = [150, 150, 150]
_TINTS = {"fuselage": [170, 180, 190], "wing": [255, 170, 60], "fin": [214, 39, 40]}


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
    size = max(_SHARE_OF_PATH * max(float(np.ptp(scene.place_ft, axis=0).max()) for scene in scenes), 1.0)
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
        step = max(round(_POSE_S / flight.sample_period_s), samples // _MOST_POSES, 1)
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

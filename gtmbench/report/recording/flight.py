"""The flight that a study's trials share: its channels, the way flown, and the aircraft on it and from near by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import rerun as rr

from gtmbench.channels import SURFACES
from gtmbench.record import FloatArray, Record
from gtmbench.report.recording.entities import GROUPS, in_unit, lighter, log_lines, times
from gtmbench.report.style import colour

_STEP = 10  # samples between two poses: 10 a second
_SHARE_OF_PATH = 0.12  # the aircraft's size on the path, so that it is seen where the whole path fits
# a paper plane in body axes (forward, right, down), wing span about 1: three corners a part
_CORNERS = {
    "fuselage": [[0.6, 0.0, 0.0], [-0.5, -0.06, 0.0], [-0.5, 0.06, 0.0]],
    "wing": [[0.1, 0.0, 0.0], [-0.15, -0.55, 0.0], [-0.15, 0.55, 0.0]],
    "fin": [[-0.3, 0.0, 0.0], [-0.5, 0.0, 0.0], [-0.5, 0.0, -0.22]],
}
_TINTS = {"fuselage": [170, 180, 190], "wing": [255, 170, 60], "fin": [214, 39, 40]}


def log_sensors(recording: rr.RecordingStream, flight: Record, healthy: Record) -> None:
    """Log ``/truth/GROUP``, ``/sensors/GROUP`` and ``/surfaces``."""
    for group, members in GROUPS.items():
        _log_group(recording, f"/truth/{group}", flight, members, " true")
        _log_group(recording, f"/sensors/{group}", healthy, members, " measured", pale=True)
    _log_group(recording, "/surfaces", flight, SURFACES)


def _log_group(
    recording: rr.RecordingStream,
    entity: str,
    record: Record,
    members: Sequence[str],
    suffix: str = "",
    *,
    pale: bool = False,
) -> None:
    channels = [name for name in members if name in record]
    if channels:
        tints = [lighter(colour(name, i)) if pale else colour(name, i) for i, name in enumerate(channels)]
        names = [in_unit(f"{name}{suffix}", name) for name in channels]
        log_lines(recording, entity, record.time_s, record.matrix(channels), names, tints, channels=channels)


def log_scene(recording: rr.RecordingStream, flight: Record) -> None:
    """Log ``/path`` (north, east and down in ft, with the aircraft on it) and ``/attitude`` (the aircraft alone)."""
    shown = slice(None, None, _STEP)
    when = times(flight.time_s[shown])
    place = np.column_stack([flight["north"], flight["east"], flight["altitude"][0] - flight["altitude"]])[shown]
    turn = _quaternions(flight["phi"][shown], flight["theta"][shown], flight["psi"][shown])
    size = max(_SHARE_OF_PATH * float(np.ptp(place, axis=0).max()), 1.0)
    for root in ("/path", "/attitude"):
        recording.log(root, rr.ViewCoordinates.RIGHT_HAND_Z_DOWN, static=True)
    way = rr.LineStrips3D([place], colors=[[120, 160, 220]], radii=rr.Radius.ui_points(1.5))
    recording.log("/path/flown", way, static=True)
    for entity, scale, moved in (("/path/aircraft", size, place), ("/attitude/aircraft", 1.0, np.zeros_like(place))):
        recording.log(entity, _aircraft(scale), static=True)
        poses = rr.Transform3D.columns(translation=moved, quaternion=turn)
        recording.send_columns(entity, indexes=[when], columns=poses)


def _aircraft(scale: float) -> rr.Mesh3D:
    corners = np.concatenate([np.array(part) for part in _CORNERS.values()]) * scale
    tints = [tint for part in _CORNERS for tint in [_TINTS[part]] * 3]
    return rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=np.arange(len(corners)).reshape(-1, 3),
        vertex_colors=tints,
    )


def _quaternions(phi_deg: FloatArray, theta_deg: FloatArray, psi_deg: FloatArray) -> FloatArray:
    """Return body-to-world rotations as x, y, z, w: yaw, then pitch, then roll."""
    from scipy.spatial.transform import Rotation

    angles = np.column_stack([psi_deg, theta_deg, phi_deg])
    return np.asarray(Rotation.from_euler("ZYX", angles, degrees=True).as_quat())

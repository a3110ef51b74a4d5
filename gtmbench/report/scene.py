"""A flight in space: where the aircraft is, how it is turned, and what it is drawn as."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gtmbench.values.record import FloatArray, Record

_SIDES = 10  # of what is round
_NOSE_TO_TAIL = ((0.50, 0.0), (0.47, 0.025), (0.40, 0.05), (0.30, 0.058), (-0.15, 0.058), (-0.40, 0.03), (-0.55, 0.008))
_ENGINE = ((0.13, 0.026), (0.10, 0.032), (0.0, 0.028), (-0.03, 0.018))  # forward, radius
# leading and trailing edge at the root, then at the tip: forward, right, down
_WING = ((0.14, 0.04, 0.025), (-0.10, 0.04, 0.025), (-0.19, 0.52, -0.02), (-0.12, 0.52, -0.02))
_TAIL = ((-0.40, 0.02, -0.02), (-0.53, 0.02, -0.02), (-0.57, 0.19, -0.035), (-0.52, 0.19, -0.035))
_FIN = ((-0.34, 0.0, -0.03), (-0.52, 0.0, -0.03), (-0.58, 0.0, -0.22), (-0.51, 0.0, -0.22))


def _turned(stations: Sequence[tuple[float, float]], right: float = 0.0, down: float = 0.0) -> FloatArray:
    """Return the triangles of a body of revolution about an axis that points forward."""
    angles = 2.0 * np.pi * np.arange(_SIDES + 1) / _SIDES
    rings = [
        np.column_stack([np.full(_SIDES + 1, x), right + radius * np.cos(angles), down + radius * np.sin(angles)])
        for x, radius in stations
    ]
    return np.concatenate(
        [_strip(ring[i : i + 2], other[i : i + 2]) for ring, other in pairwise(rings) for i in range(_SIDES)]
    )


def _strip(one: FloatArray, other: FloatArray) -> FloatArray:
    return np.array([[one[0], one[1], other[0]], [one[1], other[1], other[0]]])


def _flat(*corners: tuple[float, float, float]) -> FloatArray:
    """Return the triangles of a surface with four corners."""
    a, b, c, d = np.array(corners)
    return np.array([[a, b, c], [a, c, d]])


def _both_sides(triangles: FloatArray) -> FloatArray:
    return np.concatenate([triangles, triangles * [1.0, -1.0, 1.0]])


# a twin-engined airliner in body axes (forward, right, down), about 1 long and wide: triangles, shape (n, 3, 3), a part
AIRCRAFT = {
    "fuselage": np.concatenate([_turned(_NOSE_TO_TAIL), _both_sides(_turned(_ENGINE, right=0.17, down=0.05))]),
    "wing": _both_sides(_flat(*_WING)),
    "fin": np.concatenate([_flat(*_FIN), _both_sides(_flat(*_TAIL))]),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A flight to be seen in space."""

    flight: Record
    name: str = ""  # what it is called among others; empty where it is the only one
    # of the way flown, and of the wing where there are several
    tint: str = "#78a0dc"
    moments: Sequence[tuple[float, str]] = ()  # times that are marked on its way, and what happened then

    @property
    def place_ft(self) -> FloatArray:
        """Where it is, north, east and down of where it began, shape (samples, 3)."""
        flight = self.flight
        from_start = [flight[name] - flight[name][0] for name in ("north", "east")]
        return np.column_stack([*from_start, flight["altitude"][0] - flight["altitude"]])

    @property
    def quaternions(self) -> FloatArray:
        """Body-to-world rotations as x, y, z, w: yaw, then pitch, then roll; shape (samples, 4)."""
        return self.turned(slice(None))

    def turned(self, rows: slice) -> FloatArray:
        """Return `quaternions` of some samples."""
        from scipy.spatial.transform import Rotation

        angles = self.flight.matrix(["psi", "theta", "phi"])[rows]
        return np.asarray(Rotation.from_euler("ZYX", angles, degrees=True).as_quat())

    def row(self, time_s: float) -> int:
        """Return the sample at a time."""
        return round((time_s - self.flight.start_s) / self.flight.sample_period_s)

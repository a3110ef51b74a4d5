"""A flight in space: where the aircraft is, how it is turned, and what it is drawn as."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.record import FloatArray, Record

# a paper plane in body axes (forward, right, down), wing span about 1: three corners a part
PLANE = {
    "fuselage": np.array([[0.6, 0.0, 0.0], [-0.5, -0.06, 0.0], [-0.5, 0.06, 0.0]]),
    "wing": np.array([[0.1, 0.0, 0.0], [-0.15, -0.55, 0.0], [-0.15, 0.55, 0.0]]),
    "fin": np.array([[-0.3, 0.0, 0.0], [-0.5, 0.0, 0.0], [-0.5, 0.0, -0.22]]),
}


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """A flight to be seen in space.

    Attributes
    ----------
    flight : Record
    name : str
        What it is called among others; empty where it is the only one.
    tint : str
        Of the way flown, and of the wing where there are several.
    moments : sequence of (float, str)
        Times that are marked on its way, and what happened then.
    """

    flight: Record
    name: str = ""
    tint: str = "#78a0dc"
    moments: Sequence[tuple[float, str]] = ()

    @property
    def place_ft(self) -> FloatArray:
        """Where it is, north, east and down of where it began, shape (samples, 3)."""
        flight = self.flight
        from_start = [flight[name] - flight[name][0] for name in ("north", "east")]
        return np.column_stack([*from_start, flight["altitude"][0] - flight["altitude"]])

    @property
    def quaternions(self) -> FloatArray:
        """Body-to-world rotations as x, y, z, w: yaw, then pitch, then roll; shape (samples, 4)."""
        from scipy.spatial.transform import Rotation

        angles = self.flight.matrix(["psi", "theta", "phi"])
        return np.asarray(Rotation.from_euler("ZYX", angles, degrees=True).as_quat())

    def row(self, time_s: float) -> int:
        """Return the sample at a time."""
        return round((time_s - self.flight.start_s) / self.flight.sample_period_s)

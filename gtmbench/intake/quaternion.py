"""Attitudes that are logged as quaternions, as roll, pitch and yaw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.clock import FloatArray

ANGLES = ("roll", "pitch", "yaw")


def euler_deg(quaternion: Sequence[NDArray[Any]], angle: str) -> FloatArray:
    """Return roll, pitch or yaw in degrees; the quaternion is w, x, y, z, from the body to the world.

    >>> euler_deg([np.array([0.5**0.5]), np.array([0.5**0.5]), np.array([0.0]), np.array([0.0])], "roll").round(9)
    array([90.])
    """
    w, x, y, z = (np.asarray(part, dtype=np.float64) for part in quaternion)
    with np.errstate(all="ignore"):  # a quaternion of zeros has no attitude: NaN
        norm = w * w + x * x + y * y + z * z
        if angle == "roll":
            turned = np.arctan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
        elif angle == "pitch":
            turned = np.arcsin(np.clip(2 * (w * y - x * z) / norm, -1.0, 1.0))
        else:
            turned = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return np.where(np.abs(norm - 1.0) < 0.1, np.degrees(turned), np.nan)

"""Attitudes that are logged as quaternions, as roll, pitch and yaw."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gtmbench.clock import FloatArray


def euler_deg(quaternion: Sequence[NDArray[Any]], angle: int) -> FloatArray:
    """Return roll (0), pitch (1) or yaw (2) in degrees; the quaternion is w, x, y, z, from the body to the world.

    >>> euler_deg([np.array([0.5**0.5]), np.array([0.5**0.5]), np.array([0.0]), np.array([0.0])], 0).round(9)
    array([90.])
    """
    w, x, y, z = (np.asarray(part, dtype=np.float64) for part in quaternion)
    with np.errstate(all="ignore"):  # a quaternion of zeros has no attitude: NaN
        norm = w * w + x * x + y * y + z * z
        if angle == 0:
            turned = np.arctan2(2 * (w * x + y * z), w * w - x * x - y * y + z * z)
        elif angle == 1:
            turned = np.arcsin(np.clip(2 * (w * y - x * z) / norm, -1.0, 1.0))
        else:
            turned = np.arctan2(2 * (w * z + x * y), w * w + x * x - y * y - z * z)
        return np.where(np.abs(norm - 1.0) < 0.1, np.degrees(turned), np.nan)

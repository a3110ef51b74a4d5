"""Features of short windows, for detectors that learn what windows look like: level, spread, trend and roughness."""

from __future__ import annotations

import numpy as np

from gtmbench.detectors.rivals.signals import AIR, body_increments, windows
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray

CHANNELS = (*GYROS, *ATTITUDE, *AIR)
PER_SIGNAL = 4
SIGNALS = 3 + 3 + 2 + 6  # gyros, gyros less the attitude's rates, bank and pitch, air data
FEATURES = SIGNALS * PER_SIGNAL
_BLOCK = 2048  # windows at a time


def features_of(values: FloatArray, rows: int, sample_period_s: float) -> FloatArray:
    """Return mean, deviation, last less first, and mean step of `rows` samples up to each: shape (n, FEATURES).

    Signals are the gyros, these less the attitude's own rates, and the rest but the heading, which runs on; those of a
    signal stand side by side.

    Parameters
    ----------
    values : shape (n, channels)
        Of `CHANNELS`.
    """
    against = values[:, :3] - body_increments(values[:, 3:6]) / sample_period_s
    signals = np.hstack([values[:, :3], against, values[:, 3:5], values[:, 6:]])
    features = np.empty((len(signals), signals.shape[1], PER_SIGNAL))
    recent = windows(signals, rows)
    for first in range(0, len(signals), _BLOCK):
        part = np.ascontiguousarray(recent[first : first + _BLOCK])
        own = features[first : first + _BLOCK]
        own[:, :, 0] = part.mean(axis=2)
        own[:, :, 1] = part.std(axis=2)
        own[:, :, 2] = part[:, :, -1] - part[:, :, 0]
        own[:, :, 3] = np.abs(np.diff(part, axis=2)).mean(axis=2)
    return features.reshape(len(signals), -1)

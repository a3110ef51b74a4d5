"""What rivals make residuals of: rows that look back, attitude increments, standard units, features of windows."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray

AIR = ("alpha", "beta", "nx", "ny", "nz", "tas")
_STEADY = 1e-9  # of its size: a signal that moves less stands still


class Generator(Protocol):
    """What makes residuals of samples as they come in, from those up to now."""

    def push(self, values: FloatArray) -> FloatArray:
        """Return the residuals of the next rows, shape (rows, outputs), NaN where there are none."""


class Lookback:
    """A generator that looks at a bounded number of rows before one.

    Parameters
    ----------
    rows : int
        So many.
    channels : int
        Of what is pushed.
    work : callable
        From rows, (n, channels), to residuals of them all or of the last; those of the first `rows` aren't used, and
        rows before the first are NaN.

    Examples
    --------
    >>> steps = Lookback(1, 1, lambda values: np.diff(values, axis=0, prepend=np.nan))
    >>> [steps.push(np.array(part)).tolist() for part in ([[1.0], [3.0]], [[6.0]])]
    [[[nan], [2.0]], [[3.0]]]
    """

    def __init__(self, rows: int, channels: int, work: Callable[[FloatArray], FloatArray]) -> None:
        self._rows, self._work = rows, work
        self._kept = np.full((rows, channels), np.nan)

    def push(self, values: FloatArray) -> FloatArray:
        """Return the residuals of the next rows."""
        joined = np.concatenate([self._kept, values])
        self._kept = joined[len(joined) - self._rows :]
        with np.errstate(all="ignore"):
            made = self._work(joined)
        return made[len(made) - len(values) :]


def turned(heading_deg: FloatArray) -> FloatArray:
    """Return by how much a heading turned since the row before, whether it runs on or from 360 deg to 0.

    >>> turned(np.array([359.0, 1.0, 0.0])).tolist()
    [nan, 2.0, -1.0]
    """
    steps = np.diff(heading_deg, prepend=np.nan)
    return np.asarray(steps - 360.0 * np.rint(steps / 360.0))


def running(heading_deg: FloatArray) -> FloatArray:
    """Return a heading that runs on, from 0; after missing samples it begins anew.

    >>> running(np.array([350.0, 5.0, np.nan, 20.0, 21.0])).tolist()
    [0.0, 15.0, nan, 15.0, 16.0]
    """
    return np.asarray(np.where(np.isfinite(heading_deg), np.nancumsum(turned(heading_deg)), np.nan))


def body_rates(angles_deg: FloatArray, slopes: FloatArray) -> FloatArray:
    """Return p, q and r of an attitude, shape (rows, 3), in the unit of its slopes.

    Euler kinematics: p = phi' - psi' sin theta, q = theta' cos phi + psi' cos theta sin phi,
    r = psi' cos theta cos phi - theta' sin phi.

    Parameters
    ----------
    angles_deg, slopes : shape (rows, 3)
        phi, theta, psi and their derivatives, or increments.
    """
    phi, theta = np.deg2rad(angles_deg[:, :2].T)
    sin_phi, cos_phi, cos_theta = np.sin(phi), np.cos(phi), np.cos(theta)
    roll, pitch, yaw = slopes.T
    return np.column_stack(
        [
            roll - yaw * np.sin(theta),
            pitch * cos_phi + yaw * cos_theta * sin_phi,
            yaw * cos_theta * cos_phi - pitch * sin_phi,
        ]
    )


def body_increments(angles_deg: FloatArray) -> FloatArray:
    """Return the body rates of an attitude times the sample period, in deg, shape (rows, 3); the first row is NaN.

    Increments since the row before, at the mean attitude of the two: nothing later is looked at.

    >>> body_increments(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])).tolist()[1]
    [1.0, 0.0, 0.0]
    """
    before = np.concatenate([np.full((1, 3), np.nan), angles_deg[:-1]])
    steps = np.column_stack([*(angles_deg - before)[:, :2].T, turned(angles_deg[:, 2])])
    return body_rates((angles_deg + before) / 2.0, steps)


def with_turns(values: FloatArray, channels: Sequence[str]) -> FloatArray:
    """Return channels with the heading, which has no mean, replaced by its increments."""
    if "psi" not in channels:
        return values
    at = list(channels).index("psi")
    return np.column_stack([values[:, :at], turned(values[:, at]), values[:, at + 1 :]])


def windows(values: FloatArray, rows: int) -> FloatArray:
    """Return the last `rows` values up to each row, shape (n, channels, rows); NaN before the first."""
    before = np.full((rows - 1, values.shape[1]), np.nan)
    return np.asarray(sliding_window_view(np.concatenate([before, values]), rows, axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Scale:
    """What brings signals to mean 0 and deviation 1; both of shape (signals,). One that stands still keeps its unit."""

    mean: FloatArray
    deviation: FloatArray

    @classmethod
    def of(cls, values: FloatArray) -> Scale:
        """Return that of some signals, shape (rows, signals), without NaN."""
        mean, deviation = values.mean(axis=0), values.std(axis=0)
        return cls(mean=mean, deviation=np.where(deviation > _STEADY * (1.0 + np.abs(mean)), deviation, 1.0))

    def standard(self, values: FloatArray) -> FloatArray:
        """Return signals in deviations from their mean."""
        return np.asarray((values - self.mean) / self.deviation)


def stacked(parts: Iterable[FloatArray]) -> FloatArray:
    """Return the rows of several arrays that miss nothing."""
    rows = np.concatenate(list(parts))
    return np.asarray(rows[np.isfinite(rows).all(axis=1)])


CHANNELS = (*GYROS, *ATTITUDE, *AIR)
PER_SIGNAL = 4  # features of a window
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

"""Whether further IMUs read what a watched gyro reads while the attitude turns otherwise."""

from __future__ import annotations

import numpy as np

from gtmbench.engine.flight import Flight
from gtmbench.engine.imus.imu import FlightImu
from gtmbench.values.record import BoolArray, FloatArray, Span

_WIDER = 2.0  # times the usual spread
_FEWEST = 20  # blocks of a fit


def _rms(values: FloatArray, rows: BoolArray) -> float:
    """Return the root mean square beside the median of all; NaN, which is never less, of nothing."""
    known = values[rows & np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(known - np.nanmedian(values))))) if len(known) else float("nan")


def apart(flight: Flight, axis: int, rows: BoolArray) -> FloatArray:
    """Return how far each further IMU's gyro is from the watched one in some blocks, shape (imus,), in deg/s."""
    own = flight.blocks.gyros[:, axis]
    return np.array([_rms(imu.gyros[:, axis] - own, rows & flight.judged) for imu in flight.compared])


def factors(own: FloatArray, other: FloatArray, rows: BoolArray) -> Span:
    """Return between which factors one gyro reads another's turns: noise of either makes a fit of it less, or more.

    By least squares of the one on the other, and the other way round (Frisch's bounds).

    >>> turns = np.sin(np.arange(400.0))
    >>> low, high = factors(1.5 * turns, turns, np.ones(400, dtype=bool))
    >>> round(low, 2), round(high, 2)
    (1.5, 1.5)
    >>> noise = np.random.default_rng(1).standard_normal((2, 400))
    >>> low, high = factors(turns + noise[0], turns + noise[1], np.ones(400, dtype=bool))
    >>> low < 1.0 < high
    True
    """
    there = rows & np.isfinite(own) & np.isfinite(other)
    if np.count_nonzero(there) < _FEWEST:
        return -np.inf, np.inf
    (a, shared), (_, b) = np.cov(own[there], other[there])
    if not (a > 0.0 and b > 0.0 and shared != 0.0):
        return -np.inf, np.inf
    low, high = sorted((float(shared / b), float(a / shared)))
    return low, high


def late(flight: Flight, imu: FlightImu) -> float:
    """Return by how many seconds an IMU reads later than the watched one: the median of its axes, by least squares."""
    ahead, behind, further = (np.roll(flight.gyros, by, axis=0) for by in (-1, 1, -2))
    apart = 8.0 * (ahead - behind) - further + np.roll(flight.gyros, 2, axis=0)  # five points: motion lasts few blocks
    slopes = apart / (12.0 * flight.blocks.period_s)
    found = []
    for axis in range(imu.gyros.shape[1]):
        there = flight.judged & np.isfinite(imu.gyros[:, axis])
        columns = np.column_stack([np.ones(len(flight)), flight.gyros, slopes[:, axis]])[there]
        if np.count_nonzero(there) >= _FEWEST:
            found.append(-float(np.linalg.lstsq(columns, imu.gyros[there, axis], rcond=None)[0][-1]))
    return float(np.median(found)) if found else 0.0


def change(flight: Flight, imu: FlightImu, axis: int, rows: BoolArray) -> Span:
    """Return by how much more of the watched gyro's turns an IMU's reads in some blocks than in the rest, at least.

    The first is the least that noise leaves, the second the most.
    """
    own, watched = imu.gyros[:, axis], flight.blocks.gyros[:, axis]
    inside, outside = (factors(own, watched, part & flight.judged) for part in (rows, ~rows))
    return inside[0] - outside[1], inside[1] - outside[0]


def means_part(flight: Flight, imu: FlightImu, axis: int, rows: BoolArray) -> bool:
    """Tell whether means over a second of what two gyros differ by spread more in some blocks than in the rest."""
    apart = imu.gyros[:, axis] - flight.blocks.gyros[:, axis]
    second = np.ones(max(round(1.0 / flight.blocks.period_s), 1))
    means = np.convolve(apart, second / len(second), "same")
    inside, outside = (_usual(means[part & np.isfinite(means)]) for part in (rows, ~rows & flight.judged))
    return inside > _WIDER * outside


def _usual(values: FloatArray) -> float:
    """Return the median distance from the median; NaN, which is never more, of nothing."""
    return float(np.median(np.abs(values - np.median(values)))) if len(values) else float("nan")

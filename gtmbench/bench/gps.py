"""A GPS receiver on a flight: velocity over ground, late, at its own rate, with noise that wanders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.bench.sensors import stream
from gtmbench.bench.slow_sensor import beside, check_beside, is_read
from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.values.channels import GPS_VELOCITY, M_PER_FT
from gtmbench.values.record import FloatArray, Record
from gtmbench.values.recursive_filter import filtered

_LONGEST_DELAY_S = 2.0


@dataclass(frozen=True, kw_only=True)
class Gps:
    """A receiver that reads its velocity over ground.

    With v the velocity along north, east and down, w white noise and c noise that wanders (Gauss-Markov), it reads

        g(k) = v(t(k) - delay) + w(k) + c(k),   E c(t) c(t + s) = wander^2 exp(-s / wander_time).

    Attributes
    ----------
    rate_hz : float
        How often it is read. Rows between two readings are missing (NaN).
    delay_s : float
        How late a reading is, in seconds, at most 2.
    noise_m_s : float
        Standard deviation of the white noise along each axis, in m/s.
    wander_m_s, wander_time_s : float
        Standard deviation of the noise that wanders, in m/s, and its correlation time in seconds.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.Gps(rate_hz=10.0).delay_s
    0.15
    """

    rate_hz: float = 5.0
    delay_s: float = 0.15
    noise_m_s: float = 0.05
    wander_m_s: float = 0.1
    wander_time_s: float = 30.0

    def __post_init__(self) -> None:
        number("rate_hz", self.rate_hz, 0.0, above=True)
        number("delay_s", self.delay_s, 0.0, _LONGEST_DELAY_S)
        number("noise_m_s", self.noise_m_s, 0.0, 1e3)
        number("wander_m_s", self.wander_m_s, 0.0, 1e3)
        number("wander_time_s", self.wander_time_s, 0.0, above=True)


def with_gps(readings: Record, truth: Record, gps: Gps, *, seed: int = 1) -> Record:
    """Return sensor readings with three more channels, gps_north, gps_east, gps_down in m/s.

    Parameters
    ----------
    readings : Record
        As `measure` returns them, broken or not.
    truth : Record
        The flight that they are of, row for row, with north, east and altitude.
    gps : Gps
        Which receiver.
    seed : int
        Of its noise.

    Raises
    ------
    InputError
        If the records don't have the same rows, a position is missing, or the receiver is faster than the record.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.Record([[3.0 * k, 0.0, 100.0] for k in range(6)], channels=["north", "east", "altitude"],
    ...     sample_period_s=0.1)  # 30 ft/s to the north
    >>> perfect = gb.Gps(delay_s=0.0, noise_m_s=0.0, wander_m_s=0.0)
    >>> gb.with_gps(truth, truth, perfect)["gps_north"].round(3).tolist()
    [9.144, nan, 9.144, nan, 9.144, nan]
    """
    seed = whole("seed", seed)
    check_beside(readings, truth, GPS_VELOCITY, "receiver")
    position = truth.matrix(("north", "east", "altitude"))
    if len(truth) < 2 or not np.isfinite(position).all():
        raise InputError("the truth lacks north, east or altitude in some rows, or has one row; a velocity needs two")
    rows, period_s = is_read(truth, gps.rate_hz, "receiver"), truth.sample_period_s
    velocity = np.gradient(position * [M_PER_FT, M_PER_FT, -M_PER_FT], period_s, axis=0)
    time_s = truth.time_s
    late = np.column_stack([np.interp(time_s - gps.delay_s, time_s, along) for along in velocity.T])
    read = late + _noise(gps, len(truth), period_s, seed)
    return beside(readings, GPS_VELOCITY, read, rows)


def _noise(gps: Gps, rows: int, period_s: float, seed: int) -> FloatArray:
    """Return white noise and noise that wanders, shape (rows, 3)."""
    drawn = stream(seed, "gps velocity")
    white, driving = drawn.standard_normal((2, rows, 3))
    kept = np.exp(-period_s / gps.wander_time_s)
    driving[1:] *= np.sqrt(1.0 - kept**2)  # so that it wanders as far at its beginning as later
    wandering = filtered([1.0], [1.0, -kept], driving)
    return np.asarray(gps.noise_m_s * white + gps.wander_m_s * wandering)

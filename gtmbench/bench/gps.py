"""A GPS receiver on a flight: velocity over ground, late, at its own rate, with noise that wanders."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from gtmbench.bench.sensors import stream
from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.values.channels import GPS_VELOCITY
from gtmbench.values.record import FloatArray, Record, check_record

_M_PER_FT = 0.3048
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
    check_record(readings)
    check_record(truth)
    seed = whole("seed", seed)
    period_s = truth.sample_period_s
    if len(readings) != len(truth) or readings.sample_period_s != period_s:
        raise InputError(
            f"the readings have {len(readings)} rows and the truth has {len(truth)}, or their rates differ; give the "
            f"flight that was measured"
        )
    if taken := [name for name in GPS_VELOCITY if name in readings]:
        raise InputError(f"the readings have {', '.join(taken)} already; a record holds one receiver")
    position = truth.matrix(("north", "east", "altitude"))
    if len(truth) < 2 or not np.isfinite(position).all():
        raise InputError("the truth lacks north, east or altitude in some rows, or has one row; a velocity needs two")
    every = 1.0 / (gps.rate_hz * period_s)
    if every < 1.0 - 1e-9:
        raise InputError(
            f"the receiver is read at {gps.rate_hz:g} Hz, the record at {1.0 / period_s:g}; give at most that rate_hz"
        )
    velocity = np.gradient(position * [_M_PER_FT, _M_PER_FT, -_M_PER_FT], period_s, axis=0)
    time_s = truth.time_s
    late = np.column_stack([np.interp(time_s - gps.delay_s, time_s, along) for along in velocity.T])
    read = late + _noise(gps, len(truth), period_s, seed)
    turn = np.floor(np.arange(len(truth)) / every + 1e-6)
    read[np.diff(turn, prepend=-1.0) == 0.0] = np.nan
    return Record(
        np.column_stack([readings.values, read]),
        channels=[*readings.channels, *GPS_VELOCITY],
        sample_period_s=readings.sample_period_s,
        start_s=readings.start_s,
        there=np.column_stack([readings.there, np.isfinite(read)]),
    )


def _noise(gps: Gps, rows: int, period_s: float, seed: int) -> FloatArray:
    """Return white noise and noise that wanders, shape (rows, 3)."""
    from scipy.signal import lfilter  # takes longer to import than all of ours

    drawn = stream(seed, "gps velocity")
    white, driving = drawn.standard_normal((2, rows, 3))
    kept = np.exp(-period_s / gps.wander_time_s)
    driving[1:] *= np.sqrt(1.0 - kept**2)  # so that it wanders as far at its beginning as later
    wandering = lfilter([1.0], [1.0, -kept], driving, axis=0)
    return np.asarray(gps.noise_m_s * white + gps.wander_m_s * wandering)

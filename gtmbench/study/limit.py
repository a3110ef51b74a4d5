"""The limit of quickest detection: how soon anybody could detect a fault at an allowed rate of false alarms.

One gyro and the angle that it turns are one axis. Its model is a random walk that is seen through noise, with the
gyro's noise s_g (deg/s), the angle's noise s_a (deg) and the sample period Ts:

    x(k+1) = x(k) + Ts s_g w(k)        the error of the angle that the gyro's readings are summed to
    y(k)   = x(k) + s_a v(k)           how far the angle that is read differs from it

The steady Kalman filter of this model has white innovations of variance S = P + s_a^2, with
P = q/2 + sqrt(q^2/4 + q s_a^2), q = (Ts s_g)^2 and the gain K = P/S. A fault that changes the readings by f(k) moves
the mean of the innovations by m(k):

    gyro    m(k) = (1 - K) m(k-1) - Ts f(k)           the error is carried on, and the angle pulls it back
    angle   m(k) = (1 - K) m(k-1) + f(k) - f(k-1)     the filter learns a constant error of the angle
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.faults.fault import Fault, inject
from gtmbench.values.channels import ATTITUDE, CHANNELS, GYROS
from gtmbench.values.record import FloatArray, Record, check_record

_ANGLE_OF = dict(zip(GYROS, ATTITUDE, strict=True))
_GYRO_OF = dict(zip(ATTITUDE, GYROS, strict=True))


def detection_limit(
    fault: Fault, record: Record, *, false_alarms_per_hour: float, noise: Mapping[str, float] | None = None
) -> float:
    """Return the delay of quickest detection: what nobody beats on average, even who knows everything but the onset.

    Whoever knows the kinematics, the noise, the fault's shape and size and which sensor it is can sum the
    log-likelihood ratio of the innovations. With one false alarm in T seconds allowed, the alarm comes, to first order
    in log(T/Ts), at the first sample n after the onset k0 with

        sum over k = k0..n of m(k)^2 / (2 S)  >=  log(T / Ts)

    m and S are those of this module's docstring. The bound is Lorden's (1971, "Procedures for reacting to a change in
    distribution", Annals of Mathematical Statistics 42); Moustakides (1986) showed that CUSUM attains it, and Lai
    (1998, IEEE Transactions on Information Theory 44) extended it to changes that vary with time.

    Conditions: the noise is white and Gaussian; the gyro and the angle of its axis are all that is used (air data and
    accelerometers could add a little); the angle is measured by itself, not made of the gyro. It bounds the mean, so
    single flights may be quicker by luck. A fault that draws random numbers, or replaces the reading, is known with its
    draws and with the noise that it removes, which nobody can know: there the bound is lower than what is attainable.

    Parameters
    ----------
    fault : Fault
        Of a gyro (p, q, r) or of an attitude angle (phi, theta, psi).
    record : Record
        Healthy readings, with the fault's channel and what the fault needs.
    false_alarms_per_hour : float
        The allowed rate.
    noise : mapping of channel to float, optional
        Standard deviations of a sample, in the channel's unit; those left out are the T2's.

    Returns
    -------
    float
        Seconds from the onset to the alarm, as `Verdict.detection_delay_s` counts them; infinity where the record ends
        before.

    Raises
    ------
    InputError
        If the fault is of another sensor, its onset lies outside the record, or a figure is invalid.

    Examples
    --------
    >>> import gtmbench as gb
    >>> flight = gb.measure(gb.fly(duration_s=30.0), noise="t2")
    >>> sizes = (0.1, 1.0, 10.0)
    >>> faults = [gb.Bias(channel="p", onset_s=5.0, size=size) for size in sizes]
    >>> [round(gb.detection_limit(fault, flight, false_alarms_per_hour=0.1), 2) for fault in faults]
    [8.69, 0.13, 0.01]
    """
    check_record(record)
    angle = _ANGLE_OF[_gyro(fault)]
    rate = number("false_alarms_per_hour", false_alarms_per_hour, 0.0, 1e6, above=True)
    noises = {name: _noise(name, noise) for name in (_gyro(fault), angle)}
    change = changed_readings(fault, record)
    return limit_of(change, fault.channel, noises, record.sample_period_s, rate)


def changed_readings(fault: Fault, record: Record) -> FloatArray:
    """Return by how much a fault changes its channel from its onset on; infinite where it takes a sample away."""
    readings, first = record[fault.channel], _onset_row(fault, record)
    broken = inject(record, fault)[fault.channel]
    change = np.where(np.isnan(broken) & ~np.isnan(readings), np.inf, np.nan_to_num(broken - readings))
    return np.asarray(change[first:])


def limit_of(
    change: FloatArray,
    channel: str,
    noise: Mapping[str, float],
    sample_period_s: float,
    false_alarms_per_hour: float,
    *,
    pole: float = 0.0,
    information: float = 1.0,
) -> float:
    """Return the delay of quickest detection of a known change; `detection_limit` has equation and conditions.

    Noise of first-order autoregression is whitened on gyro and angle alike, which leaves the kinematics as they are.

    Parameters
    ----------
    change : shape (samples,)
        Of the readings, from the onset on; infinite where a sample is taken away, which is seen at once.
    channel : str
        The gyro or angle that changes.
    noise : mapping of channel to float
        Of the axis's gyro and angle.
    sample_period_s, false_alarms_per_hour : float
    pole : float
        Of the noise's autoregression.
    information : float
        Fisher's information of a shift over that of a Gaussian of the same variance, for small shifts.
    """
    gyro = channel if channel in GYROS else _GYRO_OF[channel]
    white = math.sqrt(1.0 - pole * pole)
    gone = np.isinf(change)
    kept = np.where(gone, 0.0, change)
    fresh = kept - pole * np.concatenate([[0.0], kept[:-1]])
    mean, variance = _innovations(
        fresh, channel in GYROS, white * noise[gyro] * sample_period_s, white * noise[_ANGLE_OF[gyro]], sample_period_s
    )
    asked = math.log(max(3600.0 / (false_alarms_per_hour * sample_period_s), 1.0))
    reached = (information * np.cumsum(np.square(mean)) / (2.0 * variance) >= asked) | gone
    return float(np.argmax(reached) * sample_period_s) if reached.any() else math.inf


def _gyro(fault: Fault) -> str:
    """Return the gyro of a fault's axis."""
    gyro = fault.channel if fault.channel in GYROS else _GYRO_OF.get(fault.channel)
    if gyro is None or len(fault.changes) > 1:
        raise InputError(
            f"the limit is known of one gyro or one attitude angle, and the fault changes {', '.join(fault.changes)}; "
            f"give a fault of {', '.join((*GYROS, *ATTITUDE))}"
        )
    return gyro


def _noise(channel: str, given: Mapping[str, float] | None) -> float:
    return number(f"noise of {channel}", (given or {}).get(channel, CHANNELS[channel].noise), 0.0, 1e6, above=True)


def _onset_row(fault: Fault, record: Record) -> int:
    if not record.start_s <= fault.onset_s <= record.end_s:
        raise InputError(
            f"the fault begins at {fault.onset_s:g} s, outside of the record ({record.start_s:g} to {record.end_s:g} "
            "s); give an onset within it"
        )
    return math.ceil((fault.onset_s - record.start_s) / record.sample_period_s - 1e-6)


def _innovations(
    change: FloatArray, of_gyro: bool, walk: float, angle_noise: float, period_s: float
) -> tuple[FloatArray, float]:
    """Return by how much a change moves the means of the innovations, and their variance."""
    from scipy.signal import lfilter

    q, r = walk**2, angle_noise**2
    ahead = q / 2.0 + math.sqrt(q * q / 4.0 + q * r)
    gain = ahead / (ahead + r)
    # of a gyro the error is carried on; of an angle only what changes is new, and the rest of the last error fades
    driven = -period_s * change if of_gyro else np.diff(change, prepend=0.0)
    return np.asarray(lfilter([1.0], [1.0, gain - 1.0], driven)), ahead + r

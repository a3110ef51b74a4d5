"""Attitude as an aircraft knows it: from its gyros, faulty or not, corrected by an absolute reference."""

from __future__ import annotations

import math

import numpy as np

from gtmbench.bench.sensors import stream
from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.record import FloatArray, Record, check_record

GYROS = ("p", "q", "r")
ATTITUDE = ("phi", "theta", "psi")
STEEPEST_DEG = 85.0  # beyond, tan(theta) exceeds 11 and Euler angles turn faster than samples can follow
FASTEST_DEG_S = 1e6  # no gyro reads this, and no float overflows below

_RAD = math.pi / 180.0


def filtered_attitude(
    record: Record, *, time_constant_s: float, reference_noise_deg: float = 0.5, seed: int = 1
) -> Record:
    """Return the record with phi, theta, psi as a complementary filter estimates them from the record's gyros.

    With x = (phi, theta, psi) and f the kinematics of Euler angles (phi' = p + tan(theta) (q sin(phi) + r cos(phi)),
    theta' = q cos(phi) - r sin(phi), psi' = (q sin(phi) + r cos(phi)) / cos(theta)),

        x(k) = a (x(k-1) + Ts (f1 + f2)/2) + (1 - a) (reference(k) + noise(k)),   a = tau/(tau + Ts),
        f1 = f(x(k-1), gyros(k-1)),   f2 = f(x(k-1) + Ts f1, gyros(k)).

    This is Heun's method: it is of second order and takes the mean of the gyros at both ends of a step, where the
    rectangle with either end would put the attitude half a sample early or late. Sample k depends on the gyros up to
    and including sample k. A steady gyro error of b shifts the attitude by tau b in level flight, so a fault of the
    gyros shows in the attitude, too; the reference's white noise is weakened to sqrt(Ts/(2 tau + Ts)) of itself.

    Parameters
    ----------
    record : Record
        p, q, r in deg/s as measured, broken or not; phi, theta, psi in deg as an absolute reference (accelerometers,
        magnetometer) without error would tell them: put the truth's there, for noise is added here. They are unwrapped:
        a jump through +-180 deg is refused.
    time_constant_s : float
        tau, in seconds: how long the filter trusts the gyros. 0 is the reference itself.
    reference_noise_deg : float
        Standard deviation of the reference's white noise, in degrees. Sample 0 has none: there the filter starts.
    seed : int
        Of the noise. Every angle has a random stream of its own.

    Returns
    -------
    Record
        All channels but phi, theta and psi are unchanged. Where a gyro's sample is missing (NaN), its last rate is
        held, at the start zero; where the reference's is, that angle goes without correction.

    Raises
    ------
    InputError
        Where the record lacks a channel or its first attitude, an argument can't be meant, or theta comes near
        +-90 deg, where Euler angles end.

    Examples
    --------
    >>> import gtmbench as gb
    >>> level = {"p": 2.0, "q": 0.0, "r": 0.0, "phi": 0.0, "theta": 0.0, "psi": 45.0}  # p is off by 2 deg/s
    >>> record = gb.Record([list(level.values())] * 1001, channels=list(level), sample_period_s=0.01)
    >>> attitude = gb.filtered_attitude(record, time_constant_s=0.5, reference_noise_deg=0.0)
    >>> attitude["phi"][[0, 50, 1000]].round(3), attitude["psi"][1000].round(3)
    (array([0.   , 0.628, 1.   ]), np.float64(45.0))
    """
    check_record(record)
    tau = number("time_constant_s", time_constant_s, 0.0)
    deviation = number("reference_noise_deg", reference_noise_deg, 0.0, 180.0)
    seed = whole("seed", seed)
    gyros, reference = record.matrix(GYROS), record.matrix(ATTITUDE)
    _check(gyros, reference, record)
    # names of channels are printable: none has a zero byte, so these streams are no channel's measurement noise
    noise = np.column_stack([stream(seed, f"{name}\0reference").standard_normal(len(record)) for name in ATTITUDE])
    noise[0] = 0.0
    rates = np.column_stack([_held(gyros[:, i]) for i in range(3)])
    told = reference + deviation * noise
    attitude = _filter(rates, told, tau / (tau + record.sample_period_s), record)
    for i, name in enumerate(ATTITUDE):
        record = record.replace(name, attitude[:, i])
    return record


def _filter(rates: FloatArray, told: FloatArray, a: float, record: Record) -> FloatArray:
    """Return the filtered attitude in degrees, shape (samples, 3): the equation of `filtered_attitude`, in floats."""
    ts = record.sample_period_s
    half = 0.5 * ts
    before, *later = rates.tolist()
    phi, theta, psi = told[0].tolist()
    path = [(phi, theta, psi)]
    for k, (now, reference) in enumerate(zip(later, told[1:].tolist(), strict=True), start=1):
        phi_1, theta_1, psi_1 = _euler_rates(phi, theta, *before)
        theta_2 = theta + ts * theta_1
        if abs(theta_2) > STEEPEST_DEG:
            raise _too_steep(theta_2, k, record)
        phi_2, theta_2, psi_2 = _euler_rates(phi + ts * phi_1, theta_2, *now)
        phi = _corrected(phi + half * (phi_1 + phi_2), reference[0], a)
        theta = _corrected(theta + half * (theta_1 + theta_2), reference[1], a)
        psi = _corrected(psi + half * (psi_1 + psi_2), reference[2], a)
        if abs(theta) > STEEPEST_DEG:
            raise _too_steep(theta, k, record)
        path.append((phi, theta, psi))
        before = now
    return np.array(path)


def _euler_rates(phi_deg: float, theta_deg: float, p: float, q: float, r: float) -> tuple[float, float, float]:
    """Return phi', theta', psi' in deg/s."""
    phi, theta = phi_deg * _RAD, theta_deg * _RAD
    sin_phi, cos_phi = math.sin(phi), math.cos(phi)
    turn = (q * sin_phi + r * cos_phi) / math.cos(theta)
    return p + math.sin(theta) * turn, q * cos_phi - r * sin_phi, turn


def _corrected(predicted: float, reference: float, a: float) -> float:
    return predicted if math.isnan(reference) else a * predicted + (1.0 - a) * reference


def _held(rate: FloatArray) -> FloatArray:
    """Return a rate with its last value where a sample is missing, and zero before the first."""
    there = np.isfinite(rate)
    last = np.maximum.accumulate(np.where(there, np.arange(len(rate)), -1))
    return np.where(last < 0, 0.0, rate[np.maximum(last, 0)])


def _check(gyros: FloatArray, reference: FloatArray, record: Record) -> None:
    """Refuse rates and references that the filter can't work with."""
    for i, name in enumerate(GYROS):
        if (np.abs(gyros[:, i]) > FASTEST_DEG_S).any():
            raise InputError(
                f"'{name}' exceeds {FASTEST_DEG_S:g} deg/s; that is no gyro's reading, so correct the record"
            )
    for i, name in enumerate(ATTITUDE):
        angle = reference[:, i]
        if not np.isfinite(angle[:1]).all() or not len(angle):
            raise InputError(
                f"'{name}' has no first sample, where the attitude filter starts; let the record begin later"
            )
        jumps = np.flatnonzero(np.abs(np.diff(angle)) > 180.0)
        if len(jumps):
            raise InputError(
                f"'{name}' jumps by more than 180 deg at {record.time_s[jumps[0] + 1]:g} s; unwrap it with "
                f"np.unwrap({name}, period=360)"
            )


def _too_steep(theta_deg: float, k: int, record: Record) -> InputError:
    return InputError(
        f"theta reaches {theta_deg:.4g} deg at {record.time_s[k]:g} s; the attitude filter's Euler angles end near "
        f"+-90 deg (here at {STEEPEST_DEG:g}); take a shorter time constant or a milder fault"
    )

"""Attitude as an aircraft knows it: from its gyros, faulty or not, corrected by an absolute reference."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np

from gtmbench.bench.sensors import stream
from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.values.attitude_estimators import (
    STEEPEST_DEG,
    AttitudeEstimator,
    carried_on,
    estimator_of,
    less,
    too_steep,
)
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record, check_record

FASTEST_DEG_S = 1e6  # no gyro reads this, and no float overflows below
REFERENCE_NOISE_DEG = 0.5  # of the references of an estimator that is named, at every sample

Filter = Callable[[float, Sequence[float], Sequence[float]], Sequence[float]]


def filtered_attitude(
    record: Record,
    *,
    time_constant_s: float,
    reference_noise_deg: float = 0.5,
    seed: int = 1,
    bias_time_constant_s: float | None = None,
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
    bias_time_constant_s : float, optional
        tau_b: in how long the filter learns a gyro's bias, as a Kalman filter with bias states does; it is taken from
        the gyro's readings: b(k) = b(k-1) - Ts/(tau tau_b) (reference(k) + noise(k) - predicted(k)). By default it
        learns none.

    Returns
    -------
    Record
        All channels but phi, theta and psi are unchanged. Where a gyro's sample is missing (NaN), its last rate is
        held, at the start zero; where the reference's is, that angle goes without correction.

    Raises
    ------
    InputError
        If the record lacks a channel or its first attitude, an argument is invalid, or theta comes near
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
    bias_s = math.inf
    if bias_time_constant_s is not None:
        bias_s = number("bias_time_constant_s", bias_time_constant_s, 0.0, above=True)
    estimator = AttitudeEstimator(time_constant_s=tau, bias_time_constant_s=bias_s)
    gyros, reference = record.matrix(GYROS), record.matrix(ATTITUDE)
    _check(reference, record)
    (noise,) = reference_noise(deviation, seed, len(record), len(record))
    step = filtering(estimator, record.sample_period_s)
    rows = zip(record.time_s.tolist(), gyros.tolist(), (reference + noise).tolist(), strict=True)
    attitude = np.array([step(*row) for row in rows])
    for i, name in enumerate(ATTITUDE):
        record = record.replace(name, attitude[:, i])
    return record


def estimated_attitude(record: Record, truth: Record, attitude: object, seed: int) -> Record:
    """Return readings with the attitude that an estimator makes of their gyros, broken or not.

    >>> import gtmbench as gb
    >>> truth = gb.fly(duration_s=20.0)
    >>> readings = gb.measure(truth, noise="t2", seed=3)
    >>> broken = gb.inject(readings, gb.Bias(channel="p", onset_s=0.0, size=2.0))
    >>> healthy, bent = (estimated_attitude(each, truth, "filter 1 s", 3) for each in (readings, broken))
    >>> (bent["phi"] - healthy["phi"])[-1].round(1), estimated_attitude(broken, truth, "own", 3) is broken
    (np.float64(2.0), True)
    """
    estimator = estimator_of(attitude)
    if estimator is None:
        return record
    for name in ATTITUDE:
        record = record.replace(name, np.unwrap(truth[name], period=360.0))
    bias_s = estimator.bias_time_constant_s
    return filtered_attitude(
        record,
        time_constant_s=estimator.time_constant_s,
        reference_noise_deg=REFERENCE_NOISE_DEG,
        seed=seed,
        bias_time_constant_s=bias_s if math.isfinite(bias_s) else None,
    )


def filtering(estimator: AttitudeEstimator, sample_period_s: float) -> Filter:
    """Return the filter of `filtered_attitude` as a function of one sample after the other.

    It takes a time in seconds, the gyros in deg/s and the reference with its noise in deg, unwrapped, and returns phi,
    theta, psi. The first sample's are the reference's.

    >>> step = filtering(AttitudeEstimator(time_constant_s=0.5), 0.01)
    >>> path = [step(0.01 * k, (2.0, 0.0, 0.0), (0.0, 0.0, 45.0)) for k in range(1001)]  # p is off by 2 deg/s
    >>> [round(angle, 3) for angle in path[1000]]
    [1.0, 0.0, 45.0]
    """
    tau = estimator.time_constant_s
    a = tau / (tau + sample_period_s)
    learning = sample_period_s / (tau * estimator.bias_time_constant_s) if tau else 0.0
    rates: Sequence[float] = (0.0, 0.0, 0.0)
    bias: Sequence[float] = (0.0, 0.0, 0.0)
    angles: Sequence[float] = ()

    def step(time_s: float, gyros: Sequence[float], reference: Sequence[float]) -> Sequence[float]:
        nonlocal rates, bias, angles
        now = [_rate_or_last(*each) for each in zip(GYROS, gyros, rates, strict=True)]
        before, rates = rates, now
        if not angles:
            angles = list(reference)
            return angles
        reached = carried_on(angles, less(before, bias), less(now, bias), sample_period_s)
        pairs = list(zip(reached, reference, strict=True))
        angles = [x if math.isnan(told) else a * x + (1.0 - a) * told for x, told in pairs]
        if max(abs(reached[1]), abs(angles[1])) > STEEPEST_DEG:
            raise too_steep(max(reached[1], angles[1], key=abs), time_s)
        if learning:
            off = [0.0 if math.isnan(told) else told - x for x, told in pairs]
            bias = [before - learning * each for before, each in zip(bias, off, strict=True)]
        return angles

    return step


def reference_noise(deviation_deg: float, seed: int, samples: int, block: int) -> Iterator[FloatArray]:
    """Give the noise of phi, theta and psi as references tell them, in blocks of samples, shape (block, 3).

    >>> [noise.shape for noise in reference_noise(0.5, 1, samples=5, block=3)]
    [(3, 3), (2, 3)]
    """
    # names of channels are printable: none has a zero byte, so these streams are no channel's measurement noise
    drawn = [stream(seed, f"{name}\0reference") for name in ATTITUDE]
    for first in range(0, samples, block):
        rows = min(block, samples - first)
        noise = deviation_deg * np.column_stack([each.standard_normal(rows) for each in drawn])
        if not first:
            noise[0] = 0.0
        yield noise


def _rate_or_last(name: str, rate: float, before: float) -> float:
    """Return a gyro's reading, or its last one where it is missing."""
    if math.isnan(rate):
        return before
    if abs(rate) > FASTEST_DEG_S:
        raise InputError(f"'{name}' exceeds {FASTEST_DEG_S:g} deg/s; that is no gyro's reading, so correct the record")
    return rate


def _check(reference: FloatArray, record: Record) -> None:
    """Refuse references that the filter can't work with."""
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

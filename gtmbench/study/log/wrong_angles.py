"""A gyro of a wrong gain, or an angle: the turns about the other two axes tell, for an angle enters them, too.

A gyro that reads a multiple g of its turn, and an angle that reads 1/g of itself, differ in the same way about the
gyro's own axis. With theta of the turned sign, though, p = phi' - psi' sin(theta) is wrong, too, and so is
r = psi' cos(theta) cos(phi) - theta' sin(phi). So what the other two gyros read beside the attitude's rates grows where
the angle is wrong and is taken as it stands, and where it is right and is taken as wrong.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from gtmbench.method.regression.slow import HALF, interpolated, slow
from gtmbench.study.log.self_check.motion import rates_from, terms_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.values.record import FloatArray, Record, Span

SURE = 3.0  # of the logarithm of the ratio of likelihoods


def for_the_gyro(records: Sequence[Record], axis: int, factor: float, *, healthy: Sequence[Span], since: Span) -> float:
    """Return ln(likelihood that the gyro's gain is `factor`/likelihood that its angle reads 1/`factor` of itself).

    Of what the other two gyros read beside the attitude's rates, as it is, e(k), and with the angle put right, f(k),
    each about its mean, k over samples of slow motion that aren't much alike:
    sum over both gyros of (sum f(k)^2 - sum e(k)^2)/(2 s^2), where s is the deviation of e where healthy, or what the
    better of both leaves if that is more. 0 where nothing is known.

    Parameters
    ----------
    records : sequence of Record
        With p, q, r, phi, theta and psi.
    axis : int
        0, 1, 2: p or phi, q or theta, r or psi.
    factor : float
        The gyro's gain against the attitude, -1 for a turned sign.
    healthy : sequence of (start, end)
    since : (start, end)
        Where it reads so, in seconds.

    Examples
    --------
    >>> time_s = np.arange(0.0, 200.0, 0.1)
    >>> angles = [20.0, 10.0, 30.0] * np.sin(np.outer(time_s, [0.9, 0.7, 0.4]))
    >>> rates = terms_of(angles, 0.1) @ rates_from((1.0, 1.0, 1.0))
    >>> rates += np.random.default_rng(1).standard_normal(rates.shape)
    >>> flight = Record(np.column_stack([rates, angles])[1:-1], channels=[*GYROS, *ATTITUDE], sample_period_s=0.1)
    >>> turned = np.where(flight.time_s < 100.0, 1.0, -1.0)
    >>> spans = {"healthy": [(0.0, 90.0)], "since": (101.0, 120.0)}
    >>> gyro, angle = (flight.replace(name, flight[name] * turned) for name in ("q", "theta"))
    >>> for_the_gyro([gyro], 1, -1.0, **spans) > SURE, for_the_gyro([angle], 1, -1.0, **spans) < -SURE
    (True, True)
    """
    signs = [factor if angle == axis else 1.0 for angle in range(3)]
    others = [other for other in range(3) if other != axis]
    gyros, terms = _moved(records, healthy)
    gyros_now, terms_now = _moved(records, [since])
    if min(len(gyros), len(gyros_now)) < 2 * HALF:
        return 0.0
    known = np.column_stack([terms @ rates_from((1.0, 1.0, 1.0)), np.ones(len(terms))])
    gains = np.linalg.lstsq(known, gyros, rcond=None)[0]
    noise = np.mean(np.square(gyros - known @ gains), axis=0)
    as_it_is, put_right = (
        np.var(gyros_now - terms_now @ rates_from(each) @ gains[:3], axis=0) for each in ([1.0, 1.0, 1.0], signs)
    )
    deviation = np.maximum(noise, np.minimum(as_it_is, put_right))
    told = 0.5 * len(gyros_now) / HALF * (put_right - as_it_is) / deviation
    return float(told[others].sum())


def _moved(records: Sequence[Record], spans: Sequence[Span]) -> tuple[FloatArray, FloatArray]:
    """Return slow motion of the gyros and of the terms of the attitude's rates within spans, where both are known."""
    parts = [
        _slow(record.between(max(first, record.start_s), min(last, record.end_s)))
        for record in records
        for first, last in spans
        if min(last, record.end_s) - max(first, record.start_s) > record.sample_period_s
    ]
    if not parts:
        return np.zeros((0, 3)), np.zeros((0, 6))
    gyros, terms = (np.concatenate(each) for each in zip(*parts, strict=True))
    return gyros, terms


def _slow(record: Record) -> tuple[FloatArray, FloatArray]:
    gyros, terms = record.matrix(GYROS), terms_of(record.matrix(ATTITUDE), record.sample_period_s)
    there = np.isfinite(gyros).all(axis=1) & np.isfinite(terms).all(axis=1)
    return slow(interpolated(gyros))[there], slow(interpolated(terms))[there]

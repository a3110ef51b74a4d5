"""Virtual sensors: what a channel should have read, from the others, while it may be broken."""

from __future__ import annotations

import math

import numpy as np

from gtmbench.checks import meant
from gtmbench.errors import InputError
from gtmbench.method.regression.equations import held
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray, Record

ANGLES = ("phi", "theta", "psi")
_SETTLE = 50  # rows before the start that fix the constant of integration


def integrable(channel: str, channels: tuple[str, ...]) -> bool:
    """Tell whether a channel is an attitude angle that the gyros there can carry on."""
    return channel in ANGLES and {"p", "q", "r", "phi", "theta"} <= set(channels)


def integrated_angle(record: Record, channel: str, start_row: int) -> FloatArray:
    """Return an attitude angle as the gyros carry it on from `start_row`, in deg; before that, as measured.

    phi' = p + tan theta (q sin phi + r cos phi), theta' = q cos phi - r sin phi,
    psi' = (q sin phi + r cos phi) / cos theta, by the trapezoidal rule; the angle's own measurement isn't used from
    there on. Its constant of integration is the mean over the rows before. It drifts with the gyros' noise and bias
    (0.05 deg after 1 s with the T2's noise, as the root of time).

    InputError where the channel isn't phi, theta or psi.

    >>> stuck = Record(np.tile([0.0, 0.0, 2.0, 0.0, 0.0, 7.0], (400, 1)),
    ...                channels=["p", "q", "r", "phi", "theta", "psi"], sample_period_s=0.01)
    >>> integrated_angle(stuck, "psi", 0)[300].round(3)
    np.float64(13.0)
    """
    if channel not in ANGLES:
        raise InputError(f"'{channel}' isn't an attitude angle; there are {', '.join(ANGLES)}{meant(channel, ANGLES)}")
    begin = max(start_row - _SETTLE, 0)
    rows = slice(begin, None)
    p, q, r, phi, theta = held(record.matrix((*GYROS, "phi", "theta"))[rows]).T
    phi, theta = np.deg2rad(phi), np.deg2rad(theta)
    if channel == "phi":
        turned = _rolled(p, q, r, np.tan(theta), float(phi[0]), record.sample_period_s)
    else:
        slope = q * np.cos(phi) - r * np.sin(phi)
        if channel == "psi":
            slope = (q * np.sin(phi) + r * np.cos(phi)) / np.cos(theta)
        steps = 0.5 * (slope[1:] + slope[:-1]) * record.sample_period_s
        turned = np.concatenate([[0.0], np.cumsum(steps)])
    angle = np.array(record[channel])
    settle = max(start_row - begin, 1)
    off = angle[begin : begin + settle] - turned[:settle]
    offset = np.nanmean(off) if np.isfinite(off).any() else 0.0
    angle[start_row:] = (turned + offset)[start_row - begin :]
    return angle


def _rolled(
    p: FloatArray, q: FloatArray, r: FloatArray, tangent: FloatArray, start: float, sample_period_s: float
) -> FloatArray:
    """Return phi in deg: its slope depends on itself, so step by step."""
    step = math.radians(sample_period_s)
    means = [0.5 * (rate[1:] + rate[:-1]) for rate in (p, q, r)]
    at, angles = start, [start]
    for roll, pitch, yaw, tan in zip(*(mean.tolist() for mean in means), tangent.tolist(), strict=False):
        at += step * (roll + tan * (pitch * math.sin(at) + yaw * math.cos(at)))
        angles.append(at)
    return np.asarray(np.rad2deg(angles))

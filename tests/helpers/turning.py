"""Gyros and attitude of one motion, exactly: angles are sums of sines, and body rates follow from their slopes."""

from functools import cache

import numpy as np

import gtmbench as gb
from gtmbench.values.channels import ATTITUDE, GYROS

SENSORS = (*GYROS, *ATTITUDE)
GYRO_NOISE, ANGLE_NOISE = 0.15, 0.03


def angles_and_slopes(time_s, seed, large_deg=(12.0, 8.0, 25.0)):
    """Return phi, theta, psi in deg and their slopes in deg/s, shape (rows, 3) each."""
    random = np.random.default_rng(seed)
    angles, slopes = np.zeros((2, len(time_s), 3))
    for axis, large in enumerate(large_deg):
        omegas = 2.0 * np.pi * random.uniform(0.03, 0.4, 8)
        phases, sizes = random.uniform(0.0, 2.0 * np.pi, 8), large * random.uniform(0.3, 0.6, 8) / 1.4
        turned = np.outer(time_s, omegas) + phases
        angles[:, axis] = np.sin(turned) @ (sizes * 0.5)
        slopes[:, axis] = np.cos(turned) @ (sizes * 0.5 * omegas)
    return angles, slopes


def body_rates(angles, slopes):
    """Return p, q, r in deg/s."""
    phi, theta, _ = np.radians(angles).T
    turned_phi, turned_theta, turned_psi = slopes.T
    return np.column_stack(
        [
            turned_phi - turned_psi * np.sin(theta),
            turned_theta * np.cos(phi) + turned_psi * np.sin(phi) * np.cos(theta),
            -turned_theta * np.sin(phi) + turned_psi * np.cos(phi) * np.cos(theta),
        ]
    )


@cache
def motion(duration_s=120.0, rate_hz=20.0, seed=1, start_s=0.0, noise=1.0, large_deg=(12.0, 8.0, 25.0)):
    """Return a healthy record."""
    time_s = np.arange(round(duration_s * rate_hz) + 1) / rate_hz
    angles, slopes = angles_and_slopes(time_s, seed, large_deg)
    random = np.random.default_rng((seed, round(rate_hz)))
    gyros = body_rates(angles, slopes) + noise * GYRO_NOISE * random.standard_normal(angles.shape)
    told = angles + noise * ANGLE_NOISE * random.standard_normal(angles.shape)
    return gb.Record(np.column_stack([gyros, told]), channels=SENSORS, sample_period_s=1.0 / rate_hz, start_s=start_s)


def with_error(record, sensor, error):
    """Return a record with something added to a sensor: an array, or a function of time."""
    added = error(record.time_s) if callable(error) else error
    return record.replace(sensor, record[sensor] + added)


def from_on(onset_s, size, until_s=np.inf):
    """Return an error that begins, stays and may end."""
    return lambda time_s: np.where((time_s >= onset_s) & (time_s < until_s), size, 0.0)


def clear_at(spans, time_s):
    """Tell whether all that is claimed at a time is that a sensor is clear."""
    own = {span.state.value for span in spans if span.covers(time_s)}
    return own == {"clear"}

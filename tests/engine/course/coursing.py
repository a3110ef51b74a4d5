"""A flight of which every sensor reads what kinematics make of one motion: seconds of it cost milliseconds."""

from functools import cache

import numpy as np

import gtmbench as gb
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.values.attitude_estimators import to_earth
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS, MAGNETOMETER
from tests.helpers.turning import angles_and_slopes, body_rates

G_M_S2, KNOT_M_S, FOOT_M = 9.80665, 1852.0 / 3600.0, 0.3048
WIND_M_S, FIELD = np.array([4.0, -3.0, 0.0]), np.array([20.0, 5.0, 45.0])
STEP_S, FINE = 0.02, 4  # samples; steps of a motion in one
# what each channel's readings scatter by, in its unit
NOISE = (
    dict.fromkeys(GYROS, 0.15)
    | dict.fromkeys(ATTITUDE, 0.03)
    | dict.fromkeys(ACCELEROMETERS, 0.005)
    | dict.fromkeys(GPS_VELOCITY, 0.05)
    | dict.fromkeys(MAGNETOMETER, 0.2)
    | {"tas": 0.3, "alpha": 0.1, "beta": 0.1, "altitude": 1.0}
)


@cache
def coursed(duration_s=100.0, seed=1, noise=1.0, speed_m_s=50.0):
    """Return what is read of a motion; the air moves evenly, and the field is the same everywhere."""
    time_s = np.arange(-1.0, duration_s + 1.0, STEP_S / FINE)
    angles, slopes = angles_and_slopes(time_s, seed, (8.0, 4.0, 12.0))
    flow, _ = angles_and_slopes(time_s, seed + 100, (2.0, 2.0, 4.0))
    alpha, beta, speed = 3.0 + flow[:, 0], flow[:, 1], speed_m_s + flow[:, 2]
    a, b = np.radians(alpha), np.radians(beta)
    matrices = np.moveaxis(to_earth(np.radians(angles).T), -1, 0)
    through = speed[:, np.newaxis] * np.column_stack([np.cos(a) * np.cos(b), np.sin(b), np.sin(a) * np.cos(b)])
    velocity = np.einsum("nij,nj->ni", matrices, through) + WIND_M_S
    pulled = np.gradient(velocity, STEP_S / FINE, axis=0) - [0.0, 0.0, G_M_S2]
    felt = np.einsum("nji,nj->ni", matrices, pulled) / G_M_S2 * [1.0, 1.0, -1.0]
    height = 300.0 - np.cumsum(velocity[:, 2]) * STEP_S / FINE
    read = np.column_stack(
        [
            *(body_rates(angles, slopes), angles, felt, velocity, np.einsum("nji,j->ni", matrices, FIELD)),
            *(speed / KNOT_M_S, alpha, beta, height / FOOT_M),
        ]
    )
    rows = slice(round(FINE / STEP_S), round((duration_s + 1.0) * FINE / STEP_S) + 1, FINE)
    random = np.random.default_rng(seed)
    values = read[rows] + noise * random.standard_normal(read[rows].shape) * [*NOISE.values()]
    return gb.Record(values, channels=[*NOISE], sample_period_s=STEP_S)


def samples_of(record, *left_out):
    """Return what each channel read, where it did."""
    found = {}
    for name in record.channels:
        there = np.isfinite(record[name])
        found[name] = Samples(record.time_s[there], record[name][there])
    return {name: each for name, each in found.items() if name not in left_out}


def flight_from(record):
    """Return the flight of gyros, attitude and forces, which the gyros don't drive."""
    six = (*GYROS, *ATTITUDE, *ACCELEROMETERS)
    return flight_of({name: each for name, each in samples_of(record).items() if name in six}, is_driven=False)

"""Logs as ArduPilot and PX4 write them, made of a synthetic flight: two IMUs, an estimator's attitude, messages."""

from functools import cache

import numpy as np

import gtmbench as gb
from gtmbench.bench.attitude_filter import filtered_attitude
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers import intake_files as files
from tests.helpers.log_makers import quaternions

SECOND = 1_000_000  # in us
STEP = 10  # of 10 ms: 10 Hz
TIME_CONSTANT_S = 8.0


@cache
def truth(duration_s=130.0, seed=1):
    """A flight of the GTM, at 100 Hz."""
    return fly_once(duration_s=duration_s, seed=710_000 + seed).select([*GYROS, *ATTITUDE])


def imus(count=2, *, faults=(), seed=1, duration_s=130.0, driver=0, step=STEP):
    """Return IMUs, each a record every so many steps of 10 ms, with the attitude that the driver's gyros drive.

    faults: (number, fault).
    """
    flight, draw = truth(duration_s, seed), np.random.default_rng([seed, 5])
    read = []
    for number in range(count):
        sensed = flight
        for name in GYROS:
            noise = 0.2 * draw.standard_normal(len(flight)) + 0.1 * draw.standard_normal()
            sensed = sensed.replace(name, flight[name] + noise)
        for of, fault in faults:
            sensed = gb.inject(sensed, fault) if of == number else sensed
        read.append(sensed)
    guessed = filtered_attitude(read[driver], time_constant_s=TIME_CONSTANT_S, seed=seed).matrix(ATTITUDE)
    return [
        gb.Record(
            np.column_stack([each.matrix(GYROS), guessed])[::step],
            channels=[*GYROS, *ATTITUDE],
            sample_period_s=0.01 * step,
        )
        for each in read
    ]


def broken(fault):
    """Return an IMU with a fault, and the attitude of an estimator that another one drives."""
    return imus(2, faults=[(1, fault)])[1:]


def at(seconds):
    return round(seconds * SECOND)


def ardupilot(records, *, settings=(), texts=(), unhealthy=(), lanes=(), more=None):
    """Return an ArduPilot log.

    settings: (s, name, value) of PARM; texts: (s, text) of MSG; unhealthy: (number of an IMU, from s on); lanes: (s,
    instance, SV) of XKF4.
    """
    stamps = [at(time_s) for time_s in records[0].time_s]
    tables = {}
    for number, record in enumerate(records):
        since_s = min((from_s for of, from_s in unhealthy if of == number), default=np.inf)
        health = (record.time_s < since_s).astype(int).tolist()
        rates = np.radians(record.matrix(GYROS)).tolist()
        rows = [(t, *rate, good) for t, rate, good in zip(stamps, rates, health, strict=True)]
        tables[f"IMU{number + 1}" if number else "IMU"] = ("QfffB", "TimeUS,GyrX,GyrY,GyrZ,GH", rows)
    angles = records[0].matrix(ATTITUDE).tolist()
    tables["ATT"] = ("Qfff", "TimeUS,Roll,Pitch,Yaw", [(t, *row) for t, row in zip(stamps, angles, strict=True)])
    if settings:
        rows = [(at(time_s), name.encode(), value) for time_s, name, value in settings]
        tables["PARM"] = ("QNf", "TimeUS,Name,Value", rows)
    if texts:
        tables["MSG"] = ("QZ", "TimeUS,Message", [(at(time_s), text.encode()) for time_s, text in texts])
    if lanes:
        rows = [(at(time_s), lane, round(100 * ratio)) for time_s, lane, ratio in lanes]
        tables["XKF4"] = ("QBc", "TimeUS,C,SV", rows)
    units = {"XKF4": ("s#-", "F-0")} if lanes else None
    return files.dataflash({**tables, **(more or {})}, units=units)


def px4(record, *, more=None, texts=(), settings=None):
    """Return a PX4 log; more: further topics, their rows' stamps in seconds; settings: parameters by name."""
    stamps = [at(time_s) for time_s in record.time_s]
    rates = np.radians(record.matrix(GYROS)).tolist()
    turned = quaternions(record.matrix(ATTITUDE)).tolist()
    topics = {
        "vehicle_angular_velocity": (["float[3] xyz"], [(t, *row) for t, row in zip(stamps, rates, strict=True)]),
        "vehicle_attitude": (["float[4] q"], [(t, *row) for t, row in zip(stamps, turned, strict=True)]),
    }
    for name, (fields, rows) in (more or {}).items():
        topics[name] = (fields, [(at(row[0]), *row[1:]) for row in rows])
    return files.ulog(topics, texts=[(at(time_s), text) for time_s, text in texts], settings=settings)

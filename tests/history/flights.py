"""Entries of drawn flights, for tests."""

import numpy as np

from gtmbench.history.entry import AT_REST, FACTOR, LAG, MISALIGNMENT, NOISE, OFFSET, Constant, Entry
from gtmbench.values.channels import GYROS

DEVIATIONS = {OFFSET: 0.05, AT_REST: 0.02, FACTOR: 0.002, NOISE: 0.02, LAG: 0.001, MISALIGNMENT: 0.1}
SPREADS = {OFFSET: 0.2, AT_REST: 0.2, FACTOR: 0.005, NOISE: 0.1, LAG: 0.002, MISALIGNMENT: 0.2}


def keys_of(imus=("",)):
    """Return the constants that a flight tells of one or more IMUs."""
    for imu in imus:
        for gyro in GYROS:
            sensor = f"{gyro} of {imu}" if imu else gyro
            yield sensor, OFFSET
            yield sensor, FACTOR
            if not imu:
                yield sensor, AT_REST
                yield sensor, NOISE
                yield sensor, LAG
            yield from ((sensor, f"{MISALIGNMENT} {other}") for other in GYROS if other != gyro)


def usual(random, imus=("",)):
    """Draw what an airframe's constants are on average."""
    middles = {OFFSET: 0.0, AT_REST: 0.0, FACTOR: 1.0, NOISE: -1.0, LAG: 0.0, MISALIGNMENT: 0.0}
    wide = {OFFSET: 0.7, AT_REST: 0.7, FACTOR: 0.01, NOISE: 0.3, LAG: 0.02, MISALIGNMENT: 1.0}
    return {
        key: middles[name] + wide[name] * random.standard_normal()
        for key in keys_of(imus)
        for name in [key[1].split(" ")[0] if key[1].startswith(MISALIGNMENT) else key[1]]
    }


def flight(random, number, means, *, off=None, airframe="a", temperature_c=float("nan"), spread=1.0):
    """Draw a flight about an airframe's means, some constants off by so much."""
    constants = []
    for key, mean in means.items():
        name = MISALIGNMENT if key[1].startswith(MISALIGNMENT) else key[1]
        value = mean + spread * SPREADS[name] * random.standard_normal() + DEVIATIONS[name] * random.standard_normal()
        value += (off or {}).get(key, 0.0)
        constants.append(Constant(sensor=key[0], name=key[1], value=float(value), deviation=DEVIATIONS[name]))
    return Entry(
        digest=f"{airframe} {number}",
        log=f"{number}.bin",
        airframe=airframe,
        temperature_c=temperature_c,
        constants=tuple(constants),
    )


def flights(seed, count, *, imus=("",), **how):
    """Draw an airframe: its means, and its first flights."""
    random = np.random.default_rng(seed)
    means = usual(random, imus)
    return random, means, [flight(random, number, means, **how) for number in range(count)]

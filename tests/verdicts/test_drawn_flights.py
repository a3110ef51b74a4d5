"""Flights that nobody chose: rates, excitations, noise, loggers, estimators, IMUs and up to two faults are drawn.

On the first 250 such flights four named a healthy sensor and two called a broken one clear; each stands in the corpus
or in a test of the engine now. By night other flights are drawn (`GTMBENCH_ORACLES`).
"""

import os

import numpy as np
import pytest

from gtmbench.values.attitude_estimators import SteepError
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.night import by_day
from tests.verdicts.entries import entry_of
from tests.verdicts.recipes import made
from tests.verdicts.requirements import breaches, watched

SEED = int(os.environ.get("GTMBENCH_ORACLES", "64000"))
FLIGHTS, LEAST_HZ = 40, 10.0
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence", "dissertation+turbulence", "turbulence", "multisine")
FACTORS = (-0.5, 0.0, 0.4, 0.7, 1.5, 2.0, 3.0)
ESTIMATORS = ("filter 1 s", "filter 5 s", "filter 20 s", "kalman")
# kind, its parameter, and between which sizes it is drawn, evenly in the logarithm
OF_ANGLES = (
    ("drift", "slope", (0.05, 1.5)),
    ("bias", "size", (1.5, 15.0)),
    ("oscillation", "amplitude", (1.0, 6.0)),
    ("random_walk", "gain", (0.3, 3.0)),
    ("noise", "deviation", (1.0, 6.0)),
    ("scale_factor", "factor", None),
    ("jam", None, None),
)
OF_GYROS = (
    ("drift", "slope", (0.02, 0.6)),
    ("bias", "size", (0.6, 8.0)),
    ("oscillation", "amplitude", (0.8, 5.0)),
    ("noise", "deviation", (0.5, 5.0)),
    ("scale_factor", "factor", None),
    ("sign_flip", None, None),
    ("jam", None, None),
)


def fault(random, sensor, first_s, last_s):
    kinds = OF_GYROS if sensor in GYROS else OF_ANGLES
    kind, parameter, sizes = kinds[random.integers(len(kinds))]
    told = {"kind": kind, "channel": sensor, "onset_s": round(float(random.uniform(first_s, last_s)), 2)}
    if parameter == "factor":
        told["factor"] = float(random.choice(FACTORS))
    elif parameter is not None:
        sign = float(random.choice([-1.0, 1.0])) if parameter in ("slope", "size") else 1.0
        told[parameter] = round(sign * between(random, *sizes), 4)
    if kind == "oscillation":
        told["frequency_hz"] = round(between(random, 0.1, 2.5), 3)
    if random.random() < 0.4:
        told["duration_s"] = round(between(random, 1.0, 60.0), 1)
    return told


def between(random, least, most):
    """Return a number that is drawn evenly in the logarithm."""
    return float(np.exp(random.uniform(np.log(least), np.log(most))))


def logged(random, rate_hz, duration_s):
    """Return what a logger does to the table: each of these seldom, and none is a fault."""
    gap_s = float(random.uniform(10.0, duration_s - 15.0))
    most = max(int(rate_hz / LEAST_HZ), 1)
    kinds = (
        (0.25, {"do": "rounded", "columns": [*GYROS], "step": float(random.choice([0.05, 0.2, 0.5]))}),
        (0.25, {"do": "late", "columns": [*ATTITUDE], "by_s": round(float(random.uniform(0.01, 0.15)), 3)}),
        (0.2, {"do": "held", "columns": [*ATTITUDE], "every": int(random.choice([2, 4]))}),
        (0.2, {"do": "gap", "from_s": gap_s, "to_s": gap_s + float(random.uniform(0.5, 8.0))}),
        (0.2, {"do": "wrapped"}),
        (0.4, {"do": "slower", "columns": [*ATTITUDE], "every": min(int(random.choice([2, 3, 5])), most)}),
    )
    return [told for share, told in kinds if random.random() < share and told.get("every", 2) > 1]


def flight(number):
    """Return what an entry of the corpus says, drawn; every fifth flight is healthy."""
    random = np.random.default_rng([SEED, 11, number])
    rate_hz, duration_s = (float(random.choice(of)) for of in ((20.0, 25.0, 50.0, 100.0, 200.0), (70.0, 100.0, 150.0)))
    attitude = str(random.choice(["own", "own", "own", *ESTIMATORS]))
    stands_s = float(random.choice([0.0, 0.0, 0.0, 8.0, 20.0]))
    imus = int(random.choice([1, 1, 1, 1, 2, 3]))
    broken = random.permutation([*GYROS, *(ATTITUDE if attitude == "own" else ())])
    faults = [
        fault(random, str(sensor), stands_s + 6.0, duration_s - 6.0)
        for sensor in broken[: 0 if number % 5 == 0 else random.integers(1, 3)]
    ]
    return {
        "about": "a flight that was drawn",
        "seed": int(random.integers(1, 10**6)),
        "duration_s": duration_s,
        "rate_hz": rate_hz,
        "excitation": str(random.choice(EXCITATIONS)),
        "noise": round(float(random.uniform(0.3, 3.0)), 2),
        "file": str(random.choice(["csv", "two_tables"])),
        "channels": str(random.choice(["six", "six", "all"])),
        "attitude": attitude,
        "stand_s": stands_s,
        "imus": [{"turned_deg": float(random.choice([0.0, 90.0, 180.0])) if imu else 0.0} for imu in range(imus)],
        "faults": [
            told | ({"imu": int(random.integers(imus)) + 1} if told["channel"] in GYROS else {}) for told in faults
        ],
        "done": logged(random, rate_hz, duration_s),
    }


@pytest.mark.parametrize("number", by_day(range(FLIGHTS)))
def test_nobody_healthy_is_named_and_nobody_broken_is_clear(tmp_path, number):
    told = flight(number)
    drawn = entry_of(f"drawn-{number}", told)
    try:
        log = made(drawn, tmp_path)
    except SteepError as error:
        pytest.skip(f"its estimator has no angles there: {error}")
    assert not breaches(drawn, log, watched(drawn, log)), told

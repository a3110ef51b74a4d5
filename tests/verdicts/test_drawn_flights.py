"""Flights that nobody chose: rates, excitations, noise, one late fault or none are drawn, and what follows must hold.

On the first 250 such flights four named a healthy sensor and two called a broken one clear; each stands in the corpus
or in a test of the engine now. By night other flights are drawn (`GTMBENCH_ORACLES`).
"""

import os

import numpy as np
import pytest

from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.night import by_day
from tests.verdicts.entries import entry_of
from tests.verdicts.recipes import made
from tests.verdicts.requirements import breaches, watched

SEED = int(os.environ.get("GTMBENCH_ORACLES", "64000"))
FLIGHTS, LEAST_HZ = 40, 10.0
EXCITATIONS = ("multisine+turbulence", "doublets+turbulence", "dissertation+turbulence", "turbulence", "multisine")
FACTORS = (-0.5, 0.0, 0.4, 0.7, 1.5, 2.0, 3.0)
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


def fault(random, duration_s):
    sensor = str(random.choice([*GYROS, *ATTITUDE]))
    kinds = OF_GYROS if sensor in GYROS else OF_ANGLES
    kind, parameter, sizes = kinds[random.integers(len(kinds))]
    told = {"kind": kind, "channel": sensor, "onset_s": round(duration_s - float(random.uniform(15.0, 60.0)), 2)}
    if parameter == "factor":
        told["factor"] = float(random.choice(FACTORS))
    elif parameter is not None:
        sign = float(random.choice([-1.0, 1.0])) if parameter in ("slope", "size") else 1.0
        told[parameter] = round(sign * float(np.exp(random.uniform(*np.log(sizes)))), 4)
    if kind == "oscillation":
        told["frequency_hz"] = round(float(np.exp(random.uniform(*np.log((0.1, 2.5))))), 3)
    return told


def flight(number):
    """Return what an entry of the corpus says, drawn; every fifth flight is healthy."""
    random = np.random.default_rng([SEED, 7, number])
    rate_hz, every = float(random.choice([25.0, 50.0, 60.0, 100.0])), int(random.choice([1, 2, 3, 5]))
    every = min(every, int(rate_hz / LEAST_HZ))
    duration_s = float(random.choice([100.0, 130.0, 180.0]))
    told = {
        "about": "a flight that was drawn",
        "seed": int(random.integers(1, 10**6)),
        "duration_s": duration_s,
        "rate_hz": rate_hz,
        "excitation": str(random.choice(EXCITATIONS)),
        "noise": round(float(random.uniform(0.3, 3.0)), 2),
        "file": str(random.choice(["csv", "two_tables"])),
        "faults": [fault(random, duration_s)] if number % 5 else [],
    }
    if every > 1:
        told["done"] = [{"do": "slower", "columns": list(ATTITUDE), "every": every}]
    return told


@pytest.mark.parametrize("number", by_day(range(FLIGHTS), 2))
def test_nobody_healthy_is_named_and_nobody_broken_is_clear(tmp_path, number):
    told = flight(number)
    drawn = entry_of(f"drawn-{number}", told)
    log = made(drawn, tmp_path)
    assert not breaches(drawn, log, watched(drawn, log)), told

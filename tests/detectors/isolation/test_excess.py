"""Whose excess: what is added to a reading is found there, and what takes motion away is blamed on no other."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.signal import lfilter

from gtmbench.detectors.isolation.referee import held_by

ROWS, SPAN, NOISE = 2000, 256, 0.05
FAST = np.arange(2, SPAN // 2 + 1) / SPAN / 0.01 > 3.0
SEEDS = range(10)


def motion(rng, rows=ROWS):
    """A rate of a few deg/s, mostly below 2 Hz, at 100 Hz."""
    return 40.0 * lfilter([1.0 - 0.93], [1.0, -0.93], lfilter([1.0 - 0.93], [1.0, -0.93], rng.standard_normal(rows)))


def told(seed, fault, broken=0):
    """Break one of two readings of a motion, each with noise of its own, and ask which it was."""
    rng = np.random.default_rng(seed)
    rate, before = motion(rng), motion(rng, 3000)
    sensed = [rate, rate]
    sensed[broken] = fault(rate, rng)
    readings, predicted = (values + NOISE * rng.standard_normal(ROWS) for values in sensed)
    found = held_by(readings, predicted, before, np.full(SPAN // 2 - 1, 2.0 * NOISE**2), FAST)
    return None if found is None or not found[1] else found[0]


def tone(frequency_hz):
    return lambda rate, _: rate + 3.0 * np.sin(2.0 * np.pi * frequency_hz * 0.01 * np.arange(ROWS))


def bursts(rate, _):
    time_s = 0.01 * np.arange(ROWS)
    return rate + np.where(time_s % 2.5 < 0.6, 3.0 * np.sin(2.0 * np.pi * 7.0 * time_s), 0.0)


ADDED = {
    "tone 4 Hz": tone(4.0),
    "tone 9 Hz": tone(9.0),
    "bursts": bursts,
    "noise": lambda rate, rng: rate + 2.0 * rng.standard_normal(ROWS),
}
TAKEN = {
    "nothing": lambda rate, _: rate,
    "jam": lambda rate, _: np.full(ROWS, rate[0]),
    "half": lambda rate, _: 0.5 * rate,
    "a tenth": lambda rate, _: 0.1 * rate,
    "clipped": lambda rate, _: np.clip(rate, -2.0, 2.0),
    "slow": lambda rate, _: lfilter([0.01], [1.0, -0.99], rate),
    "late": lambda rate, _: np.concatenate([np.zeros(20), rate[:-20]]),
    "deadzone": lambda rate, _: np.where(np.abs(rate) < 3.0, 0.0, rate),
}


@pytest.mark.parametrize("broken", [0, 1])
@pytest.mark.parametrize("name", ADDED)
def test_what_is_added_is_found_where_it_is(name, broken):
    answers = [told(seed, ADDED[name], broken) for seed in SEEDS]
    assert set(answers) <= {broken, None}
    assert answers.count(broken) > len(answers) / 2


@pytest.mark.parametrize("broken", [0, 1])
@pytest.mark.parametrize("name", TAKEN)
def test_what_takes_motion_away_is_blamed_on_no_other(name, broken):
    assert {told(seed, TAKEN[name], broken) for seed in SEEDS} <= {None, broken}  # a deadzone's jumps are added


@pytest.mark.parametrize("broken", [0, 1])
def test_slow_motion_that_an_autopilot_might_make_is_not_enough(broken):
    """The aircraft turns against what is added, so that the broken sensor reads as before and the other doesn't."""
    answers = {
        told(seed, lambda rate, _: rate + 3.0 * np.sin(0.02 * np.pi * np.arange(ROWS)), broken) for seed in SEEDS
    }
    assert answers == {None}


def test_units_signs_and_gaps_change_nothing():
    rng = np.random.default_rng(1)
    rate, before = motion(rng), motion(rng, 3000)
    broken, healthy = bursts(rate, rng) + NOISE * rng.standard_normal(ROWS), np.full(SPAN // 2 - 1, NOISE**2)
    assert held_by(broken, rate, before, healthy, FAST) == (0, True)
    assert held_by(-7.0 * broken, -7.0 * rate, 7.0 * before, 49.0 * healthy, FAST) == (0, True)
    assert held_by(broken + 5.0, rate - 2.0, before, healthy, FAST) == (0, True)
    broken[[300, 900]] = np.nan
    assert held_by(broken, rate, before, healthy, FAST) == (0, True)


@pytest.mark.parametrize("rows", [0, 200, 700])
def test_a_short_record_tells_nothing(rows):
    rng = np.random.default_rng(2)
    rate = motion(rng)
    assert held_by(bursts(rate, rng)[:rows], rate[:rows], rate, np.full(SPAN // 2 - 1, 1e-3), FAST) is None
    assert held_by(bursts(rate, rng), rate, rate[:100], np.full(SPAN // 2 - 1, 1e-3), FAST) is None

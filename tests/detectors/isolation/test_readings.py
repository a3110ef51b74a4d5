"""What a sensor's own readings tell: how often they run dead straight, and when counts of a converter may say so."""

import numpy as np
import pytest

from gtmbench.detectors.isolation.own_noise import habit_of, is_straighter

ROWS = 3000


def rounded(noise, count=0.01, seed=1, rows=ROWS):
    """Return readings of a slow motion, with noise, in counts of a hundredth."""
    motion = 3.0 * np.sin(np.arange(rows) / 150.0)
    return np.round((motion + noise * np.random.default_rng(seed).standard_normal(rows)) / count) * count


@pytest.mark.parametrize("noise", [0.02, 0.05])
def test_counts_below_their_noise_tell_that_a_sensor_stands_still_and_nothing_of_healthy_ones(noise):
    habit = habit_of(rounded(noise))
    assert habit.is_counted
    assert habit.surprise(np.full(139, 1.23)) > 200.0
    for seed in range(2, 12):
        healthy = rounded(noise, seed=seed, rows=400)
        assert habit.surprise(healthy) == 0.0
        assert not is_straighter(healthy, habit)


def test_readings_that_never_repeat_are_surprising_at_the_first_repeat():
    habit = habit_of(3.0 + 0.05 * np.random.default_rng(3).standard_normal(ROWS))
    assert not habit.is_counted
    assert habit.surprise(np.array([1.0, 1.0, 1.0])) > 9.0


@pytest.mark.parametrize("noise", [0.02, 0.05])
def test_a_while_of_standing_still_says_the_same_however_long_the_sensor_moves_after_it(noise):
    readings = rounded(noise, rows=9000)
    habit = habit_of(readings[:3000])
    held = readings[3000:].copy()
    held[:100] = held[0]
    told = [habit.surprise(held[:rows]) for rows in (100, 400, 1600, 6000)]
    assert min(told) > 200.0
    assert told == pytest.approx([told[0]] * 4, rel=0.05)
    assert is_straighter(held, habit)
    assert not is_straighter(readings[3000:], habit)


@pytest.mark.parametrize("count", [0.05, 0.2])
def test_counts_coarser_than_their_noise_tell_by_standing_still_far_longer_than_before(count):
    readings = rounded(0.005, count, rows=9000)
    habit = habit_of(readings[:3000])
    assert habit.longest > 5
    assert habit.is_counted
    usual = 2 + 2 * habit.longest + 5  # the first two rows can't be straight
    for longer in (0, 1, 20):  # -2 log likelihood is 4 for every time as long as the longest
        assert habit.surprise(np.full(usual + longer * habit.longest, 1.2)) == pytest.approx(4.0 * longer)
    assert not is_straighter(np.full(2 * habit.longest, 1.2), habit)
    assert [habit.surprise(readings[first : first + 500]) for first in range(3000, 8500, 500)] == [0.0] * 11


def test_counts_far_above_noise_and_motion_are_coarse():
    assert habit_of(rounded(0.005, 2.0)).is_coarse
    assert not habit_of(rounded(0.005, 0.05)).is_coarse
    assert not habit_of(3.0 + 0.05 * np.random.default_rng(3).standard_normal(ROWS)).is_coarse

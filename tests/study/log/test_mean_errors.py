"""Mean errors: calm seconds tell more than lively ones, and a mean is known as well as it says."""

import numpy as np
import pytest

from gtmbench.study.log.mean_errors import ErrorSeconds, mean_errors, weighted_means, weights
from gtmbench.study.log.slow_means import slow_means
from gtmbench.values.record import Record

HEALTHY_S, SECONDS, RATE_HZ = 90, 240, 10
GYROS = ["p", "q", "r"]


def seconds_of(error, motion, deviation):
    return ErrorSeconds(error=error, motion=motion, variance=np.square(deviation), up=np.zeros(error.shape))


def vibrating(seed, *, bias_deg_s=0.0, lively=5.0, calm=0.3):
    """Return level flight whose gyros vibrate in every other ten seconds, which a slow sampling aliases."""
    random = np.random.default_rng(seed)
    rows = SECONDS * RATE_HZ
    time_s = np.arange(rows) / RATE_HZ
    deviation = np.where((time_s // 10.0) % 2 == 0, lively, calm)[:, np.newaxis]
    values = np.zeros((rows, 6))
    values[:, :3] = deviation * random.standard_normal((rows, 3))
    values[time_s > 120.0, 0] += bias_deg_s
    return Record(values, channels=[*GYROS, "phi", "theta", "psi"], sample_period_s=1.0 / RATE_HZ)


def compared(record):
    return slow_means([record], healthy=[(0.0, float(HEALTHY_S))], is_driven=True)


@pytest.mark.parametrize("seed", range(8))
def test_a_bias_is_heard_in_calm_seconds_between_vibrating_ones(seed):
    assert compared(vibrating(seed)).alarms == ()
    (alarm,) = compared(vibrating(seed, bias_deg_s=1.0)).alarms
    assert alarm.source == "p"
    assert 120.0 < alarm.time_s <= 140.0


def test_bounds_of_calm_means_dont_grow_with_the_vibration_between_them():
    least = [np.nanmin(compared(vibrating(1, lively=lively)).bounds[10]) for lively in (1.0, 20.0)]
    assert least[1] == pytest.approx(least[0], rel=0.3)


@pytest.mark.parametrize("window", [10, 30])
def test_deviations_are_what_means_scatter_by(window):
    scattered = []
    for seed in range(30):
        random = np.random.default_rng(seed)
        deviation, motion = np.exp(random.uniform(-2.0, 2.0, (300, 3))), 10.0 * random.standard_normal((300, 3))
        weight = weights(seconds_of(motion, motion, deviation))
        gains = 0.02 * random.standard_normal((3, 3))
        error = 0.4 + motion @ gains + random.standard_normal((300, 3)) / np.sqrt(weight)
        left = mean_errors(seconds_of(error, motion, deviation), np.arange(300) < 60)
        scattered.append(left.mean(window)[60 + window :: window] / left.deviation(window)[60 + window :: window])
    assert np.sqrt(np.mean(np.square(scattered))) == pytest.approx(1.0, abs=0.1)


def test_who_learnt_in_one_long_turn_knows_little_of_straight_flight():
    turning, calm = np.zeros((120, 3)), np.zeros((120, 3))
    turning[:60, 2] = -70.0
    after_turning, after_calm = (
        mean_errors(seconds_of(0.0 * motion, motion, np.full((120, 3), 0.1)), np.arange(120) < 60).deviation(10)[110]
        for motion in (turning, calm)
    )
    assert (after_turning > 1.0).all()
    assert (after_calm < 0.1).all()


def test_seconds_after_a_hard_turn_tell_less_until_the_attitude_is_pulled_back():
    motion = np.zeros((60, 3))
    motion[20, 1] = 100.0
    weight = weights(seconds_of(motion, motion, np.full((60, 3), 0.05)))[:, 1]
    assert weight[20] < weight[21] < weight[25] < weight[19]
    assert weight[50] == pytest.approx(weight[19], rel=0.01)


def test_weighted_means_are_means_of_what_is_known():
    random = np.random.default_rng(5)
    values, weight = random.standard_normal((50, 3)), random.uniform(0.1, 9.0, (50, 3))
    values[11] = np.nan
    part = slice(3, 13)
    there = np.isfinite(values[part, 0])
    expected = np.average(values[part][there], axis=0, weights=weight[part][there])
    np.testing.assert_allclose(weighted_means(values, weight, 10)[12], expected)


def test_too_few_healthy_seconds_teach_nothing():
    some = np.zeros((60, 3))
    assert mean_errors(seconds_of(some, some, some), np.arange(60) < 14) is None

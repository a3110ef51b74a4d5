"""Thresholds from tails: passed no more often than asked, as far as the blocks and the shape of the tail allow."""

import math

import numpy as np
import pytest
from scipy import stats

from gtmbench.detectors.statistics.thresholds import block_maxima, rate_bound, tail_threshold

REPEATS = 300
LENGTH = 1000  # samples a block


def exceeded(distribution, blocks, share, seed):
    """Return how often the maximum of a fresh block passes the threshold, exactly, for every repetition."""
    rng = np.random.default_rng(seed)
    passed = []
    for _ in range(REPEATS):
        # the greatest of LENGTH draws, by its distribution function F^LENGTH
        maxima = distribution.isf(-np.expm1(np.log(rng.uniform(size=blocks)) / LENGTH))
        threshold = tail_threshold(maxima, crossings_per_block=share)
        passed.append(-math.expm1(LENGTH * math.log1p(-distribution.sf(threshold))))
    return np.array(passed)


def plug_in(blocks, share):
    """Return what an exponential tail of estimated scale gives in the mean, where `share` is asked for.

    The excesses over the k-th greatest are exponential, their mean is a gamma variate of k degrees over k: then
    E exp(-s mean) = (1 + s/k)^-k, s = log(1/4 / share).
    """
    k, s = blocks // 4, math.log(0.25 / share)
    return 0.25 * (1.0 + s / k) ** -k


LIGHT = [stats.expon(), stats.chi2(1), stats.norm(), stats.uniform()]  # exponential tails, and lighter ones


@pytest.mark.parametrize("distribution", LIGHT, ids=lambda law: law.dist.name)
@pytest.mark.parametrize("blocks", [20, 40, 100, 400])
def test_fresh_blocks_pass_no_more_often_than_documented(distribution, blocks):
    for share in (1e-2, 1e-3, 1e-4):
        passed = exceeded(distribution, blocks, share, seed=7)
        # four deviations of the mean; a maximum of 1000 samples is 1 % short of an exponential tail at its quartile
        assert passed.mean() < 1.01 * plug_in(blocks, share) + 4.0 * passed.std() / math.sqrt(REPEATS)


@pytest.mark.parametrize("distribution", LIGHT[:2], ids=lambda law: law.dist.name)
def test_many_blocks_of_an_exponential_tail_give_about_what_was_asked(distribution):
    # 1000 above the quartile: the scale is known to 3 %, s = 5.5 of it moves the logarithm by 0.17; the shape, held
    # to 0 or more, is off by 1/sqrt(1000), and that by s^2 / 2 of it, 0.5, towards rarer
    passed = exceeded(distribution, 4000, 1e-3, seed=3)
    assert math.exp(-4.0 * math.hypot(0.17, 0.5)) < np.median(passed) / 1e-3 < math.exp(4.0 * 0.17)


def test_a_heavy_tail_is_extrapolated_further_than_an_exponential_one():
    heavy = stats.genpareto(0.25)
    rng = np.random.default_rng(5)
    thresholds, exponential = [], []
    for _ in range(100):
        maxima = np.sort(heavy.isf(-np.expm1(np.log(rng.uniform(size=400)) / LENGTH)))
        thresholds.append(tail_threshold(maxima, crossings_per_block=1e-4))
        exponential.append(maxima[-101] + np.mean(maxima[-100:] - maxima[-101]) * math.log(0.25 / 1e-4))
    exact = heavy.isf(1e-4 / LENGTH)
    assert abs(math.log(np.median(thresholds) / exact)) < abs(math.log(np.median(exponential) / exact)) / 2.0


def test_a_tail_beyond_the_shapes_it_knows_is_passed_more_often():
    assert np.median(exceeded(stats.genpareto(0.6), 400, 1e-4, seed=1)) > 2e-4


@pytest.mark.parametrize("window", [5, 50])
def test_serial_correlation_makes_no_false_alarms(window):
    # moving sums of squares, in blocks much longer than their memory: fresh records, counted
    rows, share = 1000, 5e-3

    def sums(blocks, seed):
        squares = np.square(np.random.default_rng(seed).standard_normal(blocks * rows))
        return np.convolve(squares, np.ones(window), mode="valid")

    total = 0
    for seed in range(10):
        threshold = tail_threshold(block_maxima(sums(400, seed), rows), crossings_per_block=share)
        total += int(np.count_nonzero(block_maxima(sums(400, 100 + seed), rows) > threshold))
    asked = 10 * 399 * plug_in(400, share)
    assert total <= stats.poisson.isf(1e-5, asked)


@pytest.mark.parametrize("count", [1, 2, 3, 4, 7, 20, 41, 400])
def test_rarer_is_higher_and_never_below_the_greatest_seen(count):
    maxima = np.random.default_rng(count).gumbel(size=count)
    shares = np.geomspace(10.0, 1e-300, 40)
    thresholds = [tail_threshold(maxima, crossings_per_block=share) for share in shares]
    assert np.isfinite(thresholds).all()
    assert (np.diff(thresholds) >= 0.0).all()
    assert thresholds[0] == maxima.max()
    shuffled = np.random.default_rng(1).permutation(maxima)
    assert tail_threshold(shuffled, crossings_per_block=1e-3) == tail_threshold(maxima, crossings_per_block=1e-3)


@pytest.mark.parametrize("unit", [1e-6, 1e6])
def test_units_and_offsets_of_the_statistic_dont_matter(unit):
    maxima = np.random.default_rng(4).gumbel(size=200)
    here = tail_threshold(maxima, crossings_per_block=1e-3)
    assert tail_threshold(unit * (maxima - 50.0), crossings_per_block=1e-3) == pytest.approx(unit * (here - 50.0))


def test_values_that_are_all_the_same_are_the_threshold():
    assert tail_threshold(np.full(100, 3.0), crossings_per_block=1e-3) == pytest.approx(3.0)


# blocks


def test_blocks_with_less_than_half_their_rows_say_nothing():
    nan = np.nan
    values = np.array([1.0, nan, nan, nan, 5.0, 2.0, nan, nan, nan, nan, nan, nan, 4.0, 4.5, 7.0, nan, 9.0])
    np.testing.assert_array_equal(block_maxima(values, 4), [5.0, 7.0])
    assert block_maxima(np.full(12, nan), 4).shape == (0,)


@pytest.mark.parametrize(
    ("values", "expected"), [([], []), ([np.nan], []), ([1.0, np.nan, 3.0], [3.0]), ([-1.0, -2.0, -3.0, -4.0], [-1.0])]
)
def test_a_record_shorter_than_a_block_is_one(values, expected):
    np.testing.assert_array_equal(block_maxima(np.array(values), 4), expected)


# rates


@pytest.mark.parametrize(
    ("events", "bound"), [(0, 2.996), (1, 4.744), (2, 6.296), (3, 7.754), (5, 10.513), (10, 16.962)]
)
def test_the_bound_of_a_rate_is_that_of_poisson_tables(events, bound):
    assert rate_bound(events, 1.0) == pytest.approx(bound, abs=5e-4)
    assert rate_bound(events, 30.0) == pytest.approx(bound / 30.0, abs=2e-5)
    assert stats.poisson.cdf(events, rate_bound(events, 1.0, confidence=0.99)) == pytest.approx(0.01)


def test_without_hours_there_is_no_bound():
    assert rate_bound(0, 0.0) is None

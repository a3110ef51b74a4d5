"""Thresholds from tails: passed no more often than asked, as far as the blocks and the shape of the tail allow."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from gtmbench.detectors.statistics.statistic import Allowance, Statistic
from gtmbench.detectors.statistics.thresholds import (
    HealthyMaxima,
    Luck,
    ScoreMaxima,
    _tail,
    block_maxima,
    common_scale,
    common_shape,
    healthy_maxima,
    rate_bound,
    tail_threshold,
)
from gtmbench.detectors.statistics.whitening import White
from gtmbench.errors import InputError
from tests.helpers.night import by_day

REPEATS = 300
LENGTH = 1000  # samples a block


def exceeded(distribution, blocks, share, seed):
    """Return how often the maximum of a fresh block passes the threshold, exactly, for every repetition."""
    rng = np.random.default_rng(seed)
    passed = []
    for _ in range(REPEATS):
        maxima = drawn_maxima(distribution, blocks, rng)
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


@pytest.mark.parametrize("distribution", by_day(LIGHT, 2), ids=lambda law: law.dist.name)
@pytest.mark.parametrize("blocks", by_day([20, 400, 40, 100], 2))
def test_fresh_blocks_pass_no_more_often_than_documented(distribution, blocks):
    for share in (1e-2, 1e-3, 1e-4):
        passed = exceeded(distribution, blocks, share, seed=7)
        # four deviations of the mean; a maximum of 1000 samples is 1 % short of an exponential tail at its quartile
        assert passed.mean() < 1.01 * plug_in(blocks, share) + 4.0 * passed.std() / math.sqrt(REPEATS)


def drawn_maxima(distribution, blocks, rng):
    """Return the greatest of LENGTH draws, by its distribution function F^LENGTH."""
    return distribution.isf(-np.expm1(np.log(rng.uniform(size=blocks)) / LENGTH))


def test_tests_that_hardly_leave_their_floor_have_no_say_in_the_shape():
    rng = np.random.default_rng(2)
    light = [drawn_maxima(stats.expon(), 400, rng) for _ in range(10)]
    at_floor = [np.where(rng.uniform(size=400) < 0.1, rng.exponential(size=400), 0.0) for _ in range(40)]
    assert common_shape([*light, *at_floor]) == common_shape(light)
    assert common_scale([*light, *at_floor]) == common_scale(light)


@pytest.mark.parametrize("spread", [0.0, 0.22])
def test_a_scale_that_others_lend_keeps_the_rate_where_tests_differ_as_assumed(spread):
    # the scales of forty tests scatter by `spread`; what fresh blocks pass is what was asked, in the mean over tests
    rng = np.random.default_rng(11)
    passed = []
    for _ in range(60):
        scales = np.maximum(1.0 + spread * rng.standard_normal(40), 0.3)
        tests = [scale * rng.exponential(size=40) for scale in scales]
        common = common_scale(tests)
        thresholds = [tail_threshold(maxima, crossings_per_block=1e-4, scale=common) for maxima in tests]
        passed.append(np.mean(np.exp(-np.array(thresholds) / scales)))
    assert np.mean(passed) < 1.3e-4


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


@pytest.mark.parametrize("tests", [[], [np.linspace(0.0, 1.0, 400)]], ids=len)
def test_a_scale_that_others_lend_is_never_less_than_theorys(tests):
    assert common_scale(tests) == 1.0


def test_values_that_are_all_the_same_are_the_threshold():
    assert tail_threshold(np.full(100, 3.0), crossings_per_block=1e-3) == pytest.approx(3.0)


def test_a_tail_of_known_shape_is_followed_as_far_as_asked():
    law = stats.genpareto(0.25)
    maxima = law.isf((np.arange(40_000) + 0.5) / 40_000)
    assert tail_threshold(maxima, crossings_per_block=1e-6, shape=0.25) == pytest.approx(law.isf(1e-6), rel=0.02)


def test_a_test_is_judged_by_five_independent_values_of_its_tail_or_not_at_all():
    maxima = np.random.default_rng(4).exponential(size=40)  # ten above the quartile
    finite = [np.isfinite(tail_threshold(maxima, crossings_per_block=1e-3, independent=of)) for of in (0.5, 0.49)]
    assert finite == [True, False]


def test_a_scale_that_others_lend_counts_for_twenty_values():
    """Of k values and 20, n of mean m, a maximum passes u + y with the probability 1/4 (1 + y / n m)^-n."""
    maxima = np.repeat([0.0, 1.0], [30, 10])  # ten that exceed the quartile by 1
    beyond, mean = tail_threshold(maxima, crossings_per_block=1e-3, scale=2.0), (10 * 1.0 + 20 * 2.0) / 30.0
    assert 0.25 * (1.0 + beyond / (30.0 * mean)) ** -30 == pytest.approx(1e-3)


def test_a_shape_is_at_most_three_tenths_of_one_test_half_and_of_tails_of_ten_values():
    heavy = stats.genpareto(2.0).isf((np.arange(20_000) + 0.5) / 20_000)
    assert common_shape([heavy[::10]]) == pytest.approx(0.5 * 500 / (500 + 500))
    assert common_shape([heavy]) == 0.3
    few = 3.0 * stats.expon().isf((np.arange(40) + 0.5) / 40)
    assert (common_scale([few]) > 2.0, common_scale([few[1:]])) == (True, 1.0)


def test_a_tail_that_has_no_length_tells_of_no_scale_and_one_that_has_of_its_mean():
    assert (common_scale([np.repeat([0.0, 1.0], [10, 30])]), common_shape([np.repeat([0.0, 1.0], [10, 30])])) == (
        1.0,
        0.0,
    )
    assert common_scale([np.repeat([0.0, 5.0, 50.0], [20, 19, 1])]) == pytest.approx(4.5)  # nine of ten exceed by none


def test_the_upper_quartile_of_eight_is_the_sixth():
    u, excess = _tail(np.array([5.0, 8.0, 1.0, 2.0, 7.0, 3.0, 6.0, 4.0]))
    assert (u, excess.tolist()) == (6.0, [1.0, 2.0])


def test_theory_counts_for_a_shape_as_five_hundred_tail_values_do():
    maxima = stats.genpareto(0.2).isf((np.arange(4000) + 0.5) / 4000)  # a thousand above the quartile
    one, two = common_shape([maxima]), common_shape([maxima, maxima])
    own = 1.0 / (2.0 / two - 1.0 / one)
    assert (1000 * (own / one - 1.0), own) == (pytest.approx(500.0), pytest.approx(0.2, abs=0.01))


# blocks


def test_blocks_with_less_than_half_their_rows_say_nothing():
    nan = np.nan
    values = np.array([1.0, nan, nan, nan, 5.0, 2.0, nan, nan, nan, nan, nan, nan, 4.0, 4.5, 7.0, nan, 9.0])
    np.testing.assert_array_equal(block_maxima(values, 4), [5.0, 7.0])
    assert block_maxima(np.full(12, nan), 4).shape == (0,)


@pytest.mark.parametrize(
    ("values", "expected"),
    [
        ([], []),
        ([np.nan], []),
        ([1.0, np.nan, 3.0], [3.0]),
        ([-1.0, -2.0, -3.0, -4.0], [-1.0]),
        ([np.nan, np.nan, np.nan, 4.0], []),
    ],
)
def test_a_record_shorter_than_a_block_is_one(values, expected):
    found = block_maxima(np.array(values), 4)
    np.testing.assert_array_equal(found, expected)
    assert found.shape == (len(expected),)


@pytest.mark.parametrize(("seconds", "block_s"), [(20.0, 1.0), (1000.0, 25.0), (3600.0, 60.0)])
def test_a_block_lasts_a_minute_or_a_fortieth_of_what_there_is(seconds, block_s):
    white = np.random.default_rng(1).standard_normal(round(seconds / 0.5))
    test = Statistic(name="whitened_energy", windows_s=(4.0,))
    assert healthy_maxima(test, {"p": [(white, White.steady(white), None)]}, {"p": Allowance()}, 0.5).block_s == block_s


@pytest.mark.parametrize(("name", "in_nats"), [("glr", True), ("whitened_energy", False)])
def test_a_test_of_healthy_maxima_is_of_its_windows_rows_and_in_nats_if_it_is_a_likelihoods(name, in_nats):
    white = np.random.default_rng(1).standard_normal(500)
    test = Statistic(name=name, windows_s=(0.4, 4.0), baseline_s=6.0, two_sided=False)
    told = healthy_maxima(test, {"p": [(white, White.steady(white), None)]}, {"p": Allowance()}, 0.1).tests.values()
    assert {(each.reach, each.in_nats) for each in told} == {(4.0, in_nats), (40.0, in_nats)}


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


@pytest.mark.parametrize("samples", [8, 64])
def test_too_little_energy_has_a_threshold_that_silence_passes_and_noise_hardly(samples):
    # the RMS of n samples lies below x with a probability that goes as x^n: exactly known, and never below 0
    law = stats.chi2(samples)
    draw = np.random.default_rng(samples)
    blocks, looks, wanted = 400, 500, 1e-3
    least = np.sqrt(law.ppf(-np.expm1(np.log(draw.uniform(size=(20, blocks))) / looks)) / samples)
    passed = []
    for maxima in -least:
        test = ScoreMaxima(
            maxima=[maxima], greatest=[maxima.max()], reach=1.0, least=lambda _: -math.inf, in_nats=False, most=0.0
        )
        limit = test.threshold(tail_threshold(test.tail(), crossings_per_block=wanted), -math.inf)
        assert limit < 0.0
        passed.append(-np.expm1(looks * np.log1p(-law.cdf(samples * limit**2))))
    assert 0.2 * wanted < np.mean(passed) < 2.0 * wanted


def test_what_is_at_its_greatest_when_healthy_isnt_judged():
    at_most = np.append(-np.random.default_rng(1).exponential(size=50), 0.0)
    test = ScoreMaxima(maxima=[at_most], greatest=[0.0], reach=1.0, least=lambda _: -math.inf, in_nats=False, most=0.0)
    assert test.threshold(tail_threshold(test.tail(), crossings_per_block=1e-3), -math.inf) == math.inf


def judging(**reaches):
    """Return tests of one output, by their windows' rows, on one flight of forty blocks of 100 rows at 100 Hz."""
    maxima = np.random.default_rng(4).exponential(size=40)
    of = {"greatest": [maxima.max()], "least": lambda _: -math.inf, "in_nats": False}
    tests = {("p", label): ScoreMaxima(maxima=[maxima], reach=float(rows), **of) for label, rows in reaches.items()}
    return HealthyMaxima(tests=tests, rows=100, sample_period_s=0.01), maxima


def test_tests_share_a_rate_an_hour_evenly():
    for labels in (["a"], ["a", "b"]):
        seen, maxima = judging(**dict.fromkeys(labels, 10))
        per_block = 0.36 / 3600.0 / len(labels)
        expected = tail_threshold(maxima, crossings_per_block=per_block, shape=common_shape([maxima] * len(labels)))
        assert seen.thresholds(0.36)["p"] == dict.fromkeys(labels, pytest.approx(expected))


def test_a_window_longer_than_blocks_is_judged_by_what_only_it_has_seen_and_the_shortest_anyway():
    """Of ten values above the quartile a window of two blocks has five of its own, a longer one fewer."""
    told = judging(short=10, long=200, longer=210)[0].thresholds(0.36)["p"]
    assert {label: math.isfinite(value) for label, value in told.items()} == {
        "short": True,
        "long": True,
        "longer": False,
    }
    assert math.isfinite(judging(longer=210)[0].thresholds(0.36)["p"]["longer"])


# luck


def seen_on(flights, seed=0, *, heavy=False):
    """Return maxima of twenty tests on flights of ten blocks each."""
    draw = np.random.default_rng(seed)
    tests = {}
    for i in range(20):
        parts = [draw.pareto(0.6, size=10) if heavy else draw.exponential(size=10) for _ in range(flights)]
        greatest = [float(part.max()) for part in parts]
        tests["p", f"test {i}"] = ScoreMaxima(
            maxima=parts, greatest=greatest, reach=1.0, least=lambda _: -math.inf, in_nats=not heavy
        )
    return HealthyMaxima(tests=tests, rows=100, sample_period_s=0.01)


@pytest.mark.parametrize("flights", [1, 3, 10, 40])
def test_redrawn_flights_tell_what_other_flights_would_have_done(flights):
    redrawn = seen_on(flights).luck(0.01)
    others = [seen_on(flights, seed).thresholds(0.01)["p"].values() for seed in range(1, 11)]
    real = Luck.of(np.array([list(of) for of in others]))
    assert math.log(redrawn.within) == pytest.approx(math.log(real.within), rel=0.6)
    assert redrawn.within < 1.5


def test_redraws_are_the_same_every_time():
    assert seen_on(8).redrawn(0.01) == (redrawn := seen_on(8).redrawn(0.01))
    assert len(redrawn) * (len(redrawn) - 1) // 2 == 45  # pairs


@pytest.mark.parametrize("flights", [4, 5])
def test_of_five_flights_whole_ones_are_drawn_and_of_fewer_their_blocks_of_each_test_its_own_many(flights):
    seen = seen_on(flights)
    (key, test), *_ = seen.tests.items()
    short = replace(test, maxima=[part[:3] for part in test.maxima])
    drawn = replace(seen, tests={key: test, "short": short})._drawn(np.random.default_rng(1)).tests
    assert [len(part) for part in drawn[key].maxima] == [10] * flights
    assert [len(part) for part in drawn["short"].maxima] == [3] * flights
    assert drawn[key].greatest == [part.max() for part in drawn[key].maxima]
    whole = {tuple(part) for part in test.maxima}
    assert all(tuple(part) in whole for part in drawn[key].maxima) == (flights == 5)


def test_luck_is_told_to_a_thousandth():
    luck = Luck.of(np.array([[1.0], [1.2345678]]))
    assert (luck.median, luck.within) == (1.235, 1.111)


def test_thresholds_that_are_chance_are_refused_with_how_many_flights_would_do():
    luck = Luck(median=9.0, within=20.0)
    assert luck.enough(5) == 5 * 4 + 1  # half the logarithm of 9 is that of 3
    with pytest.raises(InputError, match=r"5 other flights .* 9 times .* give about 21 flights"):
        luck.check(5, "flights")
    Luck(median=3.0, within=20.0).check(5)
    assert seen_on(5, heavy=True).luck(1e-3).within > 10.0 * seen_on(5).luck(1e-3).within


def test_a_window_that_no_calibration_judges_owes_nothing_to_luck():
    inf = math.inf
    assert Luck.of(np.array([[0.0, 2.0], [0.0, 3.0]])) == Luck.of(np.array([[2.0], [3.0]]))
    assert Luck.of(np.zeros((2, 0))) == Luck(median=1.0, within=1.0)
    assert Luck.of(np.array([[inf, 2.0], [inf, 2.0]])) == Luck(median=1.0, within=1.0)
    assert Luck.of(np.array([[inf, 2.0], [5.0, 2.0], [5.0, 2.0]])).within == inf


@pytest.mark.parametrize(
    ("spread", "told"),
    [
        ({"median": 1.2, "within": 2.0}, (1.2, 2.0)),
        ({"median": 1.0, "within": None}, (1.0, math.inf)),
        ({"median": 0.9, "within": 2.0}, None),
        ({"median": 1.2}, None),
        ("wide", None),
        (None, None),
    ],
)
def test_luck_is_read_of_a_file_that_may_hold_anything(spread, told):
    """And where thresholds are a factor m apart, (log m / log 3)^2 times as many records bring them to three."""
    luck = Luck.from_provenance({"threshold_spread": spread})
    assert (luck and (luck.median, luck.within)) == told
    assert Luck(median=9.0, within=99.0).enough(10) == 4 * 10 + 1

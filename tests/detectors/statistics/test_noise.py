"""The noise that is learnt where it is watched: what of a healthy residual must not matter, and what must."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import toeplitz
from scipy.signal import lfilter

import gtmbench as gb
from gtmbench.detectors.statistics import noise_model
from gtmbench.detectors.statistics.learnt_noise import NoiseFollower, followed, lasting_rows, suspicion_rows
from gtmbench.detectors.statistics.noise_model import (
    COUNT,
    FAST,
    FIRST,
    FOURTHS,
    LAGS,
    LATE,
    MEMORY,
    SIZE,
    SLOW,
    SQUARED_MEANS,
    SQUARES,
    SUM,
    LearntBlocks,
)
from gtmbench.detectors.statistics.statistic import Allowance, Statistic
from gtmbench.detectors.statistics.whitening import White, Whitener
from tests.helpers.monitors import monitor, record, truth
from tests.helpers.night import by_day

TS = 0.01
CALIBRATED = Whitener(coefficients=np.array([1.0, -0.2]), mean=0.0, deviation=1.0)
COLOURED = lfilter([1.0], [1.0, -0.2], np.random.default_rng(5).standard_normal(20_000))


def white(seed=1, samples=20_000):
    return np.random.default_rng(seed).standard_normal(samples)


def wandering(seed, samples=20_000):
    slow = lfilter([1.0], [1.0, -0.999], white(100 + seed, samples)) * np.sqrt(1.0 - 0.999**2)
    noise = white(seed, samples) * np.exp(0.5 * slow)
    return noise / noise.std()


LAWS = {
    "white": white,
    "coloured": lambda seed: lfilter([1.0], [1.0, -0.7], white(seed)) * np.sqrt(1.0 - 0.49),
    "t4": lambda seed: np.random.default_rng(seed).standard_t(4, 20_000) / np.sqrt(2.0),
    "Laplace": lambda seed: np.random.default_rng(seed).laplace(size=20_000) / np.sqrt(2.0),
    "outliers": lambda seed: np.where(np.random.default_rng(seed).random(20_000) < 0.02, 5.0, 1.0) * white(seed + 50),
    "wandering": wandering,
}


def greatest(residual, whitener=CALIBRATED):
    """The greatest ratio of a whole record, in nats."""
    told = followed(whitener, residual, TS)
    return max(np.nanmax(score.values) for score in Statistic().scores(residual, told, TS, Allowance()))


@pytest.mark.parametrize("chunk", by_day([130, 20_000, 1, 7, 50], 2))
def test_the_same_in_whatever_chunks(chunk):
    noise = COLOURED[:6000].copy()
    noise[2500:2520] = np.nan
    noise[3015:3170] = np.nan  # blocks of which nothing is learnt
    noise[3400] += 50.0  # an outlier
    noise[4000:] += 3.0  # held from here on
    noise[5200:5400] += 40.0  # what lasts is none
    whole = NoiseFollower(CALIBRATED, TS).push(noise)
    follower = NoiseFollower(CALIBRATED, TS)
    told = White.joined([follower.push(noise[i : i + chunk]) for i in range(0, len(noise), chunk)])
    np.testing.assert_allclose(told.values, whole.values, rtol=0, atol=1e-9)
    np.testing.assert_allclose(told.unsteady, whole.unsteady, rtol=0, atol=1e-9)
    assert follower.row == len(noise)


@pytest.mark.parametrize("row", [100, 3025, 4110])  # while it learns, within a block, while it is held
def test_a_copy_goes_on_as_the_first_would_and_neither_changes_the_other(row):
    noise = COLOURED[:6000].copy()
    noise[4000:4300] += 3.0
    first, alone = NoiseFollower(CALIBRATED, TS), NoiseFollower(CALIBRATED, TS)
    for follower in (first, alone):
        follower.push(noise[:row])
    other = first.copy()
    other.copy().push(50.0 * noise[row:])
    wanted = alone.push(noise[row:])
    for follower in (first, other):
        told = follower.push(noise[row:])
        np.testing.assert_array_equal(told.values, wanted.values)
        np.testing.assert_array_equal(told.unsteady, wanted.unsteady)
        assert follower.first_rows == alone.first_rows
        assert follower.whitener_at(row).deviation == alone.whitener_at(row).deviation


@pytest.mark.parametrize("level", [0.3, 0.6, 1.3, 10.0, 1000.0])
def test_another_level_changes_next_to_nothing(level):
    one, other = followed(CALIBRATED, COLOURED, TS), followed(CALIBRATED, level * COLOURED, TS)
    apart = np.nanmax(np.abs(one.values - other.values))
    assert apart < (0.3 if level < 1.0 else 0.02)  # a floor far below the calibrated noise is all that tells them apart


def test_a_spread_that_grows_with_its_residual_changes_only_what_it_is_measured_in():
    noise = LAWS["outliers"](3)[:5990]
    noise[[300, 3000]] = 1e4
    one = NoiseFollower(CALIBRATED, TS).push(noise)
    other = NoiseFollower(CALIBRATED, TS).push(3.0 * noise, np.full(5990, 3.0))
    np.testing.assert_allclose(other.values, 3.0 * one.values, rtol=1e-9)
    np.testing.assert_allclose(other.unsteady, one.unsteady, rtol=1e-9)


@pytest.mark.parametrize("chunk", [1, 130])
def test_outliers_are_counted_once_a_second_and_their_echo_counts_for_one_deviation(chunk):
    noise = LAWS["outliers"](3).copy()
    follower = NoiseFollower(CALIBRATED, TS)
    follower.push(noise[:9870])
    before = follower.outliers
    noise[9870:10_300] = np.clip(noise[9870:10_300], -1.0, 1.0)
    noise[10_025:10_027] = [-4.0, 4.0]  # the last of the echo, and the first after it
    noise[[10_000, 10_098, 10_180]] = 300.0  # the second is too soon
    told = White.joined([follower.push(noise[i : i + chunk]) for i in range(9870, 10_300, chunk)])
    assert follower.outliers - before == 2
    outlier, last, first = np.abs(told.values[[130, 155, 156]])
    assert min(outlier, first) > 1.5 * last


def test_a_mean_that_was_there_from_the_first_changes_nothing():
    one, other = followed(CALIBRATED, COLOURED[:4000], TS), followed(CALIBRATED, COLOURED[:4000] + 100.0, TS)
    np.testing.assert_allclose(other.values, one.values, atol=1e-9)
    np.testing.assert_allclose(other.unsteady, one.unsteady, atol=1e-9)


def test_noise_is_learnt_once_the_first_blocks_are_there_and_nothing_is_clipped_before_an_outlier():
    follower, rows = NoiseFollower(CALIBRATED, TS), 700  # seven seconds
    assert len(follower.push(COLOURED[: rows - 1])) == 0
    told = follower.push(COLOURED[rows - 1 : rows])
    assert (follower.is_learnt, len(told)) == (True, rows)
    assert np.nanmax(np.abs(told.values[100:].reshape(-1, 25)), axis=1).min() > 1.1


@pytest.mark.parametrize("row", [1000, 1049, 1050, 2000])  # blocks begin at multiples of 50
def test_a_row_is_whitened_by_what_is_told_of_it(row):
    follower = NoiseFollower(CALIBRATED, TS)
    told = White.joined([follower.push(COLOURED[start : start + 130]) for start in range(0, 3000, 130)])
    by = follower.whitener_at(row)
    assert by.loudest == pytest.approx(by.most * 5.0 / 4.0)  # of a tail that is clipped at four deviations
    assert told.values[row] == pytest.approx(by.whiten(COLOURED[row - by.order : row + 1])[-1], rel=1e-9)


def test_the_mean_of_the_first_seconds_is_a_mean_but_for_outliers():
    noise = 100.0 + np.random.default_rng(3).exponential(size=1000)  # of mean 1 and median 0.69, clipped at 3.6
    noise[[40, 500]] = 1e6
    follower = NoiseFollower(CALIBRATED, TS)
    follower.push(noise)
    assert follower.whitener.mean == pytest.approx(101.0 - np.exp(-3.6), abs=0.1)


@pytest.mark.parametrize("missing", [25, 26])
def test_a_block_of_which_half_is_missing_is_learnt_from_and_of_which_more_is_not(missing):
    noise = COLOURED[: FIRST * 50].copy()
    noise[150 : 150 + missing] = np.nan
    assert len(NoiseFollower(CALIBRATED, TS).push(noise)) == (FIRST * 50 if missing == 25 else 0)


def test_rows_are_whitened_alike_to_the_end_of_their_block_once_the_noise_is_learnt():
    follower = NoiseFollower(CALIBRATED, TS)
    follower.push(COLOURED[:100])
    assert follower.rows_alike == 0
    follower.push(COLOURED[100:3010])
    assert follower.rows_alike == 40


def test_a_sample_is_loud_beyond_four_deviations_until_half_a_second_is_as_loud():
    follower, sizes = NoiseFollower(CALIBRATED, TS), np.repeat([0.0, 3.0], [10, 60])
    loud = follower._loud_in(sizes, np.full(70, 2.0))
    assert np.flatnonzero(loud).tolist() == list(range(10, 10 + 24))  # then the median of 50 is between none and all
    assert not follower._loud_in(sizes, np.full(70, 1.3)).any()


def test_windows_that_suspicions_are_found_in_have_four_rows_at_least_and_what_lasts_five():
    assert suspicion_rows(0.1) == [4, 13, 51]
    assert [lasting_rows(period_s) for period_s in (0.01, 0.04, 0.2)] == [50, 12, 5]


@pytest.mark.parametrize(("row", "size"), [(49, 6.4), (50, 6.4), (50, 6.0)])
def test_a_block_is_suspected_by_its_own_rows_from_twelve_nats_on(row, size):
    """One sample of 6.24 deviations in 8 makes their power s = 5.75, and L / 2 (s - 1 - log s) = 12."""
    joined = np.tile([1.0, -1.0], 306)
    joined[512 + row] = size
    steady = replace(
        learnt(order=8).model.repeated(3).repeated(2), unsteady=np.zeros(2), slow=np.zeros(2), base=np.full(2, 0.5)
    )
    suspected = NoiseFollower(CALIBRATED, TS)._suspected(joined + 0.5, steady)  # about the mean that was learnt
    assert len(steady.clip) == 2
    assert (suspected > 0).tolist() == [row == 49, size > 6.24]


def test_what_is_suspected_is_over_after_two_calm_seconds_and_the_noise_after_two_minutes():
    follower, order = NoiseFollower(CALIBRATED, TS), 8
    follower._held = learnt(order).model
    assert follower._wait(np.array([False, False, True, False, False, False, False, False])) == 7
    assert not follower.is_held
    follower._held, follower._ring, follower._held_for = learnt(order).model, np.ones((20, LAGS.start + order + 1)), 0
    assert follower._wait(np.ones(300, dtype=bool)) == 240
    assert (follower.is_held, follower.is_learnt) == (False, False)


def test_what_is_suspected_is_taken_out_of_what_was_learnt_and_so_is_what_misses_half():
    follower = NoiseFollower(CALIBRATED, TS)
    table = np.ones((5, LAGS.start + 9))
    table[:, COUNT] = [25.0, 24.0, 50.0, 50.0, 50.0]
    follower._ring = np.ones((20, table.shape[1]))
    follower._remember(table)
    assert len(follower._ring) == 20 + 4
    follower._suspect(table[2:], 1)  # the last of three, and one before
    assert len(follower._ring) == 24 + 1
    follower._suspect(table[:1], 3)  # three before what was told
    assert len(follower._ring) == 25 - 3
    follower._suspect(table[:1], 30)
    assert len(follower._ring) == FIRST
    follower._remember(np.full((1000, table.shape[1]), 50.0))
    assert len(follower._ring) == MEMORY + LATE + 1 + 16  # with some that a suspicion may take out


BLOCKS, ROWS = 500, 50  # measured blocks, of which 400 before the last 16 tell of steadiness, and rows of each


def learnt(order=3, blocks=BLOCKS, sums=(1.0, 3.0), means=(1.0,) * 5, **columns):
    """Return what is learnt from blocks that are all alike: means of samples, of white noise unless told."""
    table = np.zeros((blocks, LAGS.start + order + 1))
    table[:, COUNT] = ROWS
    usual = {"SIZE": np.sqrt(2.0 / np.pi), "CLIPPED": [1.0] * 4, "FOURTH": 3.0, "LAGS": np.eye(1, order + 1)[0]}
    for name, value in (usual | columns).items():
        table[:, getattr(noise_model, name)] = ROWS * np.array(value)
    table[:, [SQUARES, FOURTHS]], table[:, SQUARED_MEANS] = sums, means
    return LearntBlocks(table, 1, np.array([blocks]), ROWS)


def test_noise_is_followed_over_twenty_seconds_and_remembered_for_two_hundred():
    of = learnt(blocks=14)
    of._table[0, SIZE] = 100.0 * ROWS  # the first of fewer counts, too
    assert of.local[0] == pytest.approx((100.0 * np.sqrt(np.pi / 2.0) + 13.0) / 14.0)
    longer = learnt(blocks=500)
    longer._table[459, SIZE] = 1e9  # twenty seconds are 40 blocks
    assert learnt(SIZE=0.0).local[0] == pytest.approx(0.1 * 0.05)  # a tenth of the floor's deviation
    assert longer.local[0] == pytest.approx(1.0)
    assert [int(each[0]) for each in longer._remembered] == [500 - 16 - 400, 500 - 16]


def test_the_second_filter_solves_the_yule_walker_equations_above_a_floor():
    (taps,) = learnt(LAGS=[1.0, 0.7, 0.3, 0.1]).taps
    floored = np.array([1.0 + 1e-4 + 0.0025, 0.7, 0.3, 0.1])
    expected = np.append(1.0, -np.linalg.solve(toeplitz(floored[:3]), floored[1:]))
    np.testing.assert_allclose(taps, expected / np.sqrt(expected @ floored), rtol=1e-9)


@pytest.mark.parametrize(
    ("kurtosis", "clip", "power"), [(3.0, 4.0, 1.0), (3.4, 3.76, 0.9904), (4.0, 3.04, 0.9524), (9.0, 2.5, 0.9)]
)
def test_a_heavier_tail_is_clipped_sooner_and_scaled_to_the_power_that_is_left(kurtosis, clip, power):
    of = learnt(CLIPPED=[1.8, 1.9, 1.96, 2.0], FOURTH=4.0 * kurtosis)
    assert [each[0] for each in of.tail[:2]] == pytest.approx([clip, (2.0 * power + 0.0025 / 1.0026) ** -0.5])


def test_noise_far_below_the_floor_is_as_unsteady_as_the_floor_is_larger():
    quiet = 0.001 / 0.0035001
    of = learnt(LAGS=[0.001, 0.0, 0.0, 0.0], CLIPPED=[quiet] * 4)
    assert of.model.unsteady[0] == pytest.approx((0.5 * np.log(quiet / (quiet + 0.0025 / 0.0035001))) ** 2)


UNKNOWN = 0.001 + 0.2 * (20.0 / 420.0) ** 2  # what 400 blocks leave open of steadiness


@pytest.mark.parametrize(
    ("said", "beyond"),
    [
        ({}, 0.0),
        ({"SLOW": 0.1 / ROWS}, 0.1 - 0.1 / 50.0),  # 2 / sqrt(blocks) of chance: by the rows of a block,
        ({"FAST": 0.1 / ROWS}, 0.1 - 0.45 / 50.0),  # of its parts,
        ({"LOW": 0.1 / ROWS}, 0.1 - 0.016),  # and of the sums that it has
        ({"sums": [1.0, 5.0]}, (2.0 - np.sqrt(24.0 / 5.0) * 0.1) / 20.0),
        ({"sums": [2.0, 400.0]}, 3.0 / 20.0),
    ],
    ids=range(6),
)
def test_what_is_unsteady_is_what_chance_leaves_of_powers_and_of_short_sums_tails(said, beyond):
    assert learnt(**said)._unsteady[0] == pytest.approx(beyond + UNKNOWN)


@pytest.mark.parametrize("place", range(5))
def test_means_of_so_many_blocks_are_slow_beyond_two_and_a_half_deviations_of_chance(place):
    length = 2**place
    limit = 2.5 * (1.0 + 4.0 * UNKNOWN) * np.sqrt(2.0 * length / 400.0)
    for factor, is_told in ((0.999, False), (1.001, True)):
        excess = factor * limit
        found = learnt(means=1.0 + excess * (np.arange(5) == place))._slow[0]
        left = 1.0 / 50.0 * (20.0 / 420.0) ** 4
        assert found == pytest.approx(left + is_told * excess / (length * ROWS))
    for blocks, is_told in ((4 * length, True), (4 * length - 1, False)):  # and of four times as many at least
        found = learnt(blocks=max(blocks, FIRST) + LATE, means=1.0 + 50.0 * (np.arange(5) == place))._slow[0]
        assert (found > 30.0 / (length * ROWS)) == (is_told or blocks < FIRST)


def test_the_powers_of_blocks_are_multiplied_by_the_mean_of_the_four_before_each():
    sizes = np.array([1.0, 1.5, 0.5, 1.2, 0.8, 1.1, 9.0])
    powers = np.minimum(sizes**2, 4.0) - 1.0
    table = np.zeros((7, LAGS.start + 9))
    ends = NoiseFollower(CALIBRATED, TS)._measure_steadiness(table, np.repeat(sizes, 50) * np.tile([1.0, -1.0], 175))
    padded = np.append(np.zeros(4), powers)
    np.testing.assert_allclose(table[:, SLOW], [powers[k] * padded[k : k + 4].mean() for k in range(7)], atol=1e-12)
    np.testing.assert_allclose(table[1:, FAST], (4.0 * powers[1:] ** 2 + powers[1:] * powers[:-1]) / 5.0, atol=1e-12)
    np.testing.assert_allclose(ends[0][:, 0], powers[3:])


def test_means_over_some_blocks_are_squared_over_their_rows_and_there_was_nothing_before_the_first():
    table = np.zeros((20, LAGS.start + 9))
    table[:, SUM] = white(2, 20)
    last = NoiseFollower(CALIBRATED, TS)._measure_means(table)
    for place, length in enumerate((1, 2, 4, 8, 16)):
        sums = [table[max(k + 1 - length, 0) : k + 1, SUM].sum() for k in range(20)]
        np.testing.assert_allclose(table[:, SQUARED_MEANS.start + place], np.square(sums) / (length * 50))
    assert last.tolist() == table[-15:, SUM].tolist()


def test_the_trend_of_blocks_is_the_variance_of_the_line_through_their_sums():
    table = np.zeros((60, 40))
    table[:, SUM] = 5.0 + np.cumsum(white(2, 60))
    first, end = np.array([3, 10]), np.array([40, 55])
    found = LearntBlocks(table, 1, np.array([60]), 50)._trend(first, end)
    for place, (start, stop) in enumerate(zip(first, end, strict=True)):
        line = np.polyval(np.polyfit(np.arange(start, stop), table[start:stop, SUM], 1), np.arange(start, stop))
        assert found[place] == pytest.approx(line.var())


@pytest.mark.parametrize("law", LAWS)
def test_healthy_noise_of_any_law_stays_below_what_thresholds_are(law):
    assert max(greatest(0.8 * LAWS[law](seed)) for seed in range(4)) < 22.0  # 0.002 an hour of 54 tests ask for 23


@pytest.mark.parametrize("law", LAWS)
def test_a_step_is_seen_in_noise_of_any_law(law):
    broken = LAWS[law](7).copy()
    broken[10_000:] += 2.5
    told = followed(CALIBRATED, broken, TS)
    scores = Statistic().scores(broken, told, TS, Allowance())
    above = np.logical_or.reduce([score.values > 23.0 for score in scores])
    assert 10_000 <= np.argmax(above) < 10_200


@pytest.mark.parametrize("law", ["t4", "wandering", "outliers"])
def test_a_large_step_shows_as_large_in_noise_of_any_tail(law):
    def seen(size):
        broken = LAWS[law](8).copy()
        broken[10_000:10_200] += size
        scores = Statistic().scores(broken, followed(CALIBRATED, broken, TS), TS, Allowance())
        return max(np.nanmax(score.values[10_000:10_200]) for score in scores)

    assert seen(40.0) > 10.0 * seen(4.0)


def test_one_sample_far_off_is_no_fault_and_some_a_second_are():
    def seen(rows):
        broken = COLOURED[:12_000].copy()
        broken[rows] += 30.0
        return greatest(broken)

    assert seen([9000]) < 20.0
    assert seen(np.arange(9000, 9500, 20)) > 40.0


def test_nothing_is_learnt_while_something_is_suspected():
    broken = COLOURED[:12_000].copy()
    broken[6000:] += 2.0
    follower = NoiseFollower(CALIBRATED, TS)
    follower.push(broken[:6000])
    before = follower.whitener
    follower.push(broken[6000:11_000])
    assert follower.is_held
    np.testing.assert_allclose(follower.whitener.coefficients, before.coefficients, atol=0.05)
    assert follower.whitener.deviation == pytest.approx(before.deviation, rel=0.05)


@pytest.mark.parametrize(("times", "shift"), [(1.7, 0.0), (0.5, 0.0), (1.0, 0.35)])
def test_power_or_mean_that_changes_for_good_is_measured_for_a_minute_by_what_was_before(times, shift):
    noise = white(4, 16_000)
    noise[8000:] = times * noise[8000:] + shift
    told = followed(CALIBRATED, noise, TS).values[11_000:]
    assert np.nanstd(told) == pytest.approx(times, rel=0.08)
    assert np.nanmean(told) == pytest.approx(shift, abs=0.06)


def test_steady_noise_is_known_to_be_and_wandering_noise_too():
    steady, unsteady = (NoiseFollower(CALIBRATED, TS) for _ in range(2))
    steady.push(COLOURED)
    unsteady.push(wandering(1))
    assert steady.whitener.unsteady < 0.02 < 0.2 < unsteady.whitener.unsteady


def with_noise(of, channels, factor, *, since_s=0.0, seed=9):
    """A record whose sensors' noise is so many times as strong, more of it being added."""
    draw = np.random.default_rng(seed)
    for name in channels:
        deviation = gb.CHANNELS[name].noise * np.sqrt(factor**2 - 1.0)
        of = of.replace(name, of[name] + np.where(of.time_s >= since_s, deviation, 0.0) * draw.standard_normal(len(of)))
    return of


CHANNELS = ("p", "q", "r", "phi", "theta", "psi")


@pytest.mark.parametrize("name", ["C", "C-early"])
def test_sensors_ten_times_as_noisy_are_healthy(name):
    watch = monitor(name).watch(with_noise(record(), CHANNELS, 10.0))
    assert watch.faults == ()
    assert 5.0 < min(watch.noise_levels.values()) < 20.0


def test_noise_that_changes_is_a_verdict_that_names_nobody():
    healthy = record()
    since_s = healthy.start_s + 60.0
    watch = monitor("C").watch(with_noise(healthy, CHANNELS, 2.0, since_s=since_s))
    assert watch.faults
    for alarm in watch.faults:
        assert alarm.sensor is None
        assert alarm.verdict == "can't tell: the noise changed"
        assert alarm.time_s > since_s
    times = watch.faults[0].judgements[-1].parameters["times"]
    assert 1.4 < times < 3.0


def test_noise_of_one_gyro_beyond_three_times_is_its_fault():
    healthy = record()
    noise = gb.Noise(channel="q", onset_s=healthy.start_s + 60.0, deviation=8.0 * gb.CHANNELS["q"].noise, seed=3)
    (alarm,) = monitor("C").watch(gb.inject(healthy, noise)).faults
    assert (alarm.sensor, alarm.judgements[-1].kind) == ("q", "noise")


def wandering_record(seed):
    """A healthy record of 120 s, every sensor's noise of a level that wanders by a factor of two within a minute."""
    healthy, draw = truth(seed=11), np.random.default_rng(seed)
    for name in CHANNELS:
        slow = lfilter([1.0], [1.0, -0.9993], draw.standard_normal(len(healthy))) * np.sqrt(1.0 - 0.9993**2)
        level = gb.CHANNELS[name].noise * np.exp(0.7 * (slow - slow.mean()))
        healthy = healthy.replace(name, healthy[name] + level * draw.standard_normal(len(healthy)))
    return healthy


@pytest.mark.parametrize("seed", by_day([1, 2, 3]))
@pytest.mark.parametrize("channel", by_day(["p", "r", "phi", "psi"], 2))
def test_what_is_named_in_noise_that_wanders_is_what_failed(seed, channel):
    slope = 12.0 * gb.CHANNELS["p"].noise  # of an angle: what it adds to the gyro's residual
    onset_s = 70.0
    fault = (
        gb.Drift(channel=channel, onset_s=onset_s, slope=slope)
        if channel in ("phi", "psi")
        else gb.Bias(channel=channel, onset_s=onset_s, size=slope)
    )
    watch = monitor("C").watch(gb.inject(wandering_record(seed), fault))
    late = [alarm for alarm in watch.faults if alarm.time_s > onset_s]
    assert late
    assert {judged.sensor for alarm in late for judged in alarm.judgements} <= {channel, None}
    assert any(alarm.sensor == channel or channel in alarm.candidates for alarm in late)
    if channel in ("p", "r"):  # a gyro's bias enters one residual, a drift of the angle all of them
        assert {alarm.sensor for alarm in late} == {channel}


@pytest.fixture(scope="module")
def rival():
    return gb.find_detector("kinematic-kalman-no-fir").calibrate([record(seed=seed) for seed in range(1, 4)])


@pytest.mark.parametrize("times", [0.4, 1.8, 2.5])
def test_a_rival_names_nobody_for_noise_of_another_level(rival, times):
    since_s = 60.0
    draw, sensed = np.random.default_rng(4), truth(seed=11)
    for name in CHANNELS:
        level = gb.CHANNELS[name].noise * np.where(sensed.time_s < since_s, 1.0, times)
        sensed = sensed.replace(name, sensed[name] + level * draw.standard_normal(len(sensed)))
    watch = rival.watch(sensed)
    assert watch.faults
    assert {alarm.verdict for alarm in watch.faults} == {"can't tell: the noise changed"}
    assert min(alarm.time_s for alarm in watch.faults) > since_s


@pytest.mark.parametrize("gyro", ["p", "q", "r"])
def test_a_rival_names_a_gyro_whose_error_has_a_mean_or_motion_in_it(rival, gyro):
    sensed, noise = record(seed=11), gb.CHANNELS[gyro].noise
    for fault in (
        gb.Bias(channel=gyro, onset_s=60.0, size=3.0 * noise),
        gb.ScaleFactor(channel=gyro, onset_s=60.0, factor=0.6),
    ):
        assert {alarm.sensor for alarm in rival.watch(gb.inject(sensed, fault)).faults} == {gyro}


@pytest.mark.parametrize("memory_s", [1.0, 5.0])
def test_a_slow_part_of_the_noise_is_learnt_and_white_noise_has_none(memory_s):
    pole = np.exp(-TS / memory_s)
    slow = lfilter([1.0], [1.0, -pole], white(31)) * np.sqrt(1.0 - pole**2)
    with_it, without = (followed(CALIBRATED, noise, TS) for noise in (white(32) + 0.4 * slow, white(32)))
    late = slice(10_000, None)
    assert np.median(with_it.slow[late]) > 5e-3  # the second filter has taken some of 0.16
    assert np.median(without.slow[late]) < 1e-4
    healthy = Statistic().scores(white(32) + 0.4 * slow, with_it, TS, Allowance())
    assert max(np.nanmax(score.values[late]) for score in healthy) < 25.0


def test_a_drift_is_no_slow_noise():
    drift = 1e-3 * np.maximum(np.arange(20_000) - 1000.0, 0.0)
    told = followed(CALIBRATED, white(33) + drift, TS)
    scores = Statistic().scores(white(33) + drift, told, TS, Allowance())
    assert 1000 <= np.argmax(np.logical_or.reduce([score.values > 25.0 for score in scores])) < 2500

"""Test statistics: every series against loops and likelihoods written out, causal, and sound after gaps and spikes."""

import math
from dataclasses import replace

import numpy as np
import pytest
from scipy.stats import norm

from gtmbench.detectors.statistics.statistic import (
    STATISTICS,
    Allowance,
    Spread,
    Statistic,
    Steadiness,
    glr,
    over,
    tolerance_of,
)
from gtmbench.detectors.statistics.whitening import White

TS = 0.1
NONE = Allowance()
SOME = Allowance(mean=0.3, low=0.7, high=1.4)
every_statistic = pytest.mark.parametrize("name", STATISTICS)
GIVEN = {"windows_s": (0.4, 1.0, 2.5), "baseline_s": 6.0}


def noise(samples=300, seed=3):
    return np.random.default_rng(seed).standard_normal(samples)


def series(name, e, white=None, tolerance=NONE, **settings):
    """Return values and reach of every series by its label."""
    test = Statistic(name=name, **{**GIVEN, **settings})
    scores = test.scores(e, White.steady(e if white is None else white), TS, tolerance)
    assert len({score.label for score in scores}) == len(scores)
    return {score.label: score for score in scores}


def values(name, e, **settings):
    return {label: score.values for label, score in series(name, e, **settings).items()}


def base_of(w, end, rows=60):
    """Return the samples that a baseline of up to `rows` before `end` holds; None where it is too short."""
    before = w[max(end - rows, 0) : max(end, 0)]
    return before if len(before) >= rows // 9 else None


def windows(w, rows):
    """Yield k, baseline and window wherever there are both."""
    for k in range(rows - 1, len(w)):
        base = base_of(w, k + 1 - rows)
        if base is not None:
            yield k, base, w[k + 1 - rows : k + 1]


# against independent answers


@pytest.mark.parametrize("rows", [4, 10, 25])
def test_glr_of_the_mean_is_what_one_more_mean_gains_in_likelihood(rows):
    w = noise() + np.repeat([0.0, 1.5, -0.5], 100)
    expected = np.full(len(w), np.nan)
    for k, base, window in windows(w, rows):
        together = np.concatenate([base, window])
        single = norm.logpdf(together, together.mean()).sum()
        two = norm.logpdf(base, base.mean()).sum() + norm.logpdf(window, window.mean()).sum()
        expected[k] = two - single
    np.testing.assert_allclose(values("glr", w)[f"mean {rows * TS:g} s"], expected, rtol=0, atol=1e-9)


@pytest.mark.parametrize("rows", [4, 10, 25])
def test_glr_of_the_energy_is_what_another_variance_gains_in_likelihood(rows):
    w = noise() * np.repeat([1.0, 2.0, 0.4], 100)
    expected = np.full(len(w), np.nan)
    for k, base, window in windows(w, rows):
        spread = math.sqrt(np.mean((window - base.mean()) ** 2))
        expected[k] = np.sum(norm.logpdf(window, base.mean(), spread) - norm.logpdf(window, base.mean(), 1.0))
    np.testing.assert_allclose(values("glr", w)[f"energy {rows * TS:g} s"], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("slow", [0.0, 0.05])
@pytest.mark.parametrize("doubt", [0.0, 0.02])
def test_what_slow_noise_and_an_operator_do_to_a_mean_adds_to_its_variance(slow, doubt):
    e, rows = noise(), 10
    told = White(values=e, unsteady=np.zeros(300), slow=np.full(300, slow), loud=np.zeros(300))
    spread = Spread(raw=np.ones(300), white=np.ones(300), means={rows: np.full(300, doubt)})
    (score,) = [
        each
        for each in Statistic(**GIVEN).scores(e, told, TS, NONE, spread if doubt else None)
        if each.label == f"mean {rows * TS:g} s"
    ]
    known, variance = values("glr", e)["mean 1 s"], 1.0 / rows + 1.0 / 60.0
    share = variance / (variance + 2.0 * slow + doubt)
    np.testing.assert_allclose(score.values[70:], share * known[70:], rtol=1e-9)


def test_a_ratio_is_students_and_never_more_than_that_of_known_noise_nor_less_than_that_of_the_loudest():
    def of_mean(shift, power, unsteady):
        told = glr(np.array([shift]), np.array([power]), 25, 0.04, 0.5, 1.0, 1.0, Steadiness.of(np.array([unsteady])))
        return float(told[0][0])

    square, nu = (3.5 - 0.5) ** 2 / 0.04, 2.0 / 0.2
    student = 0.5 * (nu + 25) * math.log1p(square / (nu + 25 * 1.0))
    assert of_mean(3.5, 1.0 + 3.5**2, 0.2) == pytest.approx(student)
    assert of_mean(3.5, 1.0 + 3.5**2, 0.0) == pytest.approx(0.5 * square)
    assert of_mean(0.7, 0.5, 1e-4) == pytest.approx(0.5 * 0.2**2 / 0.04)  # although the window itself is quieter
    assert of_mean(0.7, 0.5, 0.05**2) == pytest.approx(0.5 * 0.2**2 / 0.04 / math.exp(2.5 * 0.02))
    assert of_mean(20.5, 500.0, 0.2) == pytest.approx(20.0**2 / 0.04 / 18.0)


@pytest.mark.parametrize("loud", [0.9, 1.1, 2.0])
def test_power_beyond_the_loudest_is_held_against_nine_times_the_noise_however_unsteady_it_is(loud):
    told = glr(np.zeros(1), np.array([1.4 * 9.0 * loud]), 25, 0.04, 0.0, 1.0, 1.4, Steadiness.of(np.array([2.0])))
    assert told[1][0] == pytest.approx(max(12.5 * (loud - 1.0 - math.log(loud)), 0.0) if loud > 1.0 else 0.0)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_power_within_two_deviations_of_how_unsteady_noise_is_tells_nothing(sign):
    for far, tells in ((1.99, False), (2.2, True)):
        power = np.exp(np.array([sign * far * 0.3]))
        told = glr(np.zeros(1), power, 25, 0.04, 0.0, 1.0, 1.0, Steadiness.of(np.array([0.3**2])))
        assert (told[1][0] > 1e-6) == tells


def test_a_statistic_looks_back_at_a_baseline_a_window_and_a_sample():
    test = Statistic(windows_s=(0.4, 1.0), baseline_s=60.0)
    assert (test.looks_back(TS), replace(test, baseline_s=0.1).looks_back(TS)) == (600 + 10 + 1, 6 + 10 + 1)


def test_over_a_threshold_that_is_none_nothing_is_and_over_zero_all():
    values = np.array([2.0, -1.0])
    assert over(values, 4.0).tolist() == [0.5, -0.25]
    assert over(values, -4.0).tolist() == [-2.0, 4.0]
    assert over(values, 0.0).tolist() == [math.inf, -math.inf]
    assert np.isnan(over(np.array([math.inf]), math.inf)).all()


def test_energy_is_tolerated_as_far_as_an_operators_error_of_four_deviations_makes_it():
    """Of a spread of 2 three quarters of the variance are the operator's."""
    e, rows, high = 20.0 * noise(), 10, 1.0 + 15.0 * 0.75
    spread = Spread(raw=np.ones(300), white=np.full(300, 2.0))
    scores = {score.label: score.values for score in Statistic(**GIVEN).scores(e, White.steady(e), TS, NONE, spread)}
    found = scores["energy 1 s"]
    np.testing.assert_allclose(scores["mean 1 s"], values("glr", e)["mean 1 s"])  # which is of the residual as it is
    for k, base, window in windows(e / 2.0, rows):
        ratio = np.mean((window - base.mean()) ** 2) / high
        assert found[k] == pytest.approx(5.0 * (max(ratio, 1.0) - 1.0 - math.log(max(ratio, 1.0))), abs=1e-9)


def test_a_window_is_a_new_look_eight_times_its_length_and_never_more_than_once_a_row_a_cusum_every_ten():
    assert {score.looks_per_row for score in series("cusum", noise()).values()} == {0.1}
    looks = {label: score.looks_per_row for label, score in series("glr", noise()).items()}
    assert looks == {f"{of} {0.1 * rows:g} s": min(8 / rows, 1.0) for of in ("mean", "energy") for rows in (4, 10, 25)}


def test_windows_of_each_length_are_twice_as_long_as_the_ones_before_and_nothing_is_tolerated_unless_told():
    assert Statistic().windows_s == tuple(0.08 * 2**doubled for doubled in range(9))
    assert Allowance(mean=0.0, low=1.0, high=1.0) == NONE
    assert Statistic(baseline_s=60.0, shift=0.25, ratio=2.0) == Statistic()


def test_a_baseline_of_a_few_rows_is_a_mean_of_one_at_least():
    """At 6 readings a second a short log's baseline has six rows, of which a ninth is none."""
    w, rows = noise() + np.repeat([0.0, 1.5, -0.5], 100), 4
    found = values("glr", w, baseline_s=0.6)["mean 0.4 s"]
    for k in (rows, rows + 1, 200):  # the first that has a baseline, of one row
        base, window = w[max(k + 1 - rows - 6, 0) : k + 1 - rows], w[k + 1 - rows : k + 1]
        chance = 1.0 / len(base) + 1.0 / rows
        assert found[k] == pytest.approx((window.mean() - base.mean()) ** 2 / chance / 2.0)
    assert np.isnan(found[:rows]).all()


def test_glr_judges_only_what_lies_outside_the_tolerance():
    w, rows = noise() * np.repeat([1.0, 2.0, 0.4], 100) + np.repeat([0.0, 0.5, 1.5], 100), 10
    tests = values("glr", w, tolerance=SOME)
    one_sided = values("glr", w, tolerance=SOME, two_sided=False)
    for k, base, window in windows(w, rows):
        beyond = max(abs(window.mean() - base.mean()) - SOME.mean, 0.0)
        spread = np.mean((window - base.mean()) ** 2)
        nearest = min(max(spread, SOME.low), SOME.high)
        ratio = spread / nearest
        energy = rows / 2.0 * (ratio - 1.0 - math.log(ratio))
        assert tests["mean 1 s"][k] == pytest.approx(beyond**2 / 2.0 / (1.0 / rows + 1.0 / len(base)), abs=1e-9)
        assert tests["energy 1 s"][k] == pytest.approx(energy, rel=1e-9, abs=1e-9)
        assert one_sided["energy 1 s"][k] == pytest.approx(energy if spread > SOME.low else 0.0, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("tolerance", [NONE, SOME])
def test_cusum_is_pages_recursion_on_log_likelihood_ratios(tolerance):
    w = noise() + np.repeat([0.0, 1.0, -1.0], 100)
    w[220:] *= 0.2
    shift, ratio = 0.5, 3.0
    sums = series("cusum", w, shift=shift, ratio=ratio, tolerance=tolerance)
    low, high = math.sqrt(tolerance.low), math.sqrt(tolerance.high)
    steps = {
        "mean up": lambda x: norm.logpdf(x - tolerance.mean, shift) - norm.logpdf(x - tolerance.mean),
        "mean down": lambda x: norm.logpdf(x + tolerance.mean, -shift) - norm.logpdf(x + tolerance.mean),
        "variance up": lambda x: norm.logpdf(x, 0.0, high * math.sqrt(ratio)) - norm.logpdf(x, 0.0, high),
        "variance down": lambda x: norm.logpdf(x, 0.0, low / math.sqrt(ratio)) - norm.logpdf(x, 0.0, low),
    }
    for label, step in steps.items():
        at, zero = 0.0, 0
        for k in range(len(w)):
            base = base_of(w, k)
            if base is None:
                assert np.isnan(sums[f"cusum {label}"].values[k])
                continue
            at = max(at + step(w[k] - base.mean()), 0.0)
            zero = k if at == 0.0 else zero
            assert sums[f"cusum {label}"].values[k] == pytest.approx(at, rel=1e-9, abs=1e-8)
            if at > 1e-6:
                assert k - sums[f"cusum {label}"].reach[k] == max(zero, 5)  # the last row before there is a baseline
    assert set(sums) == {f"cusum {label}" for label in steps}


def test_energies_are_sums_over_windows():
    e, white = 3.0 * noise(seed=1), noise(seed=2)
    norms = series("energy", e, white, two_sided=False)
    powers = series("whitened_energy", e, white, two_sided=True)
    assert set(norms) == {"energy 0.4 s high", "energy 1 s high", "energy 2.5 s high"}
    for rows in (4, 10, 25):
        for k in range(len(e)):
            whole = k >= rows
            expected = math.sqrt(sum(x * x for x in e[k - rows : k + 1])) if whole else math.nan  # w + 1 squares
            assert norms[f"energy {rows * TS:g} s high"].values[k] == pytest.approx(expected, nan_ok=True)
            whole = k >= rows - 1
            expected = math.sqrt(sum(x * x for x in white[k - rows + 1 : k + 1]) / rows) if whole else math.nan
            assert powers[f"whitened energy {rows * TS:g} s high"].values[k] == pytest.approx(expected, nan_ok=True)
        label = f"whitened energy {rows * TS:g} s"
        np.testing.assert_array_equal(powers[f"{label} low"].values, -powers[f"{label} high"].values)


# what holds for all of them


@every_statistic
def test_missing_rows_are_passed_over(name):
    e = noise()
    gap = np.zeros(300, dtype=bool)
    gap[[0, 57, 58, 59, 150, 299]] = True
    gap[200:231] = True
    e[gap] = np.nan
    gappy, compressed = series(name, e, tolerance=SOME), series(name, e[~gap], tolerance=SOME)
    where = np.flatnonzero(~gap)
    for label, score in gappy.items():
        assert np.isnan(score.values[gap]).all()
        np.testing.assert_array_equal(score.values[~gap], compressed[label].values)
        # the change began at the same sample: rows, gaps counted
        began = np.maximum(np.arange(len(where)) - compressed[label].reach, 0)
        np.testing.assert_array_equal(where - score.reach[~gap], where[began])


@every_statistic
def test_a_row_stands_on_rows_up_to_it(name):
    e = noise()
    whole = series(name, e)
    for stop in (1, 5, 77, 150, 299):
        part, other = series(name, e[:stop]), series(name, np.concatenate([e[:stop], 1e3 * noise(300 - stop)]))
        for label, score in whole.items():
            for shorter in (part[label], other[label]):
                np.testing.assert_array_equal(shorter.values[:stop], score.values[:stop])
                np.testing.assert_array_equal(shorter.reach[:stop], score.reach[:stop])


@every_statistic
@pytest.mark.parametrize("block", [1, 7, 100])
def test_blocks_laid_end_to_end_are_the_whole(name, block):
    test, e, carried = Statistic(name=name, **GIVEN), noise(), {}
    _, given = test.given(e, White.steady(e))
    parts = {}
    for start in range(0, len(e), block):
        at = range(start, min(start + block, len(e)))
        for score in test.of(given, TS, SOME, at=at, carried=carried):
            parts.setdefault(score.label, []).append(score.values.copy())
    for label, score in series(name, e, tolerance=SOME).items():
        np.testing.assert_allclose(np.concatenate(parts[label]), score.values, rtol=1e-12, atol=1e-12)


@every_statistic
@pytest.mark.parametrize("spike", [1e12, -1e12, 1e300, np.inf])
def test_a_spike_is_forgotten_with_its_windows(name, spike):
    e = noise(400)
    whole = values(name, e)
    e[100] = spike
    spiked = values(name, e)
    for label, score in spiked.items():
        np.testing.assert_array_equal(score[:100], whole[label][:100])
        if name == "cusum":
            continue  # it has no window; it comes down as healthy samples say so
        # window and baseline; where a spike is missing (inf), they hold one sample more of the past
        late = slice(100 + 25 + 60 + 2, None)
        np.testing.assert_allclose(score[late], whole[label][late], rtol=0, atol=1e-9)


def test_a_spike_weighs_as_much_in_a_cusum_as_100_deviations():
    e = noise(400)
    e[100] = 1e12
    clipped = values("cusum", e)
    e[100] = 100.0
    for label, score in values("cusum", e).items():
        np.testing.assert_array_equal(clipped[label], score)


@pytest.mark.parametrize("label", ["mean 0.4 s", "mean 1 s", "mean 2.5 s"])
def test_at_its_greatest_a_window_reaches_back_to_the_step(label):
    score = series("glr", np.repeat([0.0, 1.0], 150))[label]
    peak = int(np.nanargmax(score.values))
    assert peak - score.reach[peak] == 149  # the last row before


@every_statistic
@pytest.mark.parametrize("samples", [0, 1, 3, 5])
def test_a_record_shorter_than_the_windows_has_no_values(name, samples):
    for score in series(name, noise(samples), windows_s=(2.5,), tolerance=SOME).values():
        assert score.values.shape == (samples,)
        assert score.reach.shape == (samples,)
        assert np.isnan(score.values).all()
    for score in series(name, np.full(samples, np.nan)).values():
        assert np.isnan(score.values).all()


def test_windows_have_at_least_4_samples_each_length_once():
    test = Statistic(windows_s=(0.001, 0.04, 0.08, 0.081))
    assert test.rows(0.01) == [4, 8]
    assert test.rows(1.0) == [4]


# the least threshold of white noise


def test_white_noise_passes_the_least_threshold_no_more_often_than_stated():
    rate, samples = 1e-3, 200_000  # crossings a row
    white = noise(samples, seed=5)
    for name in ("glr", "cusum"):
        for score in series(name, white, windows_s=(0.4, 1.0, 2.5, 10.0)).values():
            above = score.values > score.least_threshold(rate)
            crossings = int(np.count_nonzero(above[1:] & ~above[:-1]))
            # an upcrossing every 1/rate rows in the mean; six deviations of a Poisson count
            assert crossings < rate * samples + 6.0 * math.sqrt(rate * samples), score.label
    assert all(score.least_threshold(rate) == -math.inf for score in series("energy", white).values())


# tolerance


def test_white_noise_needs_no_tolerance():
    # 4 deviations are left out of some hundred means, and of as many mean squares
    tolerance = tolerance_of([noise(50_000, seed=1), noise(50_000, seed=2)], Statistic(), 0.02)
    assert tolerance == NONE


def test_what_healthy_records_do_is_tolerated_threefold():
    rows = 50  # a fortieth of 2000 samples
    white = np.zeros(2000)
    white[1000:1200] = 4.0
    tolerance = tolerance_of([white], Statistic(baseline_s=60.0), TS)
    # the greatest change of mean is that of a whole window after the step, less what noise explains
    shift = 4.0 - 4.0 * math.sqrt(1.0 / rows + 1.0 / 600.0)
    assert tolerance.mean == pytest.approx(3.0 * shift)
    # and likewise the greatest mean square is that of such a window
    power = 16.0 - 4.0 * math.sqrt(2.0 / rows)
    assert tolerance.high == pytest.approx(1.0 + 3.0 * (power - 1.0))
    # and the least, of none at all, is as much as noise explains
    assert 1.0 / tolerance.low == pytest.approx(1.0 + 3.0 * (1.0 / (4.0 * math.sqrt(2.0 / rows)) - 1.0))


@pytest.mark.parametrize("spike", [1e6, 1e12])
def test_one_spike_of_a_healthy_record_weighs_as_much_in_its_tolerance_as_in_its_series(spike):
    given = noise(20_000)
    given[9000] = spike
    tolerance = tolerance_of([given], Statistic(), 0.01)
    given[9000] = 100.0
    assert tolerance == tolerance_of([given], Statistic(), 0.01)


@pytest.mark.parametrize("samples", [0, 1, 3, 7, 39])
def test_no_data_ask_for_no_tolerance_of_the_mean(samples):
    assert tolerance_of([noise(samples), np.full(5, np.nan)], Statistic(), 0.01).mean == 0.0


@pytest.mark.parametrize(("period_s", "is_tolerated"), [(10.0, False), (13.0, True)])
def test_a_wave_is_tolerated_unless_twenty_seconds_hold_it_a_whole_number_of_times(period_s, is_tolerated):
    elapsed_s = np.arange(20_000) * TS
    wave = np.where(elapsed_s > 100.0, 3.0 * np.sin(2.0 * np.pi * elapsed_s / period_s), 0.0)
    assert (tolerance_of([wave], Statistic(), TS).mean > 0.1) == is_tolerated

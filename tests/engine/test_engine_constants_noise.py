"""Constants and noise of a relation come from the whole log, whatever two fifths of it are like."""

import numpy as np
import pytest
from scipy.signal import lfilter

from gtmbench.engine.constants import _chunks, _of_stretch, _stretches, by_chunks, constants_of
from gtmbench.engine.equation import learn, rows_per_chunk
from gtmbench.engine.noise import (
    filtered,
    level_of,
    regime_of,
    taps_of,
    unit_of,
    wander_of,
)
from gtmbench.engine.relation import Relation
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import motion

ROWS, PER_CHUNK = 1500, 20
EVERY = np.ones(ROWS, dtype=bool)
TRUE, PRIOR = np.array([0.8, 0.03, -0.05]), np.array([3.0, 0.1, 0.1])


def read_and_columns(seed, rows=ROWS):
    random = np.random.default_rng(seed)
    turns = lfilter([1.0], [1.0, -0.8], random.standard_normal((rows, 2)), axis=0) * 6.0
    columns = np.column_stack([np.ones(rows), turns])
    return columns @ TRUE + 0.3 * random.standard_normal(rows), columns


# constants ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("begins", [0.0, 0.2, 0.45, 0.6])
@pytest.mark.parametrize("size", [1.0, -4.0, 30.0])
def test_constants_are_those_of_the_three_fifths_that_are_right(seed, begins, size):
    read, columns = read_and_columns(seed)
    first = round(begins * ROWS)
    read[first : first + round(0.4 * ROWS)] += size
    found = constants_of(read, columns, EVERY, PRIOR, PER_CHUNK)
    np.testing.assert_allclose(found, TRUE, atol=0.12 if abs(size) < 2.0 else 0.06)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_constants_do_not_follow_a_gain_that_changes_in_a_part(seed):
    read, columns = read_and_columns(seed)
    read[900:] -= 0.7 * columns[900:, 1]
    np.testing.assert_allclose(constants_of(read, columns, EVERY, PRIOR, PER_CHUNK), TRUE, atol=0.06)


def test_constants_of_a_whole_log_are_about_those_of_least_squares():
    read, columns = read_and_columns(4)
    least = np.linalg.lstsq(columns, read, rcond=None)[0]
    np.testing.assert_allclose(constants_of(read, columns, EVERY, PRIOR, PER_CHUNK), least, atol=0.02)


def test_what_is_not_known_has_no_say():
    read, columns = read_and_columns(5)
    known = np.random.default_rng(5).uniform(size=ROWS) < 0.7
    wrong = np.where(known, read, 1e6)
    found = constants_of(wrong, columns, known, PRIOR, PER_CHUNK)
    np.testing.assert_array_equal(found, constants_of(np.where(known, read, -3.0), columns, known, PRIOR, PER_CHUNK))
    np.testing.assert_allclose(found, TRUE, atol=0.05)


@pytest.mark.parametrize(("every", "is_told"), [(2, True), (3, False)])
def test_chunks_of_which_half_is_known_tell_constants(every, is_told):
    columns, known = np.column_stack([np.ones(400), np.arange(400.0)]), np.arange(400) % every == 0
    found = constants_of(columns @ [2.0, 0.1], columns, known, np.array([10.0, 1.0]), 20)
    assert found == pytest.approx([2.0, 0.1] if is_told else [0.0, 0.0], abs=0.01)


def test_fits_begin_from_stretches_of_all_of_a_half_of_a_quarter_and_of_an_eighth_of_the_log():
    """By halves of each: one of them is healthy."""
    found = [(int(each[0]), len(each)) for each in _stretches(np.arange(40))]
    lengths = {40: 20, 20: 10, 10: 5, 5: 2}
    assert found == [(first, width) for width, step in lengths.items() for first in range(0, 40 - width + 1, step)]
    assert [each.tolist() for each in _stretches(np.array([3, 7]))] == [[3, 7]] * 4


@pytest.mark.parametrize(("exact", "constant"), [(19, 0.0), (22, 3.0)])
def test_chunks_that_fit_by_luck_count_as_those_that_leave_a_tenth_of_what_is_usual(exact, constant):
    """Of 60 chunks some read 3, the others nothing but a noise of 0.3: by logarithms of what is left of each."""
    read = 0.3 * np.random.default_rng(1).standard_normal(1200)
    read[: 20 * exact] = 3.0
    found = constants_of(read, np.ones((1200, 1)), np.ones(1200, dtype=bool), np.array([10.0]), 20)
    assert found == pytest.approx([constant], abs=0.1)


def test_a_column_that_never_shows_has_a_constant_of_nil():
    read, columns = read_and_columns(6)
    columns = np.column_stack([columns, np.zeros(ROWS)])
    found = constants_of(read, columns, EVERY, np.append(PRIOR, 0.1), PER_CHUNK)
    assert found[3] == pytest.approx(0.0, abs=1e-12)
    np.testing.assert_allclose(found[:3], TRUE, atol=0.05)


def test_constants_of_nothing_that_is_known_are_nil():
    read, columns = read_and_columns(7)
    assert constants_of(read, columns, np.zeros(ROWS, dtype=bool), PRIOR, PER_CHUNK).tolist() == [0.0, 0.0, 0.0]


@pytest.mark.parametrize("count", [1, 19, 20, 21, 47])
def test_chunks_hold_all_rows_and_zeros_behind_them(count):
    values = np.arange(1.0, count + 1.0)
    chunks = by_chunks(values, 20)
    assert chunks.shape == (len(range(0, count, 20)), 20)
    np.testing.assert_array_equal(chunks.ravel()[:count], values)
    assert not chunks.ravel()[count:].any()
    two = by_chunks(np.column_stack([values, -values]), 20)
    np.testing.assert_array_equal(two[:, :, 1], -chunks)


# noise -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(6))
def test_livelier_motion_is_never_quieter(seed):
    random = np.random.default_rng(seed)
    lively = np.exp(random.normal(1.0, 0.7, ROWS))
    errors = random.standard_t(3.0, ROWS) * random.uniform(0.3, 2.0, ROWS) / lively  # quieter where it is lively
    level = level_of(errors, EVERY, lively)
    assert (np.diff(level[np.argsort(lively)]) >= -1e-12).all()
    assert (level > 0.0).all()


def test_the_level_follows_the_liveliness_and_grows_beyond_what_is_known():
    random = np.random.default_rng(2)
    lively = np.repeat([1.0, 3.0, 9.0, 27.0], 500)
    known = lively < 20.0
    level = level_of(0.2 * lively * random.standard_normal(2000), known, lively)
    np.testing.assert_allclose(level[[100, 700, 1200, 1900]], [0.2, 0.6, 1.8, 5.4], rtol=0.15)


def test_a_few_huge_errors_are_no_noise():
    random = np.random.default_rng(3)
    errors, lively = random.standard_normal(ROWS), np.exp(random.normal(1.0, 0.5, ROWS))
    broken = errors.copy()
    broken[::50] += 1e4
    quiet = level_of(errors, EVERY, lively)
    np.testing.assert_allclose(level_of(broken, EVERY, lively) / quiet, 1.2, atol=0.25)


@pytest.mark.parametrize("which", ["lively", "regime"])
def test_the_regime_tells_where_noise_is_louder_by_a_bounded_factor(which):
    random = np.random.default_rng(4)
    lively, regime = np.exp(random.normal(0.0, 0.6, 3000)), random.normal(0.0, 1.0, 3000)
    drives = np.log(lively) / 0.6 if which == "lively" else regime
    factor = regime_of(np.exp(0.5 * drives) * random.standard_normal(3000), np.ones(3000, dtype=bool), lively, regime)
    loud, quiet = factor[drives > 1.0].mean(), factor[drives < -1.0].mean()
    assert 2.0 < loud / quiet < 6.0
    assert factor.min() >= np.exp(-1.5) - 1e-12
    assert factor.max() <= np.exp(1.5) + 1e-12


def test_the_logarithm_of_a_level_is_a_quadratic_surface_of_both():
    """Tails of four degrees, which the fit is by: levels are known to a twentieth."""
    random = np.random.default_rng(1)
    first, second = random.uniform(-1.0, 1.0, (2, 20_000))
    for told in (first, second, first**2, -(second**2), first * second):
        errors = np.exp(0.5 * told) * random.standard_t(4.0, 20_000)
        found = regime_of(errors, np.ones(20_000, dtype=bool), np.exp(first), second)
        apart = np.log(found) - 0.5 * told
        assert np.std(apart) < 0.05


@pytest.mark.parametrize(
    ("values", "unit"),
    [([0.0] * 51 + [1.0] * 48 + [100.0], 0.64), ([1.0, -1.0], 1.0 / 0.455), ([0.0, 0.0, 0.0, 10.0], 4.0)],
)
def test_the_unit_is_of_the_mean_square_within_four_or_of_the_median_if_that_is_more(values, unit):
    assert unit_of(np.array(values)) == pytest.approx(np.sqrt(unit))
    assert unit_of(np.zeros(0)) == 1.0


def test_a_regime_is_not_told_of_few_blocks():
    random = np.random.default_rng(4)
    factor = regime_of(
        random.standard_normal(100), np.ones(100, dtype=bool), np.exp(random.normal(size=100)), np.arange(100.0)
    )
    assert factor.tolist() == [1.0] * 100


def correlation(values, lag):
    return float(values[lag:] @ values[:-lag] / (values @ values))


@pytest.mark.parametrize("poles", [(0.8,), (0.9, -0.3), (0.6 + 0.5j, 0.6 - 0.5j), (-0.5,), (0.7, 0.5, -0.2)])
def test_taps_whiten_an_autoregression(poles):
    own = np.real(np.poly(poles))
    walk = lfilter([1.0], own, np.random.default_rng(5).standard_normal(6000))
    taps = taps_of(walk)
    white = filtered(taps, walk)[10:]
    assert taps[0] == 1.0
    assert max(abs(correlation(white, lag)) for lag in range(1, 9)) < 0.08
    assert white.std() == pytest.approx(1.0, abs=0.06)
    assert abs(correlation(walk, 1)) > 0.3


def test_taps_of_white_noise_leave_it_as_it_is():
    noise = np.random.default_rng(6).standard_normal(6000)
    np.testing.assert_allclose(taps_of(noise), [1.0, 0.0, 0.0, 0.0, 0.0, 0.0], atol=0.05)


def test_a_filter_is_linear_and_begins_with_nothing_before():
    random = np.random.default_rng(7)
    taps, values = np.array([1.0, -0.5, 0.25]), random.standard_normal((40, 3))
    np.testing.assert_allclose(filtered(taps, values), lfilter(taps, [1.0], values, axis=0), atol=1e-12)
    assert filtered(taps, values[:2]).shape == (2, 3)
    np.testing.assert_allclose(filtered(taps, 3.0 * values), 3.0 * filtered(taps, values), atol=1e-12)


def test_the_unit_of_white_errors_is_their_deviation_and_jumps_raise_it_little():
    random = np.random.default_rng(8)
    white = 0.7 * random.standard_normal(5000)
    assert unit_of(white) == pytest.approx(0.7, rel=0.05)
    white[:20] = 1e5
    assert unit_of(white) < 0.9


def test_what_is_beyond_five_deviations_counts_as_five():
    errors, lively = np.tile([1.0, -1.0], 453), np.arange(1.0, 907.0)
    errors[-1] = 1e6
    amid_the_last_sixth = 5 * 151 + 75
    expected = np.sqrt((150.0 + (5.0 * 1.4826) ** 2) / 151.0)
    level = level_of(errors, np.ones(906, dtype=bool), lively)
    assert (level[10], level[amid_the_last_sixth]) == pytest.approx((1.0, expected))


def chunk_means(seed, wander, count=60, noise=0.05):
    random = np.random.default_rng(seed)
    return wander * random.standard_normal(count) + noise * random.standard_normal(count), np.full(count, noise**-2.0)


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("place", [5, 20, 30, 50])
def test_one_step_is_no_wander(seed, place):
    means, precisions = chunk_means(seed, 0.2)
    stepped = means + 25.0 * (np.arange(len(means)) >= place)
    assert wander_of(stepped, precisions, 0.1) < 1.6 * wander_of(means, precisions, 0.1)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_slow_drift_is_no_wander(seed):
    means, precisions = chunk_means(seed, 0.2)
    drifting = means + 0.02 * np.arange(len(means))
    assert wander_of(drifting, precisions, 0.1) < 1.3 * wander_of(means, precisions, 0.1)


@pytest.mark.parametrize("wander", [0.3, 1.0, 3.0])
def test_wander_is_as_large_as_means_wander(wander):
    found = [wander_of(*chunk_means(seed, wander, 200), 0.1) for seed in range(5)]
    assert np.mean(found) == pytest.approx(wander, rel=0.35)


def test_wander_grows_with_what_means_wander_by():
    found = [wander_of(*chunk_means(1, wander), 0.05) for wander in (0.0, 0.2, 0.5, 1.0, 2.0)]
    assert np.diff(found).min() > 0.0


def test_means_that_noise_alone_moves_do_not_wander():
    assert wander_of(*chunk_means(1, 0.0, 100, noise=2.0), 0.05) < 1.2
    assert wander_of(*chunk_means(1, 0.0, 100, noise=0.01), 0.05) < 0.03


def test_few_chunks_leave_wander_as_it_is_believed():
    means, precisions = np.full(60, np.nan), np.full(60, 400.0)
    assert wander_of(means, precisions, 0.3) == pytest.approx(0.3)
    means[:4] = [5.0, -5.0, 5.0, -5.0]
    assert wander_of(means, precisions, 0.3) == pytest.approx(0.3 * np.sqrt(4.0 / (4.0 + 4.0)))  # four chunks' worth


# equations ---------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def flight():
    return flight_from(motion(300.0, seed=8), noise=0.02)


def gyros_of(_, effect):
    return effect.gyros


def relation_of(flight, values, columns, **rest):
    """Return a relation of one channel."""
    return Relation(
        name="made",
        channels=("one",),
        said="what is made of {}",
        unit="deg/s",
        values=values[:, np.newaxis],
        regressors=columns[:, np.newaxis],
        prior=PRIOR,
        floor=0.1 * PRIOR,
        wander=0.05,
        asked=np.ones(len(flight), dtype=bool),
        response=gyros_of,
        **rest,
    )


@pytest.mark.parametrize("colour", [0.0, 0.7])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_the_errors_of_a_learnt_relation_are_white_and_of_unit_deviation(flight, seed, colour):
    _, columns = read_and_columns(seed, len(flight))
    noise = lfilter([1.0], [1.0, -colour], np.random.default_rng(seed).standard_normal(len(flight)))
    values = columns @ TRUE + 0.1 * flight.lively * noise
    equation = learn(flight, relation_of(flight, values, columns), 0)
    errors = equation.errors[equation.known]
    assert 0.9 < errors.std() < 1.1
    assert max(abs(correlation(errors, lag)) for lag in range(1, 6)) < 0.2
    assert (np.abs(equation.constants - TRUE) < [0.5, 0.05, 0.05]).all()


@pytest.mark.parametrize("seed", [1, 2])
def test_errors_have_unit_deviation_about_a_step_too(flight, seed):
    _, columns = read_and_columns(seed, len(flight))
    noise = np.random.default_rng(seed).standard_normal(len(flight))
    half = len(flight) * 3 // 5
    values = columns @ TRUE + noise + 6.0 * (np.arange(len(flight)) >= half)
    equation = learn(flight, relation_of(flight, values, columns), 0)
    assert 0.85 < equation.errors[10:half].std() < 1.15
    assert 0.85 < equation.errors[half + 10 :].std() < 1.15
    assert (np.abs(equation.constants - TRUE) < [0.3, 0.05, 0.05]).all()
    assert equation.wander < 0.5


def test_what_is_explained_is_taken_away_before_anything_is_learnt(flight):
    _, columns = read_and_columns(3, len(flight))
    values = columns @ TRUE + 0.5 * np.random.default_rng(3).standard_normal(len(flight))
    fault = 9.0 * np.sin(0.02 * flight.time_s) * (flight.time_s > 40.0)
    plain = learn(flight, relation_of(flight, values, columns), 0)
    found = learn(flight, relation_of(flight, values + fault, columns), 0, explained=fault)
    np.testing.assert_allclose(found.errors, plain.errors, atol=1e-6)
    np.testing.assert_allclose(found.constants, plain.constants, atol=1e-9)


def test_an_equation_is_not_known_where_it_is_left_out_or_missing_nor_just_behind_what_is_missing(flight):
    _, columns = read_and_columns(3, len(flight))
    values = columns @ TRUE + 0.5 * np.random.default_rng(3).standard_normal(len(flight))
    values[300:320] = np.nan
    values[600] = np.nan
    left_out = np.zeros(len(flight), dtype=bool)
    left_out[700:800] = True
    columns[500:510, 1] = np.nan  # one of what explains it
    wave = np.sin(np.arange(len(flight)))
    own = learn(flight, relation_of(flight, values + wave, columns), 0, left_out=left_out, explained=wave)
    equation = learn(flight, relation_of(flight, values, columns), 0, left_out=left_out)
    np.testing.assert_allclose(own.constants, equation.constants)
    unknown = np.flatnonzero(~equation.known)
    assert {*range(300, 325), *range(500, 510), *range(600, 606), *range(700, 800)} == set(unknown.tolist())
    assert not equation.errors[unknown].any()
    assert not equation.regressors[unknown].any()
    assert np.isfinite(equation.errors).all()


def test_an_equation_of_which_hardly_anything_is_known_is_none(flight):
    _, columns = read_and_columns(3, len(flight))
    values = np.full(len(flight), np.nan)
    assert learn(flight, relation_of(flight, values, columns), 0) is None
    values[:30] = 1.0
    assert learn(flight, relation_of(flight, values, columns), 0) is None


def test_a_chunk_is_about_four_seconds_of_whole_cells(flight):
    assert rows_per_chunk(flight) == 20
    assert rows_per_chunk(flight_from(motion(60.0, 2.0, noise=0.0), has_forces=False)) % 5 == 0


# by definition -----------------------------------------------------------------------------------


def test_where_nothing_is_left_constants_begin_with_a_noise_of_a_thousandth():
    columns = np.ones((40, 1))
    chunks = _chunks(np.full(40, 0.01), columns, np.ones(40, dtype=bool), 20)
    found = _of_stretch(chunks, np.arange(2), np.array([[5e4]]))
    assert found == pytest.approx([40 * 0.01 / 1e-3 / (40 / 1e-3 + 5e4)])


def test_a_surface_of_noise_is_the_likeliest_beside_what_is_believed_of_it():
    """There the slope of Student's law of four degrees is that of the belief."""
    random = np.random.default_rng(1)
    lively, regime = np.exp(random.uniform(-1.0, 1.0, 400)), random.uniform(-1.0, 1.0, 400)
    errors = np.exp(0.3 * np.log(lively) ** 2 + 0.3 * regime**2) * random.standard_t(4.0, 400)
    first, second = (
        (np.clip(each, low, high) - amid) / (0.25 * (high - low) + 1e-6)
        for each in (np.log(lively), regime)
        for low, amid, high in [np.quantile(each, [0.02, 0.5, 0.98])]
    )
    columns = np.column_stack([np.ones(400), first, second, 0.5 * first**2, 0.5 * second**2, 0.5 * first * second])
    told = 2.0 * np.log(regime_of(errors, np.ones(400, dtype=bool), lively, regime))
    surface = np.linalg.lstsq(columns, told)[0]
    assert np.abs(told).max() < 2.9
    slope = 0.5 * columns.T @ (5.0 * errors**2 / (4.0 * np.exp(told) + errors**2) - 1.0)
    np.testing.assert_allclose(slope, [5e-3, 5.0, 5.0, 20.0, 20.0, 20.0] * surface, rtol=1e-3, atol=1e-3)


@pytest.mark.parametrize(("count", "lag"), [(6, 0), (7, 1), (19, 1), (20, 2), (79, 4), (80, 8), (200, 8)])
def test_means_wander_by_what_six_pairs_tell_up_to_a_tenth_of_the_log_apart(count, lag):
    """Means that grow by 1 a chunk tell which is the longest lag."""
    power = 0.5 * lag**2 / 0.708
    found = wander_of(np.arange(float(count)), np.full(count, 1e12), 0.0)
    assert found == pytest.approx(np.sqrt(count * power / (count + 4.0)), abs=1e-6)

"""The relation of gyros and attitude: what was put into a record is found, and only what stays is left."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gtmbench.engine.blocks import Blocks, blocks_of
from gtmbench.engine.flight import Flight
from gtmbench.engine.hindsight import alignment as subject
from gtmbench.engine.hindsight.alignment import (
    Alignment,
    _by_liveliness,
    _local,
    _stands,
    _summed,
    alignment_of,
    error_level,
    gain_level,
    jumps_deg,
    noise_levels,
    noise_size,
    of_euler_rates,
)
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.night import by_day
from tests.helpers.turning import from_on, motion, with_error

EVERY = slice(None)


def noise_level(alignment, axis, known):
    """Return what a gyro's noise is beside the others'."""
    return noise_levels(alignment, axis, known)[1]


def are_euler(blocks, but_s=()):
    share, error = of_euler_rates(blocks, but_s)
    return abs(share - 1.0) < 0.3 and share > 4.0 * error


@cache
def healthy(seed=1):
    return blocks_of([motion(seed=seed)])


def made(**read):
    """Return blocks that read what is given, and else nothing."""
    rows = len(next(iter(read.values())))
    rest = dict.fromkeys(("gyros", "rates", "euler_rates", "angles", "rough"), np.zeros((rows, 3)))
    return Blocks(start_s=0.0, period_s=0.2, held_s=np.zeros((rows, 6)), **rest | read)


def everywhere(blocks):
    return np.ones(len(blocks), dtype=bool)


def level_of(level_of_one, record, axis):
    blocks = blocks_of([record])
    return level_of_one(alignment_of(blocks), axis, everywhere(blocks))


@pytest.mark.parametrize("seconds", [0.3, 1.6, 2.4])
def test_a_moment_says_nothing_of_the_constants(seconds):
    blocks = blocks_of([motion(seed=1).between(0.0, seconds)])
    assert len(blocks) < 13
    assert np.isnan(alignment_of(blocks).offsets).all() == (len(blocks) < 8)


# its constants ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("axis", range(3))
def test_offset_and_gain_of_a_gyro_are_its_own(axis, seed):
    record = motion(seed=seed)
    name = GYROS[axis]
    alignment = alignment_of(blocks_of([record.replace(name, 1.06 * record[name] - 3.0)]))
    expected, gains = np.zeros(3), np.ones(3)
    expected[axis], gains[axis] = -3.0, 1.06
    np.testing.assert_allclose(alignment.offsets, expected, atol=0.05)
    np.testing.assert_allclose(alignment.gains, gains, atol=0.02)
    assert np.nanstd(alignment.error[:, axis]) == pytest.approx(
        np.nanstd(alignment_of(healthy(seed)).error[:, axis]), rel=0.1
    )


@pytest.mark.parametrize("duration_s", [60.0, 240.0])
@pytest.mark.parametrize("factor", [-1.0, -0.4, 0.0, 0.5, 2.0, 4.0])
def test_a_gain_that_is_far_from_one_throughout_is_not_taken_for_noise(factor, duration_s):
    record = motion(duration_s)
    alignment = alignment_of(blocks_of([record.replace("q", factor * record["q"])]))
    assert alignment.gains[1] == pytest.approx(factor, abs=0.05 + 0.4 * abs(factor - 1.0))
    np.testing.assert_allclose(alignment.gains[[0, 2]], 1.0, atol=0.02)


@pytest.mark.parametrize(("axis", "other"), [(0, 1), (1, 2), (2, 0), (0, 2)])
def test_axes_that_are_a_little_crooked_and_a_lag_are_no_error(axis, other):
    record = motion()
    name = GYROS[axis]
    usual = np.nanstd(alignment_of(healthy()).error[:, axis])
    crooked = record.replace(name, record[name] + 0.05 * record[GYROS[other]])
    assert np.nanstd(alignment_of(blocks_of([crooked])).error[:, axis]) < 1.2 * usual
    late = record.replace(name, np.interp(record.time_s - 0.1, record.time_s, record[name]))
    found = alignment_of(blocks_of([late]))
    assert np.nanstd(found.error[:, axis]) < 1.2 * usual
    left = blocks_of([late]).gyros[:, axis] - blocks_of([late]).rates[:, axis]
    assert np.nanstd(found.error[:, axis]) < 0.8 * np.nanstd(left)


def test_a_gain_is_near_one_where_no_motion_shows_it():
    """Noise of the attitude alone would make it 0."""
    alignment = alignment_of(blocks_of([motion(large_deg=(0.05, 0.05, 0.05))]))
    np.testing.assert_allclose(alignment.gains, 1.0, atol=0.3)


def test_a_gain_is_half_believed_that_motion_tells_to_a_fiftieth_of_itself():
    """By least squares beside a prior of 0.02: waves of 0.5 deg/s over a hundred blocks, of an angle's white noise."""
    turns, gains = np.sqrt(0.5) * np.sin(0.02 * np.pi * np.multiply.outer(np.arange(100), [2, 3, 5])), []
    for seed in range(12):
        angles = 0.1 / np.sqrt(2.0) * np.random.default_rng(seed).standard_normal((101, 3))
        gains.append(alignment_of(made(gyros=1.3 * turns + np.diff(angles, axis=0), rates=turns)).gains)
    assert np.mean(gains) == pytest.approx(1.15, abs=0.02)


@pytest.mark.parametrize("share", [0.1, 0.3])
def test_constants_are_those_of_most_of_the_log(share):
    """A fault that lasts for less than half of a log bends its constants by little."""
    onset_s = 120.0 * (1.0 - share)
    alignment = alignment_of(blocks_of([with_error(motion(), "q", from_on(onset_s, 20.0))]))
    assert abs(alignment.offsets[1]) < 0.7  # its mean is 2 and 6
    assert np.nanmedian(alignment.error[alignment.blocks.time_s > onset_s + 1.0, 1]) == pytest.approx(20.0, abs=0.8)


def test_what_failed_or_is_excused_bends_no_constant():
    broken = with_error(motion(), "r", from_on(40.0, 30.0))
    alignment = alignment_of(blocks_of([broken]), ((), (), [(39.0, 121.0)]))
    np.testing.assert_allclose(alignment.offsets, 0.0, atol=0.05)
    assert not alignment.known[200:, 2].any()
    assert alignment.known[:, :2].all()
    assert np.nanmedian(alignment.error[250:, 2]) == pytest.approx(30.0, abs=0.1)  # it is told all the same
    excused = alignment_of(Flight(blocks=blocks_of([broken])).without([(39.0, 121.0)]).blocks)
    np.testing.assert_allclose(excused.offsets, 0.0, atol=0.05)
    assert not excused.known[200:].any()
    assert np.isnan(excused.error[200:]).all()


def test_nothing_is_known_of_a_log_that_is_missing():
    record = motion(20.0)
    nothing = record.replace("q", np.full(len(record), np.nan))
    alignment = alignment_of(blocks_of([nothing]))
    assert np.isnan(alignment.offsets).all()
    assert np.isnan(alignment.gains).all()
    assert not alignment.known.any()


# Euler rates --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [0.0, 1.0, 4.0])
@pytest.mark.parametrize("seed", [1, 2, 3])
def test_gyros_that_read_body_rates_are_told_from_those_that_read_the_angles_slopes(seed, noise):
    record = motion(seed=seed, noise=noise, large_deg=(25.0, 15.0, 60.0))
    assert not are_euler(blocks_of([record]))
    slopes = np.gradient(record.matrix(ATTITUDE), record.time_s, axis=0)
    smooth = motion(seed=seed, noise=0.0, large_deg=(25.0, 15.0, 60.0)).matrix(ATTITUDE)
    random = np.random.default_rng(seed)
    for axis, name in enumerate(GYROS):
        slopes = np.gradient(smooth[:, axis], record.time_s) + noise * 0.15 * random.standard_normal(len(record))
        record = record.replace(name, slopes)
    assert are_euler(blocks_of([record]))


@pytest.mark.parametrize("large_deg", [(0.02, 0.02, 0.02), (12.0, 0.0, 0.0), (3.0, 3.0, 3.0)])
def test_where_both_are_nearly_the_same_chance_does_not_decide(large_deg):
    for seed in range(1, 5):
        assert not are_euler(blocks_of([motion(300.0, 10.0, seed, large_deg=large_deg)]))


@pytest.mark.parametrize("onset_s", by_day([6.0, 90.0, 30.0, 60.0]))
@pytest.mark.parametrize("name", ["phi", "theta"])
def test_an_angle_that_jumps_does_not_make_gyros_euler_rates(name, onset_s):
    """The body's axes are turned with it from there on, so that body rates fit no more, and Euler rates as before."""
    for size in (8.0, 15.0, 20.0):
        blocks = blocks_of([with_error(motion(), name, from_on(onset_s, size))])
        assert not are_euler(blocks)
        assert not are_euler(blocks, [(onset_s - 1.0, 121.0)])


def test_one_broken_gyro_does_not_make_them_euler_rates():
    broken = with_error(motion(), "p", from_on(40.0, 30.0))
    assert not are_euler(blocks_of([broken]))


# levels -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", range(3))
def test_the_error_level_is_what_a_gyro_reads_too_much_chunk_by_chunk(axis):
    level = level_of(error_level, with_error(motion(), GYROS[axis], from_on(80.0, 2.0)), axis)
    assert np.median(level.values[40:]) - np.median(level.values[:40]) == pytest.approx(2.0, abs=0.1)
    usual = level_of(error_level, motion(), axis).values
    assert np.abs(usual).max() < 0.2


@pytest.mark.parametrize("factor", [0.5, 1.6, -1.0])
@pytest.mark.parametrize("axis", range(3))
def test_the_gain_level_is_by_how_much_a_gyro_turns_too_far_whatever_its_bias(axis, factor):
    record = motion()
    name = GYROS[axis]
    late = record.time_s >= 80.0
    broken = record.replace(name, np.where(late, factor * record[name] + 3.0, record[name]))
    values = level_of(gain_level, broken, axis).values
    assert np.median(values[41:]) - np.median(values[:40]) == pytest.approx(factor - 1.0, abs=0.12)


def test_a_chunk_that_turns_more_tells_more_of_a_gain():
    record = motion()
    calm = record.time_s < 60.0
    values = record.values.copy()
    values[calm] *= 0.2
    half = type(record)(values, channels=record.channels, sample_period_s=0.05)
    deviations = level_of(gain_level, half, 0).deviations
    assert np.median(deviations[:29]) > 3.0 * np.median(deviations[31:])


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("bound", [1.0, 3.0])
def test_noise_of_the_size_that_is_stated_raises_the_level_by_its_bound(axis, bound):
    record = motion(rate_hz=50.0)
    blocks = blocks_of([record])
    alignment = alignment_of(blocks)
    usual = noise_level(alignment, axis, everywhere(blocks)).values
    sizes = noise_size(alignment, axis, np.full(len(usual), bound))
    size = float(np.median(sizes))
    added = size * np.random.default_rng(2).standard_normal(len(record))
    louder = level_of(noise_level, with_error(record, GYROS[axis], added), axis).values
    assert np.median(louder - usual) == pytest.approx(bound, abs=0.1)


def test_no_bound_of_noise_is_no_size_and_a_calm_chunk_counts_as_the_usual_one():
    blocks = healthy()
    alignment = alignment_of(blocks)
    chunks = len(error_level(alignment, 0, everywhere(blocks)).values)
    sizes = noise_size(alignment, 0, np.full(chunks, np.inf))
    assert (sizes > 1e6).all()
    sizes = noise_size(alignment, 0, np.full(chunks, 1.0))
    assert sizes.min() >= 0.99 * np.median(sizes)


@pytest.mark.parametrize("axis", range(3))
def test_a_gyro_that_failed_is_no_measure_of_the_others_noise_and_makes_no_step(axis):
    """However loud it was before: here eight times as loud."""
    random = np.random.default_rng(3)
    record = with_error(motion(), GYROS[axis], 1.2 * random.standard_normal(2401))
    blocks = blocks_of([record])
    failed_s = [(), (), ()]
    failed_s[axis] = [(60.0, 121.0)]
    alignment = alignment_of(blocks, failed_s)
    for other in {0, 1, 2} - {axis}:
        values = noise_level(alignment, other, alignment.known[:, other]).values
        assert np.median(values[30:]) - np.median(values[:30]) == pytest.approx(0.0, abs=0.3)


def test_noise_of_all_gyros_is_shaking_and_no_change_of_one():
    record = motion(rate_hz=50.0)
    shaken, noise = record, from_on(60.0, 3.0)(record.time_s)
    for name in GYROS:
        shaken = shaken.replace(
            name, record[name] + noise * np.random.default_rng(ord(name)).standard_normal(len(record))
        )
    for axis in range(3):
        values = level_of(noise_level, shaken, axis).values
        assert np.median(values[31:]) - np.median(values[:29]) == pytest.approx(0.0, abs=0.3)


@pytest.mark.parametrize(("level_of_one", "floor"), [(error_level, 0.3), (gain_level, 0.1), (noise_level, 0.7)])
def test_a_chunk_of_which_less_than_half_is_known_is_unknown_and_a_floor_is_that_of_health(level_of_one, floor):
    """In deg/s, of a gain, and of a power's logarithm."""
    blocks = healthy()
    alignment = alignment_of(blocks)
    known = everywhere(blocks)
    known[100:106] = False  # six of ten
    known[200:204] = False
    level = level_of_one(alignment, 1, known)
    assert np.flatnonzero(np.isnan(level.values)).tolist() == [10]
    assert level.floor == floor


def test_livelier_chunks_scatter_no_less():
    record = motion(240.0)
    random = np.random.default_rng(1)
    loud = record.time_s >= 120.0
    values = record.values.copy()
    values[~loud] *= 0.3
    values[:, :3] += np.where(loud, 3.0, 0.1)[:, np.newaxis] * random.standard_normal((len(record), 3))
    blocks = blocks_of([type(record)(values, channels=record.channels, sample_period_s=0.05)])
    level = error_level(alignment_of(blocks), 0, everywhere(blocks))
    assert np.median(level.deviations[62:118]) > 4.0 * np.median(level.deviations[2:58])
    lively = np.square(blocks.rates).sum(axis=1).reshape(120, 10).mean(axis=1)
    assert (np.diff(level.deviations[np.argsort(lively)]) >= 0.0).all()


# jumps --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [-6.0, 4.0, 30.0])
@pytest.mark.parametrize("axis", range(3))
def test_a_jump_of_an_angle_is_found_where_it_is_and_as_large_as_it_is(axis, size):
    blocks = blocks_of([with_error(motion(), ATTITUDE[axis], from_on(70.1, size))])
    jump, usual, _ = jumps_deg(alignment_of(blocks), np.ones((len(blocks), 3), dtype=bool))
    place = int(np.argmax(np.nan_to_num(jump[:, axis], posinf=0.0)))
    assert abs(blocks.time_s[place] - 70.0) < 4.1
    assert jump[350, axis] + max(usual[350, axis], 1.0) >= abs(size)
    assert jump[350, axis] == pytest.approx(abs(size), rel=0.15, abs=0.5)
    assert jump[350, axis] > usual[350, axis]


@pytest.mark.parametrize("late", [0.0, 0.3, 0.5, 0.9])
def test_a_jump_between_two_samples_is_as_large_however_these_lie_in_blocks(late):
    """Between slow samples an angle grows to its jump over a block, of which one may hold any part."""
    flown = motion()
    angle, rows = flown["psi"], round(0.2 / flown.sample_period_s)
    grown = np.clip((np.arange(len(flown)) - 350 * rows - late * rows) / rows, 0.0, 1.0)
    blocks = blocks_of([flown.replace("psi", angle + 4.0 * grown)])
    jump, _, stay = jumps_deg(alignment_of(blocks), np.ones((len(blocks), 3), dtype=bool))
    assert jump[350, 2] == pytest.approx(4.0, abs=0.6)
    assert stay[350, 2] == pytest.approx(4.0, abs=0.6)


@pytest.mark.parametrize("onset_s", [70.0, 70.05, 70.1, 70.15, 70.2])
def test_a_jump_is_as_large_wherever_it_lies_between_the_edges_of_blocks(onset_s):
    record = with_error(motion(), "phi", from_on(onset_s, 10.0))
    time_s = np.arange(0.03, record.end_s, 0.07)  # an edge lies amid two samples
    sensors = {name: Samples(time_s, np.interp(time_s, record.time_s, record[name])) for name in (*GYROS, *ATTITUDE)}
    blocks = flight_of(sensors, is_driven=False).blocks
    jump, _, _ = jumps_deg(alignment_of(blocks), np.ones((len(blocks), 3), dtype=bool))
    about = np.abs(blocks.time_s - onset_s) < 0.5
    assert jump[about, 0].max() == pytest.approx(10.0, rel=0.15)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_no_angle_jumps_in_health(seed):
    blocks = healthy(seed)
    jump, usual, _ = jumps_deg(alignment_of(blocks), np.ones((len(blocks), 3), dtype=bool))
    there = np.isfinite(jump)
    assert there.mean() > 0.95
    assert np.mean(jump[there] > usual[there]) < 0.001


def test_a_bias_of_a_gyro_is_no_jump_of_its_angle():
    blocks = blocks_of([with_error(motion(), "p", from_on(70.0, 8.0))])
    alignment = alignment_of(blocks, ([(69.0, 121.0)], (), ()))
    jump, usual, _ = jumps_deg(alignment, np.ones((len(blocks), 3), dtype=bool))
    far = np.abs(blocks.time_s - 70.0) > 5.0
    assert np.nanmax(jump[far, 0][np.isfinite(jump[far, 0])]) < 3.0
    assert np.isfinite(usual[far]).mean() > 0.95


def test_a_gyro_that_tells_nothing_leaves_its_angle_open():
    blocks = healthy()
    tells = np.ones((len(blocks), 3), dtype=bool)
    tells[300:, 0] = False
    jump, _, _ = jumps_deg(alignment_of(blocks), tells)
    assert np.isinf(jump[330:, 0]).all()
    assert np.isfinite(jump[30:270, 0]).all()
    assert np.isfinite(jump[330:570, 1:]).all()  # near wings level, no angle but phi is p's


@pytest.mark.parametrize(("window", "before", "behind"), [(3, 1, 1), (5, 2, 2), (20, 9, 10)])
def test_sums_are_about_each_value(window, before, behind):
    values = np.zeros(100)
    values[50] = 2.0
    found = _summed(values, window)
    assert np.flatnonzero(found == 2.0).tolist() == [*range(50 - before, 50 + behind + 1)]
    assert np.isnan(found).sum() == window - 1
    assert np.isnan(_summed(values[:2], 3)).all()
    values[50] = np.nan
    assert np.isnan(_summed(values, window)[50 - before : 50 + behind + 1]).all()


def test_of_gyros_that_read_the_angles_slopes_all_of_the_log_tells():
    """Four times as much as a quarter: half of its error."""
    random = np.random.default_rng(1)
    body, euler = 20.0 * random.standard_normal((2, 2000, 3))
    read = euler + 5.0 * random.standard_normal((2000, 3))
    blocks = made(gyros=read, rates=body, euler_rates=euler)
    _, whole = of_euler_rates(blocks)
    _, quarter = of_euler_rates(blocks, [(100.0, 400.0)])
    assert whole == pytest.approx(0.5 * quarter, rel=0.2)
    _, louder = of_euler_rates(replace(blocks, gyros=2.0 * read - euler))
    assert louder == pytest.approx(2.0 * whole, rel=0.2)


def test_an_angle_jumps_as_far_as_the_gyros_tell_that_are_known():
    """Banked by 40 degrees a heading turns about q and r: r alone feels most of it."""
    rows = 400
    blocks = made(angles=np.tile([40.0, 0.0, 0.0], (rows, 1)))
    error = 1e-3 * np.random.default_rng(1).standard_normal((rows, 3))
    error[200] += 5.0 / 0.2 * np.array([0.0, np.sin(np.radians(40.0)), np.cos(np.radians(40.0))])
    own = Alignment(
        blocks=blocks, known=np.ones((rows, 3), dtype=bool), error=error, offsets=np.zeros(3), gains=np.ones(3)
    )
    for of_q in (True, False):
        found = jumps_deg(own, np.tile([True, of_q, True], (rows, 1)))
        assert (found.sizes[200, 2], found.stay[205, 2]) == pytest.approx((5.0, 5.0), abs=0.02)
    assert np.isinf(jumps_deg(own, np.tile([True, True, False], (rows, 1))).sizes[:, 2]).all()  # q feels two fifths


def test_a_jump_is_told_over_those_blocks_in_which_it_and_six_deviations_are_least():
    """Wings level, beside what is usual for a quarter of a minute; over twenty blocks it has to stay."""
    rows = np.arange(225)
    error = np.diff(np.random.default_rng(1).standard_normal((226, 3)), axis=0)  # of an angle's white noise
    blocks = made(angles=np.zeros((225, 3)))
    own = Alignment(blocks=blocks, known=error < np.inf, error=error, offsets=np.zeros(3), gains=np.ones(3))
    found, windows = jumps_deg(own, own.known), set()
    for angle in range(3):
        turned = 0.2 * (error - _local(error))[:, angle]
        sums = np.array([_summed(turned, window) for window in (3, 5, 20)])
        usual = np.array([6.0 * _by_liveliness(each, np.zeros(225), differences=False) for each in sums])
        least, there = np.argmin(np.abs(sums) + usual, axis=0), rows[10:-10]
        np.testing.assert_allclose(found.sizes[there, angle], np.abs(sums)[least[there], there])
        np.testing.assert_allclose(found.significant[there, angle], usual[least[there], there])
        np.testing.assert_allclose(found.stay[:, angle], np.abs(sums[2]))
        windows |= {*least[there].tolist()}
    assert windows == {0, 1, 2}


def test_a_chunk_in_which_nothing_turns_or_is_known_tells_no_gain():
    alignment = alignment_of(blocks_of([motion(noise=0.0)]))
    rates, known = alignment.blocks.rates.copy(), np.ones(len(alignment.error), dtype=bool)
    rates[100:110], known[200:210] = 3.0, False  # the same throughout
    own = gain_level(replace(alignment, blocks=replace(alignment.blocks, rates=rates)), 1, known)
    assert np.flatnonzero(np.isnan(own.values))[:2].tolist() == [10, 20]
    assert np.isfinite(own.values[11:20]).all()


@pytest.mark.parametrize(("count", "parts"), [(13, 1), (37, 3), (61, 5), (201, 8)])
@pytest.mark.parametrize("differences", [True, False])
def test_values_scatter_as_those_do_that_are_about_as_lively_and_no_less_than_calmer_ones(count, parts, differences):
    """By their own sizes, or by the differences of neighbours: twelve of them a part, and eight parts at most."""
    random = np.random.default_rng(count)
    lively, values = random.permutation(count) / count, random.standard_normal(count) * random.uniform(0.5, 2.0, count)
    sizes = np.abs(np.diff(values)) / np.sqrt(2.0) if differences else np.abs(values)
    there = np.arange(count)[1:] if differences else np.arange(count)
    ordered = np.array_split(there[np.argsort(lively[there])], parts)
    usual = np.maximum.accumulate([1.4826 * np.median(sizes[part - int(differences)]) for part in ordered])
    found = _by_liveliness(values, lively, differences=differences)
    for part, size in zip(ordered, usual, strict=True):
        assert found[part] == pytest.approx(size)
    assert (_by_liveliness(np.full(5, np.nan), np.ones(5)) == 1.0).all()


def test_an_error_that_stays_is_the_median_of_a_quarter_of_a_minute_and_as_much_beside_it():
    errors = np.random.default_rng(1).standard_normal((400, 3))
    errors[:, 2] = np.nan
    found = _local(errors)
    for first in (0, 75, 150, 225, 300, 375):
        about = errors[max(first - 75, 0) : first + 150, :2]
        rows = found[first : first + 75]
        np.testing.assert_allclose(rows, [[*np.median(about, axis=0), 0.0]] * len(rows))


@pytest.mark.parametrize(
    ("still_s", "calm_deg_s", "moves_deg_s", "stands"),
    [
        (25.0, 0.1, 10.0, True),
        (19.0, 0.1, 10.0, False),
        (25.0, 1.9, 10.0, True),  # a fifth of the liveliest
        (25.0, 2.3, 10.0, False),
        (25.0, 1.4, 5.0, True),  # a degree and a half a second
        (25.0, 1.7, 5.0, False),
        (25.0, 0.1, 0.1, False),  # nothing ever moves
    ],
)
def test_an_aircraft_stands_that_hardly_turns_for_a_third_of_a_minute(still_s, calm_deg_s, moves_deg_s, stands):
    still = np.abs(np.arange(600) * 0.2 - 50.0) < 0.5 * still_s
    rates = np.where(still, calm_deg_s, moves_deg_s)[:, np.newaxis] * np.array([0.6, 0.0, 0.8])
    found = _stands(replace(blocks_of([motion()]), rates=rates))
    assert found[250] == stands
    assert not found[~still].any()


@pytest.mark.parametrize(("error", "tells"), [(0.24, True), (0.26, False)])
def test_a_quarter_tells_against_euler_rates_whose_share_is_surely_below_a_half(monkeypatch, error, tells):
    monkeypatch.setattr(subject, "_euler_share", lambda _, rows: (0.0, error) if len(rows) < 400 else (1.0, 0.1))
    assert of_euler_rates(made(gyros=np.zeros((400, 3)))) == ((0.0, error) if tells else (1.0, 0.1))


@pytest.mark.parametrize(("count", "stands"), [(100, True), (99, False)])
def test_twenty_seconds_are_long_enough_to_stand(monkeypatch, count, stands):
    monkeypatch.setattr(subject, "_LIVELY_S", 0.0)
    rates = np.where((np.arange(600) >= 200) & (np.arange(600) < 200 + count), 0.0, 10.0)[:, np.newaxis] * np.ones(3)
    assert _stands(made(rates=rates))[250] == stands

"""Blocks of a log: what gyros read and the attitude turns by, wherever records begin and samples are missing."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmbench as gb
from gtmbench.engine.blocks import blocks_of, held_for_s
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.turning import SENSORS, motion

PERIODS_S = (0.01, 0.02, 0.04, 0.05, 0.1, 0.2, 0.25)


def turning(rates, first=(10.0, -20.0, 60.0), duration_s=12.0, period_s=0.05, start_s=0.0):
    """Return a record of an aircraft that turns at constant body rates, by the exponential of their integral."""
    time_s = np.arange(round(duration_s / period_s) + 1) * period_s
    begins = Rotation.from_euler("ZYX", first[::-1], degrees=True)
    turned = begins * Rotation.from_rotvec(np.radians(np.outer(time_s, rates)))
    angles = np.unwrap(turned.as_euler("ZYX", degrees=True)[:, ::-1], axis=0, period=360.0)
    values = np.column_stack([np.tile(rates, (len(time_s), 1)), angles])
    return gb.Record(values, channels=SENSORS, sample_period_s=period_s, start_s=start_s)


@pytest.mark.parametrize("period_s", PERIODS_S)
@pytest.mark.parametrize("rates", [(5.0, 0.0, 0.0), (0.0, -3.0, 0.0), (6.0, 4.0, -9.0), (40.0, -2.0, 12.0)])
def test_constant_body_rates_are_found_exactly(rates, period_s):
    blocks = blocks_of([turning(rates, period_s=period_s)])
    steep = np.isnan(blocks.rates).any(axis=1)
    np.testing.assert_allclose(blocks.rates[~steep], np.tile(rates, ((~steep).sum(), 1)), atol=1e-9)
    np.testing.assert_allclose(blocks.gyros, np.tile(rates, (len(blocks), 1)), atol=1e-9)
    assert np.count_nonzero(steep) <= 0.1 * len(blocks)
    assert blocks.period_s == pytest.approx(0.2 if period_s != 0.25 else 0.25)
    assert len(blocks) == pytest.approx(12.0 / blocks.period_s)


def test_small_and_large_turns_of_one_block_are_exact():
    for size in (1e-7, 1e-3, 1.0, 100.0, 800.0):
        blocks = blocks_of([turning((size, 0.0, 0.0), first=(0.0, 0.0, 0.0), duration_s=2.0)])
        np.testing.assert_allclose(blocks.rates[:, 0], size, rtol=1e-6)
        np.testing.assert_allclose(blocks.rates[:, 1:], 0.0, atol=1e-9 * max(size, 1.0))


def test_angles_may_wrap_and_their_own_slopes_are_told():
    whole = turning((0.0, 0.0, 30.0), first=(0.0, 0.0, 170.0), duration_s=20.0)
    blocks, wrapped = blocks_of([whole]), blocks_of([whole.replace("psi", (whole["psi"] + 180.0) % 360.0 - 180.0)])
    np.testing.assert_allclose(wrapped.rates, blocks.rates, atol=1e-9)
    np.testing.assert_allclose(blocks.euler_rates[:, 2], 30.0, atol=1e-9)
    np.testing.assert_allclose(blocks.angles[:, 2], 170.0 + 6.0 * np.arange(len(blocks)), atol=1e-9)


@pytest.mark.parametrize(("pitch", "is_told"), [(80.0, True), (-84.0, True), (86.0, False), (-88.0, False)])
def test_turns_near_a_pitch_of_90_degrees_are_not_known(pitch, is_told):
    blocks = blocks_of([turning((0.0, 0.0, 0.0), first=(0.0, pitch, 10.0), duration_s=4.0)])
    assert np.isfinite(blocks.rates).all() == is_told
    assert np.isfinite(blocks.gyros).all()


@pytest.mark.parametrize("sensor", SENSORS)
def test_a_missing_sample_leaves_its_own_blocks_unknown(sensor):
    record = turning((4.0, -3.0, 7.0))
    row = 4 * 20 + 2  # in the middle of block 20
    values = record[sensor].copy()
    values[row] = np.nan
    blocks, whole = blocks_of([record.replace(sensor, values)]), blocks_of([record])
    of_gyro = sensor in GYROS
    axis = SENSORS.index(sensor) % 3
    lost = np.isnan(blocks.gyros if of_gyro else blocks.angles)
    assert np.isnan(blocks.rates).sum() == 0  # an angle is read at the edges alone
    if of_gyro:
        assert np.argwhere(lost).tolist() == [[20, axis]]
        there = ~lost
        np.testing.assert_array_equal(blocks.gyros[there], whole.gyros[there])
    else:
        assert not lost.any()
    values = record[sensor].copy()
    values[4 * 20] = np.nan  # on an edge: of the blocks on both sides
    blocks = blocks_of([record.replace(sensor, values)])
    lost = np.isnan(blocks.gyros if of_gyro else blocks.rates).any(axis=1)
    assert np.flatnonzero(lost).tolist() == [19, 20]


@pytest.mark.parametrize("shift", [0, 1, 2, 3])
def test_gaps_leave_unknown_what_they_cover_and_no_more(shift):
    """A block is known whose samples, those at both ends among them, are of one record."""
    record = motion(20.0)
    whole = blocks_of([record])
    parts = [range(121 + shift), range(202 + shift, 331 + shift), range(352, len(record))]
    blocks = blocks_of([record.part(part) for part in parts])
    assert (len(blocks), blocks.start_s) == (len(whole), 0.0)
    known = [any({4 * block, 4 * block + 4} <= {*part} for part in parts) for block in range(len(whole))]
    for name in ("gyros", "rates", "euler_rates", "angles"):
        found = getattr(blocks, name)
        assert np.isfinite(found).all(axis=1).tolist() == known
        np.testing.assert_allclose(found[known], getattr(whole, name)[known], atol=1e-9)


def test_a_record_that_is_shorter_than_a_block_tells_nothing():
    record = motion(20.0)
    blocks = blocks_of([record.part(range(81)), record.part(range(100, 103)), record.part(range(200, 401))])
    assert np.isnan(blocks.gyros[20:50]).all()
    assert np.isfinite(blocks.gyros[50:]).all()


@pytest.mark.parametrize("start_s", [0.0, 3.7, 1e5 + 0.03])
def test_blocks_begin_with_the_log(start_s):
    blocks = blocks_of([turning((1.0, 2.0, 3.0), start_s=start_s)])
    assert blocks.start_s == start_s
    np.testing.assert_allclose(blocks.time_s, start_s + 0.2 * np.arange(60), atol=1e-6)
    assert np.isfinite([blocks.gyros, blocks.rates, blocks.rough]).all()


def test_spans_take_the_blocks_that_they_touch():
    blocks = blocks_of([motion(20.0, start_s=5.0)])
    inside = blocks.within([(6.1, 6.9), (10.05, 10.06), (-50.0, 0.0), (99.0, 200.0)])
    assert np.flatnonzero(inside).tolist() == [5, 6, 7, 8, 9, 25]
    assert not blocks.within([]).any()


def test_means_of_gyros_are_the_integral_between_the_edges_of_a_block():
    record = motion(20.0, noise=0.0)
    time_s = record.time_s
    ramp = record.replace("q", 3.0 * time_s)
    np.testing.assert_allclose(blocks_of([ramp]).gyros[:, 1], 0.6 * np.arange(100) + 0.3, atol=1e-9)
    error = blocks_of([record]).gyros - blocks_of([record]).rates
    assert np.abs(error).max() < 0.03  # of a trapezium and of a rotation that isn't quite constant


@pytest.mark.parametrize("deviation", [0.2, 1.5])
def test_roughness_is_six_times_the_variance_of_white_noise_and_no_slow_motion(deviation):
    random = np.random.default_rng(3)
    record = motion(600.0, noise=0.0)
    noisy = record.replace("r", record["r"] + deviation * random.standard_normal(len(record)))
    quiet, loud = blocks_of([record]).rough.mean(axis=0), blocks_of([noisy]).rough.mean(axis=0)
    assert loud[2] == pytest.approx(6.0 * deviation**2, rel=0.05)
    np.testing.assert_array_equal(loud[:2], quiet[:2])
    assert (quiet < 0.02).all()


def test_how_long_a_channel_has_read_one_value_is_told_at_the_end_of_each_block():
    record = motion(20.0)
    q = record["q"].copy()
    q[100:201] = q[100]  # from 5 to 10 s
    held_s = blocks_of([record.replace("q", q)]).held_s
    np.testing.assert_allclose(held_s[24:50, 1], 0.2 * np.arange(26), atol=1e-9)
    assert held_s[50:, 1].max() == held_s[:24, 1].max() == 0.0
    assert np.delete(held_s, 1, axis=1).max() == 0.0


@pytest.mark.parametrize(("size", "is_held"), [(1e-9, True), (0.01, False)])
def test_rounding_by_interpolation_is_one_value_and_noise_is_not(size, is_held):
    record = motion(20.0)
    r = record["r"].copy()
    r[200:301] = 2.0 + size * np.random.default_rng(1).standard_normal(101)
    assert (blocks_of([record.replace("r", r)]).held_s[:, 2].max() > 4.5) == is_held


def test_nothing_is_held_where_samples_are_missing():
    record = motion(20.0)
    q = record["q"].copy()
    q[100:201] = np.nan
    assert blocks_of([record.replace("q", q)]).held_s[:, 1].max() == 0.0


def test_axes_turned_by_half_about_one_turn_its_others():
    """Seen from axes turned by half about x, q, r and the angles theta and psi have their signs changed."""
    record = motion(20.0)
    other = record
    for name in ("q", "r", "theta", "psi"):
        other = other.replace(name, -record[name])
    signs = np.array([1.0, -1.0, -1.0])
    blocks, turned = blocks_of([record]), blocks_of([other])
    np.testing.assert_allclose(turned.gyros, signs * blocks.gyros, atol=1e-9)
    np.testing.assert_allclose(turned.rates, signs * blocks.rates, atol=1e-9)
    assert ATTITUDE == ("phi", "theta", "psi")


def test_a_reading_is_held_that_interpolation_rounds_and_none_that_is_missing():
    values = np.array([0.0, 5.0, 5.0 + 1e-9, np.nan, np.nan, 3.0, 3.0])
    assert held_for_s(0.5 * np.arange(7.0), values).tolist() == [0.0, 0.0, 0.5, 0.0, 0.0, 0.0, 0.5]
    assert held_for_s(np.arange(4.0), np.full(4, 2.0)).tolist() == [0.0, 1.0, 2.0, 3.0]  # that never moves

"""Levels: what is added from an onset on is never above what is stated for it, and chance alone changes nothing."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from gtmbench.engine.hindsight.cleared_sensors import _shown
from gtmbench.engine.hindsight.levels import SPARE, WINDOWS_S, ChunkLevel, _restless, shift_of, stepped_at
from gtmbench.values.attitude_estimators import SLOWEST_S

CHUNKS = 60
DRAWS = 50
ANY = 1e-9  # a level that wanders in health: the scatter of its chunks counts in no bound


def level(values, *, deviations=0.1, floor=0.0):
    return ChunkLevel(values=values, deviations=np.broadcast_to(deviations, values.shape).copy(), floor=floor)


def white(seed=1, chunks=CHUNKS, deviation=0.1):
    return deviation * np.random.default_rng(seed).standard_normal(chunks)


def stepped(values, onset, size, until=None):
    changed = values.copy()
    changed[onset:until] += size
    return changed


@cache
def healthy(seed=1):
    return shift_of(level(white(seed)))


# what is promised ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("size", [-30.0, -0.5, 0.05, 0.3, 2.0])
@pytest.mark.parametrize("seed", range(2))
def test_what_begins_at_a_chunk_is_below_the_bound_there_or_shows(seed, size):
    """S is added to the medians behind the onset and to none before it, whatever else is known of the level."""
    values = white(seed)
    for onset in range(3, CHUNKS - 2, 2):
        shift = shift_of(level(stepped(values, onset, size)))
        assert shift.bounds[onset] >= abs(size)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("seed", range(6))
def test_a_change_of_one_and_a_half_the_stated_size_shows_whatever_its_sign(seed, sign):
    """One of the stated size may count as wander, and its bound grows then."""
    values, bounds = white(seed), healthy(seed).bounds
    for onset in range(5, CHUNKS - 4, 4):
        shift = shift_of(level(stepped(values, onset, sign * 1.5 * bounds[onset])))
        assert np.sign(shift.size) == sign
        assert shift.size == (shift.rises if sign > 0.0 else shift.falls)
        assert abs(shift.onset - onset) <= 2


def test_a_change_of_the_stated_size_mostly_shows():
    shown = [
        bool(shift_of(level(stepped(white(seed), onset, sign * healthy(seed).bounds[onset]))).size)
        for seed in range(10)
        for onset in range(5, CHUNKS - 4, 8)
        for sign in (-1.0, 1.0)
    ]
    assert np.mean(shown) > 0.7


def test_half_of_what_is_stated_shows_seldom():
    """A bound is no larger than it has to be."""
    shown = [
        bool(shift_of(level(stepped(white(seed), onset, 0.5 * healthy(seed).bounds[onset]))).size)
        for seed in range(10)
        for onset in (10, 20, 30, 40, 50)
    ]
    assert np.mean(shown) < 0.2


@pytest.mark.parametrize(("seed", "size"), [(seed, size) for seed in range(5) for size in (-4.0, 1.0)])
def test_the_onset_of_a_step_and_its_size(seed, size):
    for onset in (8, 30, 55):
        shift = shift_of(level(stepped(white(seed), onset, size)))
        assert shift.onset == onset
        assert shift.size == pytest.approx(size, abs=0.25)


# chance -------------------------------------------------------------------------------------------------------------


def student(random):
    return 0.1 * random.standard_t(3, CHUNKS)


def normal(random):
    return 0.1 * random.standard_normal(CHUNKS)


def one_wild(random):
    values = normal(random)
    values[random.integers(CHUNKS)] += 10.0
    return values


@pytest.mark.parametrize("draw", [normal, student, one_wild])
def test_nothing_shows_in_health(draw):
    shifts = [shift_of(level(draw(np.random.default_rng(seed)))) for seed in range(DRAWS)]
    assert np.mean([shift.size != 0.0 for shift in shifts]) <= 0.04
    assert all((shift.onset is None) == (shift.size == 0.0) for shift in shifts)


def test_a_level_that_wanders_has_wider_bounds_and_does_not_show():
    shown, wider = [], []
    for seed in range(DRAWS):
        random = np.random.default_rng(seed)
        calm = 0.1 * random.standard_normal(200)
        wanders = shift_of(replace(level(calm + np.cumsum(0.03 * random.standard_normal(200))), wanders=ANY))
        shown.append(wanders.size != 0.0)
        wider.append(
            np.median(wanders.bounds[10:190]) / np.median(shift_of(replace(level(calm), wanders=ANY)).bounds[10:190])
        )
    assert np.mean(shown) <= 0.5  # 0.9 by the scatter of neighbours alone
    assert np.median(wider) > 2.0


def test_one_step_is_no_wander():
    """A fault is told however restless a level is taken for: a step widens no bound by much."""
    for seed in range(5):
        wide = shift_of(level(stepped(white(seed, 120), 60, 5.0)))
        usual = shift_of(level(white(seed, 120)))
        assert wide.size == pytest.approx(5.0, abs=0.2)
        assert np.median(wide.bounds[90:110] - 5.0) < 2.0 * np.median(usual.bounds[90:110])


# what is too little -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("known", [0, 1, 2, 3, 4, 5])
def test_too_few_chunks_promise_nothing(known):
    values = np.full(CHUNKS, np.nan)
    values[20 : 20 + known] = white(1, known) if known else 0.0
    shift = shift_of(level(values))
    assert np.isinf(shift.bounds).all()
    assert (shift.size, shift.onset) == (0.0, None)


@pytest.mark.parametrize("chunks", [1, 2, 5])
def test_a_log_of_few_chunks_promises_nothing(chunks):
    assert np.isinf(shift_of(level(white(1, chunks))).bounds).all()


def test_the_ends_of_a_log_promise_nothing():
    bounds = healthy().bounds
    assert np.flatnonzero(np.isfinite(bounds)).tolist() == list(range(3, CHUNKS - 2))


def test_a_change_of_two_chunks_shows_by_half_and_one_of_three_whole():
    """The shortest window has four."""
    for size in (-8.0, 8.0):
        for chunks, share in ((2, 0.5), (3, 1.0)):
            shift = shift_of(level(stepped(white(1), 30, size, 30 + chunks)))
            assert shift.size == pytest.approx(share * size, rel=0.1)


def test_no_change_below_the_floor_shows_and_none_is_promised():
    values = 0.001 * white(1)
    for size, shows in ((0.25, False), (-0.25, False), (0.35, True), (-0.35, True)):
        assert (shift_of(level(stepped(values, 30, size), floor=0.3)).size != 0.0) == shows
    bounds = shift_of(level(values, floor=0.3)).bounds[5:50]
    np.testing.assert_allclose(bounds, 0.3 * SPARE, rtol=0.01)


# what shows late ----------------------------------------------------------------------------------------------------


def late_only():
    """Return the shares that a fault shows that only the last window sees."""
    return np.array([1e-9] * (len(WINDOWS_S) - 1) + [1.0])


def test_a_fault_that_shows_late_is_bounded_by_the_late_window():
    values, onset = white(2), 20
    usual = shift_of(level(values), late_only())
    late = stepped(values, onset + 10, 1.2 * usual.bounds[onset])  # nothing of it shows for 20 s
    assert shift_of(level(late)).size > 0.0
    assert shift_of(level(late), late_only()).bounds[onset] > 1.0 * usual.bounds[onset]
    assert np.isfinite(usual.bounds[3:48]).all()  # three chunks lie 20 s behind
    assert (usual.bounds[48:] > 1e6).all()  # behind that, only windows are known in which nothing of it shows


@pytest.mark.parametrize(("wild", "at"), [(2, 50), (3, 13)])
def test_a_level_steps_where_means_of_all_but_a_fiftieth_of_its_values_part_most(wild, at):
    values = np.where(np.arange(101) < 50, 0.0, 1.0)
    values[13 - wild : 13] = -7.0
    assert stepped_at(values) == stepped_at(-values) == at
    assert stepped_at(np.insert(values, 5, np.full(4, np.nan))) == at + 4


# by definition --------------------------------------------------------------------------------------------------------


def restless(values, deviations):
    """Return by how much neighbours scatter, in deviations, and how far the level wanders beyond that."""

    def spread(lag):
        far = np.abs(values[lag:] - values[:-lag]) / np.hypot(deviations[lag:], deviations[:-lag])
        far = far[np.isfinite(far)]
        return np.quantile(far, 0.6) / 0.8416, len(far)

    scale, grown = spread(1)[0], [0.0]
    for lag in (2, 4, 8, 16, 32, 64, 128):
        if len(values) >= 8 * lag:
            far, count = spread(lag)
            grown.append((1.0 - 2.4 / np.sqrt(count)) * far**2 - scale**2)
    return scale, np.median(deviations[np.isfinite(deviations)]) * np.sqrt(max(grown))


@pytest.mark.parametrize(("steps", "wanders"), [(0.0, 0.0), (0.1, 0.0), (0.1, 0.2)])
@pytest.mark.parametrize(("seed", "size"), [(1, 0.0), (2, 1.2), (3, -1.5)])
def test_bounds_and_changes_are_those_of_medians_on_both_sides_of_every_onset(seed, size, steps, wanders):
    random = np.random.default_rng(seed)
    deviations = random.uniform(0.1, 0.3, 128)
    values = random.standard_normal(128) * deviations + np.cumsum(steps * random.standard_normal(128))
    values = stepped(values, 80, size)
    values[random.random(128) < 0.1] = np.nan
    known = np.isfinite(values)
    shown = np.array([0.5, 0.7, 0.9, 1.0, 1.0])
    own = ChunkLevel(values=values, deviations=deviations, floor=0.25, wanders=wanders)
    scale, wander = restless(values, np.where(known, deviations, np.inf))
    rates = known / (scale * deviations)
    spread = 5.0 * scale * np.median(deviations[known])
    bounds, most = np.full(128, np.inf), np.zeros(128)
    for (from_s, to_s), share in zip(WINDOWS_S, shown, strict=True):
        for onset in range(128):
            parts = slice(0, onset), slice(onset + round(from_s / 2.0), onset + round(to_s / 2.0))
            counts = [np.count_nonzero(known[part]) for part in parts]
            if min(counts) < 3:
                continue
            before, behind = (np.nanmedian(values[part]) for part in parts)
            variance = sum(0.5 * np.pi * n / rates[part].sum() ** 2 for n, part in zip(counts, parts, strict=True))
            chance = 5.0 * np.sqrt(variance + wander**2)
            promised = max(chance, 0.25) if wanders else max(chance, 0.25, spread)
            bounds[onset] = min(bounds[onset], (abs(behind - before) + 1.1 * promised) / share)
            if abs(behind - before) > max(promised, spread, wanders, abs(most[onset])):
                most[onset] = behind - before
    found = shift_of(own, shown)
    np.testing.assert_allclose(found.bounds, bounds)
    if found.onset is not None:
        assert (found.rises, found.falls) == pytest.approx((max(most.max(), 0.0), min(most.min(), 0.0)))
        assert abs(found.size) == max(found.rises, -found.falls)
    assert (found.onset is not None) <= bool(most.any())
    assert found.onset is not None or not size or steps


def test_of_what_an_estimator_takes_back_windows_show_their_mean():
    ends = np.array([(0.0, 8.0), (0.0, 20.0), (0.0, 60.0), (20.0, 60.0), (30.0, 60.0)])
    moments = np.linspace(*ends.T, 10_001)
    np.testing.assert_allclose(_shown(is_driven=True), 1.0 - np.exp(-moments / SLOWEST_S).mean(axis=0), atol=1e-3)


@pytest.mark.parametrize(("count", "lag"), [(15, 1), (511, 32), (512, 64), (1023, 64), (1024, 128)])
def test_a_level_wanders_over_an_eighth_of_the_log_at_most(count, lag):
    """One that grows by 1 a chunk tells which is the longest lag."""
    scale = np.sqrt(0.5) / 0.8416
    grown = (1.0 - 2.4 / np.sqrt(count - lag)) * lag**2 - 1.0
    found = _restless(np.arange(float(count)), np.ones(count))
    assert found == pytest.approx((scale, scale * np.sqrt(max(grown, 0.0))))

"""Flights of sensors that each have their own stamps: means are integrals, gaps stay gaps, angles have no turns."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine import samples as subject
from gtmbench.engine.blocks import blocks_of
from gtmbench.engine.samples import (
    FORCES,
    Samples,
    _in_gap,
    _moments,
    attitude_lag_s,
    flight_of,
    held_between,
    means_between,
    rough_between,
)
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.turning import SENSORS, angles_and_slopes, body_rates, motion

RATES_HZ = {
    "p": 50.0,
    "q": 83.0,
    "r": 31.0,
    "phi": 40.0,
    "theta": 25.0,
    "psi": 11.0,
    "nx": 20.0,
    "ny": 33.0,
    "nz": 47.0,
}
UNEVEN = 0.3  # of a step: by how much stamps are uneven


def stamps(rate_hz, duration_s, seed, start_s=0.0):
    """Return times that are uneven, increasing, and begin and end a bit apart from those of other sensors."""
    random = np.random.default_rng(seed)
    count = round(duration_s * rate_hz)
    uneven = np.arange(count) + UNEVEN * random.uniform(-1.0, 1.0, count)
    return start_s + (uneven + 1.0) / rate_hz


def sensors_of(duration_s=60.0, start_s=0.0, noise=0.0, names=SENSORS):
    """Return what sensors read of one smooth motion, each at its own stamps."""
    found = {}
    for place, name in enumerate(names):
        time_s = stamps(RATES_HZ[name], duration_s, 10 + place, start_s)
        angles, slopes = angles_and_slopes(time_s - start_s, 2)
        read = np.column_stack([body_rates(angles, slopes), angles, np.cos(angles / 20.0)])[:, place]
        random = np.random.default_rng(place)
        found[name] = Samples(time_s, read + noise * random.standard_normal(len(time_s)))
    return found


def flown(sensors):
    return flight_of(sensors, is_driven=False)


def edges_of(blocks):
    return blocks.start_s + blocks.period_s * np.arange(len(blocks) + 1)


def integral(samples, first_s, last_s):
    """Return the integral of what goes straight from sample to sample, by all of its corners."""
    corners = samples.time_s[(samples.time_s > first_s) & (samples.time_s < last_s)]
    at_s = np.concatenate([[first_s], corners, [last_s]])
    return np.trapezoid(np.interp(at_s, samples.time_s, samples.values), at_s)


def test_a_block_has_the_mean_of_its_samples_and_their_deviation_where_there_are_three():
    samples = Samples(np.arange(6.0), np.array([1.0, 3.0, 2.0, np.nan, 5.0, 6.0]))
    mean, deviation = _moments(samples, np.array([0.0, 3.0, 6.0, 9.0]))
    np.testing.assert_allclose(mean, [2.0, 5.5, np.nan])
    np.testing.assert_allclose(deviation, [np.sqrt(2.0 / 3.0), np.nan, np.nan])


def test_roughness_is_the_mean_square_of_second_differences_that_no_gap_parts():
    time_s = np.delete(np.arange(400) * 0.02, [30, 31, 32, *range(100, 250)])
    values = np.random.default_rng(3).standard_normal(len(time_s))
    edges, expected = np.arange(9.0), []
    for first_s in edges[:-1]:
        rows = [k for k in range(1, len(time_s) - 1) if first_s <= time_s[k] < first_s + 1.0]
        even = [k for k in rows if max(time_s[k + 1] - time_s[k], time_s[k] - time_s[k - 1]) < 0.03]
        parts = [(values[k - 1] - 2.0 * values[k] + values[k + 1]) ** 2 for k in even]
        expected.append(np.mean(parts) if parts else np.nan)
    assert np.isnan(expected).sum() == 3
    np.testing.assert_allclose(rough_between(Samples(time_s, values), edges), expected)


@pytest.mark.parametrize("start_s", [0.0, 1234.5])
def test_means_are_the_integrals_of_what_goes_straight_between_samples(start_s):
    sensors = sensors_of(start_s=start_s, noise=1.0)
    flight = flown(sensors)
    blocks, edges = flight.blocks, edges_of(flight.blocks)
    for axis, gyro in enumerate(GYROS):
        exact = [integral(sensors[gyro], *edges[at : at + 2]) / blocks.period_s for at in range(len(blocks))]
        np.testing.assert_allclose(means_between(sensors[gyro], edges), exact, atol=1e-8)
        stamps_s = flight.angle_stamps_s[axis]
        turned = [integral(sensors[gyro], sensors[gyro].time_s[0], stamp_s) for stamp_s in stamps_s]
        straight = np.diff(np.interp(edges, stamps_s, turned)) / blocks.period_s
        np.testing.assert_allclose(blocks.gyros[:, axis], straight, atol=1e-8)


@pytest.mark.parametrize("late_s", [0.0, 0.07, 0.125])
def test_where_edges_fall_between_stamps_of_a_slow_attitude_changes_no_gain(late_s):
    """At 1 Hz four angles a second, read amid the blocks, tell of 0.7 of the turns; the gyros' blocks do alike."""
    fast_s, slow_s = np.arange(0.0, 60.0, 0.01), np.arange(0.0, 60.0, 0.25)
    turning = {"p": Samples(fast_s, 6.28 * np.cos(6.28 * fast_s)), "phi": Samples(slow_s, np.sin(6.28 * slow_s))}
    rest = {name: Samples(slow_s, 0.0 * slow_s) for name in ("theta", "psi")}
    still = {name: Samples(fast_s[fast_s >= late_s], 0.0 * fast_s[fast_s >= late_s]) for name in ("q", "r")}
    blocks = flight_of({**turning, **rest, **still}, is_driven=False).blocks
    assert blocks.start_s == pytest.approx(late_s, abs=0.011)
    np.testing.assert_allclose(blocks.gyros[:, 0], blocks.rates[:, 0], atol=0.02)


def test_gyros_and_attitude_on_stamps_of_their_own_turn_alike():
    blocks = flown(sensors_of()).blocks
    assert np.abs(blocks.gyros).max() > 5.0
    assert np.abs(blocks.gyros - blocks.rates).max() < 1.0  # psi goes straight for a tenth of a second
    assert np.sqrt(np.mean((blocks.gyros - blocks.rates) ** 2)) < 0.12


def test_blocks_lie_where_all_sensors_read():
    sensors = sensors_of()
    late = sensors["q"]
    sensors["q"] = Samples(late.time_s[late.time_s > 7.03], late.values[late.time_s > 7.03])
    ended = sensors["phi"]
    sensors["phi"] = Samples(ended.time_s[ended.time_s < 48.9], ended.values[ended.time_s < 48.9])
    blocks = flown(sensors).blocks
    assert 7.0 < blocks.start_s < 7.2
    assert 48.5 < edges_of(blocks)[-1] < 49.0
    assert np.isfinite(blocks.gyros).all()
    assert np.isfinite(blocks.rates).all()


@pytest.mark.parametrize("name", SENSORS)
@pytest.mark.parametrize("is_dropped", [True, False], ids=["no samples", "samples of nothing"])
def test_a_gap_is_unknown_there_and_only_there(name, is_dropped):
    sensors = sensors_of()
    whole, own = flown(sensors).blocks, sensors[name]
    inside = (own.time_s > 20.0) & (own.time_s < 25.0)
    dropped = Samples(own.time_s[~inside], own.values[~inside])
    blank = Samples(own.time_s, np.where(inside, np.nan, own.values))
    blocks = flown({**sensors, name: dropped if is_dropped else blank}).blocks
    edges = edges_of(blocks)
    middle_s = 0.5 * (edges[1:] + edges[:-1])
    axis, of_gyro = SENSORS.index(name) % 3, name in GYROS
    lost = np.isnan(blocks.gyros if of_gyro else blocks.rates)
    if of_gyro:
        assert not np.delete(lost, axis, axis=1).any()
        assert np.isfinite(blocks.rates).all()
    else:
        assert (lost == lost[:, [0]]).all()  # an angle enters all axes
        assert np.isfinite(blocks.gyros).all()
    own_lost = lost[:, axis]
    assert own_lost[(middle_s > 20.1) & (middle_s < 24.9)].all()
    assert not own_lost[(middle_s < 19.4) | (middle_s > 25.6)].any()
    there = ~lost.any(axis=1)
    if of_gyro:
        known, exact = blocks.gyros[there, axis], np.interp(middle_s[there], edges_mid(whole), whole.gyros[:, axis])
        assert np.abs(known - exact).max() < 0.3


def edges_mid(blocks):
    edges = edges_of(blocks)
    return 0.5 * (edges[1:] + edges[:-1])


def test_a_block_is_in_a_gap_that_it_shares_time_with():
    """Two and a half of the usual steps, and a block, are one."""
    edges = np.arange(0.0, 10.1, 0.2)
    for first_s, last_s, blocks in (
        (2.05, 3.15, [*range(10, 16)]),
        (2.0, 3.0, [*range(10, 15)]),
        (9.0, 20.0, [*range(45, 50)]),
    ):
        time_s = np.concatenate([np.arange(-0.05, first_s + 0.01, 0.05), np.arange(last_s, 30.0, 0.05)])
        assert np.flatnonzero(_in_gap(Samples(time_s, time_s), edges)).tolist() == blocks
    assert not _in_gap(Samples(np.array([0.0, 0.1, 0.2, 0.3, 0.49, 0.6, 0.7]), np.zeros(7)), edges[:3]).any()
    thin = np.delete(np.arange(0.0, 10.0, 0.05), [50, 51])
    assert not _in_gap(Samples(thin, thin), edges[:40]).any()  # three steps, and no block
    slow = np.delete(np.arange(0.0, 10.0, 0.1), [50, 51])
    assert np.flatnonzero(_in_gap(Samples(slow, slow), edges)).tolist() == [24, 25]
    assert not _in_gap(Samples(np.delete(slow, [20]), np.delete(slow, [20])), edges)[:20].any()


def test_single_samples_that_are_missing_are_bridged():
    sensors = sensors_of()
    own = sensors["p"]
    thin = np.ones(len(own.time_s), dtype=bool)
    thin[200:220:2] = False
    blocks = flown({**sensors, "p": Samples(own.time_s[thin], own.values[thin])}).blocks
    assert np.isfinite(blocks.gyros).all()


@pytest.mark.parametrize("name", ["q", "theta"])
@pytest.mark.parametrize("at_end", [True, False])
def test_what_is_missing_until_the_end_or_from_the_beginning_is_not_known(name, at_end):
    sensors = sensors_of()
    own = sensors[name]
    missing = own.time_s > 40.0 if at_end else own.time_s < 20.0
    blocks = flown({**sensors, name: Samples(own.time_s, np.where(missing, np.nan, own.values))}).blocks
    outside = edges_mid(blocks) > 40.3 if at_end else edges_mid(blocks) < 19.7
    read = blocks.gyros[:, 1] if name == "q" else blocks.rates[:, 1]
    assert np.isnan(read[outside]).all()
    assert np.isfinite(read[~outside][5:-5]).all()


@pytest.mark.parametrize("turns", [1.0, -3.0])
def test_a_heading_that_wraps_turns_no_further(turns):
    sensors = sensors_of()
    time_s, psi = sensors["psi"]
    psi = psi + turns * 360.0 * time_s / 60.0
    rate = turns * 6.0
    gyros = {}
    for axis, gyro in enumerate(GYROS):
        own_s = sensors[gyro].time_s
        angles, slopes = angles_and_slopes(own_s, 2)
        gyros[gyro] = Samples(own_s, body_rates(angles, slopes + np.array([0.0, 0.0, rate]))[:, axis])
    whole = flown({**sensors, **gyros, "psi": Samples(time_s, psi)})
    wrapped = flown({**sensors, **gyros, "psi": Samples(time_s, (psi + 180.0) % 360.0 - 180.0)})
    np.testing.assert_allclose(wrapped.blocks.rates, whole.blocks.rates, atol=1e-9)
    np.testing.assert_allclose(wrapped.blocks.euler_rates, whole.blocks.euler_rates, atol=1e-9)
    assert np.abs(wrapped.blocks.euler_rates[:, 2]).max() < 60.0
    assert np.ptp(wrapped.angles[:, 2]) == pytest.approx(abs(turns) * 360.0, rel=0.15)


@pytest.mark.parametrize("name", SENSORS)
def test_how_long_a_sensor_has_read_one_value_is_told_at_the_end_of_each_block(name):
    sensors = sensors_of()
    own = sensors[name]
    held = own.values.copy()
    inside = (own.time_s >= 20.0) & (own.time_s <= 30.0)
    held[inside] = held[np.flatnonzero(inside)[0]]
    blocks = flown({**sensors, name: Samples(own.time_s, held)}).blocks
    ends = edges_of(blocks)[1:]
    place = SENSORS.index(name)
    step = 2.0 / RATES_HZ[name]
    during = (ends > 20.5) & (ends < 29.5)
    np.testing.assert_allclose(blocks.held_s[during, place], ends[during] - 20.0, atol=step + 0.1)
    assert blocks.held_s[ends < 19.8, place].max() < step
    assert blocks.held_s[ends > 30.4, place].max() < step
    assert np.delete(blocks.held_s, place, axis=1).max() < 0.2


@pytest.mark.parametrize("rate_hz", [20.0, 50.0, 100.0])
@pytest.mark.parametrize("start_s", [0.0, 77.0])
def test_samples_of_an_even_record_make_the_blocks_of_the_record(rate_hz, start_s):
    record = motion(30.0, rate_hz, seed=4, start_s=start_s, noise=0.0)
    own, of_record = flown(samples_of(record)).blocks, blocks_of([record])
    assert own.period_s == pytest.approx(of_record.period_s)
    assert own.start_s == pytest.approx(of_record.start_s, abs=0.03)  # the attitude's stamps may be taken a bit earlier
    count = min(len(own), len(of_record))
    assert count >= len(of_record) - 1
    for name, atol in (("gyros", 0.3), ("rates", 0.3), ("euler_rates", 0.4), ("angles", 0.5)):
        found, expected = getattr(own, name)[:count], getattr(of_record, name)[:count]
        np.testing.assert_allclose(found, expected, atol=atol)
        assert np.sqrt(np.mean((found - expected) ** 2)) < 0.2 * atol + 0.02
    np.testing.assert_array_equal(own.held_s, 0.0)


def samples_of(record):
    return {name: Samples(record.time_s, record[name]) for name in record.channels}


def test_samples_of_a_record_without_a_turn_make_its_blocks_exactly():
    """Where nothing turns, nothing tells of a lag, and all stamps stay."""
    random = np.random.default_rng(3)
    values = np.zeros((601, 6))
    values[:, :3] = random.standard_normal(3)
    record = gb.Record(values, channels=SENSORS, sample_period_s=0.05)
    own, of_record = flown(samples_of(record)).blocks, blocks_of([record])
    assert len(own) == len(of_record)
    for name in ("gyros", "rates", "euler_rates", "angles", "rough"):
        np.testing.assert_allclose(getattr(own, name), getattr(of_record, name), atol=1e-9)


@pytest.mark.parametrize("lag_s", [-0.33, -0.15, 0.075, 0.18])
def test_an_attitude_that_is_stamped_late_is_taken_so_much_earlier(lag_s):
    sensors = sensors_of()
    late = {name: Samples(sensors[name].time_s + lag_s, sensors[name].values) for name in ATTITUDE}
    blocks = flown({**sensors, **late}).blocks
    assert np.sqrt(np.mean((blocks.gyros - blocks.rates) ** 2)) < 0.12
    assert attitude_lag_s({**sensors, **late}) == pytest.approx(lag_s, abs=0.008)
    still = {name: Samples(each.time_s, 0.0 * each.values) for name, each in sensors.items()}
    blank = {"psi": Samples(sensors["psi"].time_s, np.nan * sensors["psi"].values)}
    assert attitude_lag_s(still) == attitude_lag_s({**sensors, **late, **blank}) == 0.0
    assert (
        attitude_lag_s({**sensors, **{name: Samples(late[name].time_s + 2.0, late[name].values) for name in late}})
        == 0.0
    )


def test_a_lag_is_told_of_the_part_of_a_long_log_in_which_it_turns_most(monkeypatch):
    monkeypatch.setattr(subject, "_TELL_LAG", 50)
    edges = 0.2 * np.arange(301)
    gyros = np.where((np.arange(300) >= 120) & (np.arange(300) < 170), 5.0, 0.1)[:, np.newaxis] * np.ones(3)
    time_s = np.arange(0.0, 60.0, 0.1)
    angles = {name: Samples(time_s, time_s) for name in ATTITUDE}
    cut, own, between = subject._liveliest(angles, gyros, edges)
    assert (between[0], between[-1], len(between)) == (pytest.approx(24.0), pytest.approx(34.0), 51)
    assert (own == 5.0).all()
    for each in cut.values():  # and as much beside it as a lag may be
        assert (each.time_s[0], each.time_s[-1]) == (pytest.approx(23.6, abs=0.11), pytest.approx(34.4, abs=0.11))
        assert each.time_s[0] <= 23.6 < 34.4 <= each.time_s[-1]


def test_two_samples_tell_a_mean_and_values_are_held_up_to_the_end_of_a_block():
    edges = np.array([0.0, 0.2, 0.4])
    assert means_between(Samples(np.array([0.0, 0.4]), np.array([1.0, 3.0])), edges).tolist() == pytest.approx(
        [1.5, 2.5]
    )
    assert np.isnan(means_between(Samples(np.array([0.0, 0.4]), np.array([1.0, np.nan])), edges)).all()
    time_s = np.arange(0.0, 2.01, 0.1)
    moved = Samples(time_s, np.where(time_s < 0.95, 1.0, 2.0))
    found = held_between(moved, np.arange(0.0, 2.01, 0.2))
    assert found.tolist() == pytest.approx([0.2, 0.4, 0.6, 0.8, 0.0, 0.2, 0.4, 0.6, 0.8, 1.0])


@pytest.mark.parametrize(("slowest", "rate_hz", "period_s"), [("psi", 2.0, 0.5), ("r", 1.0, 1.0), ("q", 30.0, 0.2)])
def test_a_block_is_as_long_as_the_slowest_sensor_takes_but_no_shorter_than_a_fifth_of_a_second(
    slowest, rate_hz, period_s
):
    sensors = sensors_of()
    time_s = np.arange(0.0, 60.0, 1.0 / rate_hz)
    own = sensors[slowest]
    sensors[slowest] = Samples(time_s, np.interp(time_s, own.time_s, own.values))
    blocks = flown(sensors).blocks
    assert blocks.period_s == pytest.approx(period_s)
    assert np.isfinite(blocks.gyros).all()
    assert 58.0 <= len(blocks) * period_s <= 60.0


def test_the_step_of_a_sensor_is_the_usual_one():
    time_s = np.r_[np.arange(0.0, 10.0, 0.05), np.arange(30.0, 40.0, 0.05)]
    assert Samples(time_s, time_s).step_s == pytest.approx(0.05)
    assert Samples(np.array([1.0]), np.array([2.0])).step_s == np.inf


def test_the_slowest_gyro_is_told():
    sensors = sensors_of()
    assert flown(sensors).gyro_step_s == pytest.approx(1.0 / RATES_HZ["r"], rel=0.1)


def test_forces_are_means_of_each_block_and_shaking_is_the_deviation_of_the_vertical():
    sensors, random = sensors_of(), np.random.default_rng(6)
    for axis, name in enumerate(FORCES):
        time_s = stamps(RATES_HZ[name], 60.0, 30 + axis)
        deviation = np.where(time_s > 30.0, 0.3, 0.01) if name == "nz" else 0.5
        sensors[name] = Samples(time_s, axis + deviation * random.standard_normal(len(time_s)))
    flight = flown(sensors)
    edges = edges_of(flight.blocks)
    for at in range(0, len(flight), 17):
        for axis, name in enumerate(FORCES):
            own = sensors[name]
            inside = own.values[(own.time_s >= edges[at]) & (own.time_s < edges[at + 1])]
            assert flight.forces[at, axis] == pytest.approx(inside.mean())
        assert flight.shaking[at] == pytest.approx(inside.std())
    loud, quiet = flight.shaking[edges[:-1] > 30.2], flight.shaking[edges[1:] < 29.8]
    assert np.median(loud) == pytest.approx(0.28, abs=0.05)
    assert np.median(quiet) == pytest.approx(0.0095, abs=0.002)
    np.testing.assert_allclose(np.nanmean(flight.felt_rough, axis=0)[:2], 6.0 * 0.5**2, rtol=0.2)


def test_forces_that_are_missing_are_not_known_and_a_few_samples_do_not_tell_of_shaking():
    sensors = sensors_of()
    time_s = np.arange(0.0, 60.0, 0.1)  # two in a block
    for name in FORCES:
        sensors[name] = Samples(time_s, np.where((time_s > 20.0) & (time_s < 30.0), np.nan, 1.0))
    flight = flown(sensors)
    middle_s = edges_mid(flight.blocks)
    assert np.isnan(flight.forces[(middle_s > 20.2) & (middle_s < 29.8)]).all()
    np.testing.assert_array_equal(flight.forces[(middle_s < 19.8) | (middle_s > 30.2)], 1.0)
    assert np.isnan(flight.shaking[middle_s < 19.8]).mean() > 0.9


def test_a_flight_has_no_forces_unless_all_three_are_there():
    sensors = sensors_of()
    assert flown(sensors).forces is None
    sensors["nx"] = sensors["ny"] = Samples(np.arange(0.0, 60.0, 0.1), np.ones(600))
    assert flown(sensors).forces is None
    assert flown(sensors).shaking is None


@pytest.mark.parametrize("deviation", [0.2, 1.5])
def test_roughness_is_six_times_the_variance_of_white_noise_at_any_stamps(deviation):
    sensors = sensors_of(300.0)
    own = sensors["q"]
    noise = deviation * np.random.default_rng(3).standard_normal(len(own.values))
    quiet = np.nanmean(flown(sensors).blocks.rough, axis=0)
    loud = np.nanmean(flown({**sensors, "q": Samples(own.time_s, own.values + noise)}).blocks.rough, axis=0)
    assert loud[1] - quiet[1] == pytest.approx(6.0 * deviation**2, rel=0.06)


def test_what_is_driven_is_passed_on():
    sensors = sensors_of()
    assert flight_of(sensors, is_driven=True, is_assumed=True).is_assumed
    assert flight_of(sensors, is_driven=True).is_driven
    assert not flight_of(sensors, is_driven=False).is_driven


@pytest.mark.parametrize("size", [0.01, 1.0, 100.0])
def test_a_lag_is_told_whatever_the_size_of_turns(size):
    time_s = np.arange(0.0, 60.0, 0.05)
    level = {name: Samples(time_s, 0.0 * time_s) for name in (*GYROS, *ATTITUDE)}
    rolls = Samples(time_s, size * np.cos(time_s)), Samples(time_s + 0.12, size * np.sin(time_s))
    assert attitude_lag_s({**level, "p": rolls[0], "phi": rolls[1]}) == pytest.approx(0.12, abs=0.01)


def test_blocks_behind_the_last_sample_have_no_moments():
    mean, deviation = subject._moments(Samples(np.arange(5.0), np.arange(5.0)), np.array([-0.5, 4.5, 9.0, 12.0]))
    np.testing.assert_array_equal([mean, deviation], [[2.0, np.nan, np.nan], [np.sqrt(2.0), np.nan, np.nan]])


def test_beside_a_gap_of_a_gyro_nothing_is_told_up_to_the_angles_stamps_about_it():
    """What it turned meanwhile nobody knows, and an angle's step over the gap's edge is made of that."""
    fast_s, slow_s = np.arange(0.0, 60.0, 0.01), np.arange(0.0, 60.0, 0.5)
    rates = 9.0 * np.sin(fast_s)
    there = (fast_s < 20.2) | (fast_s > 23.3)
    gyro = Samples(fast_s[there], np.where(fast_s < 20.2, rates, 50.0 + rates)[there])
    edges = np.arange(0.1, 59.0, 0.25)
    found = means_between(gyro, edges, slow_s)
    unknown = edges[:-1][np.isnan(found)]
    assert (unknown[0], unknown[-1]) == (pytest.approx(19.85), pytest.approx(23.35))
    assert np.isnan(found).sum() == len(unknown) == 15

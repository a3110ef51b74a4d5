"""Parts of the engine that stand alone, each against what it is by definition: flights, stillness, odds, IMUs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t as student

from gtmbench.engine.explanation import Explanation
from gtmbench.engine.explanations import installation
from gtmbench.engine.finding import FROZEN
from gtmbench.engine.flight import LIVELY_S
from gtmbench.engine.frozen import _spread, frozen_sensors
from gtmbench.engine.imus.agreement import agree, apart, change, factors, late, means_part
from gtmbench.engine.imus.imu import FlightImu
from gtmbench.engine.imus.mounting import Mounting, mounting_of
from gtmbench.engine.judged import parting
from gtmbench.engine.relation import Effect
from gtmbench.engine.relations import gravity
from gtmbench.engine.sides import _log_odds
from tests.engine.engine_flights import felt_at_rest, flight_from
from tests.helpers.turning import from_on, motion, with_error

FLIGHT = flight_from(motion(noise=0.0), is_driven=False, has_forces=False)
ROWS, STEP_S = len(FLIGHT), FLIGHT.blocks.period_s
BEHIND = FLIGHT.time_s > 60.0


def imu(gyros, mounting=None):
    rest = np.zeros((ROWS, 3))
    return FlightImu(name="IMU2", gyros=gyros, rough=rest, held_s=rest, mounting=mounting or Mounting())


def noise(size, seed=1):
    return size * np.random.default_rng(seed).standard_normal((ROWS, 3))


# flights ---------------------------------------------------------------------------------------------------------


def test_gyros_and_attitude_of_one_motion_turn_alike_and_a_level_force_leans_nowhere():
    """Euler's equations: what the gyros say of the angles' rates is how these turn."""
    np.testing.assert_allclose(FLIGHT.turning, FLIGHT.blocks.euler_rates, atol=0.3)
    leans = replace(FLIGHT, forces=felt_at_rest(FLIGHT.angles)).lean
    assert np.nanmax(np.abs(leans[20:])) < 1e-9 + np.nanmax(np.abs(np.diff(FLIGHT.angles, axis=0)))


@pytest.mark.parametrize("axis", [0, 1])
def test_an_attitude_leans_about_the_axis_and_by_the_angle_by_which_the_force_is_turned(axis):
    level = replace(FLIGHT, blocks=replace(FLIGHT.blocks, angles=np.zeros((ROWS, 3)), euler_rates=np.zeros((ROWS, 3))))
    turned = np.zeros((ROWS, 3))
    turned[:, axis] = 5.0
    found = replace(level, forces=felt_at_rest(turned)).lean[-1]
    expected = [0.0, 0.0]
    expected[axis] = -5.0
    assert found == pytest.approx(expected, abs=0.05)


def test_how_lively_a_flight_is_is_the_root_mean_square_of_its_latest_rates():
    rates = FLIGHT.blocks.rates
    count = round(LIVELY_S / STEP_S)
    expected = np.sqrt(np.square(rates[-count:]).sum(axis=1).mean())
    assert FLIGHT.lively[-1] - expected == pytest.approx(0.5, abs=1e-9)
    np.testing.assert_allclose(FLIGHT.spread, FLIGHT.gyros.std(axis=0))


@pytest.mark.parametrize("axis", [0, 1])
def test_an_angle_that_is_off_changes_the_columns_of_gravity_as_is_said_of_it(axis):
    def flown(*lean_deg):
        angles = np.zeros((ROWS, 3))
        angles[:, axis] = sum(lean_deg)
        blocks = replace(FLIGHT.blocks, angles=angles, euler_rates=np.zeros((ROWS, 3)))
        return replace(FLIGHT, blocks=blocks, forces=felt_at_rest(np.zeros((ROWS, 3))))

    level = flown()
    changed = gravity.relation(flown(1.0)).regressors - gravity.relation(level).regressors
    effect = Effect(turned=level.angle_axes[:, :, axis])
    np.testing.assert_allclose(gravity.shift(level, effect), changed, atol=1e-12)
    assert np.nanmedian(gravity.relation(flown(1.0)).values[:, axis]) == pytest.approx(1.0, abs=0.01)
    assert gravity.response(level, effect)[:, axis] == pytest.approx(1.0)


# gyros that stand still ------------------------------------------------------------------------------------------


def stuck(gyro, first_s, last_s, record=None):
    record = motion() if record is None else record
    inside = (record.time_s >= first_s) & (record.time_s < last_s)
    return record.replace(gyro, np.where(inside, 7.0, record[gyro]))


@pytest.mark.parametrize(("lasts_s", "is_told"), [(0.9, False), (1.5, True), (20.0, True)])
def test_a_gyro_is_still_that_reads_one_value_for_more_than_a_second_in_motion(lasts_s, is_told):
    found = frozen_sensors(flight_from(stuck("q", 50.0, 50.0 + lasts_s), is_driven=False))
    assert bool(found) == is_told
    for each in found:
        assert (each.best.suspect, each.best.kind, each.size, each.lasts) == ("q", FROZEN, 7.0, False)
        assert (each.onset_s, each.end_s) == pytest.approx((50.0, 50.0 + lasts_s), abs=0.21)
        assert each.onset_range_s == pytest.approx((each.onset_s - STEP_S, each.onset_s + STEP_S))


@pytest.mark.parametrize(("behind", "spans_s"), [(7.0, [(50.0, 90.0)]), (7.1, [])])
def test_a_gyro_that_is_still_before_a_gap_and_behind_it_was_all_the_time(behind, spans_s):
    """Unless it reads another value behind: then it moved, as it usually stands."""
    record = stuck("q", 50.0, 90.0)
    read = np.where((record.time_s >= 75.0) & (record.time_s < 90.0), behind, record["q"])
    record = record.replace("q", np.where((record.time_s >= 70.0) & (record.time_s < 75.0), np.nan, read))
    found = frozen_sensors(flight_from(record, is_driven=False))
    assert [(each.onset_s, each.end_s) for each in found] == [pytest.approx(span, abs=0.21) for span in spans_s]


def test_what_is_usual_for_it_or_for_another_gyro_or_lasts_to_the_end_is_told_apart():
    twice = stuck("q", 20.0, 26.0, stuck("q", 50.0, 57.0))
    assert frozen_sensors(flight_from(twice, is_driven=False)) == ()
    other = stuck("p", 20.0, 26.0, stuck("q", 50.0, 57.0))
    assert {each.best.suspect for each in frozen_sensors(flight_from(other, is_driven=False))} == set()
    (last,) = frozen_sensors(flight_from(stuck("r", 50.0, 200.0), is_driven=False))
    assert (last.best.suspect, last.lasts) == ("r", True)


@pytest.mark.parametrize("count", [1, 6, 11, 40])
def test_how_far_rates_spread_is_told_over_five_blocks_to_either_side(count):
    rates = np.random.default_rng(1).standard_normal((count, 3))
    middle = [min(max(row, 5), max(count - 6, 5)) for row in range(count)]
    expected = [rates[max(at - 5, 0) : at + 6].std(axis=0) for at in middle]
    np.testing.assert_allclose(_spread(rates), expected)


@pytest.mark.parametrize(("least_deg_s", "far_deg_s"), [(0.0, 2.0), (1.0, 2.0), (3.0, 3.0)])
def test_gyros_part_by_two_degrees_a_second_and_by_more_beside_a_larger_error(least_deg_s, far_deg_s):
    sizes = (0.95 * far_deg_s, 1.05 * far_deg_s, -1.05 * far_deg_s)
    changes = [SimpleNamespace(of="error", axis=axis, size=size) for axis, size in enumerate(sizes)]
    assert parting(changes, least_deg_s) == ["q", "r"]
    assert parting([SimpleNamespace(of="factor", axis=0, size=99.0)], least_deg_s) == []


# what is healthy and looks like a fault --------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "of"), [("iron north", np.sin), ("iron east", np.cos)])
def test_iron_bends_a_heading_by_its_sine_or_cosine_as_slowly_as_a_compass_corrects_it(name, of):
    """About the vertical alone, at rest in the first heading: e' = (wrong - e) / tau."""
    (iron,) = [each for each in installation.explanations(FLIGHT) if each.kind == name]
    wrong, share = of(np.radians(FLIGHT.angles[:, 2])), STEP_S / 5.0
    off = [wrong[0]]
    for each in wrong[1:]:
        off.append(off[-1] + share * (each - off[-1]))
    turning = iron.effect(FLIGHT).turning
    np.testing.assert_allclose(turning[:, 2], np.gradient(off, STEP_S), atol=1e-9)
    np.testing.assert_allclose(turning[:, :2], 0.0, atol=1e-9)


def test_an_explanation_of_which_nothing_is_said_costs_nothing_and_is_of_any_size_and_length():
    said = Explanation(suspect="q", kind="own", effect=lambda _: Effect())
    assert (said.name, said.price, said.least, said.shortest_s) == ("q own", 0.0, 0.0, 0.0)
    assert (said.low, said.high, said.reach) == (-np.inf, np.inf, np.inf)
    assert (said.is_healthy, said.is_gain, said.lasts) == (False, False, True)
    assert np.isnan(said.mirror)


# which side is broken --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("value", [0.05, 0.4, -3.0])
@pytest.mark.parametrize("variance", [0.01, 0.5])
def test_odds_of_a_constant_are_students_of_three_degrees(value, variance):
    law = student(df=3.0)
    expected = law.logpdf(value / np.sqrt(variance)) - law.logpdf(0.0)
    assert _log_odds(value, variance) == pytest.approx(expected)


# further IMUs ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("late_s", [0.0, 0.03, -0.05])
def test_how_late_an_imu_reads_is_found_whatever_its_gains_and_offsets(late_s):
    slopes = np.gradient(FLIGHT.gyros, STEP_S, axis=0, edge_order=2)
    others = 1.02 * (FLIGHT.gyros - late_s * slopes) + [0.5, -1.0, 2.0]
    assert late(FLIGHT, imu(others)) == pytest.approx(late_s, abs=0.004)


def test_of_two_few_blocks_or_of_gyros_that_rest_any_factor_may_be():
    turns = np.sin(np.arange(400.0))
    every, few = np.ones(400, dtype=bool), np.arange(400) < 19
    assert factors(turns, turns, few) == factors(turns, 0.0 * turns, every) == (-np.inf, np.inf)
    assert factors(turns, turns, np.arange(400) < 20) == pytest.approx((1.0, 1.0))
    assert factors(-2.0 * turns, turns, every) == pytest.approx((-2.0, -2.0))


def test_a_factor_that_changes_is_told_by_at_least_and_at_most_how_much():
    others = FLIGHT.gyros * np.where(BEHIND, 1.5, 1.0)[:, np.newaxis]
    assert change(FLIGHT, imu(others), 0, BEHIND) == pytest.approx((0.5, 0.5))
    least, most = change(FLIGHT, imu(others + noise(2.0)), 0, BEHIND)
    assert least < 0.5 < most


def test_how_far_imus_are_apart_is_their_deviation_from_the_usual_difference():
    others = FLIGHT.gyros + 4.0 + noise(0.3)
    assert apart(replace(FLIGHT, imus=(imu(others), imu(others + noise(0.4, 2)))), 1, BEHIND) == pytest.approx(
        [0.3, 0.5], rel=0.1
    )


@pytest.mark.parametrize(("grows", "do_part"), [(1.6, False), (2.6, True)])
def test_means_part_where_they_spread_more_than_twice_as_far(grows, do_part):
    others = FLIGHT.gyros + noise(0.3) * np.where(BEHIND, grows, 1.0)[:, np.newaxis]
    assert means_part(FLIGHT, imu(others), 2, BEHIND) == do_part


@pytest.mark.parametrize(("differ", "do_agree"), [(0.2, True), (0.3, False)])
def test_imus_agree_that_are_apart_by_less_than_a_quarter_of_what_gyro_and_attitude_are(differ, do_agree):
    """The attitude turns by a sine more than the gyro since 60 s; the other IMU, by a part of it."""
    wave = np.sin(np.arange(ROWS))[:, np.newaxis] * BEHIND[:, np.newaxis] * np.ones(3)
    broken = replace(FLIGHT.blocks, rates=FLIGHT.blocks.gyros + noise(0.1) + 3.0 * wave)
    flight = replace(FLIGHT, blocks=broken, imus=(imu(FLIGHT.gyros + 3.0 * differ * wave),))
    assert agree(flight, 0, (60.0, 120.0)) == do_agree
    assert not agree(replace(flight, imus=()), 0, (60.0, 120.0))
    calm = replace(FLIGHT.blocks, rates=FLIGHT.blocks.gyros + noise(1.0))  # as far apart as it was before
    assert not agree(replace(flight, blocks=calm, imus=(imu(FLIGHT.gyros),)), 0, (60.0, 120.0))


@pytest.mark.parametrize(("degrees", "is_turned"), [(8.0, False), (12.0, True), (135.0, True)])
def test_an_imu_that_is_turned_by_more_than_ten_degrees_is_mounted_so(degrees, is_turned):
    cosine, sine = np.cos(np.radians(degrees)), np.sin(np.radians(degrees))
    turn = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    known = 10.0 * np.random.default_rng(1).standard_normal((1500, 3))
    found = mounting_of(known @ turn, known)
    assert bool(found.turned_deg) == is_turned
    if is_turned:
        assert found.turned_deg == pytest.approx(degrees, abs=0.1)
        np.testing.assert_allclose(found.matrix, turn, atol=1e-3)
        assert found.is_along_axes == (degrees == 8.0)


def test_too_few_stretches_or_other_motion_tell_no_mounting_and_a_fault_of_a_third_turns_none():
    random = np.random.default_rng(1)
    known = 10.0 * random.standard_normal((1500, 3))
    quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert mounting_of((known @ quarter)[:249], known[:249]).turned_deg == 0.0
    assert mounting_of((known @ quarter)[:250], known[:250]).turned_deg == pytest.approx(90.0)
    assert mounting_of(10.0 * random.standard_normal((1500, 3)), known).turned_deg == 0.0
    broken = known @ quarter
    broken[1000:, 0] *= -1.0
    assert mounting_of(broken, known).turned_deg == pytest.approx(90.0, abs=0.5)


def test_nothing_of_a_flight_changes_where_nothing_is_left_out():
    late_on = with_error(motion(), "q", from_on(60.0, 3.0))
    flight = flight_from(late_on, is_driven=False)
    assert flight.without([(500.0, 600.0)]) is flight
    left = flight.without([(20.0, 30.0)])
    out_s = flight.blocks.time_s[~left.judged]
    assert (out_s[0], out_s[-1]) == pytest.approx((20.0, 30.0), abs=2.0 * STEP_S)
    assert np.diff(out_s) == pytest.approx(STEP_S)

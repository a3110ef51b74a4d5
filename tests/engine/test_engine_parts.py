"""Parts of the engine that stand alone, each against what it is by definition: flights, stillness, odds, IMUs."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import t as student

from gtmbench.detectors.alarm import Judgement
from gtmbench.engine.equation import _wander
from gtmbench.engine.explanation import Explanation, name_of
from gtmbench.engine.explanations import installation
from gtmbench.engine.explanations.registry import explanations_of
from gtmbench.engine.finding import FROZEN, Finding, Side
from gtmbench.engine.flight import LIVELY_S, Flight
from gtmbench.engine.frozen import _joined, _of_three, _spread, frozen_sensors
from gtmbench.engine.imus import between
from gtmbench.engine.imus import roughness as roughness_of_imus
from gtmbench.engine.imus.agreement import apart, change, factors, late, means_part
from gtmbench.engine.imus.explanations import _as_watched
from gtmbench.engine.imus.explanations import explanations as of_imus
from gtmbench.engine.imus.imu import FlightImu, Mounting, mounting_of
from gtmbench.engine.judged import _as_logged, _logged, _named, parting
from gtmbench.engine.model import Edge, _left_out
from gtmbench.engine.relation import Effect, on_axis
from gtmbench.engine.relations import attitude, gravity
from gtmbench.engine.relations.attitude import over_second
from gtmbench.engine.relations.roughness import in_motion
from gtmbench.engine.sides import _log_odds, constants_of_gyro, side_of
from gtmbench.values.channels import GYROS
from gtmbench.verdict.timeline import SensorSpan, State
from tests.engine.conftest import model_of
from tests.engine.engine_flights import felt_at_rest, flight_from
from tests.helpers.turning import body_rates, from_on, motion, with_error

FLIGHT = flight_from(motion(noise=0.0), is_driven=False, has_forces=False)
ROWS, STEP_S = len(FLIGHT), FLIGHT.blocks.period_s
BEHIND = FLIGHT.time_s > 60.0


def imu(gyros, mounting=None):
    rest = np.zeros((ROWS, 3))
    return FlightImu(name="IMU2", gyros=gyros, rough=rest, held_s=rest, mounting=mounting or Mounting())


def noise(size, seed=1):
    return size * np.random.default_rng(seed).standard_normal((ROWS, 3))


# flights ---------------------------------------------------------------------------------------------------------


def test_what_gyros_say_of_the_angles_rates_is_how_these_turn_and_a_level_force_leans_nowhere():
    random = np.random.default_rng(1)
    angles, slopes = random.uniform(-70.0, 70.0, (2, ROWS, 3))
    read = body_rates(angles, slopes)
    blocks = replace(FLIGHT.blocks, angles=angles, euler_rates=np.zeros((ROWS, 3)), gyros=read)
    np.testing.assert_allclose(replace(FLIGHT, blocks=blocks).turning, slopes)
    steep = replace(blocks, angles=np.tile([0.0, 89.0, 0.0], (ROWS, 1)))
    assert replace(FLIGHT, blocks=steep).turning[:, 2] == pytest.approx(read[:, 2] / np.cos(np.radians(80.0)))
    leans = replace(FLIGHT, forces=felt_at_rest(FLIGHT.angles)).lean
    assert np.nanmax(np.abs(leans[20:])) < 1e-9 + np.nanmax(np.abs(np.diff(FLIGHT.angles, axis=0)))


def test_forces_far_from_one_g_tell_no_lean_and_five_blocks_are_averaged():
    level = replace(FLIGHT.blocks, angles=np.zeros((ROWS, 3)), euler_rates=np.zeros((ROWS, 3)))
    for size, tells in ((1.29, True), (1.31, False), (0.71, True), (0.69, False)):
        forces = np.tile([0.0, 0.0, size], (ROWS, 1))
        assert np.isfinite(replace(FLIGHT, blocks=level, forces=forces).lean[4:]).all() == tells
    forces = np.tile([0.0, 0.0, 1.0], (ROWS, 1))
    forces[100] = [0.1, 0.0, 0.99]
    leans = np.flatnonzero(np.abs(replace(FLIGHT, blocks=level, forces=forces).lean[:, 1]) > 1e-6)
    assert leans.tolist() == [100, 101, 102, 103, 104]
    assert np.isnan(replace(FLIGHT, forces=None).lean).all()


def standing(first, last, *, shakes=0.019, turns_deg_s=0.99):
    """Return a flight that stands in some blocks by what it shakes and turns there."""
    still = (np.arange(ROWS) >= first) & (np.arange(ROWS) < last)
    rates = np.where(still[:, np.newaxis], [turns_deg_s, 0.0, 0.0], 5.0)
    return replace(FLIGHT, blocks=replace(FLIGHT.blocks, rates=rates), shaking=np.where(still, shakes, 0.5))


def test_an_aircraft_stands_that_has_not_moved_for_three_seconds_and_flies_ten_seconds_beside():
    stands = np.flatnonzero(standing(100, 200).stands)
    assert (stands[0], stands[-1], len(stands)) == (114, 199, 86)
    for said in ({"shakes": 0.021}, {"turns_deg_s": 1.01}):
        assert not standing(100, 200, **said).stands.any()
    assert not FLIGHT.stands.any()
    began, ended, amid = standing(0, 100), standing(500, ROWS), standing(100, 200)
    assert began.flown_s == pytest.approx((began.blocks.start_s + 30.0, began.blocks.end_s), abs=0.3)
    assert ended.flown_s == pytest.approx((0.0, 102.8 - 10.0), abs=0.3)
    assert amid.flown_s == pytest.approx((0.0, amid.blocks.end_s), abs=0.3)
    assert standing(0, ROWS).flown_s == (0.0, 0.0)


def test_a_block_is_judged_in_which_a_gyro_and_all_of_the_attitude_are_there():
    for sensors, is_judged in ((["gyros"] * 2, True), (["gyros"] * 3, False), (["rates"], False)):
        missing = {name: getattr(FLIGHT.blocks, name).copy() for name in sensors}
        for axis, name in enumerate(sensors):
            missing[name][7, axis] = np.nan
        judged = replace(FLIGHT, blocks=replace(FLIGHT.blocks, **missing)).judged
        assert (judged[7], judged[8]) == (is_judged, True)


def test_gyros_that_read_one_value_each_for_three_seconds_repeat_themselves():
    held_s = np.zeros((ROWS, 6))
    held_s[50:70, :3] = 0.2 * np.arange(1, 21)[:, np.newaxis]
    held_s[300:340, 0] = 9.0  # one alone
    found = replace(FLIGHT, blocks=replace(FLIGHT.blocks, held_s=held_s)).repeats
    assert {round(start_s, 6) for start_s, _ in found} == {10.0}
    assert [round(end_s, 6) for _, end_s in found] == pytest.approx([13.2, 13.4, 13.6, 13.8, 14.0])


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
    np.testing.assert_allclose(FLIGHT.time_s, STEP_S * np.arange(0.5, ROWS))  # amid each block


def test_references_pull_at_p_by_the_bank_at_q_by_the_pitch_and_at_r_by_nothing():
    pulls = attitude.relation(FLIGHT).regressors[:, :, 5]
    np.testing.assert_array_equal(pulls, FLIGHT.angles * [1.0, 1.0, 0.0])


@pytest.mark.parametrize(("period_s", "fewest"), [(0.2, 3), (0.25, 2), (1.0, 1)])
def test_a_second_is_told_by_half_of_it(period_s, fewest):
    told = SimpleNamespace(blocks=SimpleNamespace(period_s=period_s))
    values = np.full((9, 1), np.nan)
    values[-fewest:] = 4.0
    found = over_second(told, values)[:, 0]
    assert found[-1] == 4.0
    assert np.isnan(found[:-1]).all()


def test_it_is_in_motion_where_it_is_a_fifth_as_lively_as_in_its_liveliest_tenth():
    lively = np.random.default_rng(1).permutation(np.arange(1001.0))
    told = SimpleNamespace(judged=lively != 500.0, lively=lively)
    assert sorted(lively[in_motion(told)]) == [each for each in range(181, 1001) if each != 500]


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
        assert each.shows_s == each.onset_s + 1.0


@pytest.mark.parametrize(("behind", "spans_s"), [(7.0, [(50.0, 90.0)]), (7.1, [])])
def test_a_gyro_that_is_still_before_a_gap_and_behind_it_was_all_the_time(behind, spans_s):
    """Unless it reads another value behind: then it moved, as it usually stands."""
    record = stuck("q", 50.0, 90.0)
    read = np.where((record.time_s >= 75.0) & (record.time_s < 90.0), behind, record["q"])
    record = record.replace("q", np.where((record.time_s >= 70.0) & (record.time_s < 75.0), np.nan, read))
    found = frozen_sensors(flight_from(record, is_driven=False))
    assert [(each.onset_s, each.end_s) for each in found] == [pytest.approx(span, abs=0.21) for span in spans_s]


def test_what_is_usual_for_it_and_two_that_stand_one_after_another_are_told_apart():
    twice = stuck("q", 20.0, 26.0, stuck("q", 50.0, 57.0))
    assert frozen_sensors(flight_from(twice, is_driven=False)) == ()
    other = stuck("p", 20.0, 26.0, stuck("q", 50.0, 57.0))
    assert {each.best.suspect for each in frozen_sensors(flight_from(other, is_driven=False))} == {"p", "q"}
    for first_s, last_s, is_told in ((0.2, 200.0, False), (0.4, 200.0, True), (0.0, 120.0, False), (0.0, 119.8, True)):
        found = frozen_sensors(flight_from(stuck("q", first_s, last_s), is_driven=False))
        assert bool(found) == is_told  # what never moved was never a sensor's
    slow = motion(rate_hz=2.0)
    assert len(frozen_sensors(flight_from(stuck("q", 50.0, 52.1, slow), is_driven=False))) == 1
    assert frozen_sensors(flight_from(stuck("q", 50.0, 51.1, slow), is_driven=False)) == ()
    (last,) = frozen_sensors(flight_from(stuck("r", 50.0, 200.0), is_driven=False))
    assert (last.best.suspect, last.lasts) == ("r", True)


@pytest.mark.parametrize(("share", "is_told"), [(0.28, False), (0.32, True)])
def test_a_gyro_is_still_while_another_half_degree_a_second_comes_and_goes_in_a_third_of_the_time(share, is_told):
    spread = np.zeros((ROWS, 3))
    spread[100 : 100 + round(50 * share), 1] = 0.51
    spread[300:350] = 0.49
    for first, told in ((100, is_told), (300, False)):
        found = _of_three(FLIGHT, GYROS, FLIGHT.blocks.gyros, [[], [(first, first + 50)], []], spread)
        assert bool(found) == told
    assert not _of_three(FLIGHT, GYROS, FLIGHT.blocks.gyros, [[(100, 150)]] * 3, spread + 1.0)


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


@pytest.mark.parametrize(("times", "is_told"), [((1.0, 1.0, 0.52), True), ((1.0, 0.6, 0.48), False)])
def test_two_imus_read_one_motion_whose_weakest_axis_turns_half_as_far_as_the_strongest(times, is_told):
    known = 10.0 * np.random.default_rng(1).standard_normal((1500, 3))
    assert mounting_of((known / times)[:, [1, 0, 2]] * [1.0, -1.0, 1.0], known).turned_deg == (
        pytest.approx(90.0) if is_told else 0.0
    )


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
    for first, is_reflected in ((1000, False), (400, False), (300, False), (100, True)):  # nine of ten stretches
        broken = known @ quarter
        broken[first:, 0] *= -1.0
        found = mounting_of(broken, known)
        assert found.is_reflected == is_reflected
        assert found.turned_deg == (0.0 if is_reflected else pytest.approx(90.0, abs=0.5))
        assert found.is_along_axes != is_reflected
    missing = (np.arange(1500) % 7 == 0)[:, np.newaxis] & (np.arange(3) == 1)
    assert mounting_of(np.where(missing, np.nan, known @ quarter), known).turned_deg == pytest.approx(90.0)
    assert mounting_of(known @ quarter, np.where(missing, np.nan, known)).turned_deg == pytest.approx(90.0)
    calm = known * np.where(np.arange(1500) < 1300, 0.05, 1.0)[:, np.newaxis]
    assert mounting_of(calm @ quarter, calm).turned_deg == 0.0  # four stretches in which it turns


def test_nothing_of_a_flight_changes_where_nothing_is_left_out():
    late_on = with_error(motion(), "q", from_on(60.0, 3.0))
    flight = flight_from(late_on, is_driven=False)
    assert flight.without([(500.0, 600.0)]) is flight
    left = flight.without([(20.0, 30.0)])
    out_s = flight.blocks.time_s[~left.judged]
    assert (out_s[0], out_s[-1]) == pytest.approx((20.0, 30.0), abs=2.0 * STEP_S)
    assert np.diff(out_s) == pytest.approx(STEP_S)


def test_what_imus_differ_by_is_a_further_gyros_error_less_that_of_the_watched_one():
    two = replace(FLIGHT, imus=(imu(FLIGHT.gyros + np.array([0.0, 2.0, 0.0])),))
    (own,), (rough,) = between.relations(two), roughness_of_imus.relations(two)
    assert own.values[:, 1] == pytest.approx(2.0)
    ones, on_q = np.ones(ROWS), on_axis(np.ones(ROWS), 1)
    for relation, of_watched, channel in (
        (own, Effect(gyros=on_q), "q of IMU2"),
        (own, Effect(gains=on_q), "q of IMU2"),
        (rough, Effect(rough=on_q), "roughness of q of IMU2"),
    ):
        np.testing.assert_array_equal(relation.response(two, of_watched), -on_q)
        both = replace(of_watched, channels={channel: 3.0 * ones, "tas": ones})
        np.testing.assert_array_equal(relation.response(two, both), 2.0 * on_q)
        np.testing.assert_array_equal(relation.response(two, Effect(channels={channel: ones})), on_q)
        assert relation.response(two, Effect(turning=on_q)) is None
    assert between.relations(FLIGHT) == []
    slopes = np.gradient(FLIGHT.gyros, STEP_S, axis=0)
    columns = np.column_stack([ones, FLIGHT.gyros, slopes[:, 2]])
    np.testing.assert_array_equal(own.regressors[:, 2], columns)


def test_a_further_gyro_is_off_by_what_a_watched_one_would_be():
    two = replace(FLIGHT, imus=(imu(FLIGHT.gyros),))
    watched = {each.name: each for each in explanations_of(FLIGHT)}
    found = [each for each in of_imus(two) if each.kind != "noise"]
    for each in found:
        gyro = each.suspect.removesuffix(" of IMU2")
        own = watched[name_of(gyro, each.kind, each.fades_s)].effect(FLIGHT)
        wrong = own.gains if own.gyros is None else own.gyros
        told = each.effect(two).channels
        assert [*told] == ["p of IMU2", "q of IMU2", "r of IMU2"]
        np.testing.assert_allclose(told[each.suspect], wrong[:, GYROS.index(gyro)], atol=1e-6)
    assert {each.kind for each in found} >= {"bias", "drift", "scale"}


def test_a_further_gyro_reads_what_it_usually_shares_with_the_watched_one():
    """Of turns its factor, of its own noise nothing, and its mean over ten seconds."""
    random = np.random.default_rng(1)
    own = 3.0 + 1.5 * FLIGHT.gyros + 0.5 * random.standard_normal((ROWS, 3))
    read = _as_watched(imu(own), FLIGHT).gyros
    assert np.sqrt(np.mean((read - 3.0 - 1.5 * FLIGHT.gyros) ** 2)) < 0.15
    still = replace(FLIGHT, blocks=replace(FLIGHT.blocks, gyros=0.01 * random.standard_normal((ROWS, 3))))
    assert np.abs(_as_watched(imu(own - 1.5 * FLIGHT.gyros), still).gyros - 3.0).max() < 1.0


def test_a_turned_imu_is_judged_by_the_names_of_its_log():
    mounting = Mounting(matrix=np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]]), turned_deg=90.0)
    turned = imu(FLIGHT.gyros, mounting)
    assert turned.columns == ("q of IMU2", "p of IMU2", "r of IMU2")
    assert (mounting.signs, mounting.text) == ([-1.0, 1.0, 1.0], "-q, p, r")
    flight = replace(FLIGHT, imus=(turned,))
    found = replace(
        Judgement(time_s=1.0, sensor="p", imu="IMU2", candidates=("p of IMU2",)),
        parameters={"size": 2.0, "onset_s": 5.0},
        intervals={"size": (1.0, 3.0), "onset_s": (4.0, 6.0)},
    )
    told = _named(found, dict(_logged(flight)))
    assert (told.sensor, told.candidates) == ("q", ("q of IMU2",))
    assert told.parameters == {"size": -2.0, "onset_s": 5.0}
    assert told.intervals == {"size": (-3.0, -1.0), "onset_s": (4.0, 6.0)}
    both = replace(found, sensor=None, candidates=("p of IMU2", "q of IMU2"))
    assert _named(both, dict(_logged(flight))).reason == "q of IMU2 or p of IMU2 explains it"
    assert _named(both, dict(_logged(flight))).parameters["size"] == 2.0
    other = replace(found, candidates=("p",))
    assert _named(other, dict(_logged(flight))) is other
    assert dict(_logged(replace(flight, imus=(imu(FLIGHT.gyros),)))) == {}
    span = SensorSpan(start_s=1.0, end_s=2.0, state=State.SUSPECTED, suspects=("p of IMU2", "phi"), judgement=found)
    sensor, claimed = _as_logged(("p of IMU2", span), dict(_logged(flight)))
    assert (sensor, claimed.suspects, claimed.judgement) == ("q of IMU2", ("q of IMU2", "phi"), told)
    assert _as_logged(("phi", replace(span, judgement=None)), dict(_logged(flight)))[0] == "phi"


# what is left out, and what is told of a gap ------------------------------------------------------------------------


def test_gravity_tells_where_half_of_what_is_judged_is_near_one_g():
    forces = felt_at_rest(FLIGHT.angles)
    with_gap = replace(FLIGHT, forces=forces).without([(20.0, 30.0)])
    assert gravity.relation(with_gap) is not None
    for share, is_told in ((0.45, True), (0.55, False)):
        missing = np.arange(ROWS)[:, np.newaxis] < share * ROWS
        assert (gravity.relation(replace(FLIGHT, forces=np.where(missing, np.nan, forces))) is not None) == is_told


@pytest.mark.parametrize(
    ("frozen", "edges", "is_left_out"),
    [
        ([("q", 3, 5)], [], True),  # its own channel
        ([("r", 3, 5)], [], True),  # it enters
        ([("p", 3, 5)], [], False),
        ([("theta", 3, 5)], [], True),  # an attitude turns every relation but those between IMUs
        ([], [Edge("att", -1, 3, 5)], True),
        ([], [Edge("att", 1, 3, 5)], True),
        ([], [Edge("att", 0, 3, 5)], False),  # about another axis
        ([], [Edge("between IMUs", -1, 3, 5)], False),
    ],
)
def test_no_equation_is_asked_while_a_sensor_stands_still_that_enters_it(frozen, edges, is_left_out):
    relation = SimpleNamespace(name="attitude", channels=("p", "q"), enters=("r",))
    found = _left_out(FLIGHT, relation, 1, frozen, edges)
    assert np.flatnonzero(found).tolist() == ([3, 4] if is_left_out else [])
    assert _left_out(FLIGHT, relation, 1, [], []) is None
    between = SimpleNamespace(name="between IMUs: IMU2", channels=("q of IMU2",), enters=())
    assert not _left_out(FLIGHT, between, 0, [("theta", 3, 5)], []).any()


def test_chunks_of_which_less_than_a_quarter_is_known_tell_no_wander():
    """Five of twenty blocks are known in some, and none in half of them."""
    errors, mean = np.zeros((60, 20)), np.zeros((60, 20))
    mean[:16] = 1.0
    errors[:16] = np.resize([1.0, -1.0], 16)[:, np.newaxis]
    for few, tells in ((5, False), (6, True)):
        mean[16:30], errors[16:30] = 0.0, 0.0
        mean[16:30, :few] = 1.0
        errors[16:30, :few] = np.resize([30.0, -30.0], 14)[:, np.newaxis]
        told = SimpleNamespace(mean=mean.ravel(), errors=errors.ravel(), relation=SimpleNamespace(wander=0.1))
        assert (_wander(told, 20) > 3.0) == tells


# which side is broken, of a bias or a scale --------------------------------------------------------------------------


def sided(kind, size, constants, *, suspect="q", first=60, last=200):
    """Return the side that is broken, by the constants of gyros and attitude over the whole log, axis by axis."""
    products = [
        SimpleNamespace(
            equation=SimpleNamespace(relation=SimpleNamespace(name="attitude"), channel=axis, constants=np.array(each))
        )
        for axis, each in enumerate(constants)
    ]
    model = SimpleNamespace(products=products, flight=FLIGHT, cells=len(FLIGHT) // 5, cell_s=1.0)
    best = SimpleNamespace(suspect=suspect, kind=kind)
    return side_of(model, SimpleNamespace(best=best, size=size, first=first, last=last))


@pytest.mark.parametrize("offsets", [(0.5, -0.5), (0.1, -0.2)])
def test_the_side_is_broken_whose_constants_no_healthy_gyro_has(offsets):
    """By Student's law of three degrees and three nats, at odds of a hundred to one."""

    def expected(before, size, spread):
        odds = student(df=3.0).logpdf(before / spread) - student(df=3.0).logpdf((before + size) / spread) + 3.0
        return Side.AFTER if odds > 4.6 else Side.BEFORE if odds < -4.6 else Side.OPEN

    first, last = ([each, 0.0, 0.0, 0.0] for each in offsets)
    spread = np.sqrt((0.3**2 + offsets[0] ** 2 + offsets[1] ** 2) / 3.0)
    for size in np.geomspace(0.05, 5.0, 12):
        for before in (0.0, -0.5, -1.0, -2.0):
            bias = sided("bias", size, [first, [before, 0.0, 0.0, 0.0], last])
            assert bias == expected(before, size, spread)
            gain = sided("scale", 0.1 * size, [first, [9.0, 0.0, 0.1 * before, 0.0], last])
            assert gain == expected(0.1 * before, 0.1 * size, 0.05)
    assert sided("drift", -9.0, [first, [9.0, 0.0, 0.0, 0.0], last]) == Side.AFTER
    assert sided("bias", -9.0, [first]) == sided("bias", -9.0, [first] * 3, suspect="tas") == Side.AFTER


def test_a_gyros_offset_and_gain_are_its_own_and_known_the_better_the_more_it_turns():
    """It reads f w + b, which is b / f and (1 - 1 / f) of what it reads more than w."""
    record, turns = motion(seed=2, large_deg=(2.0, 6.0, 30.0)), []
    for gyro, factor, offset in zip(GYROS, (1.1, 0.9, 1.05), (0.5, -0.8, 0.3), strict=True):
        turns.append(record[gyro].std())
        record = record.replace(gyro, factor * record[gyro] + offset)
    model = model_of(record)
    told = np.array([constants_of_gyro(model, axis) for axis in range(3)])
    np.testing.assert_allclose(told[:, 0], [0.5 / 1.1, -0.8 / 0.9, 0.3 / 1.05], atol=0.1)
    np.testing.assert_allclose(told[:, 1], 1.0 - 1.0 / np.array([1.1, 0.9, 1.05]), atol=0.02)
    assert np.ptp(np.log(told[:, 3] * turns)) < 0.4


@pytest.mark.parametrize(
    ("first", "last", "side"), [(9, 60, Side.OPEN), (10, 60, Side.AFTER), (9, 109, Side.OPEN), (9, 110, Side.AFTER)]
)
def test_a_noise_that_ends_and_of_which_ten_seconds_are_known_before_is_on_no_side(first, last, side):
    healthy = [[0.0, 0.0, 0.0, 0.0]] * 3
    assert sided("noise", 2.0, healthy, first=first, last=last) == side
    assert sided("noise", 2.0, healthy, suspect="tas", first=first, last=last) == Side.AFTER


def test_a_constant_of_a_gyro_is_known_as_well_as_rows_and_belief_tell():
    relation = SimpleNamespace(prior=np.array([0.5, 0.1, 0.2, 0.4]))
    equation = SimpleNamespace(relation=relation, constants=np.array([0.1, 0.2, 0.3, 0.4]))
    squares = np.diag([9.0, 1.0, 2.0, 3.0, 4.0])
    products = SimpleNamespace(equation=equation)
    sums = SimpleNamespace(products=products, cells=9, known=lambda *_: squares[np.newaxis])
    told = constants_of_gyro(SimpleNamespace(own_axis=lambda _: sums), 1)
    assert told == pytest.approx((0.1, 0.3, (1.0 + 0.5**-2.0) ** -0.5, (3.0 + 0.2**-2.0) ** -0.5))


@pytest.mark.parametrize(("length", "is_told"), [(31, True), (30, False)])
def test_a_gyro_is_still_that_is_so_three_times_as_long_as_is_usual(length, is_told):
    held = [[(10, 20), (40, 55)], [(100, 100 + length)], []]
    assert bool(_of_three(FLIGHT, GYROS, FLIGHT.gyros, held, np.ones((ROWS, 3)))) == is_told


def test_a_gap_is_where_nothing_is_read_at_all():
    held = [(0, 5), (7, 9)]
    assert _joined(held, np.array([1.0] * 5 + [np.nan] * 2 + [1.0] * 2)) == [(0, 9)]
    assert _joined(held, np.array([1.0] * 5 + [np.nan, 2.0] + [1.0] * 2)) == held


def test_gyros_that_rest_or_share_nothing_tell_no_factor():
    one, other = np.resize([1.0, 1.0, -1.0, -1.0], 40), np.resize([1.0, -1.0], 40)
    for own, watched in ((one, 0.0 * one), (0.0 * one, one), (one, other)):
        assert factors(own, watched, np.ones(40, dtype=bool)) == (-np.inf, np.inf)


def test_roughness_of_two_imus_is_compared_beside_the_mean_of_what_shakes_both():
    two = replace(FLIGHT, imus=(replace(imu(FLIGHT.gyros), rough=np.exp(noise(1.0))),))
    (found,) = roughness_of_imus.relations(two)
    others = 0.5 * (attitude.others_rough(two) + attitude.others_rough(two.by(two.imus[0])))
    np.testing.assert_allclose(found.regressors[:, :, 1], others)


def test_a_block_longer_than_a_second_tells_one():
    told = SimpleNamespace(blocks=SimpleNamespace(period_s=2.0))
    assert over_second(told, np.arange(4.0)[:, np.newaxis])[:, 0].tolist() == [0.0, 1.0, 2.0, 3.0]


def test_that_gyros_drive_the_attitude_is_known_unless_it_is_said_to_be_assumed():
    assert not Flight(blocks=FLIGHT.blocks).is_assumed
    said = {"first": 1, "last": 9, "onset_s": 2.0, "end_s": 9.0, "onset_range_s": (1.0, 3.0), "ranked": ()}
    assert Finding(**said, size=1.0, interval=(0.9, 1.1), evidence=9.0).own_axis == 0.0  # nothing is shown but by all

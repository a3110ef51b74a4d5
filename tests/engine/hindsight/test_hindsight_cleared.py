"""Where gyros and angles are clear: no fault of the size that is stated for its onset lies in a span called clear."""

from functools import cache
from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.blocks import blocks_of
from gtmbench.engine.flight import Flight
from gtmbench.engine.hindsight.alignment import Jumps, alignment_of
from gtmbench.engine.hindsight.cleared_sensors import (
    Failure,
    LevelChange,
    _as_good,
    _of_angle,
    _shown,
    _standing,
    _turns,
    _why_masked,
    hindsight_of,
)
from gtmbench.engine.hindsight.levels import WINDOWS_S
from gtmbench.values.attitude_estimators import SLOWEST_S
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State
from tests.helpers.night import by_day
from tests.helpers.turning import (
    ANGLE_NOISE,
    GYRO_NOISE,
    SENSORS,
    angles_and_slopes,
    body_rates,
    from_on,
    motion,
    with_error,
)

ONSETS_S = (14.0, 61.3, 96.0)
END_S = 120.0


def said_of(record, *, is_driven=False, without=(), **options):
    blocks = Flight(blocks=blocks_of([record])).without(without).blocks
    return hindsight_of(blocks, is_driven=is_driven, **options)


@cache
def healthy(seed=1, *, is_driven=False, rate_hz=20.0):
    return said_of(motion(rate_hz=rate_hz, seed=seed), is_driven=is_driven)


def stated(said, sensor, time_s):
    """Return the sizes that are stated for a sensor at a time; None where it isn't clear."""
    own = [span for span in said.claims[sensor] if span.covers(time_s)]
    return own[0].sizes if own and all(span.state is State.CLEAR for span in own) else None


def is_clear(said, sensor, from_s=0.0, until_s=END_S):
    """Tell whether a sensor is clear at any time, and no claim says otherwise then."""
    times_s = np.arange(from_s + 0.05, until_s, 1.0)
    return any(stated(said, sensor, float(time_s)) is not None for time_s in times_s)


def is_told(said, sensor, onset_s, size, of="error"):
    """Tell whether a fault is nowhere from its onset on inside a span that promises that it would show."""
    sizes = [stated(said, sensor, time_s) for time_s in np.arange(onset_s + 2.0, END_S, 1.0)]
    return all(each is None or _hides(each, size, of) for each in sizes)


def _hides(sizes, size, of):
    if of == "factor":
        return sizes.factors is None or sizes.factors[0] < size < sizes.factors[1]
    least = sizes.error if of == "error" else sizes.noise
    return least is None or least > abs(size)


# health -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("is_driven", [False, True])
@pytest.mark.parametrize("seed", range(1, 4))
def test_a_healthy_log_is_clear_but_for_its_ends(seed, is_driven):
    said = healthy(seed, is_driven=is_driven)
    assert said.changes == ()
    for gyro in GYROS:
        spans = said.claims[gyro]
        assert sum(span.duration_s for span in spans if span.state is State.CLEAR) > 90.0 - 30.0 * is_driven
        assert all(span.sizes.error < 1.5 for span in spans if span.sizes)
        assert all((span.sizes.factors is None) == is_driven for span in spans if span.sizes)
    for angle in ATTITUDE:
        assert is_clear(said, angle)
        assert all(span.sizes.error < 3.0 for span in said.claims[angle] if span.sizes)


def test_no_gyro_is_promised_to_be_better_than_what_installation_explains():
    """0.3 deg/s, and a tenth of it; and an angle than an estimator's correction of 1 deg."""
    for axis, gyro in enumerate(GYROS):
        assert 0.33 <= stated(healthy(), gyro, 60.0).error < 0.4
        assert 1.1 <= stated(healthy(), ATTITUDE[axis], 60.0).error < 1.35
        assert 0.11 <= stated(healthy(), gyro, 60.0).factors[1] - 1.0 < 0.14


def test_claims_of_a_sensor_cover_the_log_whose_ends_are_not_judged():
    for spans in healthy().claims.values():
        assert (spans[0].start_s, spans[-1].end_s) == (0.0, pytest.approx(END_S))
        assert all(before.end_s == after.start_s for before, after in pairwise(spans))
    spans = healthy().claims["q"]
    assert spans[0].state is spans[-1].state is State.NOT_JUDGED
    assert 4.0 <= spans[0].end_s <= 10.0
    assert 3.0 <= spans[-1].duration_s <= 8.0


@pytest.mark.parametrize("duration_s", [2.0, 6.0])
def test_a_log_that_is_too_short_clears_no_gyro(duration_s):
    said = said_of(motion(duration_s))
    assert not any(is_clear(said, gyro, until_s=duration_s) for gyro in GYROS)


# faults of the stated size --------------------------------------------------------------------------------------------


@pytest.mark.parametrize("times", [-1.1, 1.1])
@pytest.mark.parametrize("onset_s", by_day(ONSETS_S))
@pytest.mark.parametrize("axis", by_day(range(3), 2))
def test_a_bias_of_the_stated_size_is_not_inside_a_span_that_is_clear_for_it(axis, onset_s, times):
    size = times * stated(healthy(), GYROS[axis], onset_s).error
    said = said_of(with_error(motion(), GYROS[axis], from_on(onset_s, size)))
    assert is_told(said, GYROS[axis], onset_s, size)
    assert [change.axis for change in said.changes] == [axis]
    assert np.sign(said.changes[0].size) == np.sign(times)
    assert abs(said.changes[0].time_s - onset_s) < 6.0


@pytest.mark.parametrize("onset_s", by_day(ONSETS_S))
@pytest.mark.parametrize("axis", range(3))
def test_a_factor_of_the_stated_size_is_not_inside_a_span_that_is_clear_for_it(axis, onset_s):
    name, record = GYROS[axis], motion()
    for place in (0, 1):
        factor = stated(healthy(), name, onset_s).factors[place]
        factor = 1.0 + 1.15 * (factor - 1.0)
        broken = record.replace(name, np.where(record.time_s >= onset_s, factor, 1.0) * record[name])
        said = said_of(broken)
        assert is_told(said, name, onset_s, factor, of="factor")
        assert {change.axis for change in said.changes} <= {axis}


@pytest.mark.parametrize("onset_s", by_day(ONSETS_S))
@pytest.mark.parametrize("axis", range(3))
def test_noise_of_the_stated_size_is_not_inside_a_span_that_is_clear_for_it(axis, onset_s):
    name, record = GYROS[axis], motion()
    size = 1.1 * stated(healthy(), name, onset_s).noise
    noise = from_on(onset_s, 1.0)(record.time_s) * np.random.default_rng(5).standard_normal(len(record))
    said = said_of(with_error(record, name, size * noise))
    assert is_told(said, name, onset_s, size, of="noise")
    loud = said_of(with_error(record, name, 3.0 * size * noise))
    assert (axis, "noise") in [(change.axis, change.of) for change in loud.changes]
    assert {change.axis for change in loud.changes} == {axis}


@pytest.mark.parametrize("onset_s", by_day(ONSETS_S))
@pytest.mark.parametrize("axis", range(3))
def test_a_turned_sign_and_a_gyro_that_stands_still_are_never_clear(axis, onset_s):
    name, record = GYROS[axis], motion()
    late = record.time_s >= onset_s
    turned = said_of(record.replace(name, np.where(late, -record[name], record[name])))
    assert not is_clear(turned, name)
    row = int(np.argmax(late))
    stuck = said_of(record.replace(name, np.where(late, record[name][row], record[name])))
    assert not is_clear(stuck, name, onset_s)


@pytest.mark.parametrize("onset_s", by_day(ONSETS_S))
@pytest.mark.parametrize("axis", range(3))
def test_a_drift_that_reaches_twice_the_stated_size_in_time_is_told(axis, onset_s):
    name = GYROS[axis]
    slope = 2.0 * stated(healthy(), name, onset_s).error / 10.0
    said = said_of(with_error(motion(), name, lambda time_s: slope * np.maximum(time_s - onset_s, 0.0)))
    assert not is_clear(said, name, onset_s) or onset_s > 90.0
    assert {change.axis for change in said.changes} <= {axis}


@pytest.mark.parametrize("size", [-20.0, 20.0])
@pytest.mark.parametrize("name", ["phi", "theta"])
def test_a_large_jump_of_an_angle_leaves_gyros_clear_of_whose_axis_it_says_nothing(name, size):
    """It turns the axes of what follows, and it is no sign that gyros read Euler rates."""
    said = said_of(with_error(motion(), name, from_on(50.0, size)))
    reasons = {span.reason for spans in said.claims.values() for span in spans}
    assert not any("rates of phi, theta, psi" in reason for reason in reasons)
    assert is_told(said, name, 50.0, size)


@pytest.mark.parametrize("axis", by_day(range(3)))
def test_half_of_a_stated_bias_leaves_a_gyro_clear_more_often_than_not(axis):
    cleared = []
    for seed in (1, 2):
        for onset_s in ONSETS_S:
            size = 0.5 * stated(healthy(seed), GYROS[axis], onset_s).error
            said = said_of(with_error(motion(seed=seed), GYROS[axis], from_on(onset_s, size)))
            cleared.append(is_clear(said, GYROS[axis]))
    assert np.mean(cleared) > 0.6


@pytest.mark.parametrize("times", [-1.1, 1.1])
@pytest.mark.parametrize("onset_s", by_day(ONSETS_S))
@pytest.mark.parametrize("axis", by_day(range(3), 2))
def test_a_jump_of_an_angle_of_the_stated_size_is_not_inside_a_span_that_is_clear_for_it(axis, onset_s, times):
    size = times * stated(healthy(), ATTITUDE[axis], onset_s).error
    said = said_of(with_error(motion(), ATTITUDE[axis], from_on(onset_s, size)))
    assert is_told(said, ATTITUDE[axis], onset_s, size)
    if times > 0.0:
        large = said_of(with_error(motion(), ATTITUDE[axis], from_on(onset_s, 11.0)))
        assert is_told(large, ATTITUDE[axis], onset_s, 11.0)


@pytest.mark.parametrize("onset_s", by_day(ONSETS_S))
@pytest.mark.parametrize("axis", range(3))
def test_an_angle_that_stands_still_is_not_clear(axis, onset_s):
    record = motion()
    name, late = ATTITUDE[axis], record.time_s >= onset_s
    stuck = record.replace(name, np.where(late, record[name][int(np.argmax(late))], record[name]))
    assert not is_clear(said_of(stuck), name, onset_s + 0.3)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("size", [-2.0, 8.0])
def test_a_fault_leaves_the_other_gyros_clear(axis, size):
    said = said_of(with_error(motion(), GYROS[axis], from_on(50.0, size)))
    for other in {0, 1, 2} - {axis}:
        assert stated(said, GYROS[other], 30.0).error == pytest.approx(stated(healthy(), GYROS[other], 30.0).error)
    assert not is_clear(said, GYROS[axis])
    assert not is_clear(said, ATTITUDE[axis])


def test_one_gyro_that_is_louder_leaves_its_angle_judged_and_all_that_become_louder_are_no_fault():
    record = motion()
    noise = (
        4.0 * np.random.default_rng(1).standard_normal((len(record), 3)) * from_on(60.0, 1.0)(record.time_s)[:, None]
    )
    one = said_of(with_error(record, "q", noise[:, 1]))
    assert [(change.axis, change.of) for change in one.changes] == [(1, "noise")]
    assert is_clear(one, "theta")
    assert not is_clear(one, "q")
    every = record
    for axis, name in enumerate(GYROS):
        every = with_error(every, name, noise[:, axis])
    assert "noise" not in {change.of for change in said_of(every).changes}


def test_a_gyro_that_becomes_quieter_is_no_fault():
    record = motion(noise=0.0)
    random = np.random.default_rng(1).standard_normal((3, len(record)))
    for axis, name in enumerate(GYROS):
        record = with_error(record, name, GYRO_NOISE * random[axis] * (4.0 if axis == 1 else 1.0))
    quieter = with_error(record, "q", -GYRO_NOISE * 3.0 * random[1] * from_on(60.0, 1.0)(record.time_s))
    said = said_of(quieter)
    assert 1 not in {change.axis for change in said.changes}
    assert is_clear(said, "q")


# what is constant throughout -----------------------------------------------------------------------------------------


@pytest.mark.parametrize(("size", "is_own"), [(-3.6, True), (4.6, True), (-5.4, False), (6.5, False)])
def test_an_offset_throughout_is_a_sensors_own_up_to_five_degrees_a_second(size, is_own):
    said = said_of(with_error(motion(), "r", size))
    assert [change.of for change in said.changes] == [] if is_own else ["offset"]
    assert is_clear(said, "r") == is_clear(said, "psi") == is_own
    assert is_clear(said, "p")


@pytest.mark.parametrize(("factor", "is_own"), [(0.7, False), (0.8, True), (1.25, True), (1.42, False), (-1.0, False)])
def test_a_factor_throughout_is_a_sensors_own_up_to_a_third(factor, is_own):
    record = motion()
    said = said_of(record.replace("q", factor * record["q"]))
    assert [change.of for change in said.changes] == ([] if is_own else ["scale"])
    assert is_clear(said, "q") == is_own


@pytest.mark.parametrize("of", ["rates", "gyros"])
def test_slopes_of_angles_are_no_gyros(of):
    record = motion(large_deg=(25.0, 15.0, 60.0))
    if of == "rates":
        clean = motion(noise=0.0, large_deg=(25.0, 15.0, 60.0)).matrix(ATTITUDE)
        noise = 0.1 * np.random.default_rng(1).standard_normal(clean.shape)
        for axis, name in enumerate(GYROS):
            record = record.replace(name, np.gradient(clean[:, axis], 0.05) + noise[:, axis])
    said = said_of(record)
    reasons = {span.reason for spans in said.claims.values() for span in spans}
    is_rates = any("rates of phi, theta, psi" in reason for reason in reasons)
    assert is_rates == (of == "rates")
    assert any(is_clear(said, name) for name in SENSORS) == (of == "gyros")


# metamorphic ---------------------------------------------------------------------------------------------------------


def as_rows(said, shift_s=0.0):
    return {
        sensor: [
            (round(span.start_s - shift_s, 3), round(span.end_s - shift_s, 3), span.state, _rounded(span.sizes))
            for span in spans
        ]
        for sensor, spans in said.claims.items()
    }


def _rounded(sizes):
    return None if sizes is None else (round(sizes.error, 6), sizes.factors and np.round(sizes.factors, 6).tolist())


@pytest.mark.parametrize(("name", "size"), [("q", 0.0), ("q", 2.0), ("psi", 8.0)])
def test_neither_the_clock_nor_signs_that_turn_together_matter(name, size):
    record = with_error(motion(), name, from_on(60.0, size))
    later = gb.Record(record.values, channels=SENSORS, sample_period_s=0.05, start_s=1234.5)
    turned = record
    for each in ("p", "r", "phi", "psi"):  # seen from axes turned by half about y
        turned = turned.replace(each, -record[each])
    assert as_rows(said_of(later), 1234.5) == as_rows(said_of(turned)) == as_rows(said_of(record))


@pytest.mark.parametrize("size", [0.0, 3.0])
def test_roll_and_pitch_may_be_exchanged_where_angles_are_small(size):
    """Near wings level p and phi are to each other what q and theta are."""
    time_s = np.arange(2401) * 0.05
    angles, slopes = angles_and_slopes(time_s, 4, (5.0, 5.0, 5.0))
    noise = np.random.default_rng(4).standard_normal((2401, 6)) * np.repeat([GYRO_NOISE, ANGLE_NOISE], 3)
    told = []
    for order, broken in ((np.array([0, 1, 2]), "p"), (np.array([1, 0, 2]), "q")):
        exact = np.column_stack([body_rates(angles[:, order], slopes[:, order]), angles[:, order]])
        values = exact + noise[:, [*order, *(3 + order)]]
        record = gb.Record(values, channels=SENSORS, sample_period_s=0.05)
        told.append(said_of(with_error(record, broken, from_on(60.0, size))))
    said, exchanged = told
    assert [change.axis for change in said.changes] == ([0] if size else [])
    assert [change.axis for change in exchanged.changes] == ([1] if size else [])
    for name, its in (("p", "q"), ("q", "p"), ("phi", "theta"), ("theta", "phi")):
        for time_s in (30.0, 90.0):
            one, two = stated(said, name, time_s), stated(exchanged, its, time_s)
            assert (one is None) == (two is None)
            if one is not None:
                assert one.error == pytest.approx(two.error, rel=0.1)


@pytest.mark.parametrize("rate_hz", [4.0, 10.0, 25.0, 100.0])
def test_a_rate_gives_the_same_verdict_on_the_same_motion(rate_hz):
    record = motion(rate_hz=rate_hz)
    calm = said_of(record)
    assert calm.changes == ()
    for axis, name in enumerate(GYROS):
        assert 0.75 < stated(calm, name, 60.0).error / stated(healthy(), name, 60.0).error < 2.0  # fewer samples
        assert stated(calm, name, 60.0).factors == pytest.approx(stated(healthy(), name, 60.0).factors, abs=0.1)
        assert stated(calm, ATTITUDE[axis], 60.0).error == pytest.approx(1.3, abs=0.4)
    said = said_of(with_error(record, "q", from_on(60.0, -1.0)))
    assert [(change.axis, change.of) for change in said.changes] == [(1, "error")]
    assert abs(said.changes[0].time_s - 60.0) < 3.0
    stuck = said_of(record.replace("r", np.where(record.time_s > 70.0, record["r"][-1], record["r"])))
    assert not is_clear(stuck, "r", 71.0)


# what is named or excused ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", range(3))
def test_a_failure_that_is_named_is_taken_out_and_the_gyro_is_clear_before_it(axis):
    broken = with_error(motion(), GYROS[axis], from_on(70.0, 5.0))
    failures = {GYROS[axis]: [Failure(start_s=70.0, end_s=END_S, is_constant=True)]}
    said = said_of(broken, failures=failures)
    assert said.changes == ()
    assert stated(said, GYROS[axis], 30.0) is not None
    assert not is_clear(said, GYROS[axis], 70.0)
    assert stated(said, ATTITUDE[axis], 100.0) is not None  # a jump would show beside a bias


@pytest.mark.parametrize("axis", range(3))
def test_beside_a_gyro_that_tells_nothing_its_angle_is_not_judged(axis):
    record = motion()
    late = record.time_s >= 70.0
    noise = 20.0 * np.random.default_rng(1).standard_normal(len(record))
    broken = record.replace(GYROS[axis], np.where(late, noise, record[GYROS[axis]]))
    said = said_of(broken, failures={GYROS[axis]: [Failure(start_s=70.0, end_s=END_S)]})
    assert not is_clear(said, ATTITUDE[axis], 76.0)
    assert stated(said, ATTITUDE[axis], 40.0) is not None
    for other in {0, 1, 2} - {axis}:
        assert stated(said, GYROS[other], 100.0) is not None


def test_a_jump_that_is_named_leaves_its_gyro_clear_before_it():
    broken = with_error(motion(), "theta", from_on(70.0, 20.0))
    said = said_of(broken, failures={"theta": [Failure(start_s=69.0, end_s=END_S)]})
    assert stated(said, "q", 30.0) is not None
    assert stated(said, "theta", 30.0) is not None
    assert not is_clear(said, "theta", 72.0)


def test_excused_spans_are_not_judged_and_do_not_bend_what_is_said_beside_them():
    hit = with_error(motion(), "p", from_on(50.0, 60.0, 58.0))
    said = said_of(hit, without=[(49.9, 58.1)])
    assert said.changes == ()
    for name in SENSORS:
        assert name in GYROS or not is_clear(said, name, 52.1, 56.0)  # a gyro's fault that stays shows behind it
        assert stated(said, name, 30.0) is not None
        assert stated(said, name, 90.0) is not None
    assert stated(said, "p", 30.0).error < 2.0 * stated(healthy(), "p", 30.0).error


def test_a_fault_that_goes_on_after_an_excuse_shows():
    broken = with_error(motion(), "p", from_on(50.0, 2.0))
    said = said_of(broken, without=[(49.0, 60.0)])
    assert [change.axis for change in said.changes] == [0]
    assert not is_clear(said, "p")


def test_beside_a_gap_all_is_clear():
    record = motion()
    said = hindsight_of(blocks_of([record.between(0.0, 50.0), record.between(60.0, 120.0)]), is_driven=False)
    for name in SENSORS:
        assert stated(said, name, 30.0) is not None
        assert stated(said, name, 90.0) is not None


# what stands still ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("lasts_s", "is_told"), [(2.0, False), (4.0, True), (8.0, True)])
@pytest.mark.parametrize("name", by_day(SENSORS, 2, seed=1))
def test_a_sensor_that_reads_one_value_for_more_than_three_seconds_in_motion_is_not_judged_there(
    name, lasts_s, is_told
):
    record = motion()
    values = record[name].copy()
    during = (record.time_s >= 50.0) & (record.time_s < 50.0 + lasts_s)
    values[during] = values[int(np.argmax(during))]
    spans = [span for span in said_of(record.replace(name, values)).claims[name] if "reads one value" in span.reason]
    assert len(spans) == is_told
    if is_told:
        assert spans[0].start_s == pytest.approx(50.0, abs=0.5)
        assert spans[0].end_s == pytest.approx(50.0 + lasts_s, abs=0.5)


def test_a_sensor_may_read_one_value_while_nothing_turns():
    record = motion()
    still = (record.time_s >= 50.0) & (record.time_s < 60.0)
    values = record.values.copy()
    values[still] = np.where(np.arange(6) < 3, 0.0, record.values[int(np.argmax(still))])
    said = said_of(gb.Record(values, channels=SENSORS, sample_period_s=0.05))
    assert not any("reads one value" in span.reason for spans in said.claims.values() for span in spans)


def test_a_sensor_that_often_repeats_itself_is_held_against_its_own_habit():
    """A heading that comes once in two seconds stands still for as long, and that is no fault."""
    record = motion(240.0)
    psi = record["psi"][np.arange(len(record)) // 40 * 40]
    seldom = said_of(record.replace("psi", psi))
    assert not any("reads one value" in span.reason for span in seldom.claims["psi"])


# an attitude that the gyros drive -------------------------------------------------------------------------------------


def lowpassed(time_s, onset_s, size, tau_s):
    return np.where(time_s >= onset_s, size * -np.expm1(-(time_s - onset_s) / tau_s), 0.0)


@pytest.mark.parametrize("tau_s", [2.0, 20.0])
@pytest.mark.parametrize("sign", [-1.0, 1.0])
@pytest.mark.parametrize("axis", by_day(range(3)))
def test_a_bias_that_shows_as_slowly_as_an_estimator_lets_it_shows_at_the_stated_size(axis, sign, tau_s):
    """Of a bias, the attitude takes over at first all, and in the end nothing: 1 - exp(-t / tau) of it shows."""
    for onset_s in (12.0, 56.0):
        size = 1.1 * sign * stated(healthy(is_driven=True), GYROS[axis], onset_s).error
        broken = with_error(motion(), GYROS[axis], lambda time_s: lowpassed(time_s, onset_s, size, tau_s))  # noqa: B023
        said = said_of(broken, is_driven=True)
        assert is_told(said, GYROS[axis], onset_s, size)
        assert {change.axis for change in said.changes} == {axis}


def test_of_a_driven_attitude_more_has_to_be_wrong_before_it_shows_and_nothing_says_it_of_the_end():
    for axis, name in enumerate(GYROS):
        own, driven = (stated(healthy(is_driven=each), name, 50.0).error for each in (False, True))
        assert 1.2 * own < driven < 8.0 * own
        assert not is_clear(healthy(is_driven=True), name, 118.0)
        assert is_clear(healthy(is_driven=True), ATTITUDE[axis])


# pieces ---------------------------------------------------------------------------------------------------------------


def test_chunks_stand_together_whose_bounds_are_within_four_tenths_of_each_other():
    """From the median on, and what is better; the others by steps of as much, and what has none apart."""
    bounds = np.concatenate([np.full(40, 1.0), [1.39, 0.2], [1.41, 1.95], [1.97], [np.inf, np.inf], np.full(4, 1.0)])
    known = np.ones(len(bounds), dtype=bool)
    known[46] = False
    runs = [(first, stop) for first, stop, _ in _as_good(bounds, known)]
    assert runs == [(0, 42), (42, 44), (44, 45), (45, 46), (46, 47), (47, 51)]
    levels = [level for _, _, level in _as_good(bounds, known)]
    assert levels == [1.0, 1.95, 1.97, np.inf, np.inf, 1.0]  # from 95 of 100 onsets a fault of that size shows
    often = np.concatenate([np.full(94, 1.0), np.full(6, 1.3)])
    assert [level for *_, level in _as_good(often, np.ones(100, dtype=bool))] == [1.3]
    assert [*_as_good(np.full(3, np.inf), np.ones(3, dtype=bool))] == [(0, 3, np.inf)]


@pytest.mark.parametrize(
    ("there", "known", "first", "stop", "why"),
    [
        (1.0, 1.0, 0, 2, "too little is known before or behind it"),
        (1.0, 1.0, 8, 10, "too little is known before or behind it"),
        (1.0, 1.0, 4, 6, "it stands, or gyros or attitude are missing"),
        (0.9, 0.9, 0, 2, "it stands, or gyros or attitude are missing"),
        (0.6, 0.4, 0, 2, "q or theta failed, and nothing else tells"),
        (0.6, 0.5, 4, 6, "it stands, or gyros or attitude are missing"),
        (0.5, 0.4, 4, 6, "it stands, or gyros or attitude are missing"),
    ],
)
def test_why_nothing_is_asked_of_some_chunks(there, known, first, stop, why):
    share = (np.arange(100) % 10 + 0.5) / 10.0
    own = SimpleNamespace(
        per_chunk=10,
        error=np.where(share < there, 0.0, np.nan)[:, np.newaxis] * np.ones(3),
        known=(share < known)[:, np.newaxis] & np.ones(3, dtype=bool),
    )
    assert _why_masked(own, 1, first, stop) == why


@pytest.mark.parametrize(("usual", "stated_deg"), [(0.1, 0.5 + 1.1), (3.0, 0.5 + 3.3)])
def test_a_jump_is_excluded_that_is_larger_than_any_that_may_be_there_and_is_significant(usual, stated_deg):
    alignment = alignment_of(blocks_of([motion()]))
    rows = len(alignment.error)
    nothing = Jumps(sizes=np.full(rows, 0.5), significant=np.full(rows, usual), stay=np.zeros(rows))
    (span,) = _of_angle(alignment, 1, nothing, [])
    assert (span.state, span.reason, span.sizes.error) == (State.CLEAR, "", pytest.approx(stated_deg))
    at = rows // 2
    for size, stay, is_seen in (
        (9.0, 5.0, True),
        (9.0, 12.0, True),
        (9.0, 4.0, False),
        (0.9 * max(usual, 1.0), 9.0, False),
    ):
        jumped = Jumps(sizes=nothing.sizes.copy(), significant=nothing.significant, stay=nothing.stay.copy())
        jumped.sizes[at], jumped.stay[at] = size, stay
        spans = [*_of_angle(alignment, 1, jumped, [])]
        assert bool(spans[-1].reason) == is_seen
        if is_seen:  # it may be wrong from there on
            assert spans[-1].sizes.error == pytest.approx(max(stay, 9.0) + 1.1 * max(usual, 1.0))
            assert spans[-1].reason == f"theta jumps by 9 deg at {alignment.blocks.time_s[at]:.0f} s, and no gyro turns"
            assert spans[0].sizes.error == pytest.approx(stated_deg)


@pytest.mark.parametrize(("fast", "turns"), [(1.6, True), (1.4, False)])
def test_it_turns_that_does_so_for_a_quarter_of_the_time(fast, turns):
    rates = np.zeros((40, 3))
    rates[:12] = -fast
    rates[35:] = np.nan
    own = SimpleNamespace(rates=rates, gyros=np.zeros((40, 3)))
    assert _turns(own, slice(0, 40), "q") == turns
    assert not _turns(own, slice(0, 40), "theta")  # by the gyros
    assert not _turns(own, slice(35, 40), "q")
    rates[7:] = 0.0
    assert not _turns(own, slice(0, 40), "q")


def test_a_shift_of_noise_is_a_gyros_own_where_the_others_stay_as_they_are():
    """As far as it rises beside the others and by itself."""
    record, random = motion(), np.random.default_rng(3)
    late = (record.time_s > 60.0)[:, np.newaxis]
    for axes, is_own in (([0], True), ([0, 1, 2], False), ([1, 2], False)):
        noise = np.zeros((len(record), 3))
        noise[:, axes] = 1.5 * random.standard_normal((len(record), len(axes)))
        louder = with_error(record, "p", (noise * late)[:, 0])
        louder = with_error(with_error(louder, "q", (noise * late)[:, 1]), "r", (noise * late)[:, 2])
        said = said_of(louder)
        assert bool([each for each in said.changes if (each.of, each.axis) == ("noise", 0)]) == is_own


@pytest.mark.parametrize(
    ("of", "size", "stays", "text"),
    [
        ("error", 0.54, True, "q reads 0.54 deg/s more, against the attitude, from 16 s on than before"),
        ("error", -0.5, False, "q reads 0.5 deg/s less, against the attitude, for a time about 16 s"),
        ("gain", 0.25, True, "q turns 25 % further from 16 s on than before"),
        ("gain", -0.25, True, "q turns 25 % less from 16 s on than before"),
        ("offset", -6.0, True, "q reads -6 deg/s, against the attitude, throughout"),
        ("scale", 1.5, True, "q turns 1.5 times as far as the attitude throughout"),
        ("noise", 2.0 * np.log(3.0), True, "q is 3 times as noisy, beside the other gyros, from 16 s on than before"),
    ],
)
def test_a_level_that_shifts_is_told_in_words(of, size, stays, text):
    assert LevelChange(axis=1, of=of, time_s=15.9, size=size, stays=stays).text == text


def test_behind_the_slowest_estimator_that_share_shows_which_isnt_taken_back_yet():
    for (from_s, to_s), share in zip(WINDOWS_S, _shown(is_driven=True), strict=True):
        times_s = np.linspace(from_s, to_s, 10_001)
        assert share == pytest.approx(1.0 - np.mean(np.exp(-times_s / SLOWEST_S)), abs=1e-4)
    assert _shown(is_driven=False).tolist() == [1.0] * len(WINDOWS_S)


@pytest.mark.parametrize(
    ("other_s", "length_s", "is_told"), [(0.6, 3.2, True), (0.6, 3.0, False), (1.0, 5.0, False), (1.0, 5.2, True)]
)
def test_a_sensor_stands_for_three_seconds_and_five_times_as_long_as_otherwise(other_s, length_s, is_told):
    alignment = alignment_of(blocks_of([motion()]))
    held_s = np.zeros(len(alignment.error))
    for first, lasts_s in ((100, other_s), (300, length_s)):
        count = round(lasts_s / 0.2)
        held_s[first : first + count] = 0.2 * np.arange(1, count + 1)
    spans, usual_s = _standing(alignment, held_s, "q")
    assert usual_s == pytest.approx(other_s if is_told else length_s)
    assert len(spans) == is_told
    if is_told:
        assert (spans[0].start_s, spans[0].end_s) == pytest.approx((59.8, 60.0 + length_s))
        assert spans[0].reason == f"q reads one value from 59.8 to {60.0 + length_s:.1f} s"

"""What a sensor shows by itself: noise, a jump, a field that is far too strong; and what looks like it and isn't."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.course.blocked import blocked
from gtmbench.engine.course.jumps import hidden_jump, jumps
from gtmbench.engine.samples import Samples
from gtmbench.values.channels import ACCELEROMETERS
from gtmbench.verdict.timeline import State
from tests.engine.course.test_course_contract import END_S, ONSET_S, accused, course_from, flown, said_of
from tests.helpers.night import by_day

FLOWN_S = (0.0, 60.0)
FIELD_UT = 49.0


def noisy(channel, deviation):
    return gb.inject(flown(), gb.Noise(channel=channel, onset_s=ONSET_S, deviation=deviation))


# ---- noise ----


@pytest.mark.parametrize(
    ("channel", "sensor", "deviation"),
    by_day(
        [
            ("gps_north", "gps", 4.0),
            ("altitude", "altitude", 40.0),
            ("mag_x", "magnetometer", 0.3 * FIELD_UT),
            ("ny", "accelerometers", 0.3),
        ],
        2,
    ),
)
def test_a_noise_of_twice_and_more_the_least_is_named_and_its_curve_is_in_the_relations_unit(
    channel, sensor, deviation
):
    said = said_of(noisy(channel, deviation))
    ((name, span),) = said.accused
    assert (name, span.state, span.judgement.kind) == (sensor, State.FAILED, "noise")
    assert span.start_s == pytest.approx(ONSET_S, abs=5.0)
    curves = [each for each in said.curves if each.kind == "noise"]
    assert len(curves) == (len(ACCELEROMETERS) if channel in ACCELEROMETERS else 1)  # they are held against each other
    for curve in curves:
        behind = curve.time_s > ONSET_S + 10.0
        assert np.nanmean(curve.measured[behind]) == pytest.approx(np.nanmean(curve.predicted[behind]), abs=0.5)


@pytest.mark.parametrize(
    ("channel", "deviation"), by_day([("gps_north", 0.7), ("altitude", 11.0), ("mag_x", 0.07 * FIELD_UT), ("ny", 0.05)])
)
def test_a_noise_of_less_than_the_least_accuses_nobody(channel, deviation):
    assert accused(noisy(channel, deviation)) == set()


@pytest.mark.parametrize("second", by_day(ACCELEROMETERS[1:], 1))
def test_what_shakes_two_accelerometers_or_all_three_accuses_nobody(second):
    shaken = noisy("nx", 0.3)
    for channel in dict.fromkeys((second, "nz")):
        shaken = gb.inject(shaken, gb.Noise(channel=channel, onset_s=ONSET_S, deviation=0.3))
    assert accused(shaken) == set()


# ---- jumps ----


def altitude(size_ft, at_s=30.0, *, step_s=0.1, noise_ft=1.0, of_ft=0.0):
    time_s = np.arange(*FLOWN_S, step_s)
    read = of_ft + noise_ft * np.random.default_rng(1).standard_normal(len(time_s))
    return Samples(time_s, read + size_ft * (time_s >= at_s))


def jumped(samples, channel="altitude"):
    return [round(at_s) for _, at_s, _ in jumps({channel: samples}, FLOWN_S)]


@pytest.mark.parametrize("step_s", [0.05, 0.24])
@pytest.mark.parametrize(
    ("channel", "least", "a_second"),
    [("altitude", 32.8, 328.0), ("tas", 7.78, 47.7), ("alpha", 2.0, 60.0), ("beta", 2.0, 60.0)],
)
def test_a_jump_is_more_than_ten_metres_or_as_much_and_what_the_fastest_motion_makes(channel, least, a_second, step_s):
    """No aircraft climbs at 100 m/s, meets a gust that grows by 2.5 g, or turns against the air by 60 deg/s."""
    most = least + step_s * a_second
    for size, is_told in ((0.93 * most, False), (1.07 * most, True), (-1.07 * most, True)):
        read = altitude(size, step_s=step_s, noise_ft=0.005 * most, of_ft=120.0 if channel == "tas" else 0.0)
        assert bool(jumped(read, channel)) == is_told


@pytest.mark.parametrize(("share", "is_told"), [(0.23, True), (0.27, False)])
def test_a_jump_is_four_times_as_large_as_any_other_change(share, is_told):
    twice = altitude(500.0)
    twice.values[400:] += 500.0 * share
    assert bool(jumped(twice)) == is_told
    hides = hidden_jump("altitude", twice, FLOWN_S, np.array([10.0, 30.0, 50.0]))
    assert hides == pytest.approx([np.inf, 5.0 * 500.0, np.inf], rel=0.02)  # beside it one that is four times as large


def test_what_comes_back_goes_on_begins_late_or_is_usual_is_no_jump():
    spike, twice = altitude(0.0), altitude(0.0)
    spike.values[300:305] += 500.0
    twice.values[300:] += 500.0
    twice.values[400:] += 200.0
    assert jumped(spike) == jumped(twice) == []
    assert jumped(altitude(500.0, at_s=12.0)) == jumped(altitude(500.0, at_s=48.0)) == []
    assert jumped(altitude(500.0, at_s=14.5)) == jumped(altitude(500.0, at_s=45.5)) == []
    assert jumped(altitude(500.0, at_s=15.5)) == [16]
    assert jumped(altitude(500.0, step_s=0.26)) == []


def test_what_stands_still_before_or_behind_jumps_not_nor_does_what_changes_in_a_gap():
    stood = altitude(500.0)
    stood.values[:300] = 0.0
    assert jumped(stood) == []
    read = altitude(500.0)
    gap = np.abs(read.time_s - 30.0) > 0.5
    assert jumped(Samples(read.time_s[gap], read.values[gap])) == []


@pytest.mark.parametrize(("before_kt", "is_told"), [(0.0, False), (-7.0, False), (9.0, True)])
def test_nothing_jumps_when_an_airspeed_begins_to_be_read(before_kt, is_told):
    """A launch, or a cover that is taken off: if anything failed, it did so before."""
    tas, alpha = altitude(100.0, noise_ft=0.3, of_ft=before_kt), altitude(9.0, noise_ft=0.1)
    found = jumps({"tas": tas, "alpha": alpha}, FLOWN_S)
    assert [name for name, _, _ in found] == (["tas", "alpha"] if is_told else [])


@pytest.mark.parametrize(("channel", "size"), by_day([("altitude", 150.0), ("tas", 25.0)]))
def test_a_jump_names_its_sensor_with_its_size_and_time(channel, size):
    said = said_of(gb.inject(flown(), gb.Bias(channel=channel, onset_s=ONSET_S, size=size)))
    ((name, span),) = said.standing
    assert (name, span.state, span.judgement.kind) == (channel, State.FAILED, "bias")
    assert span.start_s == pytest.approx(ONSET_S, abs=0.1)
    assert span.judgement.parameters["size"] == pytest.approx(size, rel=0.1)
    assert {alarm.source for alarm in said.alarms} == {channel}


def test_where_a_gps_jumped_the_altitude_that_disagrees_from_then_on_is_not_suspected():
    said = said_of(gb.inject(flown(), gb.Bias(channel="gps_down", onset_s=ONSET_S, size=5.0)))
    assert {name for name, _ in (*said.standing, *said.accused)} == {"gps"}


# ---- what is left, and what nothing else makes ----


def test_a_field_that_is_read_far_stronger_than_anywhere_else_names_its_magnetometer():
    drifts = gb.Drift(channel="mag_z", onset_s=ONSET_S, slope=0.03 * FIELD_UT)
    ((name, span),) = said_of(gb.inject(flown(), drifts)).accused
    assert (name, span.state, span.judgement.axis) == ("magnetometer", State.FAILED, "mag_z")


# ---- a blocked tube ----


def follows_altitude(record, onset_s, end_s=END_S):
    """Return a record whose airspeed is that of a blocked tube from an onset on, with noise of its own."""
    knot, first = 0.514444, int(np.searchsorted(record.time_s, onset_s))
    height = 0.3048 * flown(noise=0.0)["altitude"]
    square = (knot * record["tas"][first]) ** 2 + 2.0 * 9.80665 * (height - height[first])
    read = np.sqrt(np.maximum(square, 0.0)) / knot + 0.1 * np.random.default_rng(1).standard_normal(len(square))
    inside = (record.time_s >= onset_s) & (record.time_s < end_s)
    return record.replace("tas", np.where(inside, read, record["tas"]))


def test_a_blocked_tube_names_the_airspeed_since_when_and_why():
    said = said_of(follows_altitude(flown(), ONSET_S))
    ((name, span),) = [claim for claim in said.standing if claim[1].reason]
    assert (name, span.state) == ("tas", State.FAILED)
    assert "follows the altitude" in span.reason
    assert (span.judgement.sensor, span.judgement.time_s) == ("tas", pytest.approx(span.start_s + 20.0))
    assert span.judgement.parameters == {"onset_s": span.start_s}
    assert span.start_s == pytest.approx(ONSET_S, abs=3.0)


def test_an_airspeed_that_gusts_move_or_that_follows_for_a_moment_is_not_blocked():
    assert blocked(course_from(flown())) is None
    assert blocked(course_from(flown(seed=4))) is None
    assert blocked(course_from(follows_altitude(flown(), ONSET_S, ONSET_S + 15.0))) is None

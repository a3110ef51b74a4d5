"""Every relation and explanation of a course: what a fault of a channel does to the readings is what is said of it."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmbench as gb
from gtmbench.engine.course.course import UNITS, Course, course_of
from gtmbench.engine.course.explanations.registry import explanations_of
from gtmbench.engine.course.explanations.sensor import explanations as of_sensors
from gtmbench.engine.course.judged import course_judged
from gtmbench.engine.course.relations import field, roughness
from gtmbench.engine.course.relations.registry import relations_of
from gtmbench.engine.relation import Effect
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS, MAGNETOMETER
from gtmbench.verdict.timeline import State
from tests.engine.course.coursing import coursed, flight_from, samples_of
from tests.helpers.night import by_day

ONSET_S, END_S = 60.0, 120.0
CHANNELS = (*ACCELEROMETERS, *GPS_VELOCITY, *MAGNETOMETER, "tas", "alpha", "beta", "altitude")
# in the channels' units: what a failing sensor is off by
SIZES = (
    dict.fromkeys(ACCELEROMETERS, 0.2)
    | dict.fromkeys(GPS_VELOCITY, 3.0)
    | dict.fromkeys(MAGNETOMETER, 10.0)
    | {"tas": 10.0, "alpha": 3.0, "beta": 3.0, "altitude": 100.0}
)


def flown(noise=1.0, seed=3):
    return coursed(END_S, seed, noise)


def others_of(record):
    return samples_of(record, *GYROS, *ATTITUDE)


def course_from(record):
    return course_of(flight_from(record), others_of(record))


def said_of(record):
    return course_judged(flight_from(record), others_of(record))


def accused(record):
    blamed = (State.FAILED, State.SUSPECTED)
    return {(sensor, span.state) for sensor, span in said_of(record).claims if span.state in blamed}


# ---- what sensors tell together ----


def test_a_course_that_is_off_has_the_effects_share_in_its_channels_and_in_its_attitude():
    matrices = Rotation.random(5, random_state=1).as_matrix()
    turned = 0.2 * np.random.default_rng(1).standard_normal((5, 3))  # deg
    course = Course(flight=None, matrices=matrices, read={"gps_north": np.ones(5)})
    off = course.off_by(Effect(turned=turned, channels={"gps_north": np.arange(5.0), "tas": np.ones(5)}), 0.5)
    expected = Rotation.from_rotvec(0.5 * np.radians(turned)).as_matrix() @ matrices
    np.testing.assert_allclose(off.matrices, expected, atol=1e-5)
    assert off.read["gps_north"].tolist() == [1.0, 1.5, 2.0, 2.5, 3.0]
    assert "tas" not in off.read


def test_a_field_that_is_missing_for_a_while_is_as_well_known_beside_it():
    record = flown(noise=0.0)
    gap = np.where(np.abs(record.time_s - 70.0) < 3.0, np.nan, record["mag_x"])
    whole, part = (field.relation(course_from(each)).values for each in (record, record.replace("mag_x", gap)))
    there = np.isfinite(part).all(axis=1)
    assert 0.9 < there.mean() < 0.99
    np.testing.assert_allclose(part[there], whole[there], atol=0.1)


# ---- relations ----


@pytest.mark.parametrize("channel", by_day(CHANNELS, 4, seed=1))
def test_a_bias_of_a_channel_is_what_its_signature_says_in_every_relation(channel):
    record, size = flown(noise=0.0), 0.05 * SIZES[channel]
    course, broken = course_from(record), course_from(record.replace(channel, record[channel] + size))
    (bias,) = [each for each in of_sensors(course) if (each.suspect, each.kind) == (channel, "bias")]
    effect = bias.effect(course.flight)
    strength = np.nanmedian(np.linalg.norm(course.field, axis=1))
    unit = strength if channel in MAGNETOMETER else 1.0 / UNITS.get(channel, 1.0)
    shown = 0
    for own, off in zip(relations_of(course), relations_of(broken), strict=True):
        if own.name == roughness.NAME:
            continue  # what stays is no noise
        response, changed = own.response(course.flight, effect), _in_one_unit(off, own, broken, course)
        told = np.zeros_like(changed) if response is None else response * size / unit
        scale = np.nanmax(np.abs(changed))
        assert np.nanmax(np.abs(changed - told)) <= max(0.05 * scale, 1e-6)
        shown += scale > 1e-3
    assert shown or channel == "altitude"  # whose level no relation knows


def _in_one_unit(off, own, broken, course):
    """Return what changed; shares of the field as shares of the healthy one."""
    strength, usual = (np.nanmedian(np.linalg.norm(each.field, axis=1)) for each in (broken, course))
    return off.values * (strength / usual if own.name == "field" else 1.0) - own.values


def test_an_effect_on_nothing_that_a_relation_reads_is_none():
    course = course_from(flown(noise=0.0))
    (bias,) = [each for each in of_sensors(course) if (each.suspect, each.kind) == ("tas", "bias")]
    of = {each.name: each for each in relations_of(course)}
    assert of["field"].response(course.flight, bias.effect(course.flight)) is None
    assert of["gps and air"].response(course.flight, bias.effect(course.flight)) is not None


def test_every_explanation_has_a_name_of_its_own_and_every_base_is_there():
    names = [each.name for each in explanations_of(course_from(flown()))]
    assert len(set(names)) == len(names)
    assert {each.base for each in explanations_of(course_from(flown())) if each.base} <= {*names}


# ---- verdicts ----


def test_nobody_is_accused_of_a_healthy_course():
    for seed in (3, 4):
        assert accused(flown(seed=seed)) == set()


@pytest.mark.parametrize(
    ("channel", "sensor"),
    by_day([("nz", "accelerometers"), ("ny", "accelerometers"), ("nx", "accelerometers"), ("gps_down", "gps")]),
)
def test_a_bias_that_two_relations_show_is_named_with_its_size_and_onset(channel, sensor):
    said = said_of(gb.inject(flown(), gb.Bias(channel=channel, onset_s=ONSET_S, size=SIZES[channel])))
    ((name, span),) = said.accused
    assert (name, span.state) == (sensor, State.FAILED)
    assert span.start_s == pytest.approx(ONSET_S, abs=5.0)
    judged = span.judgement
    assert judged.parameters["size"] == pytest.approx(SIZES[channel], rel=0.15)
    assert (judged.kind, judged.axis) == ("bias", channel)


@pytest.mark.parametrize("channel", by_day(ACCELEROMETERS, 1))
def test_an_accelerometer_that_drifts_for_twenty_seconds_is_named_before_the_drift_is_over(channel):
    drifts = gb.Bias(channel=channel, onset_s=ONSET_S, size=SIZES[channel], ramp_s=20.0)
    ((name, span),) = said_of(gb.inject(flown(), drifts)).accused
    assert (name, span.state) == ("accelerometers", State.FAILED)
    assert span.judgement.time_s < ONSET_S + 20.0


def test_an_accelerometer_that_is_off_is_not_taken_for_a_gps_that_is_late():
    healthy, broken = (course_from(each) for each in (flown(), gb.inject(flown(), _nx_is_off())))
    np.testing.assert_array_equal(broken.velocity, healthy.velocity)


def _nx_is_off():
    return gb.Bias(channel="nx", onset_s=ONSET_S, size=0.3)


def test_what_one_relation_of_two_sensors_shows_is_either_of_theirs():
    drifts = gb.Drift(channel="altitude", onset_s=ONSET_S, slope=SIZES["altitude"] / 30.0)
    assert accused(gb.inject(flown(), drifts)) == {("altitude", State.SUSPECTED), ("gps", State.SUSPECTED)}


@pytest.mark.parametrize("channel", by_day(["tas", "nz", "gps_east", "mag_z", "altitude"], 2))
def test_a_sensor_that_stands_still_in_flight_is_named(channel):
    broken = gb.inject(flown(), gb.Jam(channel=channel, onset_s=ONSET_S))
    said = said_of(broken)
    ((name, span),) = said.standing
    assert said.course.has("beta")
    assert not said.course.has(channel)
    assert name in (channel, "gps", "magnetometer", "accelerometers")
    assert (span.start_s, span.end_s) == (pytest.approx(ONSET_S, abs=1.0), pytest.approx(END_S, abs=1.0))


def test_what_reads_one_value_on_the_ground_is_no_fault():
    record = flown()
    row, landed = int(110.0 / record.sample_period_s), record.time_s > 110.0
    six = {name: np.where(landed, 0.01 * np.sin(record.time_s), record[name]) for name in (*GYROS, *ATTITUDE)}
    for name, values in (six | {"tas": np.where(landed, record["tas"][row], record["tas"])}).items():
        record = record.replace(name, values)
    assert said_of(record).standing == ()


def test_what_begins_with_the_flight_and_ends_names_nobody():
    """Which side of its end is the broken one isn't known: nothing was before it."""
    ends = gb.Bias(channel="nz", onset_s=8.0, duration_s=52.0, size=SIZES["nz"])
    assert accused(gb.inject(flown(), ends)) == set()
    ends = gb.Bias(channel="nz", onset_s=30.0, duration_s=52.0, size=SIZES["nz"])
    assert accused(gb.inject(flown(), ends)) == {("accelerometers", State.FAILED)}

"""Gyros at rest: a lasting error shows whole on the ground, of r too; nobody is named for warming or a calibration."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.study.log.rests import AT_REST, Rest, changes_of, found_at_rest, rests_of, settled_at_rest
from gtmbench.study.log.slow_means import SLOW, SlowMeans
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.values.attitude import AttitudeEstimator
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS
from gtmbench.verdict.verdict import Outcome

STANDS_S, PERIOD_S = 12.0, 0.04
CHANNELS = (*GYROS, *ATTITUDE, *ACCELEROMETERS)
BIAS = np.array([0.5, -0.4, 0.3])  # of healthy gyros


def flown(seed=3):
    """Return a flight between two rests: the airframe shakes as it flies, and the gyros have a bias throughout."""
    flight = MECHANISMS["plain"](seed).record.select([*GYROS, *ATTITUDE])
    random = np.random.default_rng(seed)
    count = round(STANDS_S / flight.sample_period_s)
    still = np.zeros((count, 6))
    values = np.concatenate([still + _at(flight.values[0]), flight.values, still + _at(flight.values[-1])])
    shakes = np.full(len(values), 0.15)
    shakes[:count] = shakes[-count:] = 0.002
    force = np.array([0.0, 0.0, 1.0]) + shakes[:, np.newaxis] * random.standard_normal((len(values), 3))
    values[:, :3] += BIAS + 0.05 * random.standard_normal((len(values), 3))
    return gb.Record(np.column_stack([values, force]), channels=CHANNELS, sample_period_s=flight.sample_period_s)


def _at(row):
    return np.concatenate([np.zeros(3), row[3:]])


def watched(record, folder):
    gb.write_log(record, Path(folder, "log.csv"))
    return gb.watch_log(Path(folder, "log.csv"), "auto", attitude="driven")


def accused(said):
    return {alarm.sensor for alarm in said.alarms if alarm.sensor is not None and not alarm.doubt}


@pytest.fixture(scope="module")
def flight():
    return flown()


def test_a_healthy_flight_between_rests_is_an_all_clear(flight, tmp_path):
    first, last = rests_of([flight])
    assert first.reads == pytest.approx(BIAS, abs=0.02)
    assert last.start_s == pytest.approx(flight.end_s - STANDS_S, abs=2.0)
    assert watched(flight, tmp_path).outcome is Outcome.HEALTHY


@pytest.mark.parametrize("gyro", GYROS)
def test_a_lasting_bias_that_the_attitude_follows_is_named(gyro, flight, tmp_path):
    fault = gb.Bias(channel=gyro, onset_s=flight.end_s - 60.0, size=1.5)
    bent = AttitudeEstimator(time_constant_s=5.0).bent(flight, gb.inject(flight, fault))
    said = watched(bent, tmp_path)
    assert accused(said) == {gyro}  # p and q by the angle that the attitude would be off, r at rest alone
    assert any(AT_REST in alarm.last.witness for alarm in said.alarms) == (gyro == "r")


def test_a_bias_that_is_gone_at_rest_is_named_by_no_rest(flight, tmp_path):
    fault = gb.Bias(channel="r", onset_s=flight.end_s - 60.0, size=1.5, duration_s=40.0)
    said = watched(AttitudeEstimator(time_constant_s=5.0).bent(flight, gb.inject(flight, fault)), tmp_path)
    assert not accused(said)
    assert not any(AT_REST in alarm.last.witness for alarm in said.alarms if alarm.last)


# ---- what rests tell ----


def rest(start_s, reads, segment=0):
    return Rest(segment=segment, start_s=start_s, end_s=start_s + 10.0, reads=np.array(reads))


def means(error=0.0):
    return SlowMeans(
        start_s=0.0,
        error=np.full((300, 3), error),
        weight=np.ones((300, 3)),
        bounds={},
        is_watched=np.ones(300, dtype=bool),
        is_driven=True,
    )


def open_alarm(onset_s=100.0):
    judged = Judgement(time_s=onset_s + 20.0, sensor=None, candidates=("r", "psi"), doubt="the means of r differ")
    return Alarm(number=0, time_s=onset_s + 20.0, onset_s=onset_s, source="r", test=SLOW, judgements=(judged,))


BEFORE = rest(0.0, BIAS)


def after(gyro, change, start_s=200.0, segment=0):
    return rest(start_s, BIAS + change * (np.array(GYROS) == gyro), segment)


@pytest.mark.parametrize(
    ("change", "claimed", "named"),
    [(1.2, 1.2, "r"), (-1.2, -1.0, "r"), (1.2, -1.2, None), (0.4, 1.2, None), (0.7, 2.0, None)],
)
def test_an_open_r_is_named_where_it_reads_as_wrong_at_rest_as_the_attitude_says(change, claimed, named):
    rests = [BEFORE, after("r", change)]
    assert settled_at_rest(open_alarm(), rests, means(claimed), 60.0).sensor == named


def test_a_rest_before_the_error_or_none_that_is_usual_tells_nothing():
    for rests in ([BEFORE, after("r", 2.0, 80.0)], [rest(80.0, BIAS), after("r", 2.0)], []):
        assert settled_at_rest(open_alarm(), rests, means(2.0), 60.0) == open_alarm()


def test_by_itself_a_rest_names_twice_what_warming_does_and_doubts_less():
    for change, sensor, is_found in ((0.4, None, False), (0.9, None, True), (1.6, "q", True)):
        found = found_at_rest([BEFORE, after("q", change)], means(), [], 60.0)
        assert (bool(found), found[0].sensor if found else None) == (is_found, sensor)
        assert [bool(alarm.doubt) for alarm in found] == [sensor is None] * is_found
    hours = found_at_rest([BEFORE, after("q", 1.6, 7200.0)], means(), [], 60.0)
    assert hours == ()


def test_whom_something_else_accuses_leaves_nobody_to_be_found_at_rest():
    sure = replace(open_alarm(), judgements=(Judgement(time_s=120.0, sensor="p", candidates=("p",)),))
    assert found_at_rest([BEFORE, after("q", 1.6)], means(), [sure], 60.0) == ()


def test_a_gyro_that_may_have_been_calibrated_anew_is_accused_of_nothing():
    anew = rest(200.0, [0.0, 0.0, 0.0], segment=1)
    uncalibrated = rest(0.0, [2.0, -3.0, 1.5])
    assert list(changes_of([uncalibrated, anew], "q", 60.0, 60.0)) == []
    assert found_at_rest([uncalibrated, anew], means(), [], 60.0) == ()
    kept = after("r", 1.6, segment=1)  # p and q kept theirs, so nobody calibrated
    assert [alarm.sensor for alarm in found_at_rest([BEFORE, kept], means(), [], 60.0)] == ["r"]
    small = rest(0.0, [0.1, 0.0, 0.0])  # nothing that a calibration would have taken away
    assert found_at_rest([small, rest(200.0, [0.1, 0.0, 1.6], segment=1)], means(), [], 60.0) == ()


# ---- what is a rest ----


def still(force=(0.0, 0.0, 1.0), gyro=0.05, shake=0.002, seconds=20.0):
    random, count = np.random.default_rng(1), round(seconds / PERIOD_S)
    values = np.column_stack(
        [gyro * random.standard_normal((count, 3)), np.array(force) + shake * random.standard_normal((count, 3))]
    )
    return gb.Record(values, channels=(*GYROS, *ACCELEROMETERS), sample_period_s=PERIOD_S)


def gps(speed_m_s):
    time_s = np.arange(0.0, 20.0, 0.2)
    return SensorReadings(
        name="GPS",
        channels=GPS_VELOCITY,
        columns=("vn", "ve", "vd"),
        time_s=time_s,
        values=np.tile([speed_m_s, 0.0, 0.0], (len(time_s), 1)),
        is_late=True,
    )


def test_what_shakes_turns_or_moves_is_no_rest():
    assert len(rests_of([still()])) == 1
    assert rests_of([still(shake=0.1)]) == ()
    assert rests_of([still(gyro=3.0)]) == ()
    assert rests_of([still(seconds=5.0)]) == ()
    assert len(rests_of([still()], [gps(0.3)])) == 1
    assert rests_of([still()], [gps(12.0)]) == ()  # a sailplane in calm air
    assert rests_of([still()], until_s=0.5) == ()


def test_a_tilting_force_is_no_rest():
    record = still()
    tilt = np.radians(0.8 * record.time_s)
    tilting = record.replace("nx", record["nx"] + np.sin(tilt)).replace("nz", record["nz"] + np.cos(tilt) - 1.0)
    assert rests_of([tilting]) == ()

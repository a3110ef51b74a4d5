"""The accelerometers of a log between a gyro and its angle: who is named, who never is, and what is told of it."""

import json
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.gps import Gps, with_gps
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.method.heading_witness import FieldOpinion
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.judgement import witness_text
from gtmbench.report.words.log import detail_lines
from gtmbench.study.log.field_witnesses import FORCES, settled
from gtmbench.study.log.force_witnesses import force_witnesses, found_by_forces
from gtmbench.study.log.slow_means import SLOW, slow_means
from gtmbench.study.log.watch import watch_log
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.attitude import AttitudeEstimator
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS

DURATION_S, ONSET_S, HEALTHY = 200.0, 110.0, [(0.0, 90.0)]
THROUGH = AttitudeEstimator(time_constant_s=20.0)


@cache
def flown(seed=1):
    """Return a flight at 10 Hz whose attitude a filter of 20 s makes of the gyros."""
    truth = fly_once(duration_s=DURATION_S, excitation="multisine+turbulence", seed=750_000 + seed)
    sensed = with_gps(gb.measure(truth, noise="t2", seed=seed), truth, Gps(rate_hz=5.0, delay_s=0.15), seed=seed)
    for name in ATTITUDE:
        sensed = sensed.replace(name, truth[name])
    driven = gb.filtered_attitude(sensed, time_constant_s=20.0, seed=seed)
    channels = (*GYROS, *ATTITUDE, *ACCELEROMETERS, *GPS_VELOCITY)
    return gb.Record(driven.matrix(channels)[::10], channels=channels, sample_period_s=0.1)


def watched(path, *, without=()):
    record = flown()
    gb.write_log(record.select([name for name in record.channels if name not in without]), path / "flight.csv")
    return watch_log(path / "flight.csv", "auto", healthy=HEALTHY)


def readings(record, channels, *, is_late=False):
    known = np.isfinite(record.matrix(channels)).all(axis=1)
    return SensorReadings(
        name="",
        channels=channels,
        columns=channels,
        time_s=record.time_s[known],
        values=record.matrix(channels)[known],
        is_late=is_late,
    )


@cache
def broken(fault):
    """Return the slow means of a broken flight, and its accelerometers and GPS as a witness."""
    record = THROUGH.bent(flown(), gb.inject(flown(), fault))
    sensors = [readings(flown(), ACCELEROMETERS), readings(flown(), GPS_VELOCITY, is_late=True)]
    means = slow_means([record], healthy=HEALTHY, is_driven=True)
    return means, force_witnesses(sensors, [record], [record.between(*HEALTHY[0])])


def told(fault, *, asked=True):
    """Return the alarms of slow means of a broken flight, as accelerometers and GPS settle them, and what they find."""
    means, witnesses = broken(fault)
    witnesses = witnesses if asked else ()
    means = replace(means, alarms=tuple(settled(alarm, witnesses, means) for alarm in means.alarms))
    return [*means.alarms, *found_by_forces(witnesses, means, means.alarms, HEALTHY[0][1])]


SLOW_FAULTS = [
    gb.Bias(channel="p", onset_s=ONSET_S, size=1.0),
    gb.Bias(channel="q", onset_s=ONSET_S, size=-1.0),
    gb.Bias(channel="r", onset_s=ONSET_S, size=3.5),
    gb.Drift(channel="p", onset_s=ONSET_S, slope=-0.015),
    gb.Drift(channel="q", onset_s=ONSET_S, slope=0.02),
]


@pytest.mark.parametrize("fault", SLOW_FAULTS, ids=lambda fault: f"{fault.kind} of {fault.channel}")
def test_a_slow_fault_that_means_leave_open_is_named(fault):
    assert all(alarm.sensor is None for alarm in told(fault, asked=False))
    alarms = told(fault)
    assert {alarm.sensor for alarm in alarms if alarm.accuses} == {fault.channel}
    named = next(alarm for alarm in alarms if alarm.sensor == fault.channel)
    assert named.last.witness.startswith(f"accelerometers: {fault.channel} reads ")
    assert witness_text(named).startswith(f"asked between {fault.channel} and ")


def left_open(gyro, angle, onset_s, test=SLOW):
    judged = Judgement(time_s=onset_s + 8.0, sensor=None, candidates=(gyro, angle), doubt="too little to tell")
    return Alarm(number=0, time_s=onset_s + 8.0, onset_s=onset_s, source=gyro, test=test, judgements=(judged,))


@pytest.mark.parametrize(("gyro", "angle", "is_named"), [("p", "phi", True), ("q", "theta", False)])
def test_what_left_a_gyro_or_its_angle_open_doesnt_keep_it_from_being_named(gyro, angle, is_named):
    means, witnesses = broken(SLOW_FAULTS[0])
    found = found_by_forces(witnesses, means, [left_open(gyro, angle, ONSET_S)], HEALTHY[0][1])
    assert [alarm.sensor for alarm in found] == ["p"] * is_named


@dataclass
class OverHalfAMinute:
    """A witness that knows nothing of a shorter time."""

    name, columns, least_deg_s = FORCES, (), 0.7
    records: tuple

    def knows(self, _gyro):
        return True

    def judge(self, _record, gyro, span, error_deg_s):
        is_long = span[1] - span[0] > 29.0
        return FieldOpinion(sensor=gyro if is_long else None, reason="", error_deg_s=error_deg_s, bound_deg_s=0.1)


@pytest.mark.parametrize(("test", "sensor"), [(SLOW, "p"), ("glr", None)])
def test_of_a_slow_fault_that_showed_late_the_half_minute_is_asked_in_which_it_began(test, sensor):
    means, _ = broken(SLOW_FAULTS[0])
    alarm = left_open("p", "phi", DURATION_S - 20.0, test)
    assert settled(alarm, [OverHalfAMinute((flown(),))], means).sensor == sensor


def test_a_healthy_flight_accuses_nobody_and_says_how_well_it_knows_gyros(tmp_path):
    said = watched(tmp_path)
    assert not said.alarms
    (line,) = [line for line in detail_lines(said) if line.startswith("asked where a gyro")]
    assert "accelerometers (knows p to 0." in line
    (witness,) = json.loads(json.dumps(log_results(said)["witnesses"]))
    assert set(witness["bounds_deg_s"]) == set(GYROS)


def test_a_wandering_heading_names_no_gyro(tmp_path):
    record = flown()
    wandering = record.replace("psi", record["psi"] + 1.5 * np.maximum(record.time_s - ONSET_S, 0.0))
    gb.write_log(wandering, tmp_path / "flight.csv")
    said = watch_log(tmp_path / "flight.csv", "auto", healthy=HEALTHY)
    assert not {alarm.sensor for alarm in said.alarms if alarm.accuses} & {*GYROS}


def test_without_accelerometers_there_is_no_such_witness(tmp_path):
    assert watched(tmp_path, without=ACCELEROMETERS).witnesses == ()


def test_without_a_gps_nothing_is_said_of_r(tmp_path):
    (witness,) = watched(tmp_path, without=GPS_VELOCITY).witnesses
    assert [gyro for gyro in GYROS if witness.knows(gyro)] == ["p", "q"]

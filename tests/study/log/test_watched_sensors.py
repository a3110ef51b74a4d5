"""The sensors of a log that no gyro enters: named by evidence that is large and lasts, never for a fault of a gyro."""

import json
from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.detectors.excursion import Excursion
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.report.words.other_sensors import possible_lines, sensor_lines, sensor_table
from gtmbench.report.words.verdict import verdict_text
from gtmbench.study.log.other_sensors import kind_of, not_told_apart, possible, watched_sensors
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS, MAGNETOMETER
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.verdict import Outcome
from tests.helpers.logged import watched_log
from tests.helpers.monitors import monitor, record

LEARNT_S, ONSET_S = 90.0, 110.0
CHANNELS = (GPS_VELOCITY, ACCELEROMETERS, ("tas",), ("altitude",), MAGNETOMETER)
NAMES = ("GPS", "IMU", "ARSP", "BARO", "MAG")


@pytest.fixture(scope="module")
def truth():
    return gb.fly("gtm", "multisine+turbulence", 150.0, seed=9)


def flown(truth, *faults):
    """Return what is logged of a flight whose gyros, broken or not, drive the attitude."""
    readings = gb.measure(truth, noise="t2", seed=9)
    readings = estimated_attitude(gb.inject(readings, faults) if faults else readings, truth, "filter 20 s", 9)
    readings = gb.with_magnetometer(readings, truth, gb.Magnetometer(declination_deg=10.0), seed=9)
    return gb.with_gps(readings, truth, gb.Gps(delay_s=0.12), seed=9)


def sensors_of(record):
    """Return the sensors of a record as a log holds them, each at its own rate."""
    found = []
    for name, channels in zip(NAMES, CHANNELS, strict=True):
        values = record.matrix(channels)[:: 10 if name == "BARO" else 1]
        time_s = record.time_s[:: 10 if name == "BARO" else 1]
        known = np.isfinite(values).all(axis=1)
        found.append(
            SensorReadings(
                name=name,
                channels=channels,
                columns=channels,
                time_s=time_s[known],
                values=values[known],
                is_late=name == "GPS",
            )
        )
    return found


def motion_of(record):
    """Return its gyros and attitude at 25 Hz."""
    rows = record.matrix((*GYROS, *ATTITUDE))[::4]
    return gb.Record(rows, channels=(*GYROS, *ATTITUDE), sample_period_s=0.04)


def watched(record, sensors=None, excursions=(), every=1):
    moving = motion_of(record)
    moving = gb.Record(moving.values[::every], channels=moving.channels, sample_period_s=0.04 * every)
    healthy = [moving.between(0.0, LEARNT_S)]
    return watched_sensors(
        sensors_of(record) if sensors is None else sensors, [moving], healthy, [(0.0, LEARNT_S)], excursions
    )


@pytest.fixture(scope="module")
def flight(truth):
    return flown(truth)


def failed(sensors):
    return {each.name: each.failed.time_s for each in sensors if each.failed is not None}


def test_a_healthy_flight_accuses_nobody_and_says_what_each_is_compared_with(flight):
    sensors = watched(flight)
    assert failed(sensors) == {}
    assert [each.name for each in sensors] == list(NAMES)
    assert all(each.limits and not each.why_not for each in sensors)
    gps = sensors[0]
    assert {"accelerometers", "altitude"} <= {other for limit in gps.limits for other in limit.against}
    lines = sensor_lines(sensors)
    assert lines[1].startswith("  GPS (GPS): ")
    assert "of the field's strength" in lines[-1]


@pytest.mark.parametrize(
    ("name", "fault"),
    [
        ("MAG", gb.Bias(channel="mag_z", onset_s=ONSET_S, size=15.0)),
        ("GPS", gb.Drift(channel="gps_north", onset_s=ONSET_S, slope=4.0)),
        ("GPS", gb.Drift(channel="gps_down", onset_s=ONSET_S, slope=3.0)),
        ("IMU", gb.Bias(channel="nz", onset_s=ONSET_S, size=-0.6)),
        ("ARSP", gb.Stuck(channel="tas", onset_s=ONSET_S, value=0.0)),
        ("BARO", gb.Noise(channel="altitude", onset_s=ONSET_S, deviation=60.0)),
    ],
    ids=str,
)
def test_a_broken_sensor_fails_and_nobody_else(flight, name, fault):
    (told,) = failed(watched(gb.inject(flight, fault))).items()
    assert told[0] == name
    assert ONSET_S <= told[1] < ONSET_S + 5.0


@pytest.mark.parametrize(
    "fault",
    [
        gb.Bias(channel="p", onset_s=ONSET_S, size=3.0),
        gb.Bias(channel="r", onset_s=ONSET_S, size=4.0),
        gb.Jam(channel="q", onset_s=ONSET_S),
    ],
    ids=str,
)
def test_a_gyro_that_drives_the_attitude_is_laid_on_no_sensor(truth, fault):
    assert failed(watched(flown(truth, fault))) == {}


def test_of_two_magnetometers_the_one_that_turns_is_named_by_the_other(flight):
    *others, field = sensors_of(flight)
    since_s = np.clip(field.time_s - ONSET_S, 0.0, None)
    angle = np.deg2rad(np.minimum(8.0 * since_s, 150.0))
    x, y, z = field.values.T
    turned = np.column_stack([np.cos(angle) * x - np.sin(angle) * y, np.sin(angle) * x + np.cos(angle) * y, z])
    bent = replace(field, name="MAG2", values=turned)
    alone = watched(flight, [*others, bent])
    assert failed(alone) == {}  # by itself it may be the attitude
    assert alone[-1].alarms[0].candidates == ("attitude", "magnetometer")
    both = watched(flight, [*others, field, bent])
    assert list(failed(both)) == ["MAG2"]


def test_what_begins_in_an_excursion_or_is_small_is_no_failure(flight):
    broken = gb.inject(flight, gb.Bias(channel="mag_z", onset_s=ONSET_S, size=15.0))
    landing = Excursion(start_s=ONSET_S - 1.0, end_s=ONSET_S + 1.0, reason="impact or touchdown")
    sensors = watched(broken, excursions=[landing])
    assert failed(sensors) == {}
    assert sensors[-1].alarms[0].doubt == "impact or touchdown"
    brief = gb.inject(flight, gb.Bias(channel="mag_z", onset_s=ONSET_S, size=10.0, duration_s=1.0))
    (alarm,) = watched(brief)[-1].alarms
    assert alarm.sensor == "magnetometer"
    assert "too short for a name" in alarm.doubt


def test_why_a_sensor_is_not_watched(flight):
    slow = watched(flight, every=5)
    assert {each.why_not for each in slow} == {"gyros and attitude come at 5 Hz; at least 10 are needed"}
    hovering = [
        replace(each, values=0.01 * each.values) if each.name == "ARSP" else each for each in sensors_of(flight)
    ]
    assert "no airspeed of a wing" in watched(flight, hovering)[2].why_not
    assert watched_sensors(sensors_of(flight), [motion_of(flight)], [], [], ())[0].why_not
    still = motion_of(flight).between(0.0, LEARNT_S)
    still = gb.Record(0.001 * still.values, channels=still.channels, sample_period_s=still.sample_period_s)
    (standing, *_) = watched_sensors(sensors_of(flight), [still, motion_of(flight)], [still], [], ())
    assert standing.why_not == "nothing moves where the log was learnt as healthy"
    (only,) = watched(flight, [sensors_of(flight)[3]])
    assert "have nothing beside them" in only.why_not
    assert "not watched" in sensor_lines([only])[1]


def test_a_sensor_that_falls_silent_is_told_and_does_not_fail(flight):
    gps = sensors_of(flight)[0]
    lost = replace(gps, time_s=gps.time_s[gps.time_s < 120.0], values=gps.values[gps.time_s < 120.0])
    sensors = watched(flight, [lost, *sensors_of(flight)[1:]])
    assert failed(sensors) == {}
    assert sensors[0].silent_s[0][0] == pytest.approx(120.0, abs=0.5)
    assert any("reads nothing from 1" in line for line in sensor_lines(sensors))


def test_a_failed_sensor_ends_with_1_and_leaves_the_gyros_verdict(flight):
    part = record(4500, seed=53)
    part = gb.Record(part.values, channels=part.channels, sample_period_s=part.sample_period_s, start_s=90.0)
    asked = Scope(sensors=GYROS)
    healthy = replace(watched_log([part], [part], monitor()), scope=asked)
    assert (healthy.outcome, healthy.verdict.failed) == (Outcome.HEALTHY, ())
    sensors = watched(gb.inject(flight, gb.Bias(channel="mag_z", onset_s=ONSET_S, size=15.0)))
    both = replace(healthy, sensors=sensors)
    assert both.outcome is Outcome.FAILED
    assert {sensor for sensor, _ in both.verdict.failed} == {"magnetometer"}
    assert [both.timeline.sensors[gyro] for gyro in GYROS] == [healthy.timeline.sensors[gyro] for gyro in GYROS]
    assert (both.verdict.suspected, both.verdict.unjudged) == ((), ())
    said = verdict_text(both)
    assert said.startswith("The magnetometer failed from 11")
    assert "p, q, r are clear" in said
    table = sensor_table(both.failed_sensors[0])
    assert (table["sensor"], table["name"], table["failed_s"]) == (
        "magnetometer",
        "MAG",
        both.sensors[-1].failed.time_s,
    )


def test_what_can_be_compared_and_told_apart_by_structure(flight):
    sensors = sensors_of(flight)
    assert {kind_of(each) for each in sensors} == {"gps", "accelerometers", "tas", "altitude", "magnetometer"}
    assert len(possible({kind_of(each) for each in sensors})) == 7
    assert not_told_apart(possible(["accelerometers", "altitude"]), "altitude") == ("accelerometers", "attitude")
    assert possible_lines([sensors[3]]) == [
        "other sensors, and what each can be compared with:",
        "  pressure altitude (BARO): not watched: the log has nothing to compare it with",
    ]


def test_a_log_is_watched_by_the_command_with_and_without_a_disturbed_magnetometer(flight, tmp_path, cli):
    """The whole way, of a table at 25 Hz: the gyros' verdict is the same, and the magnetometer ends with code 1."""
    codes, outcomes = {}, {}
    for name, fault in (("healthy", None), ("broken", gb.Bias(channel="mag_z", onset_s=ONSET_S, size=15.0))):
        record = flight if fault is None else gb.inject(flight, fault)
        rows = {channel: record[channel][::4] for channel in record.channels}
        table = gb.Record(np.column_stack(list(rows.values())), channels=list(rows), sample_period_s=0.04)
        gb.write_log(table, tmp_path / f"{name}.csv")
        codes[name], out, _ = cli("monitor", str(tmp_path / f"{name}.csv"), "--detector", "auto", "--json")
        outcomes[name] = json.loads(out)
    assert codes["broken"] == 1
    assert codes["healthy"] != 1
    assert [each["failed_s"] for each in outcomes["healthy"]["sensors"]] == [None] * 5
    (told,) = (each for each in outcomes["broken"]["sensors"] if each["failed_s"] is not None)
    assert told["sensor"] == "magnetometer"
    assert told["failed_s"] == pytest.approx(ONSET_S, abs=3.0)
    assert outcomes["broken"]["verdict"].startswith("The magnetometer failed from 11")
    assert "p, q, r, phi, theta, psi are clear" in outcomes["broken"]["verdict"]
    assert outcomes["broken"]["findings"] == outcomes["healthy"]["findings"]

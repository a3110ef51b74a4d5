"""The cross-check: each sensor is named when it fails, none when a gyro, the attitude or the wind does."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import gtmbench as gb
from gtmbench.bench.attitude_filter import estimated_attitude
from gtmbench.detectors.crosscheck.learnt import Learnt, moving_mean, worth
from gtmbench.detectors.crosscheck.relations import Motion, gps_delay_s, relations
from gtmbench.testing.contract.subject import contract_case
from gtmbench.testing.contract.suite import CONTRACT, check_property
from gtmbench.values.channels import ATTITUDE, GPS_VELOCITY, GYROS, MAGNETOMETER

LEARNT_S, ONSET_S = 80.0, 90.0


@pytest.fixture(scope="module")
def truth():
    return gb.fly("gtm", "multisine+turbulence", 130.0, seed=5)


def sensed(truth, *faults):
    """Return readings with an attitude that the gyros, broken or not, drive."""
    readings = gb.measure(truth, noise="t2", seed=5)
    readings = estimated_attitude(gb.inject(readings, faults) if faults else readings, truth, "filter 20 s", 5)
    readings = gb.with_magnetometer(readings, truth, gb.Magnetometer(declination_deg=10.0), seed=5)
    return gb.with_gps(readings, truth, gb.Gps(delay_s=0.12), seed=5)


@pytest.fixture(scope="module")
def flight(truth):
    return sensed(truth)


@pytest.fixture(scope="module")
def monitor(flight):
    return gb.CrossCheck().calibrate([flight.between(0.0, LEARNT_S)])


@pytest.mark.parametrize(
    ("sensor", "fault"),
    [
        ("magnetometer", gb.Bias(channel="mag_x", onset_s=ONSET_S, size=12.0)),
        ("magnetometer", gb.Drift(channel="mag_z", onset_s=ONSET_S, slope=0.6)),
        ("magnetometer", gb.Jam(channel="mag_y", onset_s=ONSET_S)),
        ("gps", gb.Bias(channel="gps_north", onset_s=ONSET_S, size=6.0)),
        ("gps", gb.Noise(channel="gps_down", onset_s=ONSET_S, deviation=3.0)),
        ("gps", gb.Dropout(channel="gps_east", onset_s=ONSET_S)),
        ("tas", gb.ScaleFactor(channel="tas", onset_s=ONSET_S, factor=0.6)),
        ("tas", gb.Jam(channel="tas", onset_s=ONSET_S)),
        ("accelerometers", gb.Bias(channel="nz", onset_s=ONSET_S, size=0.3)),
        ("accelerometers", gb.Jam(channel="nx", onset_s=ONSET_S)),
        ("altitude", gb.Bias(channel="altitude", onset_s=ONSET_S, size=-150.0)),
        ("altitude", gb.Noise(channel="altitude", onset_s=ONSET_S, deviation=30.0)),
    ],
    ids=str,
)
def test_a_broken_sensor_is_named(flight, monitor, sensor, fault):
    alarms = monitor.watch(gb.inject(flight, fault)).alarms
    assert alarms[0].sensor == sensor
    assert {alarm.sensor for alarm in alarms} <= {sensor, None}
    assert alarms[0].time_s >= ONSET_S


@pytest.mark.parametrize(
    ("faults", "axis"),
    [
        ([gb.Bias(channel="mag_y", onset_s=ONSET_S, size=12.0)], "mag_y"),
        ([gb.Jam(channel="mag_z", onset_s=ONSET_S)], "mag_z"),
        ([gb.Noise(channel="gps_down", onset_s=ONSET_S, deviation=3.0)], "gps_down"),
        ([gb.Bias(channel=name, onset_s=ONSET_S, size=8.0) for name in MAGNETOMETER], ""),
        ([gb.Noise(channel=name, onset_s=ONSET_S, deviation=3.0) for name in GPS_VELOCITY], ""),
        ([gb.Bias(channel="nz", onset_s=ONSET_S, size=0.4)], ""),
    ],
    ids=str,
)
def test_the_axis_is_named_where_one_alone_is_wrong(flight, monitor, faults, axis):
    alarm = monitor.watch(gb.inject(flight, faults)).alarms[0]
    assert alarm.last.axis == axis
    assert (f"({axis}) failed" in alarm.verdict) == bool(axis)


def test_a_healthy_flight_raises_nothing(flight, monitor):
    assert monitor.watch(flight).alarms == ()


@pytest.mark.parametrize("start_s", [5.0, 20.03, 33.33, 40.1, 61.17])
def test_a_healthy_record_may_begin_in_flight(flight, monitor, start_s):
    """Its first readings of the GPS tell of the time before it, and its first block may hold few."""
    watch = monitor.watch(flight.between(start_s, flight.end_s))
    assert watch.alarms == ()
    assert max(np.nanmax(score.values[:300]) for score in watch.scores.values()) < 0.8
    taught = gb.CrossCheck().calibrate([flight.between(start_s, flight.end_s)])
    whole = gb.CrossCheck().calibrate([flight])
    for name, learnt in taught.learnt.items():
        np.testing.assert_allclose(learnt.noise, whole.learnt[name].noise, rtol=0.5, err_msg=name)


def test_gusts_take_nothing_off_a_pull_up_without_them(flight):
    """In the airspeed's own changes gusts stand: fitted to these, they would pass for 30 to 60 % of its scale."""
    learnt = gb.CrossCheck().calibrate([flight]).learnt["air, accelerometers"]
    calm = gb.measure(gb.fly("gtm", "doublets", 60.0, seed=3), noise="t2")
    (told,) = (each for each in relations(Motion.of(calm), 0.0, None) if each.name == "air, accelerometers")
    assert np.nanmax(np.abs(calm["nz"] - 1.0)) > 0.3  # it is pulled up
    assert np.nanstd(learnt.errors(told), axis=0).max() < 0.2  # m/s2


@pytest.mark.parametrize(
    "fault",
    [
        gb.Bias(channel="p", onset_s=ONSET_S, size=3.0),
        gb.Drift(channel="q", onset_s=ONSET_S, slope=0.2),
        gb.Bias(channel="r", onset_s=ONSET_S, size=4.0),
        gb.Jam(channel="r", onset_s=ONSET_S),
    ],
    ids=str,
)
def test_a_broken_gyro_that_drives_the_attitude_is_laid_on_no_other_sensor(truth, monitor, fault):
    alarms = monitor.watch(sensed(truth, fault)).alarms
    assert {judged.sensor for alarm in alarms for judged in alarm.judgements} <= {None}
    assert all("attitude" in alarm.judgements[0].candidates for alarm in alarms[:1])


def test_a_heading_that_wanders_alone_is_no_magnetometer(flight, monitor):
    wander = np.maximum(flight.time_s - ONSET_S, 0.0) * 2.0
    alarms = monitor.watch(flight.replace("psi", flight["psi"] + wander)).alarms
    assert alarms
    assert {alarm.sensor for alarm in alarms} == {None}


def carried(flight, lasts_s, by_m_s):
    """Return a flight in a wind that changes; the aircraft goes along, so that only the air doesn't agree."""
    share = np.clip((flight.time_s - ONSET_S) / lasts_s, 0.0, 1.0)
    pull = by_m_s / lasts_s * (1.0 - np.cos(2.0 * np.pi * share))
    north_east_down = np.outer(pull, [0.8, 0.6, 0.0])
    turned = Rotation.from_euler("ZYX", flight.matrix(ATTITUDE)[:, ::-1], degrees=True).inv()
    gained = np.cumsum(north_east_down, axis=0) * flight.sample_period_s
    for name, along in zip(GPS_VELOCITY, gained.T, strict=True):
        flight = flight.replace(name, flight[name] + along)
    for name, along in zip(("nx", "ny", "nz"), (turned.apply(north_east_down) * [1.0, 1.0, -1.0]).T, strict=True):
        flight = flight.replace(name, flight[name] + along / 9.80665)
    return flight


@pytest.mark.parametrize(("lasts_s", "by_m_s"), [(2.0, 10.0), (20.0, 24.0)])
def test_a_wind_that_changes_is_no_sensor(flight, monitor, lasts_s, by_m_s):
    alarms = monitor.watch(carried(flight, lasts_s, by_m_s)).alarms
    assert alarms
    assert {judged.sensor for alarm in alarms for judged in alarm.judgements} <= {None}


@pytest.mark.parametrize(
    ("sensor", "fault"),
    [
        ("altitude", gb.Drift(channel="altitude", onset_s=ONSET_S - 5.0, slope=20.0)),
        ("altitude", gb.Bias(channel="altitude", onset_s=ONSET_S - 5.0, size=100.0)),
        ("accelerometers", gb.Bias(channel="nz", onset_s=ONSET_S - 5.0, size=0.2)),
        ("gps", gb.Bias(channel="gps_down", onset_s=ONSET_S - 5.0, size=5.0)),
    ],
    ids=str,
)
def test_a_wind_that_changes_clears_no_broken_sensor(flight, monitor, sensor, fault):
    """A relation that the wind may have violated says nothing of sensors that don't enter it."""
    first, *_ = monitor.watch(gb.inject(carried(flight, 20.0, 24.0), fault)).alarms
    assert all(sensor in judged.candidates for judged in first.judgements)


@pytest.fixture(scope="module")
def without_gps(flight):
    """Return readings whose altitude only the accelerometers are compared with, and who learnt on them."""
    record = flight.select([*GYROS, *ATTITUDE, "nx", "ny", "nz", "altitude"])
    return record, gb.CrossCheck(by_itself=False).calibrate([record.between(0.0, LEARNT_S)])


@pytest.mark.parametrize(
    ("fault", "named"),
    [
        (gb.Noise(channel="altitude", onset_s=ONSET_S, deviation=60.0), "altitude"),
        (gb.Bias(channel="altitude", onset_s=ONSET_S, size=200.0), "altitude"),
        (gb.Hardover(channel="nz", onset_s=ONSET_S, limit=60.0), None),  # what it reads may be wrong
        (gb.Noise(channel="nz", onset_s=ONSET_S, deviation=40.0), None),
        (gb.Spikes(channel="nx", onset_s=ONSET_S, size=200.0, rate_hz=5.0), None),
        (gb.Bias(channel="nz", onset_s=ONSET_S, size=3.0), None),
    ],
    ids=str,
)
def test_an_altitude_that_no_force_moves_is_named_and_no_force_that_is_read_names_it(without_gps, fault, named):
    record, monitor = without_gps
    alarms = monitor.watch(gb.inject(record, fault)).alarms
    assert {judged.sensor for alarm in alarms for judged in alarm.judgements} - {None} == {named} - {None}


def test_turbulence_after_a_calm_is_no_sensor(flight):
    """Learnt on calm air, watched in turbulence: the wind may be named as a candidate, and no sensor."""
    calm = gb.fly("gtm", "multisine", 90.0, seed=5)
    learnt = gb.CrossCheck().calibrate([sensed(calm)])
    alarms = learnt.watch(flight).alarms
    assert alarms
    assert {judged.sensor for alarm in alarms for judged in alarm.judgements} == {None}


def test_the_unit_of_the_field_and_the_delay_of_the_gps_are_learnt(flight, monitor):
    assert monitor.delay_s == pytest.approx(0.12, abs=0.03)
    in_gauss = flight
    for name in MAGNETOMETER:
        in_gauss = in_gauss.replace(name, 0.01 * flight[name])
    other = gb.CrossCheck().calibrate([in_gauss.between(0.0, LEARNT_S)])
    fault = gb.ScaleFactor(channel="mag_z", onset_s=ONSET_S, factor=0.6)
    told = [each.watch(gb.inject(record, fault)).alarms for each, record in ((monitor, flight), (other, in_gauss))]
    assert told[0][0].sensor == told[1][0].sensor == "magnetometer"
    assert told[0][0].time_s == told[1][0].time_s


def test_relations_of_perfect_sensors_hold(truth):
    """With no noise and nothing late, each relation is as exact as blocks are; a bias shows as itself."""
    readings = truth.select([*GYROS, *ATTITUDE, "alpha", "beta", "tas", "altitude", "nx", "ny", "nz"])
    perfect = gb.Gps(delay_s=0.0, noise_m_s=0.0, wander_m_s=0.0)
    readings = gb.with_gps(readings, truth, perfect)
    iron = gb.Magnetometer(noise=0.0, soft_iron=0.02, hard_iron_ut=(1.0, -2.0, 0.5))
    record = gb.with_magnetometer(readings, truth, iron)
    field_ned = np.array([21.0, 0.0, 45.0])
    assert gps_delay_s(Motion.of(record)) == 0.0
    told = {each.name: each for each in relations(Motion.of(record), 0.0, field_ned)}
    assert len(told) == 6
    errors = {name: Learnt.of([each]).errors(each) for name, each in told.items()}
    assert np.nanstd(errors["gps, accelerometers"]) < 0.06
    assert np.nanstd(errors["gps, altitude"]) < 0.05
    assert np.nanstd(errors["field"]) < 2e-3
    pulled = record.replace("nz", record["nz"] - 0.1 * (record.time_s > 60.0))
    moved = next(each for each in relations(Motion.of(pulled), 0.0, field_ned) if each.name == "gps, accelerometers")
    change = np.nanmean((moved.y - told["gps, accelerometers"].y)[320:], axis=0)
    upright = np.cos(np.deg2rad(record["phi"][6400:])) * np.cos(np.deg2rad(record["theta"][6400:]))
    assert change[2] == pytest.approx(-0.981 * upright.mean(), rel=0.02)  # less force upwards: it seems to fall faster


def test_it_keeps_the_contract_of_detectors(truth):
    """All of it but one: its suspects are sensors of three axes, not channels."""
    records = [
        gb.with_gps(gb.measure(truth, noise="t2", seed=seed), truth, gb.Gps(), seed=seed).between(0.0, 80.0)
        for seed in (1, 2, 3)
    ]
    fault = gb.ScaleFactor(channel="tas", onset_s=50.0, factor=0.5)
    case = contract_case(gb.CrossCheck(), records, fault=fault)
    for name in CONTRACT:
        if name != "stated" and not name.startswith("stream by 1"):
            check_property(case, name)


def test_a_saved_monitor_says_the_same(flight, monitor, tmp_path):
    gb.save_monitor(monitor, tmp_path / "monitor.json")
    loaded = gb.load_monitor(tmp_path / "monitor.json", gb.CrossCheck())
    broken = gb.inject(flight, gb.Bias(channel="altitude", onset_s=ONSET_S, size=150.0))
    assert loaded.watch(broken).alarms == monitor.watch(broken).alarms
    assert (loaded.suspects, loaded.entered) == (monitor.suspects, monitor.entered)


def test_what_it_cant_do_is_said(flight):
    bare = flight.select([*GYROS, *ATTITUDE])
    with pytest.raises(gb.InputError, match="no two sensors to compare"):
        gb.CrossCheck().calibrate([bare])
    with pytest.raises(gb.InputError, match="no two sensors to compare"):
        gb.CrossCheck().calibrate([flight.between(0.0, 1.0)])
    with pytest.raises(gb.InputError, match=r"can't promise 0\.1"):
        gb.CrossCheck().calibrate([flight], 0.1)
    with pytest.raises(gb.InputError, match="'psi'"):
        gb.CrossCheck().calibrate([flight.select(["p", "q", "r", "phi", "theta", *GPS_VELOCITY])])


def test_what_isnt_there_isnt_a_suspect(flight):
    monitor = gb.CrossCheck().calibrate([flight.select([*GYROS, *ATTITUDE, *MAGNETOMETER])])
    assert monitor.suspects == ("magnetometer",)
    assert monitor.entered["field strength"] == ("magnetometer",)
    assert monitor.entered["field direction"] == ("attitude", "magnetometer")


def test_means_pass_over_what_is_missing_and_worth_counts_independent_values():
    values = np.arange(10.0)[:, np.newaxis]
    values[4] = np.nan
    means = moving_mean(values, 5)[:, 0]
    assert np.isnan(means[:4]).all()
    assert means[8] == pytest.approx(np.mean([5.0, 6.0, 7.0, 8.0]))
    noise = np.random.default_rng(1).standard_normal(4000)
    assert 1500.0 < worth(noise) < 4000.0
    assert worth(moving_mean(noise[:, np.newaxis], 20)[19:, 0]) == pytest.approx(3.0 * 4000.0 / (2.0 * 20.0), rel=0.6)

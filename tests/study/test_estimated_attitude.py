"""An attitude that the gyros drive, in the loop, in scenarios and in campaigns: faults go through the estimator."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.registry import prepared
from gtmbench.jobs.progress import counted, silent
from gtmbench.study.campaign.plan import load_campaign
from gtmbench.study.campaign.task import rows_of
from gtmbench.study.fault_tables import spec_of
from gtmbench.study.flights import fly_setup
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.scenario import AlarmSetup, Setup
from gtmbench.values.attitude_estimators import ESTIMATORS
from tests.helpers.campaigns import table
from tests.helpers.hostile import refused
from tests.helpers.night import by_day

ANGLES, GYROS = ("phi", "theta", "psi"), ("p", "q", "r")
SETUP = Setup(
    excitation="turbulence",
    duration_s=60.0,
    snr=None,
    noise="t2",
    attitude="filter 5 s",
    severity_reference_s=(5.0, 20.0),
    alarm=AlarmSetup(watch_from_s=2.0, healthy_records=1),
)


def flown(setup):
    return fly_setup(setup, False, counted(silent, 2))


def injected(here, *faults, number=2):
    first, *also = (spec_of(fault, here.setup.duration_s) for fault in faults)
    broken, _ = here.broken("own", replace(first, also=tuple(also)), number)
    return broken.record


@pytest.fixture(scope="module")
def open_loop():
    return flown(SETUP)


def filtered(record, truth, estimator, seed):
    """What the array form makes of a record's gyros and the truth's attitude."""
    for name in ANGLES:
        record = record.replace(name, truth[name])
    settings = {"time_constant_s": estimator.time_constant_s}
    if np.isfinite(estimator.bias_time_constant_s):
        settings["bias_time_constant_s"] = estimator.bias_time_constant_s
    return gb.filtered_attitude(record, reference_noise_deg=0.5, seed=seed, **settings)


# ---- the loop ----


@pytest.mark.parametrize("name", by_day(ESTIMATORS))
def test_in_the_loop_the_stream_is_the_filter_of_its_own_broken_gyros(name):
    faults = [gb.Bias(channel="p", onset_s=10.0, size=2.0), gb.SignFlip(channel="r", onset_s=12.0, duration_s=0.5)]
    faults += [gb.Dropout(channel="q", onset_s=15.0, duration_s=1.0)]
    flight = gb.fly_in_loop(duration_s=50.0, faults=faults, noise_seed=7, attitude=name)
    again = filtered(flight.sensed, flight.truth, ESTIMATORS[name], 7)
    for angle in ANGLES:
        np.testing.assert_allclose(flight.sensed[angle], again[angle], rtol=0.0, atol=1e-9)
    assert np.isnan(flight.sensed["q"][1550])
    other = gb.fly_in_loop(duration_s=50.0, faults=faults, noise_seed=7, attitude=ESTIMATORS[name])
    assert other.sensed.values.tobytes() == flight.sensed.values.tobytes()


def test_before_its_onset_a_fault_is_nothing_and_faults_of_angles_act_on_the_estimate():
    faults = [gb.Bias(channel="phi", onset_s=9.0, size=5.0), gb.Bias(channel="p", onset_s=9.0, size=2.0)]
    healthy = gb.fly_in_loop(duration_s=10.0, attitude="filter 1 s")
    broken = gb.fly_in_loop(duration_s=10.0, attitude="filter 1 s", faults=faults)
    assert healthy.sensed.values[:900].tobytes() == broken.sensed.values[:900].tobytes()
    estimated = filtered(broken.sensed, broken.truth, ESTIMATORS["filter 1 s"], 1)
    off = broken.sensed["phi"] - estimated["phi"]
    np.testing.assert_allclose(off, np.where(broken.sensed.time_s >= 9.0 - 1e-9, 5.0, 0.0), rtol=0.0, atol=1e-9)


def test_the_autopilot_flies_on_the_estimate():
    bias = gb.Bias(channel="r", onset_s=10.0, size=1.0)
    own, estimated = (gb.fly_in_loop(duration_s=60.0, faults=bias, attitude=name) for name in ("own", "filter 5 s"))
    heading = [np.mean(flight.truth["psi"][4000:]) for flight in (own, estimated)]
    assert heading[0] == pytest.approx(45.0, abs=1.0)  # the GTM's is 45 deg
    assert heading[1] == pytest.approx(heading[0] - 5.0, abs=1.0)  # what is held is the estimate, off by 5 s times b


def test_a_flight_ends_where_its_estimators_euler_angles_do():
    flip = gb.SignFlip(channel="r", onset_s=20.0)
    flight = gb.fly_in_loop(duration_s=60.0, seed=4, attitude="filter 5 s", faults=flip, sensors="ideal")
    departure, end = flight.events
    assert (departure.kind, end.kind, end.channel) == ("departure", "envelope", "theta")
    assert abs(end.value) > 85.0
    assert flight.departed_s == departure.time_s < end.time_s == flight.truth.end_s == flight.sensed.end_s


@pytest.mark.parametrize("wrong", ["filter 2 s", 5.0, None])
def test_another_name_is_one_line_with_what_there_is(wrong):
    with pytest.raises(gb.InputError, match=r"no attitude .*; there is own, filter 1 s, .*, kalman") as refusal:
        gb.fly_in_loop(duration_s=1.0, attitude=wrong)
    assert "\n" not in str(refusal.value)


# ---- scenarios ----


def test_an_own_attitude_of_a_scenario_is_what_it_was():
    own = flown(replace(SETUP, attitude="own"))
    assert own.sensed(2).values.tobytes() == gb.measure(own.flight, noise="t2", seed=2001).values.tobytes()
    bias = gb.Bias(channel="p", onset_s=20.0, size=2.0)
    assert injected(own, bias).values.tobytes() == gb.inject(own.sensed(2), bias).values.tobytes()


def test_sensors_read_what_the_estimator_makes_of_their_own_gyros(open_loop):
    for number in (0, 2):
        read = open_loop.sensed(number)
        again = filtered(read, open_loop.flight, ESTIMATORS["filter 5 s"], 1 + 1000 * number)
        np.testing.assert_allclose(read.values, again.values, rtol=0.0, atol=1e-9)
        assert np.std(read["phi"] - open_loop.flight["phi"]) > 0.01


def test_what_is_broken_is_what_inject_makes_of_it(open_loop):
    """For a complementary filter, bending the healthy estimate and filtering the broken gyros are the same."""
    faults = [gb.Drift(channel="q", onset_s=20.0, slope=0.1), gb.Jam(channel="phi", onset_s=40.0)]
    expected = gb.inject(open_loop.sensed(2), faults, attitude=ESTIMATORS["filter 5 s"])
    np.testing.assert_allclose(injected(open_loop, *faults).values, expected.values, rtol=0.0, atol=1e-9)


def test_an_angle_that_fails_in_the_loop_is_told_against_its_estimate():
    here = flown(replace(SETUP, duration_s=20.0, autopilot=gb.load_aircraft("gtm").autopilot))
    spec = spec_of(gb.Bias(channel="phi", onset_s=10.0, size=2.0), 20.0)
    broken, unbroken = here.broken("own", spec)
    off = broken.record["phi"] - unbroken["phi"]
    np.testing.assert_allclose(off, np.where(off > 1.0, 2.0, 0.0), rtol=0.0, atol=1e-9)
    assert np.count_nonzero(off > 1.0) == 1001


def test_a_pitch_beyond_euler_angles_is_an_error_of_its_row():
    steep = spec_of(gb.Bias(channel="q", onset_s=20.0, size=-20.0), 60.0)
    mild = spec_of(gb.Bias(channel="q", onset_s=20.0, size=1.0), 60.0)
    task = next(load_campaign("ci").tasks())
    task = replace(
        task,
        setup=replace(SETUP, excitation="multisine", attitude="filter 20 s"),
        faults=(("own", steep), ("own", mild)),
    )
    _, first, second = rows_of(task, {"none": prepared(lambda _: [])})
    assert "theta reaches -85" in first["error"]
    assert "error" not in second
    assert second["attitude"] == "filter 20 s"


def test_calibration_flights_have_the_attitude_that_they_are_told():
    flights = CalibrationFlights(flights=1, duration_s=5.0, attitude="kalman")
    (record,) = flights.sensed([*GYROS, *ANGLES])
    again = filtered(record, gb.fly("gtm", "multisine+turbulence", 5.0, 1), ESTIMATORS["kalman"], 1)
    np.testing.assert_allclose(record.values, again.values, rtol=0.0, atol=1e-9)
    assert flights.provenance()["attitude"] == "kalman"
    assert "attitude" not in replace(flights, attitude="own").provenance()


# ---- campaigns ----

AXIS = """
duration_s = 30
excitation = "multisine"
noise = "t2"
detectors = ["C", "limits"]
severity_reference_s = [2, 10]
isolate = false
[operator]
identify_s = [2, 10]
[alarm]
threshold_s = [10, 18]
watch_from_s = 2
healthy_records = 1
[calibration]
flights = 2
duration_s = 40
[axes]
attitude = ["own", "filter 1 s"]
[[faults]]
kind = "bias"
channels = ["p", "phi"]
onset_s = 18
size = 3
[[smallest]]
kind = "bias"
channels = ["p"]
onset_s = 18
size = [0.1, 3]
"""


@pytest.mark.nightly
def test_detectors_are_calibrated_once_for_each_attitude_and_what_it_bends_shows_less(tmp_path):
    """Of a bias only what the reference pulls back is left where the attitude has bent with it."""
    rows = table(tmp_path, AXIS)
    assert rows["error"].isna().all()
    assert len(list((tmp_path / "out").glob("monitor-*"))) == 4
    banks = [gb.load_monitor(path) for path in (tmp_path / "out").glob("monitor-C*")]
    driven = {bank.provenance.get("attitude", "own"): bank.bank.attitude_from_gyros for bank in banks}
    assert driven == {"own": False, "filter 1 s": True}
    found = rows[rows["smallest"].notna() & (rows["detector"] == "C")].set_index("attitude")["smallest"]
    assert found["filter 1 s"] > 1.2 * found["own"]


# ---- the command line ----


def test_fly_writes_the_estimated_attitude(cli, tmp_path):
    out = tmp_path / "flight.csv"
    command = ["fly", "--duration", "5", "--out", str(out), "--force", "--attitude", "filter 1 s"]
    truth = gb.fly(duration_s=5.0)
    assert cli(*command, "--noise", "t2")[0] == 0
    again = filtered(gb.measure(truth, noise="t2", seed=1), truth, ESTIMATORS["filter 1 s"], 1)
    np.testing.assert_allclose(gb.read_log(out).matrix(ANGLES), again.matrix(ANGLES), rtol=0.0, atol=1e-9)
    assert cli(*command, "--noise", "t2", "--closed-loop", "--excitation", "turbulence")[0] == 0
    looped = gb.fly_in_loop(duration_s=5.0, attitude="filter 1 s").sensed
    np.testing.assert_allclose(gb.read_log(out).matrix(ANGLES), looped.matrix(ANGLES), rtol=0.0, atol=1e-9)
    assert "the truth has no estimator" in refused(cli(*command))
    said = " ".join(cli("fly", "--help")[1].split())
    assert all(name in said for name in ESTIMATORS)

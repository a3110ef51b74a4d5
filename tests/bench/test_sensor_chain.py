"""The sensor chain: each of its parts against an oracle, in the loop and in `measure` alike."""

import pickle

import numpy as np
import pytest
from scipy.signal import lsim

import gtmbench as gb
from gtmbench.bench.aircraft import aircraft_of, facts_of
from gtmbench.bench.sensor_chain import chain_of_table
from gtmbench.bench.tuning import lateness_s
from gtmbench.values.channels import SENSORS

GTM = gb.load_aircraft("gtm")
PERIOD_S = 0.01


def read_through(path, motion, noise=None, period_s=PERIOD_S):
    noise = np.zeros(len(motion)) if noise is None else noise
    chain = gb.SensorChain(paths={"p": path})
    return chain.readings(motion[:, None], noise[:, None], period_s, ["p"])[:, 0]


@pytest.fixture
def motion():
    return np.cumsum(np.random.default_rng(3).standard_normal(400)) * 0.2 + 5.0


def test_the_filter_is_the_first_order_system_driven_by_straight_lines(motion):
    """Oracle: scipy's simulation of 1/(s/w + 1), which begins at rest in the first sample, too."""
    corner = 2.0 * np.pi * 16.0
    _, expected, _ = lsim(([corner], [1.0, corner]), motion - motion[0], np.arange(len(motion)) * PERIOD_S)
    read = read_through(gb.SensorPath(filter_hz=16.0), motion)
    np.testing.assert_allclose(read, expected + motion[0], atol=1e-9)


@pytest.mark.parametrize("delay_s", [0.01, 0.015, 0.055, 0.0033, 2.0])
def test_a_delay_reads_what_was_so_long_ago_by_straight_lines(motion, delay_s):
    time_s = np.arange(len(motion)) * PERIOD_S
    expected = np.interp(time_s - delay_s, time_s, motion)
    np.testing.assert_allclose(read_through(gb.SensorPath(delay_s=delay_s), motion), expected, atol=1e-9)


@pytest.mark.parametrize("rate_hz", [50.0, 40.0, 30.0, 7.0, 100.0 / 3.0, 99.0])
def test_a_slower_sensor_is_fresh_so_often_and_held_between(rate_hz):
    motion = np.arange(2000.0)
    read = read_through(gb.SensorPath(rate_hz=rate_hz), motion)
    fresh = np.flatnonzero(read == motion)
    last = np.maximum.accumulate(np.where(read == motion, motion, 0.0))
    np.testing.assert_array_equal(read, last)
    assert len(fresh) / 20.0 == pytest.approx(rate_hz, abs=0.06)
    assert set(np.diff(fresh)) <= {int(100.0 / rate_hz), int(np.ceil(100.0 / rate_hz - 1e-9))}


def test_readings_are_whole_steps_and_noise_comes_before_them(motion):
    noise = np.random.default_rng(4).standard_normal(len(motion))
    read = read_through(gb.SensorPath(quantum=0.25), motion, noise)
    np.testing.assert_array_equal(read, np.round((motion + noise) / 0.25) * 0.25)


def test_noise_is_scaled_and_neither_filtered_nor_late():
    deviation = 1.7
    noise = gb.CHANNELS["p"].noise * np.random.default_rng(5).standard_normal(5000)
    read = read_through(gb.SensorPath(noise=deviation, filter_hz=1.0, delay_s=0.1), np.zeros(5000), noise)
    np.testing.assert_allclose(read, noise * deviation / gb.CHANNELS["p"].noise, atol=1e-12)
    assert np.std(read) == pytest.approx(deviation, rel=0.05)
    silent = read_through(gb.SensorPath(noise=0.0), np.ones(50), noise[:50])
    np.testing.assert_array_equal(silent, 1.0)


def test_an_empty_chain_is_ideal_bit_for_bit():
    ideal, empty = (
        gb.fly_in_loop(duration_s=5.0, sensors=each, autopilot=GTM.autopilot) for each in ("ideal", gb.SensorChain())
    )
    np.testing.assert_array_equal(ideal.sensed.values, empty.sensed.values)
    np.testing.assert_array_equal(ideal.truth.values, empty.truth.values)
    read, through = (gb.measure(ideal.truth, noise="t2", seed=4, sensors=each) for each in (None, gb.SensorChain()))
    assert read.values.tobytes() == through.values.tobytes()


@pytest.mark.parametrize("path", [gb.SensorPath(delay_s=0.055, rate_hz=50.0), gb.SensorPath(filter_hz=5.0)])
def test_a_bank_angle_never_reads_what_lies_between_its_two_ends(path):
    """A roll through 180 deg at 25 deg/s reads as one through 0, moved by 180 deg."""
    chain = gb.SensorChain(paths={"phi": path})
    rolled = np.arange(-100, 101) * 0.25
    through = [
        chain.readings(_wrapped(rolled + middle)[:, None], np.zeros((201, 1)), 0.01, ["phi"]) for middle in (0, 180)
    ]
    assert np.abs(_wrapped(through[1] - 180.0) - through[0]).max() < 1e-9
    assert np.abs(through[1]).min() > 150.0


def _wrapped(angle_deg):
    return (angle_deg + 180.0) % 360.0 - 180.0


def test_the_gtms_chain_is_nasas_and_its_gains_are_flown_there():
    assert GTM.chain.paths["phi"] == gb.SensorPath(rate_hz=50.0, delay_s=0.055, quantum=0.01)
    assert set(GTM.chain.paths) == set(SENSORS)
    assert GTM.autopilot_on("chain") is GTM.chain_autopilot is not GTM.autopilot
    assert GTM.autopilot_on("ideal") is GTM.autopilot
    own = gb.fly_in_loop(duration_s=5.0, sensors="chain")
    stated = gb.fly_in_loop(duration_s=5.0, sensors=GTM.chain, autopilot=GTM.chain_autopilot)
    np.testing.assert_array_equal(own.truth.values, stated.truth.values)


def test_an_estimators_attitude_replaces_the_chains():
    flight = gb.fly_in_loop(duration_s=5.0, sensors="chain", attitude="filter 5 s")
    steps = flight.sensed["phi"] / 0.01
    assert np.abs(steps - np.round(steps)).max() > 0.1  # no steps of 0.01 deg
    assert flight.departed_s is None


def test_a_chain_survives_its_aircrafts_file_and_a_process():
    again = aircraft_of(GTM.folder, facts_of(GTM))
    assert again.chain == GTM.chain
    assert again.chain_autopilot == GTM.chain_autopilot
    assert pickle.loads(pickle.dumps(GTM.chain)) == GTM.chain
    silent = gb.SensorChain(paths={"p": gb.SensorPath(noise=0.0)})
    assert chain_of_table(silent.table) == silent


def test_lateness_is_the_slowest_gyros():
    paths = {"p": gb.SensorPath(delay_s=0.1), "q": gb.SensorPath(filter_hz=16.0), "phi": gb.SensorPath(delay_s=1.0)}
    assert lateness_s(gb.SensorChain(paths=paths)) == pytest.approx(0.1)
    assert lateness_s(gb.SensorChain()) == 0.0


@pytest.mark.parametrize(
    ("table", "said"),
    [
        ({"pp": {}}, "pp"),
        ({"p": {"delay": 0.1}}, "delay"),
        ({"p": {"delay_s": -0.1}}, "chain.p.delay_s"),
        ({"p": {"delay_s": 2.1}}, "chain.p.delay_s"),
        ({"p": {"rate_hz": 0}}, "chain.p.rate_hz"),
        ({"p": {"filter_hz": float("nan")}}, "chain.p.filter_hz"),
        ({"p": {"quantum": "0.1"}}, "chain.p.quantum"),
        ({"p": 3}, "chain.p"),
    ],
)
def test_a_table_that_cannot_be_meant_is_refused_by_its_key(table, said):
    with pytest.raises(gb.InputError, match=said):
        chain_of_table(table)


def test_sensors_that_are_not_there_are_refused():
    with pytest.raises(gb.InputError, match=r"delay_s is -0\.1; it must be a finite number"):
        gb.SensorPath(delay_s=-0.1)
    with pytest.raises(gb.InputError, match=r"chain: no sensor 'pp'; there are p, q"):
        gb.SensorChain(paths={"pp": gb.SensorPath()})
    with pytest.raises(gb.InputError, match="there are ideal, chain"):
        gb.fly_in_loop(duration_s=1.0, sensors="chian")
    with pytest.raises(gb.InputError, match=r"'c172p' has no sensor chain; add a table \[chain\]"):
        gb.fly_in_loop("c172p", duration_s=1.0, sensors="chain")

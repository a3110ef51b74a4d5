"""The sensor chain: what each of its parts does to a motion, in records and in the loop alike."""

import pickle

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.sensor_chain import chain_of_table
from gtmbench.values.channels import SENSORS

PERIOD_S = 0.01


def read(path, motion, noise=None, channel="p"):
    chain = gb.SensorChain(paths={channel: path})
    noise = np.zeros(len(motion)) if noise is None else noise
    return chain.readings(motion[:, None], noise[:, None], PERIOD_S, [channel])[:, 0]


def test_an_empty_chain_is_ideal_to_the_bit():
    truth = gb.fly(duration_s=3.0)
    ideal, chained = (gb.measure(truth, noise="t2", seed=4, sensors=each) for each in (None, gb.SensorChain()))
    assert ideal.values.tobytes() == chained.values.tobytes()
    flown, through = (gb.fly_in_loop(duration_s=3.0, sensors=each) for each in ("ideal", gb.SensorChain()))
    assert flown.sensed.values.tobytes() == through.sensed.values.tobytes()


@pytest.mark.parametrize("delay_s", [0.01, 0.015, 0.055, 0.1])
def test_a_ramp_comes_late_by_the_delay_and_the_filters_time_constant(delay_s):
    """The oracle is the analytic answer of a delay and a first-order filter to a ramp."""
    ramp = 3.0 * np.arange(400) * PERIOD_S
    late_s = delay_s + 1.0 / (2.0 * np.pi * 16.0)
    out = read(gb.SensorPath(delay_s=delay_s, filter_hz=16.0), ramp)
    np.testing.assert_allclose(out[200:], ramp[200:] - 3.0 * late_s, atol=1e-9)


def test_the_filter_halves_the_power_at_its_corner():
    time_s = np.arange(6000) * PERIOD_S
    out = read(gb.SensorPath(filter_hz=4.0), np.sin(2.0 * np.pi * 4.0 * time_s))[1000:]
    # straight lines between samples of 4 Hz at 100 Hz weaken it by 0.5 %
    assert np.std(out) * np.sqrt(2.0) == pytest.approx(np.sqrt(0.5), rel=0.01)


@pytest.mark.parametrize(("rate_hz", "fresh"), [(50.0, 50), (100.0, 100), (1000.0, 100), (30.0, 30), (12.5, 12.5)])
def test_a_slow_sensor_holds_its_last_sample(rate_hz, fresh):
    motion = np.arange(4001.0)
    out = read(gb.SensorPath(rate_hz=rate_hz), motion)
    assert out[0] == 0.0
    assert np.count_nonzero(np.diff(out)) == 40 * fresh
    assert set(out) <= set(motion)
    assert (motion - out).max() <= max(np.ceil(100.0 / rate_hz) - 1.0, 0.0)


def test_readings_are_multiples_of_the_quantum_and_the_noise_is_the_sensors_own():
    random = np.random.default_rng(1)
    out = read(
        gb.SensorPath(quantum=0.25, noise=2.0), np.zeros(20_000), gb.CHANNELS["p"].noise * random.normal(size=20_000)
    )
    np.testing.assert_array_equal(out, 0.25 * np.round(out / 0.25))
    assert np.std(out) == pytest.approx(2.0, rel=0.03)


def test_the_loop_reads_what_a_measured_flight_reads():
    chain = gb.load_aircraft("gtm").chain
    flight = gb.fly_in_loop(duration_s=6.0, seed=5, sensors="chain")
    measured = gb.measure(flight.truth, noise="t2", seed=5, sensors=chain)
    assert measured.values.tobytes() == flight.sensed.values.tobytes()


def test_a_fault_acts_on_the_reading():
    fault = gb.Bias(channel="theta", onset_s=3.0, size=0.5)
    healthy, broken = (gb.fly_in_loop(duration_s=3.1, sensors="chain", faults=each) for each in ((), fault))
    row = 300
    assert broken.sensed["theta"][row] == pytest.approx(healthy.sensed["theta"][row] + 0.5)


def test_the_gtm_flies_on_its_chain_with_gains_for_it():
    """The shipped gains for ideal sensors ring there: twice the pitch rate."""
    gtm = gb.load_aircraft("gtm")
    on_chain = gb.fly_in_loop(duration_s=40.0, sensors="chain")
    ringing = gb.fly_in_loop(duration_s=40.0, sensors="chain", autopilot=gtm.autopilot)
    ideal = gb.fly_in_loop(duration_s=40.0)
    q = {name: np.std(each.truth["q"]) for name, each in (("chain", on_chain), ("ring", ringing), ("ideal", ideal))}
    assert q["chain"] < 1.25 * q["ideal"] < q["ring"]


def test_a_chain_is_plain_values_and_pickles():
    chain = gb.load_aircraft("gtm").chain
    again = chain_of_table(chain.table)
    assert dict(again.paths) == dict(chain.paths) == dict(pickle.loads(pickle.dumps(chain)).paths)
    assert set(chain.paths) == set(SENSORS)


@pytest.mark.parametrize(
    ("make", "said"),
    [
        (lambda: gb.SensorPath(delay_s=-0.1), "delay_s is -0.1; it must be a finite number"),
        (lambda: gb.SensorPath(rate_hz=0), "rate_hz is 0; it must be"),
        (lambda: gb.SensorChain(paths={"pp": gb.SensorPath()}), "chain: no sensor 'pp'; there are p, q"),
        (lambda: chain_of_table({"p": {"late_s": 1.0}}), "unknown key 'late_s' in .chain.p."),
        (lambda: chain_of_table({"p": {"delay_s": "x"}}), "chain.p.delay_s is 'x'"),
        (lambda: gb.fly_in_loop(duration_s=1.0, sensors="chian"), "no sensors 'chian'; .*did you mean 'chain'"),
        (lambda: gb.fly_in_loop("c172x", duration_s=1.0, sensors="chain"), "'c172x' has no sensor chain; add a table"),
    ],
)
def test_bad_input_is_one_line(make, said):
    with pytest.raises(gb.InputError, match=said) as refused:
        make()
    assert "\n" not in str(refused.value)


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

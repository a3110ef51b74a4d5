"""Flights with an autopilot in the loop: the same bits, the same sensors, departures, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.values.channels import SENSORS

GTM = gb.load_aircraft("gtm")
OWN = GTM.autopilot


@pytest.fixture(scope="module")
def healthy():
    return gb.fly_in_loop(duration_s=60.0, seed=4)


def same(one, other):
    return all(
        a.values.tobytes() == b.values.tobytes() for a, b in ((one.truth, other.truth), (one.sensed, other.sensed))
    )


def test_without_gains_it_is_the_open_loop():
    open_loop = gb.fly(excitation="dissertation", duration_s=30.0, seed=4)
    closed = gb.fly_in_loop(excitation="dissertation", duration_s=30.0, seed=4, autopilot=gb.Autopilot())
    assert closed.truth.values.tobytes() == open_loop.values.tobytes()


def test_sensors_read_what_measure_makes_of_the_truth(healthy):
    measured = gb.measure(healthy.truth, noise="t2", seed=4, sensors=GTM.chain)
    assert measured.channels == healthy.sensed.channels == SENSORS
    np.testing.assert_allclose(healthy.sensed.values, measured.values, rtol=0.0, atol=1e-9)
    ideal = gb.fly_in_loop(duration_s=20.0, seed=4, sensors="ideal")
    at_once = gb.measure(ideal.truth, noise="t2", seed=4)
    np.testing.assert_allclose(ideal.sensed.values, at_once.values, rtol=0.0, atol=1e-9)


def test_the_aircrafts_own_autopilot_flies_on_its_chain_and_anybody_elses_on_ideal_sensors():
    assert same(gb.fly_in_loop(duration_s=5.0), gb.fly_in_loop(duration_s=5.0, sensors="chain"))
    on_ideal = gb.fly_in_loop(duration_s=5.0, sensors="ideal")
    assert same(on_ideal, gb.fly_in_loop(duration_s=5.0, autopilot=OWN))
    without_gains = replace(GTM, chain_autopilot=None)
    assert same(on_ideal, gb.fly_in_loop(without_gains, duration_s=5.0))


def test_a_heading_runs_through_north():
    north = replace(GTM, psi_deg=359.5)
    flight = gb.fly_in_loop(north, duration_s=30.0)
    assert flight.truth["psi"].min() < 360.0 < flight.truth["psi"].max()
    measured = gb.measure(flight.truth, noise="t2", seed=1, sensors=GTM.chain)
    np.testing.assert_allclose(flight.sensed.values, measured.values, rtol=0.0, atol=1e-9)


def test_it_returns_to_heading_and_altitude():
    kicked = gb.Excitation(surfaces={"aileron": np.where(np.arange(6001) < 300, 15.0, 0.0)})
    flight = gb.fly_in_loop(excitation=kicked, duration_s=60.0, noise=None)
    assert np.abs(flight.truth["phi"]).max() > 10.0
    assert flight.truth["psi"][-1] == pytest.approx(45.0, abs=0.2)
    assert flight.truth["altitude"][-1] == pytest.approx(8000.0, abs=5.0)


FAULTS = (
    gb.Drift(channel="p", onset_s=3.0, slope=0.5),
    gb.Jam(channel="q", onset_s=2.0, duration_s=2.0),
    gb.Noise(channel="r", onset_s=1.0, deviation=1.0, ramp_s=3.0),
    gb.Bias(channel="theta", onset_s=4.0, size=1.0, intermittent=gb.Intermittent(period_s=1.0, duty=0.3)),
    gb.Swap(channel="p", onset_s=5.0, other="r"),
    gb.Delay(channel="phi", onset_s=0.0, delay_s=0.05),
    gb.Misalignment(channel="q", onset_s=6.0, axis="p", angle_deg=5.0),
)


def test_faults_in_the_loop_do_to_its_readings_what_they_do_to_a_record():
    """The oracle is the array form, put into what sensors read on the flight that came of it."""
    flight = gb.fly_in_loop(duration_s=10.0, faults=FAULTS)
    painted = gb.inject(gb.measure(flight.truth, noise="t2", seed=1, sensors=GTM.chain), FAULTS)
    np.testing.assert_allclose(flight.sensed.values, painted.values, rtol=1e-9, atol=1e-9)


def test_the_same_arguments_give_the_same_bits(healthy):
    assert same(healthy, gb.fly_in_loop(duration_s=60.0, seed=4))
    assert same(*(gb.fly_in_loop(duration_s=10.0, faults=FAULTS) for _ in range(2)))
    other = gb.fly_in_loop(duration_s=60.0, seed=4, noise_seed=5)
    assert not same(healthy, other)
    assert np.std(other.truth["q"] - healthy.truth["q"]) < 0.5 * np.std(healthy.truth["q"])  # the same gusts


def test_before_its_onset_a_fault_is_nothing(healthy):
    broken = gb.fly_in_loop(duration_s=60.0, seed=4, faults=gb.SignFlip(channel="p", onset_s=50.0))
    np.testing.assert_array_equal(broken.truth.values[:5000], healthy.truth.values[:5000])
    assert np.abs(broken.truth["p"] - healthy.truth["p"])[5010:].max() > 0.0


@pytest.mark.parametrize(("channel", "within_s"), [("q", 1.0), ("r", 2.0)])
def test_a_gyro_with_the_wrong_sign_is_a_departure_and_no_error(channel, within_s):
    flight = gb.fly_in_loop(duration_s=40.0, faults=gb.SignFlip(channel=channel, onset_s=20.0))
    departure = flight.events[0]
    assert departure.kind == "departure"
    assert flight.departed_s == departure.time_s
    assert 20.0 < departure.time_s < 20.0 + within_s
    low, high = GTM.departure[departure.channel]
    values = flight.truth[departure.channel]
    beyond = (values < low) | (values > high)
    assert np.flatnonzero(beyond)[0] == round(departure.time_s / 0.01)
    assert departure.value == values[beyond][0]


def test_the_flight_ends_where_the_envelope_does():
    flight = gb.fly_in_loop(duration_s=40.0, faults=gb.Hardover(channel="q", onset_s=20.0, limit=100.0))
    left = flight.events[-1]
    assert left.kind == "envelope"
    low, high = GTM.envelope[left.channel]
    values = flight.truth[left.channel]
    assert flight.truth.end_s == flight.sensed.end_s == left.time_s < 22.0
    assert not low <= values[-1] <= high
    assert ((values[:-1] >= low) & (values[:-1] <= high)).all()


def test_a_missing_reading_holds_the_last_one():
    """As if it were jammed, and the sensed record says that it is missing."""
    gone, jammed = (
        gb.fly_in_loop(duration_s=20.0, faults=kind(channel="q", onset_s=10.0)) for kind in (gb.Dropout, gb.Jam)
    )
    assert gone.truth.values.tobytes() == jammed.truth.values.tobytes()
    assert np.isnan(gone.sensed["q"][1000:]).all()


def test_everything_missing_from_the_first_sample_on_holds_the_trim():
    nothing = [gb.Dropout(channel=channel, onset_s=0.0) for channel in SENSORS]
    flight = gb.fly_in_loop(excitation=gb.Excitation(), duration_s=5.0, faults=nothing)
    assert np.isnan(flight.sensed.values).all()
    np.testing.assert_allclose(flight.truth.values[:, -4:], np.tile(flight.truth.values[0, -4:], (501, 1)), atol=1e-9)


def test_what_the_autopilot_does_not_read_is_said(healthy):
    fault = gb.Bias(channel="beta", onset_s=30.0, size=2.0)
    flight = gb.fly_in_loop(duration_s=60.0, seed=4, faults=fault)
    assert [(event.kind, event.time_s, event.channel) for event in flight.events] == [("out of loop", 30.0, "beta")]
    assert flight.truth.values.tobytes() == healthy.truth.values.tobytes()
    damped_only = replace(OWN, phi_to_aileron=0.0)
    assert not {"phi", "psi"} & set(damped_only.reads)


class Zero:
    """An accommodation that puts 0 in the place of a channel from a time on, and counts what it is shown."""

    def __init__(self, channel, from_s):
        self.column, self.channel, self.from_s = SENSORS.index(channel), channel, from_s

    def start(self, sample_period_s, tell):
        told = False

        def hand_on(time_s, readings):
            nonlocal told
            if time_s < self.from_s:
                return readings
            if not told:
                told = True
                tell(time_s, "accommodated", self.channel, 0.0)
            return [0.0 if i == self.column else value for i, value in enumerate(readings)]

        return hand_on


def test_an_accommodation_stands_between_sensors_and_autopilot():
    flip = gb.SignFlip(channel="q", onset_s=20.0)
    rescue = Zero("q", 20.1)
    first, again = (gb.fly_in_loop(duration_s=40.0, faults=flip, accommodate=rescue) for _ in range(2))
    assert same(first, again)  # it begins anew with each flight
    assert first.departed_s is None
    assert [(event.kind, event.time_s) for event in first.events] == [("accommodated", 20.1)]
    stuck = gb.fly_in_loop(duration_s=40.0, faults=[flip, gb.Stuck(channel="q", onset_s=20.1)])
    assert first.truth.values.tobytes() == stuck.truth.values.tobytes()
    assert np.std(first.sensed["q"][2010:]) > 0.1  # what the sensor read, not what was handed on


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"autopilot": replace(OWN, q_to_elevator_s=-3.0)}, r"the loop throws 'gtm' out of its envelope: .*gains"),
        (
            {"aircraft": replace(GTM, autopilot=None, chain_autopilot=None)},
            r"'gtm' has no autopilot; find its gains by gtmbench aircraft NAME --autopilot",
        ),
        ({"faults": gb.Jam(channel="p", onset_s=99.0)}, r"begins at 99 s, outside"),
        ({"faults": gb.Jam(channel="north", onset_s=1.0)}, r"no channel 'north' can break"),
        ({"faults": ["jam"]}, r"'jam' is no fault"),
        ({"noise": "t3"}, r"no noise 't3'"),
        ({"noise_seed": -1}, r"noise_seed is -1"),
    ],
)
def test_bad_input_is_one_line(wrong, said):
    with pytest.raises(gb.GtmbenchError, match=said) as refused:
        gb.fly_in_loop(**({"duration_s": 20.0} | wrong))
    assert "\n" not in str(refused.value)

"""Broken surfaces: what was commanded, what was driven, and what the aircraft makes of it, whoever flies."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.values.channels import ACTUAL, COMMANDS, SENSORS
from tests.helpers.night import by_day

ONSET_S, ROW = 4.0, 400
KINDS = {
    "jam": gb.Jam,
    "loss of effectiveness": lambda **at: gb.ScaleFactor(**at, factor=0.4),
    "offset": lambda **at: gb.Bias(**at, size=1.5),
    "runaway": lambda **at: gb.Hardover(**at, limit=8.0, rate_limit=20.0),
    "slow servo": lambda **at: gb.Lag(**at, lag_s=0.4),
    "rate limit": lambda **at: gb.RateSaturation(**at, rate_limit=1.0),
    "backlash": lambda **at: gb.Hysteresis(**at, width=2.0),
    "delay": lambda **at: gb.Delay(**at, delay_s=0.2),
}


def at(channel, onset_s=ONSET_S):
    return {"channel": channel, "onset_s": onset_s}


def in_loop(faults=(), *, duration_s=8.0, **how):
    return gb.fly_in_loop("gtm", "doublets+turbulence", duration_s, seed=2, faults=faults, **how)


def test_a_flight_without_a_broken_surface_has_the_bits_it_had_and_no_channel_more():
    healthy, late = in_loop(), in_loop(gb.Jam(**at("rudder", 7.99)))
    assert not set(ACTUAL) & set(healthy.truth.channels)
    assert late.truth.channels == (*healthy.truth.channels, *ACTUAL)
    rows = slice(0, 799)
    np.testing.assert_array_equal(late.truth.values[rows, : -len(ACTUAL)], healthy.truth.values[rows])
    np.testing.assert_array_equal(late.truth.matrix(ACTUAL)[rows], healthy.truth.matrix(COMMANDS)[rows])


@pytest.mark.parametrize(
    ("name", "channel"), by_day([(name, ("elevator", "aileron", "rudder")[i % 3]) for i, name in enumerate(KINDS)], 2)
)
def test_a_surface_does_what_the_kind_makes_of_the_command_in_the_loop_and_without(name, channel):
    """The oracle is the kind's array form on the commands as they were recorded."""
    fault = KINDS[name](**at(channel))
    for truth in (gb.fly("gtm", "multisine", 6.0, seed=2, faults=fault), in_loop(fault, duration_s=6.0).truth):
        commanded = truth.select([channel])
        low, high = gb.load_aircraft("gtm").limits[channel]
        wanted = np.clip(fault.array(commanded), low, high)
        driven = truth[f"{channel}_actual"]
        np.testing.assert_allclose(driven[:-1], wanted[:-1], atol=1e-12)
        assert np.abs(driven - truth[channel])[ROW:].max() > 0.0
        others = [other for other in COMMANDS if other != channel]
        same = truth.matrix([f"{other}_actual" for other in others]) == truth.matrix(others)
        assert same[:-1].all()  # the last command has flown nothing


def test_the_aircraft_follows_the_surface_and_not_the_command():
    """A surface that is driven off flies as one that is commanded so: the same motion to the last bit."""
    offset = gb.Bias(**at("elevator"), size=0.5)
    broken = gb.fly("gtm", "doublets", 8.0, faults=offset)
    simulation = gb.Simulation("gtm", gb.Excitation(), 8.0, noise=None)
    simulation.reset()
    for driven in broken.matrix(ACTUAL)[:-1]:
        simulation.step(driven)
    np.testing.assert_array_equal(simulation.flight().truth.matrix(SENSORS), broken.matrix(SENSORS))
    healthy = gb.fly("gtm", "doublets", 8.0)
    np.testing.assert_array_equal(broken.matrix(SENSORS)[: ROW + 1], healthy.matrix(SENSORS)[: ROW + 1])
    assert np.abs(broken["q"] - healthy["q"])[ROW:].max() > 1.0


def test_a_surface_that_floats_follows_the_flow_it_is_in():
    truth = in_loop(gb.Float(**at("rudder"), flow="beta", ratio=0.5)).truth
    np.testing.assert_allclose(truth["rudder_actual"][ROW:-1], 0.5 * truth["beta"][ROW:-1], atol=1e-12)


def test_a_surface_stops_at_its_stop_and_stays_where_nothing_drives_it():
    runaway = in_loop(gb.Hardover(**at("rudder"), limit=90.0), duration_s=6.0).truth
    assert set(runaway["rudder_actual"][ROW:]) == {gb.load_aircraft("gtm").limits["rudder"][1]}
    cut = in_loop(gb.Dropout(**at("aileron")), duration_s=6.0).truth
    assert set(cut["aileron_actual"][ROW:]) == {cut["aileron"][ROW - 1]}


def test_sensors_and_measurements_never_see_what_a_surface_did():
    flight = in_loop(gb.Jam(**at("elevator")))
    for record in (flight.sensed, flight.readings(commands=True), gb.measure(flight.truth, noise="t2", commands=True)):
        assert not set(ACTUAL) & set(record.channels)
    np.testing.assert_array_equal(flight.readings(commands=True)["elevator"], flight.truth["elevator"])


def test_a_switched_fault_is_the_stated_one_and_a_fork_flies_it_again():
    stated = gb.Simulation("gtm", "turbulence", 8.0, faults=gb.RateSaturation(**at("aileron"), rate_limit=0.5))
    switched = gb.Simulation("gtm", "turbulence", 8.0)
    for simulation in (stated, switched):
        simulation.reset(3)
    level = list(stated.trim.commands.values())
    for row in range(700):
        if row == ROW - 1:
            fault = switched.switch_on(gb.RateSaturation(**at("aileron", 0.0), rate_limit=0.5))
        command = [level[0], level[1] + np.sin(0.05 * row), *level[2:]]
        stated.step(command)
        switched.step(command)
    truths = [simulation.flight().truth for simulation in (stated, switched, switched.fork())]
    assert fault.onset_s == ONSET_S
    for truth in truths[1:]:
        np.testing.assert_array_equal(truth.values, truths[0].values)
    switched.switch_off(fault)
    switched.step(level)
    switched.step(level)
    assert switched.flight().truth["aileron_actual"][-1] == level[1]


def test_a_flight_that_a_broken_surface_throws_ends_there_and_says_no_more():
    thrown = gb.fly("gtm", "turbulence", 60.0, faults=gb.Hardover(**at("elevator"), limit=-30.0))
    assert ONSET_S < thrown.end_s <= 60.0


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (gb.Swap(channel="elevator", onset_s=1.0, other="q"), "it would change 'q' as well, which is a sensor"),
        (gb.Swap(channel="q", onset_s=1.0, other="elevator"), "a sensor doesn't read a command"),
        (gb.Jam(channel="flaps", onset_s=1.0), "no channel 'flaps' can break; there are p, q, r"),
        (gb.Jam(channel="elevator", onset_s=99.0), "begins at 99 s, outside"),
    ],
)
def test_what_no_surface_does_is_refused_in_a_line(fault, said):
    with pytest.raises(InputError, match=said):
        gb.fly_in_loop(duration_s=2.0, faults=fault)


def test_a_record_isnt_turned_into_the_flight_of_a_broken_surface():
    record = gb.measure(gb.fly(duration_s=2.0), noise="t2", commands=True)
    with pytest.raises(InputError, match="makes another flight"):
        gb.inject(record, gb.Jam(channel="elevator", onset_s=1.0))
    with pytest.raises(InputError, match="breaks a sensor, and the truth has none"):
        gb.fly(duration_s=2.0, faults=gb.Jam(channel="q", onset_s=1.0))

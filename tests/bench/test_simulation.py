"""A simulation stepped from outside: the bits of `fly` and `fly_in_loop`, switches by hand, forks, what is refused."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.values.channels import COMMANDS
from tests.helpers.night import by_day

GTM = gb.load_aircraft("gtm")
FAULTS = (
    gb.Drift(channel="p", onset_s=3.0, slope=0.5),
    gb.Jam(channel="q", onset_s=3.0, duration_s=2.0),
    gb.Noise(channel="r", onset_s=3.0, deviation=1.0, ramp_s=2.0),
    gb.Bias(channel="theta", onset_s=3.0, size=1.0, intermittent=gb.Intermittent(period_s=1.0, duty=0.3)),
    gb.Swap(channel="p", onset_s=3.0, other="r"),
    gb.Delay(channel="phi", onset_s=3.0, delay_s=0.05),
    gb.Stuck(channel="psi", onset_s=3.0),
)
HOW = {"ideal": {}, "chain": {"sensors": "chain"}, "estimated": {"attitude": "filter 1 s"}}


def flown(simulation, seed=1, at=None, until_s=10.0):
    """Fly the GTM's own autopilot by hand; `at` is done to the simulation at a time."""
    readings = simulation.reset(seed)
    command = GTM.autopilot.engage(simulation.trim, GTM.limits, 0.01)
    while not simulation.is_over and simulation.time_s < until_s:
        for time_s, do in (at or {}).items():
            if abs(simulation.time_s - time_s) < 1e-9:
                do(simulation)
        readings = simulation.step(command(readings))
    return simulation.flight(command(readings))


def same(one, other):
    return all(
        a.values.tobytes() == b.values.tobytes() for a, b in ((one.truth, other.truth), (one.sensed, other.sensed))
    )


@pytest.mark.parametrize("how", HOW)
def test_an_autopilot_by_hand_flies_the_bits_of_the_loop(how):
    by_hand = flown(gb.Simulation(duration_s=6.0, faults=FAULTS[:2], **HOW[how]), seed=3)
    loop = gb.fly_in_loop(duration_s=6.0, seed=3, faults=FAULTS[:2], autopilot=GTM.autopilot, **HOW[how])
    assert same(by_hand, loop)
    assert by_hand.events == loop.events


def test_trimmed_commands_fly_the_bits_of_an_open_loop():
    simulation = gb.Simulation("gtm", "multisine+turbulence", 10.0)
    simulation.reset(seed=2)
    while not simulation.is_over:
        simulation.step(list(simulation.trim.commands.values()))
    flight = simulation.flight(list(simulation.trim.commands.values()))
    assert flight.truth.values.tobytes() == gb.fly("gtm", "multisine+turbulence", 10.0, 2).values.tobytes()


@pytest.mark.parametrize("how", by_day(HOW))
@pytest.mark.parametrize("fault", by_day(FAULTS, 3), ids=lambda fault: f"{fault.kind} of {fault.channel}")
def test_a_switch_by_hand_gives_the_bits_of_an_onset_known_before(fault, how):
    """At 2.99 s the hand is on the switch; the sample at 3 s is the first broken one."""
    by_hand = flown(
        gb.Simulation(duration_s=5.0, **HOW[how]), at={2.99: lambda now: now.switch_on(replace(fault, onset_s=0.0))}
    )
    assert same(by_hand, flown(gb.Simulation(duration_s=5.0, faults=fault, **HOW[how])))


def test_several_switches_act_one_after_the_other():
    jam, drift = gb.Jam(channel="q", onset_s=2.0), gb.Drift(channel="q", onset_s=1.0, slope=1.0)
    at = {0.99: lambda now: now.switch_on(drift), 1.99: lambda now: now.switch_on(jam)}
    assert same(flown(gb.Simulation(duration_s=4.0), at=at), flown(gb.Simulation(duration_s=4.0, faults=[drift, jam])))


def test_a_rule_switches_on_after_it_first_holds():
    simulation = gb.Simulation(duration_s=5.0)
    bias = gb.Bias(channel="r", onset_s=0.0, size=3.0)
    by_rule = flown(simulation, at={0.0: lambda now: now.switch_on(bias, when=lambda seen: seen.time_s >= 2.0 - 1e-9)})
    assert [fault.onset_s for fault in simulation.faults] == [2.01]
    assert same(by_rule, flown(gb.Simulation(duration_s=5.0, faults=replace(bias, onset_s=2.01))))


def test_switched_off_a_sensor_is_healthy():
    bias = gb.Bias(channel="q", onset_s=1.0, size=2.0)

    def off(simulation):
        (fault,) = simulation.faults
        simulation.switch_off(fault)

    ended = flown(gb.Simulation(duration_s=4.0, faults=bias), at={1.99: off})
    assert same(ended, flown(gb.Simulation(duration_s=4.0, faults=replace(bias, duration_s=1.0))))


def test_a_reset_forgets_what_was_switched_on():
    simulation = gb.Simulation(duration_s=2.0)
    flown(simulation, at={0.5: lambda now: now.switch_on(gb.Jam(channel="p", onset_s=0.0))})
    assert same(flown(simulation, seed=7), flown(gb.Simulation(duration_s=2.0), seed=7))
    assert simulation.faults == ()


@pytest.mark.parametrize("how", HOW)
def test_a_fork_flies_the_same_and_then_otherwise(how):
    """With a switch before the instant, one at it, one after it, and a rule that fires before and one after."""
    at = {
        0.5: lambda now: now.switch_on(gb.Bias(channel="q", onset_s=0.0, size=1.0)),
        0.7: lambda now: now.switch_on(
            gb.Bias(channel="p", onset_s=0.0, size=1.0), when=lambda seen: seen.time_s >= 1.5 - 1e-9
        ),
        0.8: lambda now: now.switch_on(
            gb.Bias(channel="phi", onset_s=0.0, size=1.0), when=lambda seen: seen.time_s >= 2.5 - 1e-9
        ),
        2.0: lambda now: now.switch_on(gb.Jam(channel="r", onset_s=0.0)),
    }
    simulation = gb.Simulation(duration_s=4.0, faults=FAULTS[:1], **HOW[how])
    flight = flown(simulation, seed=5, at=at)
    fork = simulation.fork(2.0)
    assert fork.time_s == 2.0
    assert [fault.channel for fault in fork.faults] == ["p", "q", "p"]
    jam = fork.switch_on(gb.Jam(channel="r", onset_s=0.0))
    for row in range(200, 400):
        fork.step(flight.truth.matrix(COMMANDS)[row])
    again = fork.flight(flight.truth.matrix(COMMANDS)[400])
    np.testing.assert_allclose(again.sensed.values[:201], flight.sensed.values[:201], rtol=0.0, atol=0.0)
    # the commands were recorded with their excitation; this one adds none to surfaces
    assert same(again, flight)
    assert jam in fork.faults
    assert [fault.channel for fault in fork.faults] == [fault.channel for fault in simulation.faults]


def test_a_fork_leaves_its_origin_alone():
    simulation = gb.Simulation(duration_s=3.0)
    simulation.reset(3)
    level = list(simulation.trim.commands.values())
    for _ in range(100):
        simulation.step(level)
    fork = simulation.fork()
    fork.switch_on(gb.Jam(channel="p", onset_s=0.0))
    fork.step([0.0, 5.0, 0.0, 50.0])
    for _ in range(200):
        simulation.step(level)
    alone = gb.Simulation(duration_s=3.0)
    alone.reset(3)
    for _ in range(300):
        alone.step(level)
    assert simulation.faults == ()
    assert same(simulation.flight(), alone.flight())


def test_a_fork_of_an_excited_flight_adds_the_excitation_once():
    simulation = gb.Simulation(excitation="multisine", duration_s=3.0, noise=None)
    flight = flown(simulation)
    fork = simulation.fork(1.5)
    assert fork.flight().sensed.values.tobytes() == flight.sensed.values[:151].tobytes()


def test_truth_is_the_flights():
    simulation = gb.Simulation(duration_s=5.0, excitation="multisine+turbulence")
    flight = flown(simulation, seed=2)
    names = list(simulation.truth)
    np.testing.assert_allclose(list(simulation.truth.values()), flight.truth.matrix(names)[-1], rtol=1e-12, atol=1e-12)
    assert simulation.truth == simulation.truth


def test_it_ends_where_the_envelope_does_and_keeps_what_was_flown():
    simulation = gb.Simulation(duration_s=20.0)
    simulation.reset()
    while not simulation.is_over:
        simulation.step([20.0, 0.0, 0.0, 50.0])
    assert simulation.end == "envelope"
    flight = simulation.flight()
    assert flight.events[-1].kind == "envelope"
    assert flight.truth.end_s == simulation.time_s < 20.0
    with pytest.raises(gb.InputError, match=r"the flight is over at .* \(envelope\); call reset"):
        simulation.step([0.0, 0.0, 0.0, 50.0])
    with pytest.raises(gb.InputError, match="nothing can break any more"):
        simulation.switch_on(FAULTS[0])


def test_an_attitude_that_cannot_be_estimated_ends_it():
    bent = gb.Simulation(
        excitation=gb.Excitation(),
        duration_s=30.0,
        attitude=gb.AttitudeEstimator(time_constant_s=1000.0),
        faults=gb.Bias(channel="q", onset_s=1.0, size=60.0),
    )
    readings = bent.reset()
    while not bent.is_over:
        readings = bent.step(list(bent.trim.commands.values()))
    assert bent.end == "attitude"
    assert np.isnan([readings.phi, readings.theta, readings.psi]).all()
    flight = bent.flight()
    assert len(flight.truth) == len(flight.sensed)
    assert flight.events[-1].channel == "theta"


@pytest.mark.parametrize(
    "commands",
    [[0.0, 0.0, 0.0], [0.0] * 5, [np.nan, 0.0, 0.0, 50.0], [np.inf, 0.0, 0.0, 50.0], [np.inf, -np.inf, 0, 0], None, 3],
)
def test_bad_commands_are_refused_and_fly_nothing(commands):
    simulation = gb.Simulation(duration_s=1.0)
    simulation.reset()
    with pytest.raises(gb.InputError, match="give four finite numbers: elevator"):
        simulation.step(commands)
    assert simulation.time_s == 0.0


def test_bad_input_is_one_line():
    simulation = gb.Simulation(duration_s=1.0)
    with pytest.raises(gb.InputError, match="call reset"):
        simulation.step([0.0] * 4)
    simulation.reset()
    for wrong, said in (
        (lambda: simulation.switch_on("jam"), "is no fault"),
        (lambda: simulation.switch_on(gb.Jam(channel="north", onset_s=0.0)), "no channel .north. can break"),
        (lambda: simulation.switch_on(FAULTS[0], when=3.0), "must be a function"),
        (lambda: simulation.switch_off(FAULTS[0]), "isn't among the faults that are on: none"),
        (lambda: simulation.fork(0.5), "has come to 0 s"),
        (lambda: simulation.fork(-1.0), "at_s"),
        (lambda: simulation.reset(seed=-1), "seed"),
    ):
        with pytest.raises(gb.InputError, match=said):
            wrong()


def test_commands_are_held_within_the_limits():
    simulation = gb.Simulation(duration_s=1.0)
    simulation.reset()
    simulation.step([-1000.0, 1000.0, 0.0, 50.0])
    assert simulation.flight().truth["elevator"][0] == GTM.limits["elevator"][0]
    assert simulation.flight().truth["aileron"][0] == GTM.limits["aileron"][1]


@pytest.mark.parametrize("aircraft", ["gtm", "c172p", "c172x"])
def test_a_later_reset_stands_as_the_first_did(aircraft):
    """The c172x has controls that remember a search."""
    again, fresh = (gb.Simulation(aircraft, duration_s=1.0) for _ in range(2))
    again.reset(1)
    again.reset(2)
    fresh.reset(2)
    for simulation in (again, fresh):
        while not simulation.is_over:
            simulation.step(list(simulation.trim.commands.values()))
    assert same(again.flight(), fresh.flight())
    assert again.trim == fresh.trim

"""Controllers of one's own in the loop: what they get, what they may be, and how one fails."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb

GTM = gb.load_aircraft("gtm")


class Own:
    """The GTM's autopilot, behind the door for others."""

    def start(self, trim):
        self.engaged = GTM.autopilot.engage(trim, GTM.limits, 0.01)

    def command(self, readings, time_s):
        return self.engaged(readings)


def level(*_):
    return [2.66, 0.0, 0.0, 21.0]


@pytest.fixture(scope="module")
def autopilots():
    return gb.fly_in_loop(duration_s=10.0, seed=2, sensors="ideal")


@pytest.mark.parametrize("controller", [Own, Own()], ids=["class", "object"])
def test_our_autopilot_as_a_strangers_flies_the_same_bits(controller, autopilots):
    for _ in range(2):
        flight = gb.fly_in_loop(duration_s=10.0, seed=2, controller=controller)
        np.testing.assert_array_equal(flight.truth.values, autopilots.truth.values)
        np.testing.assert_array_equal(flight.sensed.values, autopilots.sensed.values)


def test_a_function_is_a_controller_and_gets_every_sample_once():
    seen = []

    def command(readings, time_s):
        seen.append((time_s, *readings))
        return np.array([2.66, 0.0, 0.0, 21.0])

    flight = gb.fly_in_loop(duration_s=2.0, controller=command)
    np.testing.assert_array_equal(np.array(seen), np.column_stack([flight.sensed.time_s, flight.sensed.values]))


def test_it_flies_on_the_broken_readings_and_the_excitation_is_added():
    stuck = gb.fly_in_loop(duration_s=2.0, controller=Own, faults=gb.Stuck(channel="q", onset_s=1.0))
    assert stuck.sensed["q"][-1] == stuck.sensed["q"][101]
    moved = gb.fly_in_loop(excitation="multisine", duration_s=2.0, controller=level)
    assert np.ptp(moved.truth["elevator"]) > 0.5


def test_an_accommodation_hands_on_to_it():
    class Blind:
        def start(self, sample_period_s, tell):
            return lambda _, readings: [float("nan")] * len(readings)

    seen = []
    gb.fly_in_loop(duration_s=0.1, accommodate=Blind(), controller=lambda now, _: seen.append(now) or level(now, 0.0))
    assert np.isnan(np.array(seen)).all()
    assert isinstance(seen[0], gb.Readings)


def test_a_fault_of_a_channel_that_it_says_it_does_not_read_is_an_event():
    class Reads(Own):
        reads = ("p",)

    bias = gb.Bias(channel="q", onset_s=1.0, size=1.0)
    assert [event.kind for event in gb.fly_in_loop(duration_s=2.0, controller=Reads, faults=bias).events] == [
        "out of loop"
    ]
    assert gb.fly_in_loop(duration_s=2.0, controller=Own, faults=bias).events == ()


def failing(at_s, how):
    def command(readings, time_s):
        return level(readings, time_s) if time_s < at_s - 1e-9 else how()

    return command


def raises():
    return 1.0 / 0.0


@pytest.mark.parametrize(
    ("how", "said"),
    [
        (lambda: [float("nan"), 0.0, 0.0, 50.0], "commands are [nan, 0.0, 0.0, 50.0]; give four finite numbers"),
        (lambda: [0.0, 0.0, 50.0], "commands are [0.0, 0.0, 50.0]; give four finite numbers"),
        (lambda: None, "commands are None; give four finite numbers"),
        (raises, "ZeroDivisionError: float division by zero"),
    ],
)
def test_one_that_fails_ends_the_flight_and_what_was_flown_is_kept(how, said):
    with pytest.raises(gb.ControllerError) as caught:
        gb.fly_in_loop(duration_s=5.0, controller=failing(1.5, how))
    assert str(caught.value).startswith(f"controller 'command' at 1.5 s: {said}")
    assert "\n" not in str(caught.value)
    whole = gb.fly_in_loop(duration_s=5.0, controller=level)
    kept = caught.value.flight
    assert kept.truth.end_s == kept.sensed.end_s == 1.5
    np.testing.assert_array_equal(kept.sensed.values, whole.sensed.values[:151])


def test_one_that_fails_at_once_has_flown_one_sample():
    class Unready:
        def start(self, trim):
            raise KeyError("policy.zip")

        def command(self, readings, time_s):
            return level(readings, time_s)

    with pytest.raises(
        gb.ControllerError, match=r"controller 'Unready' before the flight: KeyError: 'policy.zip'"
    ) as e:
        gb.fly_in_loop(duration_s=1.0, controller=Unready)
    assert len(e.value.flight.truth) == 1


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        ({"controller": 3}, "controller is 3; give a function of"),
        ({"controller": dict}, "class dict, which has no method command"),
        ({"controller": level, "autopilot": gb.Autopilot()}, "both autopilot and controller are given"),
    ],
)
def test_bad_input_is_one_line(wrong, said):
    with pytest.raises(gb.InputError, match=said):
        gb.fly_in_loop(duration_s=1.0, **wrong)


def test_one_that_throws_the_aircraft_is_told_so():
    with pytest.raises(gb.EnvelopeError, match=r"the loop throws 'gtm' out of its envelope.*check the controller"):
        gb.fly_in_loop(duration_s=20.0, controller=lambda *_: [20.0, 0.0, 0.0, 50.0])


def test_an_aircraft_without_an_autopilot_can_be_flown():
    orphan = replace(GTM, autopilot=None, chain_autopilot=None)
    assert gb.fly_in_loop(orphan, duration_s=1.0, controller=level).events == ()

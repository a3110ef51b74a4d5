"""A flight beside those before it: who is named, who isn't, and why."""

from dataclasses import replace

import pytest

from gtmbench.history.entry import FACTOR, MISALIGNMENT, NOISE, OFFSET
from gtmbench.history.overview import overviews_of
from gtmbench.history.standing import stood
from gtmbench.verdict.timeline import State
from tests.history.flights import AT_REST, flight, flights, usual

SPAN_S = (0.0, 100.0)


def states(standing):
    return {sensor: span.state for sensor, span in standing.claims(SPAN_S)}


def test_no_healthy_airframe_is_accused_and_none_begins_anew():
    for seed in range(12):
        random, means, earlier = flights(seed, 5)
        for number in range(5, 20):
            own = flight(random, number, means)
            standing = stood(earlier, own)
            assert not standing.claims(SPAN_S), standing.apart
            assert not standing.begins
            earlier.append(standing.entered([]))


def test_an_error_from_the_first_sample_on_is_named_with_its_size_and_dated_there():
    random, means, earlier = flights(1, 12)
    off = {("q", OFFSET): 4.1, ("q", AT_REST): 4.1}
    standing = stood(earlier, flight(random, 12, means, off=off))
    ((sensor, span),) = standing.claims(SPAN_S)
    assert (sensor, span.state, span.start_s, span.end_s) == ("q", State.FAILED, *SPAN_S)
    assert span.judgement.kind == "bias"
    assert span.judgement.parameters["size"] == pytest.approx(4.1, abs=0.6)
    low, high = span.judgement.intervals["size"]
    assert low < 4.1 < high
    assert "throughout; in 12 flights before at most" in span.reason


def test_a_factor_may_be_the_gyros_or_the_angles():
    random, means, earlier = flights(2, 15)
    standing = stood(earlier, flight(random, 15, means, off={("p", FACTOR): -0.15}))
    assert states(standing) == {"p": State.SUSPECTED, "phi": State.SUSPECTED}
    judgement = standing.claims(SPAN_S)[0][1].judgement
    assert judgement.parameters["factor"] == pytest.approx(0.85, abs=0.03)


def test_one_gyro_that_is_louder_is_named_and_all_that_are_aren_t():
    random, means, earlier = flights(3, 15)
    alone = stood(earlier, flight(random, 15, means, off={("r", NOISE): 2.0}))
    assert states(alone) == {"r": State.FAILED}
    off = {("r", NOISE): 2.5, ("r", FACTOR): 0.05}  # its noise stands in what the factor is fitted to
    assert states(stood(earlier, flight(random, 15, means, off=off))) == {"r": State.FAILED}
    shaken = stood(earlier, flight(random, 15, means, off={(gyro, NOISE): 2.0 for gyro in "pqr"}))
    assert State.FAILED not in states(shaken).values()
    quieter = stood(earlier, flight(random, 15, means, off={("r", NOISE): -2.0}))
    assert not quieter.claims(SPAN_S)


def test_another_imu_is_a_healthy_cause_and_a_history_begins_with_it():
    for seed in range(30):
        random, means, earlier = flights(seed, 15)
        other = flight(random, 15, usual(random))
        standing = stood(earlier, other)
        assert not {State.FAILED, State.SUSPECTED} & {*states(standing).values()}, standing.explained[0]
        if standing.begins:
            again = stood([*earlier, standing.entered([])], flight(random, 16, means))
            assert again.flights == 1
            assert not again.claims(SPAN_S)


def test_an_imu_that_is_mounted_anew_is_told_and_accuses_nobody():
    random, means, earlier = flights(7, 15)
    off = {("p", f"{MISALIGNMENT} q"): 4.0, ("q", f"{MISALIGNMENT} p"): -4.0, ("r", f"{MISALIGNMENT} p"): 3.0}
    standing = stood(earlier, flight(random, 15, means, off=off))
    assert not standing.claims(SPAN_S)
    assert standing.begins
    assert "mounted anew" in standing.lines[0]


def test_a_gyro_that_another_imu_agrees_with_is_not_named():
    random, means, earlier = flights(8, 15, imus=("", "IMU2"))
    off = {("q", OFFSET): 4.0, ("q", AT_REST): 4.0}
    agrees = stood(earlier, flight(random, 15, means, off=off))
    assert State.FAILED not in states(agrees).values()
    apart = stood(earlier, flight(random, 15, means, off=off | {("q of IMU2", OFFSET): -4.0}))
    assert states(apart) == {"q": State.FAILED}
    second = stood(earlier, flight(random, 15, means, off={("q of IMU2", OFFSET): 4.0}))
    assert states(second) == {"q of IMU2": State.FAILED}


def test_fewer_than_five_flights_are_said_and_name_nobody():
    random, means, earlier = flights(9, 4)
    standing = stood(earlier, flight(random, 4, means, off={("q", OFFSET): 30.0}))
    assert not standing.claims(SPAN_S)
    assert "4 of its flights were judged before, and it takes 5" in standing.lines[0]


def test_a_flight_that_was_another_is_no_part_of_what_later_ones_are_held_against():
    random, means, earlier = flights(10, 12)
    off = {("q", OFFSET): 4.0, ("q", AT_REST): 4.0}
    first = stood(earlier, flight(random, 12, means, off=off)).entered([])
    assert ("q", OFFSET) in first.apart
    assert states(stood([*earlier, first], flight(random, 13, means, off=off))) == {"q": State.FAILED}
    assert not stood([*earlier, first], flight(random, 14, means)).claims(SPAN_S)


def test_other_airframes_and_later_flights_have_no_say():
    random, means, earlier = flights(11, 12)
    others = [flight(random, number, usual(random), airframe="b") for number in range(12)]
    own = flight(random, 12, means)
    later = [flight(random, number, usual(random)) for number in range(13, 25)]
    assert stood([*others, *earlier, own, *later], own).predictions == stood(earlier, own).predictions


def test_a_flight_that_tells_no_constant_is_said_and_hides_nothing():
    """Its log isn't what it is taken for, so nothing was learnt of it."""
    _, _, earlier = flights(1, 8)
    empty = replace(earlier[0], digest="empty", constants=())
    assert not stood(earlier, empty).claims(SPAN_S)
    assert "tells none of the constants" in stood(earlier, empty).lines[0]
    assert stood([], empty).flights == 0
    assert [each.sensor for each in overviews_of([*earlier, empty])]
    assert overviews_of([empty]) == ()

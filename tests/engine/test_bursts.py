"""Moments in which gyro and attitude part: nothing is clear in them, and nobody is named for them."""

import numpy as np
import pytest

from gtmbench.engine.bursts import bursts_of
from gtmbench.engine.judged import judged
from gtmbench.verdict.timeline import State, laid_out
from tests.engine.engine_flights import flight_from
from tests.helpers.turning import from_on, motion, with_error


def said(record):
    return judged(flight_from(record, is_driven=False))


def swinging(size, sensor="q", first_s=50.0, last_s=54.0):
    during = from_on(first_s, size, last_s)
    return with_error(motion(), sensor, lambda time_s: during(time_s) * np.sin(8.0 * time_s))


@pytest.mark.parametrize(("sensor", "axis", "size"), [("q", 1, 6.0), ("theta", 1, 1.0), ("r", 2, 6.0)])
def test_nothing_of_an_axis_is_clear_while_its_gyro_and_attitude_part_for_a_moment(sensor, axis, size):
    found = said(swinging(size, sensor))
    assert found.accused == ()
    timeline = laid_out((0.0, 120.0), found.claims)
    for place, names in enumerate((("p", "phi"), ("q", "theta"), ("r", "psi"))):
        states = {timeline.at(name, at_s).state for name in names for at_s in (50.5, 52.0, 53.5)}
        assert states == {State.NOT_JUDGED if place == axis else State.CLEAR}
        elsewhere = {timeline.at(name, at_s).state for name in names for at_s in (40.0, 65.0)}
        assert sensor != "q" or elsewhere == {State.CLEAR}  # of the others their levels shift, too
    assert sensor != "q" or timeline.at("q", 52.0).reason == "q and the attitude part for a moment"


def test_a_burst_is_dated_to_a_second_and_a_half():
    ((start_s, end_s),) = bursts_of(said(swinging(6.0)).model, 1)
    assert 48.0 <= start_s <= 50.0
    assert 54.0 <= end_s <= 56.0


@pytest.mark.parametrize("seed", range(3))
def test_health_has_no_burst_nor_has_noise_that_is_loud_throughout(seed):
    for record in (motion(seed=seed), motion(seed=seed, noise=20.0)):
        assert [bursts_of(said(record).model, axis) for axis in range(3)] == [[], [], []]


def test_less_than_a_degree_a_second_is_none_however_quiet_it_is_elsewhere():
    quiet = motion(noise=0.1)
    for size, is_told in ((1.1, False), (2.5, True)):  # of a sine, the square root of two is left
        during = from_on(50.0, size, 54.0)
        record = with_error(quiet, "p", lambda time_s, during=during: during(time_s) * np.sin(8.0 * time_s))
        assert bool(bursts_of(said(record).model, 0)) == is_told


def test_what_six_times_the_usual_level_makes_is_one_and_three_times_is_none():
    random = np.random.default_rng(3)
    loud = motion(rate_hz=5.0)
    for times, is_told in ((3.0, False), (30.0, True)):
        error = times * 0.5 * random.standard_normal(len(loud)) * from_on(50.0, 1.0, 53.0)(loud.time_s)
        usual = loud.replace("q", loud["q"] + 0.5 * random.standard_normal(len(loud)))
        assert bool(bursts_of(said(with_error(usual, "q", error)).model, 1)) == is_told


def test_what_a_finding_explains_is_no_burst():
    found = said(with_error(motion(), "q", from_on(60.0, 5.0)))
    assert [sensor for sensor, _ in found.accused] == ["q"]
    assert all(start_s < 62.0 and end_s > 58.0 for start_s, end_s in bursts_of(found.model, 1))  # at its edge alone


def test_an_axis_without_attitude_has_none():
    blind = motion().replace("psi", np.full(len(motion()), np.nan))
    assert bursts_of(said(blind).model, 2) == []

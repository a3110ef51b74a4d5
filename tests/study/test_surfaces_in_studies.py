"""Scenarios whose surfaces break: flown anew open loop as in the loop, scored, and shown."""

import math

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.study.fault_tables import spec_of
from gtmbench.study.flights import fly_setup
from gtmbench.study.scenario import Setup
from tests.helpers.night import by_day

OFFSET = gb.Bias(channel="elevator", onset_s=12.0, size=1.0)
GYRO = gb.Bias(channel="r", onset_s=13.0, size=3.0)


def flown(**setup):
    return fly_setup(
        Setup(excitation="multisine", duration_s=20.0, seed=4, severity_reference_s=(1.0, 10.0), **setup),
        False,
        lambda _: None,
    )


@pytest.mark.parametrize("noise", by_day([{"snr": None, "noise": "t2"}, {"snr": 50.0}]))
def test_a_broken_surface_is_flown_and_its_sensors_have_the_noise_of_the_healthy_record(noise):
    study = flown(**noise)
    injection, healthy = study.broken("mine", spec_of((OFFSET, GYRO), 20.0))
    motion = gb.fly("gtm", "multisine", 20.0, 4, faults=OFFSET)
    np.testing.assert_array_equal(injection.flight.values, motion.values)
    np.testing.assert_allclose(
        healthy.values - motion.matrix(healthy.channels),
        study.sensed(2).values - study.flight.matrix(healthy.channels),
        atol=1e-9,
    )
    np.testing.assert_allclose((injection.record["r"] - healthy["r"])[1300:], 3.0, atol=1e-9)
    np.testing.assert_array_equal(injection.record["q"], healthy["q"])
    assert (injection.channel, injection.unit) == ("elevator", "deg")
    np.testing.assert_allclose(
        injection.broken("elevator")[1200:-1], np.minimum(motion["elevator"] + 1.0, 20.0)[1200:-1]
    )


def test_a_score_tells_nothing_of_samples_that_nobody_read():
    study = flown(snr=None, noise="t2")
    injection, healthy = study.broken("mine", spec_of(OFFSET, 20.0))
    limit = gb.FunctionDetector(lambda record: record.time_s[record["q"] > 1e6][:1], name="limit").calibrate()
    verdict = gb.score(limit.watch(injection.record), fault=OFFSET, healthy=healthy, broken=injection.record)
    assert math.isnan(verdict.altered_share)
    assert not verdict.detected
    assert not verdict.false_alarms


def test_the_scenario_that_ships_breaks_surfaces():
    scenario = gb.load_scenario("surfaces")
    assert scenario.setup.is_in_loop
    assert {spec.channel for spec in scenario.faults} == {"elevator", "aileron", "rudder", "throttle"}

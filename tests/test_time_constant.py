"""The time constant of an attitude's estimator, found from a log: where accelerometers tell it, and nowhere else."""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.attitude import ATTITUDE
from gtmbench.method.time_constant import time_constant_of
from gtmbench.study.log.bending import following_in_log
from gtmbench.testing.flights import fly_once


@cache
def flight():
    truth = fly_once(excitation="doublets+turbulence", duration_s=130.0, seed=7)
    return truth, gb.measure(truth, noise="t2", seed=7)


def estimated(tau, *, by_accelerometers, bias=0.0):
    truth, sensed = flight()
    references = sensed
    for name in ATTITUDE:
        references = references.replace(name, truth[name])
    if by_accelerometers:
        tilt = {
            "phi": np.degrees(np.arctan2(-sensed["ny"], sensed["nz"])),
            "theta": np.degrees(np.arctan2(sensed["nx"], np.hypot(sensed["ny"], sensed["nz"]))),
        }
        for name, angle in tilt.items():
            references = references.replace(name, angle)
    return gb.filtered_attitude(references.replace("p", references["p"] + bias), time_constant_s=tau, seed=7)


@pytest.mark.parametrize("bias", [0.0, 0.5])
@pytest.mark.parametrize("tau", [1.0, 5.0, 20.0])
def test_a_filter_that_accelerometers_correct_is_identified_whatever_the_gyros_bias(tau, bias):
    found = time_constant_of([estimated(tau, by_accelerometers=True, bias=bias)])
    assert abs(found.time_constant_s - tau) < 0.05 * tau
    assert found.deviation_s < 0.05 * tau


@pytest.mark.parametrize("tau", [1.0, 5.0, 20.0])
def test_nothing_is_said_where_something_else_corrects_it(tau):
    assert time_constant_of([estimated(tau, by_accelerometers=False)]) is None


def test_nothing_is_said_of_an_attitude_of_its_own_of_too_little_and_without_accelerometers():
    own = flight()[1]
    driven = estimated(5.0, by_accelerometers=True)
    assert time_constant_of([own]) is None
    assert time_constant_of([driven.between(0.0, 20.0)]) is None
    assert time_constant_of([driven.select(["p", "q", "r", "phi", "theta", "psi"])]) is None
    assert time_constant_of([]) is None


def test_a_log_that_shows_it_is_bent_by_it(tmp_path):
    gb.write_log(estimated(3.0, by_accelerometers=True), tmp_path / "log.csv")
    following = following_in_log(tmp_path / "log.csv", ["q"], attitude="follows")
    assert abs(following.estimator.time_constant_s - 3.0) < 0.15
    assert "its time constant is the log's" in following.why
    assert following_in_log(tmp_path / "log.csv", ["q"], attitude="own").estimator is None
    assert following_in_log(tmp_path / "log.csv", ["nz"]).estimator is None

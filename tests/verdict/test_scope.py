"""What is asked of a log, as people type it."""

import math

import pytest

from gtmbench.errors import InputError
from gtmbench.verdict.scope import Scope, asked_sensors, judge_text

THERE = ["p", "q", "r", "phi", "theta", "tas", "strain_3"]
USUAL = ["p", "q", "r", "phi", "theta", "psi"]
HELD = ["p", "q", "r", "phi", "theta", "tas", "q of IMU2"]  # strain_3 has nothing beside it


@pytest.mark.parametrize(
    ("given", "asked"),
    [
        (None, ["p", "q", "r", "phi", "theta"]),
        ("p,q", ["p", "q"]),
        (" q , p,q", ["q", "p"]),
        ("gyros", ["p", "q", "r"]),
        ("attitude", ["phi", "theta"]),
        ("all", HELD),
        ("q of IMU2", ["q of IMU2"]),
        ("strain_3,gyros", ["strain_3", "p", "q", "r"]),
        (["tas", "p"], ["tas", "p"]),
    ],
)
def test_the_sensors_that_are_asked(given, asked):
    assert list(asked_sensors(given, THERE, USUAL, HELD)) == asked
    if given is not None:
        assert list(asked_sensors(judge_text(given), THERE, USUAL, HELD)) == asked


@pytest.mark.parametrize("given", [None, "gyros"])
def test_a_sensor_is_asked_that_the_log_has_or_that_anything_compares(given):
    assert asked_sensors(given, ["p"], ["p", "q", "r"], ["q"]) == ("p", "q")


@pytest.mark.parametrize("given", ["", "pp", "psi", "p,,q", "gyros,airspeed", ["p", "x"], "p q"])
def test_a_sensor_that_the_log_hasnt_is_named(given):
    with pytest.raises(InputError, match=r"--judge: no sensor '.*' in this log.*there are p, q, r, phi"):
        asked_sensors(given, THERE, USUAL, HELD)


def test_a_group_without_a_sensor_of_the_log_is_refused():
    with pytest.raises(InputError, match="--judge names no sensor of this log"):
        asked_sensors("attitude", ["p", "tas"], USUAL, ["p", "tas"])


@pytest.mark.parametrize(
    ("limits", "sizes"),
    [
        ([], (5.0, 10.0, None)),
        (["2deg/s"], (2.0, 10.0, None)),
        (["3"], (3.0, 10.0, None)),
        (["8deg"], (5.0, 8.0, None)),
        ([" 8 deg ", "0.5 deg/s"], (0.5, 8.0, None)),
        (["factor=0.7", "2deg/s", "1deg/s"], (1.0, 10.0, 0.7)),
        (["factor = 1.5"], (5.0, 10.0, 1.5)),
        (["factor=100", "10000deg", "10000deg/s"], (1e4, 1e4, 100.0)),
    ],
)
def test_limits_as_they_are_typed(limits, sizes):
    scope = Scope(sensors=("p",)).with_limits(limits)
    assert (scope.error_deg_s, scope.error_deg, scope.factor) == sizes
    assert [scope.limit_of(name) for name in ("r", "psi", "tas")] == [*sizes[:2], math.inf]


WRONG = ["0", "0deg/s", "-2deg/s", "-0.0deg", "nan", "NaNdeg", "inf", "infdeg/s", "1e999", "1e-999", "", "deg"]
WRONG += ["5rad/s", "10001deg", "10001deg/s", "factor=101"]
WRONG += ["factor=0", "factor=1", "factor=-1", "factor=nan", "factor=inf", "factor=", "faktor=0.7", "p=2deg/s"]


@pytest.mark.parametrize("text", WRONG)
def test_a_size_that_is_none_is_refused_in_one_line(text):
    with pytest.raises(InputError, match=r"^--limit") as refused:
        Scope(sensors=("p",)).with_limits(["1deg", text])
    assert "\n" not in str(refused.value)

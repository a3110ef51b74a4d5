"""The IMUs beside the one that is watched: each is held against the attitude, and a healthy one is clear."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.imus import Imu
from gtmbench.study.log.imu_comparison import channels_of
from gtmbench.study.log.other_imus import claims_of, of_other_imus
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State
from tests.helpers.turning import motion

UNITS = {"deg/s": 1.0, "rad/s": np.pi / 180.0}
IMUS = [Imu(name=f"IMU{n}", number=n, columns=("x", "y", "z"), unit="deg/s", rate_hz=20.0) for n in (1, 2, 3)]


class SideBySide:
    """The part of a log that is read."""

    def __init__(self, record):
        self.segments, self.channels = (record,), record.channels


def beside(change=lambda gyros, _: gyros, unit="deg/s", is_driven=False, excused_s=()):
    """Return {IMU: what is said of it}: the first is watched, the second changed, the third healthy."""
    record = motion()
    gyros, random = record.matrix(GYROS), np.random.default_rng(7)
    own = [gyros, change(gyros, record.time_s), gyros + 0.1 * random.standard_normal(gyros.shape)]
    imus = [IMUS[0], Imu(name="IMU2", number=2, columns=("x", "y", "z"), unit=unit, rate_hz=20.0), IMUS[2]]
    own[1] = own[1] * UNITS[unit]
    names = [name for imu in imus for name in channels_of(imu)]
    whole = gb.Record(np.hstack([*own, record.matrix(ATTITUDE)]), channels=[*names, *ATTITUDE], sample_period_s=0.05)
    return dict(of_other_imus(SideBySide(whole), imus, "IMU1", is_driven=is_driven, excused_s=excused_s))


def clear_of(said):
    return {gyro for gyro in GYROS if any(span.state is State.CLEAR for span in said.claims[gyro])}


@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("is_driven", [False, True])
def test_healthy_ones_are_clear_whatever_their_unit_and_the_watched_one_is_left_out(unit, is_driven):
    said = beside(unit=unit, is_driven=is_driven)
    assert list(said) == ["IMU2", "IMU3"]
    for each in said.values():
        assert each.changes == ()
        assert clear_of(each) == set(GYROS)


@pytest.mark.parametrize(
    "turned", [lambda g: g[:, [1, 0, 2]] * [1.0, -1.0, 1.0], lambda g: -g, lambda g: g * [1.0, -1.0, -1.0]]
)
def test_one_that_is_mounted_turned_is_not_clear(turned):
    said = beside(lambda gyros, _: turned(gyros))
    assert said["IMU2"].changes
    assert clear_of(said["IMU2"]) <= {"p", "r"}
    assert clear_of(said["IMU3"]) == set(GYROS)


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("size", [-2.0, 1.0])
def test_one_that_steps_is_named_from_when_on(axis, size):
    def stepped(gyros, time_s):
        return gyros + size * np.outer(time_s >= 70.0, np.arange(3) == axis)

    said = beside(stepped, unit="rad/s")
    failed = {gyro: [each for each in said["IMU2"].claims[gyro] if each.state is State.FAILED] for gyro in GYROS}
    assert [gyro for gyro, spans in failed.items() if spans] == [GYROS[axis]]
    (span,) = failed[GYROS[axis]]
    assert (span.start_s, span.end_s) == (pytest.approx(70.0, abs=3.0), pytest.approx(120.0, abs=0.3))
    assert span.judgement.parameters["size"] == pytest.approx(size, abs=0.2)
    assert said["IMU2"].changes == ()  # all that shifted has a name
    assert clear_of(said["IMU2"]) == clear_of(said["IMU3"]) == {*GYROS}  # before it, the one that steps, too


def test_excused_spans_bend_nothing():
    def hit(gyros, time_s):
        return gyros + 100.0 * ((time_s > 40.0) & (time_s < 60.0))[:, np.newaxis]

    said = beside(hit, excused_s=[(39.0, 61.0)])
    assert said["IMU2"].changes == ()


def test_claims_are_of_the_imus_gyros_alone():
    said = beside()["IMU2"]
    claims = list(claims_of("IMU2", said))
    assert {sensor for sensor, _ in claims} == {f"{gyro} of IMU2" for gyro in GYROS}
    assert [span for sensor, span in claims if sensor == "q of IMU2"] == list(said.claims["q"])

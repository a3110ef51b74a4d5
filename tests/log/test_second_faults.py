"""A second gyro's fault is named beside the first, with its size; none where there is none, and nothing in health."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Judgement
from gtmbench.log.judging.second_faults import _about, _first_named, _without, second_faults
from gtmbench.values.channels import GYROS
from tests.helpers import monitors
from tests.helpers.night import by_day

SAMPLES = 4000  # 80 s


@cache
def healthy(seed=31):
    return monitors.record(SAMPLES, seed=seed)


def bias(channel, onset_s, size):
    return gb.Bias(channel=channel, onset_s=onset_s, size=size)


def found(*faults, seed=31, wanted=GYROS):
    """Return (sensor, onset, size) of what is told beside the first, and whom the first watch names.

    `wanted`: who parts from the attitude, where any breaks, or else in the middle.
    """
    record = healthy(seed)
    for fault in faults:
        record = gb.inject(record, fault)
    watch = monitors.monitor().watch(record)
    times_s = [fault.onset_s for fault in faults] or [40.0]
    later = second_faults(monitors.monitor(), [watch], None, dict.fromkeys(wanted, times_s))
    told = [(each.sensor, each.onset_s, each.last.parameters.get("size")) for each in later]
    return told, {each.sensor for each in watch.faults}


@pytest.mark.parametrize("seed", [31, 32])
def test_nothing_is_told_in_health(seed):
    assert found(seed=seed) == ([], set())


@pytest.mark.parametrize("sensor", by_day(["p", "q", "r"]))
def test_nothing_is_told_beside_a_fault_that_is_alone(sensor):
    told, named = found(bias(sensor, 30.0, 4.0))
    assert named == {sensor}
    assert told == []


@pytest.mark.parametrize(("first", "second"), by_day([("p", "q"), ("q", "r"), ("r", "p")]))
@pytest.mark.parametrize("apart_s", by_day([20.0, 28.0]))
def test_a_second_gyro_is_named_with_its_size(first, second, apart_s):
    told, named = found(bias(first, 30.0, 4.0), bias(second, 30.0 + apart_s, -5.0))
    assert first in named
    assert [sensor for sensor, _, _ in told] == [second]
    assert told[0][1] == pytest.approx(30.0 + apart_s, abs=1.0)
    assert told[0][2] == pytest.approx(-5.0, abs=0.7)


@pytest.mark.nightly
def test_three_faults_are_named_one_after_another():
    told, _ = found(bias("p", 20.0, 4.0), bias("q", 40.0, -5.0), bias("r", 60.0, 6.0))
    assert [(sensor, pytest.approx(size, abs=0.7)) for sensor, _, size in told] == [("q", -5.0), ("r", 6.0)]


@pytest.mark.nightly
@pytest.mark.parametrize(("wanted", "expected"), by_day([({"r"}, ["r"]), ({"p"}, [])]))
def test_only_those_are_told_that_are_wanted(wanted, expected):
    told, _ = found(bias("p", 20.0, 4.0), bias("q", 40.0, -5.0), bias("r", 60.0, 6.0), wanted=wanted)
    assert [sensor for sensor, _, _ in told] == expected


def test_a_gyro_that_failed_first_is_told_no_second_time():
    told, _ = found(bias("q", 30.0, 4.0), bias("q", 55.0, 4.0))
    assert [sensor for sensor, _, _ in told] == []


def test_a_fault_of_an_angle_hides_nothing_by_a_gyros_prediction():
    told, named = found(bias("theta", 30.0, 8.0))
    assert "p" not in named
    assert told == []


def named(sensor, onset_s):
    judgement = Judgement(time_s=onset_s + 2.0, sensor=sensor, candidates=(sensor,), kind="bias")
    return gb.Alarm(number=0, time_s=onset_s + 1.0, onset_s=onset_s, source=sensor, judgements=(judgement,))


def test_another_is_named_that_begins_three_seconds_later_within_two_minutes_of_where_a_gyro_parts():
    first = named("p", 500.0)
    for onset_s, is_told in ((502.9, False), (503.1, True)):
        other = named("q", onset_s)
        assert _first_named(SimpleNamespace(faults=[first, other]), [first]) is (other if is_told else None)
    assert _about(first, {"p": (300.0,), "q": (800.0, 370.0)}) == [(380.0, 620.0), (680.0, 920.0)]
    watch = monitors.monitor().watch(healthy())
    instead = _without(watch, named("p", 30.0))
    assert instead.time_s[np.argmax(instead["p"] != healthy()["p"])] == pytest.approx(29.0, abs=0.03)


def test_a_monitor_that_predicts_nothing_tells_nothing():
    monitor = gb.FunctionDetector(lambda record: record.time_s[100:101], channels=("p",)).calibrate()
    assert second_faults(monitor, [monitor.watch(healthy())], None, dict.fromkeys(GYROS, (40.0,))) == ()

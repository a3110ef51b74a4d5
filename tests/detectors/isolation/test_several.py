"""Several sensors hit at once: all of them are told, no healthy one is, and one fault is never told as several."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Judgement
from gtmbench.detectors.isolation.several import _large, _Part
from gtmbench.detectors.isolation.standing import quantum_of
from gtmbench.report.words.judgement import judgement_text
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers.monitors import monitor, record
from tests.helpers.night import by_day

ONSET_S = 60.0
AT = {"onset_s": ONSET_S}
SIZES = dict(zip(GYROS, (1.0, 0.8, 1.3), strict=True))


def healthy():
    return record(9000, seed=11)


def broken_by(make, channels=GYROS):
    """Break some channels of a healthy record, each by what `make` gives of it."""
    broken = healthy()
    for channel in channels:
        broken = gb.inject(broken, make(channel))
    return broken


def watched(broken):
    """Return the faults that are told of a record."""
    return monitor("C").watch(broken).faults


def failed(faults):
    return {name for alarm in faults if alarm.last is not None for name in alarm.last.failed}


def tone(channel):
    return gb.Oscillation(channel=channel, amplitude=2.0 * SIZES[channel], frequency_hz=12.0, **AT)


CAUSES = {
    "drift": lambda channel: gb.Drift(channel=channel, slope=0.2 * SIZES[channel], **AT),
    "oscillation": tone,
    "noise": lambda channel: gb.Noise(channel=channel, deviation=4.0, seed=ord(channel), **AT),
    "jam": lambda channel: gb.Jam(channel=channel, duration_s=0.8, **AT),
    "stale": lambda channel: gb.Stale(channel=channel, hold_s=0.1, **AT),
}


@pytest.mark.parametrize("kind", by_day(CAUSES))
def test_what_hits_all_gyros_is_told_of_all_and_of_no_angle(kind):
    faults = watched(broken_by(CAUSES[kind]))
    (alarm,) = (each for each in faults if each.is_of_several)
    assert failed(faults) == set(GYROS)
    assert alarm.last.kind == kind
    assert {judged.sensor for judged in alarm.last.together} == set(GYROS)
    assert alarm.sensor is None
    assert alarm.isolated_s > ONSET_S
    assert alarm.accuses


def test_rows_that_a_logger_repeats_are_told_of_all_channels():
    before = healthy()
    rows = np.arange(len(before))
    since = int(ONSET_S / before.sample_period_s)
    held = np.where(rows < since, rows, since + (rows - since) // 4 * 4)
    repeated = before
    for name in (*GYROS, *ATTITUDE):
        repeated = repeated.replace(name, before[name][held])
    faults = watched(repeated)
    assert failed(faults) == {*GYROS, *ATTITUDE}
    parameters = faults[0].last.together[0].parameters
    assert faults[0].last.kind == "stale"
    assert parameters["hold_s"] == pytest.approx(4 * before.sample_period_s, rel=0.02)


@pytest.mark.nightly
def test_what_is_rounded_is_told_of_all_channels():
    quanta = dict.fromkeys(GYROS, 0.5) | dict.fromkeys(ATTITUDE, 0.25)
    faults = watched(
        broken_by(lambda name: gb.Quantisation(channel=name, quantum=quanta[name], **AT), (*GYROS, *ATTITUDE))
    )
    assert failed(faults) == {*GYROS, *ATTITUDE}
    assert {judged.sensor: judged.parameters["quantum"] for judged in faults[0].last.together} == pytest.approx(quanta)


@pytest.mark.parametrize("apart_s", by_day([0.0, 0.5, 8.0]))
def test_two_gyros_are_both_told_whenever_the_second_follows(apart_s):
    first = gb.Bias(channel="p", size=2.0, **AT)
    broken = gb.inject(gb.inject(healthy(), first), gb.Bias(channel="q", size=-1.5, onset_s=ONSET_S + apart_s))
    faults = watched(broken)
    assert failed(faults) == {"p", "q"}
    named = {each.sensor: each for alarm in faults for each in (alarm.last.together or (alarm.last,))}
    assert named["p"].parameters["size"] == pytest.approx(2.0, abs=0.1)
    assert named["q"].parameters["size"] == pytest.approx(-1.5, abs=0.1)


@pytest.mark.parametrize("size_deg", by_day([5.0, -12.0]))
def test_of_a_gyro_and_its_own_angle_no_other_axis_is_named(size_deg):
    both = gb.inject(healthy(), gb.Bias(channel="q", size=3.0, **AT))
    faults = watched(gb.inject(both, gb.Bias(channel="theta", size=size_deg, **AT)))
    assert faults
    assert failed(faults) <= {"q", "theta"}
    assert {name for alarm in faults for name in alarm.candidates} & {"q", "theta"}


@pytest.mark.parametrize("gyro", by_day(GYROS))
def test_a_gyro_and_its_own_angle_that_both_stand_still_are_both_told(gyro):
    angle = ATTITUDE[GYROS.index(gyro)]
    both = gb.inject(healthy(), gb.Jam(channel=gyro, **AT))
    faults = watched(gb.inject(both, gb.Jam(channel=angle, **AT)))
    assert failed(faults) == {gyro, angle}


SINGLES = {
    "bias": lambda channel: gb.Bias(channel=channel, size=3.0, **AT),
    "drift": lambda channel: gb.Drift(channel=channel, slope=0.5, **AT),
    "scale_factor": lambda channel: gb.ScaleFactor(channel=channel, factor=1.5, **AT),
    "jam": lambda channel: gb.Jam(channel=channel, **AT),
    "noise": lambda channel: gb.Noise(channel=channel, deviation=3.0, seed=3, **AT),
    "oscillation": lambda channel: gb.Oscillation(channel=channel, amplitude=3.0, frequency_hz=1.5, **AT),
    "quantisation": lambda channel: gb.Quantisation(channel=channel, quantum=2.0, **AT),
}


@pytest.mark.parametrize("kind", by_day(SINGLES, 2))
@pytest.mark.parametrize("channel", by_day([*GYROS, *ATTITUDE], 2))
def test_one_fault_is_never_told_as_several(channel, kind):
    faults = watched(gb.inject(healthy(), SINGLES[kind](channel)))
    assert faults
    assert not any(alarm.is_of_several for alarm in faults)
    assert failed(faults) <= {channel}


@pytest.mark.parametrize("fault", by_day([SINGLES["noise"]("p"), tone("p")]), ids=["noise", "tone"])
def test_a_fault_that_reads_anything_ends_and_the_next_of_that_gyro_is_told(fault):
    first = replace(fault, duration_s=10.0)
    faults = watched(gb.inject(gb.inject(healthy(), first), gb.Bias(channel="p", size=2.0, onset_s=82.0)))
    assert [alarm.sensor for alarm in faults] == ["p", "p"]
    assert faults[0].ended_s == pytest.approx(ONSET_S + 10.0, abs=0.5)
    assert faults[0].end_known_s < 82.0
    assert faults[1].last.kind == "bias"


def test_several_are_told_in_words_each_with_its_own_kind():
    broken = gb.inject(healthy(), gb.Bias(channel="p", size=2.0, **AT))
    (alarm,) = watched(gb.inject(broken, gb.Drift(channel="r", slope=0.3, **AT)))
    text = judgement_text(alarm.last)
    assert text.startswith("p and r failed")
    assert "p: bias 2.00 ± 0.02 deg/s, from 60.0" in text
    assert "r: drift 0.30" in text


@pytest.mark.parametrize(("quantum", "noise"), [(0.1, 0.05), (3.0, 1.0), (0.25, 0.3)])
def test_a_quantum_is_found_in_readings_and_in_no_others(quantum, noise):
    readings = noise * np.random.default_rng(1).standard_normal(2000) + np.sin(np.arange(2000) / 80.0)
    assert quantum_of(readings) is None
    assert quantum_of(np.round(readings / quantum) * quantum) == pytest.approx(quantum)


@pytest.mark.parametrize(
    ("gains", "kept"),
    [
        ({"p": 1000.0, "q": 10.0}, {"p"}),
        ({"p": 10.0, "q": 1000.0}, {"q"}),
        ({"p": 30.0, "q": 1000.0}, {"p", "q"}),
        ({"p": -5.0}, {"p"}),
        ({"p": 0.0, "q": 0.0}, {"p", "q"}),
    ],
)
def test_a_small_share_is_left_out_and_something_always_stays(gains, kept):
    told = Judgement(time_s=1.0, sensor=None, candidates=("p",))
    assert set(_large({output: _Part(told, gain) for output, gain in gains.items()})) == kept

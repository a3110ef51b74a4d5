"""A decided alarm stops computing, in a stream as at once; what noise may be told; fast ways give what slow ones do."""

from dataclasses import dataclass
from functools import cache
from unittest.mock import patch

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.isolation import noise
from gtmbench.detectors.monitor import open_fault_review
from gtmbench.values.attitude_estimators import AttitudeEstimator
from tests.helpers import monitors
from tests.helpers.night import by_day

ONSET_S, PERIOD_S = 60.0, 0.02


@dataclass(frozen=True, kw_only=True)
class Bursts(gb.Fault):
    """A tone for 0.6 s, every 2.5 s."""

    kind = "bursts"
    amplitude: float

    def distort(self, readings, elapsed_s, _sample_period_s, carried):
        tone = self.amplitude * np.sin(8.0 * np.pi * elapsed_s)
        return readings[:, 0] + np.where(elapsed_s % 2.5 < 0.6, tone, 0.0), carried


@cache
def broken(fault):
    return gb.inject(monitors.record(7000, seed=23), fault)


def ranked(fault):
    """The first alarm of a fault, and how often its hypotheses were weighed."""
    weighed = []

    def counting(case, *given):
        weighed.append(case.end_s)
        return review_ranked(case, *given)

    review_ranked = open_fault_review.ranked_hypotheses
    with patch.object(open_fault_review, "ranked_hypotheses", counting):
        alarm = monitors.monitor("C").watch(broken(fault)).faults[0]
    return alarm, [time_s - alarm.time_s for time_s in weighed]


def test_a_decided_alarm_is_weighed_no_more():
    alarm, after_s = ranked(gb.Lag(channel="q", onset_s=ONSET_S, lag_s=0.3))
    assert (alarm.sensor, alarm.last.kind) == ("q", "lag")
    assert max(after_s) < 21.0
    assert len(alarm.judgements) == len(after_s) + 1  # the first stands on the signature


def test_a_sensor_that_reads_one_value_is_looked_at_to_the_end():
    alarm, after_s = ranked(gb.Stuck(channel="r", onset_s=ONSET_S, value=2.0))
    assert alarm.sensor == "r"
    assert max(after_s) == pytest.approx(60.0, abs=0.1)


def test_the_end_of_a_decided_fault_is_found():
    fault = gb.ScaleFactor(channel="p", onset_s=ONSET_S, factor=1.6, duration_s=30.0)
    alarm, _ = ranked(fault)
    assert alarm.sensor == "p"
    assert alarm.ended_s == pytest.approx(ONSET_S + 30.0, abs=1.0)


@pytest.mark.nightly
@pytest.mark.parametrize(
    "fault",
    by_day([gb.Lag(channel="q", onset_s=ONSET_S, lag_s=0.3), gb.Stuck(channel="r", onset_s=ONSET_S, value=2.0)]),
    ids=["decided", "to the end"],
)
def test_an_alarm_says_when_it_is_judged_again_until_it_is_decided(fault):
    record, stream = broken(fault), monitors.monitor("C").stream()
    announced, judged = {}, {}
    for part in (record.between(first_s, first_s + 0.5 - 0.5 * PERIOD_S) for first_s in np.arange(0.0, 140.0, 0.5)):
        for alarm in stream.push(part):
            assert alarm.looks_again_s is None or alarm.looks_again_s > part.end_s
            announced.setdefault(alarm.number, []).append(alarm.looks_again_s)
            judged[alarm.number] = [each.time_s for each in alarm.judgements[1:]]
    first = next(alarm for alarm in stream.alarms if alarm.is_first)
    times_s = announced[first.number]
    assert set(judged[first.number]) <= set(times_s)
    assert times_s[-1] is None
    assert None not in times_s[:-1]  # nothing is said after it is decided, or after the last look
    at_once = next(alarm for alarm in monitors.monitor("C").watch(record).alarms if alarm.is_first)
    assert [each.time_s for each in at_once.judgements[1:]] == judged[first.number]


@pytest.mark.parametrize("channel", ["p", "phi"])
def test_bursts_of_a_tone_are_an_oscillation_or_of_no_kind(channel):
    alarm, _ = ranked(Bursts(channel=channel, onset_s=ONSET_S, amplitude=6.0 if channel == "p" else 1.0))
    assert alarm.sensor in (channel, None)
    assert channel in alarm.candidates
    assert alarm.last.kind in ("oscillation", "unknown")


def test_an_angle_that_steps_twice_is_of_no_kind():
    fault = gb.Bias(channel="phi", onset_s=40.0, size=1.5)
    record = gb.inject(
        gb.inject(monitors.record(5000, seed=23), fault), gb.Bias(channel="phi", onset_s=44.0, size=25.0)
    )
    alarm = monitors.monitor("C").watch(record).faults[0]
    assert (alarm.sensor, alarm.last.kind) == ("phi", "unknown")  # a random walk of such steps has another spectrum


@pytest.mark.nightly
def test_noise_that_explains_a_little_of_every_axis_accuses_none_of_another():
    """A heading with two faults in a row stirs all three axes, which noise of theta explains best."""

    def flight(seed, excitation, duration_s):
        return gb.measure(gb.fly("gtm", excitation, duration_s, seed), noise="t2", seed=seed)

    monitor = gb.calibrate([flight(seed, "multisine+turbulence", 100.0) for seed in (1, 2, 3)], bank=gb.load_bank("C"))
    healthy = flight(530_002, "dissertation+turbulence", 85.0)
    broken = gb.inject(healthy, gb.Bias(channel="psi", onset_s=50.0, size=1.5))
    broken = gb.inject(broken, gb.ScaleFactor(channel="psi", onset_s=58.0, factor=1.25))
    judged = [each for alarm in monitor.watch(broken).faults for each in alarm.judgements]
    assert {each.sensor for each in judged} <= {"psi", None}
    assert any("psi" in each.candidates for each in judged)


@pytest.mark.parametrize("bias_s", [np.inf, 16.0])
def test_a_bend_of_all_rows_at_once_is_that_row_by_row(bias_s):
    estimator = AttitudeEstimator(time_constant_s=5.0, bias_time_constant_s=bias_s)
    record = monitors.record(4000, seed=5)
    gyros, attitude = (record.matrix(names) for names in (("p", "q", "r"), ("phi", "theta", "psi")))
    change = np.where(np.arange(4000)[:, np.newaxis] > 1000, [2.0, 0.0, 0.5], 0.0)
    given = np.full(3999, PERIOD_S), gyros, gyros + change, attitude, record.time_s
    at_once = estimator.bent_path(*given)
    with patch.object(AttitudeEstimator, "_bend", lambda *_: None):
        by_row = estimator.bent_path(*given)
    assert np.abs(by_row - attitude).max() > 1.0
    assert np.abs(at_once - by_row).max() < 1e-9


def test_a_spectrum_without_a_line_fits_nothing():
    """In a real log a fault began where all samples of a residual were missing."""
    spectra = noise._Spectra.of(np.ones((1, 4)), np.ones((1, 4)))
    assert spectra.misfits(np.zeros((1, 4)), np.zeros((1, 4)), np.array([0])) == [np.inf]
    assert spectra.misfits(np.ones((1, 4)), np.full((1, 4), 2.0), np.array([0])) < np.inf

"""Scoring: alarms and norms made by hand, with verdicts that can be read off."""

import numpy as np
import pytest

from gtmbench.bench.faults import Drift
from gtmbench.method.alarms import Alarms
from gtmbench.method.residual import WindowedNorm
from gtmbench.record import Record
from gtmbench.study.score import score

# a second a sample; E(k) needs k..k+2 and one sample of look-ahead, so it is known 3 s after k
SAMPLES, ONSET_S, THRESHOLD = 20, 10.0, 2.0
KNOWN_AFTER_S = 3
HEALTHY = np.linspace(1.0, 2.0, SAMPLES)


def verdict(
    alarms_s=(),
    norm=1.0,
    *,
    altered=range(10, SAMPLES),
    duration_s=None,
    onset_s=ONSET_S,
    healthy=HEALTHY,
    channel="p",
):
    """Score alarms at those times, a norm (a number, or one a sample) and a fault that altered those samples."""
    raised = Alarms(
        time_s=np.array(alarms_s, dtype=float), armed_s=0.0, threshold=THRESHOLD, look_ahead_s=1.0, window_s=3.0
    )
    values = np.full(SAMPLES, norm) if np.isscalar(norm) else np.array(norm, dtype=float)
    watched = WindowedNorm(
        values=values, time_s=np.arange(float(SAMPLES)), window=2, look_ahead_s=1.0, sample_period_s=1.0
    )
    changed = healthy.copy()
    changed[list(altered)] += 0.5
    fault = Drift(channel=channel, onset_s=onset_s, duration_s=duration_s, slope=1.0)
    before, after = (Record(y, channels=[channel], sample_period_s=1.0) for y in (healthy, changed))
    return score(raised, watched, fault=fault, healthy=before, broken=after, channels=("p", "r"))


def one_window(k, value):
    """Return a norm that is low but for window k."""
    norm = np.full(SAMPLES, 0.5)
    norm[k] = value
    return norm


def test_an_alarm_at_the_very_onset_is_a_detection_without_delay():
    result = verdict([ONSET_S])
    assert (result.detected, result.alarm_time_s, result.detection_delay_s) == (True, 10.0, 0.0)
    assert (result.false_alarms, result.reason) == (0, "")


def test_an_alarm_before_the_onset_is_a_false_one_and_no_detection():
    result = verdict([9.0])
    assert (result.detected, result.false_alarms) == (False, 1)
    assert (result.alarm_time_s, result.detection_delay_s) == (None, None)
    assert result.reason


def test_the_first_alarm_after_the_onset_counts_and_those_before_are_false():
    result = verdict([4.0, 9.0, 12.5, 15.0])
    assert (result.detected, result.alarm_time_s, result.detection_delay_s) == (True, 12.5, 2.5)
    assert result.false_alarms == 2


def test_a_delay_comes_with_the_parts_that_are_the_methods():
    result = verdict([14.0])
    assert (result.detection_delay_s, result.look_ahead_s, result.window_s) == (4.0, 1.0, 3.0)


def test_rounding_of_times_makes_no_false_alarm():
    """0.1 + 0.2 is a hair more than 0.3: an alarm at the onset is one, however its time was added up."""
    assert verdict([0.3], onset_s=0.1 + 0.2).detection_delay_s == 0.0


def test_a_norm_that_stood_above_since_before_the_onset_has_missed_the_fault():
    """The alarm of the transient can't be had twice: no crossing after the onset, no detection."""
    result = verdict([5.0], norm=3.0)
    assert not result.detected
    assert result.false_alarms == 1
    assert result.peak_ratio == 1.5
    assert result.reason == "the norm stood above the threshold since before the onset"


def test_a_fault_that_changed_no_sample_says_so():
    result = verdict(altered=())
    assert (result.detected, result.altered_share) == (False, 0.0)
    assert result.reason == "the fault changed no sample"


@pytest.mark.parametrize("channel", ["p", "q", "r"])
def test_a_fault_on_a_channel_the_operator_doesnt_use_says_so(channel):
    """What an operator doesn't look at can't be found by it: no wonder, and no near miss."""
    blind = verdict(channel=channel).reason == "the detector doesn't use this channel"
    assert blind == (channel == "q")


def test_a_missed_fault_says_how_near_it_came():
    assert verdict(norm=1.7).reason == "the norm reached 85 % of the threshold"


def test_the_peak_counts_windows_known_at_or_after_the_onset_only():
    first = int(ONSET_S) - KNOWN_AFTER_S
    assert verdict(norm=one_window(first - 1, 1.8)).peak_ratio == 0.25
    assert verdict(norm=one_window(first, 1.8)).peak_ratio == 0.9
    assert verdict(norm=one_window(SAMPLES - 1, 1.8)).peak_ratio == 0.9


def test_missing_windows_leave_the_peak_alone():
    assert verdict(norm=one_window(12, np.nan)).peak_ratio == 0.25


def test_a_fault_after_the_last_window_was_never_watched():
    norm = np.full(SAMPLES, 1.0)
    norm[7:] = np.nan
    result = verdict(norm=norm)
    assert (result.detected, result.peak_ratio) == (False, 0.0)
    assert result.reason == "no complete window ends after the onset"


@pytest.mark.parametrize(("altered", "share"), [(range(10, 20), 1.0), (range(10, 15), 0.5), ([13], 0.1), ([], 0.0)])
def test_the_altered_share_is_of_the_samples_after_the_onset(altered, share):
    assert verdict(altered=altered).altered_share == pytest.approx(share)


def test_the_altered_share_is_of_the_samples_before_the_faults_end():
    assert verdict(altered=[10, 11], duration_s=4.0).altered_share == 0.5


def test_a_sample_that_was_missing_before_isnt_altered():
    holed = HEALTHY.copy()
    holed[12:14] = np.nan
    result = verdict(altered=(), healthy=holed)
    assert result.altered_share == 0.0
    assert result.reason == "the fault changed no sample"


def test_a_detected_fault_needs_no_reason_whatever_its_norm():
    for norm in (0.1, 3.0):
        assert verdict([11.0], norm=norm).reason == ""

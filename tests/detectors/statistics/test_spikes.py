"""Spikes: rare and large samples are found, a tail that is always heavy isn't, and chunks change nothing."""

import numpy as np
import pytest
from scipy import stats

import gtmbench as gb
from gtmbench.detectors.statistics.spikes import THRESHOLD, _surprise, spike_scores
from gtmbench.detectors.statistics.whitening import loud_in
from tests.helpers import monitors

PERIOD_S, LOOKS_BACK = 0.01, 8000


def greatest(values):
    """Return the greatest score of whitened samples."""
    scores = list(spike_scores(loud_in(values), PERIOD_S, LOOKS_BACK, range(len(values))))
    return max(float(np.fmax.reduce(score.values, initial=0.0)) for score in scores)


def with_spikes(rate_hz, since_s, seconds=200.0, seed=1):
    random = np.random.default_rng(seed)
    values = random.standard_normal(round(seconds / PERIOD_S))
    since = np.arange(len(values)) * PERIOD_S >= since_s
    return values + 6.0 * since * (random.random(len(values)) < rate_hz * PERIOD_S)


@pytest.mark.parametrize("rate_hz", [0.5, 1.0, 3.0])
def test_spikes_that_begin_are_found(rate_hz):
    assert greatest(with_spikes(rate_hz, 120.0)) > THRESHOLD


@pytest.mark.parametrize("rate_hz", [0.02, 0.5, 3.0])
def test_spikes_that_were_always_there_tell_nothing(rate_hz):
    assert max(greatest(with_spikes(rate_hz, 0.0, 300.0, seed)[8000:]) for seed in range(4)) < THRESHOLD


@pytest.mark.parametrize("seed", range(6))
def test_normal_noise_and_one_burst_are_no_spikes(seed):
    values = with_spikes(0.0, 0.0, 300.0, seed)
    assert greatest(values) < 0.7 * THRESHOLD
    values[15_000:15_300] *= 8.0  # three seconds of whatever
    assert greatest(np.where(np.arange(len(values)) % 5, values, 0.0)) < 4.0 * THRESHOLD


def test_the_score_of_a_sample_is_the_same_whatever_is_asked_for_with_it():
    values = loud_in(with_spikes(1.0, 60.0))
    whole = [score.values for score in spike_scores(values, PERIOD_S, LOOKS_BACK, range(len(values)))]
    for start in (9000, 12_345):
        piece = values[start - LOOKS_BACK : start + 500]
        for own, all_ in zip(
            spike_scores(piece, PERIOD_S, LOOKS_BACK, range(LOOKS_BACK, len(piece))), whole, strict=True
        ):
            np.testing.assert_array_equal(own.values, all_[start : start + 500])


def test_a_spike_is_judged_by_thirty_seconds_before_its_window_and_reaches_back_to_the_first_in_it():
    loud = np.zeros(8000)
    loud[99::100] = 1.0  # one a second, from the first second on
    for score, window in zip(spike_scores(loud, PERIOD_S, LOOKS_BACK, range(8000)), (1000, 4000), strict=True):
        judged = np.flatnonzero(np.isfinite(score.values))
        assert judged.tolist() == list(range(window + 2999, 8000, 100))
        assert set(score.reach[judged]) == {window - 100}
        seconds = window / 100.0  # and of thirty seconds before the first of these
        chance = stats.nbinom.sf(seconds - 1.0, 30.5, 40.0 / (40.0 + seconds))
        assert score.values[judged[0]] == pytest.approx(-np.log(chance))


def test_the_surprise_is_that_of_counts_whose_rate_was_counted_before():
    """Of a rate of a gamma law, whose counts in a time are of a negative binomial one: half a one in 10 s before."""
    for before, count in ((0, 4), (3, 6), (40, 5)):
        chance = stats.nbinom.sf(count - 1, before + 0.5, 70.0 / 80.0)
        assert _surprise(count, before, 10.0, 60.0) == pytest.approx(-np.log(chance))


@pytest.mark.parametrize(("count", "apart", "judged"), [(3, 11, 0), (4, 11, 1), (4, 10, 0)])
def test_four_a_tenth_of_a_second_apart_are_the_fewest_and_chance_passes_once_in_hundreds_of_years(
    count, apart, judged
):
    loud = np.zeros(9000)
    loud[8000 : 8000 + apart * count : apart] = 1.0
    scores = spike_scores(loud, PERIOD_S, LOOKS_BACK, range(9000))
    assert [int(np.isfinite(score.values).sum()) for score in scores] == [judged] * 2
    assert 100.0 < np.exp(THRESHOLD) / (20.0 * 24.0 * 365.0) < 1000.0  # of twenty looks an hour


@pytest.mark.nightly
def test_a_gyro_with_rare_spikes_is_named_and_its_stream_says_the_same():
    record = monitors.record(12_000, seed=21)
    fault = gb.Spikes(channel="r", onset_s=150.0, size=2.2, rate_hz=1.0, seed=3)
    broken = gb.inject(record, fault)
    monitor = monitors.monitor("C")
    watch = monitor.watch(broken)
    assert watch.faults[0].test.startswith("spikes")
    assert watch.faults[0].sensor in (None, "r")
    assert monitors.streamed(monitor, broken, 1).alarms == watch.alarms
    assert not monitor.watch(record).alarms

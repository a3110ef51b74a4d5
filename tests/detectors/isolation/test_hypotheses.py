"""Hypotheses: what a change shows is exact, readings testify only where they can, every kind finds its name.

On made-up records (50 Hz, bank C); `experiments/every_fault.py` has flights of the GTM.
"""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.calibrated import residuals_of
from gtmbench.detectors.isolation.diagnosis import SAME
from gtmbench.detectors.isolation.effects import Effects, paths_of
from gtmbench.detectors.isolation.noise import spikes_in
from gtmbench.detectors.isolation.own_noise import habit_of, is_straighter, straight_rows
from gtmbench.faults.kinds.shaping import Hysteresis, RateSaturation
from gtmbench.faults.registry import FAULTS
from tests.helpers import monitors
from tests.helpers.night import by_day

ONSET_S, PERIOD_S = 60.0, 0.02
ANGLE_OF = {"p": "phi", "q": "theta", "r": "psi"}


@cache
def healthy():
    return monitors.record(5000, seed=21)


def whitened(monitor, record):
    """The bank's residuals of a record, whitened."""
    raw = residuals_of(monitor.bank, record, monitor.operators).raw
    return {output: monitor.whiteners[output].whiten(values) for output, values in raw.items()}


@pytest.mark.parametrize(
    ("bank", "channel", "size", "tolerance"),
    [
        ("C", "q", 5.0, 1e-9),
        ("B", "r", 5.0, 1e-9),
        ("C", "psi", 5.0, 1e-9),
        ("C", "phi", 5.0, 1e-2),
        ("C", "theta", 2.0, 1e-2),
    ],
)
def test_what_a_change_shows_is_what_filtering_anew_gives(bank, channel, size, tolerance):
    monitor = monitors.monitor(bank)
    change = np.where(np.arange(5000) > 2000, size * np.sin(np.arange(5000) / 40.0), 0.0)
    changed = healthy().replace(channel, healthy()[channel] + change)
    # the middle of what was read and what should have been is where the linear effect is taken
    paths = paths_of(monitor, changed, channel, healthy()[channel])
    outputs = monitor.bank.affects(channel)
    (shown,) = Effects(paths, outputs, 5000, PERIOD_S).of(change[np.newaxis], slice(0, 5000))
    before, after = whitened(monitor, healthy()), whitened(monitor, changed)
    for output, wave in zip(outputs, shown, strict=True):
        rows = slice(200, 4900)
        exact = (after[output] - before[output])[rows]
        assert np.abs(wave[rows] - exact).max() <= tolerance * max(np.abs(exact).max(), 1.0)


@pytest.mark.parametrize("fault", [RateSaturation, Hysteresis])
def test_many_steps_from_readings_before_are_those_of_one_after_the_other(fault):
    rng = np.random.default_rng(5)
    y, before = rng.normal(size=200), rng.normal(size=200)
    name, value = next(iter(fault.parameters())).name, 0.7
    own = fault(channel="p", onset_s=0.0, **{name: value})
    reads = [own.distort_sample([now], 1.0, PERIOD_S, was)[0] for now, was in zip(y, before, strict=True)]
    np.testing.assert_array_equal(own.follow(y, before, PERIOD_S), reads)


# a sensor's own readings


def noisy(rng, scale=1.0, count=3000):
    return 20.0 * np.sin(np.arange(count) / 60.0) + scale * rng.normal(size=count)


def test_noise_that_comes_costs_and_noise_that_goes_tells():
    rng = np.random.default_rng(1)
    habit = habit_of(noisy(rng))
    usual, loud, quiet = (np.nansum(np.square(habit.innovations(noisy(rng, scale)))) for scale in (1.0, 3.0, 0.01))
    assert usual == pytest.approx(1500.0, rel=0.15)  # two samples count for one
    assert habit.variance == pytest.approx(1.0, rel=0.1)
    assert habit.deviance(loud, 3000) > 5.0 * habit.deviance(usual, 3000)
    assert habit.deviance(quiet, 3000) < -3000.0
    assert habit.deviance(0.7 * usual, 3000) == pytest.approx(0.7 * usual)  # that little tells nothing


def test_counts_of_a_converter_tell_nothing_by_repeating():
    counts = np.round(noisy(np.random.default_rng(2)))
    habit = habit_of(counts)
    assert habit.surprise(np.round(noisy(np.random.default_rng(4)))) == 0.0
    assert habit.deviance(np.zeros(()), 3000) == 0.0
    assert habit_of(np.full(3000, 4.0)) is None


def test_motion_as_sudden_as_noise_is_discounted():
    rng = np.random.default_rng(3)
    still = habit_of(0.01 * rng.normal(size=3000))
    motion = 5.0 * np.sin(1.0 * np.arange(600))
    moving = still.innovations(motion + 0.01 * rng.normal(size=600)) / still.motion(motion)
    assert np.nanmean(np.square(moving)) < 1.0 < 100.0 < np.nanmean(np.square(still.innovations(motion)))


def test_straight_rows_are_repeats_and_ramps():
    rows = straight_rows(np.array([0.0, 0.5, 1.0, 1.5, 1.5, 1.5, 7.0]))
    assert rows.tolist() == [False, False, True, True, False, True, False]


def test_what_still_reads_rounded_is_no_longer_as_usual_however_little_moves():
    rng = np.random.default_rng(6)
    habit, calm = habit_of(noisy(rng)), 0.2 * rng.normal(size=500)
    assert not is_straighter(calm, habit)
    assert not is_straighter(calm, None)
    assert is_straighter(np.round(calm / 3.0) * 3.0, habit)
    counts = habit_of(np.round(noisy(rng)))
    assert not is_straighter(np.round(rng.normal(size=500)), counts)
    assert is_straighter(np.zeros(500), counts)


def test_a_gain_or_a_little_noise_tells_only_of_a_steady_sensor():
    rng = np.random.default_rng(7)
    gusts = noisy(rng) * np.where(np.arange(3000) % 1000 < 100, 5.0, 1.0)
    assert habit_of(noisy(rng)).is_steady
    assert not habit_of(gusts).is_steady


def test_spikes_are_found_one_by_one_and_their_echoes_are_not():
    rng = np.random.default_rng(8)
    habit = habit_of(noisy(rng))
    truth = np.zeros(2000)
    truth[[300, 303, 900, 1500, 1990]] = [400.0, -80.0, 30.0, 5000.0, 60.0]
    found = spikes_in(np.nan_to_num(habit.innovations(noisy(rng, count=2000) + truth)), habit.taps)
    assert np.flatnonzero(found).tolist() == np.flatnonzero(truth).tolist()
    np.testing.assert_allclose(found, truth, atol=3.0)


# every kind finds its name

SEVERITIES = {
    "drift": {"slope": 0.3},
    "bias": {"size": 3.0},
    "random_walk": {"gain": 1.0},
    "oscillation": {"amplitude": 4.0, "frequency_hz": 2.3},
    "scale_factor": {"factor": 1.4},
    "sign_flip": {},
    "noise": {"deviation": 3.0},
    "spikes": {"size": 30.0, "rate_hz": 1.0},
    "stuck": {"value": 1.0},
    "hardover": {"limit": 150.0},
    "stale": {"hold_s": 0.2},
    "lag": {"lag_s": 0.2},
    "delay": {"delay_s": 0.2},
    "misalignment": {"angle_deg": 25.0},
    "swap": {},
    "jam": {},
    "deadzone": {"half_width": 3.0},
    "saturation": {"limit": 4.0},
    "rate_saturation": {"rate_limit": 5.0},
}
SAME_KINDS = {"stuck": {"stuck", "hardover", "jam"}, "hardover": {"hardover", "stuck"}}


def fault_on(kind, channel):
    other = {"misalignment": {"axis": "r"}, "swap": {"other": "r"}} if channel == "q" else {}
    return FAULTS[kind](channel=channel, onset_s=ONSET_S, **SEVERITIES[kind], **other.get(kind, {}))


@pytest.mark.parametrize("kind", by_day(SEVERITIES, 11, seed=78))
def test_every_kind_on_a_gyro_finds_its_name(kind):
    fault = fault_on(kind, "q")
    alarm = monitors.monitor("C").watch(gb.inject(healthy(), fault)).faults[0]
    judged = alarm.at(20.0)
    assert judged.sensor in fault.changes
    assert alarm.isolated_s >= alarm.time_s > ONSET_S
    assert alarm.ended_s is None
    assert judged.kind in SAME_KINDS.get(kind, {kind})
    for name, value in fault.severities.items():
        if name in judged.parameters:
            assert judged.parameters[name] == pytest.approx(value, rel=0.3)
            low, high = judged.intervals[name]
            assert 2.0 * low - high - 0.05 * abs(value) <= value <= 2.0 * high - low + 0.05 * abs(value)


@pytest.mark.parametrize(
    "kind", by_day(["bias", "drift", "noise", "spikes", "stale", "lag", "delay", "scale_factor"], 4, seed=78)
)
def test_a_fault_of_an_angle_is_never_its_gyros(kind):
    fault = fault_on(kind, "phi")
    alarm = monitors.monitor("C").watch(gb.inject(healthy(), fault)).faults[0]
    judged = alarm.at(20.0)
    assert judged.candidates[0] == "phi" or ("phi" in judged.candidates and any(kind in pair for pair in SAME))
    assert judged.sensor in (None, "phi")


def test_an_angle_that_reads_far_off_is_named_though_its_effect_is_no_longer_linear():
    turned = healthy().replace("psi", healthy()["psi"] + 150.0)
    fault = gb.Misalignment(channel="theta", onset_s=ONSET_S, axis="psi", angle_deg=20.0)
    judged = monitors.monitor("C").watch(gb.inject(turned, fault)).faults[0].at(20.0)
    assert (judged.sensor, judged.kind, judged.partner) == ("theta", "misalignment", "psi")
    assert judged.parameters["angle_deg"] == pytest.approx(20.0, abs=0.5)


@pytest.mark.parametrize(
    ("channel", "factor"), by_day([("theta", 1.15), ("theta", 0.87), ("q", 1.15), ("q", 0.87)], 2, seed=3)
)
def test_a_gain_is_that_of_the_sensor_whose_noise_has_changed_with_it(channel, factor):
    fault = gb.ScaleFactor(channel=channel, onset_s=ONSET_S, factor=factor)
    judged = monitors.monitor("C").watch(gb.inject(healthy(), fault)).faults[0].at(20.0)
    assert (judged.sensor, judged.kind) == (channel, "scale_factor")
    assert judged.parameters["factor"] == pytest.approx(factor, abs=0.02)


def test_what_nobody_wrote_a_hypothesis_for_is_unknown_and_its_axis_is_told():
    rng = np.random.default_rng(9)
    wave = np.where(healthy().time_s > ONSET_S, 6.0 * np.sign(np.sin(healthy().time_s * 3.0)) * rng.random(5000), 0.0)
    alarm = monitors.monitor("C").watch(healthy().replace("q", healthy()["q"] + wave)).faults[0]
    assert set(alarm.last.candidates) <= {"q", "theta"}
    assert alarm.sensor != "theta"
    assert not alarm.has_passed

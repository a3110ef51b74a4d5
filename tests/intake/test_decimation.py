"""Decimation keeps what is slow, removes what would fold, and leaves operators between channels alone."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError


def record_of(*columns, start_s=25.0, period_s=0.01):
    names = ["p", "q", "r", "beta"][: len(columns)]
    return gb.Record(np.column_stack(columns), channels=names, sample_period_s=period_s, start_s=start_s)


def waves(hz, samples=6000, start_s=25.0):
    return np.sin(2 * np.pi * hz * (start_s + np.arange(samples) * 0.01) + 0.3)


@pytest.mark.parametrize("factor", [2, 3, 5, 10, 25])
def test_slow_waves_pass_with_amplitude_and_phase(factor):
    hz = 0.6 * 50.0 / factor
    slow = gb.decimate(record_of(waves(hz), waves(0.1 * hz)), factor)
    assert slow.sample_period_s == pytest.approx(0.01 * factor)
    for i, name in enumerate(slow.channels):
        expected = np.sin(2 * np.pi * [hz, 0.1 * hz][i] * slow.time_s + 0.3)
        np.testing.assert_allclose(slow[name], expected, atol=2e-4)


@pytest.mark.parametrize("factor", [2, 3, 5, 10, 25])
@pytest.mark.parametrize("above", [1.0, 1.3, 1.99])
def test_what_would_fold_is_removed(factor, above):
    slow = gb.decimate(record_of(waves(above * 50.0 / factor)), factor)
    assert np.abs(slow["p"]).max() < 2e-4


def test_a_sample_stands_at_its_own_time():
    record = record_of(np.arange(2000.0))  # a ramp of 1 a sample
    slow = gb.decimate(record, 4)
    np.testing.assert_allclose(slow["p"], (slow.time_s - 25.0) * 100, atol=1e-8)
    assert set(np.round(slow.time_s, 9)) <= set(np.round(record.time_s, 9))


def test_a_missing_sample_spoils_its_own_results_only():
    values = np.random.default_rng(1).standard_normal((1000, 2))
    holed = values.copy()
    holed[500, 0] = np.nan
    whole, part = gb.decimate(record_of(*values.T), 5), gb.decimate(record_of(*holed.T), 5)
    missing = np.isnan(part["p"])
    np.testing.assert_array_equal(part["q"], whole["q"])
    np.testing.assert_array_equal(part["p"][~missing], whole["p"][~missing])
    assert np.abs(part.time_s[missing] - 30.0).max() <= 13 * 0.05 + 1e-9
    assert missing.sum() == 27


def test_a_factor_of_1_is_the_record():
    record = record_of(np.arange(10.0))
    assert gb.decimate(record, 1) is record


@pytest.mark.parametrize(("factor", "message"), [(0, "factor is 0"), (2.0, "factor is 2.0"), (10, "takes 261; choose")])
def test_what_cant_be_decimated_is_refused(factor, message):
    with pytest.raises(InputError, match=message):
        gb.decimate(record_of(np.arange(260.0)), factor)

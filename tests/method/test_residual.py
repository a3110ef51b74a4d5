"""The residual (4.11) and its windowed norm (4.12) against their definitions, written out as loops."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.errors import InputError
from gtmbench.method.residual import Residual, residual, windowed_norm
from gtmbench.values.record import Record
from tests.helpers.oracles import operator

INPUTS, OUTPUTS = ("p", "q"), ("r", "beta")
ORDERS = [(0, 0), (3, 2), (4, 0), (0, 5)]  # r, d
TS = 0.01
R, D = 3, 2


def flight(samples=60, seed=1, start_s=25.0):
    values = np.random.default_rng(seed).standard_normal((samples, 4))
    return Record(values, channels=[*INPUTS, *OUTPUTS], sample_period_s=TS, start_s=start_s)


def with_value(record, channel, sample, value):
    values = record[channel].copy()
    values[sample] = value
    return record.replace(channel, values)


def residual_by_definition(model, record):
    u = record.matrix(model.inputs) - model.input_means
    y = record.matrix(model.outputs) - model.output_means
    r, d, last = model.causal_order, model.noncausal_order, len(record) - 1
    e = np.full(y.shape, np.nan)
    for k in range(r, last - d + 1):
        e[k] = y[k]
        for i in range(-d, r + 1):
            e[k] -= model.markov[i + d] @ u[k - i]
    return e


def norm_by_definition(e, window):
    norm = np.full(len(e), np.nan)
    for k in range(len(e) - window):
        norm[k] = np.sqrt(sum(np.sum(e[i] ** 2) for i in range(k, k + window + 1)))
    return norm


def made_up(values):
    """Return a residual of given values, shape (samples,) or (samples, outputs)."""
    values = np.asarray(values, dtype=float)
    values = values.reshape(len(values), -1)
    time_s = 25.0 + np.arange(len(values)) * TS
    names = tuple(f"y{o}" for o in range(values.shape[1]))
    return Residual(values=values, time_s=time_s, outputs=names, look_ahead_s=0.02, sample_period_s=TS)


@pytest.mark.parametrize(("r", "d"), ORDERS)
def test_the_residual_is_what_equation_4_11_says_from_r_to_l_minus_d(r, d):
    model, record = operator(r, d), flight()
    e = residual(model, record)
    np.testing.assert_allclose(e.values, residual_by_definition(model, record), rtol=0, atol=1e-12)
    assert np.flatnonzero(np.isfinite(e.values[:, 0])).tolist() == list(range(r, 60 - d))
    np.testing.assert_array_equal(e.time_s, record.time_s)
    assert e.look_ahead_s == pytest.approx(d * TS)


@pytest.mark.parametrize("samples", range(8))
def test_a_record_without_a_single_equation_has_no_residual(samples):
    e = residual(operator(), flight(samples)).values
    assert e.shape == (samples, 2)
    assert np.isfinite(e).any(axis=1).sum() == max(samples - R - D, 0)


@pytest.mark.parametrize("spike", [1e6, -1e6, np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(("channel", "m"), [("q", 0), ("q", 7700), ("q", 19_999), ("r", 7700), ("beta", 12_345)])
def test_a_spike_changes_the_rows_that_need_it_and_not_a_bit_of_the_others(channel, m, spike):
    model, record = operator(50, 50), flight(20_000)
    before, after = (residual(model, each).values for each in (record, with_value(record, channel, m, spike)))
    k = np.arange(20_000)
    rows = (k == m) if channel in OUTPUTS else np.abs(k - m) <= 50
    columns = [OUTPUTS.index(channel)] if channel in OUTPUTS else [0, 1]
    needs_it = np.zeros(before.shape, dtype=bool)
    needs_it[np.ix_(rows, columns)] = True
    np.testing.assert_array_equal(after[~needs_it], before[~needs_it])
    known = needs_it & ~np.isnan(before)
    assert (np.abs(after[known]) > 1e2).all() if abs(spike) == 1e6 else not np.isfinite(after[known]).any()


def test_a_residual_needs_no_memory_that_grows_with_the_record_beyond_its_own():
    def temporary(samples):
        model, record = operator(50, 50), flight(samples)
        tracemalloc.start()
        e = residual(model, record)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        return peak - e.values.nbytes - e.time_s.nbytes

    assert temporary(200_000) <= temporary(20_000) < 2e6


@pytest.mark.parametrize("period", [0.02, 0.0100001, 0.005])
def test_another_sample_period_is_refused(period):
    record = Record(np.zeros((60, 4)), channels=[*INPUTS, *OUTPUTS], sample_period_s=period)
    with pytest.raises(InputError, match=rf"every {period:g} s.*identified at 0.01 s; resample"):
        residual(operator(), record)


@pytest.mark.parametrize("channel", [*INPUTS, *OUTPUTS])
def test_a_record_without_a_channel_of_the_operator_is_refused(channel):
    others = [name for name in (*INPUTS, *OUTPUTS) if name != channel]
    with pytest.raises(InputError, match=f"no channel '{channel}' in this record"):
        residual(operator(), flight().select(others))


errors = st.one_of(st.floats(-1e3, 1e3), st.just(np.nan))


@given(values=st.lists(errors, min_size=1, max_size=40), window=st.integers(0, 45))
def test_the_norm_is_what_equation_4_12_says_with_missing_samples_too(values, window):
    e = made_up(values)
    expected = norm_by_definition(e.values, window)
    np.testing.assert_allclose(windowed_norm(e, window=window).values, expected, rtol=1e-12, atol=1e-12)


def test_several_outputs_add_the_squares_of_each():
    e = np.random.default_rng(3).standard_normal((50, 2))
    both, norm, other = (windowed_norm(made_up(part), window=6).values for part in (e, e[:, 0], e[:, 1]))
    np.testing.assert_allclose(both, np.hypot(norm, other), rtol=1e-13)


@pytest.mark.parametrize("w", [0, 4, 6, 100])
@pytest.mark.parametrize("m", [0, 13, 199, 299])
@pytest.mark.parametrize("spike", [1e6, 1e150, 1e200, np.inf, np.nan], ids=str)
def test_a_spike_leaves_no_trace_in_windows_that_dont_hold_it(w, m, spike):
    clean = np.random.default_rng(4).standard_normal(300)
    spiked = clean.copy()
    spiked[m] = spike
    before, after = (windowed_norm(made_up(e), window=w).values for e in (clean, spiked))
    holds_it = np.array([k <= m <= k + w for k in range(300)])
    np.testing.assert_array_equal(after[~holds_it], before[~holds_it])
    known = holds_it & np.isfinite(before)
    assert np.isnan(after[known]).all() if np.isnan(spike) else (after[known] >= spike).all()


def test_a_norm_is_known_when_its_last_sample_is():
    """The last sample that E(k) needs is k + w + d."""
    record = flight(300)
    norm = windowed_norm(residual(operator(), record), window=10)
    np.testing.assert_allclose(norm.known_s[: 300 - 12], record.time_s[12:], rtol=0, atol=1e-9)
    # seen from the other side: what comes after doesn't change it
    cut = record.between(record.start_s, norm.known_s[200])
    short = windowed_norm(residual(operator(), cut), window=10)
    # but for its last bits: kernels of sums and products take the last samples of an array otherwise
    assert short.values[200] == pytest.approx(norm.values[200], rel=1e-14, abs=0.0)
    assert np.isnan(short.values[201])


@pytest.mark.parametrize("window", [-1, 1.0, 2.5, True, None, np.nan], ids=str)
def test_a_window_that_is_no_count_is_refused(window):
    with pytest.raises(InputError, match="must be a whole number, 0 or more"):
        windowed_norm(made_up(np.ones(30)), window=window)


def test_what_isnt_a_record_is_refused_with_what_to_do():
    for other in (None, np.ones((3, 2)), flight().frame()):
        with pytest.raises(InputError, match="was given for a Record; wrap it with Record"):
            residual(operator(), other)

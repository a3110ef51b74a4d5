"""The banded Toeplitz product against its definition, written out as a loop."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.method import filters
from gtmbench.method.filters import filtered, levinson, yule_walker


def made(samples, lags, outputs, inputs, seed=0):
    """Return a signal, shape (samples, inputs), an operator and the means of its inputs."""
    random = np.random.default_rng(seed)
    return (
        random.standard_normal((samples, inputs)),
        random.standard_normal((lags, outputs, inputs)),
        random.standard_normal(inputs),
    )


def by_definition(u, markov, means):
    lags = len(markov)
    rows = [
        sum(markov[j] @ (u[n + lags - 1 - j] - means) for j in range(lags)) for n in range(max(len(u) - lags + 1, 0))
    ]
    return np.array(rows).reshape(-1, markov.shape[1])


sizes = st.tuples(st.integers(0, 70), st.integers(1, 12), st.integers(1, 3), st.integers(1, 4))


@given(size=sizes, block=st.integers(1, 9), blocks=st.integers(1, 4))
def test_it_is_the_sum_over_the_lags_however_the_signal_is_cut(size, block, blocks):
    u, markov, means = made(*size)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(filters, "_BLOCK", block)
        patch.setattr(filters, "_STRETCH", blocks * block)
        x = filtered(u.T, markov, means)
    expected = by_definition(u, markov, means)
    assert x.shape == expected.shape
    np.testing.assert_allclose(x, expected, rtol=0, atol=1e-13 * size[1] * size[3])


@pytest.mark.parametrize("samples", [101, 148, 7779, 7780, 7781, 20_000])
def test_long_signals_are_filtered_as_numpy_does_it(samples):
    u, markov, means = made(samples, 101, 1, 3)
    expected = sum(np.convolve(u[:, i] - means[i], markov[:, 0, i], mode="valid") for i in range(3))
    np.testing.assert_allclose(filtered(u.T, markov, means)[:, 0], expected, rtol=0, atol=1e-12)


@given(
    samples=st.integers(1, 90),
    lags=st.integers(1, 12),
    where=st.lists(st.tuples(st.integers(0, 89), st.integers(0, 1)), min_size=1, max_size=4),
    spike=st.sampled_from([1e6, -1e6, 1e308, np.nan, np.inf, -np.inf]),
)
def test_a_spike_changes_the_windows_that_hold_it_and_not_a_bit_of_the_others(samples, lags, where, spike):
    u, markov, means = made(samples, lags, 2, 2)
    before = filtered(u.T, markov, means)
    rows = np.array([k % samples for k, _ in where])
    u[rows, [i for _, i in where]] = spike
    after = filtered(u.T, markov, means)
    holds_it = [np.any((n <= rows) & (rows < n + lags)) for n in range(len(before))]
    np.testing.assert_array_equal(np.delete(after, holds_it, axis=0), np.delete(before, holds_it, axis=0))
    if np.isfinite(spike):
        assert (after[holds_it] != before[holds_it]).all()
    else:
        assert np.isnan(after[holds_it]).all()


def test_channels_may_be_views_and_the_result_may_go_anywhere():
    wide, markov, means = made(9000, 7, 2, 6)
    views, markov, means = [wide[:, 4], wide[:, 1]], markov[:, :, :2], means[:2]
    wide.setflags(write=False)
    out = np.zeros((9000, 5))[3:-3, 1:3]
    assert filtered(views, markov, means, out=out) is out
    np.testing.assert_array_equal(out, filtered([view.copy() for view in views], markov, means))


def test_an_autoregression_of_no_order_leaves_all_as_it_is():
    taps, variance = yule_walker(np.array([2.0]))
    assert (taps.tolist(), variance) == ([1.0], 2.0)


def test_an_autoregression_of_what_no_noise_can_be_stays_stable():
    taps, variance = levinson(np.array([[1.0, 2.0], [1.0, -2.0]]))
    np.testing.assert_allclose(taps, [[1.0, -0.9999], [1.0, 0.9999]])
    np.testing.assert_allclose(variance, 1.0 - 0.9999**2)

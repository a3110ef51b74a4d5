"""Doubt: the variance of a model's error from the covariance of its parameters, against the same the slow way."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.detectors.bank.doubt import HALF, Doubt, leverage, regressors, shifts, slow, whitened
from gtmbench.detectors.bank.statistics import Statistic, Tolerance
from gtmbench.method.transmissibility import Transmissibility

ORDERS = [(0, 0), (3, 0), (0, 2), (4, 3)]


def motion(samples, inputs=2, seed=1):
    return np.random.default_rng(seed).standard_normal((samples, inputs))


def root_of(size, seed=2):
    return np.random.default_rng(seed).standard_normal((size, size))


def operator(theta, causal, noncausal, inputs=2, period_s=0.1):
    names = tuple("pqrs"[:inputs])
    lags = causal + noncausal + 1
    return Transmissibility(
        markov=theta.reshape(lags, 1, inputs),
        inputs=names,
        outputs=("beta",),
        causal_order=causal,
        noncausal_order=noncausal,
        input_means=np.zeros(inputs),
        output_means=np.zeros(1),
        rank=lags * inputs,
        samples=100,
        rms_residual=np.ones(1),
        sample_period_s=period_s,
    )


@pytest.mark.parametrize(("causal", "noncausal"), ORDERS)
def test_regressors_times_parameters_are_what_the_operator_predicts(causal, noncausal):
    u, size = motion(40), 2 * (causal + noncausal + 1)
    theta = np.random.default_rng(3).standard_normal(size)
    record = gb.Record(u, channels=["p", "q"], sample_period_s=0.1)
    predicted = operator(theta, causal, noncausal).predict(record)[:, 0]
    rows = slice(causal, 40 - noncausal)
    np.testing.assert_allclose(regressors(u, causal + noncausal + 1) @ theta, predicted[rows], rtol=0, atol=1e-12)
    assert np.isnan(np.delete(predicted, np.arange(40)[rows])).all()


@pytest.mark.parametrize(("causal", "noncausal"), ORDERS)
def test_leverage_is_the_variance_of_a_prediction_with_such_parameters(causal, noncausal):
    u, size = motion(30), 2 * (causal + noncausal + 1)
    root = root_of(size)
    covariance = root @ root.T
    found = leverage(u, causal, noncausal, root)
    for k in range(causal, 30 - noncausal):
        phi = np.concatenate([u[k - i] for i in range(-noncausal, causal + 1)])
        assert found[k] == pytest.approx(phi @ covariance @ phi, rel=1e-10)
    assert (found[:causal] == found[causal]).all()
    assert (found[30 - noncausal :] == found[29 - noncausal]).all()


def test_leverage_draws_the_scatter_of_predictions():
    """An independent oracle: operators drawn with this covariance scatter by it."""
    u, root = motion(25), 0.3 * root_of(12)
    record = gb.Record(u, channels=["p", "q"], sample_period_s=0.1)
    draws = np.random.default_rng(4).standard_normal((4000, 12)) @ root.T
    scatter = np.std([operator(theta, 3, 2).predict(record)[:, 0] for theta in draws], axis=0)
    np.testing.assert_allclose(np.sqrt(leverage(u, 3, 2, root))[3:-2], scatter[3:-2], rtol=0.08)


@pytest.mark.parametrize("samples", [4096, 4097, 4100, 8192, 8197])
def test_long_records_are_worked_through_in_chunks_without_a_seam(samples):
    u, root = motion(samples), root_of(12)
    found = leverage(u, 3, 2, root)
    expected = np.square(regressors(u, 6) @ root).sum(axis=1)
    np.testing.assert_allclose(found[3:-2], expected, rtol=1e-12)
    assert (found > 0).all()


def test_a_record_shorter_than_a_window_has_no_leverage():
    assert leverage(motion(5), 3, 2, root_of(12)).tolist() == [0.0] * 5
    assert (leverage(motion(6), 3, 2, root_of(12)) > 0.0).all()  # one window, which stands for all rows


def frequency_response(frequency):
    """Return what `slow` makes of a sinusoid, well inside: its gain and its phase; frequency in cycles a sample."""
    k = np.arange(400)
    out = slow(np.column_stack([np.cos(2 * np.pi * frequency * k), np.sin(2 * np.pi * frequency * k)]))[100:300]
    wave = np.exp(2j * np.pi * frequency * k[100:300])
    return np.mean((out[:, 0] + 1j * out[:, 1]) / wave)


@pytest.mark.parametrize("frequency", [0.0, 0.01, 0.03, 0.05])
def test_slow_motion_passes_without_delay(frequency):
    found = frequency_response(frequency)
    assert abs(found) == pytest.approx(1.0, abs=0.15)
    assert np.angle(found) == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("frequency", [0.25, 0.3, 0.4, 0.5])
def test_fast_motion_doesnt(frequency):
    assert abs(frequency_response(frequency)) < 0.02


def test_constants_and_ramps_come_through_at_the_ends_too():
    ramp = 5.0 + 0.3 * np.arange(60.0)
    np.testing.assert_allclose(slow(np.column_stack([ramp, np.full(60, -2.0)])).T, [ramp, np.full(60, -2.0)], atol=1e-9)


@given(st.integers(1, 40), st.integers(0, 2**32 - 1))
def test_slow_is_linear_keeps_the_length_and_knows_no_direction(samples, seed):
    a, b = motion(samples, seed=seed), motion(samples, seed=seed + 1)
    assert slow(a).shape == a.shape
    np.testing.assert_allclose(slow(a - 2.0 * b), slow(a) - 2.0 * slow(b), atol=1e-12)
    np.testing.assert_allclose(slow(a[::-1])[::-1], slow(a), atol=1e-12)


def test_slow_looks_no_further_than_it_says():
    a = motion(60)
    b = a.copy()
    b[40:] += 100.0
    np.testing.assert_array_equal(slow(a)[: 40 - HALF], slow(b)[: 40 - HALF])
    assert (slow(a)[40 - HALF] != slow(b)[40 - HALF]).all()


def test_missing_samples_are_bridged():
    line = np.column_stack([2.0 + 0.1 * np.arange(50.0), 3.0 - 0.2 * np.arange(50.0)])
    holes = line.copy()
    holes[20:31, 0] = np.nan
    np.testing.assert_allclose(slow(holes), line, atol=1e-9)
    holes[:, 1] = np.nan
    assert (slow(holes)[:, 1] == 0.0).all()
    holes[:, 0] = np.nan
    holes[7, 0] = 4.0
    np.testing.assert_allclose(slow(holes)[:, 0], 4.0)


def test_whitened_motion_is_what_the_whitening_filter_makes_of_it_but_for_its_start():
    u, coefficients = motion(30), np.array([1.0, -0.6, 0.2])
    found = whitened(u, coefficients)
    for k in range(2, 30):
        np.testing.assert_allclose(found[k], u[k] - 0.6 * u[k - 1] + 0.2 * u[k - 2], atol=1e-12)
    np.testing.assert_allclose(found[0], 0.6 * u[0], atol=1e-12)  # as if u[0] had been before
    np.testing.assert_array_equal(whitened(u, np.ones(1)), u)


def test_the_spread_is_one_at_rest_and_grows_with_motion_whatever_its_sign():
    root, coefficients = 0.5 * np.eye(6), np.array([1.0, -0.5])
    doubt = Doubt(root=root, raw=4.0, white=9.0)
    by = operator(np.zeros(6), 1, 1)
    time = np.arange(400.0)
    push = np.exp(-(((time - 200.0) / 20.0) ** 2))

    def spread(size):
        record = gb.Record(np.outer(size * push, [1.0, 2.0]), channels=["p", "q"], sample_period_s=0.1)
        return doubt.spread(by, record, coefficients, Statistic())

    rest, once, twice, other = (spread(size) for size in (0.0, 1.0, 2.0, -1.0))
    for way in ("raw", "white"):
        assert (getattr(rest, way) == 1.0).all()
        np.testing.assert_allclose(getattr(once, way)[:100], 1.0, atol=1e-6)
        np.testing.assert_allclose(getattr(twice, way) ** 2 - 1.0, 4.0 * (getattr(once, way) ** 2 - 1.0), atol=1e-9)
        np.testing.assert_allclose(getattr(other, way), getattr(once, way))
    # at the top the motion is flat: three lags of 1 and of 2, each times 1/2, and half of that behind the whitener
    assert once.raw[200] ** 2 == pytest.approx(1.0 + 4.0 * 0.25 * 3.0 * (1.0 + 4.0), rel=0.02)
    assert once.white[200] ** 2 == pytest.approx(1.0 + 9.0 * 0.25 * 3.0 * (1.0 + 4.0) * 0.25, rel=0.03)
    assert once.between(slice(150, 160)).white.tolist() == once.white[150:160].tolist()


@pytest.mark.parametrize(("rows", "before"), [(4, 10), (1, 3), (20, 60)])
def test_shifts_are_means_less_the_means_before(rows, before):
    u = motion(50)
    found = shifts(u, rows, before)
    for k in range(rows, 50):
        base = u[max(k + 1 - rows - before, 0) : k + 1 - rows]
        np.testing.assert_allclose(found[k], u[k + 1 - rows : k + 1].mean(axis=0) - base.mean(axis=0), atol=1e-12)


def test_an_operators_error_that_lasts_is_judged_as_the_one_error_that_it_is():
    """Operators drawn from the doubt: they shift means by what is said, and seldom alarm."""
    random = np.random.default_rng(5)
    by, test = operator(np.zeros(2), 0, 0, period_s=0.01), Statistic(windows_s=(0.64,), baseline_s=2.0, two_sided=False)
    push = np.where((np.arange(1500) // 150) % 2, 3.0, -3.0)  # half turns of 1.5 s
    record = gb.Record(np.column_stack([push, push**2 / 3.0]), channels=["p", "q"], sample_period_s=0.01)
    spread = Doubt(root=0.5 * np.eye(2), raw=1.0, white=1.0).spread(by, record, np.ones(1), test)
    tolerance, drawn, greatest, judged = Tolerance(high=2.0), [], [], []
    for _ in range(60):
        error = record.matrix(["p", "q"]) @ (0.5 * random.standard_normal(2)) + random.standard_normal(1500)
        drawn.append(error)
        scaled = test.series(error, error / spread.white, 0.01, tolerance)
        known = test.series(error, error, 0.01, tolerance, spread)
        greatest.append(np.nanmax(scaled[0].values))
        judged.append([np.nanmax(one.values) for one in known])
    assert np.median(greatest) > 20.0  # samples over their spread alone: most draws would alarm
    assert np.quantile(judged, 0.9, axis=0).max() < 12.0
    windows = shifts(np.array(drawn).T, 64, 200)[300:1400]
    ratio = windows.std(axis=1) / np.sqrt(1.0 / 64 + 1.0 / 200 + spread.means[64][300:1400])
    assert np.median(ratio) == pytest.approx(1.0, abs=0.15)


def test_a_shift_in_known_motion_alarms_as_without_doubt():
    test, noise = Statistic(windows_s=(0.64,), baseline_s=2.0), np.random.default_rng(6).standard_normal(1500)
    shifted = noise + np.where(np.arange(1500) > 1000, 1.5, 0.0)
    still = gb.Record(np.zeros((1500, 2)), channels=["p", "q"], sample_period_s=0.01)
    doubt = Doubt(root=0.5 * np.eye(2), raw=1.0, white=1.0)
    spread = doubt.spread(operator(np.zeros(2), 0, 0, period_s=0.01), still, np.ones(1), test)
    for one, other in zip(
        test.series(noise, shifted, 0.01, Tolerance()),
        test.series(noise, shifted, 0.01, Tolerance(), spread),
        strict=True,
    ):
        np.testing.assert_array_equal(one.values, other.values)

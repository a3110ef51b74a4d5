"""Whitening: what is left of a coloured residual is white, of variance 1, and gaps cost no more than they must."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import toeplitz
from scipy.signal import lfilter

from gtmbench.detectors.statistics.whitening import Whitener, fit_whitener
from gtmbench.errors import InputError

AR2 = [1.0, -1.6, 0.8]  # poles at 0.8 +- 0.4i
SAMPLES = 40_000


def coloured(samples=SAMPLES, seed=1, scale=3.0, mean=5.0):
    return mean + scale * lfilter([1.0], AR2, np.random.default_rng(seed).standard_normal(samples + 200))[200:]


def test_the_coefficients_solve_the_yule_walker_equations():
    parts = [coloured(500, seed=seed) for seed in (1, 2, 3)]
    mean = np.concatenate(parts).mean()
    covariance = [
        sum((x[i:] - x.mean()) @ (x[: len(x) - i] - x.mean()) for x in parts) / 1500 for i in range(7)
    ]  # each record about its own mean
    taps = np.linalg.solve(toeplitz(covariance[:-1]), covariance[1:])
    whitener = fit_whitener(parts, order=6)
    np.testing.assert_allclose(whitener.coefficients, [1.0, *-taps], rtol=1e-9)
    assert whitener.mean == pytest.approx(mean)
    assert whitener.deviation == pytest.approx(np.sqrt(covariance[0] - taps @ covariance[1:]), rel=1e-9)


@pytest.mark.parametrize("order", [0, 1, 7])
def test_a_missing_sample_spoils_the_order_and_one(order):
    whitener = fit_whitener([coloured(2000)], order=order)
    assert whitener.order == order
    e = coloured(100, seed=9)
    whole = whitener.whiten(e)
    e[[40, 90]] = np.nan
    white = whitener.whiten(e)
    spoilt = np.zeros(100, dtype=bool)
    spoilt[:order] = True
    spoilt[40 : 40 + order + 1] = True
    spoilt[90 : 90 + order + 1] = True
    np.testing.assert_array_equal(np.isnan(white), spoilt)
    np.testing.assert_array_equal(white[~spoilt], whole[~spoilt])


def test_gaps_part_a_record_into_stretches():
    series, other = (x - x.mean() for x in (coloured(3000, seed=1), coloured(2000, seed=2)))
    joined = np.concatenate([[np.nan], series, [np.nan, np.nan], other, [np.nan]])
    apart, together = fit_whitener([series, other], order=8), fit_whitener([joined], order=8)
    np.testing.assert_allclose(apart.coefficients, together.coefficients, rtol=0, atol=1e-12)
    assert apart.deviation == pytest.approx(together.deviation, rel=1e-12)


def test_a_bias_that_differs_from_record_to_record_is_no_noise():
    series, other = coloured(3000, seed=1), coloured(2000, seed=2)
    here, there = fit_whitener([series, other], order=8), fit_whitener([series + 5.0, other - 7.0], order=8)
    np.testing.assert_allclose(there.coefficients, here.coefficients, rtol=0, atol=1e-12)
    assert there.mean == pytest.approx(here.mean + (5.0 * 3000 - 7.0 * 2000) / 5000, abs=1e-12)


def test_a_spectrum_has_the_power_of_what_it_describes():
    whitener = Whitener(coefficients=np.array([1.0, -0.6]), mean=0.0, deviation=3.0)
    power = whitener.power(np.linspace(-np.pi, np.pi, 2000, endpoint=False))
    assert power.mean() == pytest.approx(9.0 / (1.0 - 0.36))


@pytest.mark.parametrize("unit", [1e-15, 1e-3, 1e9])
def test_units_dont_matter(unit):
    here, there = fit_whitener([coloured(3000)], order=8), fit_whitener([unit * coloured(3000)], order=8)
    fresh = coloured(500, seed=3)
    np.testing.assert_allclose(there.whiten(unit * fresh), here.whiten(fresh), rtol=0, atol=1e-8)


@pytest.mark.parametrize(("size", "is_noise"), [(3e-4, False), (3e-2, True)])
def test_what_is_below_a_millionth_of_a_millionth_of_a_residual_is_rounding(size, is_noise):
    residual = 1e9 + size * np.random.default_rng(1).standard_normal(1000)
    if is_noise:
        assert fit_whitener([residual], order=0).deviation == pytest.approx(size, rel=0.1)
    else:
        with pytest.raises(InputError, match="the same at every sample"):
            fit_whitener([residual], order=0)


@pytest.mark.parametrize("order", [0, 3, 30])
@pytest.mark.parametrize("value", [0.0, 7.0, -1e9, 0.1])
def test_a_constant_residual_is_refused(value, order):
    with pytest.raises(InputError, match="the same at every sample"):
        fit_whitener([np.full(1000, value)], order=order)


@pytest.mark.parametrize(
    ("residuals", "count"),
    [([np.zeros(99)], 99), ([np.full(500, np.nan)], 0), ([], 0), ([np.zeros(60), np.ones(39)], 99)],
)
def test_too_few_samples_are_refused(residuals, count):
    with pytest.raises(InputError, match=f"{count} samples .* too few for a whitening filter of 9 .* at least 100"):
        fit_whitener(residuals, order=9)
    assert len(fit_whitener([np.random.default_rng(1).standard_normal(100)], order=9).coefficients) == 10


def residuals(kind, samples, seed):
    rng, t = np.random.default_rng(seed), np.arange(samples)
    return {
        "noise": rng.standard_normal(samples),
        "walk": np.cumsum(rng.standard_normal(samples)),
        "double walk": np.cumsum(np.cumsum(rng.standard_normal(samples))),
        "sine": np.sin(rng.uniform(0.01, 3.0) * t),
        "ramp": t - 3.0,
        "spike": np.where(t == samples // 2, 1e9, 0.0),
        "steps": np.repeat(rng.standard_normal(samples // 10 + 1), 10)[:samples],
        "offset": 1e6 + rng.standard_normal(samples),
    }[kind]


@given(
    kind=st.sampled_from(["noise", "walk", "double walk", "sine", "ramp", "spike", "steps", "offset"]),
    order=st.integers(0, 30),
    seed=st.integers(0, 1000),
)
def test_the_model_is_stable_whatever_it_is_fitted_to(kind, order, seed):
    given_ = residuals(kind, 400, seed)
    whitener = fit_whitener([given_], order=order)
    assert whitener.deviation > 0.0
    roots = np.roots(whitener.coefficients)
    assert np.abs(roots).max(initial=0.0) < 1.0
    assert np.isfinite(whitener.whiten(given_)[order:]).all()


@pytest.mark.parametrize("samples", [1, 3, 8192, 8194, 8195, 20_000])
def test_a_long_residual_is_whitened_as_its_parts_are(samples):
    whitener = Whitener(coefficients=np.array([1.0, -1.6, 0.8]), mean=1.0, deviation=2.0)
    residual = coloured(samples)
    residual[samples // 2] = np.inf
    residual[samples // 3] = np.nan
    x = np.where(np.isfinite(residual), (residual - 1.0) / 2.0, np.nan)
    expected = np.full(samples, np.nan)
    expected[2:] = x[2:] - 1.6 * x[1:-1][: len(x[2:])] + 0.8 * x[:-2][: len(x[2:])]
    np.testing.assert_allclose(whitener.whiten(residual), expected, rtol=0, atol=1e-12)

"""Several records and weights are stacked, weighted equations; weights of one over the variance are Gauss-Markov's."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy import signal

from gtmbench.method.estimators.least_squares import InstrumentalVariables, LeastSquares
from gtmbench.method.estimators.prediction_error import PredictionError
from gtmbench.method.estimators.total_least_squares import TotalLeastSquares
from gtmbench.values.record import Record
from tests.helpers.oracles import MARKOV, dense, distances, is_chi_square, lagged, least_squares, record, siso


def uneven(seed, samples=300):
    """Return a record whose noise grows sixteenfold, and the weights 1 / variance, their mean 1."""
    rng = np.random.default_rng([9, seed])
    u, e = rng.standard_normal((2, samples))
    std = np.geomspace(0.1, 1.6, samples)
    y = std * e
    y[2:-2] += lagged(u[:, None], 2, 2) @ MARKOV
    return record(u=u, y=y), std**-2 / np.mean(std**-2)


@pytest.mark.parametrize("weighted", [False, True])
def test_the_covariance_of_least_squares_is_right_in_white_noise_and_weights_of_one_over_the_variance_keep_it_so(
    weighted,
):
    operators = []
    for seed in range(300):
        series, weights = uneven(seed)
        if not weighted:  # the same noise at every sample
            rng = np.random.default_rng([10, seed])
            clean = lagged(series.values[:, :1], 2, 2) @ MARKOV
            series = series.replace("y", np.pad(clean, 2) + rng.standard_normal(300))
        operators.append(siso(series, weights=weights if weighted else None))
    assert is_chi_square(distances(operators), 5)


@st.composite
def flights(draw):
    """Draw several records, weights with gaps over garbage, orders and channels."""
    r, d = draw(st.integers(0, 4)), draw(st.integers(0, 4))
    inputs, outputs = list("uvw")[: draw(st.integers(1, 3))], list("yz")[: draw(st.integers(1, 2))]
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    records, weights = [], []
    for kind in draw(st.lists(st.sampled_from(["ones", "each", "runs", "gaps"]), min_size=1, max_size=3)):
        samples = draw(st.integers(1, 150)) if records else 200
        values = rng.standard_normal((samples, len(inputs) + len(outputs))) + 3.0
        w = {"ones": np.ones(samples), "each": rng.random(samples) + 0.1}.get(kind)
        if w is None:
            levels = rng.integers(1, 4, samples) if kind == "runs" else rng.integers(0, 2, samples)
            w = np.repeat(levels, rng.integers(5, 40, samples))[:samples].astype(float)
        values[w == 0] = rng.choice([np.nan, np.inf, 1e300], values[w == 0].shape)
        records.append(Record(values, channels=[*inputs, *outputs], sample_period_s=0.01))
        weights.append(w)
    return records, inputs, outputs, r, d, weights


def test_a_list_of_one_record_takes_a_list_of_one_array_of_weights():
    for weight in (1.0, 1e-100, 1e100):
        assert siso([uneven(0)[0]], weights=[np.full(300, weight)]).rank == 5


@settings(max_examples=50)
@given(flights())
def test_records_and_weights_give_the_stacked_weighted_equations(drawn):
    records, inputs, outputs, r, d, weights = drawn
    size = (r + d + 1) * len(inputs)
    phi, y, w = dense(records, inputs, outputs, r, d, weights)
    assume(len(phi) >= 2 * size and w.sum() > size + 1)
    operator = siso(records, None, r, d, inputs, outputs, weights)
    np.testing.assert_allclose(operator.markov, least_squares(*drawn), rtol=0, atol=1e-10)
    assert operator.samples == len(phi)
    left = y - phi @ operator.markov.transpose(0, 2, 1).reshape(size, -1)
    np.testing.assert_allclose(operator.rms_residual, np.sqrt(w @ left**2 / w.sum()), rtol=1e-9)
    variance = w @ left**2 / (w.sum() - size - 1)
    inverse = np.linalg.inv((phi * w[:, None]).T @ phi)
    for o, name in enumerate(outputs):
        covariance = operator.covariance(name).reshape(size, size)
        np.testing.assert_allclose(covariance, inverse * variance[o], rtol=0, atol=1e-9 * np.abs(covariance).max())
        deviation = operator.standard_error[:, o].ravel()
        np.testing.assert_allclose(deviation, np.sqrt(np.diag(inverse) * variance[o]), rtol=1e-9)


def test_large_weights_leave_the_rank_as_it_is():
    u, e = np.random.default_rng(0).standard_normal((2, 2000))
    slow = signal.lfilter(*signal.butter(6, 0.02), u)
    series = record(u=slow, y=slow + 0.1 * e)
    assert siso(series, r=5, d=5).rank == 11
    assert siso(series, r=5, d=5, weights=np.full(2000, 1e8)).rank == 11


def test_weighted_prediction_errors_solve_both_weighted_problems():
    """At the end the operator is weighted least squares on data filtered by A, and A that on the residual."""
    rng = np.random.default_rng(12)
    u, e = rng.standard_normal((2, 1500))
    y = signal.lfilter([1.0], [1.0, -1.2, 0.5], e) * np.linspace(0.2, 2.0, 1500)
    y[2:-2] += lagged(u[:, None], 2, 2) @ MARKOV
    w = rng.random(1500) + 0.1
    series = record(u=u, y=y)
    operator = siso(series, PredictionError(noise_order=3, tolerance=0.0, most_iterations=500), r=3, d=2, weights=w)
    taps, h = operator.noise_model.autoregressive[0], operator.markov[:, 0, 0]
    centred = series.values - np.average(series.values, axis=0, weights=w)
    root = np.sqrt(w[6:-2])[:, None]  # lags of the operator, and of A on top of them
    white = signal.lfilter(taps, 1.0, centred, axis=0)[3:]
    phi = np.column_stack([lagged(white[:, :1], 3, 2), np.ones(len(white) - 5)])
    theta = np.linalg.lstsq(phi * root, white[3:-2, 1] * root[:, 0], rcond=None)[0]
    np.testing.assert_allclose(theta[:-1], h, atol=1e-6)
    left = lagged((centred[3:-2, 1] - lagged(centred[:, :1], 3, 2) @ h)[:, None], 3, 0)
    past = np.column_stack([left[:, 1:], np.ones(len(left))])
    expected = np.linalg.lstsq(past * root, -left[:, 0] * root[:, 0], rcond=None)[0]
    np.testing.assert_allclose(taps[1:], expected[:-1], atol=1e-6)


@pytest.mark.parametrize("factor", [1e-6, 1e-3, 1e6])
@pytest.mark.parametrize(
    "estimator",
    [
        LeastSquares(),
        LeastSquares(ridge=0.1),
        LeastSquares(truncate=0.1),
        PredictionError(noise_order=2),
        InstrumentalVariables(instruments=("u",), past=3),
        TotalLeastSquares(noise=0.1),
    ],
    ids=lambda kind: type(kind).__name__,
)
def test_a_factor_of_all_weights_changes_no_parameter(estimator, factor):
    rng = np.random.default_rng(1)
    u = rng.standard_normal(2000)
    series = record(u=u + 0.1 * rng.standard_normal(2000), y=u + 2 * np.roll(u, 1) + 0.1 * rng.standard_normal(2000))
    weights = rng.random(2000) + 0.5
    plain, scaled = (siso(series, estimator, weights=w) for w in (weights, factor * weights))
    np.testing.assert_allclose(scaled.markov, plain.markov, rtol=0, atol=1e-9)
    assert scaled.rank == plain.rank

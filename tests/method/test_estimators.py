"""Open loop: least squares and the prediction-error method are as exact, and as uncertain, as they say."""

import numpy as np
import pytest
from scipy import signal

from gtmbench.errors import ConvergenceWarning, InputError, RankWarning
from gtmbench.method.estimators.prediction_error import PredictionError
from gtmbench.method.residual import innovations, residual
from tests.helpers.oracles import MARKOV, distances, is_chi_square, lagged, record, siso

NOISE = [1.0, -1.6, 0.7]  # A(q) e = epsilon
INPUT = [1.0, -0.9]  # A(q) u = white


def coloured(seed, samples, noise=NOISE):
    """Return a record of a slow input, and of the output under noise coloured by 1 / A."""
    rng = np.random.default_rng([7, seed])
    u = signal.lfilter([1.0], INPUT, rng.standard_normal(samples + 200))[100:]
    e = signal.lfilter([1.0], noise, rng.standard_normal(samples + 200))[100:]
    y = e.copy()
    y[2:-2] += lagged(u[:, np.newaxis], 2, 2) @ MARKOV
    return record(u=u[50 : samples + 50], y=y[50 : samples + 50])


@pytest.fixture(scope="module")
def repeated():
    """Return least squares and prediction errors of 200 records."""
    records = [coloured(seed, 1000) for seed in range(200)]
    return (
        records,
        [siso(given) for given in records],
        [siso(given, PredictionError(noise_order=2)) for given in records],
    )


def test_coloured_noise_leaves_the_covariance_of_prediction_errors_right(repeated):
    _, plain, whitened = repeated
    assert is_chi_square(distances(whitened), 5)
    assert not is_chi_square(distances(plain), 5)  # least squares takes the noise as white


def gauss_markov(record, taps):
    """Return generalised least squares for noise whose A is known."""
    whitened = signal.lfilter(taps, 1.0, record.values - record.values.mean(axis=0), axis=0)[len(taps) - 1 :]
    phi = lagged(whitened[:, :1], 2, 2)
    return np.linalg.lstsq(phi, whitened[2:-2, 1], rcond=None)[0]


def correlations(denominator, numerator=(1.0,), lags=400):
    """Return the autocorrelation of white noise filtered, at lags -lags..lags."""
    h = signal.lfilter(numerator, denominator, np.eye(1, 4000)[0])
    return signal.correlate(h, h)[3999 - lags : 4000 + lags]


def toeplitz(values, shift=0):
    """Return the 5 x 5 matrix of values at lag shift + j - i."""
    middle = len(values) // 2 + shift
    return np.array([[values[middle + j - i] for j in range(5)] for i in range(5)])


def test_the_noise_model_is_the_inverse_of_the_noise_filter(repeated):
    """An autoregression's asymptotic covariance is sigma^2 / n times the inverse of the noise's correlations."""
    taps = np.array([operator.noise_model.autoregressive[0] for operator in repeated[2]])
    assert (taps[:, 0] == 1.0).all()
    off = taps[:, 1:] - NOISE[1:]
    metric = toeplitz(correlations(NOISE))[:2, :2]
    assert is_chi_square(1000 * np.einsum("ki,ij,kj->k", off, metric, off), 2)
    std = np.array([operator.noise_model.innovation_std[0] for operator in repeated[2]])
    assert np.mean(std**2) == pytest.approx(1.0, abs=5 * np.sqrt(2.0 / 1000 / 200) + 10 / 1000)


def test_at_the_end_neither_the_parameters_nor_the_noise_model_can_be_improved():
    given = coloured(0, 3000)
    operator = siso(given, PredictionError(noise_order=2, tolerance=0.0, most_iterations=500))
    taps, h = operator.noise_model.autoregressive[0], operator.markov[:, 0, 0]
    np.testing.assert_allclose(gauss_markov(given, taps), h, atol=1e-6)
    centred = given.values - given.values.mean(axis=0)
    e = centred[2:-2, 1] - lagged(centred[:, :1], 2, 2) @ h
    np.testing.assert_allclose(
        np.linalg.lstsq(lagged(e[:, None], 2, 0)[:, 1:], -e[2:], rcond=None)[0], taps[1:], atol=1e-6
    )
    assert operator.noise_model.innovation_std[0] == pytest.approx(np.std(signal.lfilter(taps, 1.0, e)[2:]), rel=1e-9)
    assert operator.rms_residual[0] == pytest.approx(np.std(e), rel=1e-9)


def test_the_criterion_of_one_output_is_the_mean_square_of_its_innovations():
    model = siso(coloured(0, 400), PredictionError(noise_order=2)).noise_model
    assert model.criterion[-1] == pytest.approx(model.innovation_std[0] ** 2, rel=1e-9)


@pytest.mark.parametrize("order", [0, 1, 5, 20])
def test_the_criterion_never_rises_and_says_when_it_settled(order):
    for seed in range(10):
        model = siso(coloured(seed, 400), PredictionError(noise_order=order)).noise_model
        assert model.converged
        assert (np.diff(model.criterion[:, 0]) <= 1e-12 * model.criterion[0]).all()
        assert model.criterion[-2] - model.criterion[-1] <= 1e-8 * model.criterion[-2]


def test_one_iteration_isnt_called_converged():
    with pytest.warns(ConvergenceWarning, match="hasn't settled after 1 iterations"):
        model = siso(coloured(0, 400), PredictionError(noise_order=5, most_iterations=1)).noise_model
    assert (model.converged, model.criterion.shape) == (False, (1, 1))


def test_no_noise_model_is_least_squares():
    given = coloured(0, 400)
    plain = siso(given, PredictionError(noise_order=0, tolerance=0.0))  # which changes nothing in its second turn
    np.testing.assert_allclose(plain.markov, siso(given).markov, rtol=0, atol=1e-13)
    assert (plain.noise_model.converged, len(plain.noise_model.criterion)) == (True, 2)


def test_every_output_has_its_own_noise_model():
    given, other = coloured(0, 800), coloured(1, 800, [1.0, 0.7])
    both = record(u=given["u"], y=given["y"], w=1e6 * other["y"])
    operator = siso(both, PredictionError(noise_order=3), outputs=["y", "w"])
    for o, name in enumerate(["y", "w"]):
        alone = siso(both, PredictionError(noise_order=3), outputs=[name])
        np.testing.assert_allclose(operator.markov[:, o], alone.markov[:, 0], rtol=1e-9)
        np.testing.assert_allclose(
            operator.noise_model.autoregressive[o], alone.noise_model.autoregressive[0], atol=1e-9
        )
        np.testing.assert_allclose(operator.covariance(name), alone.covariance(name), rtol=1e-9)


def test_gaps_and_records_are_never_filtered_across():
    """The same pieces, as records or as what weights of 0 leave, and garbage between: the same estimate."""
    given = coloured(0, 900)
    weights = np.ones(900)
    weights[300:340] = 0.0
    holed = given.replace("y", np.where(weights > 0, given["y"], np.nan))
    pieces = [given.between(0, 2.99), given.between(3.4, 8.99)]
    expected = siso(pieces, PredictionError(noise_order=4))
    operator = siso(holed, PredictionError(noise_order=4), weights=weights)
    np.testing.assert_allclose(operator.markov, expected.markov, rtol=0, atol=1e-12)
    np.testing.assert_allclose(operator.standard_error, expected.standard_error, rtol=1e-9)


def test_a_wave_of_one_frequency_warns_with_any_noise_model():
    wave = np.sin(2 * np.pi * np.arange(2000) / 50)
    given = record(u=wave, y=wave + np.random.default_rng(1).standard_normal(2000))
    with pytest.warns(RankWarning, match="determines 2 of the 5"):
        assert siso(given, PredictionError(noise_order=2)).rank == 2


def test_the_innovations_of_a_record_are_those_of_its_residual():
    given = coloured(0, 800)
    operator = siso(given, PredictionError(noise_order=3))
    e, taps = residual(operator, given).values[:, 0], operator.noise_model.autoregressive[0]
    white = innovations(operator, given)
    expected = [np.nan if k < 3 else taps @ e[k - 3 : k + 1][::-1] for k in range(800)]
    np.testing.assert_allclose(white.values[:, 0], expected, rtol=0, atol=1e-12)
    assert np.sqrt(np.nanmean(white.values**2)) == pytest.approx(operator.noise_model.innovation_std[0], rel=0.01)
    with pytest.raises(InputError, match="has no noise model; identify it by PredictionError"):
        innovations(siso(given), given)
    with pytest.raises(InputError, match=r"residuals of shape \(800, 2\) for 1 outputs"):
        operator.noise_model.innovations(np.ones((800, 2)))


def test_the_noise_models_parameters_count_as_parameters():
    """Mean over 40 draws of white noise: its variance, 1, whatever the order; uncounted, 40 of 400 would miss 10 %."""
    rng = np.random.default_rng(4)
    variances = []
    for _ in range(40):
        u, e = rng.standard_normal((2, 400))
        variances.append(siso(record(u=u, y=u + e), PredictionError(noise_order=40)).noise_variance[0])
    assert np.mean(variances) == pytest.approx(1.0, abs=4 * np.std(variances) / np.sqrt(40))
    assert 4 * np.std(variances) / np.sqrt(40) < 0.06


def test_an_order_may_be_a_numpy_integer():
    given = coloured(0, 400)
    plain, other = (siso(given, PredictionError(noise_order=n)) for n in (3, np.int64(3)))
    np.testing.assert_array_equal(plain.markov, other.markov)

"""IIR models: exact plants come back exactly, noise leaves what theory says, and nothing depends on means or units."""

import re

import numpy as np
import pytest
import scipy.optimize
from scipy import signal

from gtmbench.errors import InputError
from tests.helpers.oracles import sampled
from theory.closed_loop import loop_records
from theory.iir import arx, iv4
from theory.pem import pem
from theory.plants import example_3_2

A, B, C = [1.0, -1.1, 0.3], [0.0, 1.0, 0.5], [1.0, 0.4, 0.2]
ESTIMATORS = {"arx": arx, "iv4": lambda record, order: iv4(record, order=order, instrument="c"), "pem": pem}


def armax(seed, samples=2000, noise=C, std=0.5):
    """Return a record of A y = B u + C e, white u."""
    u, e = np.random.default_rng([11, seed]).standard_normal((2, samples))
    return sampled(
        np.column_stack([u, u, signal.lfilter(B, A, u) + std * signal.lfilter(noise, A, e)]), ["c", "u", "y"]
    )


def theta(model):
    return np.concatenate([model.denominator[1:], model.numerator[1:]])


@pytest.fixture(scope="module")
def loop():
    """Return a loop around an unstable plant without noise: example 3.2."""
    example = example_3_2()
    return example.plant, loop_records(example.plant, example.gain, samples=2000)[0]


@pytest.mark.parametrize("name", ESTIMATORS)
@pytest.mark.parametrize("order", [7, 9])
def test_an_unstable_plant_is_found_exactly_in_its_loop(loop, name, order):
    plant, record = loop
    model = ESTIMATORS[name](record, order=order)
    circle = np.exp(1j * np.linspace(0.0, np.pi, 50))
    np.testing.assert_allclose(model.plant.at(circle), plant.at(circle), rtol=0, atol=1e-7)
    np.testing.assert_allclose(model.plant.markov(30), plant.markov(30), rtol=1e-5, atol=1e-6)
    assert np.nanmax(np.abs(model.innovations(record).values)) < 1e-10
    assert model.converged


def test_least_squares_are_those_of_the_equations_written_out():
    record = armax(1, samples=300)
    u, y = record["u"], record["y"]
    rows = [[-y[k - 1], -y[k - 2], -y[k - 3], u[k - 1], u[k - 2], u[k - 3], 1.0] for k in range(3, 300)]
    expected = np.linalg.lstsq(np.array(rows), y[3:], rcond=None)[0]
    model = arx(record, order=3)
    np.testing.assert_allclose([*theta(model), model.offset], expected, rtol=1e-9)
    np.testing.assert_allclose(model.innovations(record).values[3:, 0], y[3:] - rows @ expected, rtol=0, atol=1e-11)
    assert np.all(np.isnan(model.innovations(record).values[:3]))


def recursive_innovations(parameters, u, y):
    """Return e(k) sample by sample, from k = 2 on."""
    a1, a2, b1, b2, c1, c2, offset = parameters
    e = np.zeros(len(y))
    for k in range(2, len(y)):
        e[k] = y[k] + a1 * y[k - 1] + a2 * y[k - 2] - b1 * u[k - 1] - b2 * u[k - 2] - offset
        e[k] -= c1 * e[k - 1] + c2 * e[k - 2]
    return e[2:]


def test_prediction_errors_are_least_as_a_search_without_derivatives_of_ours_finds_them():
    record = armax(2, samples=400)
    u, y = record["u"], record["y"]
    search = scipy.optimize.least_squares(
        recursive_innovations, [*A[1:], *B[1:], *C[1:], 0.0], args=(u, y), xtol=1e-12, ftol=1e-12, gtol=1e-12
    )
    model = pem(record, order=2)
    ours = model.innovations(record).values[2:, 0]
    given = [*theta(model), *model.noise_numerator[1:], model.offset]
    np.testing.assert_allclose(ours, recursive_innovations(given, u, y), rtol=0, atol=1e-10)
    assert np.sum(ours**2) <= 2.0 * search.cost * (1.0 + 1e-6)
    np.testing.assert_allclose(given, search.x, rtol=0, atol=2e-3)


@pytest.mark.nightly
def test_fed_back_noise_spares_instruments_from_the_exogenous_signal_only():
    example = example_3_2()
    records = loop_records(example.plant, example.gain, samples=40_000, runs=2, snr=10.0)
    circle = np.exp(1j * np.linspace(0.0, np.pi, 50))
    truth = example.plant.at(circle)

    def error(estimator):
        models = [estimator(record) for record in records]
        return np.mean([np.linalg.norm(model.plant.at(circle) - truth) for model in models]) / np.linalg.norm(truth)

    consistent = error(lambda record: iv4(record, order=7, instrument="c"))
    for biased in (
        lambda record: iv4(record, order=7, instrument="u"),
        lambda record: arx(record, order=7),
        lambda record: pem(record, order=7),
    ):
        assert error(biased) > 5.0 * consistent


@pytest.mark.parametrize("name", ESTIMATORS)
def test_the_samples_that_a_short_record_is_told_to_have_are_enough(name):
    record = armax(6, samples=200)
    with pytest.raises(InputError, match="too few for an IIR model of order 3") as refused:
        ESTIMATORS[name](record.between(0.0, 0.05), order=3)
    needed = int(re.search(r"record (\d+) or more", str(refused.value))[1])
    ESTIMATORS[name](record.between(0.0, (needed - 1) * 0.01), order=3)

"""Closed loop, noise fed back: instruments are consistent where least squares and prediction errors can't be."""

import re

import numpy as np
import pytest
import scipy.linalg
from scipy import signal, stats

from gtmbench.errors import InputError, RankWarning
from gtmbench.method.estimators.least_squares import InstrumentalVariables
from gtmbench.method.estimators.prediction_error import PredictionError
from tests.helpers.night import by_day
from tests.helpers.oracles import means, record, siso
from tests.helpers.plants import companion, example_3_2

SMALL = companion([0.5, 1.0], [0.5, 1.8])
SNR = 10.0  # of c's power over v's


def loops(plant, samples, count, seed=0):
    """Return records of c, u, y: white c, process noise v behind where u is measured."""
    c, v = np.moveaxis(np.random.default_rng([seed, samples]).standard_normal((2, samples, 1, count)), -1, 1)
    u, y = plant.closed_loop(c, plant.lqr(1.0), v / np.sqrt(SNR))
    return [record(c=c[i, :, 0], u=u[i, :, 0], y=y[i, :, 0]) for i in range(count)]


def rms_error(records, estimator, truth, r, d):
    errors = [siso(series, estimator, r, d).markov - truth for series in records]
    return np.sqrt(np.mean(np.square(errors)))


DELAYED = InstrumentalVariables(instruments=("c",), delay=3)
PAST = InstrumentalVariables(instruments=("c",), past=20)
FILTERED = InstrumentalVariables(instruments=("c",), delay=3, prefilter=([1.0, 0.5], [1.0, -0.4]))


@pytest.fixture(scope="module")
def examples():
    """Return loops of example 3.2: 24 of 4000 samples and 24 of 16,000."""
    return {samples: loops(example_3_2(), samples, 24) for samples in (4000, 16_000)}


@pytest.mark.parametrize("estimator", by_day([DELAYED, PAST, FILTERED]), ids=["delayed", "past", "filtered"])
def test_instruments_are_consistent_in_example_3_2(examples, estimator):
    """Four times the samples halve the error: 24 loops of 101 parameters tell the ratio to about 10 %."""
    truth = example_3_2().laurent(50, 50)
    short, long = (rms_error(some, estimator, truth, 50, 50) for some in examples.values())
    assert 1.6 < short / long < 2.5
    mean = np.mean([siso(series, estimator, 50, 50).markov for series in examples[16_000]], axis=0) - truth
    assert np.sqrt(np.mean(mean**2)) < 1.5 * long / np.sqrt(24)  # what is left averages out: no bias


@pytest.fixture(scope="module")
def endogenous():
    """Return 300 records whose input holds some of the output's own white noise: theory's covariance is exact there."""
    records = []
    for seed in range(300):
        c, e = np.random.default_rng([3, seed]).standard_normal((2, 500))
        u = signal.lfilter([1.0, 0.5], 1.0, c) + 0.7 * e
        records.append(record(c=c, u=u, y=2.0 * u + e))
    return records


def test_the_covariance_of_instruments_is_right_and_least_squares_misses(endogenous):
    truth = np.array([0.0, 2.0, 0.0])
    for estimator, right in ((InstrumentalVariables(instruments=("c",), past=1), True), (None, False)):
        operators = [siso(series, estimator, 1, 1) for series in endogenous]
        off = [operator.markov[:, 0, 0] - truth for operator in operators]
        squares = [
            x @ np.linalg.solve(operator.covariance("y")[:, 0, :, 0], x)
            for x, operator in zip(off, operators, strict=True)
        ]
        low, high = stats.chi2.ppf([1e-5, 1 - 1e-5], 3 * 300)
        assert (low < np.sum(squares) < high) == right


def written_out(records, estimator, r, d, inputs, weights):
    """Return Z, Phi, y, each times the root of the weights, over all equations whose samples all count."""
    causal, noncausal = r + estimator.delay + estimator.past, d - estimator.delay + estimator.future
    names = [*estimator.instruments, *inputs, "y"]
    centre, count, parts = means(records, names, weights), len(estimator.instruments), []
    reach = max(noncausal, d)
    for series, w in zip(records, weights, strict=True):
        values = series.matrix(names) - centre
        z = values[:, :count]
        if estimator.prefilter:
            z = signal.lfilter(*estimator.prefilter, z, axis=0)
        rows = range(causal, len(values) - reach)
        root = np.sqrt(w[list(rows)])[:, None]
        parts.append(
            (
                np.array([[z[k - i] for i in range(-noncausal, causal + 1)] for k in rows]).reshape(len(rows), -1)
                * root,
                np.array([[values[k - i, count:-1] for i in range(-d, r + 1)] for k in rows]).reshape(len(rows), -1)
                * root,
                values[list(rows), -1:] * root,
                root,
            )
        )
    z, phi, y, ones = (np.concatenate(part) for part in zip(*parts, strict=True))
    # a constant is one more parameter, and its own instrument: all columns lose what it explains
    return [column - ones @ (ones.T @ column) / (ones.T @ ones) for column in (z, phi, y)]


CASES = {
    "basic": ({}, ["u"]),
    "delayed": ({"delay": 2}, ["u"]),
    "delayed beyond": ({"delay": 7}, ["u"]),
    "past": ({"past": 3}, ["u"]),
    "future": ({"delay": 1, "future": 4}, ["u"]),
    "filtered": ({"delay": 1, "prefilter": ([2.0, 0.0, 1.0], [2.0, -1.0])}, ["u"]),
    "two of each": ({"instruments": ("c", "b")}, ["u", "v"]),
    "one for two": ({"past": 9}, ["u", "v"]),
}


@pytest.mark.parametrize("several", [False, True])
@pytest.mark.parametrize("case", CASES)
def test_instruments_solve_their_equations_written_out(case, several):
    given_settings, inputs = CASES[case]
    estimator = InstrumentalVariables(**{"instruments": ("c",), **given_settings})
    rng = np.random.default_rng(2)
    records, weights = [], []
    for samples in (400, 150) if several else (400,):
        c, b, e = rng.standard_normal((3, samples))
        mixed = signal.lfilter([1.0, 0.6, 0.3, 0.5, -0.4, 0.3], [1.0, -0.5], c)
        u, v = mixed + 0.5 * e, np.roll(b, 2) + np.roll(mixed, 7) + 0.3 * e
        records.append(record(c=1e5 * c + 7.0, b=b, u=1e-6 * u, v=v + 3.0, y=u - np.roll(v, 1) + e))
        weights.append(rng.random(samples) + 0.5 if several else np.ones(samples))
    operator = siso(records, estimator, 3, 2, inputs, weights=weights if several else None)
    z, phi, y = written_out(records, estimator, 3, 2, inputs, weights)
    theta = operator.markov[:, 0].reshape(-1, 1)
    left = y - phi @ theta
    if z.shape[1] == phi.shape[1]:
        scale = np.linalg.norm(z, axis=0) * np.linalg.norm(y)
        np.testing.assert_allclose((z.T @ left)[:, 0] / scale, 0.0, atol=1e-11)
    basis = scipy.linalg.orth(z / np.linalg.norm(z, axis=0))
    scale = np.linalg.norm(phi, axis=0)
    expected = np.linalg.lstsq(basis.T @ phi / scale, basis.T @ y, rcond=None)[0] / scale[:, None]
    np.testing.assert_allclose(
        theta * scale[:, None], expected * scale[:, None], rtol=0, atol=1e-9 * np.abs(expected * scale[:, None]).max()
    )
    np.testing.assert_allclose(operator.input_means, means(records, inputs, weights), rtol=1e-9, atol=1e-15)
    projected = basis.T @ phi
    total = sum(
        np.sum(w[3 + estimator.delay + estimator.past : len(w) - max(2, 2 - estimator.delay + estimator.future)])
        for w in weights
    )
    variance = np.sum(left**2) / (total - phi.shape[1] - 1)
    expected_covariance = variance * np.linalg.inv(projected.T @ projected / np.outer(scale, scale))
    stated = operator.covariance("y").reshape(phi.shape[1], -1) * np.outer(scale, scale)
    np.testing.assert_allclose(stated, expected_covariance, rtol=0, atol=1e-8 * np.abs(expected_covariance).max())


def test_instruments_that_move_at_one_frequency_determine_two_parameters():
    rng = np.random.default_rng(0)
    c = np.sin(2 * np.pi * np.arange(2000) / 50)
    u = c + rng.standard_normal(2000)
    series = record(c=c, u=u, y=u + 0.1 * rng.standard_normal(2000))
    with pytest.warns(RankWarning, match="the instruments c determine 2 of the 11 Markov parameters"):
        operator = siso(series, InstrumentalVariables(instruments=("c",)), 5, 5)
    assert operator.rank == 2


@pytest.mark.filterwarnings("ignore::gtmbench.errors.ConvergenceWarning")  # as many parameters as equations
@pytest.mark.parametrize(
    "estimator",
    [InstrumentalVariables(instruments=("c",), past=60), PredictionError(noise_order=60)],
    ids=["IV", "PEM"],
)
def test_the_samples_that_a_short_record_is_told_to_have_are_just_enough(estimator):
    record = loops(SMALL, 400, 1)[0]
    with pytest.raises(ValueError, match="samples of u give 0 equations") as refused:
        siso(record.between(0.0, 0.59), estimator, 5, 5)
    needed = int(re.search(r"at least (\d+) samples", str(refused.value))[1])
    assert needed == 142  # 72 unknowns, constant included, and 70 samples before and behind that no equation is of
    siso(record.between(0.0, (needed - 1) * 0.01), estimator, 5, 5)
    with pytest.raises(ValueError, match=f"at least {needed} samples"):
        siso(record.between(0.0, (needed - 2) * 0.01), estimator, 5, 5)


@pytest.mark.parametrize("pole", [1.0, -1.1])
def test_a_prefilter_is_stable(pole):
    with pytest.raises(InputError, match="pole of magnitude 1"):
        InstrumentalVariables(instruments=("c",), prefilter=([1.0], [1.0, -pole]))
    InstrumentalVariables(instruments=("c",), prefilter=([1.0], [1.0, -0.99 * pole / abs(pole)]))


def test_an_output_is_no_instrument_of_its_own():
    with pytest.raises(ValueError, match="'y' is instrument and pseudo output, with lag -5"):
        siso(loops(SMALL, 400, 1)[0], InstrumentalVariables(instruments=("y",)), 5, 5)
    with pytest.raises(ValueError, match="with lag 0"):
        siso(loops(SMALL, 400, 1)[0], InstrumentalVariables(instruments=("y",), delay=1), 1, 1)
    assert siso(loops(SMALL, 400, 1)[0], InstrumentalVariables(instruments=("y",), delay=2), 1, 1).rank == 3

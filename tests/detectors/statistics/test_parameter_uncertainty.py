"""Parameter uncertainty: the variance of a model's error from that of its parameters, against the same the slow way."""

from dataclasses import replace

import numpy as np
import pytest

from gtmbench.detectors.statistics.statistic import Allowance, Spread, Statistic
from gtmbench.detectors.statistics.uncertainty import ParameterUncertainty
from gtmbench.detectors.statistics.whitening import White
from gtmbench.method.regression.equations import HALF, held, interpolated, slow
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import Record
from tests.helpers.night import by_day

ONE = np.ones(1)
ORDERS = [(0, 0), (3, 0), (0, 2), (4, 3)]


def motion(samples, inputs=2, seed=1):
    return np.random.default_rng(seed).standard_normal((samples, inputs))


def root_of(size, seed=2):
    return np.random.default_rng(seed).standard_normal((size, size))


def known_to(root):
    return ParameterUncertainty(root=root, raw=2.0, white=3.0)


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


def through(u, by, uncertainty, coefficients=ONE, test=None):
    """Return the spread of all rows."""
    return uncertainty.of_inputs(by, u, coefficients, test or Statistic(name="energy"))


def leverage(motion, causal, noncausal, root):
    """Return |F' phi(k)|^2 the slow way, 0 where phi(k) isn't complete."""
    leverages = np.zeros(len(motion))
    for k in range(causal, len(motion) - noncausal):
        phi = np.concatenate([motion[k - i] for i in range(-noncausal, causal + 1)])
        leverages[k] = phi @ root @ root.T @ phi
    return leverages


def shifts(motion, rows, before):
    """Return the mean of the last rows less that of those before, the slow way."""
    means = np.zeros(motion.shape)
    for k in range(len(motion)):
        begin = max(k + 1 - rows, 0)
        base = motion[max(begin - before, 0) : begin]
        means[k] = motion[begin : k + 1].mean(axis=0) - (base.mean(axis=0) if len(base) else 0.0)
    return means


def whitened(motion, coefficients):
    """Return motion through a filter, the slow way: as if the first row had been before."""
    order = len(coefficients) - 1
    longer = np.concatenate([np.repeat(motion[:1], order, axis=0), motion])
    return sum(a * longer[order - i : len(longer) - i] for i, a in enumerate(coefficients))


@pytest.mark.parametrize(("causal", "noncausal"), ORDERS)
def test_the_spread_is_the_covariance_of_a_prediction_with_such_parameters_and_of_its_means(causal, noncausal):
    u, size = motion(200), 2 * (causal + noncausal + 1)
    root, coefficients = root_of(size), np.array([1.0, -0.6, 0.2])
    test = Statistic(windows_s=(0.4, 2.0), baseline_s=4.0)
    spread = through(
        u,
        operator(np.zeros(size), causal, noncausal),
        known_to(root),
        coefficients,
        test,
    )
    white = whitened(slow(u), coefficients)
    np.testing.assert_allclose(spread.raw**2 - 1.0, 2.0 * leverage(slow(u), causal, noncausal, root), rtol=1e-9)
    np.testing.assert_allclose(spread.white**2 - 1.0, 3.0 * leverage(white, causal, noncausal, root), rtol=1e-9)
    assert list(spread.means) == [4, 20]
    for rows, variance in spread.means.items():
        expected = 3.0 * leverage(shifts(white, rows, 40), causal, noncausal, root)
        np.testing.assert_allclose(variance, expected, rtol=1e-8, atol=1e-12)


def test_a_window_about_as_long_as_the_rows_at_once_is_as_if_all_were_worked_out_alone():
    """512 rows at once, of more than 64 parameters; of 500 some windows begin before there are 40 lags."""
    u, root, coefficients = motion(560), root_of(82), np.array([1.0, -0.6])
    test = Statistic(windows_s=(0.4, 50.0), baseline_s=4.0)
    spread = through(u, operator(np.zeros(82), 40, 0), known_to(root), coefficients, test)
    for rows, variance in spread.means.items():
        expected = 3.0 * leverage(shifts(whitened(slow(u), coefficients), rows, 40), 40, 0, root)
        np.testing.assert_allclose(variance, expected, rtol=1e-8, atol=1e-12)


@pytest.mark.parametrize("factor", [0.0, 1.0, 3.0])
def test_a_factor_weighs_variances_beyond_that_of_noise(factor):
    alone = Spread(raw=np.array([1.0, 1.5]), white=np.array([1.0, 4.0]), means={4: np.array([0.0, 0.3])})
    told = ParameterUncertainty(root=root_of(2), raw=2.0 * factor, white=factor).weighed(alone)
    np.testing.assert_allclose(told.raw**2 - 1.0, 2.0 * factor * np.array([0.0, 1.25]), atol=1e-12)
    np.testing.assert_allclose(told.white**2 - 1.0, factor * np.array([0.0, 15.0]), atol=1e-12)
    np.testing.assert_allclose(told.means[4], factor * alone.means[4])


@pytest.mark.parametrize("samples", by_day([41, 4097, 8197], 2))
@pytest.mark.parametrize("gaps", [False, True])
def test_whichever_rows_are_asked_for_the_spread_is_the_same(samples, gaps):
    u = motion(samples)
    if gaps:
        u[np.random.default_rng(3).random(u.shape) < 0.02] = np.nan
        u[: samples // 3, 0] = np.nan
    test = Statistic(windows_s=(0.4, 30.0), baseline_s=100.0)
    by, uncertainty, coefficients = operator(np.zeros(12), 3, 2), known_to(root_of(12)), np.array([1.0, -0.6])
    whole = through(u, by, uncertainty, coefficients, test)
    for first in (1, samples // 2, samples - 9):
        some = uncertainty.of_inputs(by, u, coefficients, test, first)
        for late, other in zip(arrays(some), arrays(whole), strict=True):
            assert len(late) == len(other) == samples
            np.testing.assert_allclose(late[first:], other[first:], rtol=1e-9, atol=1e-12)


def arrays(spread):
    return [spread.raw, spread.white, *spread.means.values()]


@pytest.mark.parametrize("missing", ["nothing", "the first row", "a late start", "a gap", "gaps"])
@pytest.mark.parametrize(("causal", "noncausal"), ORDERS)
def test_the_spread_stands_on_nothing_beyond_its_look_ahead(causal, noncausal, missing):
    u, size = motion(120), 2 * (causal + noncausal + 1)
    if missing == "the first row":
        u[0, 0] = np.nan
    if missing == "a late start":
        u[:30, 0] = np.nan
    if missing == "a gap":
        u[50:70, 1] = np.nan
    if missing == "gaps":
        u[np.random.default_rng(3).random(u.shape) < 0.03] = np.nan
    test = Statistic(windows_s=(0.4, 2.0), baseline_s=4.0)
    uncertainty = ParameterUncertainty(root=root_of(size), raw=2.0, white=3.0)
    given = operator(np.zeros(size), causal, noncausal), uncertainty, np.array([1.0, -0.6]), test
    whole = arrays(through(u, *given))
    for cut in (*range(1, 40), *range(41, 120, 7)):
        known = max(cut - HALF - noncausal, 0)
        for pieced, other in zip(arrays(through(u[:cut], *given)), whole, strict=True):
            assert len(pieced) == cut
            np.testing.assert_allclose(pieced[:known], other[:known], rtol=1e-9, atol=1e-12)


def test_a_derivative_takes_one_sample_more():
    angles = np.cumsum(np.random.default_rng(8).standard_normal((200, 3)), axis=0)
    angles[80:90, 1] = np.nan
    by = replace(operator(np.zeros(5), 2, 2, inputs=1), inputs=("p_att",))
    uncertainty = ParameterUncertainty(root=root_of(5), raw=2.0, white=3.0)

    def spread(rows):
        record = Record(angles[:rows], channels=["phi", "theta", "psi"], sample_period_s=0.1)
        return arrays(
            uncertainty.spread(by, record, np.array([1.0, -0.6]), Statistic(windows_s=(0.4,), baseline_s=4.0))
        )

    whole = spread(200)
    assert whole[0].max() > 1.5
    for cut in range(20, 200, 5):
        known = cut - HALF - 2 - 1
        for pieced, other in zip(spread(cut), whole, strict=True):
            np.testing.assert_allclose(pieced[:known], other[:known], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("gap", [slice(0, 9), slice(40, 41), slice(55, 60)])
def test_rows_that_no_complete_window_tells_of_have_a_spread_of_one(gap):
    u = motion(60)
    u[gap, 1] = np.nan
    spread = through(u, operator(np.zeros(12), 3, 2), known_to(root_of(12)))
    there = np.isfinite(operator(np.zeros(12), 3, 2).predict(Record(u, channels=["p", "q"], sample_period_s=0.1))[:, 0])
    assert (spread.raw[~there] == 1.0).all()
    assert (spread.raw[there] > 1.0).all()


@pytest.mark.parametrize("samples", [0, 1, 5])
def test_a_record_shorter_than_a_window_has_a_spread_of_one(samples):
    spread = through(motion(samples), operator(np.zeros(12), 3, 2), known_to(root_of(12)))
    assert spread.raw.tolist() == spread.white.tolist() == [1.0] * samples


def test_constants_and_ramps_come_through_at_the_ends_too():
    ramp = 5.0 + 0.3 * np.arange(60.0)
    np.testing.assert_allclose(slow(np.column_stack([ramp, np.full(60, -2.0)])).T, [ramp, np.full(60, -2.0)], atol=1e-9)


def test_missing_samples_are_held_or_bridged_by_a_line():
    line = np.column_stack([2.0 + 0.1 * np.arange(50.0), 3.0 - 0.2 * np.arange(50.0)])
    holes = line.copy()
    holes[20:31, 0] = np.nan
    holes[:4, 1] = np.inf
    expected = line.copy()
    expected[:4, 1] = line[4, 1]
    np.testing.assert_allclose(interpolated(holes), expected, rtol=1e-12)
    expected[20:31, 0] = line[19, 0]
    np.testing.assert_array_equal(held(holes), expected)
    holes[:, 1] = np.nan
    for bridged in (held, interpolated):
        assert (bridged(holes)[:, 1] == 0.0).all()
        np.testing.assert_array_equal(bridged(line), line)


def test_an_operators_error_that_lasts_is_judged_as_the_one_error_that_it_is():
    """Operators drawn from the uncertainty: they shift means by what is said, and seldom alarm."""
    random = np.random.default_rng(5)
    by, test = operator(np.zeros(2), 0, 0, period_s=0.01), Statistic(windows_s=(0.64,), baseline_s=2.0, two_sided=False)
    push = np.where((np.arange(1500) // 150) % 2, 3.0, -3.0)  # half turns of 1.5 s
    record = Record(np.column_stack([push, push**2 / 3.0]), channels=["p", "q"], sample_period_s=0.01)
    spread = ParameterUncertainty(root=0.5 * np.eye(2), raw=1.0, white=1.0).spread(by, record, np.ones(1), test)
    tolerance, drawn, greatest, judged = Allowance(high=2.0), [], [], []
    for _ in range(60):
        error = record.matrix(["p", "q"]) @ (0.5 * random.standard_normal(2)) + random.standard_normal(1500)
        drawn.append(error)
        scaled = test.scores(error, White.steady(error / spread.white), 0.01, tolerance)
        known = test.scores(error, White.steady(error), 0.01, tolerance, spread)
        greatest.append(np.nanmax(scaled[0].values))
        judged.append([np.nanmax(score.values) for score in known])
    assert np.median(greatest) > 20.0  # samples over their spread alone: most draws would alarm
    assert np.quantile(judged, 0.9, axis=0).max() < 12.0
    windows = shifts(np.array(drawn).T, 64, 200)[300:1400]
    ratio = windows.std(axis=1) / np.sqrt(1.0 / 64 + 1.0 / 200 + spread.means[64][300:1400])
    assert np.median(ratio) == pytest.approx(1.0, abs=0.15)


def test_a_shift_in_known_motion_alarms_as_without_doubt():
    test, noise = Statistic(windows_s=(0.64,), baseline_s=2.0), np.random.default_rng(6).standard_normal(1500)
    shifted = noise + np.where(np.arange(1500) > 1000, 1.5, 0.0)
    still = Record(np.zeros((1500, 2)), channels=["p", "q"], sample_period_s=0.01)
    uncertainty = ParameterUncertainty(root=0.5 * np.eye(2), raw=1.0, white=1.0)
    spread = uncertainty.spread(operator(np.zeros(2), 0, 0, period_s=0.01), still, np.ones(1), test)
    for score, other in zip(
        test.scores(noise, White.steady(shifted), 0.01, Allowance()),
        test.scores(noise, White.steady(shifted), 0.01, Allowance(), spread),
        strict=True,
    ):
        np.testing.assert_array_equal(score.values, other.values)

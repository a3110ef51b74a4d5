"""Noise on the pseudo inputs: total least squares, ridge and truncation against dense solutions in physical units."""

import numpy as np
import pytest
import scipy.linalg
from scipy import signal

from gtmbench.errors import InputError
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.estimators.total_least_squares import TotalLeastSquares
from gtmbench.values.record import Record
from tests.helpers.oracles import dense, lagged, record, siso

LEVELS = {"u": 0.3, "v": 0.5, "y": 0.4}
CORRELATED = np.array([[0.09, 0.03, 0.06], [0.03, 0.25, -0.08], [0.06, -0.08, 0.16]])
UNITS = [1.0, 1e8, 1e-8]


def identified(records, estimator, r=2, d=2, inputs=("u", "v"), outputs=("y",), weights=None):
    return siso(records, estimator, r, d, inputs, outputs, weights)


def measured(samples, covariance, seed=0, denominator=(1.0, -0.6)):
    """Return the operator, a record of two coloured inputs and an output without noise, and one with it."""
    rng = np.random.default_rng([4, seed])
    truth = np.random.default_rng(0).standard_normal((5, 1, 2))
    clean = signal.lfilter([1.0], denominator, rng.standard_normal((samples + 4, 2)), axis=0)
    y = lagged(clean, 2, 2) @ truth[:, 0].ravel()
    values = np.column_stack([clean[2:-2], y])
    noise = rng.multivariate_normal(np.zeros(3), covariance, samples)
    records = [Record(rows, channels=["u", "v", "y"], sample_period_s=0.01) for rows in (values, values + noise)]
    return truth, *records


def in_units(series, factors):
    return Record(series.values * factors, channels=series.channels, sample_period_s=0.01)


def eigenvectors(series, covariance, r, d, inputs=("u", "v"), output="y", rank=None):
    """Return theta and how many directions were kept: generalised eigenvectors of the Gram matrix and C.

    Directions whose eigenvalue noise explains span w; of w with w_y = -1 the one of the smallest w' C w is theta.
    """
    phi, y, _ = dense([series], list(inputs), [output], r, d)
    rows, count = np.column_stack([phi, y]), len(inputs)
    C = scipy.linalg.block_diag(*[covariance[:count, :count]] * (r + d + 1), covariance[count:, count:])
    C[d * count : (d + 1) * count, -1] = C[-1, d * count : (d + 1) * count] = covariance[:count, count]
    scale = 1.0 / np.sqrt(np.diag(C))
    values, vectors = scipy.linalg.eigh(rows.T @ rows * np.outer(scale, scale) / len(rows), C * np.outer(scale, scale))
    edge = (1.0 + np.sqrt(rows.shape[1] / len(rows))) ** 2
    kept = np.clip(np.sum(values > edge), 1, len(values) - 1) if rank is None else rank
    left_out = vectors[:, : len(values) - kept] * scale[:, None]
    least = np.linalg.pinv(left_out[-1:] / np.linalg.norm(left_out[-1])) / np.linalg.norm(left_out[-1])
    return -(left_out @ least)[:-1, 0], kept


@pytest.mark.parametrize("noise", ["levels", "matrix"])
@pytest.mark.parametrize("rank", [None, 10, 7, 1])
@pytest.mark.parametrize("units", [[1.0, 1.0, 1.0], [1e8, 1.0, 1e-8]])
def test_total_least_squares_is_the_generalised_eigenvector(noise, rank, units):
    covariance = np.diag(np.square(list(LEVELS.values()))) if noise == "levels" else CORRELATED
    _, _, noisy = measured(1500, covariance)
    scaled = covariance * np.outer(units, units)
    stated = scaled if noise == "matrix" else dict(zip("uvy", np.sqrt(np.diag(scaled)), strict=True))
    operator = identified(in_units(noisy, units), TotalLeastSquares(noise=stated, rank=rank))
    theta, kept = eigenvectors(noisy, covariance, 2, 2, rank=rank)
    theta = theta.reshape(5, 2) * units[2] / units[:2]
    np.testing.assert_allclose(
        operator.markov[:, 0] / np.abs(theta).max(axis=0), theta / np.abs(theta).max(axis=0), atol=1e-9
    )
    np.testing.assert_allclose(operator.sensor_noise, np.sqrt(np.diag(scaled)), rtol=1e-12)
    assert np.isnan(operator.standard_error).all()
    assert operator.rank == kept
    assert rank is not None or kept == 10


@pytest.mark.parametrize(
    "covariance", [np.diag(np.square(list(LEVELS.values()))), CORRELATED], ids=["levels", "matrix"]
)
def test_total_least_squares_is_consistent_where_least_squares_is_biased(covariance):
    """Four times the samples halve the error of one, and leave the other's where it is."""
    errors = {}
    for estimator in (TotalLeastSquares(noise=covariance), None):
        for samples in (4000, 16_000):
            off = [
                identified(r[2], estimator).markov - r[0] for r in (measured(samples, covariance, s) for s in range(24))
            ]
            errors[estimator is None, samples] = np.sqrt(np.mean(np.square(off)))
            bias = np.sqrt(np.mean(np.mean(off, axis=0) ** 2))
            share = bias / errors[estimator is None, samples]
            assert share > 0.9 if estimator is None else share < 2.0 / np.sqrt(24)
    assert 1.6 < errors[False, 4000] / errors[False, 16_000] < 2.5
    assert 0.9 < errors[True, 4000] / errors[True, 16_000] < 1.1
    assert errors[True, 16_000] > 4.0 * errors[False, 16_000]


def test_outputs_are_solved_each_with_its_own_noise():
    _, _, noisy = measured(1500, CORRELATED)
    w = np.roll(noisy["u"], 1) + 0.2 * np.random.default_rng(1).standard_normal(1500)
    both = record(u=noisy["u"], v=noisy["v"], y=noisy["y"], w=w)
    C = scipy.linalg.block_diag(CORRELATED, [[0.04]])
    operator = identified(both, TotalLeastSquares(noise=C), outputs=["y", "w"])
    for o, name in enumerate(["y", "w"]):
        own = C[np.ix_([0, 1, 2 + o], [0, 1, 2 + o])]
        theta, _ = eigenvectors(both, own, 2, 2, output=name)
        np.testing.assert_allclose(operator.markov[:, o].ravel(), theta, rtol=0, atol=1e-9)


SLOW = signal.butter(10, 0.3)


def slow(samples, seed):
    """Return a record of low-pass inputs and their output under white noise; above Nyquist / 2 only noise is left."""
    rng = np.random.default_rng([6, seed])
    clean = 3.0 * signal.lfilter(*SLOW, rng.standard_normal((samples + 104, 2)), axis=0)[100:]
    y = lagged(clean, 2, 2) @ np.linspace(1.0, -0.5, 10)
    values = np.column_stack([clean[2:-2], y])
    noise = rng.standard_normal(values.shape) * list(LEVELS.values())
    return [Record(rows, channels=["u", "v", "y"], sample_period_s=0.01) for rows in (values, values + noise)]


def test_noise_is_read_off_where_low_pass_signals_dont_move():
    """A mean over half a spectrum has n / 2 degrees of freedom: an error of 1 / sqrt(n), windows aside."""
    levels = [identified(slow(20_000, seed)[1], TotalLeastSquares()).sensor_noise for seed in range(10)]
    shares = np.array(levels) / list(LEVELS.values())
    np.testing.assert_allclose(shares.mean(axis=0), 1.0, atol=5.0 / np.sqrt(10 * 20_000))


def test_estimated_noise_is_used_as_if_it_were_stated_and_predicts_better_than_least_squares():
    clean, noisy = slow(20_000, 0)
    operator = identified(noisy, TotalLeastSquares())
    stated = identified(noisy, TotalLeastSquares(noise=dict(zip("uvy", operator.sensor_noise, strict=True))))
    np.testing.assert_allclose(operator.markov, stated.markov, rtol=0, atol=1e-9)
    off = [np.nanstd(model.predict(clean)[:, 0] - clean["y"]) for model in (operator, identified(noisy, None))]
    assert off[0] < 0.5 * off[1]


@pytest.mark.parametrize("noise", [None, {"u": 0.1, "v": 0.1, "y": 0.1}], ids=["estimated", "stated"])
@pytest.mark.parametrize("rank", [None, 6])
def test_noisy_sinusoids_give_a_finite_operator_that_predicts(noise, rank):
    """Three tones are six directions, fitted to n samples of noise 0.1 sqrt(1 + ||theta||^2): an RMS error of
    sqrt(6 / n) times that. The edge is where noise ends on average, so a few of its directions may stand above it.
    """
    rng, t = np.random.default_rng(3), np.arange(4000)
    tones = [np.sin(2 * np.pi * t / period + phase) for period, phase in ((100, 0.0), (37, 1.0), (19, 2.0))]
    u, v = tones[0] + 0.5 * tones[1] + tones[2], 0.4 * tones[0] - np.roll(tones[1], 3) + np.roll(tones[2], 5)
    values = np.column_stack([u, v, np.roll(tones[0], 4) + np.roll(tones[1], 2) - 0.5 * tones[2]])
    clean, noisy = (
        Record(samples, channels=["u", "v", "y"], sample_period_s=0.1)
        for samples in (values, values + 0.1 * rng.standard_normal(values.shape))
    )
    operator = identified(noisy, TotalLeastSquares(noise=noise, rank=rank), 10, 10)
    assert 6 <= operator.rank <= (rank or 12)
    assert np.linalg.norm(operator.markov) < 1.0
    off = operator.predict(clean)[20:-20, 0] - values[20:-20, 2]
    assert np.sqrt(np.mean(off**2)) < 3.0 * 0.1 * np.sqrt(6 / 4000) * np.sqrt(1.0 + np.sum(operator.markov**2))


def test_noise_that_isnt_there_cant_be_estimated():
    t = np.arange(1000)
    silent = record(u=np.random.default_rng(0).standard_normal(1000), v=np.where(t < 500, 0.0, 1.0), y=1.0 * t)
    with pytest.raises(InputError, match="shows no noise above half the Nyquist frequency"):
        identified([silent.between(0, 4.99), silent.between(5, 9.99)], TotalLeastSquares())


@pytest.mark.parametrize("kind", ["ridge", "truncate"])
@pytest.mark.parametrize("unit", UNITS)
@pytest.mark.parametrize("weighted", [False, True])
def test_ridge_and_truncation_are_the_dense_solutions_in_physical_units(kind, unit, weighted):
    """Ridge: (Phi' W Phi + n Sigma) theta = Phi' W y; truncation: singular values of Phi Sigma^-1/2 above sqrt(n)."""
    rng = np.random.default_rng(2)
    _, _, noisy = measured(800, 1e-4 * CORRELATED, denominator=[1.0, -1.7, 0.75])
    noisy = in_units(noisy, np.array([unit, 1.0, 1.0]))
    weights = rng.random(800) + 0.5 if weighted else None
    levels = {"u": 0.3 * unit, "v": 0.8}
    operator = identified(noisy, LeastSquares(**{kind: levels}), 4, 3, weights=weights)
    phi, y, w = dense([noisy], ["u", "v"], ["y"], 4, 3, None if weights is None else [weights])
    sigma = np.tile(list(levels.values()), 8)
    root, n = np.sqrt(w)[:, None], w.sum()
    if kind == "ridge":
        whitened = phi * root / sigma
        theta = np.linalg.solve(whitened.T @ whitened + n * np.eye(16), whitened.T @ (y * root))[:, 0] / sigma
        assert operator.rank == 16
    else:
        left, singular, right = np.linalg.svd(phi * root / sigma, full_matrices=False)
        keep = singular > np.sqrt(n)
        theta = right[keep].T @ (left[:, keep].T @ (y * root)[:, 0] / singular[keep]) / sigma
        assert 0 < operator.rank == keep.sum() < 16
    np.testing.assert_allclose(operator.markov[:, 0].ravel() * sigma, theta * sigma, rtol=0, atol=1e-11)
    rms = np.sqrt(w @ (y[:, 0] - phi @ theta) ** 2 / n)
    assert operator.rms_residual[0] == pytest.approx(rms, rel=1e-9)


@pytest.mark.parametrize("level", [0.0, {"u": 0.0, "v": 0.4}, {"u": -0.4, "v": 0.4}])
def test_a_level_of_noise_is_more_than_none(level):
    for kind in ("ridge", "truncate"):
        with pytest.raises(InputError, match=rf"{kind}.* must be a finite number greater than 0"):
            LeastSquares(**{kind: level})


@pytest.mark.parametrize("kind", ["ridge", "truncate"])
def test_one_number_stands_for_every_input(kind):
    _, _, noisy = measured(800, CORRELATED)
    markov, other = (identified(noisy, LeastSquares(**{kind: level})).markov for level in (0.4, {"u": 0.4, "v": 0.4}))
    np.testing.assert_array_equal(markov, other)


def test_truncation_keeps_just_what_stands_out_of_the_noise():
    """A level a thousandth below a direction's own RMS keeps the direction, a thousandth above it doesn't."""
    _, clean, _ = measured(800, CORRELATED, denominator=[1.0, -1.7, 0.75])
    phi, _, _ = dense([clean], ["u", "v"], ["y"], 2, 2)
    for kept, singular in enumerate(np.linalg.svd(phi, compute_uv=False) / np.sqrt(len(phi))):
        assert identified(clean, LeastSquares(truncate=0.999 * singular)).rank == kept + 1
        above = LeastSquares(truncate=1.001 * singular)
        if kept:
            assert identified(clean, above).rank == kept
        else:
            with pytest.raises(InputError, match="no direction of the pseudo inputs stands out"):
                identified(clean, above)


@pytest.mark.parametrize(("tone", "counts"), [(0.24, False), (0.28, True), (0.32, True), (0.48, True)])
def test_what_lies_above_half_the_nyquist_frequency_is_noise(tone, counts):
    """A tone of amplitude a there raises the spectrum's mean as white noise of variance a^2 does."""
    _, noisy = slow(20_000, 0)
    wave = 0.4 * np.sin(2.0 * np.pi * tone * np.arange(20_000))
    level = identified(noisy.replace("u", noisy["u"] + wave), TotalLeastSquares()).sensor_noise[0]
    assert level == pytest.approx(np.hypot(LEVELS["u"], 0.4 * counts), rel=0.03)


def test_noise_is_told_from_motion_that_has_as_much_power():
    rng = np.random.default_rng(1)
    motion = signal.lfilter(*SLOW, rng.standard_normal(40_100))[100:]
    for share, is_told in ((0.45, True), (0.55, False)):
        u = np.sqrt(1.0 - share) * motion / motion.std() + np.sqrt(share) * rng.standard_normal(40_000)
        given = record(u=u, y=motion + 0.1 * rng.standard_normal(40_000))
        if is_told:
            assert siso(given, TotalLeastSquares()).sensor_noise[0] == pytest.approx(np.sqrt(share), rel=0.03)
        else:
            with pytest.raises(InputError, match="'u' moves as much above half the Nyquist frequency as below"):
                siso(given, TotalLeastSquares())

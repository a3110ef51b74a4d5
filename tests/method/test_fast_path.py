"""The short cut, correlations instead of a regressor, gives what the written-out equations give."""

import warnings

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gtmbench.errors import RankWarning
from gtmbench.method.identify import identify
from gtmbench.method.regression import stretches as stretches_module
from gtmbench.method.regression import triangle as triangle_module
from gtmbench.method.regression.stretches import Scaling, Stretch
from gtmbench.values.record import Record
from tests.helpers.oracles import dense, exact_least_squares, lagged, least_squares, record

EPS = np.finfo(float).eps


def identified(records, r, d, inputs=("u", "v"), outputs=("y",), **others):
    return identify(records, inputs=list(inputs), outputs=list(outputs), causal_order=r, noncausal_order=d, **others)


def noisy(samples=600, seed=0):
    rng = np.random.default_rng(seed)
    u, v = rng.standard_normal((2, samples))
    y = np.roll(u, 2) - 0.5 * np.roll(v, -1) + 0.3 * rng.standard_normal(samples)
    return record(u=u, v=v, y=y)


def off(estimate, expected, scales=1.0):
    """Return the relative error, in units scaled to an RMS of 1."""
    return np.linalg.norm((estimate - expected) * scales) / np.linalg.norm(expected * scales)


@st.composite
def regressions(draw):
    """Draw stretches with gaps, weights and scalings, orders, and small chunks."""
    r, d = draw(st.integers(0, 5)), draw(st.integers(0, 5))
    lags, lagged_channels, targets = r + d + 1, draw(st.integers(1, 3)), draw(st.integers(0, 2))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    kinds = draw(st.lists(st.sampled_from(["none", "each", "runs"]), min_size=1, max_size=3))
    parts = []
    for kind in kinds:
        samples = draw(st.one_of(st.integers(1, 2 * lags + 1), st.integers(2 * lags, 8 * lags), st.integers(150, 200)))
        weights = {"none": None, "each": rng.random(samples) + 0.1}.get(kind)
        if kind == "runs":
            weights = np.repeat(rng.random(samples) + 0.1, rng.integers(1, 4 * lags, samples))[:samples]
        rows = rng.permutation(lagged_channels + targets + 1)[: lagged_channels + targets]
        scaling = None
        if draw(st.booleans()):
            scaling = Scaling(rows=rows, centre=rng.standard_normal(len(rows)), rms=rng.random(len(rows)) + 0.5)
        values = rng.standard_normal((lagged_channels + targets + (scaling is not None), samples))
        parts.append(Stretch(values=values, weights=weights, scaling=scaling))
    return parts, lagged_channels, r, d, draw(st.sampled_from([7, 40, 1 << 16])), draw(st.sampled_from([3, 2048]))


def scaled(part):
    if part.scaling is None:
        return part.values
    return (part.values[part.scaling.rows] - part.scaling.centre[:, None]) / part.scaling.rms[:, None]


def written_out(parts, channels, r, d):
    """Return sqrt(weight) [u(k-r) .. u(k+d), y(k)] of all equations: the oldest lag first."""
    blocks = []
    for part in parts:
        z = scaled(part).T
        if len(z) <= r + d:
            continue
        phi = lagged(z[:, :channels], r, d).reshape(len(z) - r - d, -1, channels)[:, ::-1]
        weights = np.ones(len(z)) if part.weights is None else part.weights
        rows = np.hstack([phi.reshape(len(phi), -1), z[r : len(z) - d, channels:]])
        blocks.append(rows * np.sqrt(weights[r : len(z) - d, None]))
    return np.vstack(blocks) if blocks else None


def roots(parts, r, d):
    """Return the column of ones of all equations, times the root of their weights."""
    weights = [np.ones(len(part)) if part.weights is None else part.weights for part in parts]
    return np.concatenate([np.sqrt(w[r : len(w) - d]) if len(w) > r + d else [] for w in weights])


@settings(max_examples=50)
@given(regressions())
def test_gram_is_the_product_of_the_written_out_equations(drawn):
    """To rounding: an FFT of N points errs by a few log2(N) eps of the signals' norms, 100 eps here."""
    parts, channels, r, d, chunk, rows = drawn
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(triangle_module, "CHUNK", chunk)
        patch.setattr(triangle_module, "ROWS", rows)
        products, sums = triangle_module.gram(parts, channels, r, d)
    equations = written_out(parts, channels, r, d)
    if equations is None:
        assert not np.triu(products).any()
        assert not sums.any()
        return
    norm = sum(
        (len(part) + np.sum(scaled(part) ** 2)) * (1.0 if part.weights is None else part.weights.max())
        for part in parts
    )
    np.testing.assert_allclose(np.triu(products), np.triu(equations.T @ equations), rtol=0, atol=100 * EPS * norm)
    np.testing.assert_allclose(sums, roots(parts, r, d) @ equations, rtol=0, atol=100 * EPS * norm)


@settings(max_examples=25)
@given(regressions(), st.booleans(), st.booleans())
def test_the_triangle_stands_for_the_equations_whichever_method_made_it(drawn, reflected, constant):
    parts, channels, r, d, chunk, rows = drawn
    equations = written_out(parts, channels, r, d)
    assume(equations is not None and len(equations) >= 2 * equations.shape[1] and parts[0].channels > channels)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(triangle_module, "CHUNK", chunk)
        patch.setattr(triangle_module, "ROWS", rows)
        patch.setattr(triangle_module, "ROWS", rows)
        if reflected:
            patch.setattr(triangle_module, "_CONDITION_TRUSTED", 0.0)
        triangle = triangle_module.triangle(parts, channels, r, d, constant=constant)
    assert triangle.solver == "householder" or not reflected
    ones, means = roots(parts, r, d)[:, None], np.zeros(equations.shape[1])
    if constant:
        means = (ones.T @ equations / np.sum(ones**2))[0]
    np.testing.assert_allclose(triangle.means, means, rtol=0, atol=1e-12)
    root = np.linalg.qr(equations - ones * means, mode="r")
    signs = np.sign(np.diag(root)) * np.sign(np.diag(triangle.root))
    condition = np.linalg.cond(equations)
    tolerance = 100 * EPS * condition * (1.0 if triangle.solver == "householder" else condition)
    np.testing.assert_allclose(triangle.root, root * signs[:, None], atol=tolerance * np.linalg.norm(root), rtol=0)
    total = sum(
        np.ones(len(p))[r : len(p) - d].sum() if p.weights is None else p.weights[r : len(p) - d].sum()
        for p in parts
        if len(p) > r + d
    )
    assert triangle.weight == pytest.approx(total)
    assert triangle.equations == len(equations)


def test_chunks_dont_change_what_is_found(monkeypatch):
    operator = identified(noisy(), 6, 4, weights=np.repeat([1.0, 2.0, 0.5], 200))
    for module in (triangle_module, stretches_module):
        monkeypatch.setattr(module, "CHUNK", 37)
    monkeypatch.setattr(triangle_module, "ROWS", 11)
    other = identified(noisy(), 6, 4, weights=np.repeat([1.0, 2.0, 0.5], 200))
    np.testing.assert_allclose(other.markov, operator.markov, rtol=0, atol=1e-13)


def test_offsets_of_a_million_and_scales_eight_decades_apart_cost_no_more_than_the_recording_does():
    """An offset of 1e6 RMS rounds a sample to 1e-10 RMS; a condition near 1 passes that on."""
    plain, scales = noisy(), np.array([1e-4, 1e4, 1e4])
    shifted = Record(
        (plain.values + 1e6 * np.array([1, -1, 1])) * scales, channels=plain.channels, sample_period_s=0.01
    )
    operator, other = identified(plain, 5, 5), identified(shifted, 5, 5)
    assert other.solver == "cholesky"
    np.testing.assert_allclose(other.markov * scales[:2] / scales[2], operator.markov, rtol=0, atol=1e-9)


@pytest.mark.parametrize("at", [0, 1, 5, 10, 11, 300, -12, -11, -10, -6, -2, -1])
@pytest.mark.parametrize("channel", [0, 1, 2])
@pytest.mark.parametrize("size", [1e3, 1e6])
def test_a_spike_anywhere_is_solved_as_the_written_out_equations_are(at, channel, size):
    values = noisy().values.copy()
    values[at, channel] += size
    spiked = Record(values, channels=["u", "v", "y"], sample_period_s=0.01)
    expected = least_squares([spiked], ["u", "v"], ["y"], 5, 5)
    rms = values.std(axis=0)
    assert off(identified(spiked, 5, 5).markov, expected, rms[:2] / rms[2]) < 1e-6


@pytest.mark.parametrize("kind", ["float32", "strided", "fortran", "read-only", "integers"])
def test_any_array_will_do(kind):
    values = np.round(noisy().values * 64)
    given_array = {
        "float32": values.astype(np.float32),
        "strided": np.repeat(np.repeat(values, 2, axis=0), 2, axis=1)[::2, ::2],
        "fortran": np.asfortranarray(values),
        "read-only": values.copy(),
        "integers": values.astype(np.int64),
    }[kind]
    given_array.setflags(write=False)
    operator = identified(Record(values, channels=["u", "v", "y"], sample_period_s=0.01), 5, 5)
    other = identified(Record(given_array, channels=["u", "v", "y"], sample_period_s=0.01), 5, 5)
    np.testing.assert_array_equal(given_array, values)
    np.testing.assert_allclose(other.markov, operator.markov, rtol=0, atol=1e-14)


def nearly_twins(kappa, noise, samples=300):
    """Return a record whose second input is the first but for a share of 1 / kappa: the condition is about 2 kappa."""
    rng = np.random.default_rng(0)
    u = rng.standard_normal(samples)
    v = u + rng.standard_normal(samples) / kappa
    return record(u=u, v=v, y=np.roll(u, 1) - 2 * np.roll(v, -1) + 0.5 * u + noise * rng.standard_normal(samples))


@pytest.mark.parametrize("noise", [0.0, 1e-4, 1.0])
def test_precision_is_kept_up_to_any_condition(noise):
    """Against rational arithmetic: the normal equations lose eps cond^2, an orthogonal method eps cond."""
    for kappa in 10.0 ** np.arange(0, 13, 0.5):
        twins = nearly_twins(kappa, noise)
        operator = identified(twins, 1, 1)
        error = off(operator.markov, exact_least_squares(twins.values, 2, 1, 1))
        power = 2 if operator.solver == "cholesky" else 1
        assert operator.rank == 6
        assert error < 10 * EPS * operator.condition**power
        assert error < max(1e-6, 10 * EPS * operator.condition)
        if operator.condition > 3e4 or noise == 0.0:
            assert operator.solver == "householder"
        elif operator.condition < 3e3:
            assert operator.solver == "cholesky"


def wave(phase=0.0, samples=1200):
    return np.sin(2 * np.pi * np.arange(samples) / 120 + phase)


@pytest.mark.parametrize(
    ("channels", "rank", "message"),
    [
        (
            {"u": wave(), "v": wave(1.0)},
            2,
            r"too few frequencies in 'u' \(2 of its 11 lags\), 'v' \(2 of its 11 lags\)",
        ),
        ({"u": None, "v": wave()}, 13, r"13 of the 22 .*: too few frequencies in 'v' \(2 of its 11 lags\)"),
        ({"u": None, "v": "u"}, 11, "11 of the 22 .*: 'v' follows from u;"),
        ({"u": None, "w": None, "v": "w"}, 22, "22 of the 33 .*: 'v' follows from w;"),
        ({"u": None, "w": None, "v": "u+w"}, 22, "22 of the 33 .*: 'v' follows from u, w;"),
    ],
    ids=["sinusoids", "one sinusoid", "twins", "twins of three", "sum"],
)
def test_what_isnt_determined_is_named_and_predicted_all_the_same(channels, rank, message):
    rng = np.random.default_rng(5)
    made = {}
    for name, given_values in channels.items():
        if given_values is None:
            made[name] = rng.standard_normal(1200)
        else:
            made[name] = (
                sum(made[part] for part in given_values.split("+")) if isinstance(given_values, str) else given_values
            )
    series = record(**made, y=np.roll(made["u"], 2) - made["v"])
    with pytest.warns(RankWarning, match=message):
        operator = identified(series, 5, 5, inputs=list(made))
    assert (operator.rank, operator.solver) == (rank, "householder")
    assert operator.condition > 1e10
    assert np.isnan(operator.standard_error).all()
    phi, y, _ = dense([series], list(made), ["y"], 5, 5)
    scale = np.tile([made[name].std() for name in made], 11)
    theta = np.linalg.lstsq(phi / scale, y, rcond=1e-12)[0] / scale[:, None]
    np.testing.assert_allclose(operator.markov[:, 0].ravel(), theta[:, 0], rtol=0, atol=1e-9)


def test_a_channel_that_barely_moves_is_identified_in_its_own_scale():
    """Noise of 1e-9 about 1 is stored to 1e-16: seven digits of it are there to be used."""
    rng = np.random.default_rng(6)
    u = 1.0 + 1e-9 * rng.standard_normal(2000)
    series = record(u=u, y=1e9 * np.roll(u, 3))
    operator = identified(series, 5, 5, inputs=["u"])
    assert operator.rank == 11
    assert 1e-9 * operator.markov[8, 0, 0] == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("kappa", [1e6, 1e9, 1e12])
def test_nearly_identical_channels_keep_their_rank_without_a_warning(kappa):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        operator = identified(nearly_twins(kappa, 1.0), 1, 1)
    assert (operator.rank, operator.solver) == (6, "householder")
    assert 0.5 < operator.condition / np.linalg.cond(dense([nearly_twins(kappa, 1.0)], "uv", "y", 1, 1)[0]) < 2.0


@pytest.mark.parametrize(
    ("condition", "left", "is_trusted"), [(2.95e4, 1.1e-5, True), (3.05e4, 1.1e-5, False), (2.95e4, 0.9e-5, False)]
)
def test_cholesky_is_trusted_up_to_a_condition_of_30_000_and_down_to_a_residual_of_1_in_100_000(
    condition, left, is_trusted
):
    assert triangle_module._trusted(np.diag([1.0 / condition, left]), 1, np.ones(2)) == is_trusted


@pytest.mark.parametrize("size", [1, 3])
def test_the_norm_of_an_inverse_is_exact_of_columns_that_are_alike(size):
    root = 1e-3 * np.eye(size + 1)
    assert triangle_module._inverse_norm(root, size) == pytest.approx(1e3, rel=1e-9)

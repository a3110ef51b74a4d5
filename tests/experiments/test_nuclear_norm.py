"""Nuclear norms of Hankel matrices, (3.3) and (3.4): optima known another way, and orders known beforehand."""

import sys

import numpy as np
import pytest
from scipy.optimize import brentq

from gtmbench.errors import InputError
from tests.helpers.night import by_day
from tests.helpers.plants import example_3_2
from theory.nuclear_norm import nuclear_norm_path
from theory.realisation import block_hankel, hankel_singular_values


def noisy(seed=0, count=12, error=0.02):
    """Return H_0.. of two states, with noise."""
    lags = np.arange(count) - 1.0
    rng = np.random.default_rng(seed)
    return 0.8**lags - 0.5 * (-0.5) ** lags + error * rng.standard_normal(count)


def nuclear(markov):
    return hankel_singular_values(markov).sum()


def adjoint(matrix, count):
    """Return the sums over the entries where H_i stands, i = 1..count."""
    turned = matrix[::-1]
    return np.array([np.trace(turned, offset) for offset in range(1 - len(matrix), count + 1 - len(matrix))])


@pytest.mark.parametrize("gamma", [1e-3, 5e-3])
def test_the_optimum_has_the_gradient_of_a_multiplier(gamma):
    """While no singular value has vanished, the norm's gradient U V' is what the ball pushes against."""
    data = noisy(error=0.1, count=8)
    path = nuclear_norm_path(data, [gamma])
    assert path.ranks == (4,)
    left, _, right = np.linalg.svd(block_hankel(path.markov[0]))
    gradient, step = adjoint(left @ right, 7), data[1:] - path.markov[0, 1:, 0, 0]
    assert np.linalg.norm(step) == pytest.approx(gamma, rel=1e-5)
    assert step @ gradient == pytest.approx(gamma * np.linalg.norm(gradient), rel=1e-5)


def test_one_block_is_soft_thresholding():
    """With n = 1 the matrix is H_1 itself: each singular value falls by as much, or to 0, until gamma is used up."""
    block = np.random.default_rng(2).standard_normal((4, 3))
    left, singular, right = np.linalg.svd(block, full_matrices=False)
    gamma = 0.7 * np.linalg.norm(singular)
    fall = brentq(lambda t: np.linalg.norm(np.minimum(singular, t)) - gamma, 0.0, singular[0])
    expected = left @ np.diag(np.maximum(singular - fall, 0.0)) @ right
    markov = nuclear_norm_path([np.ones((4, 3)), block], [gamma]).markov[0]
    np.testing.assert_allclose(markov[1], expected, atol=1e-5)
    np.testing.assert_array_equal(markov[0], np.ones((4, 3)))  # H_0 isn't in the matrix


def test_no_point_of_the_ball_is_better_and_larger_balls_are_no_worse():
    data, gammas = noisy(), [0.01, 0.05, 0.1, 0.3]
    path = nuclear_norm_path(data, gammas[::-1])
    np.testing.assert_array_equal(path.gammas, gammas)
    norms = [nuclear(markov) for markov in path.markov]
    assert nuclear(data) > norms[0] > norms[1] > norms[2] > norms[3]
    rng = np.random.default_rng(3)
    for gamma, best, norm in zip(gammas, path.markov[:, 1:, 0, 0], norms, strict=True):
        assert np.linalg.norm(best - data[1:]) <= gamma * (1.0 + 1e-6)
        for spread in (1e-3, 1e-1, 1.0):
            for direction in rng.standard_normal((50, 11)):
                step = best + spread * gamma * direction - data[1:]
                tried = data[1:] + step * min(1.0, gamma / np.linalg.norm(step))
                assert nuclear([0.0, *tried]) >= norm * (1.0 - 1e-6)


def test_a_ball_that_holds_zero_leaves_nothing():
    data = noisy()
    path = nuclear_norm_path(data, 1.01 * np.linalg.norm(data[1:]))
    assert path.ranks == (0,)


def test_one_output_and_two_of_which_one_is_silent_have_the_same_optimum():
    """The one is solved as a symmetric matrix, the other as any."""
    data, gammas = noisy(), [0.02, 0.1]
    alone = nuclear_norm_path(data, gammas)
    both = nuclear_norm_path(np.stack([data, np.zeros(12)], axis=1)[..., np.newaxis], gammas)
    np.testing.assert_allclose(both.markov[:, 1:, 0, 0], alone.markov[:, 1:, 0, 0], atol=1e-5)
    np.testing.assert_allclose(both.markov[:, 1:, 1, 0], 0.0, atol=1e-5)
    assert alone.ranks == both.ranks


@pytest.mark.parametrize("shape", [(1, 1), (2, 2)])
def test_the_optimum_follows_units_signs_and_turned_signals(shape):
    rng = np.random.default_rng(4)
    data = noisy()[:, np.newaxis, np.newaxis] * rng.standard_normal(shape) + 0.02 * rng.standard_normal((12, *shape))
    best = nuclear_norm_path(data, [0.1]).markov[0]
    P, Q = (np.linalg.qr(rng.standard_normal((side, side)))[0] for side in shape)
    signs = (-1.0) ** np.arange(12)[:, np.newaxis, np.newaxis]  # z becomes -z
    for factor, turn in (
        (1e6, lambda x: 1e6 * x),
        (1.0, lambda x: signs * x),
        (1.0, lambda x: P @ x @ Q),
        (1.0, lambda x: x.transpose(0, 2, 1)),
    ):
        optimum = nuclear_norm_path(turn(data), [factor * 0.1]).markov[0]
        np.testing.assert_allclose(optimum, turn(best), rtol=0, atol=2e-5 * factor)


def random_plant(rng, states, shape, count):
    """Return H_0.. of a random minimal plant: residues of rank 1 at poles of magnitude 0.2..0.9."""
    markov, left = np.zeros((count, *shape)), states
    while left:
        pair = left > 1 and rng.random() < 0.5
        pole = rng.uniform(0.2, 0.9) * (np.exp(1j * rng.uniform(0.1, 3.0)) if pair else rng.choice([-1.0, 1.0]))
        ends = [rng.standard_normal(side) + 1j * pair * rng.standard_normal(side) for side in shape]
        powers = pole ** np.arange(count - 1.0)
        markov[1:] += (1 + pair) * np.real(powers[:, np.newaxis, np.newaxis] * np.outer(*ends))
        left -= 1 + pair
    return markov


def trials(shape, plants, seed=7):
    """Return states, order found, and least singular value over the error, of random plants with random noise.

    Errors of neighbouring lags are correlated by 0, 0.5, 0.9 or -0.9.
    """
    count, rows = 16 if shape == (1, 1) else 8, []
    for plant in range(plants):
        rng = np.random.default_rng([seed, plant])
        states = int(rng.integers(1, 6))
        exact = random_plant(rng, states, shape, count)
        ratio = 10.0 ** rng.uniform(-1.0, 2.0)
        error = hankel_singular_values(exact)[states - 1] / ratio
        between = rng.choice([0.0, 0.5, 0.9, -0.9]) ** np.abs(np.subtract.outer(np.arange(count), np.arange(count)))
        noise = np.tensordot(np.linalg.cholesky(between), rng.standard_normal((count, *shape)), 1)
        data = exact + error * noise / np.sqrt(exact[1:].size)
        rows.append((states, nuclear_norm_path(data, error * np.array([1.0, 2.0, 4.0])).order(error), ratio))
    return np.array(rows).T


@pytest.mark.parametrize(
    ("shape", "plants", "right", "high"),
    by_day([((1, 1), 40, 0.9, 0.03), ((2, 2), 15, 0.7, 0.15)], 0),
    ids=["1 x 1", "2 x 2"],
)
def test_the_order_is_right_where_the_least_singular_value_stands_out_and_hardly_ever_too_high(
    shape, plants, right, high
):
    """Eight errors are enough to stand out. Below the error itself nothing tells it; then the order is too low."""
    states, order, ratio = trials(shape, plants)
    clear, hidden = ratio > 8.0, ratio < 1.0
    assert np.mean(order[clear] == states[clear]) >= right
    assert np.mean(order > states) <= high
    assert np.mean(order[hidden] < states[hidden]) >= 0.6


def test_example_3_3_has_4_and_3_where_no_gap_shows_it():
    series, error = example_3_2().laurent(25, 25), 2e-4
    rng = np.random.default_rng(5)
    for part, order in ((series[25:45], 4), (series[25:5:-1], 3)):
        data = part + error / np.sqrt(19.0) * rng.standard_normal(part.shape)
        path = nuclear_norm_path(data, error * np.array([0.01, 1.0, 2.0, 4.0]))
        assert path.order(error) == order
        assert path.ranks[0] == 10  # a gamma that the errors dwarf leaves the data as they are: the printed range


@pytest.mark.parametrize(
    ("markov", "gammas", "says"),
    [
        (np.zeros(6), [1.0], "all Markov parameters are 0"),
        ([1.0], [1.0], "all Markov parameters are 0"),
        (noisy(), [0.0], "gamma is 0.0; it must be a finite number greater than 0"),
        (noisy(), [np.nan], "gamma is nan"),
        (np.ones((3, 2)), [1.0], r"have shape \(3, 2\)"),
    ],
)
def test_what_has_no_path_is_refused(markov, gammas, says):
    with pytest.raises(InputError, match=says):
        nuclear_norm_path(markov, gammas)


def test_an_order_stands_on_gammas_about_the_error():
    path = nuclear_norm_path(noisy(), [0.1, 0.2])
    with pytest.raises(InputError, match=r"gammas from 0.1 to 0.2, 1 of them between 0.2 and 0.8"):
        path.order(0.2)
    assert path.order(0.1) == path.ranks[1]


def test_without_cvxpy_one_line_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(InputError, match=r"needs? the package cvxpy; pip install 'gtmbench\[theory\]'"):
        nuclear_norm_path(noisy(), [0.1])

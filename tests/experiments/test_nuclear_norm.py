"""Nuclear norms of Hankel matrices, (3.3) and (3.4): optima known another way, and orders known beforehand."""

import sys

import numpy as np
import pytest
from scipy.optimize import brentq

from gtmbench.errors import InputError
from tests.helpers.plants import example_3_2
from theory.nuclear_norm import nuclear_norm_path
from theory.realisation import hankel_singular_values


def noisy(seed=0, count=12, error=0.02):
    """Return H_0.. of two states, with noise."""
    lags = np.arange(count) - 1.0
    rng = np.random.default_rng(seed)
    return 0.8**lags - 0.5 * (-0.5) ** lags + error * rng.standard_normal(count)


def nuclear(markov):
    return hankel_singular_values(markov).sum()


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


def test_example_3_3_has_4_and_3_where_no_gap_shows_it():
    series, error = example_3_2().laurent(25, 25), 2e-4
    rng = np.random.default_rng(5)
    for part, order in ((series[25:45], 4), (series[25:5:-1], 3)):
        data = part + error / np.sqrt(19.0) * rng.standard_normal(part.shape)
        path = nuclear_norm_path(data, error * np.array([0.01, 1.0, 2.0, 4.0]))
        assert path.order(error) == order
        assert path.ranks[0] == 10  # a gamma that the errors dwarf leaves the data as they are: the printed range


def test_without_cvxpy_one_line_says_what_is_missing(monkeypatch):
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    with pytest.raises(InputError, match=r"needs? the package cvxpy; pip install 'gtmbench\[theory\]'"):
        nuclear_norm_path(noisy(), [0.1])

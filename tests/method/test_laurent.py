"""An operator identified in closed loop is the Laurent series of an unstable plant, section 3.6."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtmbench.method.identify import identify
from gtmbench.values.record import Record
from tests.helpers.oracles import lagged
from tests.helpers.plants import companion, example_3_1, example_3_2

EPS = np.finfo(float).eps
AT_REST = 100  # samples without excitation at the end: loops as slow as 0.7 a sample fall below 1e-15


def excited(plant, weight, samples, seed=0):
    """Return u and y of a loop that is excited by white c, from rest to rest.

    At rest at both ends, the mean of y is exactly G(1) times that of u, so the means cost no bias.
    """
    c = np.random.default_rng(seed).standard_normal((samples, plant.system.inputs))
    c[-AT_REST:] = 0.0
    u, y = plant.closed_loop(c, plant.lqr(weight))
    assert np.abs(u[-30:]).max() < 1e-12 * np.abs(u).max()
    return u, y


def found(u, y, r, d):
    names = [[f"{what}{i}" for i in range(values.shape[1])] for what, values in (("u", u), ("y", y))]
    record = Record(np.hstack([u, y]), channels=[*names[0], *names[1]], sample_period_s=1.0)
    return identify(record, inputs=names[0], outputs=names[1], causal_order=r, noncausal_order=d).markov


def bound(plant, u, y, r, d):
    """Return how far least squares can be from the Laurent coefficients, in the Frobenius norm: ||e|| / sigma_min(Phi).

    e(k) is what the lags left out add, at most the sum of |L_i| times max |u|, and as much again for its mean; rounding
    adds a thousand units in the last place of the greatest y (of the simulation, through a few states) and of theta.
    """
    cut = np.linalg.norm(2.0 * plant.tail(r, d) @ np.abs(u).max(axis=0))
    rounding = 1e3 * EPS * np.abs(y).max() * np.sqrt(y.shape[1])
    singular = np.linalg.svd(lagged(u - u.mean(axis=0), r, d), compute_uv=False)
    own = 1e3 * EPS * singular[0] / singular[-1] * np.linalg.norm(plant.laurent(r, d))
    return (cut + rounding) * np.sqrt(len(u)) / singular[-1] + own


@pytest.mark.parametrize("plant", [example_3_1(), example_3_2()], ids=["3.1", "3.2"])
def test_the_oracles_agree_partial_fractions_and_cauchys_integral(plant):
    np.testing.assert_allclose(plant.laurent(50, 50), plant.laurent_by_contour(50, 50), rtol=0, atol=1e-11)


def test_the_printed_numbers_of_both_examples_come_out():
    np.testing.assert_allclose(example_3_1().system.poles, [0.193774, 1.806226], atol=5e-7)
    np.testing.assert_allclose(example_3_1().lqr(2.0), [[2.5446, 0.4259], [1.3095, 0.2707]], atol=5e-5)
    printed = [[3.5197, -3.1272, -3.0739, 2.0825, 1.0096, 0.7134, 0.4997]]
    np.testing.assert_allclose(example_3_2().lqr(1.0), printed, atol=5e-5)


@pytest.mark.parametrize(
    ("plant", "weight", "orders", "sharp"),
    [(example_3_1(), 2.0, 25, 1e-5), (example_3_2(), 1.0, 50, 1e-6)],
    ids=["3.1", "3.2"],
)
def test_the_examples_are_identified_to_the_truncation_error(plant, weight, orders, sharp):
    u, y = excited(plant, weight, 5000)
    allowed = bound(plant, u, y, orders, orders)
    assert allowed < sharp * np.linalg.norm(plant.laurent(orders, orders))
    assert np.linalg.norm(found(u, y, orders, orders) - plant.laurent(orders, orders)) < allowed


@st.composite
def poles(draw, inside, outside):
    """Draw so many single or paired poles inside and outside, an annulus of 0.65..1/0.65 free, all well apart."""
    found_poles = []
    for count, power in ((inside, 1.0), (outside, -1.0)):
        angles = draw(st.permutations([0.0, np.pi, 1.1, 2.1]))[:count]
        for angle in angles:
            pole = draw(st.floats(0.3, 0.65)) ** power * np.exp(1j * angle)
            found_poles += [pole] if angle in (0.0, np.pi) else [pole, pole.conjugate()]
    return found_poles


def check(drawn, feedthrough, seed, r, d):
    rng = np.random.default_rng(seed)
    plant = companion(rng.standard_normal(len(drawn)), drawn, feedthrough)
    u, y = excited(plant, 1.0, 1200, seed)
    allowed = bound(plant, u, y, r, d)
    assert allowed < 1e-4 * np.linalg.norm(plant.laurent(r, d))
    markov = found(u, y, r, d)
    assert np.linalg.norm(markov - plant.laurent(r, d)) < allowed
    return markov[:, 0, 0], allowed


FEEDTHROUGH, SEED = st.floats(-2.0, 2.0), st.integers(0, 1000)


@settings(max_examples=15)
@given(st.integers(1, 3).flatmap(lambda n: poles(n, 0)), FEEDTHROUGH, SEED)
def test_a_stable_plant_has_no_noncausal_part(drawn, feedthrough, seed):
    markov, allowed = check(drawn, feedthrough, seed, 40, 5)
    np.testing.assert_allclose(markov[:6], [0.0] * 5 + [feedthrough], rtol=0, atol=allowed)


@settings(max_examples=15)
@given(st.integers(1, 2).flatmap(lambda n: poles(0, n)), FEEDTHROUGH, SEED)
def test_a_strongly_unstable_plant_has_no_causal_part(drawn, feedthrough, seed):
    markov, allowed = check(drawn, feedthrough, seed, 5, 40)
    np.testing.assert_allclose(markov[-5:], 0.0, rtol=0, atol=allowed)


@settings(max_examples=15)
@given(st.tuples(st.integers(1, 2), st.integers(1, 2)).flatmap(lambda n: poles(*n)), FEEDTHROUGH, SEED)
def test_a_mixed_plant_has_both(drawn, feedthrough, seed):
    check(drawn, feedthrough, seed, 40, 40)

"""Markov parameters made systems again: exact ones give the plant, on either side of the unit circle, section 3.8."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag

from tests.helpers.plants import example_3_1, example_3_2
from theory.realisation import era, hankel_singular_values, realise
from theory.state_space import StateSpace

CIRCLE = np.exp(1j * np.linspace(0.1, 3.0, 7))


def random_system(rng, states, outputs, inputs, low=0.3, high=0.85):
    """Return a system with poles of magnitude low..high, real ones and pairs, well apart, in a rotated basis."""
    pairs = states // 2
    sizes = np.linspace(low, high, pairs + states % 2)
    blocks = []
    for size in sizes[:pairs]:
        angle = rng.uniform(0.3, 2.8)
        blocks.append(size * np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]]))
    blocks.extend(rng.choice([-1.0, 1.0]) * np.array([[size]]) for size in sizes[pairs:])
    A = block_diag(*blocks) if blocks else np.zeros((0, 0))
    Q = np.linalg.qr(rng.standard_normal((states, states)))[0]
    B, C = rng.standard_normal((states, inputs)), rng.standard_normal((outputs, states))
    return StateSpace(Q @ A @ Q.T, Q @ B, C @ Q.T, rng.standard_normal((outputs, inputs)))


def by_contour(system, r, d, points=2048):
    """Return L_i for i = -d..r by Cauchy's integral on the unit circle, the trapezoidal rule."""
    z = np.exp(2j * np.pi * np.arange(points) / points)
    values = system.at(z)
    return np.array([np.tensordot(z**i, values, 1).real / points for i in range(-d, r + 1)])


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), states=st.integers(0, 6), outputs=st.integers(1, 3), inputs=st.integers(1, 3))
def test_exact_markov_parameters_give_the_system(seed, states, outputs, inputs):
    system = random_system(np.random.default_rng(seed), states, outputs, inputs)
    singular = hankel_singular_values(system.markov(16))
    realised = era(system.markov(16), states)
    if states == 0 or singular[states - 1] > 1e-4 * singular[0]:
        size = np.abs(system.markov(60)).max()
        np.testing.assert_allclose(realised.markov(60), system.markov(60), rtol=0, atol=1e-8 * size)
        np.testing.assert_allclose(realised.at(CIRCLE), system.at(CIRCLE), rtol=0, atol=1e-7 * size)
        np.testing.assert_allclose(realised.poles, system.poles, rtol=0, atol=1e-6)
        assert np.all(singular[states:] < 1e-12 * max(singular[0], 1e-300))


@settings(max_examples=30)
@given(seed=st.integers(0, 10_000), stable=st.integers(0, 4), unstable=st.integers(0, 4))
def test_laurent_coefficients_give_the_plant_with_its_unstable_part_and_d(seed, stable, unstable):
    rng = np.random.default_rng(seed)
    inner, turned = random_system(rng, stable, 2, 2), random_system(rng, unstable, 2, 2)
    outer = np.linalg.inv(turned.A)
    plant = StateSpace(
        block_diag(inner.A, outer), np.vstack([inner.B, turned.B]), np.hstack([inner.C, turned.C]), inner.D
    )
    coefficients = by_contour(plant, 13, 13)
    for some in (coefficients[13:], coefficients[13::-1]):
        singular = hankel_singular_values(some)
        order = stable if some is coefficients[13:] else unstable
        if order and singular[order - 1] < 1e-4 * singular[0]:
            return
    realised = realise(coefficients, noncausal_order=13, stable_order=stable, unstable_order=unstable)
    assert np.sum(np.abs(realised.poles) > 1.0) == unstable
    size = np.abs(coefficients).max()
    np.testing.assert_allclose(realised.D, plant.D, rtol=0, atol=1e-7 * size)
    np.testing.assert_allclose(realised.at(CIRCLE), plant.at(CIRCLE), rtol=0, atol=1e-7 * size)


@pytest.mark.parametrize(("example", "orders"), [(example_3_1(), (1, 1)), (example_3_2(), (4, 3))], ids=["3.1", "3.2"])
def test_the_examples_come_back_from_partial_fractions(example, orders):
    realised = realise(example.laurent(19, 19), noncausal_order=19, stable_order=orders[0], unstable_order=orders[1])
    np.testing.assert_allclose(np.poly(realised.A)[::-1], example.denominator, rtol=0, atol=1e-10)
    np.testing.assert_allclose(realised.at(CIRCLE), example.system.at(CIRCLE), rtol=0, atol=1e-11)

"""Laurent series in every annulus, sections 3.3 to 3.5: against closed forms, other ways to them, and Theorem 2."""

import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.special import comb

from gtmbench.errors import InputError
from tests.helpers.plants import example_3_1, example_3_2
from theory.annuli import annuli, inner_spectral_radius, spectral_radius
from theory.laurent import laurent, reflected, scaled, split
from theory.state_space import StateSpace
from theory.transfer_matrix import transfer_matrix

SHARP = 1e-12  # of the largest coefficient


class Fractions:
    """G(z) = D + sum of R / (z - p)^k over poles p of any multiplicity, whose series are binomial coefficients."""

    def __init__(self, poles, shape, seed):
        rng = np.random.default_rng(seed)
        self.D = rng.standard_normal(shape)
        self.terms = []
        for pole, multiplicity in poles:
            residues = rng.standard_normal((multiplicity, *shape)) * max(abs(abs(pole) - 1.0), 0.1)
            turned = 1.0 if pole.imag == 0.0 else np.exp(1j * rng.uniform(0, 6, multiplicity))[:, None, None]
            self.terms.append((pole, residues * turned))
        self.basis = np.linalg.qr(rng.standard_normal((self.order, self.order)))[0]

    @property
    def order(self):
        return sum(len(residues) * residues.shape[2] * (1 + (pole.imag != 0.0)) for pole, residues in self.terms)

    def laurent(self, r, d):
        """(z - p)^-k: C(i-1, k-1) p^(i-k) for i >= k inside; (-1)^k C(k-1-i, k-1) p^(i-k) for i <= 0 outside."""
        lags = np.arange(-d, r + 1)
        value = np.where((lags == 0)[:, None, None], self.D, 0.0)
        for pole, residues in self.terms:
            for k, residue in enumerate(residues, 1):
                if abs(pole) < 1.0:
                    powers = np.array([pole ** (i - k) if i >= k else 0.0 for i in lags])
                    series = comb(lags - 1, k - 1) * powers
                else:
                    series = (lags <= 0) * (-1.0) ** k * comb(k - 1 - lags, k - 1) * pole ** (lags - float(k))
                term = series[:, None, None] * residue
                value = value + (term.real if pole.imag == 0.0 else 2.0 * term.real)
        return value

    def system(self):
        """Jordan blocks in a random orthonormal basis; a complex one stands for a pair, by real and imaginary part."""
        inputs, done = self.D.shape[1], 0
        A, B, C = np.zeros((self.order,) * 2), np.zeros((self.order, inputs)), np.zeros((len(self.D), self.order))
        for pole, residues in self.terms:
            k = len(residues)
            block = np.kron(pole * np.eye(k) + np.eye(k, k=1), np.eye(inputs))
            enters, leaves = np.kron(np.eye(k)[:, -1:], np.eye(inputs)), np.hstack(list(residues[::-1]))
            if pole.imag != 0.0:
                block = np.block([[block.real, -block.imag], [block.imag, block.real]])
                enters, leaves = np.vstack([enters, 0.0 * enters]), np.hstack([2.0 * leaves.real, -2.0 * leaves.imag])
            here = slice(done, done + len(block))
            A[here, here], B[here], C[:, here] = block.real, enters, leaves.real
            done += len(block)
        return StateSpace(self.basis @ A @ self.basis.T, self.basis @ B, C @ self.basis.T, self.D)


@st.composite
def fractions(draw, low=0.0, near=0.02):
    """Draw up to two pole(pair)s of up to three-fold multiplicity on either side, as near the circle as `near`."""
    poles = []
    for side in (st.floats(low, 1.0 - near), st.floats(1.0 + near, 4.0)):
        for magnitude in draw(st.lists(side, max_size=2)):
            angle = draw(st.sampled_from([0.0, np.pi, 1.1, 2.0]))
            pole = magnitude * (round(np.cos(angle)) if angle in (0.0, np.pi) else np.exp(1j * angle))
            poles.append((complex(pole), draw(st.integers(1, 3 if abs(magnitude - 1.0) > 0.2 else 1))))
    shape = draw(st.sampled_from([(1, 1), (2, 1), (1, 2), (2, 3)]))
    return Fractions(poles, shape, draw(st.integers(0, 1000)))


def sizes(coefficients):
    return np.linalg.norm(coefficients, axis=(1, 2))


@settings(max_examples=80)
@given(fractions(), st.integers(0, 60), st.integers(0, 60))
def test_coefficients_are_those_of_partial_fractions(drawn, r, d):
    series, expected = laurent(drawn.system(), causal_order=r, noncausal_order=d), drawn.laurent(r, d)
    assert_allclose(series.coefficients, expected, rtol=0, atol=SHARP * np.abs(drawn.laurent(60, 60)).max())


@settings(max_examples=20)
@given(fractions(), st.floats(0.3, 3.0))
def test_any_circle_without_poles_has_a_series_and_it_is_the_scaled_systems(drawn, alpha):
    """L_i of G(z / alpha) in the annulus of the circle of radius alpha, equation (3.31)."""
    expected = drawn.laurent(40, 40)
    wide = scaled(drawn.system(), 1.0 / alpha)
    series = laurent(wide, causal_order=40, noncausal_order=40, radius=alpha)
    back = alpha ** -series.lags[:, None, None].astype(float) * series.coefficients
    assert_allclose(back, expected, rtol=0, atol=SHARP * np.abs(expected).max())


@settings(max_examples=20)
@given(fractions(low=0.05))
def test_reflection_turns_the_series_round_and_swaps_the_radii(drawn):
    system = drawn.system()
    there, back = (laurent(of, causal_order=30, noncausal_order=30) for of in (system, reflected(system)))
    largest = np.abs(there.coefficients).max()
    assert_allclose(back.coefficients[::-1], there.coefficients, rtol=0, atol=1e-9 * largest)  # A^-1 costs digits
    if system.order:
        assert_allclose(spectral_radius(reflected(system)), 1.0 / inner_spectral_radius(system), rtol=1e-6)
        assert_allclose(inner_spectral_radius(reflected(system)), 1.0 / spectral_radius(system), rtol=1e-6)


@settings(max_examples=20)
@given(fractions())
def test_the_parts_are_strictly_proper_on_their_sides_and_add_up(drawn):
    system = drawn.system()
    inside, outside = split(system)
    assert inside.order + outside.order == system.order
    assert not inside.D.any()
    assert not outside.D.any()
    assert np.all(np.abs(inside.poles) < 1.0)
    assert np.all(np.abs(outside.poles) > 1.0)
    z = np.exp(1j * np.linspace(0.0, 6.0, 7))
    expected = system.at(z)
    assert_allclose(inside.at(z) + outside.at(z) + system.D, expected, rtol=0, atol=1e-12 * np.abs(expected).max())


def bounded(coefficients):
    half = len(coefficients) // 4
    size = sizes(coefficients)
    return max(size[:half].max(), size[-half:].max()) <= size[half:-half].max()


def converge(coefficients):
    size = sizes(coefficients)
    return max(size[:20].max(), size[-20:].max()) < 1e-6 * size.max()


def square_summable(coefficients):
    squares = sizes(coefficients) ** 2
    return squares[100:-100].sum() > (1.0 - 1e-6) * squares.sum()


@settings(max_examples=25)
@given(fractions(low=0.3, near=0.1))
def test_theorem_2_in_all_maximal_annuli(drawn):
    """Judged by 250 coefficients to either side: 0.9^250 is 4e-12, 4^250 and 0.3^-250 have squares yet."""
    system = drawn.system()
    for annulus in annuli(system):
        if annulus.outer > 1.01 * annulus.inner:
            series = laurent(system, causal_order=250, noncausal_order=250, radius=annulus.radius)
            contains = annulus.inner < 1.0 < annulus.outer
            judged = [judge(series.coefficients) for judge in (square_summable, converge, bounded)]
            assert judged == [contains] * 3, annulus


def test_theorem_2_needs_its_assumption_that_no_pole_lies_on_the_circle():
    """1 / (z - 1) = z^-1 + z^-2 + ... for |z| > 1: bounded, and yet neither convergent nor about the unit circle."""
    coefficients = laurent(transfer_matrix([[[1.0]]], [1.0, -1.0]), causal_order=300, noncausal_order=0, radius=2.0)
    assert_allclose(coefficients.coefficients[:, 0, 0], [0.0] + [1.0] * 300, rtol=1e-12)


@pytest.mark.parametrize(("plant", "digits"), [(example_3_1(), SHARP), (example_3_2(), 3e-11)], ids=["3.1", "3.2"])
def test_the_examples_have_the_series_of_two_oracles(plant, digits):
    """Roots of a polynomial of degree 7 are right to 3e-11 of the result, Cauchy's integral is to rounding."""
    series = laurent(plant.system, causal_order=50, noncausal_order=50).coefficients
    largest = np.abs(series).max()
    assert_allclose(series, plant.laurent(50, 50), rtol=0, atol=digits * largest)
    assert_allclose(series, plant.laurent_by_contour(50, 50), rtol=0, atol=SHARP * largest)


def test_examples_3_4_1_and_3_4_2_in_all_their_annuli():
    lags = np.arange(-20, 21)
    G = transfer_matrix([[np.poly([1.0, 0.5])]], np.poly([2.0, 3.0]))  # 1 - 1.5 / (z - 2) + 5 / (z - 3)
    inside, outside = split(G)
    assert (inside.order, outside.order) == (0, 2)
    assert outside.at(0.0)[0, 0] == pytest.approx(-11 / 12, abs=1e-14)
    for radius, causal in ((1.0, (0, 0)), (2.5, (1, 0)), (4.0, (1, 1))):
        series = np.where(lags == 0, 1.0, 0.0)
        for residue, pole, inner in zip((-1.5, 5.0), (2.0, 3.0), causal, strict=True):
            series += residue * np.where((lags >= 1) == bool(inner), (1 if inner else -1) * pole ** (lags - 1.0), 0.0)
        ours = laurent(G, causal_order=20, noncausal_order=20, radius=radius)
        assert_allclose(ours.coefficients[:, 0, 0], series, rtol=0, atol=1e-13 * np.abs(series).max())
    stable, unstable = split(transfer_matrix([[[1.0]]], np.poly([0.5, 1.5])))
    assert_allclose([stable.at(2.0)[0, 0], unstable.at(2.0)[0, 0], unstable.at(0.0)[0, 0]], [-2 / 3, 2.0, -2 / 3])


@pytest.mark.parametrize(
    "poles", [[1.0], [0.5, -1.0, 3.0], [0.5, 1j, -1j], [1.0] * 3 + [0.2], [0.3, 1.0 - 1e-14, 1.0 + 1e-14, 2.0]]
)
def test_a_pole_on_the_circle_is_refused_and_every_radius_offered_works(poles):
    system = transfer_matrix([[[1.0]]], np.poly(poles).real)
    with pytest.raises(InputError, match="poles of magnitude 1, on the circle") as refused:
        laurent(system, causal_order=5, noncausal_order=5)
    offered = [float(figure) for figure in re.findall(r"radius=(\S+)", str(refused.value))]
    assert len(offered) == 2
    assert offered[0] < 1.0 < offered[1]
    for radius in offered:
        assert radius in laurent(system, causal_order=5, noncausal_order=5, radius=radius).annulus


def test_an_improper_matrix_has_its_polynomial_part_by_entry():
    G = transfer_matrix([[[2.0, 0.0, 1.0], [1.0]], [[3.0], [1.0, 0.0]]], [[[1.0], [1.0, -2.0]], [[4.0], [1.0, -0.5]]])
    assert_allclose(G.polynomial, [[[0.0, 0.0], [0.0, 0.0]], [[2.0, 0.0], [0.0, 0.0]]])
    assert_allclose(G.proper.D, [[1.0, 0.0], [0.75, 1.0]])
    z = np.array([0.3 + 1j, -2.0])
    entries = [[2.0 * z**2 + 1.0, 1.0 / (z - 2.0)], [0.75 + 0.0 * z, z / (z - 0.5)]]
    assert_allclose(G.at(z), np.moveaxis(np.array(entries), -1, 0), rtol=1e-14)
    assert_allclose(
        laurent(G, causal_order=1, noncausal_order=1).coefficients[0], [[0.0, -0.25], [0.0, 0.0]], atol=1e-15
    )

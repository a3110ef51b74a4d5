"""Structures: the two ways of driving them, exactly and in floating point, and models they must agree with."""

from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gtmbench.errors import InputError
from theory.exact import exact_operator
from theory.motions import holds_for_free_responses
from theory.numeric import NumericOperator
from theory.structures import Structure, displacement_driven, force_driven, mass_spring, unit_columns, unit_rows

STIFFNESS = st.integers(0, 30).map(lambda k: Fraction(k, 10))


@st.composite
def cases(draw, coupled=True):
    """Return a structure of 4 or 5 masses, one or two driven ones, Wi and Wo."""
    n = draw(st.integers(4, 5))
    springs = {(i, j): draw(STIFFNESS) for j in range(1, n + 1) for i in range(j)}
    lumped = mass_spring([Fraction(draw(st.integers(10, 40)), 10) for _ in range(n)], springs)
    off = [[Fraction(draw(st.integers(-2, 2)) * coupled, 10) if i < j else 0 for j in range(n)] for i in range(n)]
    structure = Structure(np.array(lumped.M) + np.array(off) + np.array(off).T, lumped.K)
    driven = draw(st.permutations(range(1, n + 1)))[: draw(st.integers(1, 2))]
    weights = st.lists(st.integers(-3, 3), min_size=n, max_size=n)
    return structure, driven, [draw(weights) for _ in driven], [draw(weights)]


def both(structure, driven, Wi, Wo):
    """Return the operators driven by forces and by motions, the driven masses left out of the outputs."""
    blank = ([[0 if k + 1 in driven else w for k, w in enumerate(row)] for row in W] for W in (Wi, Wo))
    try:
        forced = force_driven(structure, unit_columns(driven, structure.masses), *blank)
        return forced, displacement_driven(structure, driven, Wi, Wo)
    except InputError as error:
        assume("singular" not in str(error))
        raise


@settings(max_examples=25)
@given(cases())
def test_forces_and_prescribed_motions_give_one_operator(case):
    """Theorems 5 and 6, whatever the inertia couples; with one driven mass even Gamma is the same, (5.91)."""
    forced, moved = both(*case)
    assert forced.equals(moved)
    if len(case[1]) == 1:
        assert forced.gamma_i == moved.gamma_i
        assert forced.gamma_o == moved.gamma_o


@pytest.mark.nightly
@settings(max_examples=15)
@given(cases())
def test_a_structure_is_the_state_space_model_of_its_equations(case):
    structure, driven, Wi, Wo = case
    forced = both(*case)[0]
    M, K, n = sympy.Matrix(structure.M), sympy.Matrix(structure.K), structure.masses
    blank = [sympy.Matrix([[0 if k + 1 in driven else w for k, w in enumerate(row)] for row in W]) for W in (Wi, Wo)]
    A = sympy.Matrix(sympy.BlockMatrix([[sympy.zeros(n), sympy.eye(n)], [-M.inv() * K, sympy.zeros(n)]]))
    B = sympy.Matrix.vstack(sympy.zeros(n, len(driven)), M.inv() * sympy.Matrix(unit_columns(driven, n)))
    Ci, Co = (sympy.Matrix.hstack(W, sympy.zeros(W.rows, n)) for W in blank)
    model = exact_operator(A, B, Ci, Co)
    assert forced.equals(model)
    scale = model.delta.ring.domain.from_sympy(M.det())
    assert forced.delta == model.delta * scale
    assert forced.gamma_i == model.gamma_i * model.delta.ring.ground_new(scale)
    assert holds_for_free_responses(forced.theorem_1, A, Ci, Co)  # Theorems 3 and 4


def test_beyond_the_driven_mass_of_a_chain_hang_the_poles():
    """Whatever drives mass 21 of 40, the 19 beyond it are a chain from a wall, whose frequencies are known."""
    structure, W = mass_spring([1.0] * 40, {(i, i + 1): 1.0 for i in range(40)}), unit_rows([1, 40], 40)
    expected = 2.0 * np.sin(np.pi * (np.arange(1, 20) - 0.5) / 39)
    for model in (structure.states(unit_columns([21], 40), W), structure.driven_states([21], W)):
        poles = NumericOperator(model=model).poles
        np.testing.assert_allclose(np.sort(poles.imag), np.sort([*-expected, *expected]), rtol=1e-10)
        np.testing.assert_allclose(poles.real, 0.0, atol=1e-10)


def test_half_of_the_masses_driven_leaves_no_dynamics():
    structure = mass_spring([1, 2, 3, 4], {(0, 1): 1, (1, 2): 2, (2, 3): 1, (3, 4): 5})
    Wi, Wo = [[9, 1, 9, 2], [9, 0, 9, 3]], [[9, 1, 9, 1]]  # of masses 2 and 4: [1 1] [1 2; 0 3]^-1
    for T in both(structure, [1, 3], Wi, Wo):
        assert T.reduced.denominator.degree() == 0
        np.testing.assert_allclose(T.at(2j), [[1.0, -1.0 / 3.0]])

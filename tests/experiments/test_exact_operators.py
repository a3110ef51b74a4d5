"""Exact operators: against other ways to the same numbers, and what may be cancelled of them."""

import sys
from fractions import Fraction

import numpy as np
import pytest
import sympy
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dissertation.reproduction import Reproduction, claim_polynomials
from gtmbench.errors import InputError
from theory.exact import exact_operator
from theory.motions import holds_for_free_responses, relative_residual, with_input
from theory.numeric import NumericOperator, invariant_zeros
from theory.polynomials import read_polynomial, write_polynomial
from theory.rational import coefficients, entries, roots
from theory.state_space import StateSpace

p = sympy.Symbol("p")
TENTHS = st.integers(-20, 20).map(lambda k: Fraction(k, 10))
# u = w1 + w3, lines and a growing oscillation
INPUT = {"generator": [[0, 1, 0, 0], [0, 0, 0, 0], [0, 0, 0.1, 2], [0, 0, -2, 0.1]]}


def matrices(*shape):
    return st.lists(st.lists(TENTHS, min_size=shape[1], max_size=shape[1]), min_size=shape[0], max_size=shape[0])


@st.composite
def models(draw, most_inputs=2):
    """Return A, B, Ci, Co, Di, Do of tenths."""
    n, m, outputs = draw(st.integers(2, 4)), draw(st.integers(1, most_inputs)), draw(st.integers(1, 2))
    shapes = {"A": (n, n), "B": (n, m), "Ci": (m, n), "Co": (outputs, n), "Di": (m, m), "Do": (outputs, m)}
    return {name: draw(matrices(*shape)) for name, shape in shapes.items()}


def operator(model):
    try:
        return exact_operator(**model)
    except InputError as error:
        assume("singular" not in str(error))
        raise


def stacked(model):
    """Return the model in floating point, pseudo inputs above pseudo outputs."""
    parts = {name: np.array(part, dtype=float) for name, part in model.items()}
    return StateSpace(parts["A"], parts["B"], *(np.vstack([parts[x + "i"], parts[x + "o"]]) for x in "CD"))


def system_matrix(model):
    """Return S(p) = [p I - A, -B; Ci, Di] as sympy has it."""
    A, B, Ci, Di = (sympy.Matrix(model[name]) for name in ("A", "B", "Ci", "Di"))
    return sympy.Matrix(sympy.BlockMatrix([[p * sympy.eye(A.rows) - A, -B], [Ci, Di]]))


def expression(polynomial):
    return sympy.Poly(list(coefficients(polynomial)), p).as_expr()


@settings(max_examples=25)
@given(models())
def test_the_operator_is_go_gi_inverse_and_its_longer_forms_are_too(model):
    T = operator(model)
    s, m = 1.3 + 2.1j, len(model["B"][0])
    G = stacked(model).at(s)
    assume(np.linalg.cond(G[:m]) < 1e6)
    expected = G[m:] @ np.linalg.inv(G[:m])
    scale = 1e-8 * (1.0 + np.abs(expected).max())
    np.testing.assert_allclose(T.at(s), expected, rtol=0, atol=scale)
    for form in (T.theorem_1, T.system_equation, T.reduced):
        above = [[np.polyval([float(c) for c in entry], s) for entry in row] for row in entries(form.numerators)]
        below = np.polyval([float(c) for c in coefficients(form.denominator)], s)
        np.testing.assert_allclose(np.array(above) / below, expected, rtol=0, atol=scale)


@pytest.mark.nightly
@settings(max_examples=15)
@given(models(most_inputs=3))
def test_the_system_equation_divides_by_the_determinant_of_the_system_matrix(model):
    assert (
        sympy.expand(
            system_matrix(model).det(method="berkowitz") - expression(operator(model).system_equation.denominator)
        )
        == 0
    )


@settings(max_examples=20)
@given(models(), st.data())
def test_theorem_1_and_the_system_equation_hold_for_every_motion(model, data):
    T, m = operator(model), len(model["B"][0])
    whole = with_input(**model, **INPUT, G=data.draw(matrices(m, 4)))
    assert holds_for_free_responses(T.theorem_1, **whole)
    assert holds_for_free_responses(T.system_equation, **whole)


def test_the_counterexamples_forbid_their_factor_only_where_it_moves():
    for pole in (0, -1):  # examples 2.2.1 and 2.2.2
        model = {"A": [[pole, 0], [0, pole]], "Ci": [[1, 0]], "Co": [[1, 1]]}
        T = exact_operator(**model, B=[[1], [0]])
        assert coefficients(T.delta) == coefficients(T.theorem_1.denominator**2)
        assert holds_for_free_responses(T.theorem_1, **model)
        assert not holds_for_free_responses(T.reduced, **model)
        assert holds_for_free_responses(T.reduced, A=model["A"], Ci=[[1, 0]], Co=[[1, 0]])


@settings(max_examples=15)
@given(models(), st.data())
def test_the_residual_is_rounding_and_tells_a_wrong_equation(model, data):
    T, m = operator(model), len(model["B"][0])
    whole = with_input(**model, **INPUT, G=data.draw(matrices(m, 4)))
    x0 = [1.0, *(0.3 * k - 0.5 for k in range(1, len(whole["A"])))]
    time_s = np.linspace(0.0, 2.0, 21)
    assert np.abs(relative_residual(T.theorem_1, **whole, x0=x0, time_s=time_s)).max() < 1e-7
    wrong = {**whole, "Co": 2 * whole["Co"]}
    off = np.abs(relative_residual(T.theorem_1, **wrong, x0=x0, time_s=time_s))
    assert holds_for_free_responses(T.theorem_1, **wrong) or off.max() > 1e-6


def test_poles_and_zeros_come_with_their_multiplicities():
    """y_i and y_o of one chain of integrators: Gamma_i = (p+1)^3 (p^2+4), Gamma_o = (p+1)(p-2)^2."""
    A = np.eye(7, k=1, dtype=int)
    below, above = (np.poly(numbers).round().astype(int)[::-1] for numbers in ([-1, -1, -1, 2j, -2j], [-1, 2, 2]))
    Ci, Co = (np.pad(polynomial, (0, 7 - len(polynomial)))[np.newaxis] for polynomial in (below, above))
    T = exact_operator(A, np.eye(7, dtype=int)[:, 6:], Ci, Co)
    assert T.delta == T.delta.ring.gens[0] ** 7
    np.testing.assert_allclose(T.poles, [-1, -1, -2j, 2j], atol=1e-14)
    np.testing.assert_allclose(T.zeros(), [2, 2], atol=1e-14)
    assert (T.relative_degree.item(), T.properness, T.stable) == (2, "strictly proper", False)
    inverse = exact_operator(A, np.eye(7, dtype=int)[:, 6:], Co, Ci)
    assert (inverse.properness, inverse.relative_degree.item()) == ("improper", -2)
    assert not inverse.stable
    np.testing.assert_allclose(inverse.at(1j) * T.at(1j), [[1.0]])


@pytest.mark.parametrize("tenth", [0.1, np.float64(0.1), np.float32(0.1), sympy.Float(0.1), sympy.Rational(1, 10)])
def test_a_decimal_is_what_it_prints_as(tenth):
    assert (
        exact_operator([[tenth]], [[1]], [[1]], [[1]]).delta
        == exact_operator([[Fraction(1, 10)]], [[1]], [[1]], [[1]]).delta
    )


def test_symbols_and_numbers_agree():
    a, b = sympy.symbols("a b")
    with_symbols = exact_operator([[a, 1], [0, b / a]], [[0], [1]], [[1, 0]], [[0, 1]])
    with_numbers = exact_operator([[3, 1], [0, Fraction(5, 3)]], [[0], [1]], [[1, 0]], [[0, 1]])
    for symbolic, other in zip(with_symbols.entry(0, 0), with_numbers.entry(0, 0), strict=True):
        assert [c.subs({a: 3, b: 5}) for c in symbolic] == [sympy.Rational(str(c)) for c in other]
    for value in ("poles", "stable"):
        with pytest.raises(InputError, match="symbols"):
            getattr(with_symbols, value)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"Ci": [[1, 0], [2, 0]]}, "singular"),
        ({"Ci": [[1, 0]]}, r"Ci has shape \(1, 2\); beside the other matrices it has \(2, 2\)"),
        ({"A": [[1, 2], [3]]}, "A has rows of lengths"),
        ({"A": 3}, "A is 3; give a matrix"),
        ({"A": [[np.nan, 0], [0, 1]]}, "A holds nan"),
        ({"A": [[True, 0], [0, 1]]}, "A holds True"),
        ({"A": [[sympy.sqrt(2), 0], [0, 1]]}, "give rational numbers"),
        ({"A": [[p, 0], [0, 1]]}, "aren't called p"),
    ],
)
def test_what_has_no_operator_is_refused(changed, message):
    model = {"A": [[1, 2], [0, 1]], "B": [[1, 0], [0, 1]], "Ci": [[1, 0], [0, 1]], "Co": [[1, 1]]} | changed
    with pytest.raises(InputError, match=message):
        exact_operator(**model)


def test_without_sympy_one_line_says_what_to_install(monkeypatch):
    monkeypatch.setitem(sys.modules, "sympy", None)
    with pytest.raises(InputError, match=r"pip install 'gtmbench\[theory\]'"):
        exact_operator([[1]], [[1]], [[1]], [[1]])


@settings(max_examples=25)
@given(models())
def test_floating_point_without_polynomials_gives_the_same_operator(model):
    T = operator(model)
    numeric = NumericOperator(model=stacked(model))
    s = 0.9 - 1.7j
    expected = T.at(s)
    np.testing.assert_allclose(numeric.at(s), expected, atol=1e-8 * (1.0 + np.abs(expected).max()))
    exact = roots(T.system_equation.denominator)
    assert len(numeric.poles) == len(exact)
    for pole in numeric.poles:  # multiple roots lose digits, so hold the polynomial against zero instead
        values = [float(c) for c in coefficients(T.system_equation.denominator)]
        assert abs(np.polyval(values, pole)) < 1e-8 * np.polyval(np.abs(values), abs(pole) + 1.0)


def test_zeros_at_infinity_stay_there():
    """Forty integrators: y_i is the last state but one, whose only finite zeros are none; y_o has a zero at 3."""
    A, B = np.eye(40, k=1), np.eye(40)[:, 39:]
    C = np.zeros((2, 40))
    C[0, 1] = 1.0
    C[1, :2] = -3.0, 1.0
    T = NumericOperator(model=StateSpace(A, B, C, np.zeros((2, 1))))
    np.testing.assert_allclose(T.poles, [0.0], atol=1e-12)
    np.testing.assert_allclose(T.zeros(), [3.0], atol=1e-12)
    far = invariant_zeros(*(np.array([[entry]]) for entry in (-1.0, 1.0, 1.0, 1e-6)))  # of 1 + 1e-6 (p + 1)
    np.testing.assert_allclose(far, [-1e6 - 1.0], rtol=1e-9)
    assert invariant_zeros(A, B, np.zeros((1, 40)), np.zeros((1, 1))) is None
    with pytest.raises(InputError, match="Definition 1"):
        NumericOperator(model=StateSpace(A, B, C * [[0.0], [1.0]], np.zeros((2, 1))))
    with pytest.raises(InputError, match="pseudo inputs, so give more"):
        NumericOperator(model=StateSpace(A, B, C[:1], np.zeros((1, 1))))


@given(st.lists(st.fractions(max_denominator=50), min_size=1, max_size=9), st.sampled_from("pqz"))
def test_polynomials_are_read_as_they_are_written(values, variable):
    read = read_polynomial(write_polynomial(values, variable))
    stripped = list(np.trim_zeros(np.array(values, dtype=object), "f")) or [Fraction(0)]
    assert list(read) == stripped


@pytest.mark.parametrize(
    ("text", "values"),
    [("-p + 3", [-1, 3]), ("63.38p^2-1.5e3", [Fraction("63.38"), 0, -1500]), ("p^2+2p^2", [3, 0, 0]), ("0", [0])],
)
def test_polynomials_are_read_as_they_are_printed(text, values):
    assert list(read_polynomial(text)) == values


def test_rows_of_polynomials_differ_in_one_coefficient(tmp_path):
    page = Reproduction(quick=True, folder=tmp_path, silent=True)
    for ours in ((1, 0, 2), (1, 0, 3), (0, 1, 0, 2)):
        claim_polynomials(page, "a row", ["p^2+2"], [tuple(Fraction(c) for c in ours)])
    a = sympy.Symbol("a")
    claim_polynomials(page, "symbols", ["a^2+2a"], [(a * (a + 2),)], expected=[(a**2 + 2 * a,)])
    assert [row.agreement for row in page.rows] == ["agrees", "differs", "differs", "agrees"]
    assert page.rows[1].values == [[1, 0, 3]]

"""Exact transmissibility operators of state-space models, chapter 2 of the dissertation."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction
from numbers import Integral, Real
from typing import Any

import numpy as np

from gtmbench.checks import shown
from gtmbench.errors import InputError
from gtmbench.imports import load_extra
from theory.rational import PolynomialMatrix, RationalOperator, adjugate_times

Matrix = Any  # rows of ints, Fractions, floats or sympy expressions: lists, a numpy array, a sympy matrix


def exact_operator(
    A: Matrix, B: Matrix, Ci: Matrix, Co: Matrix, Di: Matrix | None = None, Do: Matrix | None = None
) -> RationalOperator:
    """Return the operator from y_i = Ci x + Di u to y_o = Co x + Do u, where x' = A x + B u, equations (2.1)-(2.6).

    Nothing is assumed about controllability or observability, and any initial condition is allowed.

    Parameters
    ----------
    A, B, Ci, Co, Di, Do : shapes (n, n), (n, m), (m, n), (outputs, n), (m, m), (outputs, m)
        Ints, Fractions, rational sympy expressions of any symbols but p, or floats; a float is read as the shortest
        decimal that it prints as, which is what a source prints: 0.1 is 1/10. Without Di, Do: zero.

    Raises
    ------
    InputError
        For shapes that don't fit, entries that aren't rational, and a singular Gamma_i(p) (Definition 1).

    Examples
    --------
    >>> T = exact_operator([[0, 1], [-2, -0.5]], [[0], [1]], [[1, 0]], [[0, 1]])  # from position to velocity
    >>> T.entry(0, 0), T.properness
    (((Fraction(1, 1), Fraction(0, 1)), (Fraction(1, 1),)), 'improper')
    """
    n, m, outputs = len(rows("A", A)), len(rows("B", B)[0]), len(rows("Co", Co))
    Di, Do = (np.zeros((size, m), dtype=int) if D is None else D for size, D in ((m, Di), (outputs, Do)))
    read = read_exactly(
        {"A": A, "B": B, "Ci": Ci, "Co": Co, "Di": Di, "Do": Do},
        {"A": (n, n), "B": (n, m), "Ci": (m, n), "Co": (outputs, n), "Di": (m, m), "Do": (outputs, m)},
    )
    A = read.pop("A")
    return operator_of_system(A.eye(n, A.domain) * A.domain.gens[0] - A, **read)


def operator_of_system(
    P: PolynomialMatrix,
    B: PolynomialMatrix,
    Ci: PolynomialMatrix,
    Co: PolynomialMatrix,
    Di: PolynomialMatrix | None = None,
    Do: PolynomialMatrix | None = None,
) -> RationalOperator:
    """Return the operator of P(p) x = B(p) u, y_i = Ci x + Di u, y_o = Co x + Do u, all over one ring K[p].

    Gamma = C adj P(p) B + D det P(p): (2.20)-(2.22) with P = p I - A, (5.39) and (5.40) with P = p^2 M + K.
    """
    reached, delta = adjugate_times(P, B)
    return RationalOperator(
        gamma_i=Ci * reached if Di is None else Ci * reached + Di * delta,
        gamma_o=Co * reached if Do is None else Co * reached + Do * delta,
        delta=delta,
    )


def read_exactly(matrices: Mapping[str, Matrix], shapes: Mapping[str, tuple[int, int]]) -> dict[str, PolynomialMatrix]:
    """Return matrices over one ring K[p], K the rationals or the rational functions of the symbols in them."""
    load_extra("sympy", "theory", "exact operators need")
    from sympy import Symbol
    from sympy.polys.constructor import construct_domain
    from sympy.polys.matrices import DomainMatrix

    flat: list[Any] = []
    for name, given in matrices.items():
        entries = rows(name, given)
        shape = len(entries), len(entries[0])
        if shape != shapes[name]:
            raise InputError(f"{name} has shape {shape}; beside the other matrices it has {shapes[name]}")
        flat += [exact_entry(name, x) for row in entries for x in row]
    operator = Symbol("p")
    field, values = construct_domain(flat, field=True)
    symbols = () if field.is_QQ else getattr(field, "symbols", (None,))
    if not all(isinstance(symbol, Symbol) and symbol.name != operator.name for symbol in symbols):
        raise InputError(
            f"the matrices hold entries of {field}; give rational numbers, decimals and rational functions of symbols "
            "that aren't called p"
        )
    ring, left = field[operator], iter(values)
    return {
        name: DomainMatrix(
            [[ring.convert_from(next(left), field) for _ in range(columns)] for _ in range(count)],
            (count, columns),
            ring,
        )
        for name, (count, columns) in ((name, shapes[name]) for name in matrices)
    }


def rows(name: str, given: Matrix) -> list[list[Any]]:
    """Return a matrix as lists, at least 1 x 1."""
    listed = given.tolist() if hasattr(given, "tolist") and not isinstance(given, np.ndarray) else given
    try:
        matrix = [list(row) for row in listed]
    except TypeError as error:
        raise InputError(f"{name} is {shown(given)}; give a matrix, rows of equal length") from error
    if not matrix or not matrix[0] or len({len(row) for row in matrix}) > 1:
        raise InputError(f"{name} has rows of lengths {[len(row) for row in matrix]}; give rows of equal length, not 0")
    return matrix


def exact_entry(name: str, value: Any) -> Any:
    """Return an entry of a matrix as sympy has it, every float as its shortest decimal."""
    from sympy import Expr, Float, Integer, Rational

    if isinstance(value, Integral) and not isinstance(value, bool):
        return Integer(int(value))
    if isinstance(value, Fraction):
        return Rational(value.numerator, value.denominator)
    if isinstance(value, Real) and not isinstance(value, bool) and math.isfinite(value):
        return Rational(str(value))
    if isinstance(value, Expr) and value.is_finite is not False:
        return value.xreplace({decimal: Rational(str(decimal)) for decimal in value.atoms(Float)})
    raise InputError(f"{name} holds {shown(value)}; give finite numbers or sympy expressions")

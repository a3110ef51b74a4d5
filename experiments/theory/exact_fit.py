"""One output of a system without inputs from another, in rational numbers: what doubles are too short to show."""

from __future__ import annotations

from fractions import Fraction

from gtmbench.errors import InputError
from gtmbench.imports import load_extra
from gtmbench.values.record import FloatArray
from theory.state_space import StateSpace

Rationals = list[Fraction]


def exact_weights(system: StateSpace, *, given: int, wanted: int) -> Rationals:
    """Solve y_wanted(k + n-1) = sum over j = 0..n-1 of h_j y_given(k + 2j), n states, for whatever they are.

    As lags: every second one from -(n-1) to n-1. A double is a rational number, so A and C are taken as they are, and
    nothing is rounded.

    Parameters
    ----------
    system : StateSpace
    given, wanted : int
        Rows of C.

    Returns
    -------
    list of Fraction, h_0..h_(n-1)

    Raises
    ------
    InputError
        Where y_given doesn't see every state, or sympy is missing.

    Examples
    --------
    >>> import numpy as np
    >>> ring = StateSpace([[0.0, 1.0], [-1.0, 0.5]], np.zeros((2, 0)), np.eye(2), np.zeros((2, 0)))
    >>> exact_weights(ring, given=0, wanted=1)  # x_1(k+1) = x_0(k+2)
    [Fraction(0, 1), Fraction(1, 1)]
    """
    load_extra("sympy", "theory", "exact weights need")
    from sympy import QQ
    from sympy.polys.matrices import DomainMatrix
    from sympy.polys.matrices.exceptions import DMNonInvertibleMatrixError

    n = system.order
    columns = _observed(system, given, 2 * n - 1)[::2]
    rows = [[QQ(column[i].numerator, column[i].denominator) for column in columns] for i in range(n)]
    right = [[QQ(entry.numerator, entry.denominator)] for entry in _observed(system, wanted, n)[-1]]
    try:
        weights = DomainMatrix(rows, (n, n), QQ).lu_solve(DomainMatrix(right, (n, 1), QQ))
    except DMNonInvertibleMatrixError as error:
        raise InputError(f"output {given} doesn't see all {n} states by every second sample; choose another") from error
    return [Fraction(int(row[0].numerator), int(row[0].denominator)) for row in weights.to_list()]


def left_over(system: StateSpace, weights: Rationals, *, given: int, wanted: int) -> Fraction:
    """Return the largest coefficient of the states in y_wanted(k + n-1) - sum over j of h_j y_given(k + 2j).

    Nil means that the residual is nil at every k, whatever the states.
    """
    target = _observed(system, wanted, system.order)[-1]
    regressor = _observed(system, given, 2 * system.order - 1)[::2]
    fitted = [
        sum((h * row[i] for h, row in zip(weights, regressor, strict=True)), Fraction(0)) for i in range(len(target))
    ]
    return max(abs(coefficient - fit) for coefficient, fit in zip(target, fitted, strict=True))


def _observed(system: StateSpace, output: int, count: int) -> list[Rationals]:
    """Return C A^k of one output, k = 0..count-1."""
    columns = [_nonzero(column) for column in system.A.T]
    rows = [[Fraction(entry) for entry in system.C[output].tolist()]]
    while len(rows) < count:
        rows.append([sum((rows[-1][i] * a for i, a in column), Fraction(0)) for column in columns])
    return rows


def _nonzero(column: FloatArray) -> list[tuple[int, Fraction]]:
    return [(i, Fraction(entry)) for i, entry in enumerate(column.tolist()) if entry]

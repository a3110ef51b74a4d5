"""The transmissibility operator as a matrix of exact rational functions of p = d/dt, chapter 2 of the dissertation."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray
from theory.state_space import ComplexArray

Polynomial = Any  # of p: an element of sympy's ring K[p], K the rationals or rational functions of the symbols
PolynomialMatrix = Any  # sympy's DomainMatrix over K[p]; .to_Matrix() makes it an ordinary sympy matrix
Coefficients = tuple[Any, ...]  # by falling powers: Fraction, or sympy expressions where there are symbols
Properness = Literal["strictly proper", "proper", "improper"]
_DIGITS = 30  # of a root, before it's rounded to a float


@dataclass(frozen=True, kw_only=True, eq=False)
class DifferentialEquation:
    """denominator(p) y_o = numerators(p) y_i, one way of writing the operator down.

    Attributes
    ----------
    numerators : DomainMatrix, shape (outputs, inputs), over K[p]
    denominator : polynomial of K[p]
    """

    numerators: PolynomialMatrix
    denominator: Polynomial


@dataclass(frozen=True, kw_only=True, eq=False)
class RationalOperator:
    """T(p) = Gamma_o(p) Gamma_i(p)^-1, equation (2.49), from m pseudo inputs to the pseudo outputs, exactly.

    A common factor in p can't always be cancelled (examples 2.2.1, 2.2.2), so three differential equations are told
    apart, from the longest to the shortest:

    - `theorem_1`, (2.32): only delta(p) of (2.29) is cancelled. Every motion satisfies it: Theorem 1.
    - `system_equation`: delta(p)^(m-1), which (2.32) still has on both sides where m > 1, is cancelled too. Every
      motion satisfies it as well: with S(p) = [p I - A, -B; Ci, Di], det S(p) = det Gamma_i(p) / delta(p)^(m-1), and
      adj S(p) times S(p) [x; u] = [0; y_i] gives [x; u], hence y_o, times det S(p).
    - `reduced`: what the entries still have in common is cancelled. Every motion satisfies it if (A, B) is
      controllable: the motions of (y_i, y_o) are then the image of a polynomial matrix M(p), and c(p) r(p) M(p) = 0
      only where r(p) M(p) = 0. Uncontrollable modes may be excluded; `motions.holds_for_free_responses` tells.

    Attributes
    ----------
    gamma_i, gamma_o : DomainMatrix over K[p], shapes (m, m), (outputs, m)
        (2.20), (2.21); for structures (5.39), (5.40) or (5.80), (5.81).
    delta : polynomial of K[p]
        (2.22), the cancelled factor.

    Raises
    ------
    InputError
        Where Gamma_i(p) is singular: Definition 1 needs its inverse.
    """

    gamma_i: PolynomialMatrix
    gamma_o: PolynomialMatrix
    delta: Polynomial

    def __post_init__(self) -> None:
        if not self.theorem_1.denominator:
            raise InputError(
                "Gamma_i(p) is singular, so the pseudo inputs don't tell the inputs apart (Definition 1 needs its "
                "inverse); choose pseudo inputs that every input reaches on a way of its own"
            )

    @cached_property
    def theorem_1(self) -> DifferentialEquation:
        """Equation (2.32), det Gamma_i(p) y_o = Gamma_o(p) adj Gamma_i(p) y_i."""
        identity = self.gamma_i.eye(self.gamma_i.shape[0], self.gamma_i.domain)
        adjugate, determinant = adjugate_times(self.gamma_i, identity)
        return DifferentialEquation(numerators=self.gamma_o * adjugate, denominator=determinant)

    @cached_property
    def system_equation(self) -> DifferentialEquation:
        """(2.32) with delta(p)^(m-1) cancelled, as it always may be; for m = 1 nothing changes."""
        return _divided(self.theorem_1, self.delta ** (self.gamma_i.shape[0] - 1))

    @cached_property
    def reduced(self) -> DifferentialEquation:
        """Without any factor that all numerators and the denominator share; the denominator is monic."""
        equation = self.system_equation
        factor = equation.denominator
        for row in equation.numerators.to_list():
            for numerator in row:
                factor = factor.gcd(numerator)
        return _divided(equation, factor * (equation.denominator.LC / factor.LC))

    def entry(self, output: int, pseudo_input: int) -> tuple[Coefficients, Coefficients]:
        """Return the coprime numerator and monic denominator of one entry, coefficients by falling powers."""
        numerator, denominator = self._entry(output, pseudo_input)
        return coefficients(numerator), coefficients(denominator)

    def floats(self, output: int, pseudo_input: int) -> tuple[FloatArray, FloatArray]:
        """Return `entry` as arrays of floats."""
        numerator, denominator = self._entry(output, pseudo_input)
        return _floats(numerator), _floats(denominator)

    @cached_property
    def poles(self) -> ComplexArray:
        """Roots of the reduced denominator with their multiplicities, by rising magnitude, in rad/s."""
        return roots(self.reduced.denominator)

    def zeros(self, output: int = 0, pseudo_input: int = 0) -> ComplexArray:
        """Return the zeros of one entry in coprime form, by rising magnitude, in rad/s."""
        return roots(self._entry(output, pseudo_input)[0])

    @property
    def stable(self) -> bool:
        """Whether every pole has a negative real part."""
        return bool(np.all(self.poles.real < 0.0))

    @cached_property
    def relative_degree(self) -> FloatArray:
        """Degree of the denominator less that of the numerator, entry by entry; infinite for an entry that is zero."""
        degrees = np.full(self.gamma_o.shape, np.inf)
        for o, i in np.ndindex(degrees.shape):
            numerator, denominator = self._entry(o, i)
            degrees[o, i] = denominator.degree() - numerator.degree() if numerator else np.inf
        return degrees

    @property
    def properness(self) -> Properness:
        """What the entries are together; an improper operator differentiates, and sampled it's noncausal."""
        least = self.relative_degree.min()
        return "improper" if least < 0 else "proper" if least == 0 else "strictly proper"

    def at(self, p: ArrayLike) -> ComplexArray:
        """Return T at some points, shape ``(*p.shape, outputs, inputs)``, from the coprime entries in floats."""
        points = np.asarray(p, dtype=complex)
        values = np.empty((*points.shape, *self.gamma_o.shape), dtype=complex)
        for o, i in np.ndindex(self.gamma_o.shape):
            numerator, denominator = self.floats(o, i)
            values[..., o, i] = np.polyval(numerator, points) / np.polyval(denominator, points)
        return values

    def equals(self, other: RationalOperator) -> bool:
        """Tell whether two operators are the same rational functions, crosswise as in (5.133), exactly."""
        own, theirs = self.theorem_1, other.theorem_1
        left, right = (own.numerators * theirs.denominator).unify(theirs.numerators * own.denominator)
        return bool(left == right)

    def _entry(self, output: int, pseudo_input: int) -> tuple[Polynomial, Polynomial]:
        numerator, denominator = self.reduced.numerators[output, pseudo_input].element, self.reduced.denominator
        factor = numerator.gcd(denominator)
        factor = factor.quo_ground(factor.LC)
        return numerator.exquo(factor), denominator.exquo(factor)


def adjugate_times(matrix: PolynomialMatrix, right: PolynomialMatrix) -> tuple[PolynomialMatrix, Polynomial]:
    """Return adj(matrix) right and det(matrix), which may be zero, by the theorem of Cayley and Hamilton.

    `DomainMatrix.adj_det` of sympy 1.14 fails where a coefficient of the characteristic polynomial is zero.
    """
    product, sign = right * matrix.domain.zero, matrix.domain((-1) ** matrix.shape[0])
    *upper, last = matrix.charpoly()
    for coefficient in upper:
        product = matrix * product + right * coefficient
    return product * -sign, last * sign


def coefficients(polynomial: Polynomial) -> Coefficients:
    """Return the coefficients by falling powers: Fractions, or sympy expressions where there are symbols."""
    field = polynomial.ring.domain
    return tuple(
        Fraction(int(c.numerator), int(c.denominator)) if field.is_QQ else field.to_sympy(c)
        for c in (polynomial.to_dense() or [field.zero])
    )


def entries(matrix: PolynomialMatrix) -> list[list[Coefficients]]:
    """Return the coefficients of every entry of a polynomial matrix."""
    return [[coefficients(polynomial) for polynomial in row] for row in matrix.to_list()]


def roots(polynomial: Polynomial) -> ComplexArray:
    """Return the roots by rising magnitude; multiple ones come out exactly multiple.

    Raises
    ------
    InputError
        Where there are symbols, or the polynomial is zero.
    """
    from sympy import QQ, Poly, Symbol

    _refuse_symbols(polynomial)
    if not polynomial:
        raise InputError("zero has no roots; that entry of the operator is zero")
    unordered: list[complex] = []
    for factor, times in Poly(polynomial.to_dense(), Symbol("p"), domain=QQ).sqf_list()[1]:
        unordered += [complex(root) for root in factor.nroots(n=_DIGITS, maxsteps=1000)] * times
    return np.array(sorted(unordered, key=lambda root: (abs(root), root.real, root.imag)), dtype=complex)


def _floats(polynomial: Polynomial) -> FloatArray:
    _refuse_symbols(polynomial)
    return np.array([float(c) for c in coefficients(polynomial)])


def _refuse_symbols(polynomial: Polynomial) -> None:
    field = polynomial.ring.domain
    if not field.is_QQ:
        raise InputError(f"the operator holds the symbols of {field}; numbers need numbers: make it from numbers")


def _divided(equation: DifferentialEquation, factor: Polynomial) -> DifferentialEquation:
    return DifferentialEquation(
        numerators=equation.numerators.applyfunc(lambda numerator: numerator.exquo(factor)),
        denominator=equation.denominator.exquo(factor),
    )

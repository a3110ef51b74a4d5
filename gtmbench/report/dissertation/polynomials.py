"""Rows that hold exact polynomials against printed ones."""

from __future__ import annotations

from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from gtmbench.report.dissertation.reproduction import Reproduction
from gtmbench.theory.polynomials import read_polynomial, write_polynomial
from gtmbench.theory.rational import Coefficients, PolynomialMatrix, entries

_SHOWN = 3  # polynomials in a cell; more are cut short, `values` has them all


def claim_polynomials(
    page: Reproduction,
    result: str,
    printed: Sequence[str],
    ours: Sequence[Coefficients],
    *,
    expected: Sequence[Coefficients] | None = None,
    note: str = "",
) -> None:
    """Hold polynomials against the printed ones, coefficient by coefficient, exactly.

    `expected` are the printed ones' coefficients by falling powers, where `read_polynomial` can't read the print.
    """
    theirs = [read_polynomial(text) for text in printed] if expected is None else expected
    agrees = len(theirs) == len(ours) and all(_same(one, other) for one, other in zip(theirs, ours, strict=True))
    written = [write_polynomial(one) for one in ours]
    page.claim(result, _cell(printed), _cell(written), agrees=agrees, note=note, values=[plain(one) for one in ours])


def flat(matrix: PolynomialMatrix) -> list[Coefficients]:
    """Return the coefficients of all entries of a polynomial matrix, row by row."""
    return [one for row in entries(matrix) for one in row]


def plain(coefficients: Coefficients) -> list[int | float | str]:
    """Return coefficients as JSON has them: whole numbers, floats, and text where there are symbols."""
    return [_number(c) if isinstance(c, Fraction) else str(c) for c in coefficients]


def _number(value: Fraction) -> int | float:
    return value.numerator if value.denominator == 1 else float(value)


def _same(one: Sequence[Any], other: Sequence[Any]) -> bool:
    from sympy import cancel, sympify

    return len(one) == len(other) and all(cancel(sympify(a) - sympify(b)) == 0 for a, b in zip(one, other, strict=True))


def _cell(texts: Sequence[str]) -> str:
    return "; ".join(texts if len(texts) <= _SHOWN else [*texts[: _SHOWN - 1], "...", texts[-1]])

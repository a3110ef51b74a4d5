"""Polynomials as a line of text, ``p^6+10p^4+28p^2+19``, for the tables of printed results; nothing is evaluated."""

from __future__ import annotations

import re
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from gtmbench.checks import shown
from gtmbench.errors import InputError

_TERM = re.compile(
    r"(?P<sign>[+-]?)(?P<number>\(\d+/[1-9]\d*\)|\d+/[1-9]\d*(?![a-z\d])|\d+(?:\.\d+)?(?:e[+-]?\d+)?)?(?P<variable>[a-z](?:\^(?P<power>\d+))?)?"
)
_HIGHEST = 1000  # a power; a typing error shouldn't fill the memory


def write_polynomial(coefficients: Sequence[Any], variable: str = "p") -> str:
    """Return a polynomial as text; coefficients by falling powers, anything that has a ``str`` (floats: 7 digits).

    >>> write_polynomial([1, 0, -10, 0, Fraction(1, 2)])
    'p^4-10p^2+1/2'
    """
    top = len(coefficients) - 1
    written = [_written(c, top - i, variable) for i, c in enumerate(coefficients) if c != 0]
    return "".join(written).removeprefix("+") or "0"


def read_polynomial(text: str) -> tuple[Fraction, ...]:
    """Return the coefficients by falling powers of a sum of terms such as ``2p^4``, ``-1.5p``, ``(1/2)p^2`` and ``3``.

    >>> [int(c) for c in read_polynomial("p^4 - 10p^2 + 3")]
    [1, 0, -10, 0, 3]
    """
    terms: dict[int, Fraction] = {}
    letters = set()
    left = re.sub(r"\s*([+-])\s*", r"\1", text.strip())
    while left or not terms:
        term = _TERM.match(left)
        if term is None or not (term["number"] or term["variable"]) or (terms and not term["sign"]):
            raise InputError(f"{shown(text)} isn't a sum of terms such as 10p^4, at '{left[:20]}'; write p^6+10p^4+3")
        power = int(term["power"] or 1) if term["variable"] else 0
        letters |= {term["variable"][0]} if term["variable"] else set()
        if power > _HIGHEST or len(letters) > 1:
            raise InputError(f"{shown(text)} has a power above {_HIGHEST} or several variables; give one polynomial")
        value = Fraction((term["number"] or "1").strip("()"))
        terms[power] = terms.get(power, Fraction(0)) + (-value if term["sign"] == "-" else value)
        left = left[term.end() :]
    top = max((power for power, value in terms.items() if value), default=0)
    return tuple(terms.get(power, Fraction(0)) for power in range(top, -1, -1))


def _written(value: Any, power: int, variable: str) -> str:
    plain, sign = isinstance(value, float), "+"
    text = f"{value:.7g}" if plain else str(value)
    if text.startswith("-") and (plain or not set("+-") & set(text[1:])):
        sign, text = "-", text[1:]
    if not plain and (set("+-") & set(text) or (power and not text.isalnum())):
        text = f"({text})"
    if not power:
        return sign + text
    return f"{sign}{'' if text == '1' else text}{variable}{f'^{power}' if power > 1 else ''}"

"""How much worse than recorded a figure may be."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from gtmbench.checks import number, shown
from gtmbench.errors import InputError

_LARGEST = 1e9


@dataclass(frozen=True, kw_only=True)
class Tolerance:
    """The larger of a share of what was recorded and a number in the figure's unit.

    >>> tolerance = Tolerance(share=0.02, absolute=0.1)
    >>> tolerance.around(100.0), tolerance.around(1.0)
    (2.0, 0.1)
    """

    share: float = 0.0
    absolute: float = 0.0

    def around(self, recorded: float) -> float:
        """Return how far from the recorded value is still well."""
        return max(self.share * abs(recorded), self.absolute)


def parse_tolerance(key: str, given: Any) -> Tolerance:
    """Return a tolerance as a baseline states it: ``0.1``, ``"5 %"``, or both, ``["5 %", 0.1]``.

    Raises
    ------
    InputError
        Naming the key, what was given and what is legal.

    Examples
    --------
    >>> parse_tolerance("tolerances.delay_s", ["2 %", 0.1])
    Tolerance(share=0.02, absolute=0.1)
    """
    if not isinstance(given, list):
        return _one(key, given)
    if len(given) != 2 or isinstance(given[0], str) == isinstance(given[1], str):
        raise InputError(f'{key} is {shown(given)}; a list holds a share and a number, such as ["5 %", 0.1]')
    one, two = (_one(key, part) for part in given)
    return Tolerance(share=max(one.share, two.share), absolute=max(one.absolute, two.absolute))


def _one(key: str, given: Any) -> Tolerance:
    if not isinstance(given, str):
        return Tolerance(absolute=number(key, given, 0.0, _LARGEST))
    digits, percent, rest = given.partition("%")
    try:
        share = float(digits) if percent and not rest.strip() else None
    except ValueError:
        share = None
    if share is None:
        raise InputError(f'{key} is {shown(given)}; give a share such as "5 %", or a number in the figure\'s unit')
    return Tolerance(share=number(key, share, 0.0, _LARGEST) / 100.0)

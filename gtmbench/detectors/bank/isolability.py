"""Isolability: which suspects a bank tells apart, by which residuals rise or by how they rise, and which it can't."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from gtmbench.detectors.bank.bank import Bank
from gtmbench.detectors.virtual import integrable

BY_SHAPE, NOT_TOLD = "by shape", "no"


@dataclass(frozen=True, kw_only=True)
class Isolability:
    """What a bank's residuals tell of its suspects."""

    enters: Mapping[str, tuple[str, ...]]  # by suspect: the residuals that its fault enters
    # the suspects of which something says what they should have read: a residual of their own, or, of an angle, the
    # gyros. Others are never named: an alarm that one of them may explain stays undecided
    predicted: frozenset[str]

    @property
    def suspects(self) -> tuple[str, ...]:
        """Those of the bank."""
        return tuple(self.enters)

    def residuals_between(self, one: str, other: str) -> tuple[str, ...]:
        """Return the residuals that a fault of one enters and a fault of the other doesn't."""
        return tuple(output for output in self.enters[one] if output not in self.enters[other])

    def told(self, one: str, other: str) -> str:
        """Say what tells a fault of one from a fault of the other.

        The residuals that rise for it alone, ``by shape`` where only how residuals rise does, or ``no``.
        """
        return " ".join(self.residuals_between(one, other)) or (
            BY_SHAPE if {one, other} <= self.predicted else NOT_TOLD
        )

    def table(self) -> dict[str, dict[str, str]]:
        """Return `told` of every two suspects: a fault of the first, from a fault of the second."""
        names = self.suspects
        return {one: {other: self.told(one, other) for other in names if other != one} for one in names}


def isolability(bank: Bank) -> Isolability:
    """Work out what a bank tells apart.

    >>> from gtmbench.detectors.bank.bank import load_bank
    >>> table = isolability(load_bank("C"))
    >>> table.told("p", "q"), table.told("phi", "p"), table.told("p", "phi")
    ('p', 'q r', 'by shape')
    >>> isolability(load_bank("paper")).told("p", "q")
    'no'
    """
    outputs = [spec.output for spec in bank.diagnostic]
    return Isolability(
        enters={name: bank.affects(name) for name in bank.suspects},
        predicted=frozenset(name for name in bank.suspects if name in outputs or integrable(name, bank.channels)),
    )

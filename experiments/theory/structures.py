"""Lumped structures driven by forces or by prescribed motions, chapter 5 of the dissertation."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gtmbench.checks import shown, whole
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray
from theory.exact import Matrix, operator_of_system, read_exactly, rows
from theory.rational import PolynomialMatrix, RationalOperator
from theory.state_space import StateSpace


@dataclass(frozen=True, eq=False, repr=False)
class Structure:
    """M q'' + K q = f, equations (5.1) and (5.29); M needn't be diagonal.

    Attributes
    ----------
    M, K : tuples of rows, each n x n
        Ints, Fractions, floats or sympy expressions; in kg and N/m, say.
    """

    M: Matrix
    K: Matrix

    def __post_init__(self) -> None:
        for name in ("M", "K"):
            object.__setattr__(self, name, tuple(tuple(row) for row in rows(name, getattr(self, name))))
        n = len(self.M)
        for name, matrix in (("M", self.M), ("K", self.K)):
            if (len(matrix), len(matrix[0])) != (n, n):
                raise InputError(f"{name} has shape ({len(matrix)}, {len(matrix[0])}); M and K are both {n} x {n}")

    def __repr__(self) -> str:
        return f"Structure({len(self.M)} masses)"

    @property
    def masses(self) -> int:
        """How many, n."""
        return len(self.M)

    def states(self, B: Matrix, W: Matrix) -> StateSpace:
        """Return x = [q; q'] with forces B u and outputs W q, as (2.52), in floating point."""
        M, K, n = np.array(self.M, dtype=float), np.array(self.K, dtype=float), self.masses
        forces, outputs = np.array(rows("B", B), dtype=float), np.array(rows("W", W), dtype=float)
        below = np.linalg.solve(M, np.hstack([-K, forces]))
        return _second_order(below[:, :n], below[:, n:], outputs, np.zeros((len(outputs), forces.shape[1])))

    def driven_states(self, driven: Sequence[int], W: Matrix) -> StateSpace:
        """Return the structure with prescribed motions of some masses as inputs, outputs W q without their columns.

        The coordinates are z = q_[D] + M_[D,D]^-1 M_[D,.] e_D q_D, in which no input is differentiated.
        """
        M, K = np.array(self.M, dtype=float), np.array(self.K, dtype=float)
        moved, free = self._split(driven)
        outputs = np.array(rows("W", W), dtype=float)[:, free]
        here = np.ix_(free, free)
        inertial = np.linalg.solve(M[here], M[np.ix_(free, moved)])
        stiffness = np.linalg.solve(M[here], np.hstack([K[here], K[np.ix_(free, moved)] - K[here] @ inertial]))
        n = len(free)
        return _second_order(-stiffness[:, :n], -stiffness[:, n:], outputs, -outputs @ inertial)

    def _split(self, driven: Sequence[int]) -> tuple[list[int], list[int]]:
        """Return which rows, from 0, belong to driven masses and which don't."""
        moved = [whole("a driven mass", k, 1, self.masses) - 1 for k in driven]
        free = [k for k in range(self.masses) if k not in moved]
        if len(set(moved)) < len(moved) or not moved or not free:
            raise InputError(f"driven is {shown(driven)}; name some of the {self.masses} masses, each once")
        return moved, free


def mass_spring(masses: Sequence[Any], springs: Mapping[tuple[int, int], Any]) -> Structure:
    """Return masses 1..n joined by springs (i, j); 0 is the wall.

    >>> mass_spring([1, 1], {(0, 1): 3, (1, 2): 1}).K
    ((4, -1), (-1, 1))
    """
    n = len(masses)
    K: list[list[Any]] = [[0] * n for _ in range(n)]
    for ends, stiffness in springs.items():
        if len(ends) != 2 or len(set(ends)) < 2 or not all(0 <= end <= n for end in ends):
            raise InputError(f"a spring joins {ends}; give two of the masses 1 to {n}, or one and 0, the wall")
        for i in ends:
            for j in ends:
                if i and j:
                    K[i - 1][j - 1] += stiffness if i == j else -stiffness
    return Structure([[mass if i == j else 0 for j in range(n)] for i, mass in enumerate(masses)], K)


def unit_rows(numbers: Sequence[int], n: int) -> list[list[int]]:
    """Return the rows e_k of some masses 1..n: W of their displacements, and transposed B of forces on them.

    >>> unit_rows([1, 3], 3)
    [[1, 0, 0], [0, 0, 1]]
    """
    chosen = [whole("a mass", k, 1, n) for k in numbers]
    return [[int(k == j) for j in range(1, n + 1)] for k in chosen]


def unit_columns(numbers: Sequence[int], n: int) -> list[list[int]]:
    """Return the columns e_D of some masses 1..n, shape (n, masses): B of forces on them."""
    return [list(row) for row in zip(*unit_rows(numbers, n), strict=True)]


def force_driven(structure: Structure, B: Matrix, Wi: Matrix, Wo: Matrix) -> RationalOperator:
    """Return the operator from y_i = Wi q to y_o = Wo q under forces B u, equations (5.39), (5.40), (5.50), exactly.

    Parameters
    ----------
    structure : Structure
    B, Wi, Wo : shapes (n, m), (m, n), (outputs, n)

    Examples
    --------
    >>> two = mass_spring([1, 1], {(0, 1): 1, (1, 2): 1})
    >>> T = force_driven(two, unit_columns([1], 2), unit_rows([1], 2), unit_rows([2], 2))
    >>> T.reduced.numerators, T.reduced.denominator  # as Example 2.4.1
    (DomainMatrix([[1]], (1, 1), QQ[p]), p**2 + 1)
    """
    inputs = len(rows("B", B)[0])
    read = _read(structure, inputs, {"Wi": Wi, "Wo": Wo, "B": B})
    return operator_of_system(read["P"], read["B"], read["Wi"], read["Wo"])


def displacement_driven(structure: Structure, driven: Sequence[int], Wi: Matrix, Wo: Matrix) -> RationalOperator:
    """Return the operator under prescribed motions of the masses D, equations (5.80), (5.81), (5.88), exactly.

    The driven masses don't count in the outputs: (5.71) means the identity with the columns D, not k, removed. Row i
    of (5.55) is driven by -(p^2 M + K)_[D,.] e_D q_D; the source has only K there, which is the same where M is
    diagonal, but not in (5.114), where inertia couples too.

    Parameters
    ----------
    structure : Structure
    driven : sequence of int
        D, masses 1..n; as many as pseudo inputs, so at most n/2.
    Wi, Wo : shapes (d, n), (outputs, n)
    """
    moved, free = structure._split(driven)
    read = _read(structure, len(moved), {"Wi": Wi, "Wo": Wo})
    P = read["P"]
    outputs = (read[name].extract(range(read[name].shape[0]), free) for name in ("Wi", "Wo"))
    return operator_of_system(P.extract(free, free), -P.extract(free, moved), *outputs)


def _read(structure: Structure, inputs: int, given: dict[str, Matrix]) -> dict[str, PolynomialMatrix]:
    """Return P = p^2 M + K and the others over one ring."""
    n = structure.masses
    shapes = {"M": (n, n), "K": (n, n), "Wi": (inputs, n), "Wo": (len(rows("Wo", given["Wo"])), n), "B": (n, inputs)}
    read = read_exactly({"M": structure.M, "K": structure.K} | given, shapes)
    ring = read["M"].domain
    return read | {"P": read["M"] * ring.gens[0] ** 2 + read["K"]}


def _second_order(A: FloatArray, B: FloatArray, W: FloatArray, D: FloatArray) -> StateSpace:
    """Return z'' = A z + B u, y = W z + D u with the states [z; z']."""
    n = len(A)
    return StateSpace(
        A=np.block([[np.zeros((n, n)), np.eye(n)], [A, np.zeros((n, n))]]),
        B=np.vstack([np.zeros_like(B), B]),
        C=np.hstack([W, np.zeros_like(W)]),
        D=D,
    )

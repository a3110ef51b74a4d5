"""Rational matrices from their numerators and denominators, improper ones too, and minimal realisations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from numbers import Real
from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray, frozen
from theory.state_space import ComplexArray, StateSpace, companion

_TOLERANCE = 1e-10  # of the norms of A, B and C: directions that are reached more weakly count as unreached


@dataclass(frozen=True, kw_only=True, eq=False)
class TransferMatrix:
    """G(z) = proper(z) + sum over i = 1..degree of P_i z^i: any rational matrix.

    Attributes
    ----------
    proper : StateSpace
        What stays finite at infinity.
    polynomial : shape (degree, outputs, inputs)
        P_1, P_2, ...; none where G is proper.
    """

    proper: StateSpace
    polynomial: FloatArray

    def at(self, z: ArrayLike) -> ComplexArray:
        """Return G(z) at some points, shape ``(*z.shape, outputs, inputs)``."""
        points = np.asarray(z, dtype=complex)
        powers = points[..., np.newaxis] ** np.arange(1, len(self.polynomial) + 1)
        return np.asarray(self.proper.at(points) + np.tensordot(powers, self.polynomial, 1))


def transfer_matrix(
    numerators: Sequence[Sequence[ArrayLike]],
    denominators: Sequence[Sequence[ArrayLike]] | Sequence[float] | FloatArray,
) -> TransferMatrix:
    """Return the rational matrix of some numerators over their denominators, its proper part realised minimally.

    Parameters
    ----------
    numerators : nested sequences, outputs x inputs, of polynomials
        Falling powers of z.
    denominators : the same, or one polynomial for all entries

    Raises
    ------
    InputError
        Where these aren't rows of equal length, or a denominator is zero.

    Examples
    --------
    >>> G = transfer_matrix([[[-1.0, 6.3], [5.0, -11.9]], [[4.0, -14.0], [-12.0, 26.0]]], [1.0, -2.0, 0.35])
    >>> G.proper, G.proper.poles.real.round(6)
    (StateSpace(2 states, 2 x 2), array([0.193774, 1.806226]))
    >>> improper = transfer_matrix([[[1.0, 0.0, 0.0]]], [1.0, -2.0])  # z^2 / (z - 2) = z + 2 + 4 / (z - 2)
    >>> improper.polynomial[:, 0, 0], improper.proper.D[0, 0]
    (array([1.]), np.float64(2.0))
    """
    above = _rows("numerators", numerators)
    common = isinstance(denominators, Real) or isinstance(denominators[0], Real)
    below = _rows("denominators", [[denominators] * len(row) for row in above] if common else denominators)
    if [len(row) for row in below] != [len(row) for row in above]:
        raise InputError("numerators and denominators differ in shape; give a denominator for every entry, or one")
    entries = [[_divided(b, a) for b, a in zip(*rows, strict=True)] for rows in zip(above, below, strict=True)]
    degree = max(len(whole) for row in entries for whole, _ in row)
    quotient = np.array([[np.pad(whole, (degree - len(whole), 0)) for whole, _ in row] for row in entries])
    return TransferMatrix(
        proper=minimal(_joined([[part for _, part in row] for row in entries], quotient[..., -1])),
        polynomial=frozen(np.moveaxis(quotient[..., -2::-1], -1, 0)),
    )


def minimal(system: StateSpace) -> StateSpace:
    """Return a realisation of the same transfer matrix that is controllable and observable.

    Directions that are reached with less than 1e-10 of the norms of A, B and C are taken as unreached.

    >>> minimal(companion([1.0, -1.0], [1.0, -1.5, 0.5]))  # (z - 1) / ((z - 1) (z - 0.5))
    StateSpace(1 state, 1 x 1)
    """
    A, B, C = _reachable(system.A, system.B, system.C)
    A, C, B = (matrix.T for matrix in _reachable(A.T, C.T, B.T))
    return StateSpace(A, B, C, system.D)


def _rows(what: str, given: Any) -> list[list[FloatArray]]:
    """Return rows of polynomials without leading zeros."""
    try:
        rows = [
            [np.trim_zeros(np.atleast_1d(np.asarray(entry, dtype=np.float64)), "f") for entry in row] for row in given
        ]
    except (TypeError, ValueError):
        rows = []
    lengths = {len(row) for row in rows}
    if len(lengths) != 1 or 0 in lengths or any(entry.ndim != 1 for row in rows for entry in row):
        raise InputError(f"{what} aren't rows of polynomials; a single entry is [[[1.0, -0.5]]], for z - 0.5")
    return rows


def _divided(numerator: FloatArray, denominator: FloatArray) -> tuple[FloatArray, StateSpace]:
    """Return an entry's quotient, falling powers down to z^0, and its strictly proper rest."""
    if not len(denominator):
        raise InputError("a denominator is zero; give at least one coefficient that isn't")
    if len(numerator) < len(denominator):
        return np.zeros(1), companion(numerator, denominator)
    quotient, remainder = np.polydiv(numerator, denominator)
    return np.asarray(quotient), companion(remainder, denominator)


def _joined(parts: list[list[StateSpace]], D: FloatArray) -> StateSpace:
    """Return the matrix of some strictly proper entries, every entry with states of its own."""
    flat = [part for row in parts for part in row]
    return StateSpace(
        A=scipy.linalg.block_diag(*(part.A for part in flat)),
        B=np.vstack([scipy.linalg.block_diag(*(part.B for part in row)) for row in parts]),
        C=scipy.linalg.block_diag(*(np.hstack([part.C for part in row]) for row in parts)),
        D=D,
    )


def _reachable(A: FloatArray, B: FloatArray, C: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the system on the span of B, A B, A^2 B, ..., in an orthonormal basis of it, built block by block."""
    basis, block, scale = np.zeros((len(A), 0)), B, np.linalg.norm(B)
    while block.shape[1] and basis.shape[1] < len(A):
        for _ in range(2):  # the second time takes away what rounding left
            block = block - basis @ (basis.T @ block)
        directions, singular, _ = np.linalg.svd(block, full_matrices=False)
        new = directions[:, singular > _TOLERANCE * scale]
        basis = np.hstack([basis, new])
        block, scale = A @ new, np.linalg.norm(A)
    return basis.T @ A @ basis, basis.T @ B, C @ basis

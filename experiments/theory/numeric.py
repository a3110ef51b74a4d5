"""Transmissibility operators of large models in floating point: no polynomial is ever expanded."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from gtmbench.checks import whole
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray
from theory.state_space import ComplexArray, StateSpace

_NEGLIGIBLE = 1e-10  # of the largest singular value that a block had to begin with


@dataclass(frozen=True, kw_only=True, eq=False)
class NumericOperator:
    """T = Go Gi^-1 of x' = A x + B u, whose first m outputs are the pseudo inputs, as in (2.4), m the number of inputs.

    With S(p) = [p I - A, -B; Ci, Di] it is [Co, Do] S(p)^-1 [0; I]: what `RationalOperator.system_equation` is exactly.

    Attributes
    ----------
    model : StateSpace
        C = [Ci; Co], D = [Di; Do].

    Raises
    ------
    InputError
        Where there are no outputs but pseudo inputs, or S(p) is singular for every p.

    Examples
    --------
    >>> model = StateSpace([[0.0, 1.0], [-2.0, -0.5]], [[0.0], [1.0]], np.eye(2), np.zeros((2, 1)))
    >>> T = NumericOperator(model=model)  # from position to velocity: p
    >>> T.at(2j), T.poles, T.zeros()
    (array([[0.+2.j]]), array([], dtype=complex128), array([0.+0.j]))
    """

    model: StateSpace

    def __post_init__(self) -> None:
        if self.model.outputs <= self.model.inputs:
            raise InputError(
                f"the model has {self.model.outputs} outputs and {self.model.inputs} inputs; the first "
                f"{self.model.inputs} are pseudo inputs, so give more"
            )
        _ = self.poles  # refuses what Definition 1 excludes

    def at(self, p: ArrayLike) -> ComplexArray:
        """Return T at some points, shape ``(*p.shape, outputs, pseudo inputs)``; poles of the model do no harm."""
        A, B, C, D = self.model.A, self.model.B, self.model.C, self.model.D
        n, m = B.shape
        points = np.asarray(p, dtype=complex)[..., np.newaxis, np.newaxis]
        system = np.block([[-A, -B], [C[:m], D[:m]]]) + points * np.diag([1.0] * n + [0.0] * m)
        return np.asarray(np.hstack([C[m:], D[m:]]) @ np.linalg.solve(system, np.eye(n + m, m, -n) + 0j))

    @cached_property
    def poles(self) -> ComplexArray:
        """Roots of det S(p), the invariant zeros from inputs to pseudo inputs, by rising magnitude, in rad/s.

        They are the poles of T together with what cancels when `RationalOperator.system_equation` is reduced.
        """
        m = self.model.inputs
        poles = invariant_zeros(self.model.A, self.model.B, self.model.C[:m], self.model.D[:m])
        if poles is None:
            raise InputError("the pseudo inputs don't tell the inputs apart (Definition 1); choose others")
        return poles

    def zeros(self, output: int = 0, pseudo_input: int = 0) -> ComplexArray:
        """Return the roots of the numerator over det S(p) of one entry, by rising magnitude.

        Cramer's rule: S(p) with the row of the pseudo input replaced by that of the output.
        """
        m = self.model.inputs
        replaced = list(range(m))
        replaced[whole("pseudo_input", pseudo_input, 0, m - 1)] = m + whole(
            "output", output, 0, self.model.outputs - m - 1
        )
        zeros = invariant_zeros(self.model.A, self.model.B, self.model.C[replaced], self.model.D[replaced])
        if zeros is None:
            raise InputError("that entry of the operator is zero, and zero has no roots")
        return zeros


def invariant_zeros(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray) -> ComplexArray | None:
    """Return the roots of det [p I - A, -B; C, D] by rising magnitude, or None where it is zero for every p.

    As many outputs as inputs. What lies at infinity, which a generalised eigenvalue solver returns as large finite
    numbers, is taken out by orthogonal transformations until D is invertible (Emami-Naeini and Van Dooren, Automatica
    18, 1982, 415-430); then the roots are the eigenvalues of A - B D^-1 C.
    """
    A, B, C, D = _scaled(A, B, C, D)
    tolerance = _NEGLIGIBLE * np.linalg.norm(np.block([[A, B], [C, D]]), 2)
    while True:
        rotation, singular, _ = np.linalg.svd(D)
        C, D, rank = rotation.T @ C, rotation.T @ D, int(np.sum(singular > tolerance))
        if rank == len(D):
            break
        _, singular, turned = np.linalg.svd(C[rank:])
        told = int(np.sum(singular > tolerance))  # states that the outputs without feedthrough tell, so are at rest
        if told < len(C) - rank:
            return None
        turned = np.roll(turned, -told, axis=0)
        A, B, C, left = turned @ A @ turned.T, turned @ B, C[:rank] @ turned.T, len(A) - told
        A, B, C, D = (
            A[:left, :left],
            B[:left],
            np.vstack([C[:, :left], A[left:, :left]]),
            np.vstack([D[:rank], B[left:]]),
        )
    zeros = np.linalg.eigvals(A - B @ np.linalg.solve(D, C)).astype(complex)
    return np.asarray(zeros[np.lexsort((zeros.imag, zeros.real, np.abs(zeros)))])


def _scaled(A: FloatArray, B: FloatArray, C: FloatArray, D: FloatArray) -> tuple[FloatArray, ...]:
    """Return the system with balanced states and inputs and outputs of the size of A, which moves no zero."""
    _, (scale, _) = scipy.linalg.matrix_balance(A, permute=False, separate=True)
    A, B, C = A * scale / scale[:, np.newaxis], B / scale[:, np.newaxis], C * scale
    size = np.linalg.norm(A, 2) or 1.0
    rows = np.linalg.norm(np.hstack([C, D]), axis=1, keepdims=True)
    C, D = (size * part / np.where(rows, rows, 1.0) for part in (C, D))
    columns = np.linalg.norm(np.vstack([B, D]), axis=0)
    B, D = (size * part / np.where(columns, columns, 1.0) for part in (B, D))
    return A, B, C, D

"""Linear systems, equations (3.10) and (3.11): what the dissertation's examples are made of."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray, frozen

ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, eq=False, init=False, repr=False)
class StateSpace:
    """x(k+1) = A x(k) + B u(k), y(k) = C x(k) + D u(k), equations (3.10) and (3.11).

    The matrices serve x' = A x + B u as well, of structures and of exact operators; `simulate` and `markov` are those
    of discrete time.

    Parameters
    ----------
    A, B, C, D : array_like, shapes (n, n), (n, inputs), (outputs, n), (outputs, inputs)
        Copied, then read-only; n may be 0.

    Raises
    ------
    InputError
        Where the shapes don't fit or an entry isn't finite.

    Examples
    --------
    >>> half = StateSpace([[0.5]], [[1.0]], [[1.0]], [[0.0]])  # 1 / (z - 0.5)
    >>> half, half.markov(4)[:, 0, 0]
    (StateSpace(1 state, 1 x 1), array([0.  , 1.  , 0.5 , 0.25]))
    """

    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray

    def __init__(self, A: ArrayLike, B: ArrayLike, C: ArrayLike, D: ArrayLike) -> None:
        for name, given in (("A", A), ("B", B), ("C", C), ("D", D)):
            object.__setattr__(self, name, _matrix(name, given))
        n, (outputs, inputs) = len(self.A), self.D.shape
        for name, shape in (("A", (n, n)), ("B", (n, inputs)), ("C", (outputs, n))):
            own = getattr(self, name).shape
            if own != shape:
                raise InputError(f"{name} has shape {own}; with {n} rows of A and a D of {self.D.shape} it has {shape}")

    def __repr__(self) -> str:
        states = "1 state" if self.order == 1 else f"{self.order} states"
        return f"StateSpace({states}, {self.outputs} x {self.inputs})"

    @property
    def order(self) -> int:
        """States, n."""
        return len(self.A)

    @property
    def inputs(self) -> int:
        """Columns of D."""
        return int(self.D.shape[1])

    @property
    def outputs(self) -> int:
        """Rows of D."""
        return int(self.D.shape[0])

    @cached_property
    def poles(self) -> ComplexArray:
        """Eigenvalues of A, by rising magnitude."""
        poles = np.linalg.eigvals(self.A).astype(complex)
        return poles[np.argsort(np.abs(poles), kind="stable")]

    def at(self, z: ArrayLike) -> ComplexArray:
        """Return G(z) = C (z I - A)^-1 B + D at some points, shape ``(*z.shape, outputs, inputs)``."""
        points = np.asarray(z, dtype=complex)[..., np.newaxis, np.newaxis]
        return np.asarray(self.C @ np.linalg.solve(points * np.eye(self.order) - self.A, self.B + 0j) + self.D)

    def markov(self, count: int) -> FloatArray:
        """Return the Markov parameters H_0 = D, H_i = C A^(i-1) B, equation (3.12), shape (count, outputs, inputs)."""
        parameters = np.empty((count, self.outputs, self.inputs))
        power = self.B
        for i in range(count):
            parameters[i] = self.D if i == 0 else self.C @ power
            power = self.A @ power if i else power
        return parameters

    def simulate(self, u: ArrayLike, x0: ArrayLike | None = None) -> FloatArray:
        """Return y for inputs of shape (..., samples, inputs), every run from x0 (..., n), or from rest.

        Leading axes are runs, simulated together.
        """
        given = np.asarray(u, dtype=np.float64)
        if given.ndim < 2 or given.shape[-1] != self.inputs:
            raise InputError(f"u has shape {given.shape}; give (samples, {self.inputs}), runs in front")
        driven = np.moveaxis(given @ self.B.T, -2, 0)
        states = np.empty_like(driven)
        x = np.zeros(driven.shape[1:]) + (0.0 if x0 is None else np.asarray(x0, dtype=np.float64))
        for k, now in enumerate(driven):
            states[k] = x
            x = x @ self.A.T + now
        return np.asarray(np.moveaxis(states, 0, -2) @ self.C.T + given @ self.D.T)


def companion(numerator: ArrayLike, denominator: ArrayLike) -> StateSpace:
    """Return a proper SISO transfer function in controllable companion form, as (3.6), (3.7); falling powers of z.

    >>> companion([1.0], [1.0, -0.5]).poles
    array([0.5+0.j])
    """
    b, a = (np.trim_zeros(np.atleast_1d(np.asarray(part, dtype=np.float64)), "f") for part in (numerator, denominator))
    if not len(a) or len(b) > len(a):
        raise InputError(
            f"a numerator of degree {len(b) - 1} over a denominator of degree {len(a) - 1} isn't proper; "
            "give at least as high a degree below"
        )
    order = len(a) - 1
    b = np.pad(b, (len(a) - len(b), 0)) / a[0]
    a = a / a[0]
    return StateSpace(
        A=np.vstack([-a[1:], np.eye(order)[: max(order - 1, 0)]]) if order else np.zeros((0, 0)),
        B=np.eye(order, 1),
        C=(b[1:] - b[0] * a[1:])[np.newaxis],
        D=b[:1, np.newaxis],
    )


def lqr(plant: StateSpace, state_weight: ArrayLike, input_weight: ArrayLike) -> FloatArray:
    """Return K of u = -K x that minimises the sum over k >= 0 of x'Q x + u'R u, shape (inputs, n).

    >>> lqr(companion([1.0], [1.0, -2.0]), [[1.0]], [[1.0]]).round(4)
    array([[1.618]])
    """
    from scipy.linalg import solve_discrete_are

    Q, R = _matrix("state_weight", state_weight), _matrix("input_weight", input_weight)
    P = solve_discrete_are(plant.A, plant.B, Q, R)
    return np.asarray(np.linalg.solve(R + plant.B.T @ P @ plant.B, plant.B.T @ P @ plant.A))


def _matrix(name: str, given: ArrayLike) -> FloatArray:
    try:
        matrix = frozen(given)
    except (TypeError, ValueError) as error:
        raise InputError(f"{name} isn't a matrix of numbers; give rows of equal length") from error
    if matrix.ndim != 2 or not np.all(np.isfinite(matrix)):
        raise InputError(f"{name} has shape {matrix.shape}; it must be a matrix of finite numbers")
    return matrix

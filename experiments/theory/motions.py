"""Which motions satisfy an operator's differential equation: exactly, and in floating point (appendix A)."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from gtmbench.values.record import FloatArray
from theory.exact import Matrix, exact_entry, read_exactly, rows
from theory.rational import Coefficients, DifferentialEquation, coefficients, entries


def holds_for_free_responses(equation: DifferentialEquation, A: Matrix, Ci: Matrix, Co: Matrix) -> bool:
    """Tell, exactly, whether Ci e^(At) x0 and Co e^(At) x0 satisfy an equation for all x0 and t, as in Lemma A.3.

    Their k-th derivatives are Ci A^k e^(At) x0 and Co A^k e^(At) x0, so they do if and only if the sum over k of
    N_k Ci A^k - d_k Co A^k is zero, N_k and d_k being the coefficients of p^k. An equation with the operator's transfer
    function that holds for free responses holds with every input too, for motions add up.

    Examples
    --------
    Signals that differ by a constant, as in Example 2.2.1: y_i = x1 with x1' = u, and y_o = x1 + x2 with x2' = 0.

    >>> from theory.exact import exact_operator
    >>> model = {"A": [[0, 0], [0, 0]], "Ci": [[1, 0]], "Co": [[1, 1]]}
    >>> T = exact_operator(**model, B=[[1], [0]])
    >>> holds_for_free_responses(T.theorem_1, **model), holds_for_free_responses(T.reduced, **model)
    (True, False)
    """
    (outputs, m), n = equation.numerators.shape, len(rows("A", A))
    read = read_exactly({"A": A, "Ci": Ci, "Co": Co}, {"A": (n, n), "Ci": (m, n), "Co": (outputs, n)})
    numerators, A = equation.numerators.unify(read["A"])
    ring = A.domain
    inputs, output = (read[name].convert_to(ring) for name in ("Ci", "Co"))
    denominator = ring.convert_from(equation.denominator, equation.numerators.domain)

    def power(polynomial: Any, k: int) -> Any:
        return ring.ring.ground_new(polynomial.get((k,), ring.domain.zero))

    total = output * ring.zero
    for k in range(1 + max(entry.degree() for entry in [denominator, *numerators.to_list_flat()])):
        total += numerators.applyfunc(lambda entry, k=k: power(entry, k)) * inputs - output * power(denominator, k)
        inputs, output = inputs * A, output * A
    return bool(total.is_zero_matrix)


def relative_residual(
    equation: DifferentialEquation, A: ArrayLike, Ci: ArrayLike, Co: ArrayLike, x0: ArrayLike, time_s: ArrayLike
) -> FloatArray:
    """Return numerators(p) y_i - denominator(p) y_o over the sum of its terms' magnitudes, shape (times, outputs).

    y_i = Ci e^(At) x0 and y_o = Co e^(At) x0, derivatives from powers of A, not from differences: where the equation
    holds, what is left is rounding.
    """
    A, inputs, outputs, x0 = (np.asarray(given, dtype=float) for given in (A, Ci, Co, x0))
    states = np.array([scipy.linalg.expm(A * t) @ x0 for t in np.asarray(time_s, dtype=float)])
    total = size = np.zeros((len(states), len(outputs)))
    for into, out in zip(*_rising(equation), strict=True):
        taken, given = into * (states @ inputs.T)[:, np.newaxis], out * (states @ outputs.T)
        total = total + taken.sum(axis=-1) - given
        size = size + np.abs(taken).sum(axis=-1) + np.abs(given)
        inputs, outputs = inputs @ A, outputs @ A
    return np.asarray(total / np.where(size, size, 1.0))


def with_input(
    A: Matrix, B: Matrix, Ci: Matrix, Co: Matrix, Di: Matrix, Do: Matrix, *, generator: Matrix, G: Matrix
) -> dict[str, Any]:
    """Return the model with the input u = G w, w' = generator w, as one without: keys A, Ci, Co, for states [x; w].

    Every sum of polynomials times exponentials and sines is such an input; its motions are free responses of the whole.
    Entries are read exactly, as `exact_operator` reads them, so the whole has no rounding either.

    Examples
    --------
    >>> whole = with_input([[-1]], [[1]], [[1]], [[2]], [[0]], [[1]], generator=[[0]], G=[[3]])  # u = 3 w(0)
    >>> whole["A"].tolist(), whole["Co"].tolist()
    ([[-1, 3], [0, 0]], [[2, 3]])
    """
    A, B, Ci, Co, Di, Do, generator, G = (
        np.array([[exact_entry("a matrix", x) for x in row] for row in rows("a matrix", matrix)])
        for matrix in (A, B, Ci, Co, Di, Do, generator, G)
    )
    below = np.hstack([np.zeros((len(generator), len(A)), dtype=object), generator])
    return {
        "A": np.vstack([np.hstack([A, B @ G]), below]),
        "Ci": np.hstack([Ci, Di @ G]),
        "Co": np.hstack([Co, Do @ G]),
    }


def _rising(equation: DifferentialEquation) -> tuple[FloatArray, FloatArray]:
    """Return the coefficients by rising powers: shapes (powers, outputs, m) and (powers,)."""
    numerators, denominator = entries(equation.numerators), coefficients(equation.denominator)
    powers = max(len(entry) for entry in [denominator, *(entry for row in numerators for entry in row)])

    def padded(entry: Coefficients) -> list[float]:
        return [float(c) for c in reversed(entry)] + [0.0] * (powers - len(entry))

    rising = np.array([[padded(entry) for entry in row] for row in numerators])
    return np.moveaxis(rising, -1, 0), np.array(padded(denominator))

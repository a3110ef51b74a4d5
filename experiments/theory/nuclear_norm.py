"""The order of a system from noisy Markov parameters: nuclear norms of Hankel matrices, equations (3.3) and (3.4)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.imports import load_extra
from gtmbench.values.record import FloatArray, frozen
from theory.realisation import block_hankel, hankel_singular_values, markov_parameters

_FLOOR: Final = 1e-6  # of the data's greatest singular value: the solver leaves 1e-8 of it
_REACH: Final = 4.0


@dataclass(frozen=True, kw_only=True, eq=False)
class NuclearNormPath:
    """The solutions of (3.3), (3.4) for rising gamma.

    Attributes
    ----------
    gammas : shape (count,)
    markov : shape (count, parameters, outputs, inputs)
        Hbar(gamma): H_0, which isn't in the Hankel matrix, as given, then H_1, ..., H_(2n-1).
    singular_values : shape (count, rank of a full matrix)
        Of the Hankel matrix of Hbar(gamma), falling.
    floor : float
        Singular values above it are those that the solver means.
    """

    gammas: FloatArray
    markov: FloatArray
    singular_values: FloatArray
    floor: float

    @property
    def ranks(self) -> tuple[int, ...]:
        """How many singular values are left at each gamma."""
        return tuple(int(count) for count in np.sum(self.singular_values > self.floor, axis=1))

    def order(self, error: float) -> int:
        """Return how many singular values survive every gamma from `error` to four times that.

        `error` is the size of the estimate's own error: the Frobenius norm of the standard errors of H_1..H_(2n-1).
        About there the ball (3.4) begins to hold the true parameters; at four times it does whatever the errors'
        correlation. Singular values that errors alone have made vanish in between. So do those of the system that
        aren't several times larger than `error`: the order is then too low.

        Raises
        ------
        InputError
            Where the path has fewer than two gammas in that range.
        """
        low, high = number("error", error, 0.0, above=True), _REACH * error
        inside = (self.gammas >= low * (1.0 - 1e-9)) & (self.gammas <= high * (1.0 + 1e-9))
        if np.sum(inside) < 2:
            raise InputError(
                f"the path has gammas from {self.gammas[0]:g} to {self.gammas[-1]:g}, {np.sum(inside)} of them between "
                f"{low:g} and {high:g}, where the order stands; add some there"
            )
        return int(np.min(np.array(self.ranks)[inside]))


def nuclear_norm_path(markov: ArrayLike, gammas: ArrayLike) -> NuclearNormPath:
    """Minimise ||H(Hbar)||_N subject to ||Hbar - Hhat||_F <= gamma, equations (3.3) and (3.4), for every gamma.

    The convex solver Clarabel solves it for Hhat scaled to norm 1, once compiled for all gammas.

    Parameters
    ----------
    markov : array_like, shape (2n, outputs, inputs)
        Hhat: H_0, ..., H_(2n-1); an odd last one isn't used. A vector stands for one input and one output.
    gammas : array_like
        Greater than 0; returned rising.

    Raises
    ------
    InputError
        Where cvxpy isn't installed, all parameters are 0, or the solver gives up.

    Examples
    --------
    >>> exact = 0.5 ** np.arange(-1.0, 9.0)  # H_1 = 1, H_2 = 0.5, ...: one state
    >>> noisy = exact + 0.01 * np.random.default_rng(1).standard_normal(10)
    >>> path = nuclear_norm_path(noisy, [0.001, 0.03, 0.06, 0.12])
    >>> path.ranks, path.order(error=0.03)
    ((5, 1, 1, 1), 1)
    """
    given = markov_parameters(markov)
    given = given[: len(given) // 2 * 2]
    rising = np.sort(np.atleast_1d(np.asarray(gammas, dtype=float)).ravel())
    for gamma in rising:
        number("gamma", float(gamma), 0.0, above=True)
    size = float(np.linalg.norm(given[1:]))
    if size == 0.0:
        raise InputError("all Markov parameters are 0; there is no order to look for")
    problem, data, radius, step = _problem(given.shape)
    data.value = given[1:].ravel() / size
    path = np.repeat(given[np.newaxis], len(rising), axis=0)
    for at, gamma in enumerate(rising):
        radius.value = gamma / size
        problem.solve(solver="CLARABEL", warm_start=False)  # data updated in place would keep the first scaling
        if step.value is None:
            raise InputError(f"the solver found no optimum at gamma = {gamma:g} ({problem.status}); take another gamma")
        path[at, 1:] += gamma * step.value.reshape(given[1:].shape)
    singular = np.array([hankel_singular_values(parameters) for parameters in path])
    return NuclearNormPath(
        gammas=frozen(rising),
        markov=frozen(path),
        singular_values=frozen(singular),
        floor=_FLOOR * float(hankel_singular_values(given)[0]),
    )


def _problem(shape: tuple[int, ...]) -> tuple[Any, Any, Any, Any]:
    """Return the problem, its parameters (data and radius of the ball) and its variable (Hbar - Hhat) / gamma, flat.

    With the radius in the sum and not in the bound, small balls cost no digits.
    """
    cp = load_extra("cvxpy", "theory", "nuclear norms need")
    count = int(np.prod(shape)) - shape[1] * shape[2]
    step, data, radius = cp.Variable(count), cp.Parameter(count), cp.Parameter(nonneg=True)
    # where each entry of the matrix stands in the flat H_1, ..., H_(2n-1)
    entries = block_hankel(np.arange(-shape[1] * shape[2], count).reshape(shape)).astype(int)
    matrix = cp.reshape((data + radius * step)[entries.ravel(order="F")], entries.shape, order="F")
    near = cp.norm(step, 2) <= 1.0
    if shape[1:] != (1, 1):
        return cp.Problem(cp.Minimize(cp.normNuc(matrix)), [near]), data, radius, step
    # symmetric: the least tr(P) + tr(N) with P - N the matrix, which is solved five times as fast
    positive, negative = (cp.Variable(entries.shape, PSD=True) for _ in range(2))
    norm = cp.Minimize(cp.trace(positive) + cp.trace(negative))
    return cp.Problem(norm, [near, positive - negative == matrix]), data, radius, step

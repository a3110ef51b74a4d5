"""Laurent series of a rational matrix in an annulus about the origin, sections 3.3 to 3.5."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.typing import ArrayLike

from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.values.record import FloatArray, frozen
from theory.annuli import Annulus, annuli, on_circle, refuse_zero
from theory.state_space import ComplexArray, StateSpace
from theory.transfer_matrix import TransferMatrix


@dataclass(frozen=True, kw_only=True, eq=False)
class LaurentSeries:
    """G_{r,d}(z) = sum over i = -d..r of L_i z^-i, equation (3.27): a Laurent series cut off on either side.

    Attributes
    ----------
    coefficients : shape (lags, outputs, inputs)
        L_i for i = -d..r, in this order, as `Transmissibility.markov` has them.
    causal_order, noncausal_order : int
        r and d.
    annulus : Annulus
        Where the whole series converges to G; about the unit circle, A(rho_s, rho_u).
    """

    coefficients: FloatArray
    causal_order: int
    noncausal_order: int
    annulus: Annulus

    @property
    def lags(self) -> np.ndarray[tuple[int], np.dtype[np.int_]]:
        """The lags i = -d..r of `coefficients`."""
        return np.arange(-self.noncausal_order, self.causal_order + 1)

    def at(self, z: ArrayLike) -> ComplexArray:
        """Return G_{r,d}(z) at some points but 0, shape ``(*z.shape, outputs, inputs)``."""
        powers = np.asarray(z, dtype=complex)[..., np.newaxis] ** -self.lags
        return np.asarray(np.tensordot(powers, self.coefficients, 1))


def laurent(
    system: StateSpace | TransferMatrix, *, causal_order: int, noncausal_order: int, radius: float = 1.0
) -> LaurentSeries:
    """Return the coefficients of G's Laurent series in the maximal annulus that holds a circle, (3.22) and (3.23).

    L_i = H_s,i for i > 0, H_u,0 + D for i = 0 and H_u,i for i < 0: Markov parameters of the part with the poles inside
    the circle, and those of the reflection of the part with the poles outside, (3.15). Coefficients are bounded, and
    then square summable, in the annulus of the unit circle only (Theorem 2).

    Parameters
    ----------
    system : StateSpace or TransferMatrix
        A minimal realisation; the polynomial part of an improper matrix adds to ``L_-1``, ``L_-2``, ...
    causal_order, noncausal_order : int
        r and d.
    radius : float
        Of a circle about 0 without poles, which chooses the annulus. Other than 1 it does what the scaling (3.30),
        (3.31) is for: the series of G(alpha z) in the annulus of the unit circle has L_i / alpha^i.

    Raises
    ------
    InputError
        Where poles lie on the circle, as far as rounding lets that be told (`on_circle`); the message offers radii.

    Examples
    --------
    >>> from theory.transfer_matrix import transfer_matrix
    >>> G = transfer_matrix([[[1.0]]], np.poly([0.5, 1.5]))  # Example 3.4.2
    >>> series = laurent(G, causal_order=2, noncausal_order=1)
    >>> series.coefficients[:, 0, 0].round(9), series.annulus
    (array([-0.44444444, -0.66666667, -1.        , -0.5       ]), Annulus(inner=0.5, outer=1.5))
    >>> integrating = transfer_matrix([[[1.0]]], np.poly([0.5, 1.0]))
    >>> laurent(integrating, causal_order=2, noncausal_order=1)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ...
    gtmbench.errors.InputError: G has poles of magnitude 1, on the circle |z| = 1 ...
    """
    r, d = whole("causal_order", causal_order), whole("noncausal_order", noncausal_order)
    proper = _proper(system)
    annulus = _annulus_at(proper, radius)
    inside, outside = _parts(proper, radius)
    noncausal = reflected(outside).markov(d + 1)
    noncausal[0] += proper.D
    if isinstance(system, TransferMatrix):
        some = system.polynomial[:d]
        noncausal[1 : 1 + len(some)] += some
    return LaurentSeries(
        coefficients=frozen(np.concatenate([noncausal[::-1], inside.markov(r + 1)[1:]])),
        causal_order=r,
        noncausal_order=d,
        annulus=annulus,
    )


def split(system: StateSpace | TransferMatrix, radius: float = 1.0) -> tuple[StateSpace, StateSpace]:
    """Return the strictly proper parts with the poles inside a circle about 0 and outside: G = G_s + G_u + D, (3.18).

    By an ordered real Schur form and a Sylvester equation, so multiple poles cost no digits. A polynomial part belongs
    to neither.

    Raises
    ------
    InputError
        Where poles lie on the circle (`on_circle`); the message offers radii.

    Examples
    --------
    >>> stable, unstable = split(StateSpace([[0.5, 1.0], [0.0, 2.0]], [[0.0], [1.0]], [[1.5, 0.0]], [[0.0]]))
    >>> stable.at(0.0)[0, 0].real.round(9), unstable.at(0.0)[0, 0].real.round(9)  # -1 / (z - 0.5), 1 / (z - 2)
    (np.float64(2.0), np.float64(-0.5))
    """
    proper = _proper(system)
    _annulus_at(proper, radius)
    return _parts(proper, radius)


def reflected(system: StateSpace) -> StateSpace:
    """Return G_ref(z) = G(1/z), Proposition 2; its Markov parameters (3.15) are G's power series about 0, (3.17).

    Raises
    ------
    InputError
        Where zero is a pole.

    Examples
    --------
    >>> reflected(StateSpace([[2.0]], [[1.0]], [[1.0]], [[0.0]])).markov(3)[:, 0, 0]  # 1 / (z - 2)
    array([-0.5  , -0.25 , -0.125])
    """
    refuse_zero(system)
    inverse = np.linalg.inv(system.A)
    return StateSpace(inverse, -inverse @ system.B, system.C @ inverse, system.D - system.C @ inverse @ system.B)


def scaled(system: StateSpace, alpha: float) -> StateSpace:
    """Return G_alpha(z) = G(alpha z), equation (3.30), whose poles are those of G over alpha.

    >>> scaled(StateSpace([[1.0]], [[1.0]], [[1.0]], [[0.0]]), 2.0).poles
    array([0.5+0.j])
    """
    number("alpha", alpha, 0.0, above=True)
    return StateSpace(system.A / alpha, system.B, system.C / alpha, system.D)


def _proper(system: StateSpace | TransferMatrix) -> StateSpace:
    return system.proper if isinstance(system, TransferMatrix) else system


def _parts(system: StateSpace, radius: float) -> tuple[StateSpace, StateSpace]:
    T, Q, count = scipy.linalg.schur(system.A, output="real", sort=lambda x, y: np.hypot(x, y) < radius)
    inner, outer = slice(count), slice(count, None)
    B, C, D = Q.T @ system.B, system.C @ Q, np.zeros_like(system.D)
    X = scipy.linalg.solve_sylvester(T[inner, inner], -T[outer, outer], -T[inner, outer])
    return (
        StateSpace(T[inner, inner], B[inner] - X @ B[outer], C[:, inner], D),
        StateSpace(T[outer, outer], B[outer], C[:, inner] @ X + C[:, outer], D),
    )


def _annulus_at(system: StateSpace, radius: float) -> Annulus:
    """Return the maximal annulus that holds a circle, or refuse it for its poles."""
    number("radius", radius, 0.0, above=True)
    every = annuli(system)
    for annulus in every:
        if radius in annulus and not on_circle(system, radius):
            return annulus
    below = [annulus for annulus in every if annulus.radius < radius][-1:]
    above = [annulus for annulus in every if annulus.radius > radius][:1]
    magnitude = below[0].outer if below else 0.0
    offers = " or ".join(
        f"radius={_short(annulus)} ({annulus.inner:.6g} < |z| < {annulus.outer:.6g})" for annulus in below + above
    )
    raise InputError(
        f"G has poles of magnitude {magnitude:.9g}, on the circle |z| = {radius:.9g} to rounding, and no Laurent "
        f"series there; choose another annulus, equation (3.30): {offers}"
    )


def _short(annulus: Annulus) -> str:
    """Return a radius in an annulus with as few digits as will do."""
    written = (f"{annulus.radius:.{digits}g}" for digits in range(2, 18))
    return next(radius for radius in written if float(radius) in annulus)

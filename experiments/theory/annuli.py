"""Where a rational matrix is analytic: maximal annuli and spectral radii, section 3.3."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from gtmbench.errors import InputError
from theory.state_space import ComplexArray, StateSpace

_TOLERANCE = 1e-12  # of the norm of A, in `on_circle`


@dataclass(frozen=True, kw_only=True)
class Annulus:
    """A(inner, outer): inner < abs(z) < outer; a disk where inner is 0, a punctured plane where outer is infinite."""

    inner: float
    outer: float

    def __contains__(self, radius: float) -> bool:
        """Whether the circle of this radius lies in it."""
        return self.inner < radius < self.outer

    @property
    def radius(self) -> float:
        """A circle inside, as far from either edge as from the other."""
        if math.isinf(self.outer):
            return 2.0 * self.inner if self.inner else 1.0
        return math.sqrt(self.inner * self.outer) if self.inner else self.outer / 2.0


def annuli(system: StateSpace) -> tuple[Annulus, ...]:
    """Return the maximal annuli of Definition 2, from the innermost one outwards: each has a Laurent series of its own.

    The realisation must be minimal (`theory.transfer_matrix.minimal`): poles are eigenvalues of A. A multiple
    pole, which rounding takes apart, counts as one; see `on_circle`.

    >>> annuli(StateSpace([[0.5, 0.0], [0.0, -2.0]], [[1.0], [1.0]], [[1.0, 1.0]], [[0.0]]))
    (Annulus(inner=0.0, outer=0.5), Annulus(inner=0.5, outer=2.0), Annulus(inner=2.0, outer=inf))
    """
    edges = [0.0, *_magnitudes(system), math.inf]
    return tuple(Annulus(inner=inner, outer=outer) for inner, outer in pairwise(edges))


def spectral_radius(system: StateSpace) -> float:
    """Return rho(G), Definition 3: the greatest magnitude of a pole, 0 where there is none."""
    return annuli(system)[-1].inner


def inner_spectral_radius(system: StateSpace) -> float:
    """Return rho_inner(G), Definition 4: the least magnitude of a pole, infinite where there is none.

    Raises
    ------
    InputError
        Where zero is a pole.
    """
    refuse_zero(system)
    return annuli(system)[0].outer


def refuse_zero(system: StateSpace) -> None:
    """Refuse a system with a pole at zero, for which G(1/z) isn't proper (Proposition 2)."""
    if on_circle(system, 0.0):
        raise InputError("zero is a pole of G, so G(1/z) isn't proper; split G first and reflect the outer part")


def on_circle(system: StateSpace, radius: float, poles: ComplexArray | None = None) -> bool:
    """Return whether poles (all, or one of some) lie on a circle about 0, as far as rounding lets that be told.

    They do where a change of A by 1e-12 of its norm (or of the radius) puts an eigenvalue onto the circle at a pole's
    angle, at z: the least singular value of z I - A isn't more. A k-fold pole is then as near as the k-th root of that.
    """
    candidates = system.poles if poles is None else poles
    if not len(candidates):
        return False
    nearest = radius * np.exp(1j * np.angle(candidates))
    shifted = nearest[:, np.newaxis, np.newaxis] * np.eye(system.order) - system.A
    least = np.linalg.svd(shifted, compute_uv=False)[:, -1].min()
    return bool(least <= _TOLERANCE * max(float(np.linalg.norm(system.A, 2)), radius))


def _magnitudes(system: StateSpace) -> list[float]:
    """Return the distinct magnitudes of the poles but 0, rising; poles of one magnitude, to rounding, by their mean."""
    poles = system.poles
    size = np.abs(poles)
    groups: list[list[float]] = [[0.0]]
    for i in range(len(poles)):
        between = (groups[-1][-1] + size[i]) / 2.0
        if on_circle(system, between, poles[max(i - 1, 0) : i + 1]):
            groups[-1].append(float(size[i]))
        else:
            groups.append([float(size[i])])
    return [float(np.mean(group)) for group in groups[1:]]

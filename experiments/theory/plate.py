"""A thin rectangular plate, clamped along one side, by nine polynomials: section 4.5."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from gtmbench.checks import number
from gtmbench.values.record import FloatArray
from theory.vibration import Modes, modes_of

_X: Final = np.repeat([2, 3, 4], 3)  # powers of (4.14): x^(i+1) y^(j-1), i the slow index
_Y: Final = np.tile([0, 1, 2], 3)


@dataclass(frozen=True, kw_only=True)
class Plate:
    """A plate over 0 <= x <= a, 0 <= y <= b, clamped at x = 0; lengths in m, the rest in SI units.

    a, b and h are the text's; it doesn't say what aluminium is: `modulus` E, `poisson` nu and `density` are ours.

    Examples
    --------
    >>> plate = Plate()
    >>> plate.modes(forces=[(4.0, 0.25)], sensors=[(3.0, 0.75)], damping=0.05).frequency_hz[:3].round(5)
    array([0.34056, 2.12627, 3.38377])
    """

    a: float = 5.0
    b: float = 1.0
    h: float = 0.01
    modulus: float = 70e9
    poisson: float = 0.33
    density: float = 2700.0

    def __post_init__(self) -> None:
        for name in ("a", "b", "h", "modulus", "density"):
            number(name, getattr(self, name), 0.0, above=True)
        number("poisson", self.poisson, -1.0, 0.5)

    @property
    def rigidity(self) -> float:
        """D = E h^3 / 12 (1 - nu^2)."""
        return self.modulus * self.h**3 / (12.0 * (1.0 - self.poisson**2))

    def mass(self) -> FloatArray:
        """Return M of the kinetic energy: density h times the integral of w_m w_n, exact."""
        return self.density * self.h * self._integral((0, 0), (0, 0))

    def stiffness(self) -> FloatArray:
        """Return K of the bending energy, exact.

        2 U = D times the integral of w_xx^2 + w_yy^2 + 2 nu w_xx w_yy + 2 (1 - nu) w_xy^2.
        """
        xx, yy, xy = (2, 0), (0, 2), (1, 1)
        mixed = self._integral(xx, yy)
        pure = self._integral(xx, xx) + self._integral(yy, yy)
        twist = 2.0 * (1.0 - self.poisson) * self._integral(xy, xy)
        return np.asarray(self.rigidity * (pure + self.poisson * (mixed + mixed.T) + twist))

    def deflection(self, places: ArrayLike) -> FloatArray:
        """Return the nine polynomials of (4.14) at places (x, y), shape (places, 9)."""
        x, y = np.moveaxis(np.atleast_2d(np.asarray(places, dtype=np.float64)), -1, 0)[..., np.newaxis]
        return np.asarray(x**_X * y**_Y)

    def modes(self, *, forces: ArrayLike, sensors: ArrayLike, damping: float) -> Modes:
        """Return the plate's nine modes, forces and displacements standing at places (x, y)."""
        pushed, sensed = self.deflection(forces).T, self.deflection(sensors)
        return modes_of(self.mass(), self.stiffness(), forces=pushed, sensors=sensed, damping=damping)

    def _integral(self, left: tuple[int, int], right: tuple[int, int]) -> FloatArray:
        """Return integrals over the plate of products of the polynomials' derivatives, shape (9, 9)."""
        along = _moments(_X, left[0], right[0], self.a)
        return np.asarray(along * _moments(_Y, left[1], right[1], self.b))


def _moments(powers: np.ndarray[tuple[int], np.dtype[np.int_]], left: int, right: int, length: float) -> FloatArray:
    """Return the integral over 0..length of the left-th times the right-th derivatives of powers, all pairs."""
    factors = [np.prod([powers - k for k in range(order)] or [np.ones_like(powers)], axis=0) for order in (left, right)]
    total = np.add.outer(powers - left, powers - right) + 1
    held = np.maximum(total, 1)  # a derivative that is nil has no power; its factor is 0
    return np.asarray(np.multiply.outer(*factors) * length ** held.astype(float) / held)

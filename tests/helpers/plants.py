"""Rational plants whose Laurent series are known another way: partial fractions, and Cauchy's integral."""

from dataclasses import dataclass

import numpy as np
from numpy.polynomial import polynomial as poly

from theory import closed_loop, plants, state_space
from theory.state_space import StateSpace


@dataclass(frozen=True, kw_only=True)
class Plant:
    """A system with simple poles, and its numerators by rising powers of z over one denominator."""

    system: StateSpace
    numerators: list
    denominator: np.ndarray

    def laurent(self, r, d):
        """Return L_i for i = -d..r, shape (lags, outputs, inputs), by partial fractions in the annulus at |z| = 1.

        1 / (z - p) is the sum of p^(i-1) z^-i over i >= 1 where |p| < 1, of -p^(i-1) z^-i over i <= 0 where |p| > 1.
        """
        lags = np.arange(-d, r + 1)
        total = np.zeros((len(lags), *self.system.D.shape), dtype=complex)
        total[lags == 0] = self.system.D
        slope = poly.polyder(self.denominator)
        for p in poly.polyroots(self.denominator):
            residue = np.array([[poly.polyval(p, numerator) for numerator in row] for row in self.numerators])
            residue = residue / poly.polyval(p, slope)
            inside = abs(p) < 1.0
            series = np.where((lags >= 1) == inside, (1.0 if inside else -1.0) * p ** (lags - 1.0), 0.0)
            total += series[:, np.newaxis, np.newaxis] * residue
        assert np.abs(total.imag).max() < 1e-9
        return total.real

    def laurent_by_contour(self, r, d, points=4096):
        """Return the same from C (z I - A)^-1 B + D on the unit circle: the trapezoidal rule for Cauchy's integral."""
        z = np.exp(2j * np.pi * np.arange(points) / points)
        values = self.system.at(z)
        return np.array([np.tensordot(z**i, values, 1).real / points for i in range(-d, r + 1)])

    def tail(self, r, d):
        """Return the sum of |L_i| over the lags left out, shape (outputs, inputs)."""
        far = np.abs(self.laurent(400, 400))
        return far[: 400 - d].sum(axis=0) + far[400 + r + 1 :].sum(axis=0)

    def lqr(self, weight):
        """Return K of the LQR controller with Q = weight I and R = I."""
        return state_space.lqr(self.system, weight * np.eye(self.system.order), np.eye(self.system.inputs))

    def closed_loop(self, c, K, v=None):
        """Return u = c - K x, and y, from rest; v adds to the plant's input behind where u is measured.

        c and v have shape (..., samples, inputs), loops in front.
        """
        driven = np.concatenate([c, np.zeros_like(c) if v is None else v], axis=-1)
        return np.split(closed_loop.closed_loop(self.system, K).simulate(driven), [self.system.inputs], axis=-1)


def companion(numerator, poles, feedthrough=0.0):
    """Return a SISO plant in controllable companion form; the numerator, without the feedthrough, by rising powers."""
    denominator = poly.polyfromroots(poles).real
    return Plant(
        system=state_space.companion(poly.polyadd(numerator, feedthrough * denominator)[::-1], denominator[::-1]),
        numerators=[[numerator]],
        denominator=denominator,
    )


def example_3_1():
    """Return (3.95) with its realisation (3.96)."""
    return Plant(
        system=plants.example_3_1().plant,
        numerators=[[[6.3, -1.0], [-11.9, 5.0]], [[-14.0, 4.0], [26.0, -12.0]]],
        denominator=np.array([0.35, -2.0, 1.0]),
    )


def example_3_2():
    """Return (3.98) in companion form, which (3.99) belongs to."""
    return Plant(
        system=plants.example_3_2().plant,
        numerators=[[poly.polyfromroots([0.4j, -0.4j, 0.3, -0.3]).real]],
        denominator=poly.polyfromroots([-0.7, -0.6, 0.5j, -0.5j, 1.8, 1.7, 1.6]).real,
    )

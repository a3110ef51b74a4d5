"""Rational plants with known Laurent series, and closed loops about them, for the tests."""

from dataclasses import dataclass

import numpy as np
import scipy.linalg
from numpy.polynomial import polynomial as poly


@dataclass(frozen=True, kw_only=True)
class Plant:
    """G(z) = C (z I - A)^-1 B + D with simple poles; numerators by rising powers of z over one denominator."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    numerators: list
    denominator: np.ndarray

    @property
    def poles(self):
        return poly.polyroots(self.denominator)

    def laurent(self, r, d):
        """Return L_i for i = -d..r, shape (lags, outputs, inputs), by partial fractions in the annulus at |z| = 1.

        1 / (z - p) is the sum of p^(i-1) z^-i over i >= 1 where |p| < 1, of -p^(i-1) z^-i over i <= 0 where |p| > 1.
        """
        lags = np.arange(-d, r + 1)
        found = np.zeros((len(lags), *self.D.shape), dtype=complex)
        found[lags == 0] = self.D
        slope = poly.polyder(self.denominator)
        for p in self.poles:
            residue = np.array([[poly.polyval(p, one) for one in row] for row in self.numerators])
            residue = residue / poly.polyval(p, slope)
            inside = abs(p) < 1.0
            series = np.where((lags >= 1) == inside, (1.0 if inside else -1.0) * p ** (lags - 1.0), 0.0)
            found += series[:, np.newaxis, np.newaxis] * residue
        assert np.abs(found.imag).max() < 1e-9
        return found.real

    def laurent_by_contour(self, r, d, points=4096):
        """Return the same from C (z I - A)^-1 B + D on the unit circle: the trapezoidal rule for Cauchy's integral."""
        z = np.exp(2j * np.pi * np.arange(points) / points)
        values = np.array([self.C @ np.linalg.solve(one * np.eye(len(self.A)) - self.A, self.B) for one in z]) + self.D
        return np.array([np.tensordot(z**i, values, 1).real / points for i in range(-d, r + 1)])

    def tail(self, r, d):
        """Return the sum of |L_i| over the lags left out, shape (outputs, inputs)."""
        far = np.abs(self.laurent(400, 400))
        return far[: 400 - d].sum(axis=0) + far[400 + r + 1 :].sum(axis=0)

    def lqr(self, weight):
        """Return K of the LQR controller with Q = weight I and R = I."""
        count = self.B.shape[1]
        P = scipy.linalg.solve_discrete_are(self.A, self.B, weight * np.eye(len(self.A)), np.eye(count))
        return np.linalg.solve(np.eye(count) + self.B.T @ P @ self.B, self.B.T @ P @ self.A)

    def closed_loop(self, c, K, v=None):
        """Return u = c - K x, and y, from rest; v adds to the plant's input behind where u is measured.

        c and v have shape (samples, inputs), or (samples, inputs, loops) for many loops at once.
        """
        x, u, y = (
            np.zeros((len(self.A), *c.shape[2:])),
            np.empty(c.shape),
            np.empty((len(c), len(self.C), *c.shape[2:])),
        )
        for k, now in enumerate(c):
            u[k] = now - K @ x
            entering = u[k] if v is None else u[k] + v[k]
            y[k] = self.C @ x + self.D @ entering
            x = self.A @ x + self.B @ entering
        return u, y


def companion(numerator, poles, feedthrough=0.0):
    """Return a SISO plant in controllable companion form; the numerator by rising powers."""
    denominator = poly.polyfromroots(poles).real
    order = len(denominator) - 1
    padded = np.pad(np.asarray(numerator, dtype=float), (0, order - len(numerator)))
    return Plant(
        A=np.vstack([-denominator[-2::-1], np.eye(order - 1, order)]),
        B=np.eye(order, 1),
        C=padded[np.newaxis, ::-1],
        D=np.array([[feedthrough]]),
        numerators=[[padded]],
        denominator=denominator,
    )


def example_3_1():
    """Return (3.95) with its realization (3.96)."""
    return Plant(
        A=np.array([[1.5, 0.2], [2.0, 0.5]]),
        B=np.array([[1.0, -1.0], [-1.0, 3.0]]),
        C=np.array([[1.0, 2.0], [0.0, -4.0]]),
        D=np.zeros((2, 2)),
        numerators=[[[6.3, -1.0], [-11.9, 5.0]], [[-14.0, 4.0], [26.0, -12.0]]],
        denominator=np.array([0.35, -2.0, 1.0]),
    )


def example_3_2():
    """Return (3.98) in companion form, which (3.99) belongs to."""
    return companion(poly.polyfromroots([0.4j, -0.4j, 0.3, -0.3]).real, [-0.7, -0.6, 0.5j, -0.5j, 1.8, 1.7, 1.6])

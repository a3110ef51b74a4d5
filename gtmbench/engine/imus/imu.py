"""A further IMU in the blocks of a flight: how it is mounted, and what it reads about the aircraft's axes.

The rotation M of g = M g' is the median of those over stretches of the log, so that no fault of a part of it turns it:
each is fitted by least squares and made orthogonal by its singular values. Small angles are left to constants.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

_STRETCH, _FEWEST = 50, 5  # blocks of one fit; fits of which the median is any
_RIDGE, _LIVELY_DEG_S = 1e-3, 1.0  # an axis that turns less in a stretch tells nothing
_TURNED_DEG = 10.0  # more is no constant of a gyro that stands a bit askew
_ONE, _WHOLE = 0.3, 3  # from one, of singular values while no axis is broken; so many fits tell a mounting
_THROUGHOUT = 0.9  # of the fits: a sign that turns amid the log is a fault, and no mounting


@dataclass(frozen=True, kw_only=True, eq=False)
class Mounting:
    """A rotation from an IMU's axes to the aircraft's."""

    # shape (3, 3): the identity where it isn't turned, or nothing tells how
    matrix: FloatArray = field(default_factory=lambda: np.eye(3), repr=False)
    turned_deg: float = 0.0  # by how much it is turned; 0 for not at all
    is_reflected: bool = False  # whether an odd number of axes has the wrong sign, which no mounting does

    @property
    def is_along_axes(self) -> bool:
        """Whether each of its axes lies along one of the aircraft's, so that each gyro is about one of these."""
        return not self.is_reflected and bool(np.abs(self.matrix).max(axis=1).min() > np.cos(np.radians(_TURNED_DEG)))

    @property
    def signs(self) -> list[float]:
        """By which sign each of these is read, 1 or -1."""
        return [float(np.sign(self.matrix[axis, own])) for axis, own in enumerate(self.taken)]

    @property
    def text(self) -> str:
        """Which of its gyros read p, q and r: ``-q, p, r``."""
        told = zip(self.signs, self.taken, strict=True)
        return ", ".join(f"{'-' if sign < 0.0 else ''}{GYROS[own]}" for sign, own in told)

    @property
    def taken(self) -> list[int]:
        """Which of the IMU's axes lies nearest to each of the aircraft's."""
        return [int(each) for each in np.argmax(np.abs(self.matrix), axis=1)]

    def turned(self, gyros: FloatArray) -> FloatArray:
        """Return what gyros read about the aircraft's axes, shape (blocks, 3)."""
        return gyros if not self.turned_deg else np.asarray(gyros @ self.matrix.T)


def mounting_of(gyros: FloatArray, known: FloatArray) -> Mounting:
    """Return how an IMU is mounted whose gyros read one motion as those do that are known.

    `gyros`, `known`, shape (blocks, 3).

    >>> known = 10.0 * np.random.default_rng(1).standard_normal((1500, 3))
    >>> quarter = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    >>> mounting = mounting_of(known @ quarter, known)
    >>> round(mounting.turned_deg), mounting.text, np.allclose(mounting.turned(known @ quarter), known, atol=1e-6)
    (90, '-q, p, r', True)
    >>> mounting_of(known * [1.0, 1.0, -1.0], known).is_reflected
    True
    """
    there = np.isfinite(gyros).all(axis=1) & np.isfinite(known).all(axis=1)
    own, others = gyros[there], known[there]
    fits = [
        fit
        for begin in range(0, len(own) - _STRETCH + 1, _STRETCH)
        if (fit := _fit(own[begin : begin + _STRETCH], others[begin : begin + _STRETCH])) is not None
    ]
    if len(fits) < _FEWEST:
        return Mounting()
    rotations = [fit for fit in fits if np.linalg.det(fit) > 0.0]
    is_reflected = len(rotations) < (1.0 - _THROUGHOUT) * len(fits)
    whole = [fit for fit in rotations if np.abs(np.linalg.svd(fit, compute_uv=False) - 1.0).max() < _ONE]
    usual = np.median(fits if is_reflected else whole if len(whole) >= _WHOLE else rotations, axis=0)
    left, sizes, right = np.linalg.svd(usual)
    if sizes[-1] < 0.5 * sizes[0]:  # they don't read one motion
        return Mounting()
    if is_reflected:
        return Mounting(is_reflected=True)
    found = left @ right
    turned_deg = float(np.degrees(np.arccos(np.clip(0.5 * (np.trace(found) - 1.0), -1.0, 1.0))))
    return Mounting(matrix=found, turned_deg=turned_deg) if turned_deg > _TURNED_DEG else Mounting()


def _fit(own: FloatArray, others: FloatArray) -> FloatArray | None:
    """Return M of a stretch; None where an axis hardly turns."""
    own, others = own - own.mean(axis=0), others - others.mean(axis=0)
    if others.std(axis=0).min() < _LIVELY_DEG_S:
        return None
    squares = own.T @ own
    return np.asarray(np.linalg.solve(squares + _RIDGE * np.trace(squares) / 3.0 * np.eye(3), own.T @ others).T)


_OF = " of "


@dataclass(frozen=True, kw_only=True, eq=False)
class FlightImu:
    """A further IMU; NaN where nothing is read.

    Attributes
    ----------
    name : str
    gyros, rough, held_s : shape (blocks, 3)
        As those of `Blocks`.
    mounting : Mounting
        By which the gyros were turned.
    """

    name: str
    gyros: FloatArray = field(repr=False)
    rough: FloatArray = field(repr=False)
    held_s: FloatArray = field(repr=False)
    mounting: Mounting

    @property
    def channels(self) -> tuple[str, str, str]:
        """What its gyros are called."""
        p, q, r = (gyro_of(gyro, self.name) for gyro in GYROS)
        return p, q, r

    @property
    def columns(self) -> tuple[str, str, str]:
        """Which of its gyros, as the log names them, are about the aircraft's axes."""
        p, q, r = (gyro_of(GYROS[own], self.name) for own in self.mounting.taken)
        return p, q, r


def gyro_of(gyro: str, name: str) -> str:
    """Return what a gyro of a further IMU is called.

    >>> gyro_of("p", "IMU2"), gyro_and_imu("p of IMU2"), gyro_and_imu("p")
    ('p of IMU2', ('p', 'IMU2'), ('p', ''))
    """
    return f"{gyro}{_OF}{name}"


def rough_of(gyro: str) -> str:
    """Return what the logarithm of a further gyro's roughness is called."""
    return f"roughness of {gyro}"


def gyro_and_imu(sensor: str) -> tuple[str, str]:
    """Return which gyro a sensor is, and of which further IMU; "" of any other sensor."""
    gyro, _, name = sensor.partition(_OF)
    return gyro, name

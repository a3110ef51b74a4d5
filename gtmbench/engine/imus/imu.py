"""A further IMU in the blocks of a flight, turned into its body axes."""

from __future__ import annotations

from dataclasses import dataclass, field

from gtmbench.engine.imus.mounting import Mounting
from gtmbench.values.channels import GYROS
from gtmbench.values.record import FloatArray

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

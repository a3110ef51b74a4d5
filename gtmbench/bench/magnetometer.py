"""A magnetometer on a flight: the Earth's field in body axes, with iron, a motor's current, noise and its own rate."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gtmbench.bench.sensors import stream
from gtmbench.bench.slow_sensor import beside, check_beside, is_read
from gtmbench.checks import number, whole
from gtmbench.errors import InputError
from gtmbench.values.channels import ATTITUDE, MAGNETOMETER
from gtmbench.values.record import FloatArray, Record

_STRONGEST = 100.0  # times the field: no magnetometer in an aircraft reads more


@dataclass(frozen=True, kw_only=True)
class Magnetometer:
    """A magnetometer of three axes and the field that it is in.

    With R the rotation from north, east, down to body axes, S the soft iron, h the hard iron, c the field of one ampere
    and i(k) the current, it reads

        m(k) = (I + S) R(k) f + h + c i(k) + noise(k),   f = F (cos I cos D, cos I sin D, sin I).

    Attributes
    ----------
    strength_ut, inclination_deg, declination_deg : float
        F in microtesla, I (down positive) and D (east positive) of the Earth's field.
    hard_iron_ut : tuple of 3 floats
        h, in microtesla: what remains of it after calibration.
    soft_iron : float
        Size of S: its nine elements are drawn once, uniformly within this share.
    iron_seed : int or None
        By which they are drawn; None: by the seed of the noise. With a seed of its own it is one magnetometer on all of
        its flights.
    noise : float
        Standard deviation of the white noise of each axis, as a share of F.
    rate_hz : float
        How often it is read. Rows between two readings are missing (NaN).
    field_per_ampere_ut : tuple of 3 floats
        c, in microtesla per ampere.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.Magnetometer(inclination_deg=60.0).north_east_down_ut().round(1).tolist()
    [25.0, 0.0, 43.3]
    """

    strength_ut: float = 50.0
    inclination_deg: float = 65.0
    declination_deg: float = 0.0
    hard_iron_ut: tuple[float, float, float] = (0.0, 0.0, 0.0)
    soft_iron: float = 0.03
    iron_seed: int | None = None
    noise: float = 0.005
    rate_hz: float = 50.0
    field_per_ampere_ut: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        number("strength_ut", self.strength_ut, 0.0, 1e3, above=True)
        number("inclination_deg", self.inclination_deg, -90.0, 90.0)
        number("declination_deg", self.declination_deg, -180.0, 180.0)
        number("soft_iron", self.soft_iron, 0.0, 0.5)
        if self.iron_seed is not None:
            whole("iron_seed", self.iron_seed)
        number("noise", self.noise, 0.0, 1.0)
        number("rate_hz", self.rate_hz, 0.0, above=True)
        for name in ("hard_iron_ut", "field_per_ampere_ut"):
            given = getattr(self, name)
            if not isinstance(given, tuple) or len(given) != 3:
                raise InputError(f"{name} is {given!r}; give three numbers, for the axes x, y and z")
            for value in given:
                number(name, value, -_STRONGEST * self.strength_ut, _STRONGEST * self.strength_ut)

    def north_east_down_ut(self) -> FloatArray:
        """Return f, the Earth's field along north, east and down, in microtesla, shape (3,)."""
        dip, east = math.radians(self.inclination_deg), math.radians(self.declination_deg)
        along = [math.cos(dip) * math.cos(east), math.cos(dip) * math.sin(east), math.sin(dip)]
        return np.array([self.strength_ut * share for share in along])


def with_magnetometer(
    readings: Record,
    truth: Record,
    magnetometer: Magnetometer,
    *,
    seed: int = 1,
    current_a: Sequence[float] | None = None,
) -> Record:
    """Return sensor readings with three more channels, mag_x, mag_y, mag_z in microtesla: forward, right and down.

    The field is turned by the truth's attitude, so a fault of a gyro and an estimator's attitude leave it as it is.

    Parameters
    ----------
    readings : Record
        As `measure` returns them, broken or not.
    truth : Record
        The flight that they are of, row for row, with phi, theta and psi.
    magnetometer : Magnetometer
        Which one, in which field.
    seed : int
        Of its noise, and of its soft iron where `Magnetometer.iron_seed` is None.
    current_a : sequence of float, optional
        The motor's current in amperes, one value a row. By default there is none.

    Raises
    ------
    InputError
        If the records don't have the same rows, an attitude or current is missing, or the magnetometer is faster than
        the record.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.Record([[0.0, 0.0, 90.0]] * 4, channels=["phi", "theta", "psi"], sample_period_s=0.01)
    >>> perfect = gb.Magnetometer(inclination_deg=0.0, soft_iron=0.0, noise=0.0)  # north is left of a nose to the east
    >>> gb.with_magnetometer(truth, truth, perfect)["mag_y"].round(6).tolist()
    [-50.0, nan, -50.0, nan]
    """
    seed = whole("seed", seed)
    check_beside(readings, truth, MAGNETOMETER, "magnetometer")
    from scipy.spatial.transform import Rotation  # takes longer than all of ours

    attitude = truth.matrix(ATTITUDE)
    if not np.isfinite(attitude).all():
        raise InputError("the truth lacks phi, theta or psi in some rows; the field can't be turned there")
    rows = is_read(truth, magnetometer.rate_hz, "magnetometer")
    body = Rotation.from_euler("ZYX", attitude[:, ::-1], degrees=True).inv().apply(magnetometer.north_east_down_ut())
    drawn = stream(seed, "magnetometer")
    shape = drawn.uniform(-1.0, 1.0, (3, 3))  # drawn in any case: the noise after it is the same
    if magnetometer.iron_seed is not None:
        shape = stream(magnetometer.iron_seed, "magnetometer").uniform(-1.0, 1.0, (3, 3))
    iron = np.eye(3) + magnetometer.soft_iron * shape
    noise = magnetometer.noise * magnetometer.strength_ut * drawn.standard_normal(body.shape)
    field = body @ iron.T + np.array(magnetometer.hard_iron_ut) + noise
    if current_a is not None:
        current = np.asarray(current_a, dtype=np.float64)
        if current.shape != (len(truth),) or not np.isfinite(current).all():
            raise InputError(f"current_a needs one finite number for each of {len(truth)} rows")
        field += np.outer(current, magnetometer.field_per_ampere_ut)
    return beside(readings, MAGNETOMETER, field, rows)

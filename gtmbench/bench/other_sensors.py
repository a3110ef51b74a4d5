"""The sensors that a flight may have beside its own: a magnetometer and a GPS, simulated, as tables of a file state.

Both are read more slowly than a record has rows: rows between readings are NaN. A magnetometer reads the Earth's field
in body axes, with iron, a motor's current and noise; a GPS the velocity over ground, late, with noise that wanders.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import Any, TypeVar

import numpy as np

from gtmbench.bench.aircraft import SAMPLE_PERIOD_S
from gtmbench.bench.sensors import stream
from gtmbench.checks import keys, naming, number, table_of, whole
from gtmbench.errors import InputError
from gtmbench.values.attitude_estimators import filtered
from gtmbench.values.channels import ATTITUDE, GPS_VELOCITY, M_PER_FT, MAGNETOMETER
from gtmbench.values.record import BoolArray, FloatArray, Record, check_record, with_columns

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
    return _put_beside(readings, MAGNETOMETER, field, rows)


@dataclass(frozen=True, kw_only=True)
class Gps:
    """A receiver that reads its velocity over ground.

    With v the velocity along north, east and down, w white noise and c noise that wanders (Gauss-Markov), it reads

        g(k) = v(t(k) - delay) + w(k) + c(k),   E c(t) c(t + s) = wander^2 exp(-s / wander_time).

    Attributes
    ----------
    rate_hz : float
        How often it is read. Rows between two readings are missing (NaN).
    delay_s : float
        How late a reading is, in seconds, at most 2.
    noise_m_s : float
        Standard deviation of the white noise along each axis, in m/s.
    wander_m_s, wander_time_s : float
        Standard deviation of the noise that wanders, in m/s, and its correlation time in seconds.

    Raises
    ------
    InputError
        If a value is out of range.

    Examples
    --------
    >>> import gtmbench as gb
    >>> gb.Gps(rate_hz=10.0).delay_s
    0.15
    """

    rate_hz: float = 5.0
    delay_s: float = 0.15
    noise_m_s: float = 0.05
    wander_m_s: float = 0.1
    wander_time_s: float = 30.0

    def __post_init__(self) -> None:
        number("rate_hz", self.rate_hz, 0.0, above=True)
        number("delay_s", self.delay_s, 0.0, 2.0)
        number("noise_m_s", self.noise_m_s, 0.0, 1e3)
        number("wander_m_s", self.wander_m_s, 0.0, 1e3)
        number("wander_time_s", self.wander_time_s, 0.0, above=True)


def with_gps(readings: Record, truth: Record, gps: Gps, *, seed: int = 1) -> Record:
    """Return sensor readings with three more channels, gps_north, gps_east, gps_down in m/s.

    Parameters
    ----------
    readings : Record
        As `measure` returns them, broken or not.
    truth : Record
        The flight that they are of, row for row, with north, east and altitude.
    gps : Gps
        Which receiver.
    seed : int
        Of its noise.

    Raises
    ------
    InputError
        If the records don't have the same rows, a position is missing, or the receiver is faster than the record.

    Examples
    --------
    >>> import gtmbench as gb
    >>> truth = gb.Record([[3.0 * k, 0.0, 100.0] for k in range(6)], channels=["north", "east", "altitude"],
    ...     sample_period_s=0.1)  # 30 ft/s to the north
    >>> perfect = gb.Gps(delay_s=0.0, noise_m_s=0.0, wander_m_s=0.0)
    >>> gb.with_gps(truth, truth, perfect)["gps_north"].round(3).tolist()
    [9.144, nan, 9.144, nan, 9.144, nan]
    """
    seed = whole("seed", seed)
    check_beside(readings, truth, GPS_VELOCITY, "receiver")
    position = truth.matrix(("north", "east", "altitude"))
    if len(truth) < 2 or not np.isfinite(position).all():
        raise InputError("the truth lacks north, east or altitude in some rows, or has one row; a velocity needs two")
    rows, period_s = is_read(truth, gps.rate_hz, "receiver"), truth.sample_period_s
    velocity = np.gradient(position * [M_PER_FT, M_PER_FT, -M_PER_FT], period_s, axis=0)
    time_s = truth.time_s
    late = np.column_stack([np.interp(time_s - gps.delay_s, time_s, along) for along in velocity.T])
    read = late + _noise(gps, len(truth), period_s, seed)
    return _put_beside(readings, GPS_VELOCITY, read, rows)


def _noise(gps: Gps, rows: int, period_s: float, seed: int) -> FloatArray:
    """Return white noise and noise that wanders, shape (rows, 3)."""
    drawn = stream(seed, "gps velocity")
    white, driving = drawn.standard_normal((2, rows, 3))
    kept = np.exp(-period_s / gps.wander_time_s)
    driving[1:] *= np.sqrt(1.0 - kept**2)  # so that it wanders as far at its beginning as later
    wandering = filtered([1.0], [1.0, -kept], driving)
    return np.asarray(gps.noise_m_s * white + gps.wander_m_s * wandering)


def check_beside(readings: Record, truth: Record, channels: Sequence[str], sensor: str) -> None:
    """Refuse readings that aren't those of a flight, row for row, or that hold such a sensor already."""
    check_record(readings)
    check_record(truth)
    if len(readings) != len(truth) or readings.sample_period_s != truth.sample_period_s:
        raise InputError(
            f"the readings have {len(readings)} rows and the truth has {len(truth)}, or their rates differ; give the "
            f"flight that was measured"
        )
    if taken := [name for name in channels if name in readings]:
        raise InputError(f"the readings have {', '.join(taken)} already; a record holds one {sensor}")


def is_read(truth: Record, rate_hz: float, sensor: str) -> BoolArray:
    """Return the rows in which a sensor of some rate is read; refuse one that is faster than the record."""
    every = 1.0 / (rate_hz * truth.sample_period_s)
    if every < 1.0 - 1e-9:
        raise InputError(
            f"the {sensor} is read at {rate_hz:g} Hz, the record at {1.0 / truth.sample_period_s:g}; "
            f"give at most that rate_hz"
        )
    # the reading whose turn it is since the row before; the tolerance keeps 1/0.01 rows from being 99.999...
    turn = np.floor(np.arange(len(truth)) / every + 1e-6)
    return np.asarray(np.diff(turn, prepend=-1.0) != 0.0)


def _put_beside(readings: Record, channels: Sequence[str], values: FloatArray, rows: BoolArray) -> Record:
    """Return readings with a sensor's channels, whose values are there in some rows."""
    return with_columns(readings, channels, [np.where(rows[:, np.newaxis], values, np.nan)])


Sensor = TypeVar("Sensor", Gps, Magnetometer)
_LEFT_OUT = ("field_per_ampere_ut",)  # no file states a current


@dataclass(frozen=True, kw_only=True)
class OtherSensors:
    """A magnetometer and a GPS, or one of them, or none. One magnetometer flies all flights, with the same iron.

    >>> OtherSensors(gps=Gps()).channels
    ('gps_north', 'gps_east', 'gps_down')
    """

    magnetometer: Magnetometer | None = None
    gps: Gps | None = None

    def __post_init__(self) -> None:
        if self.magnetometer is not None and self.magnetometer.iron_seed is None:
            object.__setattr__(self, "magnetometer", replace(self.magnetometer, iron_seed=1))

    @property
    def channels(self) -> tuple[str, ...]:
        """What they read."""
        return (MAGNETOMETER if self.magnetometer else ()) + (GPS_VELOCITY if self.gps else ())

    @property
    def facts(self) -> dict[str, object]:
        """As plain values; a sensor that isn't there goes without saying."""
        return {name: asdict(each) for name, each in vars(self).items() if each is not None}

    def beside(self, readings: Record, truth: Record, seed: int) -> Record:
        """Return the readings of a flight's other sensors with these; the seed is of their noise."""
        if self.magnetometer is not None:
            readings = with_magnetometer(readings, truth, self.magnetometer, seed=seed)
        return readings if self.gps is None else with_gps(readings, truth, self.gps, seed=seed)

    def true(self, flight: Record) -> Record:
        """Return a flight's truth with what these would read in every row without noise and delay; iron is left."""
        at_once: dict[str, Any] = {"rate_hz": 1.0 / flight.sample_period_s}
        perfect = OtherSensors(
            magnetometer=self.magnetometer and replace(self.magnetometer, noise=0.0, **at_once),
            gps=self.gps and replace(self.gps, delay_s=0.0, noise_m_s=0.0, wander_m_s=0.0, **at_once),
        )
        return perfect.beside(flight, flight, seed=0)


def gps_of(key: str, value: Any) -> Gps:
    """Return the GPS of a file's table.

    >>> gps_of("gps", {"rate_hz": 10.0}).rate_hz
    10.0
    """
    return _sensor(Gps, key, value)


def magnetometer_of(key: str, value: Any) -> Magnetometer:
    """Return the magnetometer of a file's table.

    >>> magnetometer_of("magnetometer", {"hard_iron_ut": [1.0, 0.0, -2.0]}).hard_iron_ut
    (1.0, 0.0, -2.0)
    """
    return _sensor(Magnetometer, key, value)


def _sensor(of: type[Sensor], key: str, value: Any) -> Sensor:
    """Return the sensor of a table whose keys are as the class has them; lists are tuples."""
    known = [item.name for item in fields(of) if item.name not in _LEFT_OUT]
    table = keys(table_of(key, value), known, section=key)
    given: dict[str, Any] = {name: tuple(each) if isinstance(each, list) else each for name, each in table.items()}
    with naming(key):
        sensor = of(**given)
        number("rate_hz", sensor.rate_hz, 0.0, 1.0 / SAMPLE_PERIOD_S, above=True)
    return sensor

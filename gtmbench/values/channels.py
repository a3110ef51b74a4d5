"""The channel table: name, unit, JSBSim property and sensor noise of everything that is flown or measured.

Angles are in degrees and rates in deg/s at every public door. ``nx``, ``ny`` and ``nz`` are the specific force at the
centre of gravity in g, along forward, right and up: level flight reads nz = +1. ``psi`` is unwrapped: it runs through
360 deg and on. Surfaces are commands (where the servos are told to go), not positions: `ACTUAL` is where a broken one
was driven instead, in the truth of a flight with a fault of a surface.

Noise figures: standard deviations of NASA's T2 flight data (GTM_DesignSim, LAR-17625-1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import StrEnum
from typing import Any

from gtmbench.checks import meant, shown
from gtmbench.errors import InputError

G_M_S2 = 9.80665  # standard gravity, by definition: a specific force of 1 g
G_FT_S2, FT_S_PER_KT, M_PER_FT = 32.174, 1.68781, 0.3048  # gravity and a knot rounded; a foot by definition


class Role(StrEnum):
    """What a channel is to the aircraft."""

    SENSOR = "sensor"
    POSITION = "position"
    COMMAND = "command"


@dataclass(frozen=True, kw_only=True)
class Channel:
    """One row of the table.

    Attributes
    ----------
    name, unit, role, meaning
        ``name`` and ``unit`` as in records and messages.
    jsbsim : str
        The property read (or, for commands, written) at each step. For positions it is the speed, which the flight
        sums.
    scale : float
        Channel value = property value * scale.
    noise : float
        Standard deviation of the T2's sensor in ``unit``; 0 if there is no sensor.

    Examples
    --------
    >>> import gtmbench as gb
    >>> roll = gb.CHANNELS["p"]
    >>> roll.unit, roll.meaning, roll.header, roll.noise
    ('deg/s', 'roll rate', 'p_deg_s', 0.535)
    >>> [name for name, channel in gb.CHANNELS.items() if channel.unit == "g"]
    ['nx', 'ny', 'nz']
    """

    name: str
    unit: str
    role: Role
    meaning: str
    jsbsim: str
    scale: float = 1.0
    noise: float = 0.0

    @property
    def header(self) -> str:
        """The column name in a log: ``p_deg_s``, ``beta_deg``, ``throttle_percent``."""
        return f"{self.name}_{UNIT_SUFFIX[self.unit]}"


UNIT_SUFFIX = {"deg/s": "deg_s", "deg": "deg", "g": "g", "kt": "kt", "ft": "ft", "%": "percent"}

_DEG = math.degrees(1.0)  # of a radian
_KT_PER_FPS = 3600.0 * M_PER_FT / 1852.0  # by definition of foot and nautical mile


def _sensor(name: str, unit: str, noise: float, meaning: str, jsbsim: str, scale: float = 1.0) -> Channel:
    return Channel(name=name, unit=unit, role=Role.SENSOR, meaning=meaning, jsbsim=jsbsim, scale=scale, noise=noise)


def _command(name: str, unit: str, meaning: str, jsbsim: str) -> Channel:
    return Channel(name=name, unit=unit, role=Role.COMMAND, meaning=meaning, jsbsim=jsbsim)


_TABLE = (  # sensors: name, unit, the noise of the T2's, meaning, JSBSim's property and its factor
    _sensor("p", "deg/s", 0.535, "roll rate", "velocities/p-rad_sec", _DEG),
    _sensor("q", "deg/s", 0.474, "pitch rate", "velocities/q-rad_sec", _DEG),
    _sensor("r", "deg/s", 0.340, "yaw rate", "velocities/r-rad_sec", _DEG),
    _sensor("alpha", "deg", 0.031, "angle of attack", "aero/alpha-rad", _DEG),
    _sensor("beta", "deg", 0.033, "sideslip, nose left of the wind positive", "aero/beta-rad", _DEG),
    _sensor("phi", "deg", 0.02, "bank", "attitude/phi-rad", _DEG),
    _sensor("theta", "deg", 0.02, "pitch", "attitude/theta-rad", _DEG),
    _sensor("psi", "deg", 0.02, "heading, unwrapped", "attitude/psi-rad", _DEG),
    _sensor("nx", "g", 0.0012, "specific force at the CG, forward", "accelerations/Nx"),
    _sensor("ny", "g", 0.0022, "specific force at the CG, right", "accelerations/Ny"),
    _sensor("nz", "g", 0.0068, "specific force at the CG, up", "accelerations/Nz"),
    _sensor("tas", "kt", 0.06, "true airspeed", "velocities/vt-fps", _KT_PER_FPS),
    _sensor("altitude", "ft", 2.36, "altitude above sea level", "position/h-sl-ft"),
    Channel(
        name="north", unit="ft", role=Role.POSITION, meaning="distance flown north", jsbsim="velocities/v-north-fps"
    ),
    Channel(name="east", unit="ft", role=Role.POSITION, meaning="distance flown east", jsbsim="velocities/v-east-fps"),
    _command("elevator", "deg", "elevator command, trailing edge down positive", "fcs/elevator-cmd-deg"),
    _command("aileron", "deg", "aileron command: right one trailing edge down, left one up", "fcs/aileron-cmd-deg"),
    _command("rudder", "deg", "rudder command, trailing edge left positive", "fcs/rudder-cmd-deg"),
    _command("throttle", "%", "throttle command, both engines", "fcs/throttle-cmd-percent"),
)

CHANNELS: dict[str, Channel] = {channel.name: channel for channel in _TABLE}
SENSORS = tuple(channel.name for channel in _TABLE if channel.role is Role.SENSOR)
COMMANDS = tuple(channel.name for channel in _TABLE if channel.role is Role.COMMAND)
SURFACES = ("elevator", "aileron", "rudder")
ACTUAL = tuple(f"{name}_actual" for name in COMMANDS)  # where servos and engines were driven; never among the readings
GYROS, ATTITUDE, ACCELEROMETERS = ("p", "q", "r"), ("phi", "theta", "psi"), ("nx", "ny", "nz")  # about, along x, y, z
MAGNETOMETER = ("mag_x", "mag_y", "mag_z")  # the field in microtesla: forward, right, down
GPS_VELOCITY = ("gps_north", "gps_east", "gps_down")  # over ground, in m/s
OF_OWN_RATE = (*MAGNETOMETER, *GPS_VELOCITY)  # slower than most records, in which rows between readings are missing
# sensors of several channels, which fail, and are named, as one
WHOLE = {"magnetometer": MAGNETOMETER, "gps": GPS_VELOCITY, "accelerometers": ACCELEROMETERS}
_WHOLE_OF = {channel: sensor for sensor, channels in WHOLE.items() for channel in channels}
_UNITS_OF_OWN_RATE = dict.fromkeys(MAGNETOMETER, "uT") | dict.fromkeys(GPS_VELOCITY, "m/s")
# the greatest magnitude that a reading can have: several times what the widest instruments reach, so that a hardover, a
# saturated sensor or a bias of any size is inside; what a damaged cell holds is nearly always far outside
_LIMITS = dict.fromkeys(GYROS, 1e5) | dict.fromkeys(ACCELEROMETERS, 1e4)  # deg/s, g
_LIMITS |= {"psi": 1e7, "tas": 1e5, "altitude": 1e7} | dict.fromkeys(("phi", "theta", "alpha", "beta"), 1e5)
_LIMITS |= dict.fromkeys(MAGNETOMETER, 1e5) | dict.fromkeys(GPS_VELOCITY, 1e5) | dict.fromkeys(COMMANDS, 1e5)
LEAST_LIMIT = min(_LIMITS.values())
_ANY = 1e100  # of a channel that the table doesn't know
_AXES = {name: axis for axis in zip(GYROS, ATTITUDE, strict=True) for name in axis}

CHANNEL_OF_HEADER = {channel.header: channel.name for channel in _TABLE}
# how logs write units; "p_rad_s" is channel p in another unit, "p_2" is somebody's second gyro
_FOREIGN_UNITS = {"rad", "rad_s", "dps", "rps", "m", "m_s", "m_s2", "mps", "ft_s", "fps", "kts", "mg", "norm"}


def axis_of(name: str) -> tuple[str, ...]:
    """Return the sensors of a channel's axis: a gyro and the angle that it turns; any other sensor is one of its own.

    >>> axis_of("theta"), axis_of("beta")
    (('q', 'theta'), ('beta',))
    """
    return _AXES.get(name, (name,))


def names_of(channel: str) -> tuple[str, ...]:
    """Return the names by which a channel's sensor may be called: its own, and that of the sensor it is a part of.

    >>> names_of("gps_down"), names_of("p")
    (('gps_down', 'gps'), ('p',))
    """
    return (channel, _WHOLE_OF[channel]) if channel in _WHOLE_OF else (channel,)


def unit_of(name: str) -> str:
    """Return the unit of a channel, or of a sensor's channels; "" for one that the table doesn't know.

    >>> unit_of("p"), unit_of("gps"), unit_of("strain_3")
    ('deg/s', 'm/s', '')
    """
    name = WHOLE.get(name, (name,))[0]
    return CHANNELS[name].unit if name in CHANNELS else _UNITS_OF_OWN_RATE.get(name, "")


def limit_of(name: str) -> float:
    """Return the greatest magnitude that a reading of a channel can have, in its unit; one of an IMU by its gyro.

    >>> limit_of("q"), limit_of("q of IMU2"), limit_of("strain_3")
    (100000.0, 100000.0, 1e+100)
    """
    return _LIMITS.get(name.partition(" of ")[0], _ANY)


def header_of(name: str) -> str:
    """Return the log column of a channel; a channel that the table doesn't know goes by its own name."""
    return CHANNELS[name].header if name in CHANNELS else name


def channel_of(header: str) -> str:
    """Return the channel of a log column, the inverse of `header_of`."""
    if header in CHANNEL_OF_HEADER:
        return CHANNEL_OF_HEADER[header]
    base, _, unit = header.partition("_")
    if base in CHANNELS and (not unit or unit in _FOREIGN_UNITS or unit in UNIT_SUFFIX.values()):
        known = CHANNELS[base]
        said = "isn't in this package's unit" if unit else "doesn't state its unit"
        raise InputError(
            f"column '{header}' {said}: channel '{base}' is in {known.unit}; convert it and name it '{known.header}'"
        )
    return header


def sensor_list(key: str, value: Any) -> tuple[str, ...]:
    """Return a list of sensor channels, each named once, or say what is wrong with what stands under `key`.

    >>> sensor_list("inputs", ["p", "beta"])
    ('p', 'beta')
    """
    return _listed(key, value, SENSORS, "no sensor channel")


def breakable_list(key: str, value: Any, beside: tuple[str, ...] = ()) -> tuple[str, ...]:
    """Return a list of channels that can break, sensors, surfaces and the throttle, as `sensor_list` does of sensors.

    >>> breakable_list("channels", ["q", "elevator"]), breakable_list("channels", ["mag_x"], beside=OF_OWN_RATE)
    (('q', 'elevator'), ('mag_x',))
    """
    return _listed(key, value, (*SENSORS, *COMMANDS, *beside), "no channel that can break is")


def _listed(key: str, value: Any, known: tuple[str, ...], refused: str) -> tuple[str, ...]:
    if not isinstance(value, list) or not value or not all(isinstance(name, str) for name in value):
        raise InputError(f"{key} is {shown(value)}; it must be a list of channel names")
    for name in value:
        if name not in known:
            raise InputError(f"{key}: {refused} {shown(name)}; there are {', '.join(known)}{meant(name, known)}")
        if value.count(name) > 1:
            raise InputError(f"{key}: '{name}' stands there twice; name every channel once")
    return tuple(value)

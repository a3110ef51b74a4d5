"""ROS's ``sensor_msgs/Imu``: its fields in MCAP's ROS 2 encoding (CDR), and what they are in aircraft axes.

REP 103: a body's x points forward, y left and z up; the world's x points east, y north and z up. So q, r and pitch turn
the other way than an aircraft's, and the heading is counted from north.
"""

from __future__ import annotations

import struct
from collections.abc import Container

from gtmbench.intake.formats.raw import Meaning

SCHEMAS = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
MEANINGS = {
    "angular_velocity.x": Meaning(channel="p", unit="rad/s"),
    "angular_velocity.y": Meaning(channel="q", unit="rad/s", sign=-1.0),
    "angular_velocity.z": Meaning(channel="r", unit="rad/s", sign=-1.0),
    "linear_acceleration.x": Meaning(channel="nx", unit="m/s2"),
    "linear_acceleration.y": Meaning(channel="ny", unit="m/s2", sign=-1.0),
    "linear_acceleration.z": Meaning(channel="nz", unit="m/s2"),
}
# of the angles that make the orientation; yaw is counted from east, and 90 deg are taken off where it is read
ANGLES = {
    "roll": Meaning(channel="phi", unit="deg"),
    "pitch": Meaning(channel="theta", unit="deg", sign=-1.0),
    "yaw": Meaning(channel="psi", unit="deg", sign=-1.0),
}
_ORIENTATION = tuple(f"orientation.{axis}" for axis in "xyzw")
_ANGULAR = tuple(f"angular_velocity.{axis}" for axis in "xyz")
_LINEAR = tuple(f"linear_acceleration.{axis}" for axis in "xyz")
SEC, NANOSEC = "header.stamp.sec", "header.stamp.nanosec"


def is_oriented(columns: Container[str]) -> bool:
    """Tell whether there is an orientation among the columns."""
    return all(name in columns for name in _ORIENTATION)


def decode_imu(data: bytes) -> dict[str, float]:
    """Return the numbers of a message, covariances left out.

    Raises
    ------
    ValueError, struct.error
        Where it isn't one.
    """
    if len(data) < 4 or data[0] != 0 or data[1] > 1:
        raise ValueError("no plain CDR")
    order = "<" if data[1] else ">"
    body = data[4:]
    sec, nanosec, length = struct.unpack_from(f"{order}iII", body)
    place = -(-(12 + length) // 8) * 8  # doubles stand at multiples of eight
    orientation = struct.unpack_from(f"{order}4d", body, place)
    angular = struct.unpack_from(f"{order}3d", body, place + 8 * (4 + 9))
    linear = struct.unpack_from(f"{order}3d", body, place + 8 * (4 + 9 + 3 + 9))
    names = (SEC, NANOSEC, *_ORIENTATION, *_ANGULAR, *_LINEAR)
    return dict(zip(names, (sec, nanosec, *orientation, *angular, *linear), strict=True))

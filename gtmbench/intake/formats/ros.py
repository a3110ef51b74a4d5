"""What ROS's messages mean, by whatever container they come: of ``sensor_msgs/Imu`` the channels in aircraft axes.

REP 103: a body's x points forward, y left and z up; the world's x points east, y north and z up. So q, r and pitch turn
the other way than an aircraft's, and the heading is counted from north.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.formats.raw import Meaning, RawSeries, euler_deg

IMU_SCHEMAS = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
NOTE = "sensor_msgs/Imu: units and axes of REP 103 (forward, left, up), turned to forward, right, down"
_MEANINGS = {
    "angular_velocity.x": Meaning(channel="p", unit="rad/s"),
    "angular_velocity.y": Meaning(channel="q", unit="rad/s", sign=-1.0),
    "angular_velocity.z": Meaning(channel="r", unit="rad/s", sign=-1.0),
    "linear_acceleration.x": Meaning(channel="nx", unit="m/s2"),
    "linear_acceleration.y": Meaning(channel="ny", unit="m/s2", sign=-1.0),
    "linear_acceleration.z": Meaning(channel="nz", unit="m/s2"),
}
# of the angles that make the orientation: yaw is counted from east, and 90 deg are taken off where it is read
_ANGLES = {
    "roll": Meaning(channel="phi", unit="deg"),
    "pitch": Meaning(channel="theta", unit="deg", sign=-1.0),
    "yaw": Meaning(channel="psi", unit="deg", sign=-1.0),
}
ORIENTATION = tuple(f"orientation.{axis}" for axis in "xyzw")
Load = Callable[[], NDArray[np.float64]]


def topic_series(topic: str, columns: Mapping[str, Load], *, is_imu: bool) -> list[RawSeries]:
    """Return a topic's columns; of an Imu's with what they mean, and the angles of its orientation."""
    series = [
        RawSeries(name=f"{topic}.{field}", load=load, clock=topic, meaning=_MEANINGS.get(field) if is_imu else None)
        for field, load in columns.items()
        if not field.startswith("header.stamp.")
    ]
    if is_imu and set(ORIENTATION) <= set(columns):
        series += [_angle(topic, columns, angle, meaning) for angle, meaning in _ANGLES.items()]
    return series


def _angle(topic: str, columns: Mapping[str, Load], angle: str, meaning: Meaning) -> RawSeries:
    def load() -> NDArray[np.float64]:
        turned = euler_deg([columns[f"orientation.{part}"]() for part in "wxyz"], angle)
        return turned - 90.0 if angle == "yaw" else turned

    return RawSeries(name=f"{topic}.orientation({angle})", load=load, clock=topic, meaning=meaning)

"""What ROS's messages mean, by whatever container they come: of ``sensor_msgs/Imu`` the channels in aircraft axes."""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np
from numpy.typing import NDArray

from gtmbench.intake.formats.dialects import lines_of, meant
from gtmbench.intake.formats.raw import RawSeries

IMU_SCHEMAS = ("sensor_msgs/msg/Imu", "sensor_msgs/Imu")
NOTE = "sensor_msgs/Imu: units and axes of REP 103 (forward, left, up), turned to forward, right, down"
ORIENTATION = tuple(f"orientation.{axis}" for axis in "xyzw")
Load = Callable[[], NDArray[np.float64]]


def topic_series(topic: str, columns: Mapping[str, Load], *, is_imu: bool) -> list[RawSeries]:
    """Return a topic's columns; of an Imu's with what they mean, and the angles of its orientation."""
    series = [
        RawSeries(name=f"{topic}.{field}", load=load, clock=topic)
        for field, load in columns.items()
        if not field.startswith("header.stamp.")
    ]
    return [*meant(series, lines_of("ROS"))] if is_imu else series

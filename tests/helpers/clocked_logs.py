"""One flight as logs whose channels have clocks of their own, in every format: some messages may be left out."""

from dataclasses import dataclass

import numpy as np
import pandas as pd

import gtmbench as gb
from tests.helpers import intake_files as files
from tests.helpers.log_makers import quaternions
from tests.helpers.monitors import record

G = 9.80665
GYRO, ATTITUDE, ACCELERATION = ("p", "q", "r"), ("phi", "theta", "psi"), ("nx", "ny", "nz")


@dataclass(frozen=True, kw_only=True)
class Message:
    """What comes at once, again and again."""

    channels: tuple
    time_s: np.ndarray
    values: np.ndarray

    def without(self, *spans):
        kept = np.ones(len(self.time_s), dtype=bool)
        for start_s, end_s in spans:
            kept &= (self.time_s < start_s) | (self.time_s >= end_s)
        return Message(channels=self.channels, time_s=self.time_s[kept], values=self.values[kept])


def messages(duration_s=40.0, gyro_hz=100, attitude_hz=50, seed=11, broken=lambda record: record):
    """Return gyro, attitude and acceleration as messages, each at a rate and with stamps of its own."""

    def of(channels, hz, late_s):
        flight = record(round(duration_s * hz), seed=seed, period_s=1 / hz)
        still = np.column_stack([flight.values, np.zeros(len(flight))])
        flight = broken(gb.Record(still, channels=[*flight.channels, "nx"], sample_period_s=1 / hz))
        return Message(channels=channels, time_s=late_s + flight.time_s, values=flight.matrix(channels))

    return {
        "gyro": of(GYRO, gyro_hz, 0.0),
        "attitude": of(ATTITUDE, attitude_hz, 0.003),
        "acceleration": of(ACCELERATION, gyro_hz, 0.0),
    }


def without(sent, name, *spans):
    return {**sent, name: sent[name].without(*spans)}


def _us(message):
    return np.round(message.time_s * 1e6).astype(int)


def _down(message):
    return G * message.values * [1.0, 1.0, -1.0]


def _ulog(sent, path):
    gyro, attitude, acceleration = sent.values()
    topics = {
        "vehicle_angular_velocity": (["float[3] xyz"], np.column_stack([_us(gyro), np.radians(gyro.values)])),
        "vehicle_attitude": (["float[4] q"], np.column_stack([_us(attitude), quaternions(attitude.values)])),
        "vehicle_acceleration": (["float[3] xyz"], np.column_stack([_us(acceleration), _down(acceleration)])),
    }
    path.write_bytes(files.ulog(topics))


def _tables(sent):
    """Return gyros and accelerometers in one message, as ArduPilot has them."""
    gyro, attitude, acceleration = sent.values()
    there = np.isin(_us(acceleration), _us(gyro))
    imu = np.column_stack([np.radians(gyro.values), _down(acceleration)[there]])

    def rows(message, values):
        return [(t, *row) for t, row in zip(_us(message).tolist(), values.tolist(), strict=True)]

    return {
        "IMU": ("Qffffff", "TimeUS,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", rows(gyro, imu)),
        "ATT": ("Qfff", "TimeUS,Roll,Pitch,Yaw", rows(attitude, attitude.values)),
    }


def _dataflash(sent, path):
    path.write_bytes(files.dataflash(_tables(sent), units={"IMU": ("sEEEooo", "F000000"), "ATT": ("sddd", "F000")}))


def _dataflash_text(sent, path):
    path.write_bytes(files.dataflash_text(_tables(sent)))


def _mcap_json(sent, path):
    def told(message):
        headers = [gb.CHANNELS[name].header for name in message.channels]
        return [
            (int(t) * 1000, dict(zip(headers, row, strict=True)))
            for t, row in zip(_us(message), message.values.tolist(), strict=True)
        ]

    files.mcap(path, {f"/{name}": told(message) for name, message in sent.items()})


def _mcap_ros(sent, path):
    """ROS looks forward, left and up, and east, north and up; the IMU's attitude isn't the one that is mapped."""
    gyro, attitude, acceleration = sent.values()
    there = np.isin(_us(acceleration), _us(gyro))
    accelerations = _down(acceleration)[there] * [1, -1, -1]
    quats = quaternions(attitude.values * [1, -1, -1] + [0, 0, 90])[:, [1, 2, 3, 0]]
    nothing, up = np.zeros(3), np.array([0.0, 0.0, 0.0, 1.0])
    columns = zip(_us(gyro), np.radians(gyro.values) * [1, -1, -1], accelerations, strict=True)
    imu = [(int(t) * 1000, files.cdr_imu(int(t) * 1000, rates, felt, up)) for t, rates, felt in columns]
    columns = zip(_us(attitude), quats, strict=True)
    filtered = [(int(t) * 1000, files.cdr_imu(int(t) * 1000, nothing, nothing, quat)) for t, quat in columns]
    files.mcap(path, {"/imu": imu, "/filter": filtered}, schema="sensor_msgs/msg/Imu", encoding="cdr")


def _frame(sent):
    """Return a table of every stamp there is; cells are empty where a message wasn't sent."""
    frames = [
        pd.DataFrame(
            message.values, index=_us(message), columns=[gb.CHANNELS[name].header for name in message.channels]
        )
        for message in sent.values()
    ]
    table = pd.concat(frames, axis=1).sort_index()
    table.index = pd.Index(table.index / 1e6, name="time_s")
    return table.reset_index()


def _csv(sent, path):
    _frame(sent).to_csv(path, index=False)


def _parquet(sent, path):
    _frame(sent).to_parquet(path)


ROS = [
    *(f"{name}=/imu.angular_velocity.{axis}" for name, axis in zip(GYRO, "xyz", strict=True)),
    *(f"{name}=/imu.linear_acceleration.{axis}" for name, axis in zip(ACCELERATION, "xyz", strict=True)),
    *(f"{name}=/filter.orientation({angle})" for name, angle in zip(ATTITUDE, ("roll", "pitch", "yaw"), strict=True)),
]
FORMATS = {
    "log.ulg": (_ulog, ()),
    "log.bin": (_dataflash, ()),
    "log.log": (_dataflash_text, ()),
    "json.mcap": (_mcap_json, ()),
    "ros.mcap": (_mcap_ros, ROS),
    "log.csv": (_csv, ()),
    "log.parquet": (_parquet, ()),
}


def write(name, sent, folder):
    """Write a log and return its path, and what has to be mapped."""
    writer, mapping = FORMATS[name]
    writer(sent, folder / name)
    return folder / name, mapping

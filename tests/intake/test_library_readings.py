"""Every format's values are those that its own library reads, bit for bit."""

import csv
import gzip
import io
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from gtmbench.intake.formats.registry import read_raw
from tests.helpers import log_makers as makers
from tests.helpers.night import by_day


def telemetry(path):
    from pymavlink import mavutil

    link = mavutil.mavlink_connection(str(path))
    speeds = [message.rollspeed for message in iter(lambda: link.recv_match(type="ATTITUDE"), None)]
    link.close()
    return {"ATTITUDE.rollspeed": speeds}


def bag(path):
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    store = Stores.ROS1_NOETIC if path.suffix == ".bag" else Stores.ROS2_HUMBLE
    with AnyReader([path], default_typestore=get_typestore(store)) as reader:
        read = [reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages()]
    return {
        "/imu/data.angular_velocity.y": [message.angular_velocity.y for message in read],
        "/imu/data.orientation.w": [message.orientation.w for message in read],
    }


def matlab(path):
    from scipy.io import loadmat

    flight = loadmat(path, squeeze_me=True, struct_as_record=False)["flight"]
    return {"flight.imu.gyro_rad_s[1]": flight.imu.gyro_rad_s[:, 1], "flight.ahrs.time": flight.ahrs.time}


def hdf5(path):
    import h5py

    with h5py.File(path) as file:
        return {
            "flight.imu.gyro_rad_s[1]": file["flight/imu/gyro_rad_s"][1],
            "flight.ahrs.time": file["flight/ahrs/time"][0],
        }


def archive(path):
    with np.load(path) as arrays:
        return dict(arrays)


def book(path):
    return dict(pd.read_excel(path, sheet_name="log", engine="openpyxl"))


def table(path):
    """By Python itself: a float's shortest decimals are that float."""
    text = path.read_text() if isinstance(path, Path) else io.TextIOWrapper(path).read()
    header, *rows = csv.reader(text.splitlines())
    return {name: [float(row[place]) for row in rows] for place, name in enumerate(header)}


def gzipped_table(path):
    with gzip.open(path) as file:
        return table(file)


def packed_table(path):
    with zipfile.ZipFile(path) as inside, inside.open("flight/log.csv") as file:
        return table(file)


def tables(path):
    rates = table(path / "log_7_vehicle_angular_velocity_0.csv")
    return {f"vehicle_angular_velocity.{name}": values for name, values in rates.items() if name != "timestamp"}


READINGS = {
    "flight.tlog": telemetry,
    "flight.bag": bag,
    "bag2": bag,
    "flight.mat": matlab,
    "flight73.mat": hdf5,
    "flight.npz": archive,
    "flight.xlsx": book,
    "flight.csv.gz": gzipped_table,
    "flight.zip": packed_table,
    "tables": tables,
}


@pytest.mark.parametrize("name", by_day(makers.MAKERS, 3))
def test_values_are_those_that_the_formats_library_reads(tmp_path, name):
    path = makers.make(tmp_path, name)
    ours = {series.name: np.asarray(series.load()) for series in read_raw(path).series}
    expected = READINGS[name](path)
    assert expected
    for column, values in expected.items():
        assert np.array_equal(ours[column], np.asarray(values)), column

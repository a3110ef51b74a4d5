"""One flight in every format that is read, written by each format's own library: what a logger would have left."""

import gzip
import struct
import zipfile
from pathlib import Path

import numpy as np
import pandas as pd

RATE_HZ = 50.0
EPOCH_NS = 1_714_564_800_000_000_000
RAD = np.pi / 180.0


def flight(seconds=20.0):
    """Return a table of a motion whose rates and angles agree: p, q, r in deg/s, phi, theta, psi in deg, at 50 Hz."""
    time_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    phi, theta, psi = (
        amplitude * np.sin(2 * np.pi * hertz * time_s + phase)
        for amplitude, hertz, phase in ((20.0, 0.31, 0.0), (8.0, 0.23, 1.0), (30.0, 0.13, 2.0))
    )
    rates = [np.gradient(angle, time_s) for angle in (phi, theta, psi)]
    f, t = phi * RAD, theta * RAD
    return pd.DataFrame(
        {
            "time_s": time_s,
            "p": rates[0] - rates[2] * np.sin(t),
            "q": rates[1] * np.cos(f) + rates[2] * np.cos(t) * np.sin(f),
            "r": rates[2] * np.cos(t) * np.cos(f) - rates[1] * np.sin(f),
            "phi": phi,
            "theta": theta,
            "psi": psi,
        }
    )


def telemetry(path, table, system=1, autopilot=3):
    """A .tlog as a ground station writes it, by pymavlink's own packing."""
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=1)
    with Path(path).open("ab") as file:

        def send(time_s, message):
            file.write(struct.pack(">Q", round((EPOCH_NS / 1e9 + time_s) * 1e6)) + message.pack(mav))

        send(0.0, mavlink.MAVLink_heartbeat_message(2, autopilot, 0, 0, 4, 3))
        for row in table.itertuples():
            boot_ms = round(1000 * row.time_s) + 5000
            angles = [RAD * value for value in (row.phi, row.theta, row.psi, row.p, row.q, row.r)]
            send(row.time_s + 0.03, mavlink.MAVLink_attitude_message(boot_ms, *angles))


def quaternions(angles_deg):
    """Return w, x, y, z of rows of roll, pitch and yaw."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(np.radians(angles_deg.T) / 2), np.sin(np.radians(angles_deg.T) / 2)
    w, x = cr * cp * cy + sr * sp * sy, sr * cp * cy - cr * sp * sy
    return np.column_stack([w, x, cr * sp * cy + sr * cp * sy, cr * cp * sy - sr * sp * cy])


def _quaternion(table):
    """Return x, y, z, w of the attitude by REP 103: the body forward, left, up; the world east, north, up."""
    return quaternions(np.column_stack([table.phi, -table.theta, 90.0 - table.psi]))[:, [1, 2, 3, 0]]


def bag(path, table, *, topic="/imu/data"):
    """A bag of sensor_msgs/Imu: ROS 1's where the path ends in .bag, else ROS 2's folder."""
    from rosbags.rosbag1 import Writer as Writer1
    from rosbags.rosbag2 import Writer as Writer2
    from rosbags.typesys import Stores, get_typestore

    path = Path(path)
    is_first = path.suffix == ".bag"
    store = get_typestore(Stores.ROS1_NOETIC if is_first else Stores.ROS2_HUMBLE)
    types = store.types
    imu, header, time = (
        types[name] for name in ("sensor_msgs/msg/Imu", "std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    quaternion, vector = types["geometry_msgs/msg/Quaternion"], types["geometry_msgs/msg/Vector3"]
    nothing = np.zeros(9)
    writer = Writer1(path) if is_first else Writer2(path, version=9)
    with writer:
        connection = writer.add_connection(topic, imu.__msgtype__, typestore=store)
        for number, (row, turned) in enumerate(zip(table.itertuples(), _quaternion(table), strict=True)):
            stamp_ns = EPOCH_NS + round(row.time_s * 1e9)
            stamp = time(sec=stamp_ns // 10**9, nanosec=stamp_ns % 10**9)
            own = {"seq": number} if is_first else {}
            message = imu(
                header=header(stamp=stamp, frame_id="imu", **own),
                orientation=quaternion(*map(float, turned)),
                orientation_covariance=nothing,
                angular_velocity=vector(row.p * RAD, -row.q * RAD, -row.r * RAD),
                angular_velocity_covariance=nothing,
                linear_acceleration=vector(0.0, 0.0, 9.8),
                linear_acceleration_covariance=nothing,
            )
            packed = (store.serialize_ros1 if is_first else store.serialize_cdr)(message, imu.__msgtype__)
            writer.write(connection, stamp_ns + 1_000_000, packed)


def matlab(path, table):
    """A .mat of version 7 with structs in structs, as ``save -v7`` writes it."""
    from scipy.io import savemat

    imu = {"time": table.time_s.to_numpy(), "gyro_rad_s": table[["p", "q", "r"]].to_numpy() * RAD}
    ahrs = {"time": table.time_s.to_numpy(), "euler_deg": table[["phi", "theta", "psi"]].to_numpy()}
    savemat(path, {"flight": {"imu": imu, "ahrs": ahrs, "pilot": "somebody"}, "fs": RATE_HZ})


def matlab_hdf5(path, table):
    """The same as ``save -v7.3`` writes it: HDF5 behind 512 bytes, columns as rows."""
    import h5py

    head = b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\x00\x02IM"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, field, columns, factor in (
            ("imu", "gyro_rad_s", ["p", "q", "r"], RAD),
            ("ahrs", "euler_deg", ["phi", "theta", "psi"], 1.0),
        ):
            group = file.require_group(f"flight/{name}")
            group.attrs["MATLAB_class"] = np.bytes_("struct")
            for key, values in (
                ("time", table.time_s.to_numpy()[np.newaxis]),
                (field, factor * table[columns].to_numpy().T),
            ):
                group.create_dataset(key, data=values).attrs["MATLAB_class"] = np.bytes_("double")
    with Path(path).open("r+b") as file:
        file.write(head)


def columns(table):
    """Return a table as most people log it: gyros in rad/s, angles in deg, no unit said but in the names."""
    return pd.DataFrame(
        {
            "timestamp_ms": 1000.0 * table.time_s,
            **{f"gyro_{axis}_rad_s": RAD * table[name] for axis, name in zip("xyz", "pqr", strict=True)},
            "roll_deg": table.phi,
            "pitch_deg": table.theta,
            "yaw_deg": table.psi,
        }
    )


def numpy_archive(path, table):
    np.savez_compressed(path, **{name: column.to_numpy() for name, column in columns(table).items()})


def excel(path, table):
    with pd.ExcelWriter(path, engine="openpyxl") as book:
        columns(table).to_excel(book, sheet_name="log", index=False)
        pd.DataFrame({"note": ["one flight"]}).to_excel(book, sheet_name="notes", index=False)


def csv_gz(path, table):
    with gzip.open(path, "wt") as file:
        file.write(columns(table).to_csv(index=False))


def zipped(path, table):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("README.txt", "a log")
        archive.writestr("flight/log.csv", columns(table).to_csv(index=False))


def folder(path, table):
    """A folder as ulog2csv writes it: a table a topic, each with its own time."""
    path = Path(path)
    path.mkdir()
    stamps = (1e6 * table.time_s + 7e6).round().astype(np.int64)
    turned = quaternions(table[["phi", "theta", "psi"]].to_numpy()).T
    pd.DataFrame({"timestamp": stamps, **{f"q[{i}]": part for i, part in enumerate(turned)}}).to_csv(
        path / "log_7_vehicle_attitude_0.csv", index=False
    )
    rates = {f"xyz[{i}]": RAD * table[name] for i, name in enumerate("pqr")}
    pd.DataFrame({"timestamp": stamps, **rates}).to_csv(path / "log_7_vehicle_angular_velocity_0.csv", index=False)


MAKERS = {
    "flight.tlog": telemetry,
    "flight.bag": bag,
    "bag2": bag,
    "flight.mat": matlab,
    "flight73.mat": matlab_hdf5,
    "flight.npz": numpy_archive,
    "flight.xlsx": excel,
    "flight.csv.gz": csv_gz,
    "flight.zip": zipped,
    "tables": folder,
}


def make(folder, name, table=None):
    """Write a flight in a format; return where."""
    path = Path(folder, name)
    MAKERS[name](path, flight() if table is None else table)
    return path

"""Tables as people have them: PX4's since a boot long ago, sensors beside gyros, flight tests' names, clocks apart."""

import zipfile

import numpy as np
import pandas as pd
import pytest
from scipy.io import savemat

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.intake.other_sensors import other_sensors_of
from gtmbench.intake.read import read_log
from gtmbench.values.channels import MAGNETOMETER
from tests.helpers.log_makers import flight, make
from tests.helpers.turning import quaternions

CHANNELS = ("p", "q", "r", "phi", "theta", "psi")


@pytest.mark.parametrize("booted_s", [3.0, 700.0, 1500.0, 2500.0, 9000.0])
def test_tables_of_px4_open_however_long_ago_it_booted(tmp_path, booted_s):
    """Between 10 and 42 minutes after a boot its microseconds look like a date in seconds."""
    usual, late = flight(), flight()
    late["time_s"] = late.time_s + booted_s
    (tmp_path / "late").mkdir()
    first = gb.open_log(make(tmp_path, "tables", usual), needs=CHANNELS)
    other = gb.open_log(make(tmp_path / "late", "tables", late), needs=CHANNELS)
    assert other.segments[0].start_s - first.segments[0].start_s == pytest.approx(booted_s, abs=1e-6)
    assert other.segments[0].matrix(CHANNELS) == pytest.approx(first.segments[0].matrix(CHANNELS), abs=1e-6)


def test_sensors_beside_gyros_are_read_of_a_folder_too(tmp_path):
    folder = make(tmp_path, "tables")
    stamps = (7e6 + 1e5 * np.arange(100)).astype(np.int64)
    rng = np.random.default_rng(1)
    field = {f"magnetometer_ga[{axis}]": rng.standard_normal(100) for axis in range(3)}
    pd.DataFrame({"timestamp": stamps, **field}).to_csv(folder / "log_7_vehicle_magnetometer_0.csv", index=False)
    velocity = {name: rng.standard_normal(100) for name in ("vel_n_m_s", "vel_e_m_s", "vel_d_m_s")}
    pd.DataFrame({"timestamp": stamps, "fix_type": 3, **velocity}).to_csv(
        folder / "log_7_vehicle_gps_position_0.csv", index=False
    )
    (readings,) = (each for each in other_sensors_of(read_log(folder)) if each.channels == MAGNETOMETER)
    assert readings.values == pytest.approx(np.column_stack(list(field.values())))
    gps = next(each for each in other_sensors_of(read_log(folder)) if each.channels[0] == "gps_north")
    assert gps.values == pytest.approx(np.column_stack(list(velocity.values())))


def test_a_flight_tests_table_opens_whatever_its_rates_are_called(tmp_path):
    table = flight()
    names = {"p": "PRGX [DEG/S]", "q": "QRGY [DEG/S]", "r": "RRGZ [DEG/S]"}
    angles = {"phi": "PHI [DEG]", "theta": "THE [DEG]", "psi": "PSI [DEG]"}
    headers = {"time_s": "T [s]", **names, **angles}
    path = tmp_path / "test.csv"
    pd.DataFrame({header: table[name] for name, header in headers.items()}).to_csv(path, index=False)
    log = gb.open_log(path, needs=CHANNELS)
    read = {source.channel: source.column for source in log.sources}
    assert {channel: read[channel] for channel in (*names, *angles)} == {**names, **angles}


def test_rates_of_px4s_attitude_topic_and_a_time_that_states_its_unit_need_no_map(tmp_path):
    """Until 2018 PX4's tables of attitude held rates, too; some flight stacks write a current time."""
    log, px4, table = flight(), tmp_path / "log_7_vehicle_attitude_0.csv", tmp_path / "stack.csv"
    rates = {name: np.deg2rad(log[of]) for name, of in zip(("rollspeed", "pitchspeed", "yawspeed"), "pqr", strict=True)}
    stamps = (1e6 * (1.0 + log.time_s)).astype(np.int64)
    q = {f"q[{axis}]": each for axis, each in enumerate(quaternions(log[["phi", "theta", "psi"]].to_numpy()).T)}
    pd.DataFrame({"timestamp": stamps, **rates, **q}).to_csv(px4, index=False)
    pd.DataFrame({"Current time [s]": log.time_s, **{f"{name} [deg/s]": log[name] for name in "pqr"}}).to_csv(
        table, index=False
    )
    read = gb.open_log(tmp_path / px4.name, needs=CHANNELS).segments[0]
    assert read.matrix("pqr") == pytest.approx(log[list("pqr")].to_numpy(), abs=1e-3)
    assert gb.open_log(table, needs=("p", "q", "r")).segments[0].matrix("pqr") == pytest.approx(
        log[list("pqr")].to_numpy(), abs=1e-9
    )


def two_tables(folder, attitude_ms, imu_us):
    """Write MAVLink's messages as two tables, with stamps in milliseconds and in microseconds since boot."""
    table = flight()
    folder.mkdir()
    angles = {"roll": table.phi, "pitch": table.theta, "yaw": table.psi}
    attitude = {name: np.radians(values) for name, values in angles.items()}
    pd.DataFrame({"time_boot_ms": attitude_ms(table.time_s), **attitude}).to_csv(folder / "ATTITUDE.csv", index=False)
    rates = {f"{axis}gyro": np.radians(table[name]) for axis, name in zip("xyz", "pqr", strict=True)}
    pd.DataFrame({"time_usec": imu_us(table.time_s), **rates}).to_csv(folder / "HIGHRES_IMU.csv", index=False)
    return folder


def test_tables_of_mavlinks_messages_are_on_one_clock(tmp_path):
    folder = two_tables(tmp_path / "log", lambda s: np.rint(1e3 * s), lambda s: np.rint(1e6 * s))
    (record,) = gb.open_log(folder, needs=CHANNELS).segments
    assert record["phi"] == pytest.approx(flight().phi[: len(record)], abs=0.5)


def test_an_attitude_on_another_clock_is_said(tmp_path):
    folder = two_tables(tmp_path / "log", lambda s: np.rint(1e3 * s) + 5e6, lambda s: np.rint(1e6 * s))
    with pytest.raises(InputError, match=r"phi: 'ATTITUDE.roll' is on another clock than the others"):
        gb.watch_log(folder, "auto")


def test_stamps_of_arrival_in_bursts_are_said(tmp_path):
    def bursts(time_s):
        rows = np.arange(len(time_s))
        last = np.minimum(rows // 40 * 40 + 39, len(rows) - 1)
        return np.rint(1e6 * np.asarray(time_s)[last]) + 100 * (rows % 40)

    folder = two_tables(tmp_path / "log", lambda s: np.rint(1e3 * s), bursts)
    with pytest.raises(InputError, match=r"no moment has a sample of each channel .*bursts"):
        gb.open_log(folder, needs=CHANNELS)


def imu_rows(table, count, noise):
    """Return the messages of several IMUs as rows, one after the other, as ArduPilot logs them since 2020."""
    number = np.tile(np.arange(count), len(table))
    rates = np.repeat(np.radians(table[["p", "q", "r"]].to_numpy()), count, axis=0) + noise * number[:, np.newaxis]
    stamps = np.repeat((1e6 * table.time_s + 7e6).round().astype(np.int64), count)
    axes = {f"Gyr{axis}": rates[:, place] for place, axis in enumerate("XYZ")}
    return pd.DataFrame({"TimeUS": stamps, "I": number, **axes})


def attitude_rows(table):
    angles = {"Roll": table.phi, "Pitch": table.theta, "Yaw": table.psi}
    return pd.DataFrame({"TimeUS": (1e6 * table.time_s + 7e6).round().astype(np.int64), **angles})


def test_imus_in_one_table_are_told_apart(tmp_path):
    """Mavlogdump writes a table a message, with the rows of all IMUs: read as one they would be mixed."""
    folder, table = tmp_path / "log", flight()
    folder.mkdir()
    imu_rows(table, 3, 0.1).to_csv(folder / "IMU.csv", index=False)
    attitude_rows(table).to_csv(folder / "ATT.csv", index=False)
    log = gb.open_log(folder, needs=CHANNELS)
    assert [imu.name for imu in log.imus] == ["IMU", "IMU#1", "IMU#2"]
    assert log.segments[0]["p"] == pytest.approx(table.p[: len(log.segments[0])], abs=1e-6)
    other = gb.open_log(folder, needs=CHANNELS, mapping=log.imus[2].mapping)
    assert np.mean(other.segments[0]["p"] - log.segments[0]["p"]) == pytest.approx(np.degrees(0.2), abs=1e-6)


def test_the_first_of_several_imus_is_read_as_a_converter_numbers_it(tmp_path):
    """Mission Planner's .mat has a matrix a sensor, IMU_0 and IMU_1, and its columns' names beside."""
    table = flight()
    rows = imu_rows(table, 2, 0.1)
    tables = {f"IMU_{n}": rows[n == rows.I] for n in range(2)} | {"ATT": attitude_rows(table)}
    stored = {name: each.to_numpy(np.float64) for name, each in tables.items()}
    names = {
        f"{name}_label": np.array(list(each.columns), dtype=object)[:, np.newaxis] for name, each in tables.items()
    }
    savemat(tmp_path / "log.mat", stored | names)
    log = gb.open_log(tmp_path / "log.mat", needs=CHANNELS)
    assert {source.channel: source.column for source in log.sources}["p"] == "IMU_0.GyrX"
    assert [imu.name for imu in log.imus] == ["IMU_0", "IMU_1"]
    assert log.segments[0]["p"] == pytest.approx(table.p[: len(log.segments[0])], abs=1e-6)


def test_messages_that_are_joined_with_times_of_their_own_take_the_time_of_every_row(tmp_path):
    """Mavlogdump's CSV of a telemetry log: a row is one message's, its other cells are empty."""
    table = flight()
    rates = {
        f"RAW_IMU.{axis}gyro": np.rint(1e3 * np.radians(table[name])) for axis, name in zip("xyz", "pqr", strict=True)
    }
    angles = {
        f"ATTITUDE.{name}": np.radians(table[of])
        for name, of in zip(("roll", "pitch", "yaw"), CHANNELS[3:], strict=True)
    }
    imu = pd.DataFrame({"timestamp": 1.6e9 + table.time_s, "RAW_IMU.time_usec": 1e6 * table.time_s, **rates})
    attitude = pd.DataFrame(
        {"timestamp": 1.6e9 + table.time_s + 0.005, "ATTITUDE.time_boot_ms": 1e3 * table.time_s, **angles}
    )
    path = tmp_path / "log.csv"
    pd.concat([imu, attitude]).sort_values("timestamp").to_csv(path, index=False)
    log = gb.open_log(path, needs=CHANNELS)
    assert {source.channel: source.column for source in log.sources}["time"] == "timestamp"
    rows = slice(10, len(log.segments[0]) - 10)
    at_s = log.segments[0].time_s[rows] - log.segments[0].start_s
    assert np.std(log.segments[0]["phi"][rows] - np.interp(at_s, table.time_s, table.phi)) < 0.5


def test_resets_and_arming_are_read_of_px4s_tables_packed_or_not(tmp_path):
    folder = make(tmp_path, "tables")
    attitude = pd.read_csv(folder / "log_7_vehicle_attitude_0.csv")
    after = attitude.timestamp >= 17e6
    half_rad = np.radians(15.0) / 2.0
    attitude["quat_reset_counter"] = 2 + after.astype(int)
    attitude["delta_q_reset[0]"] = np.where(after, np.cos(half_rad), 1.0)
    attitude.to_csv(folder / "log_7_vehicle_attitude_0.csv", index=False)
    status = pd.DataFrame({"timestamp": [7_000_000, 9_000_000, 20_000_000], "arming_state": [1, 2, 2]})
    status.to_csv(folder / "log_7_vehicle_status_0.csv", index=False)
    with zipfile.ZipFile(tmp_path / "log.zip", "w") as archive:
        for table in sorted(folder.iterdir()):
            archive.write(table, table.name)
    for path in (folder, tmp_path / "log.zip"):
        events = gb.open_log(path, needs=CHANNELS).events
        told = [(event.kind.value, event.time_s, event.text) for event in events]
        assert told == [("arm", 9.0, "commander"), ("reset", pytest.approx(17.0), "attitude by 15 deg")]

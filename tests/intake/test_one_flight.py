"""A folder of tables is one log only where nothing shows that it holds several: sensors, times, clocks, names."""

import zipfile

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.intake.contents import log_contents
from gtmbench.intake.formats.table_folder import is_folder_of_tables
from gtmbench.intake.read import is_log_folder, why_several_in
from gtmbench.log.fleet import logs_in
from tests.helpers.log_makers import flight, make
from tests.helpers.night import by_day

GYROS, ATTITUDE = ("p", "q", "r"), ("phi", "theta", "psi")
CHANNELS = (*GYROS, *ATTITUDE)
TIME_S = np.arange(0.0, 60.0, 0.02)


def table(columns, time_s=TIME_S, name="time_s"):
    """Return a table of columns that all move, each its own way."""
    moving = {column: np.sin(TIME_S * (1.0 + 0.1 * place)) for place, column in enumerate(columns)}
    return pd.DataFrame({name: time_s, **moving})


def named(channels):
    return [f"{name}_deg_s" if name in GYROS else f"{name}_deg" for name in channels]


def write(folder, tables):
    folder.mkdir()
    for name, each in tables.items():
        each.to_csv(folder / f"{name}.csv", index=False)
    return folder


def zipped(folder):
    path = folder.with_suffix(".zip")
    with zipfile.ZipFile(path, "w") as archive:
        for each in sorted(folder.iterdir()):
            archive.write(each, each.name)
    return path


RATES, ANGLES = table(named(GYROS)), table(named(ATTITUDE))
OF_OLD_PX4 = [*(f"q[{part}]" for part in range(4)), "rollspeed", "pitchspeed", "yawspeed"]
COMBINED = [f"gyro_rad[{axis}]" for axis in range(3)]
STAMPS = (1e6 * TIME_S + 7e6).astype(np.int64)


def topic(columns):
    return table(columns, STAMPS, "timestamp")


def message(columns):
    return table(columns, STAMPS, "TimeUS")


SEVERAL = {
    "a sensor in both, under other names": {
        "failed": table(named(CHANNELS)),
        "gyros": table(["gx_rad_s", "gy_rad_s", "gz_rad_s"]),
    },
    "a sensor in both, without a unit": {
        "flight": table(named(CHANNELS)),
        "gyro": table(["gyro_x", "gyro_y", "gyro_z"]),
    },
    "one column in both": {"gyro": RATES, "attitude": table([*named(ATTITUDE), "q_deg_s"])},
    "part of the other's columns": {"flight": table(named(CHANNELS)), "attitude": ANGLES},
    "the same columns at other times": {
        "imu": table(named(CHANNELS)),
        "imu_later": table(named(CHANNELS), TIME_S + 100.0),
    },
    "the same unknown columns": {"gyro_left": table(["a1", "a2", "a3"]), "gyro_right": table(["a1", "a2", "a3"])},
    "other times": {"gyro": RATES, "attitude": table(named(ATTITUDE), TIME_S + TIME_S[-1] + 5.0)},
    "clocks that are hours apart": {"gyro": RATES, "attitude": table(named(ATTITUDE), TIME_S + 7200.0)},
    "dates of two days": {
        "gyro": RATES.assign(time_s=pd.Timestamp("2024-05-01 12:00") + pd.to_timedelta(TIME_S, unit="s")),
        "attitude": ANGLES.assign(time_s=pd.Timestamp("2024-05-02 12:00") + pd.to_timedelta(TIME_S, unit="s")),
    },
    "one since 1970, one since a boot": {"gyro": RATES, "attitude": table(named(ATTITUDE), TIME_S + 1.7e9)},
    "two flights, each in two tables": {
        "day_gyro": RATES,
        "day_attitude": ANGLES,
        "night_gyro": RATES,
        "night_attitude": ANGLES,
    },
    "two exports": {"log_7_sensor_combined_0": topic(COMBINED), "log_8_vehicle_attitude_0": topic(OF_OLD_PX4[:4])},
    "an export, and one without a log's name": {
        "IMU": message(["GyrX", "GyrY", "GyrZ"]),
        "ATT": message(["Roll", "Pitch", "Yaw"]),
        "second_IMU": message(["GyrX", "GyrY", "GyrZ"]),
    },
    "another log beside an export": {
        "log_7_sensor_combined_0": topic(COMBINED),
        "log_7_vehicle_attitude_0": topic(OF_OLD_PX4[:4]),
        "failed": table(named(CHANNELS)),
    },
    "another log beside messages": {
        "IMU": message(["GyrX", "GyrY", "GyrZ"]),
        "ATT": message(["Roll", "Pitch", "Yaw"]),
        "failed": table(named(CHANNELS)),
    },
    "another log beside a message": {"ATT": message(["Roll", "Pitch", "Yaw"]), "flight": table(named(CHANNELS))},
}
ONE = {
    "gyros and attitude": {"gyro": RATES, "attitude": ANGLES},
    "an attitude that begins later": {"gyro": RATES, "attitude": ANGLES[ANGLES.time_s > 20.0]},
    "a part of one sensor": {"gyro": RATES, "attitude": ANGLES[(ANGLES.time_s > 20.0) & (ANGLES.time_s < 30.0)]},
    "a table a sensor, axes without a name": {
        "gyro": table(["x", "y", "z"]),
        "accel": table(["x", "y", "z"]),
        "mag": table(["x", "y", "z"]),
    },
    "a heading and heights of others": {
        "imu": RATES,
        "attitude": table([*named(ATTITUDE), "altitude_m"]),
        "gps": table(["heading_deg", "altitude_m"], np.arange(len(TIME_S)) + 4e5),
    },
    "a table without a time": {"gyro": RATES, "attitude": ANGLES.drop(columns="time_s")},
    "topics that share a channel": {
        "log_7_sensor_combined_0": topic(COMBINED),
        "log_7_vehicle_attitude_0": topic(OF_OLD_PX4),
        "log_7_vehicle_angular_velocity_0": topic([f"xyz[{axis}]" for axis in range(3)]),
        "log_7_estimator_attitude_0": topic(OF_OLD_PX4[:4]),
        "log_7_sim_airspeed_0": topic(["true_airspeed_m_s"]),
        "log_7_battery_status_0": topic(["voltage_v"]),
    },
    "several IMUs of one log": {
        **{f"log_7_sensor_gyro_{number}": topic(["x", "y", "z"]) for number in range(3)},
        "log_7_vehicle_attitude_0": topic(OF_OLD_PX4[:4]),
    },
    "messages that share a channel": {
        **{name: message(["GyrX", "GyrY", "GyrZ"]) for name in ("IMU", "IMU2")},
        **{name: message(["Roll", "Pitch", "Yaw"]) for name in ("ATT", "AHR2", "NKF1")},
        "SCALED_IMU2": message(["xgyro", "ygyro", "zgyro"]),
    },
    "notes beside an export": {
        "log_7_sensor_combined_0": topic(COMBINED),
        "log_7_vehicle_attitude_0": topic(OF_OLD_PX4[:4]),
        "parameters": pd.DataFrame({"name": ["a", "b"], "value": [1, 2]}),
    },
}


@pytest.mark.parametrize("case", by_day(SEVERAL, 6, seed=78))
def test_tables_of_several_logs_are_a_log_each_packed_or_not(tmp_path, case):
    folder = write(tmp_path / "logs", SEVERAL[case])
    assert not is_log_folder(folder)
    assert {path.stem for path in logs_in([folder])} == set(SEVERAL[case])
    with pytest.raises(gb.InputError) as told:
        gb.open_log(folder)
    assert "\n" not in str(told.value)
    assert "under other names" not in case or why_several_in(folder) == "failed and gyros both hold p, q, r"
    packed = zipped(folder)
    with pytest.raises(gb.InputError, match=r"several logs|files; say which"):
        gb.open_log(packed)
    for name in SEVERAL[case]:  # each can be named
        assert log_contents(f"{packed}:{name}.csv").columns


@pytest.mark.parametrize("case", by_day(ONE, 5, seed=78))
def test_tables_of_one_flight_are_one_log(tmp_path, case):
    folder = write(tmp_path / "log", ONE[case])
    assert is_log_folder(folder), why_several_in(folder)
    assert logs_in([tmp_path]) == (folder,)


@pytest.mark.parametrize("order", [("gyro", "attitude"), ("attitude", "gyro")])
@pytest.mark.parametrize("late_s", [0.0, 5.0, 20.0])
@pytest.mark.parametrize("how", ["dates", "two columns"])
def test_tables_that_begin_apart_stay_apart(tmp_path, order, late_s, how):
    """Dates, and seconds since 1970 in two columns, count from each table's own first row."""
    parts = {"gyro": named(GYROS), "attitude": named(ATTITUDE)}
    first, second = order
    motion = np.sin(TIME_S)
    whole = {name: pd.DataFrame(dict.fromkeys(columns, motion)) for name, columns in parts.items()}
    rows = {first: slice(None), second: slice(round(late_s / 0.02), None)}
    tables = {}
    for name, each in whole.items():
        ns = 1_714_564_800 * 10**9 + np.round(TIME_S * 1e9).astype(np.int64)
        clock = {"time": pd.to_datetime(ns)} if how == "dates" else {"secs": ns // 10**9, "nsecs": ns % 10**9}
        tables[name] = pd.DataFrame({**clock, **each}).iloc[rows[name]]
    columns = [f"{name}={table}.{column}:{unit}" for name, table, column, unit in _mapped(parts)]
    (record,) = gb.open_log(write(tmp_path / "log", tables), mapping=columns, needs=CHANNELS).segments
    assert record["p"] == pytest.approx(record["theta"], abs=1e-3)
    assert record.end_s - record.start_s == pytest.approx(TIME_S[-1] - late_s, abs=0.05)


def _mapped(parts):
    for name, columns in parts.items():
        for column in columns:
            yield column.split("_")[0], name, column, "deg/s" if column.endswith("_s") else "deg"


def test_another_log_beside_tables_is_a_log_of_its_own(tmp_path):
    """ulog2csv writes its tables beside the log: the log that they were made of is the same flight, others are not."""
    folder = make(tmp_path, "tables")
    (folder / "log_7.ulg").write_bytes(b"ULog\x01\x12\x35" + bytes(9))
    assert logs_in([folder]) == (folder,)
    (folder / "log_8.ulg").write_bytes(b"ULog\x01\x12\x35" + bytes(9))
    assert {"log_8.ulg", "log_7.ulg", "log_7_vehicle_attitude_0.csv"} <= {path.name for path in logs_in([folder])}
    with pytest.raises(gb.InputError, match="is a folder; give the logs in it"):
        gb.open_log(folder)


def test_logs_in_the_folders_of_a_log_are_logs_too(tmp_path):
    folder = make(tmp_path, "tables")
    (folder / "next").mkdir()
    flight().to_csv(folder / "next" / "flight.csv", index=False)
    assert logs_in([tmp_path]) == (folder, folder / "next" / "flight.csv")


def test_the_folders_that_hold_a_logs_tables_are_no_logs_beside_it(tmp_path):
    """EuRoC's `mav0` and the folders of its sensors."""
    for sensor, columns in {"imu0": named(GYROS), "state_groundtruth_estimate0": named(ATTITUDE)}.items():
        folder = tmp_path / "euroc" / "mav0" / sensor
        folder.mkdir(parents=True)
        table(columns).to_csv(folder / "data.csv", index=False)
    assert logs_in([tmp_path]) == (tmp_path / "euroc",)


def test_a_folder_is_judged_anew_when_its_tables_change(tmp_path):
    folder = write(tmp_path / "log", ONE["gyros and attitude"])
    assert is_log_folder(folder)
    table(named(CHANNELS)).to_csv(folder / "attitude.csv", index=False)
    assert is_folder_of_tables(folder)
    assert not is_log_folder(folder)

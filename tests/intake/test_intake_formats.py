"""The same flight in every format is the same record, to what the format keeps of it."""

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from tests.helpers import intake_files as files
from tests.helpers.turning import quaternions

KT, FT, G = 1852 / 3600, 0.3048, 9.80665
ANGLES = ("phi", "theta", "psi")


@pytest.fixture(scope="module")
def flight():
    return gb.measure(gb.fly(duration_s=30, excitation="multisine+turbulence", seed=1), noise="t2", seed=1)


def metric(flight):
    """Return the flight as autopilots measure it: rad/s, m/s2 with z down, m/s, m."""
    rates = [np.radians(flight[name]) for name in "pqr"]
    accels = [G * flight["nx"], G * flight["ny"], -G * flight["nz"]]
    return rates, accels, flight["tas"] * KT, flight["altitude"] * FT


def as_ulog(flight, path):
    rates, accels, tas, altitude = metric(flight)
    us = np.round(flight.time_s * 1e6) + 5_000_000
    path.write_bytes(
        files.ulog(
            {
                "sensor_combined": (
                    ["float[3] gyro_rad", "float[3] accelerometer_m_s2"],
                    np.column_stack([us, *rates, *accels]),
                ),
                "vehicle_attitude": (["float[4] q"], np.column_stack([us, quaternions(flight.matrix(ANGLES))])),
                "airspeed_validated": (["float true_airspeed_m_s"], np.column_stack([us, tas])),
                "vehicle_global_position": (["double lat", "float alt"], np.column_stack([us, 0 * us, altitude])),
            }
        )
    )
    return ["p", "q", "r", "nx", "ny", "nz", "phi", "theta", "psi", "tas", "altitude"], 5.0


def dataflash_tables(flight, second=True):
    rates, accels, _, altitude = metric(flight)
    us = np.round(flight.time_s * 1e6).astype(int) + 7_000_000
    degrees = [np.rint(100 * flight[name]).astype(int) for name in ("phi", "theta", "psi")]
    imu = [(t, 0, *row) for t, row in zip(us.tolist(), np.column_stack([*rates, *accels]).tolist(), strict=True)]
    other = [(t, 1, *[9.0] * 6) for t, *_ in imu] if second else []
    return {
        "IMU": ("QBffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ", sorted(imu + other)),
        "ATT": ("Qccc", "TimeUS,Roll,Pitch,Yaw", list(zip(us.tolist(), *(d.tolist() for d in degrees), strict=True))),
        "POS": ("Qf", "TimeUS,Alt", list(zip(us.tolist(), altitude.tolist(), strict=True))),
        "MSG": ("QZ", "TimeUS,Message", [(us.tolist()[0], b"ArduPlane")]),
    }


def as_dataflash(flight, path):
    units = {"IMU": ("s#EEEooo", "F-000000"), "ATT": ("sddd", "F---"), "POS": ("sm", "F0")}
    path.write_bytes(files.dataflash(dataflash_tables(flight), units=units))
    return ["p", "q", "r", "nx", "ny", "nz", "phi", "theta", "psi", "altitude"], 7.0


def as_dataflash_text(flight, path):
    tables = dataflash_tables(flight, second=False)
    letters, columns, rows = tables["ATT"]
    tables["ATT"] = (letters, columns, [(t, *(value / 100 for value in row)) for t, *row in rows])
    path.write_bytes(files.dataflash_text({name: tables[name] for name in ("IMU", "ATT", "POS")}))
    return ["p", "q", "r", "nx", "ny", "nz", "phi", "theta", "psi", "altitude"], 7.0


def as_old_dataflash_text(flight, path):
    """Texts of the early 2010s begin with the firmware and the board."""
    told = as_dataflash_text(flight, path)
    path.write_bytes(b"\n58\n\nArduCopter V3.1 (5c6503e2)\nFree RAM: 1331\nAPM 2\n" + path.read_bytes())
    return told


def as_mcap_json(flight, path):
    names = ["p", "q", "r", "nx", "phi", "tas"]
    headers = [gb.CHANNELS[name].header for name in names]
    rows = flight.matrix(names).tolist()
    stamps = [round(t * 1e9) + 10**9 for t in flight.time_s]
    sent = [
        (t, {"air": dict(zip(headers, row, strict=True)), "mode": "AUTO"}) for t, row in zip(stamps, rows, strict=True)
    ]
    files.mcap(path, {"/state": sent})
    return names, 1.0


def as_mcap_ros(flight, path):
    """ROS looks forward, left and up, and east, north and up."""
    (p, q, r), (ax, ay, az), _, _ = metric(flight)
    turned = flight.replace("theta", -flight["theta"]).replace("psi", 90 - flight["psi"])
    w, x, y, z = quaternions(turned.matrix(ANGLES)).T
    stamps = [round(t * 1e9) + 10**9 for t in flight.time_s]
    columns = zip(
        stamps,
        np.column_stack([p, -q, -r]),
        np.column_stack([ax, -ay, -az]),
        np.column_stack([x, y, z, w]),
        strict=True,
    )
    sent = [(t + 123_456, files.cdr_imu(t, gyro, accel, quat)) for t, gyro, accel, quat in columns]
    files.mcap(path, {"/imu": sent}, schema="sensor_msgs/msg/Imu", encoding="cdr")
    return ["p", "q", "r", "nx", "ny", "nz", "phi", "theta", "psi"], 1.0


SINGLE = 2.0**-23
FORMATS = {
    "flight.ulg": (as_ulog, SINGLE),
    "flight.bin": (as_dataflash, SINGLE),
    "flight.log": (as_dataflash_text, 1e-12),
    "old.log": (as_old_dataflash_text, 1e-12),
    "flight.mcap": (as_mcap_json, 1e-12),
    "ros.mcap": (as_mcap_ros, 1e-12),
}


@pytest.mark.parametrize("name", FORMATS)
def test_a_container_gives_the_flight_back(flight, tmp_path, name):
    write, precision = FORMATS[name]
    channels, start_s = write(flight, tmp_path / name)
    log = gb.open_log(tmp_path / name)
    (record,) = log.segments
    assert sorted(record.channels) == sorted(channels)
    assert (len(record), record.sample_period_s, record.start_s) == (len(flight), 0.01, start_s)
    assert log.remarks == ()
    for channel in channels:
        grain = 0.005 if name in ("flight.bin", "flight.log", "old.log") and channel in ANGLES else 0.0  # centidegrees
        scale = max(np.abs(flight[channel]).max(), 60.0 if channel in ANGLES else 0.0)
        error = np.abs(record[channel] - flight[channel])
        if channel == "psi":
            error = np.abs((record[channel] - flight[channel] + 180) % 360 - 180)
        assert error.max() <= grain * 1.001 + 4 * precision * scale, channel


@pytest.mark.parametrize("ending", [".csv", ".parquet"])
def test_what_write_log_wrote_comes_back_bit_for_bit(flight, tmp_path, ending):
    for record in (
        flight,
        flight.between(5, 20),
        flight.replace("p", np.where(flight.time_s < 1, np.nan, flight["p"])),
    ):
        gb.write_log(record, tmp_path / f"log{ending}")
        log = gb.open_log(tmp_path / f"log{ending}")
        (read,) = log.segments
        assert (read.channels, read.start_s) == (record.channels, record.start_s)
        assert read.sample_period_s == record.sample_period_s
        np.testing.assert_array_equal(read.values, record.values)


@pytest.mark.parametrize("period_s", [0.01, 0.004, 1 / 60, 0.0123, 0.1, 1 / 3, 0.05 + 1e-7, 1.0])
def test_the_period_is_the_strict_readers(tmp_path, period_s):
    rng = np.random.default_rng(3)
    record = gb.Record(rng.standard_normal((500, 2)), channels=["p", "x"], sample_period_s=period_s, start_s=12.5)
    gb.write_log(record, tmp_path / "log.csv")
    (read,), strict = gb.open_log(tmp_path / "log.csv").segments, gb.read_log(tmp_path / "log.csv")
    assert read.sample_period_s == strict.sample_period_s
    np.testing.assert_array_equal(read.values, strict.values)


def test_needs_choose_and_order_the_channels(flight, tmp_path):
    gb.write_log(flight, tmp_path / "log.csv")
    assert gb.open_log(tmp_path / "log.csv", needs=["r", "p"]).channels == ("r", "p")


def test_a_second_instance_and_undocumented_topics_are_there_by_their_names(flight, tmp_path):
    rates, *_ = metric(flight)
    us = np.round(flight.time_s * 1e6)
    turned = np.column_stack([us, *[2 * rate for rate in rates]])
    topics = {f"sensor_gyro{n}": (["float x", "float y", "float z"], turned) for n in ("", "#1")}
    (tmp_path / "log.ulg").write_bytes(files.ulog(topics))
    with pytest.raises(gb.InputError, match="no channel 'p': nothing looks like p: --map p=COLUMN:rad/s"):
        gb.open_log(tmp_path / "log.ulg", needs=["p"])
    log = gb.open_log(tmp_path / "log.ulg", mapping=["p=-sensor_gyro#1.x:rad/s"], needs=["p", "sensor_gyro.y"])
    np.testing.assert_allclose(log.segments[0]["p"], -2 * flight["p"], rtol=1e-6)
    np.testing.assert_allclose(log.segments[0]["sensor_gyro.y"], 2 * rates[1], rtol=1e-6)


def test_of_two_imus_none_is_taken_and_one_can_be_chosen(flight, tmp_path):
    """A mapping that states no unit takes the documented one, and the documented axes."""
    flown = flight.between(0.0, 10.0)
    rates, *_ = metric(flown)
    sent = [
        (round(t * 1e9), files.cdr_imu(round(t * 1e9), rate, [0, 0, 9.8], [0, 0, 0, 1]))
        for t, rate in zip(flown.time_s, np.column_stack(rates), strict=True)
    ]
    files.mcap(tmp_path / "log.mcap", {"/a": sent, "/b": sent}, schema="sensor_msgs/msg/Imu", encoding="cdr")
    with pytest.raises(gb.InputError, match=r"'/a.angular_velocity.y' may be q, as may '/b\.angular_velocity.y'"):
        gb.open_log(tmp_path / "log.mcap", needs=["q"])
    for stated, sign in (("", -1), (":rad/s", 1)):
        log = gb.open_log(tmp_path / "log.mcap", mapping=[f"q=/a.angular_velocity.y{stated}"], needs=["q"])
        np.testing.assert_allclose(log.segments[0]["q"], sign * flown["q"], atol=1e-9)


def test_stamps_of_when_a_topic_was_sampled_are_preferred(tmp_path):
    """PX4 stamps a message when it's published; what counts is when it was measured."""
    us = np.arange(1000) * 10_000 + 1_000_000
    late = us + np.random.default_rng(1).integers(1000, 4000, 1000)
    rows = np.column_stack([late, us, np.sin(us / 1e6)])
    (tmp_path / "log.ulg").write_bytes(
        files.ulog(
            {
                "vehicle_angular_velocity": (
                    ["uint64_t timestamp_sample", "float[1] xyz"],
                    [[int(a), int(b), c] for a, b, c in rows],
                )
            }
        )
    )
    record = gb.open_log(tmp_path / "log.ulg").segments[0]
    assert record.start_s == 1.0
    np.testing.assert_allclose(record["p"], np.degrees(np.sin(record.time_s)), rtol=1e-6, atol=1e-6)


def test_epochs_count_from_the_first_stamp(flight, tmp_path):
    frame = flight.frame().rename(columns={"p": "p_deg_s"})[["p_deg_s"]].reset_index(drop=True)
    start = pd.Timestamp("2026-03-04T05:06:07.25")
    dates = start + pd.to_timedelta(np.arange(len(frame)) * 10, unit="ms")
    stamps = {
        "iso": ("timestamp", dates.strftime("%Y-%m-%dT%H:%M:%S.%fZ")),
        "ns": ("timestamp_ns", dates.as_unit("ns").astype("int64")),
        "s": ("time_s", dates.as_unit("ns").astype("int64") / 1e9),
    }
    for name, values in stamps.values():
        frame.assign(**{name: values}).to_csv(tmp_path / "log.csv", index=False)
        log = gb.open_log(tmp_path / "log.csv", needs=["p"])
        assert any("2026-03-04 05:06:07.250 UTC" in line for line in log.method), log.method
        assert log.segments[0].start_s == pytest.approx(0.0, abs=1e-6)  # seconds since 1970 as doubles keep 0.2 us
        assert log.sample_period_s == 0.01
        np.testing.assert_array_equal(log.segments[0]["p"], flight["p"])
    frame.assign(time=dates).to_parquet(tmp_path / "log.parquet")
    np.testing.assert_array_equal(gb.open_log(tmp_path / "log.parquet").segments[0]["p"], flight["p"])


def test_a_truncated_container_gives_what_stands_before(flight, tmp_path):
    for name, (write, _) in FORMATS.items():
        write(flight, tmp_path / name)
        whole = (tmp_path / name).read_bytes()
        (tmp_path / name).write_bytes(whole[: int(0.7 * len(whole))])
        if name.endswith("mcap"):  # a chunk is a whole second or more: none, or some
            continue
        log = gb.open_log(tmp_path / name, needs=["p"])
        assert 10 < log.segments[0].end_s - log.segments[0].start_s < 25


def test_columns_are_listed_with_what_they_become(flight, tmp_path):
    as_ulog(flight, tmp_path / "log.ulg")
    columns = {column.name: column for column in gb.log_columns(tmp_path / "log.ulg")}
    gyro = columns["sensor_combined.gyro_rad[0]"]
    assert (gyro.channel, gyro.unit, gyro.samples) == ("p", "rad/s", len(flight))
    assert gyro.rate_hz == pytest.approx(100)
    assert (gyro.start_s, gyro.end_s) == (5.0, 35.0)
    assert columns["vehicle_global_position.lat"].channel == ""
    (tmp_path / "log.csv").write_text("time,gyro_x\n0,1\n1,2\n")
    told = {column.name: column.why_not for column in gb.log_columns(tmp_path / "log.csv")}
    assert told["gyro_x"] == "looks like p, but states no unit: --map p=gyro_x:rad/s or :deg/s"

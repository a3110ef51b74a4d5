"""The magnetometers of a log: which columns they are in every format, each reading once, laid beside a record."""

import numpy as np
import pytest

from gtmbench.errors import InputError
from gtmbench.intake.other_sensors import other_sensors_of
from gtmbench.intake.read import read_log
from gtmbench.values.channels import MAGNETOMETER
from gtmbench.values.record import Record
from tests.helpers.autopilot_logs import ardupilot, at, imus, px4
from tests.helpers.log_makers import EPOCH_NS

TIME_S = np.arange(60) * 0.1
FIELD = np.round(np.column_stack([300.0 * np.cos(TIME_S), -300.0 * np.sin(TIME_S), 400.0 + TIME_S]))  # whole numbers


@pytest.fixture(scope="module")
def record():
    return imus(1, duration_s=130.0)[0].between(0.0, 6.0)


def found(path, content=None, mapping=()):
    if content is not None:
        path.write_bytes(content)
    return tuple(each for each in other_sensors_of(read_log(path), mapping) if each.channels == MAGNETOMETER)


def table(path, header, columns=FIELD):
    rows = [",".join(f"{value:g}" for value in (time_s, *row)) for time_s, row in zip(TIME_S, columns, strict=True)]
    path.write_text("\n".join([",".join(["time_s", *header]), *rows]))
    return path


def check(readings, field=FIELD):
    assert readings.time_s == pytest.approx(TIME_S, abs=1e-6)
    assert readings.values == pytest.approx(field, rel=1e-6)


def rows_of(*values):
    return [(at(time_s), *row) for time_s, *row in zip(TIME_S, *values, strict=True)]


def test_of_an_ardupilot_log_all_that_read_anything(record, tmp_path):
    layout = ("Qfff", "TimeUS,MagX,MagY,MagZ")
    more = {
        "MAG": (*layout, rows_of(*FIELD.T)),
        "MAG2": (*layout, rows_of(*-FIELD.T)),
        "MAG3": (*layout, rows_of(*np.zeros((3, 60)))),
    }
    first, second = found(tmp_path / "log.bin", ardupilot([record], more=more))
    assert (first.name, second.name, first.columns) == ("MAG", "MAG2", ("MAG.MagX", "MAG.MagY", "MAG.MagZ"))
    check(first)
    check(second, -FIELD)


def test_of_px4_what_is_calibrated_rather_than_the_sensors_own(record, tmp_path):
    own = [(time_s, *row) for time_s, row in zip(TIME_S, FIELD, strict=True)]
    raw = {"sensor_mag": (["float x", "float y", "float z"], [(row[0], 1.0, 2.0, -row[1]) for row in own])}
    (only,) = found(tmp_path / "raw.ulg", px4(record, more=raw))
    assert only.name == "sensor_mag"
    calibrated = {**raw, "vehicle_magnetometer": (["float[3] magnetometer_ga"], own)}
    (better,) = found(tmp_path / "both.ulg", px4(record, more=calibrated))
    assert better.name == "vehicle_magnetometer"
    check(better)


@pytest.mark.parametrize("message", ["HIGHRES_IMU", "SCALED_IMU", "RAW_IMU"])
def test_of_telemetry(message, tmp_path):
    from pymavlink.dialects.v20 import ardupilotmega as mavlink

    mav = mavlink.MAVLink(None, srcSystem=1, srcComponent=1)
    packets = [(0.0, mavlink.MAVLink_heartbeat_message(2, 3, 0, 0, 4, 3))]
    for time_s, (x, y, z) in zip(TIME_S, FIELD, strict=True):
        rest, whole = (0,) * 6, [int(x), int(y), int(z)]
        sent = {
            "HIGHRES_IMU": lambda us, _, rest=rest, own=(x, y, z): mavlink.MAVLink_highres_imu_message(
                us, *rest, *own, 0, 0, 0, 0, 0
            ),
            "SCALED_IMU": lambda _, ms, rest=rest, own=whole: mavlink.MAVLink_scaled_imu_message(ms, *rest, *own),
            "RAW_IMU": lambda us, _, rest=rest, own=whole: mavlink.MAVLink_raw_imu_message(us, *rest, *own),
        }[message]
        packets.append((time_s, sent(at(time_s), round(1000 * time_s))))
    stamp = EPOCH_NS // 1000
    data = [(stamp + at(time_s)).to_bytes(8, "big") + packet.pack(mav) for time_s, packet in packets]
    (only,) = found(tmp_path / "log.tlog", b"".join(data))
    assert only.name == message
    check(only)


@pytest.mark.parametrize(
    ("header", "name"),
    [
        (("mag_x", "mag_y", "mag_z"), "mag"),
        (("MagX [uT]", "MagY [uT]", "MagZ [uT]"), "Mag"),
        (("imu.magnetometer_x", "imu.magnetometer_y", "imu.magnetometer_z"), "imu.magnetometer"),
        (("xmag", "ymag", "zmag"), "xmag"),
        (("mx", "my", "mz"), "m"),
    ],
)
def test_of_a_table_by_its_names(header, name, tmp_path):
    (only,) = found(table(tmp_path / "log.csv", header))
    assert only.name == name
    check(only)


def test_names_of_other_things_are_no_magnetometer(tmp_path):
    assert found(table(tmp_path / "a.csv", ("mag_offset_x", "mag_offset_y", "mag_offset_z"))) == ()
    assert found(table(tmp_path / "b.csv", ("mag_x", "mag_y", "magnitude"))) == ()


def test_a_mapping_decides(tmp_path):
    path = table(tmp_path / "log.csv", ("one", "two", "three"))
    assert found(path) == ()
    (only,) = found(path, mapping=("mag_x=one", "mag_y=-two", "mag_z=three"))
    check(only, FIELD * [1.0, -1.0, 1.0])
    with pytest.raises(InputError, match="no mag_z; a magnetometer has three axes"):
        found(path, mapping=("mag_x=one", "mag_y=two"))
    with pytest.raises(InputError, match="no column 'four'"):
        found(path, mapping=("mag_x=one", "mag_y=two", "mag_z=four"))
    assert found(table(tmp_path / "named.csv", MAGNETOMETER), mapping=("mag_x=none",)) == ()


def test_repeats_are_no_readings_and_a_stuck_one_reads_nothing(tmp_path):
    held = FIELD[np.arange(60) // 2 * 2]
    (only,) = found(table(tmp_path / "held.csv", MAGNETOMETER, held))
    assert only.time_s == pytest.approx(TIME_S[::2])
    assert found(table(tmp_path / "stuck.csv", MAGNETOMETER, np.tile([1.0, 2.0, 3.0], (60, 1)))) == ()


def test_readings_stand_where_they_were_taken_and_not_in_gaps(tmp_path):
    (only,) = found(table(tmp_path / "log.csv", MAGNETOMETER))
    fast = Record(np.zeros((300, 1)), channels=["p"], sample_period_s=0.02)
    laid = only.beside(fast).matrix(MAGNETOMETER)
    assert np.count_nonzero(np.isfinite(laid).all(axis=1)) == 60
    assert laid[::5] == pytest.approx(FIELD)
    slow = Record(np.zeros((40, 1)), channels=["p"], sample_period_s=0.1, start_s=-0.95)
    beside = only.beside(slow).matrix(MAGNETOMETER)
    assert np.isnan(beside[:10]).all()
    assert beside[10] == pytest.approx(0.5 * (FIELD[0] + FIELD[1]))
    kept = np.r_[0:20, 40:60]
    path = tmp_path / "gap.csv"
    lines = [f"{TIME_S[k]:g},{FIELD[k, 0]:g},{FIELD[k, 1]:g},{FIELD[k, 2]:g}" for k in kept]
    path.write_text("\n".join(["time_s,mag_x,mag_y,mag_z", *lines]))
    (gappy,) = found(path)
    whole = gappy.beside(Record(np.zeros((60, 1)), channels=["p"], sample_period_s=0.1))["mag_x"]
    assert np.isfinite(whole[:20]).all()
    assert np.isfinite(whole[41:]).all()
    assert np.isnan(whole[21:39]).all()


def test_a_clock_that_was_set_back_places_nothing(tmp_path):
    path = tmp_path / "log.csv"
    stamped = np.column_stack([np.concatenate([TIME_S + 100.0, TIME_S]), np.vstack([FIELD, FIELD + 1.0])])
    rows = [",".join(f"{value:g}" for value in row) for row in stamped]
    path.write_text("\n".join(["time_s,mag_x,mag_y,mag_z", *rows]))
    assert found(path) == ()

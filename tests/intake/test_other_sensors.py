"""The sensors of a log that no gyro enters: their columns in every format, and how they lie beside a record."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.intake.other_sensors import other_sensors_of, readings_at
from gtmbench.intake.read import read_log
from gtmbench.values.channels import GPS_VELOCITY
from tests.helpers.autopilot_logs import ardupilot, at, imus, px4

TIME_S = np.arange(60) * 0.2
SPEED, COURSE, DOWN = 5.0 + np.sin(TIME_S), 90.0 + 10.0 * np.cos(TIME_S), 0.3 * np.cos(TIME_S)
NORTH, EAST = SPEED * np.cos(np.deg2rad(COURSE)), SPEED * np.sin(np.deg2rad(COURSE))
HEIGHT_M = 100.0 + TIME_S


@pytest.fixture(scope="module")
def record():
    return imus(1, duration_s=130.0)[0].between(0.0, 12.0)


def found(path, content=None, mapping=()):
    if content is not None:
        path.write_bytes(content)
    return {each.channels[0]: each for each in other_sensors_of(read_log(path), mapping)}


def stamped(*columns):
    return [(at(time_s), *row) for time_s, *row in zip(TIME_S, *columns, strict=True)]


def of_ardupilot(status=3):
    fix = np.full(60, status)
    return {
        "GPS": ("QBfff", "TimeUS,Status,Spd,GCrs,VZ", stamped(fix.tolist(), SPEED, COURSE, DOWN)),
        "BARO": ("Qf", "TimeUS,Alt", stamped(HEIGHT_M)),
        "ARSP": ("Qf", "TimeUS,Airspeed", stamped(SPEED)),
    }


def test_of_an_ardupilot_log_its_sensors_and_not_what_its_estimator_made_of_them(record, tmp_path):
    more = {**of_ardupilot(), "POS": ("Qf", "TimeUS,Alt", stamped(HEIGHT_M + 50.0))}
    sensors = found(tmp_path / "log.bin", ardupilot([record], more=more))
    assert {name: each.name for name, each in sensors.items()} == {
        "gps_north": "GPS",
        "tas": "ARSP",
        "altitude": "BARO",
    }
    assert sensors["gps_north"].values == pytest.approx(np.column_stack([NORTH, EAST, DOWN]), abs=1e-4)
    assert sensors["tas"].values[:, 0] * 0.514444 == pytest.approx(SPEED, rel=1e-4)
    assert sensors["altitude"].values[:, 0] * 0.3048 == pytest.approx(HEIGHT_M, rel=1e-4)
    assert sensors["altitude"].time_s == pytest.approx(TIME_S, abs=1e-5)
    assert sensors["gps_north"].places is None


def test_a_gps_without_a_fix_reads_nothing(record, tmp_path):
    assert "gps_north" not in found(tmp_path / "log.bin", ardupilot([record], more=of_ardupilot(status=1)))


@pytest.mark.parametrize("latitude_deg", [47.0, -60.0])
def test_places_are_metres_north_and_east_of_the_first_fix(record, tmp_path, latitude_deg):
    # 10 m north and 20 m east a second, by the lengths of a degree that are tabled for these latitudes (WGS 84)
    degree_m = {47.0: (111_170.0, 76_056.0), -60.0: (111_412.0, 55_800.0)}[latitude_deg]
    latitudes, longitudes = latitude_deg + 10.0 * TIME_S / degree_m[0], 8.0 + 20.0 * TIME_S / degree_m[1]
    fix = np.where(TIME_S < 2.0, 1, 3).tolist()
    rows = stamped(fix, SPEED, COURSE, DOWN, latitudes, longitudes)
    of_ardupilot = ardupilot([record], more={"GPS": ("QBfffdd", "TimeUS,Status,Spd,GCrs,VZ,Lat,Lng", rows)})
    fields = [*(f"float vel_{axis}_m_s" for axis in "ned"), "uint8_t fix_type", "int32_t lat", "int32_t lon"]
    stored = (np.rint(1e7 * each).astype(int).tolist() for each in (latitudes, longitudes))
    of_px4 = px4(record, more={"sensor_gps": (fields, list(zip(TIME_S, NORTH, EAST, DOWN, fix, *stored, strict=True)))})
    for name, content in (("log.bin", of_ardupilot), ("log.ulg", of_px4)):
        gps = found(tmp_path / name, content)["gps_north"]
        since_s = gps.time_s - 2.0
        np.testing.assert_allclose(gps.places, np.column_stack([10.0 * since_s, 20.0 * since_s]), atol=0.2)


def test_of_px4_the_airspeed_sensor_and_the_pressure(record, tmp_path):
    def rows(*columns):
        return [(time_s, *row) for time_s, *row in zip(TIME_S, *columns, strict=True)]

    velocity = ["float vel_n_m_s", "float vel_e_m_s", "float vel_d_m_s", "uint8_t fix_type"]
    more = {
        "vehicle_gps_position": (velocity, rows(NORTH, EAST, DOWN, np.full(60, 3).tolist())),
        "airspeed": (["float true_airspeed_m_s"], rows(SPEED)),
        "airspeed_validated": (["float true_airspeed_m_s"], rows(SPEED + 3.0)),  # perhaps of wind and ground speed
        "vehicle_air_data": (["float baro_alt_meter"], rows(HEIGHT_M)),
        "vehicle_global_position": (["float alt"], rows(HEIGHT_M + 50.0)),
    }
    sensors = found(tmp_path / "log.ulg", px4(record, more=more))
    assert {name: each.name for name, each in sensors.items()} == {
        "gps_north": "vehicle_gps_position",
        "tas": "airspeed",
        "altitude": "vehicle_air_data",
    }
    assert sensors["gps_north"].values == pytest.approx(np.column_stack([NORTH, EAST, DOWN]), abs=1e-4)


def test_of_a_table_by_names_and_as_mapped(tmp_path):
    path = tmp_path / "log.csv"
    rows = zip(TIME_S, NORTH, EAST, DOWN, HEIGHT_M / 0.3048, strict=True)
    path.write_text(
        "\n".join(
            ["time_s,gps_north,gps_east,gps_down,altitude_ft", *(",".join(map(repr, map(float, row))) for row in rows)]
        )
    )
    sensors = found(path)
    assert sensors["gps_north"].values == pytest.approx(np.column_stack([NORTH, EAST, DOWN]))
    assert sensors["altitude"].values[:, 0] == pytest.approx(HEIGHT_M / 0.3048)
    assert list(found(path, mapping=["altitude=none"])) == ["gps_north"]
    turned = found(path, mapping=["gps_north=gps_east", "gps_east=gps_north", "gps_down=-gps_down"])["gps_north"]
    assert turned.values == pytest.approx(np.column_stack([EAST, NORTH, -DOWN]))
    with pytest.raises(InputError, match="no gps_down; a GPS velocity has three axes"):
        found(path, mapping=["gps_north=gps_east", "gps_east=gps_north"])


def test_a_stuck_sensor_keeps_on_reading_and_a_slow_one_is_read_once():
    time_s = np.arange(200) * 0.02
    slow = (np.arange(200) // 5.0)[:, np.newaxis]  # logged five times as often as it is new
    assert np.flatnonzero(readings_at(time_s, slow)).tolist() == list(range(0, 200, 5))
    stuck = np.minimum(slow, 20.0)
    kept = time_s[readings_at(time_s, stuck)]
    assert kept[-1] > 3.8
    assert np.diff(kept).max() < 0.2


def test_a_fast_sensor_is_averaged_and_a_slow_one_stays_in_its_rows():
    read = gb.Record(np.zeros((100, 1)), channels=["p"], sample_period_s=0.1, start_s=0.0)
    fast, slow = (
        _sensor(np.arange(0.0, 10.0, step), channels) for step, channels in ((0.01, ("altitude",)), (0.5, GPS_VELOCITY))
    )
    means = fast.beside(read)["altitude"]
    assert means[5:95] == pytest.approx(np.zeros(90), abs=0.2)  # of a vibration of 1 at 23 Hz
    laid = slow.beside(read)["gps_north"]
    assert np.flatnonzero(np.isfinite(laid)).tolist() == list(range(0, 100, 5))
    assert np.isfinite(laid).sum() == len(slow.time_s)


def _sensor(time_s, channels):
    from gtmbench.intake.other_sensors import SensorReadings

    values = np.tile(np.sin(2.0 * np.pi * 23.0 * time_s)[:, np.newaxis], len(channels))
    return SensorReadings(
        name="x", channels=channels, columns=channels, time_s=time_s, values=values, is_late=len(channels) > 1
    )

"""Whose log it is, and how warm its IMU was, in the formats that say so."""

import math

import numpy as np
import pytest

from gtmbench.intake.formats.raw import RawLog, RawSeries
from gtmbench.intake.read import ReadLog, airframe_of, read_log, temperature_c
from tests.helpers.autopilot_logs import ardupilot, imus, px4

NUMBER = "0034002F 3235511A 34343936"


def test_ardupilots_start_up_message_tells_the_processor(tmp_path):
    path = tmp_path / "1.bin"
    path.write_bytes(
        ardupilot(imus(1, duration_s=5.0), texts=[(0.5, "ArduCopter V4.5"), (0.6, f"CubeOrange {NUMBER}")])
    )
    assert airframe_of(read_log(path)) == NUMBER


def test_px4_states_its_number(tmp_path):
    path = tmp_path / "1.ulg"
    path.write_bytes(px4(imus(1, duration_s=5.0)[0]))
    assert read_log(path).raw.hardware == ""
    assert airframe_of(read_log(path)) == tmp_path.name


@pytest.mark.parametrize(
    ("name", "values", "found"),
    [
        ("IMU.T", [41.0, 42.0, 43.0], 42.0),
        ("sensor_gyro.temperature", [31.5, 31.5], 31.5),
        ("RAW_IMU.temperature", [4150.0, 4150.0], 41.5),
        ("IMU.T", [0.0, 0.0], math.nan),
        ("IMU.GyrX", [1.0, 1.0], math.nan),
        ("IMU.T", [900.0, 900.0], math.nan),
    ],
)
def test_the_imus_temperature_is_read_where_it_is_logged(tmp_path, name, values, found):
    series = RawSeries(name=name, load=lambda: np.array(values))
    read = ReadLog(path=tmp_path / "a.bin", raw=RawLog(kind="", series=(series,)))
    assert temperature_c(read) == pytest.approx(found, nan_ok=True)

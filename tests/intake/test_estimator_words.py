"""What an estimator logs of its own opinion: gyro biases and test ratios, of PX4 and ArduPilot."""

import numpy as np
import pytest

from gtmbench.intake.estimator_words import BIAS, RATIO, estimator_words_of
from gtmbench.intake.read import read_log
from tests.helpers.autopilot_logs import ardupilot, at, imus, px4

TIME_S = np.arange(30) * 0.2
RISING = 0.1 * np.arange(30)


@pytest.fixture(scope="module")
def record():
    return imus(1, duration_s=130.0)[0].between(0.0, 6.0)


def found(path, content):
    path.write_bytes(content)
    return {(each.quantity, each.of): each for each in estimator_words_of(read_log(path))}


def test_of_ardupilot(record, tmp_path):
    rows = [(at(time_s), value, 0.5, -value, 0.2) for time_s, value in zip(TIME_S, RISING, strict=True)]
    more = {
        "XKF1": ("Qffff", "TimeUS,GX,GY,GZ,VN", rows),
        "XKF4": ("Qffff", "TimeUS,SM,SV,SH,SVT", [(*row[:3], 0.1, 0.0) for row in rows]),
    }
    words = found(tmp_path / "log.bin", ardupilot([record], more=more))
    assert words[BIAS, "r"].values == pytest.approx(-RISING, abs=1e-6)
    assert words[RATIO, "magnetometer"].values == pytest.approx(RISING, abs=1e-6)
    assert words[RATIO, "magnetometer"].time_s == pytest.approx(TIME_S, abs=1e-5)
    assert (RATIO, "airspeed") not in words  # zero throughout: no such sensor


def test_of_ardupilots_first_estimator_in_logs_of_2014_the_largest_of_a_sensors_axes(record, tmp_path):
    rows = [(at(time_s), value, 0.5, -value) for time_s, value in zip(TIME_S, RISING, strict=True)]
    tested = [(at(time_s), 0.2, value, 0.4, 0.1) for time_s, value in zip(TIME_S, RISING, strict=True)]
    more = {"EKF1": ("Qfff", "TimeUS,GX,GY,GZ", rows), "EKF4": ("Qffff", "TimeUS,SMX,SMY,SMZ,SV", tested)}
    words = found(tmp_path / "log.bin", ardupilot([record], more=more))
    assert words[BIAS, "p"].values == pytest.approx(RISING, abs=1e-6)
    assert words[BIAS, "r"].values == pytest.approx(-RISING, abs=1e-6)
    assert words[RATIO, "magnetometer"].values == pytest.approx(np.maximum(RISING, 0.4), abs=1e-6)
    assert words[RATIO, "gps velocity"].values == pytest.approx(0.1, abs=1e-6)


def test_of_px4_the_largest_of_a_sensors_axes(record, tmp_path):
    more = {
        "estimator_sensor_bias": (
            ["float[3] gyro_bias"],
            [(t, v, 0.01, 0.0) for t, v in zip(TIME_S, RISING, strict=True)],
        ),
        "estimator_innovation_test_ratios": (
            ["float[3] mag_field", "float heading"],
            [(t, 0.2, v, 0.3, 0.1) for t, v in zip(TIME_S, RISING, strict=True)],
        ),
    }
    words = found(tmp_path / "log.ulg", px4(record, more=more))
    assert words[BIAS, "p"].values == pytest.approx(np.rad2deg(RISING), rel=1e-5)
    assert words[RATIO, "magnetometer"].values == pytest.approx(np.maximum(RISING, 0.3), rel=1e-5)
    assert words[RATIO, "heading"].values == pytest.approx(np.full(30, 0.1), rel=1e-5)


@pytest.mark.parametrize(("quaternion", "is_told"), [((0.6, 0.0, 0.8, 0.0), True), ((5.0, 1.0, 0.0, 0.0), False)])
def test_of_an_old_px4_the_states_of_its_filter_and_of_no_other(record, tmp_path, quaternion, is_told):
    """Of the filter with an attitude first; another estimator has positions and velocities there."""
    zeros = (0.0,) * 6
    rows = [(t, *quaternion, *zeros, 1e-4 * v, 2e-4, -1e-4 * v, 0.0) for t, v in zip(TIME_S, RISING, strict=True)]
    more = {"estimator_status": (["float[14] states"], rows)}
    words = found(tmp_path / "log.ulg", px4(record, more=more))
    assert ((BIAS, "p") in words) == is_told
    if is_told:
        assert words[BIAS, "p"].values == pytest.approx(np.rad2deg(1e-2 * RISING), rel=1e-5)
        assert words[BIAS, "q"].values == pytest.approx(np.rad2deg(2e-2), rel=1e-5)
        assert words[BIAS, "r"].columns == ("estimator_status.states[12]",)


def test_a_log_that_tells_nothing_has_none(record, tmp_path):
    assert found(tmp_path / "log.bin", ardupilot([record])) == {}

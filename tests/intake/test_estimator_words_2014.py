"""What ArduPilot's first estimator logged of its opinion, in logs of 2014."""

import numpy as np
import pytest

from gtmbench.intake.estimator_words import BIAS, RATIO, estimator_words_of
from gtmbench.intake.read import read_log
from tests.helpers.autopilot_logs import ardupilot, at, imus


def test_biases_and_the_largest_test_ratio_of_three_axes(tmp_path):
    time_s, rising = np.arange(30) * 0.2, 0.1 * np.arange(30)
    rows = [(at(t), value, 0.5, -value) for t, value in zip(time_s, rising, strict=True)]
    tested = [(at(t), 0.2, value, 0.4, 0.1) for t, value in zip(time_s, rising, strict=True)]
    more = {"EKF1": ("Qfff", "TimeUS,GX,GY,GZ", rows), "EKF4": ("Qffff", "TimeUS,SMX,SMY,SMZ,SV", tested)}
    path = tmp_path / "log.bin"
    path.write_bytes(ardupilot([imus(1)[0].between(0.0, 6.0)], more=more))
    words = {(each.quantity, each.of): each for each in estimator_words_of(read_log(path))}
    assert words[BIAS, "p"].values == pytest.approx(rising, abs=1e-6)
    assert words[BIAS, "r"].values == pytest.approx(-rising, abs=1e-6)
    assert words[RATIO, "magnetometer"].values == pytest.approx(np.maximum(rising, 0.4), abs=1e-6)
    assert words[RATIO, "gps velocity"].values == pytest.approx(0.1, abs=1e-6)

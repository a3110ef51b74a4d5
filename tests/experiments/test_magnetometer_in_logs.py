"""The study of recorded flights with a magnetometer, on a log as ArduPilot would have written it."""

import numpy as np
import pandas as pd

import magnetometer_in_logs as study
from gtmbench.bench.magnetometer import Magnetometer, with_magnetometer
from gtmbench.values.channels import MAGNETOMETER
from tests.helpers.autopilot_logs import STEP, ardupilot, at, imus, truth


def flown(path, seed=4, duration_s=240.0):
    flight = truth(duration_s, seed)
    read = with_magnetometer(flight, flight, Magnetometer(rate_hz=10.0), seed=seed)
    rows = [
        (at(time_s), *row)
        for time_s, row in zip(read.time_s[::STEP], read.matrix(MAGNETOMETER)[::STEP].tolist(), strict=True)
    ]
    more = {"MAG": ("Qfff", "TimeUS,MagX,MagY,MagZ", rows)}
    path.write_bytes(ardupilot(imus(1, seed=seed, duration_s=duration_s), more=more))


def test_nobody_healthy_is_named_and_r_more_often_than_without(tmp_path):
    flown(tmp_path / "flight.bin")
    rows = pd.DataFrame(study.asked(tmp_path / "flight.bin"))
    assert rows["broken"].tolist() == [study.AS_IT_IS, *4 * ["r"], study.HEADING, study.COMPASS]
    assert rows["with"].iloc[0] == "nothing"
    assert not (rows["with"] == "wrong").any()
    of_r = rows[rows["broken"] == "r"]
    assert (of_r["with"] == "right").sum() >= (of_r["without"] == "right").sum()
    assert np.count_nonzero(rows["with"] == "right") >= 3
    assert int(study.summed(rows)["put"].sum()) == len(rows)


def test_a_log_without_a_magnetometer_is_left_out(tmp_path):
    (tmp_path / "flight.bin").write_bytes(ardupilot(imus(1)))
    assert list(study.asked(tmp_path / "flight.bin")) == []

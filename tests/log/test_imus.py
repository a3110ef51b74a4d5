"""Several IMUs in a log: which are there, how the gyros of each stand, and what is told of them."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.log import log_report
from gtmbench.verdict.timeline import State
from tests.helpers import intake_files as files
from tests.helpers.autopilot_logs import ardupilot, imus

GYROS, ONSET_S = ("p", "q", "r"), 80.0


def bias(channel, size=2.0):
    return gb.Bias(channel=channel, onset_s=ONSET_S, size=size)


def test_a_log_has_the_imus_that_come_often_enough(tmp_path):
    flight = imus(2)
    stamps = range(0, 100 * 10**6, 10**6)
    rarely = {"IMU3": ("Qfff", "TimeUS,GyrX,GyrY,GyrZ", [(t, 0.0, 0.0, 0.0) for t in stamps])}
    (tmp_path / "old.bin").write_bytes(ardupilot(flight, more=rarely))
    found = gb.open_log(tmp_path / "old.bin", needs=["p"]).imus
    assert [(imu.name, imu.number, imu.unit, round(imu.rate_hz)) for imu in found] == [
        ("IMU", 1, "rad/s", 10),
        ("IMU2", 2, "rad/s", 10),
    ]
    rows = [(t, i, 0.1, 0.2, 0.3) for t in range(0, 60 * 10**6, 10**5) for i in (0, 1)]
    table = {"IMU": ("QBfff", "TimeUS,I,GyrX,GyrY,GyrZ", rows)}
    (tmp_path / "new.bin").write_bytes(files.dataflash(table, units={"IMU": ("s#EEE", "F-000")}))
    assert [imu.name for imu in gb.open_log(tmp_path / "new.bin").imus] == ["IMU", "IMU#1"]
    assert found[1].mapping[0] == "p=IMU2.GyrX:rad/s"


@pytest.fixture(scope="module")
def watched(tmp_path_factory):
    """A log with two IMUs, of which the second, which nobody watches, breaks."""
    path = tmp_path_factory.mktemp("two") / "two.bin"
    path.write_bytes(ardupilot(imus(2, faults=[(1, bias("q", 4.0))])))
    return gb.watch_log(path, "C", healthy=[(0, 60)])


def test_a_log_with_two_imus_is_compared_of_its_own_accord(watched):
    assert (watched.watched_imu, watched.compared_imus) == ("IMU", ["IMU", "IMU2"])
    (alarm,) = watched.alarms
    assert alarm.verdict == "q of IMU2 failed"
    assert watched.outcome == 1


@pytest.mark.nightly
def test_report_and_json_say_which_imu(watched):
    lines = log_report(watched)
    assert any(line.startswith("IMUs: they part from 8") and "q of IMU2" in line for line in lines)
    assert lines[0].startswith("The pitch gyro (q) of IMU2 failed from 8")
    table = log_results(watched)
    assert [(each["text"], each["imu"]) for each in table["findings"]] == [("q of IMU2 failed", "IMU2")]
    assert table["imus"]["watched"] == "IMU"
    assert [imu["name"] for imu in table["log"]["imus"]] == ["IMU", "IMU2"]


def test_each_imu_has_rows_of_its_own_and_a_healthy_one_is_clear(watched):
    rows = watched.timeline.sensors
    assert {f"{gyro} of IMU2" for gyro in GYROS} <= rows.keys()
    for row in (*GYROS, "p of IMU2", "r of IMU2"):
        assert {span.state for span in rows[row]} <= {State.CLEAR, State.NOT_JUDGED}
        assert any(span.state is State.CLEAR for span in rows[row])
    (failed,) = [span for span in rows["q of IMU2"] if span.state is State.FAILED]
    assert failed.start_s == pytest.approx(ONSET_S, abs=3.0)


def test_one_whose_columns_are_in_another_unit_or_axis_is_told_and_never_accused(tmp_path):
    first, second = imus(2)
    turned = second.matrix(GYROS) @ np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    other = gb.Record(turned, channels=GYROS, sample_period_s=second.sample_period_s)
    (tmp_path / "turned.bin").write_bytes(ardupilot([first, other]))
    watched = gb.watch_log(tmp_path / "turned.bin", "auto")
    assert any("IMU2 is mounted turned by 90 deg" in line for line in watched.timeline.told)
    assert watched.outcome == 0

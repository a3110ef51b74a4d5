"""Several IMUs: which are there, who parts from whom, who is named, and that nobody is where nothing tells."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.intake.imus import Imu
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.log import log_report
from gtmbench.study.log.imu_comparison import BETWEEN, HELD, SAME, beside, channels_of, compared, further
from tests.helpers import intake_files as files
from tests.helpers.autopilot_logs import ardupilot, imus

ANGLES, GYROS = ("phi", "theta", "psi"), ("p", "q", "r")
NAMES = [Imu(name=f"IMU{n}", number=n, columns=("x", "y", "z"), unit="deg/s", rate_hz=10.0) for n in (1, 2, 3)]
HEALTHY = [(0.0, 60.0)]
ONSET_S = 80.0


def bias(channel, size=2.0):
    return gb.Bias(channel=channel, onset_s=ONSET_S, size=size)


def beside_each_other(*records):
    """Return records as one, side by side, with the first one's attitude."""
    values = np.hstack([*(each.matrix(GYROS) for each in records), records[0].matrix(ANGLES)])
    names = [name for imu in NAMES[: len(records)] for name in channels_of(imu)]
    return gb.Record(values, channels=[*names, *ANGLES], sample_period_s=records[0].sample_period_s)


def told(*faults, count=2, seed=1, driver=0):
    """Return what the comparison says: (channel or None, IMU, test)."""
    record = beside_each_other(*imus(count, faults=faults, seed=seed, driver=driver))
    comparison = compared([record], NAMES[:count], healthy=HEALTHY)
    return [(alarm.sensor, alarm.last.imu, alarm.test) for alarm in comparison.alarms], comparison


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("count", [2, 3])
def test_healthy_imus_agree(seed, count):
    assert told(count=count, seed=seed)[0] == []


@pytest.mark.parametrize("driver", [0, 1])
@pytest.mark.parametrize("liar", [0, 1])
@pytest.mark.parametrize("channel", ["p", "q"])
def test_of_two_the_liar_is_named_whoever_drives_the_estimator(channel, liar, driver):
    said, comparison = told((liar, bias(channel)), driver=driver)
    assert said == [(channel, f"IMU{liar + 1}", BETWEEN)]
    (alarm,) = comparison.alarms
    assert ONSET_S - 1.0 <= alarm.onset_s <= alarm.time_s <= ONSET_S + 9.0
    assert alarm.last.time_s >= ONSET_S + 30.0
    assert alarm.last.parameters["size"] == pytest.approx(2.0, abs=0.3)


@pytest.mark.parametrize("liar", [0, 1])
def test_of_two_headings_rates_neither_is_named(liar):
    said, comparison = told((liar, bias("r")))
    assert said == [(None, "", BETWEEN)]
    assert "which is wrong can't be told: an estimator's heading follows its gyro" in comparison.alarms[0].doubt


@pytest.mark.parametrize("liar", [0, 1, 2])
@pytest.mark.parametrize("channel", GYROS)
def test_three_vote(liar, channel):
    said, comparison = told((liar, bias(channel)), count=3)
    assert said == [(channel, f"IMU{liar + 1}", BETWEEN)]
    assert comparison.alarms[0].isolated_s <= ONSET_S + 10.0


@pytest.mark.parametrize("liar", [0, 1, 2])
def test_three_vote_out_one_that_drifts_slowly_though_a_median_would_follow_it(liar):
    slow = gb.Drift(channel="q", onset_s=65.0, slope=0.02)
    said, comparison = told((liar, slow), count=3)
    assert ("q", f"IMU{liar + 1}", BETWEEN) in said
    assert {name for channel, name, _ in said if channel} == {f"IMU{liar + 1}"}
    assert comparison.alarms[0].time_s < 130.0


def test_of_three_of_which_two_fail_none_is_named_wrong():
    said, _ = told((0, bias("p", 2.0)), (1, bias("p", -2.0)), count=3)
    assert {name for channel, name, _ in said if channel} <= {"IMU1", "IMU2"}


def test_a_gyro_that_stands_still_is_named_at_once():
    said, comparison = told((1, gb.Jam(channel="r", onset_s=ONSET_S)))
    assert ("r", "IMU2", HELD) in said
    assert next(alarm for alarm in comparison.alarms if alarm.test == HELD).time_s <= ONSET_S + 4.0


def test_at_rest_a_coarse_gyro_that_reads_one_value_is_healthy():
    """After landing, the noise of one stays below its step, and that of the others doesn't."""
    values = np.array(beside_each_other(*imus(2, seed=1)).values)
    record = beside_each_other(*imus(2, seed=1))
    rest, random = record.time_s > ONSET_S, np.random.default_rng(5)
    values[rest] = values[np.argmax(rest)]
    for name, noise in zip(record.channels[:6], [0.0] * 3 + [0.02] * 3, strict=True):
        values[rest, record.channels.index(name)] = noise * random.standard_normal(rest.sum())
    landed = gb.Record(values, channels=record.channels, sample_period_s=record.sample_period_s)
    alarms = compared([landed], NAMES[:2], healthy=HEALTHY).alarms
    assert [alarm for alarm in alarms if alarm.test == HELD] == []


@pytest.mark.parametrize("seed", [1, 2])
def test_what_was_there_when_healthy_isnt_told(seed):
    early = (1, gb.Bias(channel="p", onset_s=0.0, size=3.0))
    assert told(early, seed=seed)[0] == []


def parted(first_s, last_s, size, healthy=HEALTHY):
    """Return the doubts of what is said where the second IMU's q is off for a while."""
    first, second = imus(2, seed=3)
    off = second.matrix(GYROS).copy()
    off[(second.time_s >= first_s) & (second.time_s < last_s), 1] += size
    other = gb.Record(off, channels=GYROS, sample_period_s=second.sample_period_s, start_s=second.start_s)
    comparison = compared([beside_each_other(first, other)], NAMES[:2], healthy=healthy)
    return [alarm.last.doubt for alarm in comparison.alarms]


def test_what_vibration_aliases_for_a_second_is_no_fault():
    assert parted(80.0, 81.0, 0.6) == []
    assert len(parted(80.0, 100.0, 0.6)) == 1


def test_of_a_parting_at_the_very_beginning_the_size_is_told():
    (doubt,) = parted(4.0, 16.0, 2.0, healthy=[(40.0, 100.0)])
    assert "part by 2 deg/s" in doubt or "part by 1.9 deg/s" in doubt


def test_what_the_imus_agree_on_is_no_gyros_fault():
    """The attitude is wrong: bank C's word on the gyro is doubted, where the other reads the same."""
    drifting = [each.replace("phi", each["phi"] + 4.0 * np.maximum(each.time_s - ONSET_S, 0.0)) for each in imus(2)]
    comparison = compared([beside_each_other(*drifting)], NAMES[:2], healthy=HEALTHY)
    comparison = replace(comparison, watched=NAMES[0])
    judged = gb.Judgement(time_s=ONSET_S + 9.0, sensor="p", candidates=("p",), kind="bias")
    alarm = gb.Alarm(number=0, time_s=ONSET_S + 1.0, onset_s=ONSET_S, source="p", judgements=(judged,))
    assert comparison.alarms == ()
    assert comparison.agree(alarm)
    alone = compared([beside_each_other(*imus(2, faults=[(0, bias("p"))], driver=1))], NAMES[:2], healthy=HEALTHY)
    assert not replace(alone, watched=NAMES[0]).agree(alarm)


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
    assert watched.comparison.watched.name == "IMU"
    (alarm,) = watched.alarms
    assert alarm.verdict == "q of IMU2 failed"
    assert watched.outcome == 1


def test_report_and_json_say_which_imu(watched):
    lines = log_report(watched)
    assert any(line.startswith("IMUs: q of IMU and IMU2 part by 4") for line in lines)
    assert lines[0].startswith("The pitch gyro (q) of IMU2 failed from 8")
    table = log_results(watched)
    assert [(each["text"], each["imu"]) for each in table["findings"]] == [("q of IMU2 failed", "IMU2")]
    assert table["imus"]["watched"] == "IMU"
    assert [imu["name"] for imu in table["log"]["imus"]] == ["IMU", "IMU2"]


def test_the_banks_own_word_says_of_which_imu_it_is_and_isnt_said_twice(watched):
    judged = gb.Judgement(time_s=95.0, sensor="q", candidates=("q",), kind="bias")
    alarm = gb.Alarm(number=0, time_s=82.0, onset_s=ONSET_S, source="q", judgements=(judged,))
    watch = replace(watched.watches[0], alarms=(alarm,))
    (doubted,) = beside([watch], watched.comparison)[0].alarms
    assert doubted.doubt in (SAME, "the IMUs disagree about its axis")  # it was the other's
    own = replace(watched.comparison, watched=watched.comparison.imus[1])
    (confirmed,) = beside([watch], own)[0].alarms
    assert confirmed.verdict == "q of IMU2 failed"
    assert further([confirmed], own) == []

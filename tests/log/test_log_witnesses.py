"""Witnesses of a log, what diagnoses read beside the bank's channels: taken along where they can be had."""

import json
from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.isolation.case import WITNESSES
from gtmbench.log.opening.records import open_for
from gtmbench.log.watch import watch_log
from tests.helpers import clocked_logs as logs
from tests.helpers import intake_files as files
from tests.helpers.clocked_logs import messages, without
from tests.helpers.monitors import monitor
from tests.helpers.night import by_day

C = gb.load_bank("C")
LEAK = gb.GSensitivity(channel="p", onset_s=30.0, axis="nz", coefficient=3.0)


def leaking(record):
    return gb.inject(record, LEAK)


def sent(duration_s=50.0):
    return messages(duration_s=duration_s, gyro_hz=50, broken=leaking)


@pytest.fixture(scope="module")
def ready(tmp_path_factory):
    path = tmp_path_factory.mktemp("monitor") / "C.json"
    gb.save_monitor(monitor("C"), path)
    return path


@pytest.mark.parametrize("name", by_day(["table.csv", "log.csv", "log.ulg", "log.bin", "json.mcap"]))
def test_a_gyro_that_acceleration_leaks_into_is_told_as_that(name, cli, ready, tmp_path):
    path = tmp_path / name
    if name == "table.csv":
        gb.write_log(leaking(logs.record(2500, seed=11)), path)
    else:
        logs.write(name, sent(), tmp_path)
    code, out, err = cli("monitor", str(path), "--detector", str(ready), "--json")
    printed = json.loads(out)
    (finding,) = printed["findings"]
    assert (code, err) == (1, "")
    assert (finding["sensor"], finding["kind"], finding["partner"]) == ("p", "g_sensitivity", "nz")
    assert finding["parameters"]["coefficient"] == pytest.approx(3.0, abs=0.3)
    assert "nz" in [channel["name"] for channel in printed["log"]["channels"]]
    assert any(line.startswith("used for diagnosis only") and "nz = " in line for line in printed["log"]["method"])


@pytest.mark.nightly
def test_a_witness_may_be_mapped(cli, ready, tmp_path):
    flight = leaking(logs.record(2500, seed=11))
    frame = (
        flight.select([*C.channels, "nz"])
        .frame()
        .rename(columns={name: gb.CHANNELS[name].header for name in C.channels})
    )
    frame.rename(columns={"nz": "felt"}).to_csv(tmp_path / "log.csv")
    watch = ("monitor", str(tmp_path / "log.csv"), "--detector", str(ready), "--json")
    (alone,) = json.loads(cli(*watch)[1])["findings"]
    (told,) = json.loads(cli(*watch, "--map", "nz=felt:g")[1])["findings"]
    assert (alone["sensor"], told["sensor"]) == ("p", "p")
    assert alone["kind"] != "g_sensitivity"
    assert (told["kind"], told["partner"]) == ("g_sensitivity", "nz")


# whatever becomes of a witness, nothing else changes


def shifted(message, seconds):
    return replace(message, time_s=message.time_s + seconds)


def thinned(message, factor):
    return replace(message, time_s=message.time_s[::factor], values=message.values[::factor])


def noisy(message):
    return replace(message, time_s=message.time_s + np.random.default_rng(1).uniform(0, 0.009, len(message.time_s)))


WITNESSED = {
    "none": lambda _: None,
    "at another clock": lambda message: shifted(message, 0.0077),
    "slow": lambda message: thinned(message, 10),
    "uneven": noisy,
    "with gaps": lambda message: message.without((10.0, 14.0), (31.0, 33.0)),
    "late": lambda message: message.without((0.0, 40.0)),
    "over early": lambda message: message.without((20.0, 60.0)),
    "elsewhere": lambda message: shifted(message, 1e5),
    "a few samples": lambda message: message.without((0.2, 60.0)),
    "standing still": lambda message: replace(message, time_s=np.full(len(message.time_s), 5.0)),
    "all missing": lambda message: replace(message, values=np.full(message.values.shape, np.nan)),
}


@pytest.mark.parametrize("how", by_day(WITNESSED))
def test_a_witness_changes_no_segment_no_remark_and_no_alarm(how, tmp_path):
    given = without(sent(), "attitude", (12.0, 13.0))
    given["acceleration"] = WITNESSED[how](given["acceleration"]) or given["acceleration"].without((-1e9, 1e9))
    path, _ = logs.write("log.ulg", given, tmp_path)
    alone = gb.open_log(path, needs=C.channels)
    log = open_for(path, monitor("C"), rate_hz=50.0)
    assert log.remarks == alone.remarks
    assert [segment.channels[: len(C.channels)] for segment in log.segments] == [C.channels] * len(log.segments)
    for segment, as_it_is in zip(log.segments, alone.segments, strict=True):
        same = segment.select(C.channels)
        assert (same.start_s, same.sample_period_s) == (as_it_is.start_s, as_it_is.sample_period_s)
        np.testing.assert_array_equal(same.values, as_it_is.values)
        np.testing.assert_array_equal(same.there, as_it_is.there)
    said = [monitor("C").watch(segment).alarms for segment in log.segments]
    before = [monitor("C").watch(segment).alarms for segment in alone.segments]
    assert [(a.time_s, a.onset_s, a.source) for one in said for a in one] == [
        (a.time_s, a.onset_s, a.source) for one in before for a in one
    ]
    has = set(log.channels) & set(WITNESSES)
    assert bool(has) == (how not in ("none", "elsewhere", "a few samples", "standing still", "all missing"))


def test_a_witness_whose_clock_was_set_back_is_left_out(tmp_path):
    stamps = (np.arange(3000) * 10_000_000).tolist()
    up = [0.0, 0.0, 0.0, 1.0]
    sent = [(t, files.cdr_imu(t, [t % 7, 2, 3], [0, 0, 9.8], up)) for t in stamps]
    later = [(t, files.cdr_imu(t if t < 15 * 10**9 else t - 9 * 10**9, [1, 2, 3], [0, 0, 9.8], up)) for t in stamps]
    files.mcap(tmp_path / "log.mcap", {"/a": sent, "/b": later}, schema="sensor_msgs/msg/Imu", encoding="cdr")
    mapping = ["p=/a.angular_velocity.x", "nz=/b.linear_acceleration.z", "ny=/a.linear_acceleration.y"]
    log = gb.open_log(tmp_path / "log.mcap", mapping=mapping, needs=["p"], witnesses=["ny", "nz"])
    assert log.channels == ("p", "ny")
    assert len(log.segments) == 1


def test_of_two_that_may_be_it_none_is_a_witness(ready, tmp_path):
    flight = leaking(logs.record(2500, seed=11)).frame()
    columns = {name: gb.CHANNELS[name].header for name in C.channels}
    frame = flight[[*C.channels]].rename(columns=columns)
    frame["AccZ (g)"], frame["az [g]"] = -flight["nz"], -flight["nz"]
    frame.to_csv(tmp_path / "log.csv")
    assert watch_log(tmp_path / "log.csv", ready).log.channels == C.channels


def test_only_who_reads_witnesses_gets_them(tmp_path):
    gb.write_log(logs.record(2500, seed=11), tmp_path / "log.csv")

    class Limit(gb.SimpleDetector):
        name, channels, memory_s = "limit", ("p",), 0.0

        def learn(self, records):
            assert {record.channels for record in records} == {("p",)}
            return {"p": 1.2 * max(np.abs(record["p"]).max() for record in records)}

        def scores(self, record, learned):
            assert record.channels == ("p",)
            return {"p": np.abs(record["p"]) / learned["p"]}

    assert watch_log(tmp_path / "log.csv", Limit(), healthy=[(0.0, 25.0)]).log.channels == ("p",)


def test_witnesses_come_behind_and_a_needed_one_is_none(tmp_path):
    gb.write_log(logs.record(2500, seed=11), tmp_path / "log.csv")
    assert gb.open_log(tmp_path / "log.csv", needs=["nz", "p"], witnesses=["nz", "ny", "nx"]).channels == (
        "nz",
        "p",
        "ny",
    )


def test_a_faster_witness_is_low_passed(tmp_path):
    """What lies above half the record's rate doesn't fold into it."""
    given = messages(gyro_hz=50)
    time_s = np.arange(0, 40, 0.004)
    tone = np.column_stack([np.sin(2 * np.pi * 47 * time_s), np.sin(2 * np.pi * 5 * time_s), np.ones(len(time_s))])
    given["acceleration"] = replace(given["acceleration"], time_s=time_s, values=tone)
    path, _ = logs.write("log.ulg", given, tmp_path)
    (record,) = gb.open_log(path, needs=C.channels, witnesses=WITNESSES).segments
    known = np.isfinite(record["nx"])
    assert known.mean() > 0.97
    assert np.abs(record["nx"][known]).max() < 1e-3
    np.testing.assert_allclose(record["ny"][known], np.sin(2 * np.pi * 5 * record.time_s[known]), atol=2e-3)

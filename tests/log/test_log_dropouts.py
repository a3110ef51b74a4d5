"""Logs whose channels have clocks of their own: one that pauses while others live has dropped out; all: a gap."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from tempfile import mkdtemp

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.detectors.alarm import MISSING
from gtmbench.detectors.bank_detector import BankDetector
from gtmbench.intake.segments import Track, cut
from gtmbench.log.watch import watch_log
from gtmbench.study.healthy_records import logged_records
from gtmbench.verdict.timeline import State
from gtmbench.verdict.verdict import Outcome
from tests.helpers import clocked_logs as logs
from tests.helpers.clocked_logs import ATTITUDE, GYRO, messages, without
from tests.helpers.night import by_day

C = gb.load_bank("C")
PAUSE = (20.0, 22.0)
PERIOD_S = 0.02
ONE_BY_ONE = ["json.mcap", "log.csv", "log.parquet"]  # formats whose channels may each come alone


@cache
def monitor():
    """Return a monitor of logs like these: their noise is low-passed."""
    folder = Path(mkdtemp())
    opened = [gb.open_log(written("log.ulg", messages(seed=seed), folder)[0], needs=C.channels) for seed in (1, 2, 3)]
    return gb.calibrate([segment for log in opened for segment in log.segments], bank=C)


written = logs.write


def opened(name, sent, folder, **options):
    path, mapping = written(name, sent, folder)
    return gb.open_log(path, mapping=mapping, **{"needs": C.channels} | options)


def watched(name, sent, folder, **options):
    path, mapping = written(name, sent, folder)
    return watch_log(path, monitor(), mapping=mapping, **options)


def kinds(log):
    return {(remark.kind, remark.channel) for remark in log.remarks}


def same_time(time_s):
    return pytest.approx(time_s, abs=PERIOD_S)


# who, and when


@pytest.mark.parametrize(("message", "channels"), by_day([("gyro", GYRO), ("attitude", ATTITUDE)]))
@pytest.mark.parametrize("name", by_day(logs.FORMATS))
def test_a_message_that_pauses_while_another_lives_is_a_dropout_of_its_channels(name, message, channels, tmp_path):
    log = watched(name, without(messages(), message, PAUSE), tmp_path)
    assert log.outcome is Outcome.FAILED
    assert {(alarm.sensor, alarm.test, alarm.last.kind) for alarm in log.alarms} == {
        (channel, MISSING, "dropout") for channel in channels
    }
    assert [(alarm.onset_s, alarm.ended_s) for alarm in log.alarms] == [(same_time(20.0), same_time(22.0))] * 3
    assert {("missing", channel) for channel in channels} <= kinds(log.log)
    assert len(log.log.segments) == 1


@pytest.mark.nightly
def test_the_command_tells_it_in_words(cli, tmp_path):
    path, _ = written("log.bin", without(messages(), "gyro", PAUSE), tmp_path)
    gb.save_monitor(monitor(), tmp_path / "C.json")
    code, out, err = cli("monitor", str(path), "--detector", str(tmp_path / "C.json"), "--details")
    assert (code, err) == (1, "")
    assert "19.99 to 22.00 s  missing, p: nothing for 2.01 s while others live on; one sample every 0.01 s else" in out
    assert "20.50 s  p failed; dropout\n" in out
    assert "since about 20.00 s; named at 20.50 s; gone since 22.00 s" in out
    verdict = " ".join(out.split("\nWhy", 1)[0].split())
    assert verdict.startswith(
        "The roll gyro (p) failed from 20.0 to 22.0 s: dropout; the pitch gyro (q) failed from 20.0 to 22.0 s: "
        "dropout; the yaw gyro (r) failed from 20.0 to 22.0 s: dropout. "
    )
    assert "phi, theta, psi are clear" in verdict


@pytest.mark.parametrize("name", by_day(logs.FORMATS))
def test_a_pause_of_all_is_a_gap(name, tmp_path):
    sent = messages()
    for message in list(sent):
        sent = without(sent, message, PAUSE)
    log = watched(name, sent, tmp_path, judged=0.5)  # 40 s are little: a quarter of them lies beside gap and ends
    assert (log.outcome, log.alarms) == (Outcome.HEALTHY, ())
    for sensor in (*GYRO, *ATTITUDE):
        assert (log.timeline.at(sensor, 21.0).state, log.timeline.at(sensor, 21.0).reason) == (State.NOT_JUDGED, "gap")
        assert log.timeline.at(sensor, 13.0).state is log.timeline.at(sensor, 29.0).state is State.CLEAR
    assert [segment.values.shape[0] > 800 for segment in log.log.segments] == [True, True]
    assert ("gap", None) in kinds(log.log)
    assert "gap" in {stretch for stretch, _ in kinds(log.log)}


@pytest.mark.nightly
@pytest.mark.parametrize("name", by_day(ONE_BY_ONE))
def test_a_channel_that_comes_alone_drops_out_alone(name, tmp_path):
    sent = messages()
    gyro = sent.pop("gyro")
    sent |= {c: replace(gyro, channels=(c,), values=gyro.values[:, [i]]) for i, c in enumerate(GYRO)}
    (alarm,) = watched(name, without(sent, "q", PAUSE), tmp_path).alarms
    assert (alarm.sensor, alarm.onset_s, alarm.ended_s) == ("q", same_time(20.0), same_time(22.0))


@pytest.mark.parametrize("ending", by_day(["csv", "parquet"]))
def test_empty_cells_of_a_faster_table_are_told_as_when_they_are(ending, tmp_path):
    """100 Hz, watched at 50: the low-pass takes 13 samples more on either side."""
    flight = logs.record(4000, seed=11, period_s=0.01)
    empty = (flight.time_s >= 20.0) & (flight.time_s < 22.0)
    gb.write_log(flight.replace("p", np.where(empty, np.nan, flight["p"])), tmp_path / f"log.{ending}")
    log = watch_log(tmp_path / f"log.{ending}", monitor())
    assert [(a.sensor, a.test, a.onset_s, a.ended_s) for a in log.alarms] == [
        ("p", MISSING, same_time(20.0), same_time(22.0))
    ]


@pytest.mark.parametrize(
    ("gyro_hz", "attitude_hz"), by_day([(50, 50), (60, 50), (100, 50), (250, 50), (50, 20), (250, 10)], 2, seed=78)
)
@pytest.mark.parametrize("message", ["gyro", "attitude"])
def test_times_are_within_a_sample_at_whatever_rates(gyro_hz, attitude_hz, message, tmp_path):
    log = opened("log.ulg", without(messages(gyro_hz=gyro_hz, attitude_hz=attitude_hz), message, PAUSE), tmp_path)
    (record,), place = log.segments, {"gyro": 0, "attitude": 3}[message]
    lost = np.flatnonzero(~record.there[:, place])
    assert np.ptp(lost) == len(lost) - 1
    slack = 1.001 * record.sample_period_s
    assert record.time_s[lost[0]] == pytest.approx(20.0, abs=slack + 0.003)
    assert record.time_s[lost[-1] + 1] == pytest.approx(22.0, abs=slack + 0.003)


def test_a_slow_channel_has_not_dropped_out(tmp_path):
    log = opened("log.ulg", messages(attitude_hz=10), tmp_path, rate_hz=50)
    assert log.remarks == ()
    assert all(np.isfinite(record.values).all() for record in log.segments)


@pytest.mark.parametrize("length_s", by_day([0.03, 0.06, 0.3, 0.45], 2, seed=3))
def test_what_is_tolerated_of_missing_samples_is_tolerated_where_gyros_are_integrated(length_s, tmp_path):
    """The integral isn't known over the pause, and an interval to either side; the sensor was there."""
    sent = without(messages(gyro_hz=250), "gyro", (20.0, 20.0 + length_s))
    (record,) = opened("log.ulg", sent, tmp_path).segments
    unknown = np.isnan(record["p"])
    assert 2 <= np.count_nonzero(unknown) <= length_s / PERIOD_S + 4
    assert np.count_nonzero(~record.there[:, 0]) <= length_s / PERIOD_S + 1
    assert [alarm for alarm in monitor().watch(record).alarms if alarm.test == MISSING] == []


@pytest.mark.parametrize(("gyro_hz", "attitude_hz"), [(10, 50), (50, 50), (50, 10), (250, 50)])
def test_single_messages_that_a_log_leaves_out_are_no_dropout(gyro_hz, attitude_hz, tmp_path):
    """Every third one: values aren't known there, but the sensor lives."""
    sent = messages(gyro_hz=gyro_hz, attitude_hz=attitude_hz)
    gyro = sent["gyro"]
    kept = (np.arange(len(gyro.time_s)) % 3 > 0) | (gyro.time_s < 21.0)
    lossy = replace(gyro, time_s=gyro.time_s[kept], values=gyro.values[kept])
    (record,) = opened("log.ulg", {**sent, "gyro": lossy}, tmp_path).segments
    assert record.there.all()
    assert np.isfinite(record["phi"]).all()


# values beside a pause


@pytest.mark.parametrize("gyro_hz", [50, 60, 250])
def test_what_is_known_is_what_it_is_without_a_pause(gyro_hz, tmp_path):
    """Of the others all of it; of the paused ones what doesn't need the pause."""
    sent = messages(gyro_hz=gyro_hz)
    (whole,) = opened("log.ulg", sent, tmp_path).segments
    (record,) = opened("log.ulg", without(sent, "gyro", PAUSE), tmp_path).segments
    assert record.start_s == whole.start_s
    known = np.isfinite(record.values)
    assert known[:, 3:].all()
    far = (record.time_s < 20.0 - 0.3) | (record.time_s > 22.0 + 0.3)
    assert known[far].all()
    np.testing.assert_allclose(record.values[far], whole.values[far], atol=1e-9)
    on_clock = 60 % gyro_hz != 0  # or else splines end at the pause
    np.testing.assert_allclose(record.values[known], whole.values[known], atol=1e-5 if on_clock else 0.5)


@pytest.mark.parametrize("gyro_hz", [50, 60, 250])
def test_nothing_reaches_over_a_pause(gyro_hz, tmp_path):
    sent = without(messages(gyro_hz=gyro_hz), "gyro", PAUSE)
    gyro = sent["gyro"]
    other = replace(gyro, values=np.where(gyro.time_s[:, np.newaxis] > 21.0, 1e3 - gyro.values, gyro.values))
    before = [
        opened("log.ulg", {**sent, "gyro": each}, tmp_path).segments[0].between(1.0, 20.5).values
        for each in (gyro, other)
    ]
    np.testing.assert_allclose(before[0], before[1], atol=1e-6)


@st.composite
def pauses(draw):
    """Return up to three pauses of 0.5 to 3 s between 5 and 35 s."""
    starts = draw(st.lists(st.integers(10, 60), max_size=3, unique=True))
    return [(0.5 * start, 0.5 * start + draw(st.sampled_from([0.5, 1.0, 3.0]))) for start in starts]


flown = cache(messages)


@given(pauses(), pauses(), st.sampled_from([50, 60, 100]))
def test_records_go_on_as_long_as_anything_lives_and_tell_who_does(of_gyro, of_attitude, gyro_hz):
    sent = without(without(flown(gyro_hz=gyro_hz), "gyro", *of_gyro), "attitude", *of_attitude)
    tracks = [
        Track(channels=sent[name].channels, time_s=sent[name].time_s, values=sent[name].values)
        for name in ("gyro", "attitude")
    ]
    made = cut(tracks, breaks_s=(), rate_hz=50.0)
    for channels, message in ((GYRO, sent["gyro"]), (ATTITUDE, sent["attitude"])):
        for record in made.records:
            there = record.there[:, record.columns(channels)]
            assert (there == there[:, :1]).all()
            after = np.clip(np.searchsorted(message.time_s, record.time_s), 1, len(message.time_s) - 1)
            apart_s = message.time_s[after] - message.time_s[after - 1]
            from_edge_s = np.minimum(record.time_s - message.time_s[after - 1], message.time_s[after] - record.time_s)
            assert not there[:, 0][(apart_s > 0.06) & (from_edge_s > 1e-6)].any()
            assert there[:, 0][(apart_s < 0.03) & (record.time_s < 39.9)].all()
    dead = common(of_gyro, of_attitude)
    for record in made.records:
        assert not any(
            np.any((record.time_s > start_s + 0.03) & (record.time_s < end_s - 0.03)) for start_s, end_s in dead
        )
    lived_s = sum(len(record) * PERIOD_S for record in made.records)
    at_most_s = 40.0 - sum(end_s - start_s for start_s, end_s in dead)
    assert at_most_s - (2 * 2.6 + 2.0) * (len(dead) + 1) <= lived_s <= at_most_s + 0.1


def common(some, others):
    """Return where both pause."""
    time_s = np.arange(0, 40, 0.1)
    both = [any(a - 0.05 <= t < b - 0.05 for a, b in some) for t in time_s]
    both = np.array(both) & [any(a - 0.05 <= t < b - 0.05 for a, b in others) for t in time_s]
    edges = np.flatnonzero(np.diff(np.concatenate([[0], both, [0]])))
    return [(time_s[a], time_s[a] + 0.1 * (b - a)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


# begins and ends


def test_a_log_begins_with_its_last_channel_and_one_that_stops_has_dropped_out(tmp_path):
    sent = without(messages(), "gyro", (30.0, 41.0))
    log = watched("log.ulg", without(sent, "attitude", (0.0, 5.0)), tmp_path)
    assert log.log.segments[0].start_s == pytest.approx(5.023)
    assert "all are there from 5.003 s on, when phi, psi, theta begins" in log.log.method
    assert [(alarm.sensor, alarm.onset_s, alarm.ended_s) for alarm in log.alarms] == [
        (channel, same_time(30.0), None) for channel in GYRO
    ]


@pytest.mark.parametrize("early_s", by_day([0.1, 1.9]))
def test_who_stops_a_moment_earlier_ends_the_log(early_s, tmp_path):
    log = watched("log.ulg", without(messages(), "gyro", (40.0 - early_s, 41.0)), tmp_path)
    assert (log.alarms, log.log.remarks) == ((), ())


def test_who_is_back_late_after_a_gap_is_missing_until_then(tmp_path):
    sent = without(without(messages(), "attitude", (15.0, 17.0)), "gyro", (15.0, 21.0))
    log = watched("log.ulg", sent, tmp_path)
    assert [round(segment.start_s) for segment in log.log.segments] == [0, 17]
    assert [(alarm.sensor, round(alarm.onset_s), alarm.ended_s) for alarm in log.alarms] == [
        (channel, 17, same_time(21.0)) for channel in GYRO
    ]


def test_a_slower_rate_for_long_is_no_dropout(tmp_path):
    """Half the gyro's messages come at 5 Hz for 20 s: nothing is known of them at 50 Hz, and nothing failed."""
    sent = messages()
    gyro = sent["gyro"]
    slow = (gyro.time_s > 10.0) & (gyro.time_s < 30.0)
    kept = ~slow | (np.arange(len(gyro.time_s)) % 20 == 0)
    slower = replace(gyro, time_s=gyro.time_s[kept], values=gyro.values[kept])
    log = watched("log.ulg", {**sent, "gyro": slower}, tmp_path)
    assert log.alarms == ()
    assert [(round(segment.start_s), round(segment.end_s)) for segment in log.log.segments] == [(0, 10), (30, 40)]
    assert {kind for kind, _ in kinds(log.log)} == {"gap", "short"} or {kind for kind, _ in kinds(log.log)} == {"gap"}


# identification


@pytest.mark.nightly
def test_what_is_identified_on_is_cut_at_pauses(tmp_path):
    path, _ = written("log.ulg", without(messages(duration_s=60.0), "gyro", (20.0, 22.0), (50.0, 50.1)), tmp_path)
    records, _ = logged_records([path], BankDetector(bank=C))
    assert len(records) == 3
    assert all(np.isfinite(record.values).all() for record in records)
    log = watch_log(path, C, healthy=[(0.0, 45.0)])
    assert log.monitor.provenance["records"] == 2
    assert log.outcome is Outcome.HEALTHY


def test_where_nothing_is_left_to_identify_on_it_is_said(tmp_path):
    pauses = [(0.5 * k, 0.5 * k + 0.3) for k in range(2, 80)]
    path, _ = written("log.ulg", without(messages(), "gyro", *pauses), tmp_path)
    said = "nothing that is healthy lasts 2 s and 20 samples with every channel there"
    with pytest.raises(gb.InputError, match=said):
        watch_log(path, C, healthy=[(5.0, 25.0)])
    with pytest.raises(gb.InputError, match=rf"log\.ulg: {said}"):
        logged_records([path], BankDetector(bank=C))


def test_a_table_that_misses_samples_is_cut_as_well(tmp_path):
    flight = logs.record(3000, seed=4)
    gb.write_log(
        flight.replace("p", np.where(np.abs(flight.time_s - 25.0) < 1.0, np.nan, flight["p"])), tmp_path / "l.csv"
    )
    records, _ = logged_records([tmp_path / "l.csv"], BankDetector(bank=C))
    assert [(record.start_s, record.end_s) for record in records] == [(0.0, 24.0), (26.0, 59.98)]

"""Samples as logs have them: repeats, joined tables, rows stamped late, times in two columns, several clocks."""

from datetime import UTC, datetime

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from gtmbench.intake.contents import log_contents, log_samples, write_samples
from gtmbench.intake.delta_angle import mean_rates
from gtmbench.intake.fresh_samples import fresh_rows
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.verdict.timeline import State
from tests.helpers import intake_files as files
from tests.helpers.clocked_logs import ATTITUDE, GYRO, Message, messages, write
from tests.helpers.night import by_day
from tests.helpers.turning import quaternions

MOTION = (*GYRO, *ATTITUDE)
RATES = ("p_att", "q_att", "r_att")


def residual(record):
    """The RMS of gyros against the attitude's rates, over that of the gyros."""
    told = gb.derive(record, RATES).matrix(RATES)
    return np.sqrt(np.nanmean(np.square(record.matrix(GYRO) - told)) / np.nanmean(np.square(record.matrix(GYRO))))


def kinds(log):
    return [remark.kind for remark in log.remarks]


# gyros over the attitude's intervals


def turning(time_s, hz=3.0):
    """Pitch about level, and its rate: beyond what a low-pass for 10 Hz lets through."""
    return 5.0 * np.sin(2 * np.pi * hz * time_s), 10.0 * np.pi * hz * np.cos(2 * np.pi * hz * time_s)


def ulog(path, gyro_s, attitude_s, q_deg_s, theta_deg):
    rates = np.column_stack([np.zeros(len(gyro_s)), np.radians(q_deg_s), np.zeros(len(gyro_s))])
    angles = np.column_stack([np.zeros(len(attitude_s)), theta_deg, np.zeros(len(attitude_s))])
    topics = {
        "vehicle_angular_velocity": (["float[3] xyz"], np.column_stack([np.round(gyro_s * 1e6), rates])),
        "vehicle_attitude": (["double[4] q"], np.column_stack([np.round(attitude_s * 1e6), quaternions(angles)])),
    }
    path.write_bytes(files.ulog(topics))
    return path


@pytest.mark.parametrize("jitter_s", [0.0, 0.02])
def test_a_gyro_reads_as_the_derivative_of_a_slow_attitude_however_fast_the_motion(tmp_path, jitter_s):
    """At 3 Hz beside an attitude at 10 Hz a low-pass takes half; what is left of stamps that are uneven is a tenth."""
    rng = np.random.default_rng(5)
    gyro_s, attitude_s = np.arange(0, 30, 0.004), np.arange(0.1, 29.9, 0.1)
    attitude_s = attitude_s + rng.uniform(-jitter_s, jitter_s, len(attitude_s))
    path = ulog(tmp_path / "log.ulg", gyro_s, attitude_s, turning(gyro_s)[1], turning(attitude_s)[0])
    log = gb.open_log(path, needs=MOTION)
    (record,) = log.segments
    told = gb.derive(record, ["q_att"])["q_att"]
    left = np.nanstd(record["q"] - told) / np.nanstd(told)
    assert left < (0.002 if not jitter_s else 0.1)
    assert any(line.startswith("p, q, r: integrated over the attitude's intervals") for line in log.method)


def test_it_is_chosen_by_the_rates_and_said(tmp_path):
    for gyro_hz, attitude_hz, integrated in ((250, 50, True), (50, 50, False), (60, 50, False), (10, 50, False)):
        path, _ = write("log.ulg", messages(gyro_hz=gyro_hz, attitude_hz=attitude_hz), tmp_path)
        method = gb.open_log(path, needs=MOTION).method
        assert any("integrated over the attitude's intervals" in line for line in method) == integrated
    path, _ = write("log.ulg", messages(gyro_hz=250, attitude_hz=10), tmp_path)
    for needs, rate_hz in ((GYRO, None), (MOTION, 5.0), (MOTION, 25.0)):
        method = gb.open_log(path, needs=needs, rate_hz=rate_hz).method
        assert not any("integrated" in line for line in method)


def test_what_is_constant_stays_and_what_is_left_out_is_missing_an_interval_about():
    time_s = np.arange(0, 20, 0.02)
    uneven_s = np.arange(0, 20, 0.1) + np.random.default_rng(2).uniform(-0.03, 0.03, 200)
    means, there = mean_rates(time_s, np.full((len(time_s), 1), 7.0), uneven_s, 1.0, 0.1, 150)
    np.testing.assert_allclose(means, 7.0, rtol=1e-9)
    assert there.all()
    kept = (time_s < 8.0) | (time_s > 9.0)
    means, there = mean_rates(time_s[kept], np.ones((kept.sum(), 1)), np.arange(0, 20, 0.1), 1.0, 0.1, 150)
    at_s = 1.0 + 0.1 * np.arange(150)
    np.testing.assert_array_equal(np.isnan(means[:, 0]), (at_s > 7.89) & (at_s < 9.11))
    np.testing.assert_array_equal(there[:, 0], (at_s < 7.99) | (at_s > 9.01))


def test_a_spike_moves_readings_no_more_than_an_interval_away():
    time_s = np.arange(0, 10, 0.01)
    rates = np.zeros((1000, 1))
    rates[505] = 100.0
    means, _ = mean_rates(time_s, rates, np.arange(0, 10, 0.1), 1.0, 0.1, 80)
    moved_s = 1.0 + 0.1 * np.flatnonzero(np.abs(means[:, 0]) > 1e-9)
    np.testing.assert_allclose(moved_s, [5.0, 5.1])
    assert 0.1 * means.sum() == pytest.approx(100.0 * 0.01)


# repeats


@pytest.mark.parametrize("name", ["held samples", "hardly fresh"])
def test_repeats_are_left_out_and_said(tmp_path, name):
    made = MECHANISMS[name](0).record
    gb.write_log(made, tmp_path / "log.csv")
    log = gb.open_log(tmp_path / "log.csv", needs=MOTION)
    assert kinds(log) == ["held"]
    assert "fresh at" in log.remarks[0].text
    (record,) = log.segments
    changes = np.any(np.diff(made.matrix(ATTITUDE), axis=0) != 0, axis=1).sum()
    assert len(record) == pytest.approx(changes, abs=3)
    assert residual(record) < 0.1
    assert residual(made) > 0.8


def test_only_what_is_regular_and_of_all_axes_is_a_repeat():
    rng = np.random.default_rng(4)
    turning = np.cumsum(rng.standard_normal((4000, 3)), axis=0)
    assert fresh_rows(turning) is None
    assert fresh_rows(np.round(turning / 20.0)) is None  # coarse, and slow
    assert fresh_rows(np.column_stack([np.zeros((4000, 2)), turning[:, 0]])) is None  # two jam
    assert fresh_rows(turning[np.sort(rng.integers(0, 4000, 4000))]) is None  # at random
    for every in (2, 3, 5, 8):
        np.testing.assert_array_equal(fresh_rows(np.repeat(turning, every, axis=0)), np.arange(4000) * every)
    beat = np.arange(4000) * 2 // 5
    np.testing.assert_array_equal(np.diff(fresh_rows(turning[beat]))[:4], [3, 2, 3, 2])
    stands = np.repeat(turning, 5, axis=0)
    stands[5000:7000] = stands[5000]
    assert np.diff(fresh_rows(stands)).max() == 5  # a jam keeps its samples


# tables


def joined(sent, apart_s=0.0):
    """Rows of gyro and attitude in order of time, neither of which has the other's columns."""
    frames = []
    for place, message in enumerate((sent["gyro"], sent["attitude"])):
        columns = [gb.CHANNELS[name].header for name in message.channels]
        frames.append(pd.DataFrame(message.values, columns=columns).assign(time_s=message.time_s + place * apart_s))
    return pd.concat(frames).sort_values("time_s", kind="stable")


@pytest.mark.parametrize(("gyro_hz", "attitude_hz"), [(50, 50), (100, 50), (50, 20)])
def test_rows_of_an_outer_join_all_count(tmp_path, gyro_hz, attitude_hz):
    """Stamps 0.1 ms apart: near-equal rows once were doubles, of which the first was kept."""
    sent = messages(gyro_hz=gyro_hz, attitude_hz=attitude_hz)
    sent["attitude"] = Message(
        channels=ATTITUDE, time_s=sent["attitude"].time_s - 0.0029, values=sent["attitude"].values
    )
    joined(sent).to_csv(tmp_path / "log.csv", index=False)
    log = gb.open_log(tmp_path / "log.csv", needs=MOTION)
    (record,) = log.segments
    assert log.remarks == ()
    assert record.end_s - record.start_s > 39.8
    assert np.isfinite(record.values).all()
    assert len(log_samples(tmp_path / "log.csv", ["p"])["p"].rows) == len(sent["gyro"].time_s)


def test_a_row_that_lacks_what_its_double_holds_takes_it_over(tmp_path):
    time_s = np.arange(0, 20, 0.02) + np.random.default_rng(6).uniform(-0.006, 0.006, 1000)
    frame = pd.DataFrame({"time_s": time_s, "p_deg_s": np.sin(time_s), "q_deg_s": np.cos(time_s)})
    rows = np.arange(7, 900, 90)
    other = frame.iloc[rows].assign(time_s=time_s[rows] + 0.001, p_deg_s=np.nan)
    frame.loc[rows, "q_deg_s"] = np.nan
    pd.concat([frame, other]).sort_values("time_s").to_csv(tmp_path / "log.csv", index=False)
    log = gb.open_log(tmp_path / "log.csv", needs=["p", "q"])
    assert np.isfinite(log.segments[0].values).all()
    assert "and of 10 what it lacks from the second" in log.remarks[0].text


def test_rows_that_slipped_stand_in_the_pause_before_and_doubles_dont(tmp_path):
    time_s = np.arange(1000) * 0.02
    p = np.sin(time_s)
    slipped = time_s.copy()
    slipped[300] = time_s[301]  # double step, then none
    slipped[600:603] = time_s[603]
    pd.DataFrame({"time_s": slipped, "p_deg_s": p}).to_csv(tmp_path / "log.csv", index=False)
    log = gb.open_log(tmp_path / "log.csv", needs=["p"])
    assert kinds(log) == ["slipped"]
    (record,) = log.segments
    np.testing.assert_allclose(record["p"], p, atol=1e-12)
    p[300] = p[301]  # a row that repeats the next is a double: one was lost
    pd.DataFrame({"time_s": slipped, "p_deg_s": p}).to_csv(tmp_path / "log.csv", index=False)
    assert sorted(kinds(gb.open_log(tmp_path / "log.csv", needs=["p"]))) == ["duplicate", "slipped"]


@pytest.mark.parametrize(
    ("whole", "beyond", "per_second"),
    [("header.stamp.secs", "header.stamp.nsecs", 10**9), ("sec", "nanosec", 10**9), ("tv_sec", "tv_usec", 10**6)],
)
def test_seconds_and_what_is_beyond_them_are_one_time(tmp_path, whole, beyond, per_second):
    ticks = 1_714_564_800 * per_second + np.arange(500) * (per_second // 50)
    frame = pd.DataFrame({whole: ticks // per_second, beyond: ticks % per_second, "p_deg_s": np.arange(500.0) % 7})
    frame.to_csv(tmp_path / "log.csv", index=False)
    log = gb.open_log(tmp_path / "log.csv", needs=["p"])
    assert (log.segments[0].start_s, log.sample_period_s, len(log.segments[0])) == (0.0, 0.02, 500)
    assert any(f"columns '{whole} + {beyond}'" in line for line in log.method)
    date = datetime.fromtimestamp(1_714_564_800, UTC)
    assert any(f"since the first, {date:%Y-%m-%d %H:%M:%S}.000 UTC" in line for line in log.method)
    frame.assign(**{beyond: 5 * per_second}).to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(gb.InputError, match="isn't what is beyond the whole seconds"):
        gb.open_log(tmp_path / "log.csv", needs=["p"])


@pytest.mark.parametrize(
    "names", [("qw", "qx", "qy", "qz"), ("q0", "q1", "q2", "q3"), ("att.q[0]", "att.q[1]", "att.q[2]", "att.q[3]")]
)
def test_quaternions_of_a_table_are_angles(tmp_path, names):
    sent = messages(attitude_hz=50)["attitude"]
    frame = pd.DataFrame(quaternions(sent.values), columns=list(names)).assign(time_s=sent.time_s)
    frame.to_csv(tmp_path / "log.csv", index=False)
    log = gb.open_log(tmp_path / "log.csv", needs=ATTITUDE)
    np.testing.assert_allclose(log.segments[0].matrix(ATTITUDE)[:, :2], sent.values[:, :2], atol=1e-6)
    assert any("taken as a quaternion from body" in line for line in log.method)
    samples = log_samples(tmp_path / "log.csv", ["phi"])
    with pytest.raises(
        gb.InputError, match=f"phi is worked out of .*{names[3][-2:]}".replace("[", r"\[").replace("]", r"\]")
    ):
        write_samples(tmp_path / "log.csv", tmp_path / "out.csv", samples, {"phi": samples["phi"].values + 1.0})


def test_a_quaternion_of_ros_and_one_beside_angles_are_left_to_the_user(tmp_path):
    sent = messages(attitude_hz=50)["attitude"]
    names = [f"pose.orientation.{part}" for part in "wxyz"]
    frame = pd.DataFrame(quaternions(sent.values), columns=names).assign(time_s=sent.time_s)
    frame.to_csv(tmp_path / "log.csv", index=False)
    with pytest.raises(gb.InputError, match=r"may be of axes that point left and up \(ROS\)"):
        gb.open_log(tmp_path / "log.csv", needs=["theta"])
    mapped = ["theta=-pose.orientation(pitch):deg"]
    record = gb.open_log(tmp_path / "log.csv", needs=["theta"], mapping=mapped).segments[0]
    np.testing.assert_allclose(record["theta"], -sent.values[:, 1], atol=1e-6)
    frame.columns = ["qw", "qx", "qy", "qz", "time_s"]
    frame.assign(roll_deg=1.0 * np.arange(len(frame))).to_csv(tmp_path / "log.csv", index=False)
    assert gb.open_log(tmp_path / "log.csv", needs=["phi"]).segments[0]["phi"][5] == 5.0


# several clocks


def test_a_topic_on_another_clock_spoils_nothing(tmp_path):
    sent = messages(duration_s=20.0)
    tables = {
        name: ("Qfff", columns, [(round(t * 1e6), *row) for t, row in zip(sent[message].time_s, values, strict=True)])
        for name, columns, message, values in (
            ("IMU", "TimeUS,GyrX,GyrY,GyrZ", "gyro", np.radians(sent["gyro"].values)),
            ("ATT", "TimeUS,Roll,Pitch,Yaw", "attitude", sent["attitude"].values),
        )
    }
    of_week = [(400_000_000_000 + 200_000 * k, 100.0 + k) for k in range(100)]
    tables["GPS"] = ("Qf", "TimeUS,Alt", of_week)
    (tmp_path / "log.bin").write_bytes(files.dataflash(tables))
    log = gb.open_log(tmp_path / "log.bin")
    assert log.channels == MOTION
    assert any("altitude, 'GPS.Alt' is on another clock" in line for line in log.method)
    with pytest.raises(gb.InputError, match=r"altitude: 'GPS\.Alt' is on another clock"):
        gb.open_log(tmp_path / "log.bin", needs=["p", "altitude"])
    contents = log_contents(tmp_path / "log.bin")
    assert contents.usable == MOTION
    assert contents.span_s == pytest.approx((0.0, 19.99), abs=0.02)


@pytest.mark.parametrize("name", by_day(["held samples", "hardly fresh"]))
def test_a_gyro_that_fails_beside_a_slow_attitude_is_named_and_a_healthy_one_isnt(tmp_path, name):
    """The fault is in the log's own samples, before anything is integrated."""
    made = MECHANISMS[name](1).record
    onset_s = round(0.7 * made.end_s, 1)
    for record in (made, gb.inject(made, gb.Jam(channel="q", onset_s=onset_s))):
        gb.write_log(record, tmp_path / "log.csv")
        watched = gb.watch_log(tmp_path / "log.csv", "C", healthy=[(0.0, 0.5 * made.end_s)])
        if record is made:
            assert watched.alarms == ()
            spans = watched.timeline.of("q", State.CLEAR)  # through a slow estimator a bias in seldom samples is larger
            assert all(span.sizes.error <= watched.scope.error_deg_s for span in spans)
            continue
        (alarm,) = watched.alarms
        assert (alarm.verdict, alarm.doubt) == ("q failed", "")
        assert onset_s < alarm.time_s < onset_s + 4.0

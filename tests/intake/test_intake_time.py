"""Stamps become one even clock: exact ones untouched, others resampled; gaps are never bridged."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from tests.helpers import intake_files as files
from tests.helpers.night import by_day


def signal(time_s, highest_hz, seed=0):
    """Return a band-limited signal of unit power: 40 sines below a frequency."""
    rng = np.random.default_rng(seed)
    hz, phase = rng.uniform(0.02, highest_hz, 40), rng.uniform(0, 2 * np.pi, 40)
    return np.sin(2 * np.pi * hz[:, np.newaxis] * np.asarray(time_s) + phase[:, np.newaxis]).sum(axis=0) / np.sqrt(20)


def table(tmp_path, time_s, **columns):
    path = tmp_path / "log.csv"
    columns = {"time_s": [repr(float(t)) for t in time_s], **columns}
    rows = "\n".join(",".join(str(value) for value in row) for row in zip(*columns.values(), strict=True))
    path.write_text(f"{','.join(columns)}\n{rows}\n")
    return path


def two_topics(tmp_path, fast_s, slow_s, fast, slow):
    """Write a ULog of a gyro and an attitude (roll only), each with its own stamps."""
    half = np.radians(slow) / 2
    topics = {
        "vehicle_angular_velocity": (
            ["double[1] xyz"],
            [[round(t * 1e6), x] for t, x in zip(fast_s, fast, strict=True)],
        ),
        "vehicle_attitude": (
            ["double[4] q"],
            [[round(t * 1e6), np.cos(h), np.sin(h), 0.0, 0.0] for t, h in zip(slow_s, half, strict=True)],
        ),
    }
    path = tmp_path / "log.ulg"
    path.write_bytes(files.ulog(topics))
    return path


@pytest.mark.parametrize(("share", "tolerance"), [(0.2, 0.01), (0.3, 0.03)])
def test_uneven_stamps_are_interpolated_accurately(tmp_path, share, tolerance):
    """Jitter of 30 % of a period either way; a signal up to a share of the rate: errors below 1 % and 3 % rms."""
    rng = np.random.default_rng(2)
    time_s = (np.arange(4000) + rng.uniform(-0.3, 0.3, 4000)) * 0.01
    log = gb.open_log(table(tmp_path, time_s, p_deg_s=signal(time_s, share * 100)), rate_hz=100)
    (record,) = log.segments
    inside = record.between(1, 39)
    error = inside["p"] - signal(inside.time_s, share * 100)
    assert np.sqrt(np.mean(error**2)) < tolerance
    assert any("uneven stamps" in line for line in log.method)


def test_mixed_rates_come_at_the_slowest_through_one_low_pass(tmp_path):
    """A gyro at 250 Hz beside an attitude at 50 Hz, 3 ms later: both as they were up to 15 Hz, within 1 %."""
    fast_s, slow_s = np.arange(0, 40, 0.004), np.arange(0.003, 40, 0.02)
    loud = signal(fast_s, 15) + np.sin(2 * np.pi * 47 * fast_s)  # an alias at 3 Hz, were it not filtered
    path = two_topics(tmp_path, fast_s, slow_s, np.radians(loud), signal(slow_s, 15, seed=1))
    log = gb.open_log(path, needs=["p", "phi"])
    (record,) = log.segments
    assert record.sample_period_s == 0.02
    np.testing.assert_allclose(record["p"], signal(record.time_s, 15), atol=0.01)
    np.testing.assert_allclose(record["phi"], signal(record.time_s, 15, seed=1), atol=0.01)
    assert any("one low-pass for every channel" in line for line in log.method)
    assert any("that is the rate of phi" in line for line in log.method)


def test_who_begins_late_is_waited_for_and_who_ends_early_is_missing(tmp_path):
    fast_s, slow_s = np.arange(0, 30, 0.02), np.arange(5, 20, 0.02)
    log = gb.open_log(two_topics(tmp_path, fast_s, slow_s, fast_s, slow_s), needs=["p", "phi"])
    (record,) = log.segments
    assert (record.start_s, round(record.end_s, 2)) == (5.0, 29.98)
    assert "all are there from 5 s on, when phi begins" in log.method
    assert np.isfinite(record["p"]).all()
    np.testing.assert_array_equal(np.isfinite(record["phi"]), record.time_s < 19.99)
    (remark,) = log.remarks
    assert (remark.kind, remark.channel, round(remark.start_s, 2), round(remark.end_s, 2)) == (
        "missing",
        "phi",
        19.98,
        29.98,
    )
    assert remark.text == "nothing for 10 s while others live on; one sample every 0.02 s else"


def test_the_low_pass_keeps_the_operator_between_channels(tmp_path):
    """Beyond 15 Hz the low-pass bites, in both channels alike: their ratio stays."""
    fast_s, slow_s = np.arange(0, 40, 0.004), np.arange(0, 40, 0.02)
    hz = 18.0
    tone = [np.sin(2 * np.pi * hz * time_s) for time_s in (fast_s, slow_s)]
    path = two_topics(tmp_path, fast_s, slow_s, np.radians(tone[0]), tone[1])
    record = gb.open_log(path, needs=["p", "phi"]).segments[0]
    assert 0.5 < np.abs(record["p"]).max() < 0.99
    np.testing.assert_allclose(record["p"], record["phi"], atol=1e-3)


def test_a_slow_channel_that_sets_the_rate_alone_isnt_touched(tmp_path):
    """60 Hz beside 50 Hz: nothing is filtered, and what comes at 50 Hz stays as it is."""
    fast_s, slow_s = np.arange(0, 20, 1 / 60), np.arange(0.0, 19.9, 0.02)
    slow = signal(slow_s, 10, seed=1)
    record = gb.open_log(two_topics(tmp_path, fast_s, slow_s, np.radians(signal(fast_s, 10)), slow)).segments[0]
    np.testing.assert_allclose(record["phi"], slow[: len(record)], atol=1e-12)
    np.testing.assert_allclose(record["p"][20:-20], signal(record.time_s, 10)[20:-20], atol=0.01)


@pytest.mark.parametrize("rate_hz", [25, 40, 100, 200])
def test_a_stated_rate_is_the_records(tmp_path, rate_hz):
    time_s = np.arange(6000) * 0.01
    values = signal(time_s, 5)
    log = gb.open_log(table(tmp_path, time_s, p_deg_s=values), rate_hz=rate_hz)
    (record,) = log.segments
    assert record.sample_period_s == pytest.approx(1 / rate_hz, rel=1e-12)
    np.testing.assert_allclose(record["p"][30:-30], signal(record.time_s, 5)[30:-30], atol=2e-3)
    if rate_hz == 100:
        np.testing.assert_array_equal(record["p"], values)


@pytest.mark.parametrize("rate_hz", [60, 75, 120, 400, 1000 / 7])
def test_stamps_of_a_millisecond_are_an_even_clock(tmp_path, rate_hz):
    time_s = np.round(5 + np.arange(2000) / rate_hz, 3)
    values = np.random.default_rng(1).standard_normal(2000)
    log = gb.open_log(table(tmp_path, time_s, p_deg_s=values))
    (record,) = log.segments
    np.testing.assert_array_equal(record["p"], values)
    assert record.sample_period_s == pytest.approx(1 / rate_hz, rel=1e-6)
    assert np.abs(record.time_s - (5 + np.arange(2000) / rate_hz)).max() < 6e-4


@pytest.mark.parametrize("in_table", [True, False])
def test_a_lost_sample_is_told_by_its_neighbours_where_they_tell_it(tmp_path, in_table):
    """Of an even clock with rounded stamps: what is there stays bit for bit, whatever is lost beside it.

    What moves slowly is told within the noise; motion of 15 Hz at 60 isn't, and stays missing rather than wrong.
    """
    time_s = np.arange(1000) / 60
    rng = np.random.default_rng(1)
    slow = signal(time_s, 2) * 10 + 0.3 * rng.standard_normal(1000)
    fast = 10 * np.sin(2 * np.pi * 15 * time_s) + 0.3 * rng.standard_normal(1000)
    lost = [100, 500, 507, 900]
    kept = np.delete(np.arange(1000), lost)
    rows = np.arange(1000) if in_table else kept
    cells = [[repr(float(value)) if k in set(kept) else "" for k, value in enumerate(own)] for own in (slow, fast)]
    columns = {"p_deg_s": np.array(cells[0])[rows], "q_deg_s": np.array(cells[1])[rows]}
    (record,) = gb.open_log(table(tmp_path, np.round(time_s, 3)[rows], **columns)).segments
    for name, own in (("p", slow), ("q", fast)):
        np.testing.assert_array_equal(record[name][kept], own[kept])
    assert np.abs(record["p"][lost] - 10 * signal(time_s, 2)[lost]).max() < 1.2  # four deviations
    assert np.isnan(record["q"][lost]).all()


@pytest.mark.parametrize("rate_hz", by_day([10, 25, 50, 100, 125, 200, 250, 400, 1000], 4))
@pytest.mark.parametrize(("jitter", "loss"), [(0.0, 0.0), (0.1, 0.0), (0.0, 0.02), (0.1, 0.02)])
def test_two_sensors_that_lose_samples_are_known_nearly_throughout(tmp_path, rate_hz, jitter, loss):
    """At most 5 % of the rows lack anything, and those that are given are wrong by no more than noise.

    At 10 Hz what is lost stays missing, and is two rows where stamps jitter.
    """
    rng = np.random.default_rng(rate_hz)
    count = 30 * rate_hz
    stamps, readings = [], []
    for seed in (0, 1):
        time_s = 0.003 + (np.arange(count) + np.clip(jitter * rng.standard_normal(count), -0.5, 0.5)) / rate_hz
        time_s = time_s[rng.random(count) >= loss]
        stamps.append(time_s)
        readings.append(5 * signal(time_s, rate_hz / 50, seed) + 0.5 * rng.standard_normal(len(time_s)))
    at_s, column = np.concatenate(stamps), np.repeat([0, 1], [len(own) for own in stamps])
    order = np.argsort(at_s, kind="stable")
    cells = [
        [
            "" if k != own else repr(float(v))
            for k, v in zip(column[order], np.concatenate(readings)[order], strict=True)
        ]
        for own in (0, 1)
    ]
    wanted_hz = min(rate_hz, 100)
    path = table(tmp_path, at_s[order], p_deg_s=cells[0], q_deg_s=cells[1])
    (record,) = gb.open_log(path, rate_hz=wanted_hz).segments
    assert record.sample_period_s == pytest.approx(1 / wanted_hz)
    share = 0.95 if rate_hz > 10 or not loss else 0.90
    assert np.isfinite(record.values).all(axis=1).sum() >= share * (30 - 0.3) * wanted_hz
    for seed, name in enumerate("pq"):
        error = record[name] - 5 * signal(record.time_s, rate_hz / 50, seed)
        error = error[np.isfinite(error)]
        assert np.sqrt(np.mean(error**2)) < 0.6
        assert np.abs(error).max() < 6 * 0.5


def test_stamps_rounded_to_seconds_are_spread_evenly(tmp_path):
    values = np.random.default_rng(1).standard_normal(3000)
    log = gb.open_log(table(tmp_path, np.floor(np.arange(3000) * 0.01), p_deg_s=values))
    (record,) = log.segments
    assert record.sample_period_s == 0.01
    np.testing.assert_array_equal(record["p"], values)
    assert [remark.kind for remark in log.remarks] == ["duplicate"]


def stretches(draw):
    """Return which samples of an even clock are kept: holes of 3 to 300 samples between stretches of 250 to 600."""
    kept, at = [], 0
    for _ in range(draw(st.integers(1, 4))):
        long = draw(st.integers(250, 600))
        kept.append(np.arange(at, at + long))
        at += long + draw(st.integers(3, 300))
    return kept


@pytest.mark.nightly
@given(st.data(), st.booleans())
def test_no_gap_is_bridged(tmp_path_factory, data, jitter):
    """No sample of any segment lies inside a hole of three samples or more; all holes are remarked with their times."""
    kept = stretches(data.draw)
    time_s = np.concatenate(kept) * 0.01
    if jitter:
        time_s = time_s + np.random.default_rng(len(time_s)).uniform(-0.002, 0.002, len(time_s))
    path = table(tmp_path_factory.mktemp("log"), time_s, p_deg_s=signal(time_s, 5))
    log = gb.open_log(path)
    assert len(log.segments) == len(kept)
    holes = [(before[-1] * 0.01, after[0] * 0.01) for before, after in pairwise(kept)]
    for record, part in zip(log.segments, kept, strict=True):
        assert record.start_s >= part[0] * 0.01 - 0.002001
        assert record.end_s <= part[-1] * 0.01 + 0.002001
        assert np.isfinite(record["p"]).mean() > 0.95
        assert record.sample_period_s == log.sample_period_s
    gaps = [remark for remark in log.remarks if remark.kind == "gap"]
    assert len(gaps) == len(holes)
    for remark, (start_s, end_s) in zip(gaps, holes, strict=True):
        assert (remark.start_s, remark.end_s) == (pytest.approx(start_s, abs=0.003), pytest.approx(end_s, abs=0.003))


def test_a_pause_of_one_topic_is_missing_and_one_of_both_a_gap(tmp_path):
    fast_s, slow_s = np.arange(0, 30, 0.004), np.arange(0, 30, 0.02)
    fast_s = fast_s[((fast_s < 10) | (fast_s > 12)) & ((fast_s < 25) | (fast_s > 26))]
    slow_s = slow_s[((slow_s < 20) | (slow_s > 20.5)) & ((slow_s < 24.9) | (slow_s > 26.1))]
    log = gb.open_log(two_topics(tmp_path, fast_s, slow_s, fast_s, slow_s), rate_hz=50, needs=["p", "phi"])
    spans = [(remark.kind, remark.channel, round(remark.start_s, 1), round(remark.end_s, 1)) for remark in log.remarks]
    assert spans == [
        ("missing", "p", 10.0, 12.0),
        ("missing", "phi", 20.0, 20.5),
        ("gap", None, 24.9, 26.1),
        ("gap", None, 25.0, 26.0),
    ]
    first, second = log.segments
    assert first.end_s < 24.9
    assert second.start_s > 26.1
    lost = [first.time_s[np.isnan(first[name])] for name in ("p", "phi")]
    assert [(round(times[0], 1), round(times[-1], 1)) for times in lost] == [
        (9.7, 12.3),
        (19.7, 20.8),
    ]  # the low-pass's
    missing = [first.time_s[~first.there[:, column]] for column in (0, 1)]
    assert [(round(times[0], 1), round(times[-1], 1)) for times in missing] == [(10.0, 12.0), (20.0, 20.5)]


def test_a_heading_is_unwrapped_before_it_is_interpolated(tmp_path):
    """A turn at 40 deg/s, headings at 5 Hz beside a gyro at 50 Hz: no sample between 0 and 360 is made."""
    time_s = np.arange(3000) * 0.02
    headings = [repr(float(value)) if k % 10 == 0 else "" for k, value in enumerate((350 + 40 * time_s) % 360)]
    log = gb.open_log(table(tmp_path, time_s, p_deg_s=time_s, heading_deg=headings), rate_hz=50)
    (record,) = log.segments
    np.testing.assert_allclose(record["psi"], 350 + 40 * record.time_s, atol=1e-6)


def test_headings_go_on_beyond_a_gap(tmp_path):
    time_s = np.delete(np.arange(2000) * 0.01, np.arange(900, 910))
    log = gb.open_log(table(tmp_path, time_s, psi_rad=np.radians((170 + 20 * time_s + 180) % 360 - 180)))
    assert len(log.segments) == 2
    for record in log.segments:
        np.testing.assert_allclose(record["psi"], 170 + 20 * record.time_s, atol=1e-9)


def test_a_clock_that_was_set_back_starts_a_segment_that_is_dated_later(tmp_path):
    time_s = np.arange(2000) * 0.01
    set_back = np.where(time_s < 12, time_s, time_s - 7.5)
    log = gb.open_log(table(tmp_path, set_back, p_deg_s=time_s))
    first, second = log.segments
    assert (first.start_s, round(first.end_s, 6), len(second)) == (0.0, 11.99, 800)
    (remark,) = log.remarks
    assert (remark.kind, remark.start_s, remark.end_s) == ("clock jump", 11.99, second.start_s)
    assert second.start_s == 4.5 + 9
    assert "went back from 11.99 to 4.5 s: what follows is dated 9 s later" in remark.text
    np.testing.assert_allclose(second["p"], second.time_s - 9 + 7.5, atol=1e-9)


def test_clocks_that_were_set_back_differently_are_refused(tmp_path):
    stamps = (np.arange(3000) * 10_000_000).tolist()
    set_back = [t if t < 15 * 10**9 else t - 9 * 10**9 for t in stamps]
    imu = [
        (t, files.cdr_imu(measured, [1, 2, 3], [0, 0, 9.8], [0, 0, 0, 1]))
        for t, measured in zip(stamps, set_back, strict=True)
    ]
    other = [(t, files.cdr_imu(t, [1, 2, 3], [0, 0, 9.8], [0, 0, 0, 1])) for t in stamps]
    path = tmp_path / "log.mcap"
    files.mcap(path, {"/a": imu, "/b": other}, schema="sensor_msgs/msg/Imu", encoding="cdr")
    mapping = ["p=/a.angular_velocity.x", "q=/b.angular_velocity.y"]
    with pytest.raises(gb.InputError, match=r"clocks were set back differently \(/a 1 times, /b 0 times\)"):
        gb.open_log(path, mapping=mapping, needs=["p", "q"])


@pytest.mark.nightly
@given(st.lists(st.integers(10, 980), min_size=1, max_size=8, unique=True), st.integers(2, 6))
def test_rows_that_came_late_are_sorted_in(tmp_path_factory, places, late):
    """However rows are shuffled over a few places, the record is that of the rows in order."""
    values = np.random.default_rng(1).standard_normal(1000)
    order = np.arange(1000)
    for place in places:
        block = order[place : place + late].copy()
        order[place : place + late] = np.roll(block, 1)
    path = table(tmp_path_factory.mktemp("log"), (order * 0.01), p_deg_s=values[order])
    log = gb.open_log(path)
    (record,) = log.segments
    np.testing.assert_array_equal(record["p"], values)
    assert {remark.kind for remark in log.remarks} == {"out of order"}


def test_stray_and_doubled_stamps_are_left_out(tmp_path):
    time_s = np.arange(1500) * 0.01
    values = np.random.default_rng(1).standard_normal(1500)
    rows = np.insert(np.arange(1500), 700, 700)  # logged twice
    stamps = time_s[rows]
    stamps[[300, 1200]] = [1e12, 0.0]
    stamps = [t if k != 1000 else np.nan for k, t in enumerate(stamps)]
    log = gb.open_log(table(tmp_path, stamps, p_deg_s=values[rows]))
    (record,) = log.segments
    kept = np.delete(np.arange(1500), [300, 999, 1199])
    np.testing.assert_array_equal(record["p"][kept], values[kept])
    remarks = [(remark.kind, round(remark.start_s, 2)) for remark in log.remarks]
    assert remarks == [("missing", 0.0), ("clock jump", 2.99), ("duplicate", 7.0), ("clock jump", 11.98)]


def test_a_far_jump_forward_is_a_jump_of_the_clock(tmp_path):
    time_s = np.arange(1000) * 0.01 + np.where(np.arange(1000) < 500, 0, 1e6)
    log = gb.open_log(table(tmp_path, time_s, p_deg_s=time_s % 10.0))
    assert [record.start_s for record in log.segments] == [0.0, 1_000_005.0]
    (remark,) = log.remarks
    assert (remark.kind, round(remark.start_s, 2), remark.end_s) == ("clock jump", 4.99, 1_000_005.0)


def test_what_is_too_short_is_dropped_and_said(tmp_path):
    time_s = np.delete(np.arange(2000) * 0.01, np.r_[500:600, 700:800])
    log = gb.open_log(table(tmp_path, time_s, p_deg_s=time_s))
    assert [round(record.start_s, 2) for record in log.segments] == [0.0, 8.0]
    (short,) = (remark for remark in log.remarks if remark.kind == "short")
    assert (short.start_s, round(short.end_s, 2)) == (6.0, 6.99)


def test_nothing_that_is_long_enough_is_refused(tmp_path):
    with pytest.raises(gb.InputError, match="no stretch of 2 s and 20 samples at 100 Hz"):
        gb.open_log(table(tmp_path, np.arange(150) * 0.01, p_deg_s=np.arange(150)))
    with pytest.raises(gb.InputError, match="time stands still or jumps: 0 of 149 steps go forward"):
        gb.open_log(table(tmp_path, np.ones(150), p_deg_s=np.arange(150)))
    with pytest.raises(gb.InputError, match="is this the column that tells the time"):
        gb.open_log(table(tmp_path, np.random.default_rng(1).random(150), p_deg_s=np.arange(150)))
    with pytest.raises(gb.InputError, match="rate_hz is -1"):
        gb.open_log(table(tmp_path, np.arange(150) * 0.01, p_deg_s=np.arange(150)), rate_hz=-1)
    with pytest.raises(gb.InputError, match=r"would be .* values; at most"):
        gb.open_log(table(tmp_path, np.arange(3000) * 0.1, p_deg_s=np.arange(3000)), rate_hz=1e6)

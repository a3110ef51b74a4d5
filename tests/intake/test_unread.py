"""Nothing of a log is silently dropped: segments and unread spans cover it, and each unread span says why."""

import re
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
from tests.helpers.night import by_day

CHANNELS = ("p", "q", "r", "phi", "theta", "psi")
PERIOD_S = 0.02
NAMES = {"gyro": ["p_deg_s", "q_deg_s", "r_deg_s"], "attitude": ["phi_deg", "theta_deg", "psi_deg"]}
PHRASE = (
    r"gap|clock jump|clock set back|too short between gaps|margin of the resampling"
    r"|(\S+: )?samples come at [\d.]+ Hz instead of [\d.]+|(gyros|attitude)( and (gyros|attitude))? "
    r"(not logged yet|not logged any more|paused)"
)


def even(end_s, period_s=PERIOD_S):
    return np.arange(0.0, end_s, period_s)


def left_out(time_s, *spans):
    inside = np.zeros(len(time_s), dtype=bool)
    for start_s, end_s in spans:
        inside |= (time_s > start_s) & (time_s < end_s)
    return time_s[~inside]


def slower(time_s, start_s, end_s, every):
    rows = np.arange(len(time_s))
    return time_s[(time_s < start_s) | (time_s > end_s) | (rows % every == 0)]


def opened(folder, gyro_s, attitude_s=None, **how):
    """Open a log of two tables, or of one whose channels share their stamps."""
    folder.mkdir(exist_ok=True)
    stamps = {"gyro": gyro_s, "attitude": attitude_s}
    tables = {
        name: pd.DataFrame({column: np.sin(time_s * (1.0 + 0.1 * place)) for place, column in enumerate(NAMES[name])})
        for name, time_s in stamps.items()
        if time_s is not None
    }
    for name, table in tables.items():
        table.insert(0, "time_s", stamps[name])
        table.to_csv(folder / f"{name}.csv", index=False)
    path = folder if len(tables) > 1 else folder / "gyro.csv"
    return gb.open_log(path, needs=CHANNELS if len(tables) > 1 else CHANNELS[:3], **how)


def check_covered(log, first_s, last_s, tolerance_s):
    """Check that what is read and what isn't follow each other from a log's first sample to its last."""
    spans = [(each.start_s, each.end_s) for each in log.segments] + [(each.start_s, each.end_s) for each in log.unread]
    spans.sort()
    assert spans[0][0] == pytest.approx(first_s, abs=tolerance_s)
    assert spans[-1][1] == pytest.approx(last_s, abs=tolerance_s)
    assert log.span_s == (spans[0][0], spans[-1][1])
    for (start_s, end_s), (next_s, _) in pairwise(spans):
        assert start_s < end_s
        assert -1e-6 <= next_s - end_s <= tolerance_s
    for each in log.unread:
        assert re.fullmatch(PHRASE, each.reason), each.reason


def random_stamps(rng, length_s, period_s):
    """Return stamps with a few of all that happens to logs."""
    time_s = even(length_s, period_s)
    start_s, end_s = sorted(rng.uniform(0.0, length_s, 2))
    happenings = [
        lambda at_s: slower(at_s, start_s, length_s, int(rng.integers(4, 12))),
        lambda at_s: slower(at_s, 0.0, min(start_s, length_s / 3), int(rng.integers(4, 12))),
        lambda at_s: slower(at_s, start_s, min(end_s, start_s + length_s / 4), int(rng.integers(4, 12))),
        lambda at_s: left_out(at_s, *((s, s + rng.uniform(0.1, 4.0)) for s in rng.uniform(0.0, length_s, 5))),
        lambda at_s: at_s[at_s > rng.uniform(0.0, length_s / 3)],
        lambda at_s: at_s[at_s < rng.uniform(0.7 * length_s, length_s)],
        lambda at_s: left_out(at_s, *((s, s + 1.0) for s in np.arange(start_s, min(start_s + 20.0, length_s), 1.5))),
        lambda at_s: at_s[rng.uniform(size=len(at_s)) > 0.02],
        lambda at_s: np.sort(at_s + rng.uniform(-0.2, 0.2, len(at_s)) * period_s),
    ]
    for which in rng.permutation(len(happenings))[: rng.integers(0, 5)]:
        time_s = happenings[which](time_s)
    return time_s


@pytest.mark.parametrize("seed", by_day(range(60), 8, seed=78))
def test_segments_and_unread_spans_cover_a_log(tmp_path, seed):
    rng = np.random.default_rng(seed)
    gyro_s, attitude_s = (random_stamps(rng, 90.0, period_s) for period_s in rng.choice([0.01, 0.02, 0.04], 2))
    attitude_s = None if seed % 3 == 0 else attitude_s
    stamps = gyro_s if attitude_s is None else np.concatenate([gyro_s, attitude_s])
    try:
        log = opened(tmp_path / "log", gyro_s, attitude_s)
    except gb.InputError as error:
        assert "no stretch of" in str(error)  # noqa: PT017  some leave nothing that is long enough
        return
    check_covered(log, stamps.min(), stamps.max(), 1.5 * log.sample_period_s)


BURSTS_S = np.concatenate([even(30.0), *(40.0 + 3.0 * burst + even(1.0) for burst in range(40))])
CASES = {  # stamps of the gyros, of the attitude, and what isn't read
    "all of it": (even(60.0), None, []),
    "rate falls": (slower(even(100.0), 60.0, 100.0, 5), None, [(60.0, 100.0, "samples come at 10 Hz instead of 50")]),
    "rate rises": (slower(even(100.0), 0.0, 30.0, 5), None, [(0.0, 30.0, "samples come at 10 Hz instead of 50")]),
    "one's rate falls": (
        even(99.92),
        slower(even(100.0), 60.0, 100.0, 5),
        [(60.0, 99.9, "attitude: samples come at 10 Hz instead of 50")],
    ),
    "a gap": (left_out(even(60.0), (20.0, 24.0)), None, [(20.0, 24.0, "gap")]),
    "a clock that jumps": (
        np.where(even(60.0) > 30.0, even(60.0) + 7200.0, even(60.0)),
        None,
        [(30.0, 7230.0, "clock jump")],
    ),
    "a late attitude": (even(60.0), even(60.0)[1000:], [(0.0, 20.0, "attitude not logged yet")]),
    "late gyros": (even(60.0)[1000:], even(60.0), [(0.0, 20.0, "gyros not logged yet")]),
    "a burst": (
        left_out(even(60.0), (30.0, 34.0), (35.0, 40.0)),
        None,
        [(30.0, 34.0, "gap"), (34.0, 35.0, "too short between gaps"), (35.0, 40.0, "gap")],
    ),
    "an attitude that ends": (even(60.0), even(59.0), [(58.98, 59.98, "attitude not logged any more")]),
}


@pytest.mark.parametrize("case", by_day(CASES, 5, seed=78))
def test_what_is_not_read_is_said_with_its_reason(tmp_path, case):
    gyro_s, attitude_s, expected = CASES[case]
    log = opened(tmp_path / "log", gyro_s, attitude_s)
    assert [each.reason for each in log.unread] == [reason for *_, reason in expected]
    for each, (start_s, end_s, _) in zip(log.unread, expected, strict=True):
        assert (each.start_s, each.end_s) == pytest.approx((start_s, end_s), abs=0.25)


def test_every_gap_is_there_however_many_remarks_are_summed_up(tmp_path):
    log = opened(tmp_path / "log", BURSTS_S)
    reasons = [each.reason for each in log.unread]
    assert reasons.count("too short between gaps") == 40
    assert reasons.count("gap") == 40
    assert len(log.remarks) < 40


def test_a_clock_that_is_set_back_leaves_a_hole_that_says_so(tmp_path):
    log = opened(tmp_path / "log", np.concatenate([even(60.0) + 500.0, even(60.0)]))
    assert [each.reason for each in log.unread] == ["clock set back"]
    check_covered(log, 500.0, log.segments[-1].end_s, 1.5 * PERIOD_S)


def test_the_samples_that_a_filter_costs_are_not_read(tmp_path):
    log = opened(tmp_path / "log", even(60.0, 0.005), even(60.0, 0.05), rate_hz=10.0)
    assert [each.reason for each in log.unread] == ["margin of the resampling"] * 2
    check_covered(log, 0.0, 59.995, 0.15)


@pytest.mark.parametrize("rate_hz", [None, 10.0])
def test_every_channel_has_the_period_of_its_own_samples(tmp_path, rate_hz):
    log = opened(tmp_path / "log", even(60.0, 0.005), even(60.0, 0.05), rate_hz=rate_hz)
    assert set(log.periods_s) == set(log.channels)
    for name, period_s in log.periods_s.items():
        assert period_s == pytest.approx(0.005 if name in CHANNELS[:3] else 0.05)
    assert {source.channel: source.period_s for source in log.sources if source.channel != "time"} == log.periods_s


def test_sensors_beside_have_a_period_too(tmp_path):
    rows = np.arange(3000)
    path = tmp_path / "log.csv"
    every = {"time_s": PERIOD_S * rows, "p_deg_s": np.sin(rows), "nx_g": np.cos(rows)}
    pd.DataFrame({**every, "nz_g": np.where(rows % 5 == 0, np.cos(rows), np.nan)}).to_csv(path, index=False)
    log = gb.open_log(path, needs=["p"], witnesses=["nx", "nz"])
    assert log.channels == ("p", "nx", "nz")
    assert log.periods_s == pytest.approx({"p": PERIOD_S, "nx": PERIOD_S, "nz": 5 * PERIOD_S})

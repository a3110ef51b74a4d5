"""The exported C says what Python's stream says: every statistic, every first alarm, whatever the readings lack."""

import ctypes
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.calibrated import bank_residuals
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.export.write import statistics_of
from studies.compiled import Compiled, compiler
from tests.helpers.monitors import monitor, record
from tests.helpers.night import by_day

pytestmark = pytest.mark.skipif(compiler() is None, reason="no C compiler")
ONSET_S = 90.0
FAULTS = {
    "none": None,
    "bias": gb.Bias(channel="q", onset_s=ONSET_S, size=1.0),
    "jam": gb.Jam(channel="p", onset_s=ONSET_S),
    "drift": gb.Drift(channel="r", onset_s=ONSET_S, slope=0.2),
    "noise": gb.Noise(channel="q", onset_s=ONSET_S, deviation=1.5),
    "angle": gb.Bias(channel="psi", onset_s=ONSET_S, size=8.0),
    "spikes": gb.Spikes(channel="r", onset_s=ONSET_S, size=30.0, rate_hz=0.3),
    "huge": gb.Bias(channel="p", onset_s=ONSET_S, size=1e7),
}
HOLES = ("whole", "single samples", "long holes", "a channel")


@pytest.fixture(scope="module")
def boards(tmp_path_factory):
    """Return the exported monitor compiled, by bank and variant."""

    @cache
    def made(bank, variant):
        aside = tmp_path_factory.mktemp("board")
        exported = gb.export_c(monitor(bank), aside / "c", compact=variant == "compact")
        return Compiled(exported.folder, exported.board, aside)

    return made


def readings(fault, holes, seed):
    """Return what sensors read: a made-up flight of 120 s at 50 Hz, broken, and with samples missing."""
    read = record(seed=seed)
    broken = read if FAULTS[fault] is None else gb.inject(read, FAULTS[fault])
    values, draw = (
        broken.matrix(("p", "q", "r", "phi", "psi", "theta")).astype(np.float32).astype(float),
        np.random.default_rng(seed),
    )
    if holes == "single samples":
        values[draw.random(values.shape) < 0.001] = np.nan
    elif holes == "long holes":
        for begin in draw.integers(1300, 5800, 4):
            values[begin : begin + draw.integers(2, 60)] = np.nan
    elif holes == "a channel":
        values[2000:2400, draw.integers(6)] = np.nan
    return gb.Record(values, channels=("p", "q", "r", "phi", "psi", "theta"), sample_period_s=read.sample_period_s)


def first_alarm(alarms, period_s):
    return [(round(alarm.time_s / period_s), alarm.output) for alarm in alarms][:1]


def first_of(told, board):
    rows = np.flatnonzero(told.alarms)[:1].tolist()
    return [
        (row, next(each.output for j, each in enumerate(board.residuals) if told.alarms[row] >> j & 1)) for row in rows
    ]


def compared(told, board, calibrated, broken):
    """Return how far statistics of the C are from Python's, where both have them, and how many only one has."""
    residuals, pairs, lonely = bank_residuals(calibrated, broken).raw, [], 0
    for j, each in enumerate(board.residuals):
        expected = statistics_of(calibrated, board, each.output, residuals[each.output])
        known = told.statistics[each.ahead :, j]
        expected, judged = expected[: len(known)], told.backlog[each.ahead :] == 0
        there = judged & np.isfinite(expected).any(axis=(1, 2))
        both = np.isfinite(known) & np.isfinite(expected) & there[:, None, None]
        lonely += int((np.isfinite(known) != np.isfinite(expected))[there].sum())
        pairs.append((known[both], expected[both]))
    known, expected = (np.concatenate(side) for side in zip(*pairs, strict=True))
    return np.abs(known - expected) / np.maximum(expected, 1.0), lonely


@pytest.mark.parametrize("holes", by_day(HOLES))
@pytest.mark.parametrize("fault", by_day(FAULTS))
def test_full_says_what_python_says(boards, fault, holes):
    seed = 100 + 7 * list(FAULTS).index(fault) + HOLES.index(holes)
    board, calibrated, broken = boards("C", "full"), monitor(), readings(fault, holes, seed)
    told = board.run(broken.values)
    residuals = bank_residuals(calibrated, broken).raw
    for j, each in enumerate(board.board.residuals):
        expected = residuals[each.output][: len(broken) - each.ahead]
        is_there = np.isfinite(expected)
        np.testing.assert_array_equal(np.isfinite(told.residuals[each.ahead :, j]), is_there)
        off = np.abs(told.residuals[each.ahead :, j] - expected)[is_there] / np.maximum(np.abs(expected[is_there]), 1.0)
        assert off.max() < 2e-4
    off, lonely = compared(told, board.board, calibrated, broken)
    assert len(off) > 10_000
    assert lonely == 0
    # spikes raise one suspicion after the other, and each takes out blocks: Python remembers more of them
    assert np.quantile(off, 0.999) < (0.12 if fault == "spikes" else 0.02)
    assert off.max() < 0.3
    assert first_of(told, board.board) == first_alarm(bank_alarms(calibrated, broken), broken.sample_period_s)


@pytest.mark.parametrize("fault", by_day(FAULTS))
def test_compact_is_a_few_samples_off_at_most(boards, fault):
    board, broken = boards("C", "compact"), readings(fault, "whole", 300 + list(FAULTS).index(fault))
    told = board.run(broken.values)
    off, _ = compared(told, board.board, monitor(), broken)
    assert np.quantile(off, 0.99) < (0.15 if fault == "spikes" else 0.05)
    is_, meant = first_of(told, board.board), first_alarm(bank_alarms(monitor(), broken), broken.sample_period_s)
    assert [name for _, name in is_] == [name for _, name in meant]
    assert all(abs(row - python) <= 5 for (row, _), (python, _) in zip(is_, meant, strict=True))


@pytest.mark.nightly
@pytest.mark.parametrize("compact", by_day([False, True]))
@pytest.mark.parametrize("rate_hz", by_day([10, 25, 200]))
def test_other_rates_and_noise_of_another_level_and_tail(tmp_path, rate_hz, compact):
    period_s = 1.0 / rate_hz
    flights = [record(samples=100 * rate_hz, seed=seed, period_s=period_s) for seed in (1, 2, 3)]
    calibrated = gb.calibrate(flights, bank=gb.load_bank("C"))
    exported = gb.export_c(calibrated, tmp_path / "c", compact=compact)
    board, draw = Compiled(exported.folder, exported.board, tmp_path), np.random.default_rng(rate_hz)
    read = record(samples=90 * rate_hz, seed=40 + rate_hz, period_s=period_s)
    values = read.matrix(exported.board.channels).copy()
    gyros = [exported.board.channels.index(name) for name in "pqr"]
    values[:, gyros] += 0.3 * draw.standard_t(3, (len(values), 3))
    values[65 * rate_hz :, exported.board.channels.index("q")] += 3.0
    values[draw.integers(25 * rate_hz, 60 * rate_hz, 5), gyros[2]] = np.nan
    values = values.astype(np.float32).astype(float)
    broken = gb.Record(values, channels=exported.board.channels, sample_period_s=period_s)
    told = board.run(values)
    off, lonely = compared(told, exported.board, calibrated, broken)
    assert len(off) > 200 * rate_hz
    assert lonely == 0
    assert np.quantile(off, 0.999) < (0.08 if compact else 0.03)
    is_, meant = first_of(told, exported.board), first_alarm(bank_alarms(calibrated, broken), period_s)
    assert [name for _, name in is_] == [name for _, name in meant] == ["q"]
    assert abs(is_[0][0] - meant[0][0]) <= (5 if compact else 1)


@pytest.mark.nightly
def test_early_residuals_are_exported_as_well(boards):
    board, calibrated, broken = boards("C-early", "full"), monitor("C-early"), readings("bias", "single samples", 5)
    told = board.run(broken.values)
    off, lonely = compared(told, board.board, calibrated, broken)
    assert lonely == 0
    assert np.quantile(off, 0.999) < 0.02
    assert first_of(told, board.board) == first_alarm(bank_alarms(calibrated, broken), broken.sample_period_s)


def test_isolation_is_that_of_the_structure(boards):
    board, bits = boards("C", "full"), {"p": 1, "q": 2, "r": 4, "phi": 8, "psi": 16, "theta": 32}
    angles = bits["phi"] | bits["psi"] | bits["theta"]
    gyro = board.run(readings("bias", "whole", 1).values)
    alarm = np.flatnonzero(gyro.alarms)[0]
    assert (gyro.above[alarm], gyro.possible[alarm], gyro.involved[alarm]) == (
        2,
        bits["q"] | angles,
        bits["q"] | angles,
    )
    told = board.run(readings("angle", "whole", 1).values)
    several = [row for row in np.flatnonzero(told.above) if bin(told.above[row]).count("1") > 1]
    assert several
    assert {told.possible[row] for row in several} == {angles}  # no gyro alone explains two residuals
    quiet = np.flatnonzero(told.above == 0)
    assert not told.possible[quiet].any()


def test_a_channel_that_goes_missing_is_told_when_python_tells_it(boards):
    board, broken = boards("C", "full"), readings("none", "a channel", 9)
    alarm = next(alarm for alarm in monitor().watch(broken).alarms if alarm.test == "missing")
    told = board.run(broken.values)
    bit = 1 << broken.channels.index(alarm.source)
    changes = np.flatnonzero(np.diff((told.missing & bit) > 0)) + 1
    assert told.missing.max() == bit
    assert changes.tolist() == [round(time_s / broken.sample_period_s) for time_s in (alarm.time_s, alarm.end_known_s)]


def test_rows_of_time(boards):
    """A row left out is a row of NaN; late and doubled ones change nothing; a clock that is off adds up to nothing."""
    board, broken = boards("C", "full"), readings("bias", "single samples", 11)
    period_us, rows = round(broken.sample_period_s * 1e6), len(broken)
    even = 50_000_000 + np.arange(rows) * period_us
    holes = np.array([1500, 2000, 2001, 2002, 3000])
    gone = broken.values.copy()
    gone[holes] = np.nan
    kept = np.setdiff1d(np.arange(rows), holes)
    meant = board.run(gone, times_us=even)
    left_out = board.run(gone[kept], times_us=even[kept])
    np.testing.assert_array_equal(left_out.statistics, meant.statistics[kept])
    np.testing.assert_array_equal(left_out.alarms, meant.alarms[kept])

    again = np.sort(np.concatenate([np.arange(rows), np.arange(700, 5000, 97)]))
    doubled = board.run(gone[again], times_us=even[again])
    first = np.concatenate([[True], np.diff(again) > 0])
    np.testing.assert_array_equal(doubled.statistics[first], meant.statistics)
    assert (doubled.flags[~first] & 1).all()
    assert not (doubled.flags[first] & 1).any()

    draw = np.random.default_rng(1)
    off = (50_000_000 + np.arange(rows) * period_us * 1.004 + draw.uniform(-0.3, 0.3, rows) * period_us).astype(
        np.uint64
    )
    np.testing.assert_array_equal(board.run(gone, times_us=off).statistics, meant.statistics)


def test_a_long_pause_and_a_clock_that_jumps_back_begin_anew(boards):
    board, broken = boards("C", "full"), readings("none", "whole", 12)
    even = np.arange(len(broken)) * round(broken.sample_period_s * 1e6) + 10**9
    late = np.where(np.arange(len(broken)) >= 2000, even + 10**7, even)
    back = np.where(np.arange(len(broken)) >= 2000, even - 9 * 10**8, even)
    fresh = board.run(broken.values[2000:])
    for times in (late, back):
        told = board.run(broken.values, times_us=times)
        assert np.flatnonzero(told.flags & 2).tolist() == [2000]
        np.testing.assert_array_equal(told.statistics[2000:], fresh.statistics)


@pytest.mark.parametrize("variant", ["full", "compact"])
def test_a_hundred_days_later_it_says_the_same(boards, variant):
    """Counters that have gone on for a hundred days or more: of samples, and of microseconds."""
    board, broken = boards("C", variant), readings("bias", "whole", 13)
    period_us = round(broken.sample_period_s * 1e6)
    even, late = (begin + np.arange(len(broken)) * period_us for begin in (10**6, 2**53))
    np.testing.assert_array_equal(
        board.run(broken.values, times_us=even).statistics, board.run(broken.values, times_us=late).statistics
    )
    forever = np.tile(readings("none", "whole", 14).values, (5, 1))  # 600 s: every counter has come round
    told = board.run(forever)
    assert np.isfinite(told.statistics[5000:]).all()
    assert not (told.flags[2000:] & 4).any()


def test_infinite_and_absurd_readings_are_survived(boards):
    board, broken = boards("C", "full"), readings("none", "whole", 15)
    values = broken.values.copy()
    values[1500, 0], values[1600, 3], values[1700, 1], values[1800, 4] = np.inf, -np.inf, 3e38, -1e30
    told = board.run(values)
    assert np.isfinite(told.statistics[-1]).all()
    assert told.alarms.any()  # 3e38 deg/s isn't a reading to be silent about
    assert told.statistics[-1].max() < 1.0


def test_several_run_beside_each_other(boards):
    board, first, second = boards("C", "compact"), readings("bias", "whole", 16), readings("none", "long holes", 17)
    states, halves = [board.begin(), board.begin()], []
    times = 10**6 + np.arange(6000) * round(first.sample_period_s * 1e6)
    for at in range(0, 6000, 500):
        rows = slice(at, at + 500)
        halves.append(
            [
                board.run(each.values[rows], times_us=times[rows], state=state).statistics
                for each, state in zip((first, second), states, strict=True)
            ]
        )
    for i, each in enumerate((first, second)):
        np.testing.assert_array_equal(np.concatenate([half[i] for half in halves]), board.run(each.values).statistics)
    assert isinstance(states[0], ctypes.Array)

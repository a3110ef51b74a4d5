"""A log gone through in pieces says what it says as a whole: joints leave no trace, wherever they fall."""

from functools import cache

import numpy as np
import pandas as pd
import pyarrow.parquet as pq
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import OUTSIDE
from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.errors import InputError
from gtmbench.intake.formats.registry import read_raw
from gtmbench.intake.open import open_log
from gtmbench.intake.row_by_row import LiveClock, live_chunks
from gtmbench.log.live_watch import watch_live
from gtmbench.log.self_check.motion import slow_motion, slow_pieces
from gtmbench.log.watch import watch_log
from gtmbench.report.tables.log import log_results
from gtmbench.report.words.log import log_report
from gtmbench.values import pieces as by_piece
from gtmbench.values.channels import ACCELEROMETERS, header_of
from tests.helpers.monitors import monitor, record
from tests.helpers.night import by_day

CHANNELS = ("p", "q", "r", "phi", "theta", "psi")
AWKWARD = (997, 2048, 5999)  # rows: what stands on a minute before goes over many joints, or begins at one
ALL = 1 << 40


@pytest.fixture
def in_pieces(monkeypatch):
    """Let a piece have so many rows."""
    return lambda rows: monkeypatch.setattr(by_piece, "ROWS", rows)


def _frame(flight):
    return flight.select(CHANNELS).frame().reset_index()


def _healthy():
    return _frame(record(12_000, seed=71))


def _gaps():
    """A pause of three seconds, rows that come twice and late, samples that are missing; one channel pauses alone."""
    frame = _frame(record(12_000, seed=72))
    frame.loc[3000:3080, "q"] = np.nan
    frame.loc[[997, 998, 2048, 7000], "p"] = np.nan
    frame.loc[4100:4103, ["phi", "theta", "psi"]] = np.nan
    frame = frame.drop(index=range(8000, 8150))
    doubled = pd.concat([frame, frame.iloc[[1994, 5000]]]).sort_values("time_s", kind="stable")
    order = np.arange(len(doubled))
    order[[6000, 6001]] = [6001, 6000]
    return doubled.iloc[order]


def _faulty():
    """A jam across every joint at 5998, 6144 and 5999 rows, and a heading that turns through 360 deg."""
    flight = gb.inject(record(12_000, seed=73), gb.Jam(channel="q", onset_s=119.9, duration_s=20.0))
    flight = gb.inject(flight, gb.Bias(channel="r", onset_s=199.7, size=4.0))
    frame = _frame(flight)
    frame["psi"] = (frame["psi"] + 315.0) % 360.0
    return frame


LOGS = {"faulty": _faulty, "gaps": _gaps, "healthy": _healthy}


@pytest.fixture(scope="module", params=by_day(LOGS, 2))
def log(request, tmp_path_factory):
    """A log, and how it is read as a whole."""
    path = tmp_path_factory.mktemp("day") / "log.parquet"
    LOGS[request.param]().rename(columns=header_of).to_parquet(path, row_group_size=1500, index=False)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(by_piece, "ROWS", ALL)
        return path, open_log(path)


@cache
def whole_of(path):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(by_piece, "ROWS", ALL)
        return watch_log(path, monitor())


def _alike(one, other):
    """Compare plain values: words and counts are the same, numbers but for rounding."""
    if isinstance(one, dict):
        assert one.keys() == other.keys()
        for key in one:
            _alike(one[key], other[key])
    elif isinstance(one, (list, tuple)):
        assert len(one) == len(other)
        for pair in zip(one, other, strict=True):
            _alike(*pair)
    elif isinstance(one, float):
        assert other == pytest.approx(one, rel=1e-6, abs=1e-9, nan_ok=True)
    else:
        assert one == other


@pytest.mark.parametrize("rows", by_day(AWKWARD[::2]))
@pytest.mark.parametrize("log", by_day(LOGS), indirect=True)
def test_a_log_in_pieces_is_told_as_the_whole(log, rows, in_pieces):
    (path, taken), told = log, []
    in_pieces(rows)
    _alike_watched(whole_of(path), watch_log(path, monitor(), progress=lambda *step: told.append(step)))
    seconds = [done for step, done, _ in told if step == "watch"]
    assert seconds == sorted(seconds)
    samples = sum(len(each) for each in taken.segments)
    assert len(seconds) > samples / rows  # it is told with every piece
    assert told[-1][1] == told[-1][2] == round(samples * 0.02)


def test_what_would_have_alarmed_in_an_excursion_is_found_in_pieces(in_pieces):
    flight = gb.inject(record(12_000, seed=73), gb.Jam(channel="q", onset_s=119.9, duration_s=20.0))
    outside = [Excursion(start_s=119.0, end_s=150.0, reason=MOTION)]
    in_pieces(ALL)
    whole = monitor().watch(flight, outside=outside).alarms
    in_pieces(997)
    found = monitor().watch(flight, outside=outside).alarms
    assert whole[0].test == OUTSIDE
    assert [(each.time_s, each.onset_s, each.source, each.test) for each in found] == [
        (each.time_s, each.onset_s, each.source, each.test) for each in whole
    ]


def _alike_watched(whole, watched):
    """Compare what is said of a log as a whole and in pieces."""
    assert log_report(watched) == log_report(whole)
    _alike(log_results(whole), log_results(watched))
    assert watched.outcome == whole.outcome
    for one, other in zip(whole.watches, watched.watches, strict=True):
        for name, score in one.scores.items():
            np.testing.assert_allclose(other.scores[name].values, score.values, rtol=1e-7, atol=1e-10)
            np.testing.assert_array_equal(other.scores[name].armed, score.armed)
            np.testing.assert_array_equal(other.scores[name].known_s, score.known_s)
        for kind in ("residuals", "predictions"):
            for name, values in getattr(one, kind).items():
                np.testing.assert_allclose(getattr(other, kind)[name], values, rtol=0.0, atol=1e-9)


@pytest.mark.parametrize("rows", AWKWARD)
def test_the_intake_is_the_same_to_the_last_bit(log, rows, in_pieces):
    path, whole = log
    in_pieces(rows)
    taken = open_log(path)
    assert (taken.remarks, taken.method) == (whole.remarks, whole.method)
    for one, other in zip(whole.segments, taken.segments, strict=True):
        np.testing.assert_array_equal(other.values, one.values)
        np.testing.assert_array_equal(other.there, one.there)
        assert (other.channels, other.start_s, other.sample_period_s) == (
            one.channels,
            one.start_s,
            one.sample_period_s,
        )


def test_the_logs_hold_what_they_are_to_try(log):
    path, taken = log
    kinds = {remark.kind for remark in taken.remarks}
    if len(taken.segments) > 1:
        assert {"gap", "missing", "duplicate", "out of order"} <= kinds
    elif alarms := whole_of(path).alarms:
        assert {alarm.sensor for alarm in alarms} == {"q", "r"}
        assert np.ptp(taken.segments[0]["psi"]) < 60.0  # 360 deg isn't a jump
    else:
        assert not kinds


def test_whole_numbers_of_which_some_are_missing_in_a_later_piece_are_read(tmp_path, in_pieces):
    path = tmp_path / "counts.parquet"
    counts = pd.array([*range(3000), None, 7], dtype="Int64")
    pd.DataFrame({"n": counts, "kept": range(3002)}).to_parquet(path, row_group_size=1000)
    in_pieces(700)
    columns = {series.name: series.load() for series in read_raw(path).series}
    np.testing.assert_array_equal(columns["n"], [*range(3000), np.nan, 7])
    assert columns["kept"].dtype == np.int64
    assert pq.read_metadata(path).num_row_groups == 4


def test_slow_motion_in_pieces_is_that_of_the_whole(in_pieces):
    values = np.random.default_rng(4).standard_normal((3000, 2))
    values[[500, 501, 1003]] = np.nan
    values[995:1100, 1] = np.nan  # where the joint would be
    whole, there = slow_motion(values)
    in_pieces(500)
    parts = list(slow_pieces(list(values.T)))
    assert len(parts) > 3
    slowed, known = (np.concatenate(column) for column in zip(*parts, strict=True))
    np.testing.assert_array_equal(known, there)
    np.testing.assert_allclose(slowed[there] - slowed[there].mean(axis=0), whole[there], atol=1e-12)


def test_a_record_that_nobody_can_write_to_is_not_copied():
    whole = record(500)
    assert np.shares_memory(whole.between(1.0, 2.0).values, whole.values)
    writable = np.asfortranarray(whole.values.copy())
    view = writable[:, :]
    view.setflags(write=False)
    kept = gb.Record(view, channels=whole.channels, sample_period_s=0.02)
    writable[0, 0] = 99.0
    assert kept.values[0, 0] != 99.0


def test_witnesses_are_laid_beside_the_channels_without_a_copy(tmp_path):
    columns = (*CHANNELS, *ACCELEROMETERS)
    values = np.random.default_rng(6).standard_normal((3000, len(columns)))
    path = tmp_path / "log.parquet"
    gb.write_log(gb.Record(values, channels=columns, sample_period_s=0.01), path)
    (segment,) = open_log(path, needs=CHANNELS, witnesses=ACCELEROMETERS).segments
    assert segment.channels == columns
    np.testing.assert_array_equal(segment.values, values)
    assert segment.values.base is not None  # what was read, seen as a record


def test_a_witness_with_samples_missing_stands_where_it_stood(tmp_path):
    frame = _frame(record(3000, seed=74)).rename(columns=header_of).assign(nx_g=0.1, ny_g=0.2, nz_g=1.0)
    frame["nz_g"] += np.linspace(0.0, 1.0, 3000)
    frame.loc[100:400, "nz_g"] = np.nan  # it keeps its table's stamps; ny has stamps of its own
    frame.loc[frame.index % 4 != 0, "ny_g"] = np.nan
    path = tmp_path / "log.parquet"
    frame.to_parquet(path, index=False)
    (segment,) = open_log(path, needs=CHANNELS, witnesses=("nz", "ny", "nx")).segments
    (alone,) = open_log(path, needs=CHANNELS).segments
    assert segment.channels == (*CHANNELS, "nz", "ny", "nx")
    np.testing.assert_array_equal(segment.matrix(CHANNELS), alone.values)
    np.testing.assert_array_equal(segment["nz"], frame["nz_g"])
    np.testing.assert_allclose(segment["nx"], 0.1)
    assert np.nanmax(np.abs(segment["ny"] - 0.2)) < 1e-12


def _told(pieces_of_alarms):
    """Return alarms as they were last told, one stream after the other."""
    return {(alarm.number, alarm.time_s): alarm for piece in pieces_of_alarms for alarm in piece}


@pytest.mark.parametrize("rows", by_day(AWKWARD))
@pytest.mark.parametrize("make", by_day([_faulty, _healthy]))
def test_a_log_that_comes_in_row_by_row_raises_the_alarms_of_the_whole(make, rows, tmp_path, in_pieces):
    path = tmp_path / "log.parquet"
    frame = make()
    frame = frame.drop(index=[2000, 4444, *range(11_000, 11_100)])  # two samples left out, and a gap
    frame = pd.concat([frame, frame.iloc[[700]]]).sort_values("time_s", kind="stable")  # and a row sent twice
    frame.rename(columns=header_of).to_parquet(path, row_group_size=1500, index=False)
    in_pieces(ALL)
    whole = watch_log(path, monitor())
    in_pieces(rows)
    told = _told(watch_live(path, monitor()))
    alarms = [alarm for watch in whole.watches for alarm in watch.alarms]
    assert [(alarm.time_s, alarm.source, alarm.sensor) for alarm in told.values()] == [
        (alarm.time_s, alarm.source, alarm.sensor) for alarm in alarms
    ]
    assert bool(alarms) == (make is _faulty)
    joined = list(live_chunks(path, 0.02, needs=CHANNELS))
    for segment in whole.log.segments:
        own = [chunk for chunk in joined if segment.start_s - 0.01 < chunk.start_s < segment.end_s]
        laid, whole_rows = np.concatenate([chunk.values for chunk in own]), segment.select(CHANNELS).values
        np.testing.assert_allclose(laid, whole_rows, rtol=0.0, atol=1e-9)
        assert np.count_nonzero(laid != whole_rows) <= 2 * len(CHANNELS)  # those that were left out, interpolated
        np.testing.assert_array_equal(np.concatenate([chunk.there for chunk in own]), segment.select(CHANNELS).there)


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda frame: frame.assign(time_s=frame["time_s"] * 2.5), "rows come at 20 Hz, and the monitor watches at 50"),
        (lambda frame: frame.iloc[[*range(100), 101, 100, *range(102, 300)]], "comes after"),
        (lambda frame: frame.assign(phi=frame["phi"].where(frame.index % 5 == 0)), "phi: samples at stamps of their"),
        (
            lambda frame: frame.assign(**{n: frame[n].to_numpy()[frame.index // 5 * 5] for n in CHANNELS[3:]}),
            "phi, theta, psi: readings are repeated",
        ),
    ],
)
def test_what_only_the_whole_log_can_mend_is_refused_row_by_row(change, said, tmp_path):
    path = tmp_path / "log.parquet"
    change(_frame(record(1500, seed=75))).rename(columns=header_of).to_parquet(path, index=False)
    with pytest.raises(InputError, match=said):
        list(live_chunks(path, 0.02, needs=CHANNELS))


def _sent(rate_hz, skew, jitter, loss, channels=2):
    """Return stamps and readings of 20 s with a pause: a clock that is off, stamps that jitter, rows that are lost.

    None is closer than a quarter of a period to another: those are one, and which is, measured periods say.
    """
    rng = np.random.default_rng(round(rate_hz * 1000 * (1 + jitter + loss + skew)))
    count = int(20 * rate_hz)
    time_s = 7.0 + (np.arange(count) + np.clip(jitter * rng.standard_normal(count), -0.35, 0.35)) / rate_hz * (1 + skew)
    slow = np.sin(2 * np.pi * 0.7 * time_s[:, np.newaxis] + np.arange(channels))
    values = 10 * slow + 0.3 * rng.standard_normal((count, channels))
    kept = (rng.random(count) >= loss) & (np.abs(time_s - 17.0) > 0.4)
    return time_s[kept], values[kept]


@pytest.mark.parametrize("rows", [1, 97])
@pytest.mark.parametrize(
    ("rate_hz", "skew", "jitter", "loss"),
    by_day(
        [
            (50, 0.0, 0.0, 0.0),
            (50, 0.0, 0.0, 0.02),
            (50, 0.005, 0.0, 0.0),
            (50, -0.005, 0.0, 0.02),
            (50, 0.0, 0.1, 0.02),
            (50, 0.005, 0.2, 0.02),
            (30, 0.0, 0.1, 0.02),
            (62.5, 0.0, 0.1, 0.02),
            (100, 0.0, 0.0, 0.02),
            (111, 0.0, 0.1, 0.02),
            (400, 0.005, 0.1, 0.02),
        ],
        3,
    ),
)
def test_a_stream_lays_the_rows_of_the_log(rate_hz, skew, jitter, loss, rows, tmp_path):
    """Whatever pieces they come in; apart from the first second, in which a stream learns what its source is like."""
    time_s, values = _sent(rate_hz, skew, jitter, loss)
    path = tmp_path / "log.parquet"
    pd.DataFrame({"time_s": time_s, "p_deg_s": values[:, 0], "q_deg_s": values[:, 1]}).to_parquet(path, index=False)
    segments = open_log(path, rate_hz=50.0, needs=("p", "q")).segments
    assert len(segments) == 2
    clock = LiveClock(("p", "q"), 0.02)
    starts = range(0, len(time_s), rows)
    chunks = [chunk for k in starts for chunk in clock.push(time_s[k : k + rows], values[k : k + rows])]
    chunks += clock.end()
    for segment in segments:
        own = [chunk for chunk in chunks if segment.start_s - 0.01 < chunk.start_s <= segment.end_s + 0.01]
        laid, there = (np.concatenate([getattr(chunk, kind) for chunk in own]) for kind in ("values", "there"))
        assert abs(own[0].start_s - segment.start_s) <= 1e-3
        assert abs(len(laid) - len(segment)) <= 1
        steady = slice(50, min(len(laid), len(segment)))
        np.testing.assert_allclose(laid[steady], segment.values[steady], rtol=0.0, atol=1e-9)
        np.testing.assert_array_equal(there[steady], segment.there[steady])
        assert np.isfinite(laid).all(axis=1).mean() >= (0.95 if rate_hz != 100 else 0.85)  # a filter loses more


def test_a_clock_is_the_same_after_rows_that_it_refused():
    clock = LiveClock(["p"], 0.1)
    rows = np.arange(20.0)[:, np.newaxis]
    clock.push(np.arange(5) * 0.1, rows[:5])
    with pytest.raises(InputError, match=r"a row of 0\.2 s comes after 0\.5 s: late"):
        clock.push(np.array([0.5, 0.2]), rows[5:7])
    (chunk,) = clock.push(np.array([0.5, 0.6]), rows[5:7])
    assert (chunk.start_s, chunk["p"].tolist()) == (0.5, [5.0, 6.0])


def test_a_row_waits_for_the_few_behind_it_that_it_depends_on():
    """On its place it's given at once; half a place off with the sixth behind it; of twice the rate 13 rows later."""
    on, off, fast = LiveClock(["p"], 0.1), LiveClock(["p"], 0.1), LiveClock(["p"], 0.1)
    values = np.ones((1, 1))
    late = {"on": [], "off": [], "fast": []}
    for k in range(200):
        now_s = 0.1 * k
        half_s = now_s + 0.05 * (k > 0)  # from the second on beside its place, so now is half a place before
        given = [*on.push(np.array([now_s]), values)], [*off.push(np.array([half_s]), values)]
        given = *given, [chunk for h in (0.0, 0.05) for chunk in fast.push(np.array([now_s + h]), values)]
        for name, chunks in zip(late, given, strict=True):
            late[name] += [round((now_s - chunk.end_s) / 0.1, 6) for chunk in chunks]
    assert (set(late["on"][2:]), set(late["off"][30:]), set(late["fast"][30:])) == ({0.0}, {5.0}, {13.0})


def test_a_witness_with_stamps_of_its_own_is_left_out_row_by_row(tmp_path, in_pieces):
    frame = _frame(record(900, seed=76)).rename(columns=header_of).assign(nx_g=0.1, ny_g=0.2)
    frame.loc[frame.index % 4 != 0, "ny_g"] = np.nan
    frame.to_parquet(tmp_path / "log.parquet", index=False)
    in_pieces(400)
    chunks = list(live_chunks(tmp_path / "log.parquet", 0.02, needs=CHANNELS, witnesses=ACCELEROMETERS))
    assert {chunk.channels for chunk in chunks} == {(*CHANNELS, "nx")}
    assert sum(map(len, chunks)) == 900


def test_a_csv_is_not_read_row_by_row(tmp_path):
    gb.write_log(record(500), tmp_path / "log.csv")
    with pytest.raises(InputError, match="read as CSV: no part of it can be read alone"):
        list(live_chunks(tmp_path / "log.csv", 0.02, needs=CHANNELS))

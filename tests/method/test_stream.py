"""Streams against the batch functions: however a record is cut, the same values, times and alarms."""

import pickle
import tracemalloc
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.errors import InputError
from gtmbench.method.residual import Residual, WindowedNorm, alarms, residual, windowed_norm
from gtmbench.method.residual_stream import AlarmStream, NormStream, ResidualStream
from gtmbench.values.record import Record
from tests.helpers.oracles import operator

INPUTS, OUTPUTS = ("p", "q"), ("r", "beta")
CHANNELS = ("ny", *OUTPUTS, *INPUTS)  # not in the operator's order, and one that it doesn't know
TS, START_S = 0.01, 25.0
LONGEST = 90


def flight(samples=LONGEST):
    values = np.random.default_rng(1).standard_normal((samples, 5))
    return Record(values, channels=CHANNELS, sample_period_s=TS, start_s=START_S)


def part(record, begin, end):
    """Return samples begin..end-1 of a record; there may be none."""
    start_s = record.start_s + round(begin * TS, 9)
    return Record(record.values[begin:end], channels=record.channels, sample_period_s=TS, start_s=start_s)


def rows(result, begin, end):
    """Return rows begin..end-1 of a residual or a norm."""
    return replace(result, values=result.values[begin:end], time_s=result.time_s[begin:end])


def chunks(whole, cuts, of=rows):
    edges = [0, *sorted(cuts), len(whole.time_s)]
    return [of(whole, begin, end) for begin, end in pairwise(edges)]


def joined(results):
    return tuple(np.concatenate([getattr(each, name) for each in results]) for name in ("values", "time_s"))


def made_up(values):
    values = np.asarray(values, dtype=float).reshape(len(values), -1)
    time_s = START_S + np.round(np.arange(len(values)) * TS, 9)
    return Residual(values=values, time_s=time_s, outputs=("y",), look_ahead_s=0.02, sample_period_s=TS)


def norm(values):
    time_s = START_S + np.round(np.arange(len(values)) * TS, 9)
    values = np.array(values, dtype=float)
    return WindowedNorm(values=values, time_s=time_s, window=4, look_ahead_s=0.02, sample_period_s=TS)


cut_anywhere = st.lists(st.integers(0, LONGEST), max_size=12)  # twice at one place: an empty chunk
one_by_one = range(1, LONGEST)
spikes = st.lists(st.tuples(st.integers(0, LONGEST - 1), st.sampled_from([1e6, np.nan, np.inf])), max_size=3)


@given(cuts=st.one_of(st.just(one_by_one), cut_anywhere), r=st.integers(0, 5), d=st.integers(0, 5), spoilt=spikes)
def test_the_residual_of_chunks_is_that_of_the_record(cuts, r, d, spoilt):
    record = flight()
    for k, spike in spoilt:
        values = record["q" if k % 2 else "beta"].copy()
        values[k] = spike
        record = record.replace("q" if k % 2 else "beta", values)
    batch = residual(operator(r, d), record)
    stream = ResidualStream(operator(r, d))
    results = [stream.push(chunk) for chunk in chunks(record, cuts, part)]
    values, time_s = joined(results)
    np.testing.assert_allclose(values, batch.values[: LONGEST - d], rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(time_s, batch.time_s[: LONGEST - d])
    assert {(e.outputs, e.look_ahead_s, e.sample_period_s) for e in results} == {(OUTPUTS, d * TS, TS)}


@pytest.mark.parametrize("samples", range(8))
def test_a_record_shorter_than_the_taps_gives_the_rows_of_the_batch(samples):
    stream = ResidualStream(operator())
    values, _ = joined([stream.push(part(flight(), k, k + 1)) for k in range(samples)] or [stream.push(flight(0))])
    np.testing.assert_allclose(values, residual(operator(), flight(samples)).values[: max(samples - 2, 0)], atol=1e-12)


squares = st.one_of(st.floats(-1e3, 1e3), st.sampled_from([np.nan, np.inf, 1e200, 1e6]))


@given(
    values=st.lists(squares, min_size=1, max_size=LONGEST),
    window=st.integers(0, 30),
    cuts=st.one_of(st.just(one_by_one), cut_anywhere),
)
def test_the_norm_of_chunks_is_that_of_the_record_bit_for_bit(values, window, cuts):
    e = made_up(values)
    batch = windowed_norm(e, window=window)
    stream = NormStream(window=window)
    results = [stream.push(chunk) for chunk in chunks(e, [cut for cut in cuts if cut <= len(values)])]
    known = max(len(values) - window, 0)
    for streamed, expected in zip(joined(results), (batch.values, batch.time_s), strict=True):
        np.testing.assert_array_equal(streamed, expected[:known])
    assert {(each.window, each.look_ahead_s, each.sample_period_s) for each in results} == {(window, 0.02, TS)}


@pytest.mark.parametrize("size", [1, 7, 999, 1000, 1001, 1002, 2500])
def test_a_long_norm_of_two_outputs_is_the_same_bit_for_bit(size):
    values = np.random.default_rng(3).standard_normal((5000, 2))
    e = replace(made_up(values[:, 0]), values=values, outputs=OUTPUTS)
    stream = NormStream(window=1000)
    streamed, _ = joined([stream.push(chunk) for chunk in chunks(e, range(size, 5000, size))])
    np.testing.assert_array_equal(streamed, windowed_norm(e, window=1000).values[:4000])


# 1.0 is the threshold itself: not above it
levels = st.lists(st.sampled_from([0.5, 1.0, 1.0 + 1e-9, 3.0, np.nan, np.inf]), max_size=40)


@given(values=levels, cuts=st.lists(st.integers(0, 40), max_size=8), first=st.integers(0, 12))
def test_the_alarms_of_chunks_are_those_of_the_record(values, cuts, first):
    start_s = START_S + first * TS
    batch = alarms(norm(values), 1.0, start_s=start_s)
    stream = AlarmStream(1.0, start_s=start_s)
    results = [stream.push(chunk) for chunk in chunks(norm(values), [cut for cut in cuts if cut <= len(values)])]
    np.testing.assert_array_equal(np.concatenate([each.time_s for each in results]), batch.time_s)
    np.testing.assert_array_equal(results[-1].armed_s, batch.armed_s)
    attributes = {(each.threshold, each.look_ahead_s, each.window_s) for each in results}
    assert attributes == {(batch.threshold, batch.look_ahead_s, batch.window_s)}


def test_from_samples_to_alarms_one_sample_at_a_time():
    record = flight(600)
    record = record.replace("r", record["r"] + 30.0 * (np.arange(600) // 150 % 2))
    expected = alarms(windowed_norm(residual(operator(), record), window=20), 60.0, start_s=25.5)
    streams = ResidualStream(operator()), NormStream(window=20), AlarmStream(60.0, start_s=25.5)
    raised = []
    for k in range(600):
        result = part(record, k, k + 1)
        for stream in streams:
            result = stream.push(result)
        # an alarm is raised by the sample that makes it known, not later
        np.testing.assert_allclose(result.time_s, record.time_s[k], rtol=0, atol=1e-9)
        raised.extend(result.time_s)
    assert len(raised) == 2
    np.testing.assert_array_equal(raised, expected.time_s)
    assert result.armed_s == expected.armed_s


def test_what_a_stream_returns_cant_be_changed():
    e = ResidualStream(operator()).push(flight())
    for result in (e.values, NormStream(window=3).push(e).values):
        with pytest.raises(ValueError, match="read-only"):
            result[5] = 0.0


# --- a chunk that doesn't continue the one before


def shifted(chunk, by_s):
    return replace(chunk, time_s=chunk.time_s + by_s)


def samples(begin, end, *, period=TS, shift_s=0.0, channels=CHANNELS):
    chunk = part(flight(), begin, end).select(channels)
    return Record(chunk.values, channels=channels, sample_period_s=period, start_s=chunk.start_s + shift_s)


def residual_rows(begin, end):
    return rows(made_up(np.arange(LONGEST)), begin, end)


def norm_rows(begin, end):
    return rows(norm(np.arange(LONGEST) % 4), begin, end)


STREAMS = {
    "residual": (lambda: ResidualStream(operator()), samples),
    "norm": (lambda: NormStream(window=6), residual_rows),
    "alarms": (lambda: AlarmStream(2.5), norm_rows),
}
REFUSED = {
    "residual-gap": (samples(31, 60), r"begins at 25\.31 s, but 25\.3 s is next; fill the gap with NaN or begin a new"),
    "residual-overlap": (samples(29, 60), r"begins at 25\.29 s, but 25\.3 s is next; leave out what came before or"),
    "residual-half": (samples(30, 60, shift_s=0.005), r"begins at 25\.305 s"),
    "residual-period": (samples(30, 60, period=0.02), r"sampled every 0\.02 s, those before every 0\.01 s; resample"),
    "residual-channel": (samples(30, 60, channels=("p", "r")), "no channel 'q', 'beta' in this record"),
    "norm-gap": (residual_rows(31, 60), r"begins at 25\.31 s"),
    "norm-overlap": (residual_rows(0, 30), r"begins at 25 s"),
    "norm-nan": (shifted(residual_rows(30, 60), np.nan), r"begins at nan s"),
    "norm-period": (replace(residual_rows(30, 60), sample_period_s=0.02), r"sampled every 0\.02 s"),
    "norm-outputs": (replace(residual_rows(30, 60), outputs=("x",)), "outputs x .* came after outputs y .*a stream of"),
    "norm-look-ahead": (replace(residual_rows(30, 60), look_ahead_s=0.5), r"look-ahead of 0\.5 s came after"),
    "alarms-gap": (norm_rows(31, 60), r"begins at 25\.31 s"),
    "alarms-overlap": (norm_rows(29, 60), r"begins at 25\.29 s"),
    "alarms-window": (replace(norm_rows(30, 60), window=9), "windows of 10 samples .* came after windows of 5 samples"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_a_chunk_that_does_not_continue_is_refused_and_changes_nothing(case):
    make, chunk_of = STREAMS[case.split("-")[0]]
    refused, message = REFUSED[case]
    disturbed, quiet = make(), make()
    for stream in (disturbed, quiet):
        stream.push(chunk_of(0, 30))
    before = pickle.dumps(disturbed)
    with pytest.raises(InputError, match=message):
        disturbed.push(refused)
    assert pickle.dumps(disturbed) == before
    after, expected = (stream.push(chunk_of(30, 60)) for stream in (disturbed, quiet))
    np.testing.assert_array_equal(after.time_s, expected.time_s)


def test_the_first_chunk_is_checked_against_the_operator():
    with pytest.raises(InputError, match=r"every 0\.02 s, the operator .* identified at 0\.01 s; resample"):
        ResidualStream(operator()).push(samples(0, 30, period=0.02))


@pytest.mark.parametrize("clock", [0.0, 1e5, 1.7e9])
def test_rounded_times_of_a_clock_are_no_gap(clock):
    stream = ResidualStream(operator())
    for k in range(50):
        stream.push(Record(np.zeros((1, 5)), channels=CHANNELS, sample_period_s=TS, start_s=clock + k / 100))


@pytest.mark.parametrize("window", [-1, 2.5, True])
def test_a_window_that_is_no_count_is_refused(window):
    with pytest.raises(InputError, match="must be a whole number, 0 or more"):
        NormStream(window=window)


@pytest.mark.parametrize("limit", [0.0, np.nan])
def test_a_threshold_that_isnt_positive_is_refused(limit):
    with pytest.raises(InputError, match="must be a finite number greater than 0"):
        AlarmStream(limit)


# --- what a sample costs, counted in bytes


def test_half_an_hour_into_a_flight_a_sample_costs_what_it_does_in_the_first_minute():
    streams = ResidualStream(operator(50, 50)), NormStream(window=1000), AlarmStream(60.0)
    record = flight(6000)

    def push(chunk):
        for stream in streams:
            chunk = stream.push(chunk)

    def sample_at(k):
        return Record(record.values[:1], channels=CHANNELS, sample_period_s=TS, start_s=START_S + round(k * TS, 9))

    def cost(first):
        """Return the peak of memory over 10 pushes, and the size of the state after them."""
        peaks = []
        for k in range(first, first + 10):
            chunk = sample_at(k)
            tracemalloc.start()
            push(chunk)
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
        return max(peaks), len(pickle.dumps(streams))

    push(part(record, 0, 4000))
    cost(4000)  # what a process makes once, with its first sample
    early = cost(4010)
    for minute in range(30):
        start_s = START_S + round((4020 + 6000 * minute) * TS, 9)
        push(Record(record.values, channels=CHANNELS, sample_period_s=TS, start_s=start_s))
    late = cost(4020 + 30 * 6000)
    assert late[0] == pytest.approx(early[0], rel=0.02)
    assert late[1] == pytest.approx(early[1], abs=16)  # the count of samples is a longer number
    assert late[1] < 60_000


def test_a_long_chunk_is_let_go():
    streams = ResidualStream(operator(50, 50)), NormStream(window=1000), AlarmStream(60.0)
    chunk = flight(50_000)
    tracemalloc.start()
    for stream in streams:
        chunk = stream.push(chunk)
    del chunk
    held = tracemalloc.get_traced_memory()[0]
    tracemalloc.stop()
    assert held < 60_000


def test_a_norm_that_is_above_from_the_start_alarms_in_no_stream_until_it_has_come_down():
    values = np.array([3.0, 3.0, 0.5, 3.0])
    norm = WindowedNorm(values=values, time_s=np.arange(4.0), window=0, look_ahead_s=0.0, sample_period_s=1.0)
    stream = AlarmStream(1.0)
    first, second = (
        stream.push(replace(norm, values=values[rows], time_s=norm.time_s[rows])) for rows in (slice(2), slice(2, 4))
    )
    assert (first.time_s.tolist(), np.isnan(first.armed_s)) == ([], True)
    assert (second.time_s.tolist(), second.armed_s) == ([3.0], 2.0)

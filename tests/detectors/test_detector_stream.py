"""Streams that any monitor can have: however a record is cut, the alarms, judgements and links of the whole."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.base import BaseMonitor, SimpleDetector
from gtmbench.detectors.buffered_stream import BufferedStream
from gtmbench.detectors.protocol import Watch
from gtmbench.errors import InputError
from gtmbench.values.record import Record

TS, SAMPLES = 0.25, 60  # exact in binary: times of parts are those of the whole


def record(values, start_s=8.0):
    return Record(values, channels=["p"], sample_period_s=TS, start_s=start_s)


def parts(whole, cuts):
    for begin, end in pairwise([0, *sorted(cuts), len(whole)]):
        yield record(whole.values[begin:end], start_s=whole.start_s + begin * TS)


# above 1 is an alarm; NaN is missing
levels = st.lists(st.sampled_from([0.0, 1.0, 2.0, np.nan]), min_size=SAMPLES, max_size=SAMPLES)
cut_anywhere = st.one_of(st.just(range(1, SAMPLES)), st.lists(st.integers(0, SAMPLES), max_size=8))


@dataclass(frozen=True, kw_only=True, eq=False)
class Judging(BaseMonitor):
    """Alarms where p jumps above 1 from one sample to the next; judges 1 and 2 s later; links within 2 s, 1 s later."""

    name: str = "judging"
    channels: tuple[str, ...] = ("p",)
    memory_s: float = 6.0

    def watch(self, record):
        high = np.nan_to_num(record["p"]) > 1.0
        rows = np.flatnonzero(high & ~np.concatenate([[True], high])[:-1]).tolist()
        alarms, last = [], None
        for i, at in enumerate(record.time_s[rows].tolist()):
            due = [at + later for later in (1.0, 2.0) if at + later <= record.end_s]
            judged = tuple(Judgement(time_s=time_s, sensor="p", candidates=("p",)) for time_s in due)
            linked = last is not None and at - last.time_s <= 2.0 and bool(due)
            alarm = Alarm(number=i, time_s=at, onset_s=at, source="p", judgements=judged)
            alarms.append(replace(alarm, fault=last.number if linked else i))
            last = alarm
        return Watch(monitor=self, record=record, alarms=tuple(alarms))


@given(values=levels, cuts=cut_anywhere)
def test_a_buffered_stream_says_what_the_whole_says(values, cuts):
    whole, stream, held = record(values), BufferedStream(Judging()), {}
    for part in parts(whole, cuts):
        for alarm in stream.push(part):
            assert alarm != held.get(alarm.number)
            held[alarm.number] = alarm
    assert stream.alarms == tuple(held.values()) == Judging().watch(whole).alarms


@dataclass(frozen=True)
class Means(SimpleDetector):
    """Two scores that look back and ahead."""

    name: str = "means"
    channels: tuple[str, ...] = ("p",)
    look_ahead_s: float = 0.5
    memory_s: float = 1.0

    def learn(self, records):
        return {"limits": np.array([1.0, max(float(np.nanmax(record["p"])) for record in records)])}

    def scores(self, record, learned):
        padded = np.concatenate([np.full(2, np.nan), record["p"], np.full(2, np.nan)])
        windows = np.lib.stride_tricks.sliding_window_view(padded, 5)
        return {"mean": windows.mean(axis=1) / learned["limits"][0], "now": record["p"] / learned["limits"][1]}


MEANS = Means().calibrate([record([0.0, 1.5])])


@settings(max_examples=settings().max_examples // 4)
@given(values=levels, cuts=cut_anywhere)
def test_a_simple_detectors_stream_says_what_the_whole_says(values, cuts):
    whole, stream, told = record(values), MEANS.stream(), []
    for part in parts(whole, cuts):
        told += stream.push(part)
    watched = MEANS.watch(whole)
    assert tuple(told) == stream.alarms == watched.alarms
    assert stream.armed == {name: bool(score.armed.any()) for name, score in watched.scores.items()}


@pytest.mark.nightly
@given(values=levels)
def test_an_alarm_over_a_gap_longer_than_the_memory_is_an_alarm(values):
    """Whether a score is armed is carried on, not buffered."""
    whole = record([0.0] * 8 + [np.nan] * 40 + [2.0] * 8 + values)
    stream = MEANS.stream()
    for part in parts(whole, range(1, len(whole))):
        stream.push(part)
    assert stream.alarms == MEANS.watch(whole).alarms
    assert stream.alarms[0].source == "now"


def test_a_stream_keeps_its_memory_and_a_sample():
    stream = BufferedStream(Judging())
    for part in parts(record(np.zeros(400)), range(1, 400)):
        stream.push(part)
    assert len(stream._buffer._kept) == 6.0 / TS + 1
    stream = BufferedStream(Judging(memory_s=np.inf))
    for part in parts(record(np.zeros(400)), range(1, 400)):
        stream.push(part)
    assert len(stream._buffer._kept) == 400


@pytest.mark.parametrize(
    ("chunk", "said"),
    [
        (record([0.0], start_s=20.0), "begins at 20 s, but 10 s is next; fill the gap"),
        (record([0.0], start_s=9.0), "begins at 9 s, but 10 s is next; leave out what came before"),
        (Record([0.0], channels=["q"], sample_period_s=TS, start_s=10.0), "no channel 'p' in this record; it has q"),
        (Record([0.0], channels=["p"], sample_period_s=0.5, start_s=10.0), r"sampled every 0.5 s"),
        (3.0, "a float was given for a Record"),
    ],
)
@pytest.mark.parametrize("make", [MEANS.stream, Judging().stream], ids=["simple", "buffered"])
def test_a_chunk_that_does_not_continue_is_refused(make, chunk, said):
    stream = make()
    stream.push(record([0.0] * 8))
    with pytest.raises(InputError, match=said):
        stream.push(chunk)
    quiet = make()
    quiet.push(record([0.0] * 8))
    after = stream.push(record([2.0] * 8, start_s=10.0))
    assert after == quiet.push(record([2.0] * 8, start_s=10.0))
    assert after


def test_scores_of_another_shape_are_refused():
    class Short(Means):
        def scores(self, record, learned):
            return {"p": record["p"][1:]}

    with pytest.raises(InputError, match=r"'means' scored 'p' in shape \(7,\), and the record has 8 samples"):
        Short().calibrate([record([0.0])]).watch(record([0.0] * 8))


def test_a_recipes_parameters_go_with_its_figures():
    monitor = Means(look_ahead_s=0.75, name="mine").calibrate([record([0.0, 1.5])])
    figures = monitor.figures()
    assert figures["recipe"]["look_ahead_s"] == 0.75
    assert figures["learned"] == {"limits": [1.0, 1.5]}
    again = Means().restore(figures)
    assert again.detector == monitor.detector
    with pytest.raises(InputError, match="recipe: key 'memory_s' is missing"):
        Means().restore({**figures, "recipe": {key: 1 for key in figures["recipe"] if key != "memory_s"}})
    with pytest.raises(InputError, match="figures: unknown key 'more'"):
        Means().restore({**figures, "more": 1})
    with pytest.raises(InputError, match=r"'means' can't promise 0.01 false alarms an hour"):
        Means().calibrate([record([0.0])], 0.01)

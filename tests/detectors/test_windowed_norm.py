"""The dissertation's detector against the functions it stands on, in batch and as a stream; and what it refuses."""

import pickle
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.detectors.windowed_norm import SCORE, DissertationOperator
from gtmbench.errors import InputError
from gtmbench.method.identify import identify
from gtmbench.method.residual import alarms, residual, threshold, windowed_norm
from gtmbench.values.record import Record

TS = 0.01
RECIPE = DissertationOperator(inputs=("u", "v"), outputs=("y",), causal_order=6, noncausal_order=3, window=80)


def plant(samples=3000, seed=1, start_s=0.0):
    """Return a record of y, which follows from u and v within the orders, with noise of a seed; u and v stay."""
    u, v = np.random.default_rng(7).standard_normal((2, samples))
    y = 0.8 * u + 0.5 * np.roll(u, 2) - 0.3 * np.roll(v, -1)
    noise = 0.05 * np.random.default_rng(seed).standard_normal((samples, 3))
    return Record(np.column_stack([u, v, y]) + noise, channels=["u", "v", "y"], sample_period_s=TS, start_s=start_s)


def broken(of, *spans):
    """Return a record whose y is biased for some samples."""
    values = np.array(of["y"])
    for begin, end in spans:
        values[begin:end] += 0.5
    return of.replace("y", values)


MONITOR = RECIPE.calibrate([plant(seed=1), plant(seed=2)])


def by_hand(record):
    """Return E(k) and its alarms by the public functions."""
    names = {"inputs": ["u", "v"], "outputs": ["y"], "causal_order": 6, "noncausal_order": 3}
    operator = identify(plant(seed=1), **names)
    healthy = windowed_norm(residual(operator, plant(seed=2)), window=80)
    norm = windowed_norm(residual(operator, record), window=80)
    return norm, alarms(norm, threshold(healthy, start_s=-np.inf, end_s=np.inf, factor=1.5))


@pytest.mark.parametrize("start_s", [0.0, 25.0, 1e5])
def test_it_says_what_the_functions_say(start_s):
    record = broken(plant(seed=3, start_s=start_s), (500, 800), (1500, 1600))
    norm, expected = by_hand(record)
    watched = MONITOR.watch(record)
    np.testing.assert_array_equal(watched.scores[SCORE].values, norm.values)
    np.testing.assert_array_equal([alarm.time_s for alarm in watched.alarms], np.round(expected.time_s, 9))
    assert len(watched.alarms) == 2
    assert MONITOR.threshold == expected.threshold
    assert watched.scores[SCORE].armed_s == pytest.approx(expected.armed_s)
    there = ~np.isnan(watched.residuals["y"])
    np.testing.assert_allclose(
        (watched.residuals["y"] + watched.predictions["y"])[there], record["y"][there], rtol=1e-12
    )
    assert there.sum() == len(record) - 6 - 3


def test_only_parts_of_its_records_are_used_where_told():
    recipe = DissertationOperator(
        inputs=("u", "v"), outputs=("y",), causal_order=6, noncausal_order=3, window=80,
        identify_s=(2.0, 20.0), threshold_s=(10.0, 12.0),
    )  # fmt: skip
    poisoned = broken(plant(seed=2), (1500, 2000))  # windows that begin in 10..12 s end before 13 s
    monitor = recipe.calibrate([broken(plant(seed=1), (2100, 2500)), poisoned])
    again = recipe.calibrate([plant(seed=1), plant(seed=2)])
    np.testing.assert_array_equal(monitor.operator.markov, again.operator.markov)
    assert monitor.threshold == again.threshold


def test_more_records_give_the_greatest_threshold():
    level, other, both = (
        RECIPE.calibrate([plant(seed=1), *(plant(seed=seed) for seed in seeds)]).threshold
        for seeds in ([2], [3], [2, 3])
    )
    assert both == max(level, other)


def test_a_score_that_is_above_from_the_start_is_no_alarm():
    watched = MONITOR.watch(broken(plant(seed=3), (0, 3000)))
    assert watched.alarms == ()
    assert watched.scores[SCORE].is_stuck_above
    assert watched.armed_hours == 0.0


@given(cuts=st.lists(st.integers(0, 900), max_size=10), gap=st.integers(0, 880), bias=st.integers(100, 700))
def test_its_stream_gives_the_alarms_of_the_whole_bit_for_bit(cuts, gap, bias):
    record = broken(plant(900, seed=3, start_s=25.0), (bias, bias + 100))
    values = np.array(record.values)
    values[gap : gap + 5, 0] = np.nan
    record = Record(values, channels=record.channels, sample_period_s=TS, start_s=25.0)
    stream, told = MONITOR.stream(), []
    for begin, end in pairwise([0, *sorted(cuts), 900]):
        start_s = record.start_s + round(begin * TS, 9)
        told += stream.push(
            Record(record.values[begin:end], channels=record.channels, sample_period_s=TS, start_s=start_s)
        )
    watched = MONITOR.watch(record)
    assert tuple(told) == stream.alarms == watched.alarms
    assert stream.armed == {SCORE: bool(watched.scores[SCORE].armed.any())}


def test_its_stream_is_bounded():
    stream = MONITOR.stream()
    stream.push(plant(3000))
    stream.push(plant(3000, start_s=30.0))
    early = len(pickle.dumps(stream))
    for k in range(2, 20):
        stream.push(plant(3000, start_s=30.0 * k))
    assert len(pickle.dumps(stream)) == pytest.approx(early, abs=16)  # the count of samples is a longer number


def test_its_memory_holds_what_an_alarm_looks_at():
    record = broken(plant(seed=3), (1500, 1600))
    (alarm,) = MONITOR.watch(record).alarms
    part = record.between(round(alarm.time_s - MONITOR.memory_s, 9), alarm.time_s)
    assert [round(told.time_s, 9) for told in MONITOR.watch(part).alarms] == [alarm.time_s]
    shorter = record.between(round(alarm.time_s - MONITOR.memory_s + 2 * TS, 9), alarm.time_s)
    assert MONITOR.watch(shorter).alarms == ()


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (([plant(), plant(seed=2)], 0.01), "'dissertation' can't promise 0.01 false alarms an hour"),
        (([plant()],), "takes its threshold from another; 1 given"),
        (([],), "0 given"),
        (([plant(), plant().select(["u", "y"])],), "no channel 'v'"),
    ],
)
def test_what_it_cannot_calibrate_on_is_refused(arguments, said):
    with pytest.raises(InputError, match=said):
        RECIPE.calibrate(*arguments)

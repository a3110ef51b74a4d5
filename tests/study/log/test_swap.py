"""What a bank without kinematics was learnt from is judged by one of the log's end, and a fault there isn't clear."""

from functools import cache
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.verdict.timeline import State

LEARNT_S, END_S = 30.0, 80.0


@cache
def healthy():
    """Return two gyros of which one follows from the other, but for noise."""
    noise = np.random.default_rng(1).standard_normal((round(END_S * 25), 2))
    return gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)


@cache
def watched(*faults, learnt_s=LEARNT_S):
    record = healthy()
    for fault in faults:
        record = gb.inject(record, fault)
    with TemporaryDirectory() as folder:
        gb.write_log(record, f"{folder}/flight.csv")
        return gb.watch_log(f"{folder}/flight.csv", gb.bank_between(["p"], ["q"]), healthy=[(0.0, learnt_s)])


def test_the_part_that_was_learnt_from_is_watched_by_the_end_of_the_log():
    swap = watched().swap
    assert swap.alarms == ()
    (watch,) = swap.watches
    assert (watch.record.start_s, watch.record.end_s) == (0.0, pytest.approx(LEARNT_S, abs=0.1))
    assert swap.monitor is not watched().monitor


def test_a_healthy_log_is_clear_in_both_parts():
    timeline = watched().timeline
    assert timeline.at("q", 60.0).state is State.CLEAR
    assert timeline.at("q", 15.0).state is State.CLEAR


@pytest.mark.parametrize("size", [-4.0, 6.0])
def test_a_fault_in_the_part_that_was_learnt_from_is_not_clear_there(size):
    fault = gb.Bias(channel="q", onset_s=10.0, duration_s=12.0, size=size)
    timeline = watched(fault).timeline
    assert timeline.at("q", 15.0).state is not State.CLEAR


def test_nothing_is_swapped_where_too_little_is_left_or_kinematics_judge():
    short = watched(learnt_s=79.0).swap
    assert short is None or short.watches == ()

"""What a bank was learnt from is judged by one of the log's end, and a fault there isn't clear."""

import re
from functools import cache
from tempfile import TemporaryDirectory

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.report.words.monitor import rms_identified
from gtmbench.verdict.timeline import State
from tests.helpers import monitors

LEARNT_S, END_S = 30.0, 80.0


@cache
def healthy():
    """Return two gyros of which one follows from the other, but for noise."""
    noise = np.random.default_rng(1).standard_normal((round(END_S * 25), 2))
    return gb.Record(noise @ [[1.0, 1.0], [0.0, 0.1]], channels=["p", "q"], sample_period_s=0.04)


def watched_log(record, faults, detector, **options):
    with TemporaryDirectory() as folder:
        gb.write_log(gb.inject(record, faults), f"{folder}/flight.csv")
        return gb.watch_log(f"{folder}/flight.csv", detector, **options)


@cache
def watched(*faults, learnt_s=LEARNT_S):
    return watched_log(healthy(), faults, gb.bank_between(["p"], ["q"]), healthy=[(0.0, learnt_s)])


def test_the_part_that_was_learnt_from_is_watched_by_the_end_of_the_log():
    swap = watched().swap
    assert [watch.faults for watch in swap.watches] == [()]
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


def test_nothing_is_swapped_where_too_little_is_left():
    short = watched(learnt_s=79.0).swap
    assert short is None or short.watches == ()


@cache
def flown(*faults, **options):
    """Return how `auto` watches gyros and attitude: 60 of 150 s are learnt from."""
    record = monitors.record(7500, seed=3).select(("p", "q", "r", "phi", "theta", "psi"))
    return watched_log(record, faults, "auto", attitude="own", **options)


OSCILLATION = gb.Oscillation(channel="q", onset_s=25.0, amplitude=6.0, frequency_hz=2.0, duration_s=5.0)
LASTING = gb.Bias(channel="r", onset_s=30.0, size=3.0)


def test_what_is_short_and_fast_in_what_was_learnt_from_is_not_clear():
    told = flown(OSCILLATION)
    assert told.swap is None  # the engine judges all of the log
    assert told.timeline.at("q", 27.0).state is not State.CLEAR
    assert told.timeline.at("r", 27.0).state is State.CLEAR


@pytest.mark.nightly
def test_a_bank_is_learnt_where_nobody_failed():
    """A fault that lasts, in what would be learnt from: less is learnt from, and residuals are as small as ever."""
    told = flown(LASTING)
    (span,) = told.identified_s
    assert span[0] == 0.0
    assert 24.0 < span[1] < LASTING.onset_s
    assert [(sensor, each.state) for sensor, each in told.verdict.failed] == [("r", State.FAILED)]
    usual, learnt = (rms_identified(each.monitor)["r"] for each in (flown(), told))
    assert learnt < 1.2 * usual


def test_a_log_that_fails_from_the_first_seconds_on_has_no_bank_and_is_judged_all_the_same():
    told = flown(gb.Jam(channel="p", onset_s=8.0))
    assert told.identified_s == ()
    assert told.watches == ()
    assert [sensor for sensor, _ in told.verdict.failed] == ["p"]
    assert told.timeline.at("q", 100.0).state is State.CLEAR
    assert any("nothing is left to learn a bank from" in reason for reason in told.reasons)


@pytest.mark.nightly
def test_who_was_said_to_be_healthy_and_is_not_is_told():
    told = flown(LASTING, healthy=((0.0, 60.0),))
    assert any(
        re.match(r"r fails from \d+\.\d s on, in a span that was given as healthy", each) for each in told.reasons
    )
    assert told.identified_s[-1][1] < LASTING.onset_s

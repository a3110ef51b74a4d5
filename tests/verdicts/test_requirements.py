"""The checks of the corpus find what they are for, on timelines that are made up, and nothing else."""

import pytest

import gtmbench as gb
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, laid_out
from tests.verdicts.entries import Broken
from tests.verdicts.requirements import badly_built, false_all_clears, reached_s, wrong_names

SIZES = Sizes(error=1.0, within_s=60.0, factors=(0.6, 1.5), noise=2.0)
END_S = 100.0


def span(state, start_s, end_s, **more):
    told = {State.CLEAR: {"sizes": SIZES}, State.NOT_JUDGED: {"reason": "a gap"}}.get(state, {})
    return SensorSpan(start_s=start_s, end_s=end_s, state=state, **(told | more))


def timeline(*spans, motion_s=((0.0, END_S),)):
    return laid_out((0.0, END_S), {"p": spans, "q": [span(State.CLEAR, 0.0, END_S)]}, motion_s=motion_s)


CLEAR = timeline(span(State.CLEAR, 0.0, END_S))


def bias(size=3.0, onset_s=50.0, **more):
    return Broken(fault=gb.Bias(channel="p", onset_s=onset_s, size=size, **more))


@pytest.mark.parametrize(
    ("fault", "is_covered"),
    [
        (gb.Bias(channel="p", onset_s=50.0, size=-1.5), True),
        (gb.Bias(channel="p", onset_s=50.0, size=0.9), False),
        (gb.Drift(channel="p", onset_s=50.0, slope=-0.05), True),
        (gb.Drift(channel="p", onset_s=50.0, slope=0.015), False),
        (gb.ScaleFactor(channel="p", onset_s=50.0, factor=0.5), True),
        (gb.ScaleFactor(channel="p", onset_s=50.0, factor=1.6), True),
        (gb.ScaleFactor(channel="p", onset_s=50.0, factor=0.7), False),
        (gb.SignFlip(channel="p", onset_s=50.0), True),
        (gb.Noise(channel="p", onset_s=50.0, deviation=2.5), True),
        (gb.Noise(channel="p", onset_s=50.0, deviation=1.5), False),
        (gb.Jam(channel="p", onset_s=50.0), True),
        (gb.Stuck(channel="p", onset_s=50.0), True),
        (gb.Spikes(channel="p", onset_s=50.0, size=9.0, rate_hz=3.0), False),  # an entry says what is required
    ],
    ids=lambda each: f"{each.kind}-{each}"[:40] if isinstance(each, gb.Fault) else "",
)
def test_a_fault_in_a_clear_span_is_a_false_all_clear_from_the_stated_size_on(fault, is_covered):
    found = list(false_all_clears(CLEAR, [Broken(fault=fault)], END_S))
    assert [each.what for each in found] == ["false all-clear"] * is_covered


def test_sizes_that_say_nothing_of_a_kind_cover_none_of_it():
    bare = Sizes(error=1.0, within_s=60.0)
    for fault in (gb.SignFlip(channel="p", onset_s=1.0), gb.Noise(channel="p", onset_s=1.0, deviation=50.0)):
        assert reached_s(Broken(fault=fault), bare) == float("inf")


LATE = (span(State.CLEAR, 0.0, 56.0), span(State.FAILED, 56.0, END_S))
BACK = (span(State.CLEAR, 0.0, 50.0), span(State.FAILED, 50.0, 70.0), span(State.CLEAR, 70.0, END_S))
WHOLE = (span(State.CLEAR, 0.0, END_S),)


@pytest.mark.parametrize(
    ("spans", "fault", "is_one"),
    [
        ((span(State.CLEAR, 0.0, 50.5), span(State.FAILED, 50.5, END_S)), bias(), False),
        ((span(State.CLEAR, 0.0, 48.0), span(State.NOT_JUDGED, 48.0, END_S)), bias(), False),
        ((span(State.CLEAR, 0.0, 54.5), span(State.SUSPECTED, 54.5, END_S, suspects=("p", "phi"))), bias(), False),
        (LATE, bias(), True),  # dated far too late
        (BACK, bias(), True),  # clear again while the fault goes on
        (BACK, bias(duration_s=22.0), False),
        (WHOLE, bias(duration_s=8.0), False),  # what passes within ten seconds is no error that stays
        (WHOLE, bias(duration_s=12.0), True),
    ],
)
def test_a_false_all_clear_is_dated_late_or_clear_while_the_fault_stays(spans, fault, is_one):
    assert len(list(false_all_clears(timeline(*spans), [fault], END_S))) == is_one


def test_a_margin_asks_for_larger_faults_and_a_jam_for_motion():
    assert list(false_all_clears(CLEAR, [bias(size=1.4)], END_S, margin=1.5)) == []
    assert len(list(false_all_clears(CLEAR, [bias(size=1.6)], END_S, margin=1.5))) == 1
    parked = timeline(*WHOLE, motion_s=[(0.0, 40.0)])
    assert list(false_all_clears(parked, [Broken(fault=gb.Jam(channel="p", onset_s=50.0))], END_S)) == []


@pytest.mark.parametrize(
    ("start_s", "faults", "is_wrong"), [(50.0, [], True), (33.0, [bias()], False), (27.0, [bias()], True)]
)
def test_a_failure_without_a_fault_or_long_before_it_is_a_wrong_name(start_s, faults, is_wrong):
    failed = timeline(span(State.FAILED, start_s, END_S))
    assert [each.what for each in wrong_names(failed, faults, END_S)] == ["wrong name"] * is_wrong


def test_one_imu_answers_for_itself():
    second = laid_out((0.0, END_S), {"p": [], "p of IMU2": [span(State.FAILED, 50.0, END_S)]})
    fault = gb.Bias(channel="p", onset_s=50.0, size=3.0)
    assert list(wrong_names(second, [Broken(fault=fault, imu=2)], END_S)) == []
    assert len(list(wrong_names(second, [Broken(fault=fault)], END_S))) == 1


def test_a_timeline_has_every_sensor_the_whole_log_and_what_each_state_has_to_say():
    bad = timeline(
        span(State.CLEAR, 0.0, 20.0, sizes=None),
        span(State.NOT_JUDGED, 20.0, 40.0, reason=""),
        span(State.SUSPECTED, 40.0, 60.0, suspects=("q",)),
    )
    assert len(list(badly_built(bad, ("p", "q"), (0.0, END_S)))) == 3
    assert list(badly_built(CLEAR, ("p", "q"), (0.0, END_S))) == []
    assert len(list(badly_built(CLEAR, ("p", "q", "tas"), (0.0, END_S)))) == 1
    assert len(list(badly_built(CLEAR, ("p", "q"), (0.0, END_S + 30.0)))) == 1

"""A timeline covers its log, and the weightiest claim stands wherever several meet."""

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.verdict import timeline as timelines
from gtmbench.verdict.timeline import NOTHING_PREDICTS, SensorSpan, State, laid_out
from tests.helpers.timelines import END_S, claims, clear, failed, span, suspected, unjudged

WEIGHT = {"failed": 3, "suspected": 2, "not judged": 1, "clear": 0}


@given(claims())
def test_spans_cover_the_log_without_hole_or_overlap(made):
    timeline = laid_out((0.0, END_S), made)
    assert list(timeline.sensors) == list(made)
    for spans in timeline.sensors.values():
        assert (spans[0].start_s, spans[-1].end_s) == (0.0, END_S)
        assert all(before.end_s == after.start_s for before, after in pairwise(spans))
        assert all(each.duration_s > 0.0 for each in spans)


@given(claims(), st.integers(0, 17))
def test_the_weightiest_claim_of_an_instant_stands(made, tenth):
    time_s = 10.0 * tenth + 5.0
    timeline = laid_out((0.0, END_S), made)
    for sensor, own in made.items():
        there = [each.state.value for each in own if each.start_s < time_s < each.end_s]
        state = max(there, key=WEIGHT.get, default="not judged")
        assert timeline.at(sensor, time_s).state == state
        if not there:
            assert timeline.at(sensor, time_s).reason == NOTHING_PREDICTS


@given(claims())
def test_the_states_of_a_sensor_add_up_to_the_time_in_motion(made):
    timeline = laid_out((0.0, END_S), made, motion_s=[(15.0, 40.0), (100.0, 180.0)])
    for sensor in made:
        total_s = sum(timeline.motion_in(sensor, state) for state in State)
        assert total_s == pytest.approx(timeline.motion_total_s) == pytest.approx(105.0)


@given(claims())
def test_laying_out_a_timeline_again_changes_nothing(made):
    once = laid_out((0.0, END_S), made)
    again = laid_out((0.0, END_S), once.sensors)
    assert dict(again.sensors) == dict(once.sensors)


def test_claims_outside_of_the_log_are_cut_and_empty_ones_left_out():
    own = [failed("q", -20.0, 10.0), unjudged("gap", 170.0, 300.0), suspected(["q"], 50.0, 50.0)]
    spans = laid_out((0.0, END_S), {"q": [*clear()["q"], *own]}).sensors["q"]
    assert [(each.start_s, each.end_s, each.state.value) for each in spans] == [
        (0.0, 10.0, "failed"),
        (10.0, 170.0, "clear"),
        (170.0, 180.0, "not judged"),
    ]


def test_what_one_span_says_is_one_span_and_two_faults_are_two():
    fault = failed("q", 20.0, 60.0)
    other = failed("q", 60.0, 90.0, kind="jam", parameters={"value": 2.0})
    spans = laid_out((0.0, END_S), {"q": [fault, other, unjudged("gap", 30.0, 40.0)]}).of("q", State.FAILED)
    assert [(each.start_s, each.end_s, each.judgement.kind) for each in spans] == [
        (20.0, 60.0, "bias"),
        (60.0, 90.0, "jam"),
    ]


def test_what_isnt_judged_spans_what_it_was_told():
    told = SensorSpan(start_s=3.0, end_s=8.0, state=State.NOT_JUDGED, reason="gap")
    assert timelines.unjudged((3.0, 8.0), "gap") == told


def test_nothing_writes_to_a_timeline():
    timeline = laid_out((0.0, END_S), clear())
    with pytest.raises(TypeError):
        timeline.sensors["q"] = ()
    with pytest.raises(AttributeError):
        timeline.sensors["q"][0].state = State.FAILED


@pytest.mark.parametrize("time_s", [-0.1, 180.1, float("nan")])
def test_a_time_outside_of_the_log_is_refused(time_s):
    timeline = laid_out((0.0, END_S), {"q": [span(State.CLEAR)]})
    with pytest.raises(ValueError, match="outside of the log"):
        timeline.at("q", time_s)


@pytest.mark.parametrize(
    ("start_s", "end_s", "meets"),
    [
        (0.0, 20.0, False),
        (0.0, 20.5, True),
        (25.0, 30.0, True),
        (39.5, 60.0, True),
        (40.0, 60.0, False),
        (0.0, 99.0, True),
    ],
)
def test_spans_meet_that_share_time_and_those_that_touch_do_not(start_s, end_s, meets):
    one, other = span(State.CLEAR, 20.0, 40.0), span(State.CLEAR, start_s, end_s)
    assert one.duration_s == 20.0
    assert one.meets(start_s, end_s) == other.meets(20.0, 40.0) == meets


def test_an_instant_between_two_spans_lies_in_the_later_and_the_logs_end_in_the_last():
    own = [failed("q", 0.0, 60.0), suspected(["q"], 60.0, END_S)]
    timeline = laid_out((0.0, END_S), {"q": own})
    states = [timeline.at("q", time_s).state.value for time_s in (0.0, 59.9, 60.0, END_S)]
    assert states == ["failed", "failed", "suspected", "suspected"]
    assert own[0].covers(0.0)
    assert not own[0].covers(60.0)


def test_a_sensor_without_a_motion_or_a_row_is_judged_for_no_share_of_it():
    assert laid_out((0.0, END_S), clear()).judged_share("q") == 0.0
    moving = laid_out((0.0, END_S), clear(0.0, 45.0), motion_s=[(0.0, END_S)])
    assert moving.judged_share("tas") == 0.0
    assert laid_out((0.0, END_S), clear(), motion_s=[(5.0, 5.5)]).judged_share("q") == 1.0  # however short it is
    assert moving.judged_share("q") == 0.25

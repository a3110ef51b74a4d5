"""The exit code: one pure function of a timeline and of what is asked, that no excuse turns into an all-clear."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import Sizes, State, laid_out
from gtmbench.verdict.verdict import verdict_of, within
from tests.helpers.timelines import END_S, cases, clear, failed, span, spans, suspected, unjudged, verdict


def with_claim(timeline, sensor, claim):
    """Return a timeline that has one claim more."""
    made = {name: [*([claim] if name == sensor else []), *own] for name, own in timeline.sensors.items()}
    return laid_out(timeline.span_s, made, motion_s=timeline.motion_s)


def test_a_scope_holds_sizes_against_what_is_clear_and_has_some():
    kept = [span(State.CLEAR, 0.0, 9.0), span(State.NOT_JUDGED, 9.0, 99.0, sizes=Sizes(error=1e3, within_s=60.0))]
    assert within(laid_out((0.0, 99.0), {"q": kept}), Scope(sensors=("q",))).sensors["q"] == tuple(kept)


@given(cases())
def test_a_scope_only_turns_clear_into_not_judged_and_says_why(case):
    timeline, scope = case
    for sensor, before in timeline.sensors.items():
        for was, is_ in zip(before, within(timeline, scope).sensors[sensor], strict=True):
            if was != is_:
                assert (was.state, is_.state) == (State.CLEAR, State.NOT_JUDGED)
                assert is_.reason
                assert (was.start_s, was.end_s, was.sizes) == (is_.start_s, is_.end_s, is_.sizes)
            elif was.state is State.CLEAR:
                assert was.sizes.error <= scope.limit_of(sensor)


@given(cases(), st.data())
def test_a_failure_more_always_ends_with_1(case, data):
    timeline, scope = case
    sensor = data.draw(st.sampled_from(sorted(timeline.sensors)))
    assert verdict_of(with_claim(timeline, sensor, data.draw(spans(sensor, State.FAILED))), scope).exit_code == 1


@given(cases(), st.data())
def test_what_isnt_judged_or_is_suspected_never_makes_it_0(case, data):
    timeline, scope = case
    sensor = data.draw(st.sampled_from(sorted(timeline.sensors)))
    claim = data.draw(spans(sensor, State.SUSPECTED, State.NOT_JUDGED))
    before = verdict_of(timeline, scope).exit_code
    after = verdict_of(with_claim(timeline, sensor, claim), scope).exit_code
    assert (before, after) not in [(1, 0), (3, 0)]


@given(cases(), st.floats(1.0, 5.0))
def test_a_higher_limit_never_hides_a_failure_and_asks_no_more(case, times):
    timeline, scope = case
    raised = replace(scope, error_deg_s=times * scope.error_deg_s, error_deg=times * scope.error_deg)
    before, after = (verdict_of(timeline, each).exit_code for each in (scope, raised))
    assert (before == 1) == (after == 1)
    assert (before, after) != (0, 3)


@given(cases(), st.data())
def test_to_ask_of_more_sensors_never_makes_it_0(case, data):
    timeline, scope = case
    more = replace(scope, sensors=(*scope.sensors, *data.draw(st.lists(st.sampled_from(sorted(timeline.sensors))))))
    before, after = (verdict_of(timeline, each).exit_code for each in (scope, more))
    assert (before, after) not in [(1, 0), (3, 0), (1, 3)]


@given(cases())
def test_an_all_clear_holds_for_every_asked_sensor(case):
    judged = verdict_of(*case)
    if judged.exit_code != 0:
        return
    for sensor in judged.scope.sensors:
        assert not judged.timeline.of(sensor, State.FAILED, State.SUSPECTED)
        sure_s = judged.timeline.motion_in(sensor, State.CLEAR)
        assert sure_s >= 0.75 * judged.timeline.motion_total_s - 1e-9 > 0.0
        assert judged.sizes_of(sensor).error <= judged.scope.limit_of(sensor)


@pytest.mark.parametrize(
    ("claims", "code"),
    [
        ({}, 0),
        ({"q": [failed("q", 60.0, 70.0)]}, 1),
        ({"q": [suspected(["q", "theta"], 60.0, 70.0)]}, 1),
        ({"tas": [failed("tas", 60.0, 70.0)]}, 1),
        ({"tas": [suspected(["tas", "gps"], 60.0, 70.0)]}, 0),
        ({"r": [unjudged("gap", 0.0, 44.9)]}, 0),
        ({"r": [unjudged("gap", 0.0, 45.1)]}, 3),
        ({"tas": [unjudged("gap")]}, 0),
        ({"r": [unjudged("gap")], "q": [failed("q", 60.0, 70.0)]}, 1),
    ],
)
def test_the_exit_code(claims, code):
    made = clear()
    for sensor, own in claims.items():
        made[sensor] = [*made.get(sensor, []), *own]
    assert verdict(made).exit_code == code


def test_nothing_that_moves_and_nothing_that_is_asked_is_no_all_clear():
    assert verdict(clear(), motion_s=()).exit_code == 3
    assert verdict(clear(), asked=()).exit_code == 3
    assert verdict(clear(sensors=("p",)), asked=("p", "q")).exit_code == 3  # q isn't in the log


def test_what_isnt_judged_while_nothing_moves_costs_nothing():
    made = clear(100.0, 180.0)
    assert verdict(made, motion_s=[(100.0, 180.0)]).exit_code == 0
    assert verdict(made, motion_s=[(0.0, 180.0)]).exit_code == 3


@pytest.mark.parametrize(
    ("factors", "code"), [((0.8, 1.2), 0), ((0.7, 9.0), 0), ((0.1, 0.7), 0), ((0.6, 1.2), 3), (None, 3)]
)
def test_a_factor_is_held_where_it_is_asked(factors, code):
    made = {"q": [span(State.CLEAR, sizes=Sizes(error=0.5, within_s=60.0, factors=factors))]}
    assert verdict(made, asked=("q",)).exit_code == 0
    assert verdict(made, asked=("q",), factor=0.7).exit_code == code


def test_failures_and_suspicions_are_listed_in_time():
    made = clear()
    made["q"] += [failed("q", 90.0, 95.0), failed("q", 20.0, 25.0)]
    made["p"].append(suspected(["p", "phi"], 40.0, 50.0))
    made["tas"] = [failed("tas", 30.0, 60.0)]
    judged = verdict(made)
    assert [(name, each.start_s) for name, each in judged.failed] == [("q", 20.0), ("tas", 30.0), ("q", 90.0)]
    assert [(name, each.start_s) for name, each in judged.suspected] == [("p", 40.0)]


def test_a_scope_keeps_what_it_isnt_asked():
    scope = Scope(sensors=("q",))
    assert verdict_of(laid_out((0.0, END_S), clear()), scope).scope is scope


def test_a_sensor_at_its_limits_is_judged_and_clear():
    """A limit of 5 deg/s lets 5 deg/s pass; three quarters of the motion are enough."""
    at_limit = span(State.CLEAR, 0.0, 135.0, sizes=Sizes(error=5.0, within_s=60.0))
    enough = verdict({"q": [at_limit]}, asked=("q",))
    assert (enough.exit_code, enough.unjudged) == (0, ())
    above = span(State.CLEAR, 0.0, 135.0, sizes=Sizes(error=5.1, within_s=60.0))
    assert verdict({"q": [above]}, asked=("q",)).exit_code == 3


def test_the_share_that_is_judged_is_the_least_of_some_sensors_and_none_of_no_sensor():
    judged = verdict({"p": [*clear(0.0, 90.0)["p"]], "q": [*clear(0.0, 45.0)["q"]]})
    assert judged.judged_share("p", "q") == 0.25
    assert judged.judged_share() == 0.0
    assert verdict(clear(0.0, 90.0, sensors="pq"), asked=("q", "p", "r")).unjudged == ("q", "p", "r")


def test_the_sizes_of_a_sensor_are_the_worst_of_its_clear_spans():
    small = Sizes(error=0.5, within_s=20.0, factors=(0.8, 1.2), noise=0.4)
    large = Sizes(error=2.0, within_s=60.0, factors=(0.6, 1.1), noise=1.5)
    own = [span(State.CLEAR, 0.0, 90.0, sizes=small), span(State.CLEAR, 90.0, END_S, sizes=large)]
    assert verdict({"q": own}).sizes_of("q") == Sizes(error=2.0, within_s=60.0, factors=(0.6, 1.2), noise=1.5)
    unknown = span(State.CLEAR, 0.0, 10.0, sizes=Sizes(error=3.0, within_s=30.0))
    assert verdict({"q": [unknown, *own]}).sizes_of("q") == Sizes(error=3.0, within_s=60.0, factors=None, noise=None)
    assert verdict({"q": [unjudged("gap")]}).sizes_of("q") is None


def test_why_a_sensor_isnt_judged_is_told_by_what_costs_most_of_the_motion_then_most_of_the_log():
    own = [unjudged("stands", 0.0, 60.0), unjudged("gap", 60.0, 70.0), unjudged("stands longer", 100.0, END_S)]
    judged = verdict({"q": [*own, *clear(70.0, 100.0)["q"]]}, motion_s=[(60.0, 100.0)])
    assert judged.reasons_of("q") == ("gap", "stands longer", "stands")

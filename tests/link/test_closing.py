"""The closing word of a link: clear where every test was armed, failed by an alarm, and no verdict by silence."""

import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.link.closing import closing_verdict
from gtmbench.verdict.timeline import State
from gtmbench.verdict.verdict import Outcome
from tests.helpers import monitors

HEARD = [(10.0, 70.0), (80.0, 130.0)]
ALL = [(10.0, 70.0), (80.0, 130.0)]
FUNCTION = gb.FunctionDetector(lambda _: [], name="level", channels=("p", "q")).calibrate()


def alarm(sensor="q", candidates=("q",), onset_s=90.0, ended_s=None, doubt=""):
    judged = Judgement(time_s=onset_s + 5.0, sensor=sensor, candidates=candidates, kind="bias", doubt=doubt)
    return Alarm(number=0, time_s=onset_s + 1.0, onset_s=onset_s, source="q", judgements=(judged,), ended_s=ended_s)


def closed(heard=HEARD, armed=ALL, alarms=(), why_not="", monitor=None):
    return closing_verdict(monitor or monitors.monitor(), heard, armed, alarms, why_not)


def states(said, sensor):
    return [(span.state.value, span.start_s, span.end_s) for span in said.timeline.sensors[sensor]]


def test_a_healthy_link_is_clear_where_it_was_armed_and_exits_with_0():
    said = closed()
    assert (said.outcome, said.exit_code) == (Outcome.HEALTHY, 0)
    assert set(said.scope.sensors) == set(monitors.monitor().suspects)
    assert states(said, "q") == [("clear", 10.0, 70.0), ("not judged", 70.0, 80.0), ("clear", 80.0, 130.0)]
    assert said.timeline.motion_total_s == 110.0  # what wasn't heard is no motion
    assert said.timeline.at("q", 20.0).sizes is None


@pytest.mark.parametrize(
    ("armed_s", "outcome"), [(90.0, Outcome.HEALTHY), (75.0, Outcome.UNKNOWN), (0.0, Outcome.UNKNOWN)]
)
def test_a_link_of_which_too_little_was_armed_is_no_verdict(armed_s, outcome):
    armed = [(10.0, min(10.0 + armed_s, 70.0)), (80.0, max(80.0, 80.0 + armed_s - 60.0))]
    said = closed(armed=[each for each in armed if each[1] > each[0]])
    assert said.outcome == outcome
    assert said.judged_share("p") == pytest.approx(armed_s / 110.0)
    assert "could not have alarmed" in said.timeline.at("p", 129.0).reason


def test_an_alarm_fails_its_sensor_until_its_end_and_exits_with_1():
    said = closed(alarms=[alarm()])
    assert (said.outcome, said.exit_code) == (Outcome.FAILED, 1)
    assert states(said, "q")[-1] == ("failed", 90.0, 130.0)
    assert states(said, "p")[-1] == ("clear", 80.0, 130.0)
    over = closed(alarms=[alarm(ended_s=100.0)])
    assert over.exit_code == 1
    assert states(over, "q")[-2:] == [("failed", 90.0, 100.0), ("clear", 100.0, 130.0)]


def test_what_is_left_open_is_suspected_and_what_is_doubted_is_not_judged():
    open_one = closed(alarms=[alarm(None, ("q", "theta"))])
    assert open_one.exit_code == 1
    assert [open_one.timeline.at(name, 100.0).state for name in ("q", "theta", "p")] == [
        State.SUSPECTED,
        State.SUSPECTED,
        State.CLEAR,
    ]
    doubted = closed(alarms=[alarm(None, ("q", "theta"), doubt="motion or model")])
    assert doubted.timeline.at("q", 100.0).state is State.NOT_JUDGED
    assert doubted.exit_code == 3


def test_an_alarm_of_a_sensor_that_is_not_asked_fails_all_the_same():
    said = closed(alarms=[alarm("tas", ("tas",))], monitor=monitors.monitor())
    assert said.timeline.at("tas", 100.0).state is State.FAILED
    assert said.exit_code == 1


def test_the_silence_of_a_function_says_nothing_and_its_alarm_does():
    said = closed(monitor=FUNCTION)
    assert said.exit_code == 3
    assert not said.timeline.of("p", State.CLEAR)
    assert said.timeline.at("p", 20.0).reason == "level states no size that it would find, so its silence says nothing"
    risen = Alarm(number=0, time_s=91.0, onset_s=90.0, source="level")
    alarmed = closed(monitor=FUNCTION, alarms=[risen])
    assert alarmed.exit_code == 1
    assert alarmed.timeline.at("q", 100.0).suspects == ("p", "q")


def test_a_reason_why_nothing_can_be_judged_stands_everywhere():
    said = closed(why_not="the axes are turned")
    assert said.exit_code == 3
    assert {span.reason for span in said.timeline.of("p", State.NOT_JUDGED)} == {"the axes are turned"}
    assert closed(why_not="the axes are turned", alarms=[alarm()]).exit_code == 1


def test_a_link_that_was_silent_is_no_verdict():
    said = closed(heard=[], armed=[])
    assert said.exit_code == 3
    assert said.timeline.motion_total_s == 0.0

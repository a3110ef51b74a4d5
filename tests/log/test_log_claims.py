"""What alarms, checks, excursions and certificates claim of sensors: the state that each kind asks for, never clear."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import OUTSIDE, Alarm, Judgement
from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.detectors.monitor.regime import IMPACT
from gtmbench.detectors.protocol import Score, Watch
from gtmbench.intake.flight_log import Unread
from gtmbench.log.judging.certificate import Certificate
from gtmbench.log.judging.claims import (
    began_s,
    excuses,
    motion_spans,
    of_alarm,
    of_certificate,
    of_check,
    of_excursions,
    of_unread,
    of_watches,
)
from gtmbench.log.self_check.refusal import Doubt, SelfCheck, Stop
from gtmbench.verdict.timeline import State

END_S = 200.0
CONCERNED = ("q", "theta")


def alarm(*judgements, time_s=52.0, onset_s=50.0, **more):
    return Alarm(number=0, time_s=time_s, onset_s=onset_s, source="q", judgements=judgements, **more)


def judged(sensor, candidates, time_s=60.0, **more):
    return Judgement(time_s=time_s, sensor=sensor, candidates=tuple(candidates), **more)


NAMED = judged("q", ["q"], kind="bias", parameters={"size": 3.0, "onset_s": 49.5})
EITHER = judged(None, ["q", "theta"], kind="bias", reason="both explain it")
DOUBT = judged(None, ["q", "theta"], doubt="motion or model")
NAMED_IN_DOUBT = judged("q", ["q"], kind="bias", doubt="motion or model")
PASSED = judged(None, [])
SWAPPED = judged("p", ["p"], kind="swap", partner="q")
TURNED = judged("p", ["p"], kind="turn", partner="q")
OTHER_IMU = judged("q", ["q"], kind="bias", imu="IMU2")
OWN_IMU = judged("q", ["q"], kind="bias", imu="IMU1")


def told(given, end_s=END_S, concerned=CONCERNED, watched_imu="IMU1", excursions=()):
    """Return {sensor: (state, start, end)} that an alarm claims."""
    claims = list(of_alarm(given, end_s, concerned, watched_imu, excursions))
    assert len({sensor for sensor, _ in claims}) == len(claims)
    return {sensor: (span.state.value, span.start_s, span.end_s) for sensor, span in claims}


@pytest.mark.parametrize(
    ("judgement", "expected"),
    [
        (NAMED, {"q": ("failed", 49.5, END_S)}),
        (EITHER, {"q": ("suspected", 50.0, END_S), "theta": ("suspected", 50.0, END_S)}),
        (DOUBT, {"q": ("not judged", 50.0, END_S), "theta": ("not judged", 50.0, END_S)}),
        (NAMED_IN_DOUBT, {"q": ("not judged", 50.0, END_S), "theta": ("not judged", 50.0, END_S)}),
        (PASSED, {"q": ("not judged", 50.0, 60.0), "theta": ("not judged", 50.0, 60.0)}),
        (SWAPPED, {"p": ("failed", 50.0, END_S), "q": ("failed", 50.0, END_S)}),
        (TURNED, {"p": ("failed", 50.0, END_S)}),
        (OTHER_IMU, {"q of IMU2": ("failed", 50.0, END_S)}),
        (OWN_IMU, {"q": ("failed", 50.0, END_S)}),
    ],
    ids=["named", "either", "doubt", "named in doubt", "passed", "swapped", "turned", "other IMU", "own IMU"],
)
def test_each_kind_of_alarm_claims_its_state(judgement, expected):
    assert told(alarm(judgement)) == expected


@pytest.mark.parametrize("judgement", [NAMED, EITHER, DOUBT, PASSED, SWAPPED, OTHER_IMU, None])
@pytest.mark.parametrize("test", ["", OUTSIDE, "missing"])
@pytest.mark.parametrize("ended_s", [None, 90.0, 51.0])
@pytest.mark.parametrize("concerned", [CONCERNED, ("p", "q", "r")])
def test_no_alarm_clears_anything_and_each_claims_something(judgement, test, ended_s, concerned):
    given = alarm(*([judgement] if judgement else []), test=test, ended_s=ended_s)
    about = Excursion(start_s=45.0, end_s=70.0, reason=IMPACT)
    claims = list(of_alarm(given, END_S, concerned, "IMU1", [about]))
    assert claims
    for _, span in claims:
        assert span.state is not State.CLEAR
        assert span.start_s <= given.onset_s
        assert given.time_s <= span.end_s <= END_S


def test_whom_nobody_judges_is_suspected_of_all_that_are_concerned():
    """A rival's or a function's alarm: what its statistic depends on."""
    claims = dict(of_alarm(alarm(), END_S, ("p", "q", "tas"), ""))
    assert {sensor: span.suspects for sensor, span in claims.items()} == dict.fromkeys("pq", ("p", "q", "tas")) | {
        "tas": ("p", "q", "tas")
    }
    assert {span.state for span in claims.values()} == {State.SUSPECTED}
    assert "52.0 s" in claims["tas"].reason


def test_an_end_ends_the_claim_and_never_before_the_alarm():
    assert told(alarm(NAMED, ended_s=90.0))["q"] == ("failed", 49.5, 90.0)
    assert told(alarm(NAMED, ended_s=51.0))["q"] == ("failed", 49.5, 52.0)
    assert told(alarm(ended_s=90.0))["q"] == ("suspected", 50.0, 90.0)
    assert told(alarm(PASSED, ended_s=90.0))["q"] == ("not judged", 50.0, 90.0)


def test_suspects_are_all_of_the_candidates():
    claims = dict(of_alarm(alarm(EITHER), END_S, (), ""))
    assert {span.suspects for span in claims.values()} == {("q", "theta")}
    assert {span.reason for span in claims.values()} == {"both explain it"}
    of_other = dict(of_alarm(alarm(judged(None, ["q", "r"], imu="IMU2")), END_S, (), "IMU1"))
    assert set(of_other) == {"q of IMU2", "r of IMU2"}


def test_a_passed_alarm_is_of_its_own_axis_where_that_is_concerned_and_of_all_where_it_is_not():
    assert set(told(alarm(PASSED), concerned=("p", "q", "r"))) == {"q", "theta"}
    other = Alarm(number=0, time_s=52.0, onset_s=50.0, source="residual", judgements=(PASSED,))
    assert set(told(other, concerned=("p", "r"))) == {"p", "r"}


@pytest.mark.parametrize("judgement", [EITHER, DOUBT, NAMED])
def test_an_alarm_of_an_excursion_alone_ends_with_it(judgement):
    about = [Excursion(start_s=48.0, end_s=70.0, reason=IMPACT), Excursion(start_s=100.0, end_s=120.0, reason=IMPACT)]
    spans = told(alarm(judgement, test=OUTSIDE), excursions=about)
    assert {span[2] for span in spans.values()} == {70.0}
    assert {span[2] for span in told(alarm(judgement, test=OUTSIDE)).values()} == {52.0}
    assert {span[2] for span in told(alarm(judgement), excursions=about).values()} == {END_S}


def test_a_fault_begins_where_its_kind_is_fitted_and_no_later_than_its_alarm():
    assert began_s(alarm(NAMED)) == 49.5
    assert began_s(alarm(EITHER)) == began_s(alarm()) == 50.0
    late = judged("q", ["q"], kind="drift", parameters={"onset_s": 55.0})
    assert told(alarm(late))["q"][1] == 52.0


# the self-check -------------------------------------------------------------------------------------------------------


def test_where_the_check_stops_no_sensor_is_judged():
    check = SelfCheck(stops=(Stop(text="other motion"), Stop(text="and more")))
    claims = list(of_check(check, (0.0, END_S), ("p", "tas")))
    assert [(sensor, span.state.value, span.reason) for sensor, span in claims] == [
        ("p", "not judged", "other motion"),
        ("tas", "not judged", "other motion"),
    ]
    causes = SelfCheck(causes=tuple(SimpleNamespace(text=each) for each in ("p is -p", "phi is -phi", "p is -p")))
    assert {span.reason for _, span in of_check(causes, (0.0, END_S), ("p",))} == {"p is -p or phi is -phi"}


def test_a_doubt_is_of_those_that_it_names_or_of_all():
    claims = list(of_check(SelfCheck(doubts=(Doubt(text="why", sensors=("q",)),)), (10.0, END_S), "pqr"))
    assert [(sensor, span.start_s, span.end_s) for sensor, span in claims] == [("q", 10.0, END_S)]
    everyone = of_check(SelfCheck(doubts=(Doubt(text="why"),)), (10.0, END_S), ("p", "q"))
    assert [(sensor, span.state) for sensor, span in everyone] == [(name, State.NOT_JUDGED) for name in "pq"]
    assert not list(of_check(SelfCheck(), (0.0, END_S), ("p",)))


# excursions and what wasn't read --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reason", "is_judged", "is_excused"), [(IMPACT, False, True), (IMPACT, True, False), (MOTION, False, False)]
)
def test_only_what_is_no_mere_motion_and_not_judged_excuses(reason, is_judged, is_excused):
    about = Excursion(start_s=10.0, end_s=20.0, reason=reason, is_judged=is_judged)
    claims = list(of_excursions([about], ("p", "tas")))
    assert excuses(about) == is_excused == bool(claims)
    assert all((span.state, span.start_s, span.end_s) == (State.NOT_JUDGED, 10.0, 20.0) for _, span in claims)
    assert [sensor for sensor, _ in claims] == (["p", "tas"] if is_excused else [])


def test_what_was_not_read_is_not_judged_with_its_reason():
    claims = list(of_unread([Unread(start_s=3.0, end_s=7.0, reason="gap")], ("p", "q")))
    assert [(sensor, span.start_s, span.end_s, span.state, span.reason) for sensor, span in claims] == [
        (name, 3.0, 7.0, State.NOT_JUDGED, "gap") for name in "pq"
    ]


@pytest.mark.parametrize(
    ("reason", "span_s", "counts"),
    [
        ("gap", (40.0, 50.0), True),
        ("clock jump", (40.0, 50.0), False),
        ("clock set back", (40.0, 50.0), False),
        ("samples come at 25 Hz instead of 100", (90.0, 120.0), True),  # up to the end
        ("attitude not logged yet", (0.0, 5.0), True),
        ("gap", (60.0, 70.0), False),  # motion before it alone
        ("gap", (64.4, 80.6), True),  # within five seconds
        ("gap", (64.6, 80.6), False),
        ("gap", (64.4, 80.4), False),
        ("gap", (20.0, 30.0), False),  # none on either side
    ],
)
def test_what_was_not_read_is_motion_where_it_lies_between_motion(reason, span_s, counts):
    lively = [*np.arange(5.5, 10.0), *np.arange(35.5, 40.0), *np.arange(50.5, 60.0), *np.arange(85.5, 90.0)]
    spans = motion_spans(lively, (0.0, 120.0), [Unread(start_s=span_s[0], end_s=span_s[1], reason=reason)])
    moving_s = sum(end_s - start_s for start_s, end_s in spans)
    assert moving_s == pytest.approx(len(lively) + (span_s[1] - span_s[0]) * counts)
    assert all(first[1] < second[0] for first, second in pairwise(spans))


def test_nothing_that_stands_is_motion():
    assert motion_spans([], (0.0, 50.0), [Unread(start_s=0.0, end_s=50.0, reason="gap")]) == ()


# residuals and certificates -------------------------------------------------------------------------------------------


def watch_of(armed, values=0.5, start_s=0.0, name="q"):
    armed = np.asarray(armed, dtype=bool)
    record = gb.Record(np.zeros(len(armed)), channels=["q"], sample_period_s=0.1, start_s=start_s)
    score = Score(name=name, values=np.full(len(armed), values), known_s=record.time_s, armed=armed, channels=("q",))
    return Watch(monitor=None, record=record, scores={name: score}, alarms=())


def test_a_residual_that_never_came_down_leaves_its_axis_not_judged_and_no_other():
    stuck = watch_of(np.zeros(300), values=4.0)
    claims = list(of_watches([stuck, watch_of(np.ones(300), name="p")]))
    assert [(sensor, span.state, span.end_s) for sensor, span in claims] == [
        (name, State.NOT_JUDGED, pytest.approx(29.9)) for name in ("q", "theta")
    ]


def row(kind, size, within_s=5.0):
    return SimpleNamespace(sensor="q", kind=kind, size=size, within_s=within_s)


def certified(*rows, armed, states=(State.CLEAR,)):
    spans = [span for _, span in of_certificate(Certificate(rows=rows), [watch_of(armed)])]
    return [span for span in sorted(spans, key=lambda span: span.start_s) if span.state in states]


def test_a_certificate_clears_where_its_test_was_armed_for_long_enough():
    armed = np.ones(1000)
    armed[:100] = armed[400:600] = 0
    armed[203:206] = 0  # a pause that its statistic looks over
    spans = certified(row("bias", 2.0), row("scale_factor", 0.4), armed=armed)
    assert [(round(span.start_s, 1), round(span.end_s, 1)) for span in spans] == [(10.0, 34.9), (60.0, 94.9)]
    assert {span.state for span in spans} == {State.CLEAR}
    assert spans[0].sizes.error == 2.0
    assert spans[0].sizes.within_s == 5.0
    assert spans[0].sizes.noise is None
    rest = certified(row("bias", 2.0), armed=armed, states=(State.NOT_JUDGED,))
    assert [(round(span.start_s, 1), round(span.end_s, 1)) for span in rest] == [
        (0.0, 10.0),
        (34.9, 60.0),
        (94.9, 99.9),
    ]
    assert {span.reason for span in rest} == {"too little is known before or behind it"}


@pytest.mark.parametrize("pause_s", [0.6, 2.0])
def test_a_longer_pause_is_not_clear(pause_s):
    armed = np.ones(1000)
    armed[500 : 500 + round(pause_s * 10)] = 0
    assert len(certified(row("bias", 2.0), armed=armed)) == 2


def test_no_size_is_no_certificate_nor_is_a_stretch_that_is_shorter_than_its_delay():
    assert not certified(row("bias", None), armed=np.ones(1000))
    assert not certified(row("drift", 0.1), armed=np.ones(1000))
    assert not certified(row("bias", 2.0, within_s=200.0), armed=np.ones(1000))
    assert not certified(row("bias", 2.0), armed=np.zeros(1000))
    (span,) = certified(row("bias", None), armed=np.ones(1000), states=tuple(State))
    assert (span.start_s, round(span.end_s, 1), span.reason) == (0.0, 99.9, "no error of it would show here")
    assert certified(row("drift", 0.1), armed=np.ones(1000), states=tuple(State)) == []

"""What the engine says of a flight: whom it accuses, as claims, alarms and curves; what stays open isn't excluded."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest

from gtmbench.detectors.alarm import MOST_PROBABLE
from gtmbench.engine.finding import FROZEN, Side
from gtmbench.engine.hindsight.cleared_sensors import LevelChange
from gtmbench.engine.judged import judged, leaning
from gtmbench.engine.named import WHOLE, alarm_of, judgement_of
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State, laid_out
from tests.engine.engine_flights import flight_from
from tests.helpers.night import by_day
from tests.helpers.turning import from_on, motion, with_error


@cache
def said(size=0.0, onset_s=60.0):
    return judged(flight_from(with_error(motion(), "q", from_on(onset_s, size)), is_driven=False))


def clear_at(found, time_s, sensor="q"):
    return laid_out((0.0, 120.0), found.claims).at(sensor, time_s)


def only(found, **changes):
    """Return the same with its one finding changed."""
    (finding,) = found.found
    return replace(found, found=(replace(finding, **changes),))


# whom it accuses -----------------------------------------------------------------------------------------------------


def test_a_finding_is_a_claim_an_alarm_and_a_curve_of_one_sensor():
    found = said(3.0)
    ((sensor, span),) = found.accused
    assert (sensor, span.state, span.end_s) == ("q", State.FAILED, pytest.approx(120.0, abs=0.2))
    (alarm,) = found.alarms
    assert (alarm.sensor, alarm.test, alarm.onset_s, alarm.ended_s) == ("q", WHOLE, span.start_s, None)
    assert alarm.last.kind == "bias"
    assert alarm.last.parameters["size"] == pytest.approx(3.0, abs=0.3)
    low, high = alarm.last.intervals["size"]
    assert low < alarm.last.parameters["size"] < high < low + 2.0
    (curve,) = found.curves
    late = curve.time_s > 65.0
    assert np.nanmean(curve.measured[late]) == pytest.approx(np.mean(curve.predicted[late]), abs=0.2)
    assert np.nanmean(curve.measured[curve.time_s < 55.0]) == pytest.approx(0.0, abs=0.2)


def test_an_alarm_is_raised_when_enough_was_seen():
    (soon,), (late,) = said(5.0).alarms, said(2.0).alarms
    assert 60.0 < soon.time_s < 66.0
    assert 60.0 < late.time_s < 80.0


def test_a_fault_that_ends_has_an_end():
    record = with_error(motion(180.0), "p", from_on(50.0, 3.0, 110.0))
    (alarm,) = judged(flight_from(record, is_driven=False)).alarms
    assert (alarm.sensor, alarm.ended_s) == ("p", pytest.approx(110.0, abs=3.0))


@pytest.mark.parametrize(
    ("kind", "size", "told", "named"),
    [
        ("drift", 0.2, {"slope": 0.2}, "drift"),
        ("scale", -1.0, {"factor": 0.5}, "scale_factor"),
        ("scale", 2.0, {}, "sign_flip"),
        ("step", 4.0, {"size": 4.0}, "bias"),
    ],
)
def test_kinds_are_called_as_faults_are(kind, size, told, named):
    (finding,) = said(3.0).found
    best = replace(finding.best, kind=kind)
    found = only(said(3.0), ranked=((best, 0.0),), size=size, interval=(size - 0.1, size + 0.1))
    last = found.alarms[0].last
    assert last.kind == named
    assert {name: value for name, value in last.parameters.items() if name != "onset_s"} == pytest.approx(told)


def test_of_several_suspects_each_is_suspected():
    (finding,) = said(3.0).found
    other = next(each for each in said(3.0).model.explanations if each.suspect == "theta")
    found = only(said(3.0), ranked=(*finding.ranked, (other, 1.0)))
    assert {(sensor, span.state) for sensor, span in found.accused} == {
        ("q", State.SUSPECTED),
        ("theta", State.SUSPECTED),
    }
    assert found.alarms[0].sensor is None


def test_a_doubt_accuses_nobody():
    found = only(said(3.0), doubt="it moves more there")
    assert (found.accused, found.alarms) == ((), ())
    assert [curve.sensor for curve in found.curves] == ["q"]  # what it is doubted for is shown all the same


def test_odds_are_of_a_sensor_and_then_of_its_kind_and_an_alarm_is_raised_within_its_span():
    (finding,) = said(3.0).found
    chances = (("q", "bias", 0.6), ("q", "drift", 0.3), ("theta", "step", 0.05), ("wind", "changes", 0.05))
    told = judgement_of(replace(finding, chances=chances), 70.0)
    assert (told.probability, told.kind_probability) == pytest.approx((0.9, 0.6 / 0.9))
    assert (told.reason, judgement_of(replace(finding, others=("p",)), 70.0).reason) == ("", "q or p explains it")
    sure = judgement_of(replace(finding, chances=(("q", "bias", 1.0),)), 70.0)
    assert (sure.probability, sure.kind_probability) == (MOST_PROBABLE, MOST_PROBABLE)
    for unweighed in (replace(finding, chances=()), replace(finding, chances=chances, others=("references",))):
        assert judgement_of(unweighed, 70.0).probability is None
    for shows_s, raised_s in ((-np.inf, 60.0), (75.0, 75.0), (300.0, 120.0)):
        alarm = alarm_of(replace(finding, shows_s=shows_s, lasts=False), 4, (60.0, 120.0))
        assert (alarm.number, alarm.time_s, alarm.last.time_s, alarm.ended_s) == (4, raised_s, raised_s, 120.0)


# what is clear beside it ---------------------------------------------------------------------------------------------


def test_beside_a_doubt_no_error_is_excluded_that_is_as_large():
    healthy = clear_at(said(), 90.0).sizes
    (finding,) = said(3.0).found
    beside = replace(said(), found=(replace(finding, doubt="it moves more there"),))
    assert healthy.error < 1.0
    assert clear_at(beside, 90.0).sizes == replace(healthy, error=pytest.approx(1.2 * abs(finding.size)))
    assert clear_at(beside, 90.0, "p").sizes == clear_at(said(), 90.0, "p").sizes
    assert clear_at(beside, 30.0).sizes == healthy  # before it may have begun
    for lasts_s, is_open in ((9.9, False), (10.0, True)):
        passing = replace(beside, found=(replace(beside.found[0], end_s=finding.onset_s + lasts_s),))
        assert (clear_at(passing, finding.onset_s + 5.0).sizes != healthy) == is_open
    accusing = replace(beside, found=(finding,))  # what accuses somebody opens nothing, but for when it may have begun
    opened = {
        sensor: spans[len(said().cleared.claims[sensor]) :] for sensor, spans in accusing.beside(said().cleared).items()
    }
    (earlier,) = opened.pop("q")
    assert (earlier.state, earlier.end_s) == (State.NOT_JUDGED, finding.onset_s)
    assert earlier.start_s == finding.onset_range_s[0] - 2.0
    assert set(opened.values()) == {()}
    frozen = replace(accusing, found=(replace(finding, ranked=((replace(finding.best, kind=FROZEN), 0.0),)),))
    for exact in (frozen, replace(accusing, found=(replace(finding, side=Side.BEFORE),))):
        assert exact.beside(said().cleared) == said().cleared.claims


def test_beside_a_doubt_of_a_gain_no_factor_is_excluded():
    (finding,) = said(3.0).found
    gain = next(each for each in said(3.0).model.explanations if each.name == "q scale")
    doubted = replace(finding, ranked=((gain, 0.0),), size=0.3, doubt="it moves more there")
    sizes = clear_at(replace(said(), found=(doubted,)), 90.0).sizes
    assert sizes == replace(clear_at(said(), 90.0).sizes, factors=None)


def test_where_a_side_is_open_both_sides_are():
    found = only(said(3.0), side=Side.OPEN, doubt="q is off before or after it")
    beside = replace(said(), found=found.found)
    assert clear_at(beside, 30.0).sizes.error > 2.0


@pytest.mark.parametrize(("deg_s", "until_s", "leans"), [(1.0, 80.1, True), (1.0, 79.9, False), (-1.0, 80.1, True)])
def test_a_gyro_leans_the_attitude_that_parts_so_long_that_it_is_off_by_twenty_degrees(deg_s, until_s, leans):
    def changed(axis, of="error", *, stays=True):
        return LevelChange(axis=axis, of=of, time_s=60.0, size=deg_s, stays=stays)

    assert leaning([changed(1)], until_s) == (["q"] if leans else [])
    assert leaning([changed(2), changed(0, "gain"), changed(0, stays=False)], until_s) == []


# what nobody reads ---------------------------------------------------------------------------------------------------


def frozen_from(onset_s, *sensors):
    record = motion()
    for sensor in sensors:
        values = record[sensor].copy()
        values[record.time_s >= onset_s] = values[int(np.argmax(record.time_s >= onset_s))]
        record = record.replace(sensor, values)
    return judged(flight_from(record, is_driven=False))


@pytest.mark.parametrize("sensors", by_day(map(pytest.param, [GYROS, ATTITUDE])))
def test_sensors_that_freeze_together_name_nobody_and_one_alone_is_named(sensors):
    assert frozen_from(50.0, *sensors).accused == ()
    for sensor in sensors:
        found = frozen_from(50.0, sensor)
        ((named, span),) = found.accused
        assert (named, span.start_s) == (sensor, pytest.approx(50.0, abs=0.5))
        assert found.alarms[0].last.kind == FROZEN
        [size] = [each.size for each in found.found]
        assert size == pytest.approx(motion()[sensor][int(50.0 / motion().sample_period_s)], abs=1.0)


@pytest.mark.parametrize("sensor", ["p", "phi"])
def test_a_column_that_never_moves_is_no_sensor_that_failed(sensor):
    assert frozen_from(0.0, sensor).accused == ()


@pytest.mark.parametrize("step_deg", [0.1, 1.0, 5.0])
def test_angles_that_are_rounded_have_not_frozen(step_deg):
    rounded = motion()
    for angle in ATTITUDE:
        rounded = rounded.replace(angle, np.round(rounded[angle] / step_deg) * step_deg)
    assert not [each for each in judged(flight_from(rounded, is_driven=False)).found if each.is_frozen]


@pytest.mark.nightly
def test_what_is_left_out_of_a_flight_is_asked_nothing():
    flight = flight_from(with_error(motion(), "q", from_on(60.0, 3.0)), is_driven=False)
    assert judged(flight.without([(57.0, np.inf)])).accused == ()
    assert flight.without([]) is flight
    assert {sensor for sensor, _ in judged(flight.without([(20.0, 30.0)])).accused} == {"q"}
    assert set(judged(flight).cleared.claims) == {*GYROS, *ATTITUDE}


# gyros that part and that nobody explains ----------------------------------------------------------------------------


@pytest.mark.parametrize("is_driven", by_day([True, False]))
def test_where_another_gyro_parts_unexplained_nobody_is_named_behind_an_estimator(is_driven, monkeypatch):
    from gtmbench.engine import judged as subject

    record = with_error(with_error(motion(), "q", from_on(60.0, 3.0)), "p", from_on(60.0, 6.0))
    flight = flight_from(record, is_driven=is_driven)
    whole = subject.findings_of(flight)
    of_q = tuple(each for each in whole.found if each.best.suspect == "q")
    assert of_q  # as if nothing had explained p
    monkeypatch.setattr(subject, "findings_of", lambda _: replace(whole, found=of_q))
    monkeypatch.setattr(subject, "with_doubts", lambda _, found: found)
    (finding,) = judged(flight).found
    assert (finding.named == "q") is not is_driven
    if is_driven:
        assert finding.doubt == "p parts from the attitude, too, and nothing explains it"


@pytest.mark.parametrize("is_accused", [True, False])
def test_others_that_part_are_asked_for_where_somebody_is_accused(is_accused, monkeypatch):
    from gtmbench.engine import judged as subject

    flight, found = said(3.0).flight, said(3.0).found if is_accused else ()
    whole = SimpleNamespace(model=SimpleNamespace(without_signatures=said(3.0).model), found=found)
    monkeypatch.setattr(subject, "findings_of", lambda _: whole)
    monkeypatch.setattr(subject, "with_doubts", lambda _, found: found)
    monkeypatch.setattr(subject, "_unnamed_where_others_part", lambda _: ("asked",))
    assert judged(flight).found == (("asked",) if is_accused else ())


def test_what_parts_when_a_finding_has_long_shown_doesnt_speak_against_it(monkeypatch):
    """An attitude that one gyro bends parts from the others, sooner or later."""
    from gtmbench.engine import judged as subject

    record = with_error(with_error(motion(), "q", from_on(40.0, 3.0)), "p", from_on(80.0, 6.0))
    flight = flight_from(record, is_driven=True)
    whole = subject.findings_of(flight)
    (of_q,) = (each for each in whole.found if each.best.suspect == "q")
    monkeypatch.setattr(subject, "with_doubts", lambda _, found: found)
    for shows_s, is_named in ((70.0, True), (90.0, False)):
        told = replace(of_q, shows_s=shows_s)
        monkeypatch.setattr(subject, "findings_of", lambda _, told=told: replace(whole, found=(told,)))
        (finding,) = judged(flight).found
        assert (finding.named == "q") == is_named


# alarms ---------------------------------------------------------------------------------------------------------------


def test_an_alarm_holds_whose_sensor_is_named_meanwhile_or_that_begins_last():
    found = said(3.0)  # q, from 60 s on
    assert found.holds("q", 70.0, np.inf)
    assert found.holds("q", 40.0, 61.5)
    assert not found.holds("q", 20.0, 50.0)
    assert not found.holds("p", 110.0, np.inf)  # q fails then
    calm = said()
    assert calm.holds("p", 109.0, np.inf)
    assert not calm.holds("p", 107.0, np.inf)  # long enough to show
    assert not calm.holds("p", 109.0, 115.0)  # over by the end
    assert not only(found, doubt="it moves more there").holds("p", 110.0, np.inf)
    assert not replace(calm, model=replace(calm.model, flight=calm.flight.without([(0.0, 200.0)]))).holds("p", 1.0, 1.0)

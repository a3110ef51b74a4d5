"""The timeline of a watched log: one place puts together what is claimed, and nothing is clear by silence."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.detectors.monitor.regime import IMPACT
from gtmbench.engine.judged import judged
from gtmbench.intake.flight_log import FlightLog, Unread
from gtmbench.log.judging.claims import UNHELD
from gtmbench.log.judging.timeline import LogEvidence, timeline_of
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.log.self_check.refusal import SelfCheck, Stop
from gtmbench.verdict.timeline import State
from tests.helpers.night import by_day
from tests.helpers.turning import SENSORS, from_on, motion, with_error

MONITOR = gb.FunctionDetector(lambda _: [], name="never", channels=("p", "q")).calibrate()
END_S = 120.0


def named(sensor, onset_s, kind="bias", number=0, **more):
    """Return an alarm that names a sensor."""
    judgement = Judgement(time_s=onset_s + 5.0, sensor=sensor, candidates=(sensor,), kind=kind)
    return Alarm(number=number, time_s=onset_s + 1.0, onset_s=onset_s, source=sensor, judgements=(judgement,), **more)


@cache
def judged_once(records, is_driven, excused):
    return judged(flight_of_records(records, is_driven=is_driven, is_assumed=False).without(excused))


def evidence(*records, alarms=(), moves=True, **more):
    records = records or (motion(),)
    unread = more.pop("unread", ())
    log = FlightLog(path=Path("log.csv"), segments=records, remarks=(), method=(), unread=unread)
    given = {
        "sensors": tuple(records[0].channels),
        "monitor": MONITOR,
        "moving": records if moves else (),
        "has_heading": True,
        "watches": (),
        "check": SelfCheck(),
        "excursions": (),
        "unwatched": (),
        "certified": (),
        "watched_imu": "",
    }
    is_driven = more.pop("is_driven", False)
    told = given | more
    excused = tuple((each.start_s, each.end_s) for each in told["excursions"] if each.reason != MOTION)
    said = judged_once(records, is_driven, excused) if moves else None
    return LogEvidence(log=log, judged=said, alarms=tuple(alarms), **told)


def states(timeline, sensor):
    return [(span.state.value, round(span.start_s), round(span.end_s)) for span in timeline.sensors[sensor]]


def is_clear(timeline, sensor, time_s):
    return timeline.at(sensor, time_s).state is State.CLEAR


# no alarm -------------------------------------------------------------------------------------------------------------


def test_a_healthy_log_is_clear_and_moves():
    timeline = timeline_of(evidence())
    assert all(is_clear(timeline, sensor, time_s) for sensor in SENSORS for time_s in (20.0, 60.0, 100.0))
    assert timeline.motion_total_s > 100.0
    assert timeline.told == ()


@pytest.mark.parametrize("sensor", by_day(["p", "q", "r"]))
def test_a_gyro_that_shifts_is_named_by_the_whole_log_without_an_alarm(sensor):
    given = evidence(with_error(motion(), sensor, from_on(60.0, 2.0)))
    timeline = timeline_of(given)
    (failed,) = timeline.of(sensor, State.FAILED)
    assert (failed.start_s, failed.end_s) == (pytest.approx(60.0, abs=2.5), 120.0)
    assert is_clear(timeline, sensor, 30.0)
    alarmed = timeline_of(replace(given, alarms=(named(sensor, 60.5),)))
    (failed,) = alarmed.of(sensor, State.FAILED)
    assert failed.start_s == 60.5  # the alarm says since when


def test_what_an_alarm_dates_long_before_it_was_raised_begins_where_the_whole_log_has_it():
    """Behind an estimator a bias is fitted by a drift from half a minute before."""
    given = evidence(with_error(motion(), "q", from_on(60.0, 2.0)))
    drift = replace(named("q", 60.5, "drift"), onset_s=30.0)
    drift = replace(drift, judgements=(replace(drift.last, parameters={"slope": 0.1, "onset_s": 30.0}),))
    timeline = timeline_of(replace(given, alarms=(drift,)))
    (failed,) = timeline.of("q", State.FAILED)
    assert (failed.start_s, failed.judgement.kind) == (pytest.approx(60.0, abs=2.5), "bias")
    assert is_clear(timeline, "q", 40.0)


def test_a_gyro_that_shifts_and_that_nobody_names_is_clear_nowhere():
    given = evidence(with_error(motion(), "q", from_on(60.0, 2.0)))
    given = replace(given, judged=replace(given.judged, found=()))
    assert not timeline_of(given).of("q", State.CLEAR)


@pytest.mark.parametrize("kind", ["bias", "spikes"])
@pytest.mark.parametrize("ended_s", [57.0, None])
def test_an_alarm_names_nobody_whom_the_whole_log_does_not(kind, ended_s):
    timeline = timeline_of(evidence(alarms=[named("q", 50.0, kind, ended_s=ended_s)]))
    assert not timeline.of("q", State.FAILED, State.SUSPECTED)
    assert [timeline.at("q", at_s).state for at_s in (30.0, 53.0)] == [State.CLEAR, State.NOT_JUDGED]
    assert timeline.at("q", 53.0).reason == UNHELD
    assert is_clear(timeline, "q", 80.0) == (ended_s is not None)


def test_an_alarm_of_another_sensor_than_gyros_and_angles_stands():
    timeline = timeline_of(evidence(alarms=[named("tas", 50.0)], sensors=(*SENSORS, "tas")))
    assert timeline.at("tas", 80.0).state is State.FAILED


def test_samples_that_are_missing_are_each_sensors_own():
    told = [
        replace(named(name, 50.0, "dropout", number, ended_s=56.0), test="missing")
        for number, name in enumerate(("phi", "theta"))
    ]
    timeline = timeline_of(evidence(alarms=told))
    assert [timeline.at(name, 53.0).state for name in ("phi", "theta")] == [State.FAILED, State.FAILED]


# failures -------------------------------------------------------------------------------------------------------------


def test_a_failure_stands_from_its_onset_to_the_end_and_all_else_is_clear():
    timeline = timeline_of(evidence(with_error(motion(), "q", from_on(60.0, 4.0)), alarms=[named("q", 60.0)]))
    assert states(timeline, "q")[-1] == ("failed", 60, 120)
    assert is_clear(timeline, "q", 30.0)
    assert all(is_clear(timeline, sensor, 90.0) for sensor in ("p", "r", "theta"))


@pytest.mark.parametrize("until_s", by_day([75.0, 90.0]))
def test_a_failure_that_ends_is_over_where_the_sensor_reads_as_before_and_clear_behind_it(until_s):
    broken = with_error(motion(), "q", from_on(50.0, 4.0, until_s))
    timeline = timeline_of(evidence(broken, alarms=[named("q", 50.0)]))
    (failed,) = timeline.of("q", State.FAILED)
    assert (failed.start_s, failed.end_s) == (50.0, pytest.approx(until_s, abs=2.1))
    assert is_clear(timeline, "q", until_s + 8.0)
    assert is_clear(timeline, "q", 30.0)
    other = timeline_of(evidence(broken, alarms=[named("q", 50.0, ended_s=until_s + 7.0)]))
    assert other.of("q", State.FAILED)[0].end_s == failed.end_s  # the whole log knows better


def test_an_alarm_without_a_judgement_suspects_its_channels_where_the_engine_judges_nothing():
    risen = Alarm(number=0, time_s=61.0, onset_s=60.0, source="level")
    timeline = timeline_of(evidence(alarms=[risen]))
    assert [timeline.at(sensor, 90.0).state for sensor in "pqr"] == [State.NOT_JUDGED, State.NOT_JUDGED, State.CLEAR]
    alone = timeline_of(evidence(alarms=[risen], moves=False))  # nobody else judges
    assert [alone.at(sensor, 90.0).state for sensor in "pq"] == [State.SUSPECTED, State.SUSPECTED]


# what isn't judged ----------------------------------------------------------------------------------------------------


def test_what_was_not_read_is_not_judged_and_counts_as_motion():
    whole = motion()
    gap = Unread(start_s=50.0, end_s=70.0, reason="samples come at 4 Hz instead of 20")
    given = evidence(whole.between(0.0, 50.0), whole.between(70.0, 120.0), unread=(gap,))
    timeline = timeline_of(given)
    for sensor in SENSORS:
        assert timeline.at(sensor, 60.0).state is State.NOT_JUDGED
        assert timeline.at(sensor, 60.0).reason == gap.reason
        assert is_clear(timeline, sensor, 30.0)
        assert is_clear(timeline, sensor, 90.0)
        assert timeline.motion_in(sensor, State.NOT_JUDGED) >= 20.0
    assert timeline.span_s == (0.0, 120.0)


def test_a_failure_goes_on_through_a_gap():
    whole = with_error(motion(), "q", from_on(40.0, 4.0))
    gap = Unread(start_s=50.0, end_s=70.0, reason="gap")
    given = evidence(whole.between(0.0, 50.0), whole.between(70.0, 120.0), unread=(gap,), alarms=[named("q", 40.0)])
    assert timeline_of(given).at("q", 60.0).state is State.FAILED


@pytest.mark.parametrize("reason", [IMPACT, MOTION])
def test_an_excuse_never_clears_and_hard_motion_is_none(reason):
    about = Excursion(start_s=50.0, end_s=60.0, reason=reason)
    timeline = timeline_of(evidence(excursions=(about,)))
    for sensor in SENSORS:
        assert is_clear(timeline, sensor, 55.0) == (reason == MOTION)
        assert is_clear(timeline, sensor, 90.0)


def test_what_goes_on_after_an_excuse_counts():
    about = Excursion(start_s=50.0, end_s=60.0, reason=IMPACT)
    given = evidence(with_error(motion(), "p", from_on(52.0, 3.0)), excursions=(about,))
    timeline = timeline_of(given)
    assert timeline.at("p", 90.0).state is State.FAILED
    assert not any(is_clear(timeline, "p", time_s) for time_s in (51.0, 55.0, 65.0, 90.0, 110.0))


def test_where_the_check_stops_nothing_is_clear():
    timeline = timeline_of(evidence(check=SelfCheck(stops=(Stop(text="another motion"),))))
    assert {span.state for spans in timeline.sensors.values() for span in spans} == {State.NOT_JUDGED}
    assert timeline.at("p", 60.0).reason == "another motion"


def test_unwatched_gyros_keep_their_reason():
    timeline = timeline_of(evidence(unwatched=(("r", "the heading never changes"),)))
    assert states(timeline, "r") == [("not judged", 0, 120)]
    assert timeline.at("r", 60.0).reason == "the heading never changes"
    assert is_clear(timeline, "q", 60.0)


def test_without_a_heading_of_its_own_nobody_clears_r_and_psi():
    timeline = timeline_of(evidence(has_heading=False))
    assert not timeline.of("r", State.CLEAR)
    assert not timeline.of("psi", State.CLEAR)
    assert is_clear(timeline, "p", 60.0)


def test_the_silence_of_a_detector_without_a_certificate_clears_nothing():
    timeline = timeline_of(evidence(moves=False))
    assert not any(timeline.of(sensor, State.CLEAR) for sensor in SENSORS)
    assert "silence says nothing" in timeline.at("p", 60.0).reason


def test_sensors_that_nobody_clears_are_told():
    timeline = timeline_of(evidence(sensors=(*SENSORS, "tas", "alpha")))
    (line,) = timeline.told
    assert line.startswith("No verdict on tas, alpha")
    assert timeline.at("tas", 60.0).state is State.NOT_JUDGED
    alarmed = timeline_of(evidence(sensors=(*SENSORS, "tas"), alarms=[named("tas", 50.0)]))
    assert alarmed.told == ()


def test_a_factor_is_told_where_gyros_are_alone_and_not_where_they_drive_the_attitude():
    own, driven = (timeline_of(evidence(is_driven=each)).at("q", 50.0).sizes for each in (False, True))
    assert own.factors[0] < 1.0 < own.factors[1]
    assert driven.factors is None
    assert driven.error > own.error
    assert np.isfinite(driven.error)

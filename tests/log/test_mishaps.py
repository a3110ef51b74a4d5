"""Nothing is learnt from a crash: what is taken as healthy ends before it, begins behind it, or the verdict says so."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.detectors.monitor.regime import FAILURE, IMPACT
from gtmbench.intake.flight_log import FlightLog
from gtmbench.log.learning.crashes import clear_parts, crash_of, is_enough, mishaps, part_without_mishap
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from gtmbench.verdict.verdict import Outcome

PERIOD_S, LIES_S = 0.1, 12.0
CHANNELS = (*GYROS, *ATTITUDE, *ACCELEROMETERS)


def flight(*parts, seed=1):
    """Return a record of parts (seconds, whether it flies, force): it turns about p as it flies, and rests else."""
    random, rows = np.random.default_rng(seed), []
    for seconds, flies, force in parts:
        count = round(seconds / PERIOD_S)
        values = np.zeros((count, 9))
        time_s = np.arange(count) * PERIOD_S
        if flies:
            values[:, 0], values[:, 3] = 20.0 * np.cos(time_s), np.degrees(np.radians(20.0) * np.sin(time_s))
        values[:, 6:] = force
        rows.append(values + 0.01 * random.standard_normal(values.shape))
    return gb.Record(np.concatenate(rows), channels=CHANNELS, sample_period_s=PERIOD_S)


def log_of(record, events=()):
    return FlightLog(path=Path("flight.csv"), segments=(record,), remarks=(), method=(), events=tuple(events))


def failure(time_s):
    return gb.Event(kind=gb.EventKind.FAILURE, time_s=time_s, text="ERR CRASH_CHECK 1")


UP, SIDE, BACK = (0.0, 0.0, 1.0), (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)


def test_a_flight_without_a_mishap_is_chosen_as_ever():
    record = flight((10.0, False, UP), (200.0, True, UP))
    assert mishaps([], [record]) == ()
    span, doubt = part_without_mishap(log_of(record), [record])
    assert (doubt, span[0]) == ("", 0.0)
    assert span[1] == pytest.approx(90.0, abs=2.0)


def test_what_is_learnt_ends_before_a_crash():
    record = flight((40.0, True, UP), (LIES_S, False, SIDE), (160.0, True, UP))
    span, doubt = part_without_mishap(log_of(record), [record])
    assert (span, doubt) == ((0.0, pytest.approx(35.0, abs=1.0)), "")
    assert part_without_mishap(log_of(flight((200.0, True, UP)), [failure(40.0)]), [record])[0] == (0.0, 35.0)


def test_it_begins_behind_a_crash_that_comes_early_and_then_silence_says_nothing():
    record = flight((12.0, True, UP), (LIES_S, False, BACK), (30.0, False, UP), (160.0, True, UP))
    span, doubt = part_without_mishap(log_of(record), [record])
    assert span[0] == pytest.approx(54.0, abs=1.5)
    assert "lies on its back from 12.0 s on" in doubt


def test_a_failure_before_what_is_taken_is_said_and_an_aircraft_that_is_carried_isnt():
    """A short hop far before a flight teaches nothing; where it failed, silence says nothing of it."""
    record = flight((8.0, True, UP), (LIES_S, False, SIDE), (320.0, False, UP), (160.0, True, UP))
    span, doubt = part_without_mishap(log_of(record), [record])
    assert (span[0] > 320.0, doubt) == (True, "")
    _, doubt = part_without_mishap(log_of(record, [failure(9.0)]), [record])
    assert doubt.endswith("so it is not judged")


def test_what_an_autopilot_finds_before_it_takes_off_is_no_mishap():
    record = flight((8.0, True, UP), (40.0, False, UP), (160.0, True, UP))
    assert mishaps([failure(30.0), failure(47.0)], [record]) == ()
    assert [each.is_told for each in mishaps([failure(70.0)], [record])] == [True]


def test_nothing_is_learnt_where_a_sensor_failed_and_as_much_motion_is_behind_it():
    record = flight((200.0, True, UP))
    log, part = log_of(record), (0.0, 80.0)
    assert clear_parts(log, [record], part, []) == (part,)
    assert clear_parts(log, [record], part, [(90.0, 200.0)]) == (part,)  # what comes later changes nothing
    first, second = clear_parts(log, [record], part, [(30.0, 50.0)])
    assert first == (0.0, 28.0)
    assert second == (52.0, pytest.approx(80.0 + 24.0, abs=2.0))
    assert clear_parts(log, [record], part, [(30.0, 50.0), (150.0, np.inf)]) == (first, second)  # nor beside another
    assert clear_parts(log, [record], part, [(40.0, np.inf)]) == ((0.0, 38.0),)
    assert clear_parts(log, [record], part, [(12.0, np.inf)]) == ()  # ten seconds teach nothing


def test_what_makes_up_for_a_failure_ends_before_a_crash():
    record = flight((100.0, True, UP), (LIES_S, False, SIDE), (100.0, True, UP))
    parts = clear_parts(log_of(record), [record], (0.0, 80.0), [(10.0, 70.0)])
    assert parts[-1] == (72.0, pytest.approx(95.0, abs=1.0))


def test_where_every_choice_holds_a_crash_that_is_said():
    record = flight((12.0, True, UP), (LIES_S, False, BACK), (30.0, True, UP), (LIES_S, False, SIDE))
    events = [failure(30.0), failure(40.0), failure(48.0)]
    _, doubt = part_without_mishap(log_of(record, events), [record])
    assert "in what had to be learnt from" in doubt


@pytest.mark.parametrize(
    ("seconds", "tilt_deg", "lies"), [(4.0, 180.0, False), (5.0, 180.0, True), (12.0, 34.0, False), (12.0, 36.0, True)]
)
def test_an_aircraft_lies_that_points_elsewhere_by_35_degrees_for_five_seconds(seconds, tilt_deg, lies):
    """A short inverted pass is no mishap."""
    force = (0.0, -np.sin(np.radians(tilt_deg)), np.cos(np.radians(tilt_deg)))
    assert len(mishaps([], [flight((40.0, True, UP), (seconds, True, force), (160.0, True, UP))])) == lies


@pytest.mark.parametrize(("flown_s", "is_said"), [(4.0, False), (6.0, True)])
def test_a_flight_of_five_seconds_is_the_shortest_that_can_have_failed(flown_s, is_said):
    record = flight((flown_s, True, UP), (LIES_S, False, BACK), (30.0, False, UP), (160.0, True, UP))
    assert bool(part_without_mishap(log_of(record), [record])[1]) == is_said


def test_twenty_seconds_of_which_ten_are_in_motion_are_enough_to_learn_from():
    log, every = log_of(flight((100.0, True, UP))), np.arange(100.0)
    assert [is_enough(log, every, (10.0, end_s)) for end_s in (29.85, 29.95)] == [False, True]
    assert [is_enough(log, every[:count], (0.0, 60.0)) for count in (9, 10)] == [False, True]


@pytest.mark.parametrize("reason", [IMPACT, FAILURE])
def test_a_hard_contact_or_a_failure_after_which_it_turns_for_less_than_ten_seconds_is_a_crash(reason):
    record = flight((60.0, True, UP))
    watch = SimpleNamespace(record=record, armed=np.ones(len(record), dtype=bool))
    amid, last = (
        Excursion(start_s=40.0, end_s=end_s, reason=reason, is_hard=reason == IMPACT) for end_s in (49.5, 50.5)
    )
    assert crash_of([watch], [amid, last]) is last
    assert crash_of([watch], [amid, replace(last, reason=MOTION)]) is None
    unwatched = SimpleNamespace(record=record, armed=np.zeros(len(record), dtype=bool))
    assert crash_of([unwatched], [last, amid]) is last


@pytest.mark.nightly
def test_gyros_are_judged_by_the_whole_log_where_a_bank_had_to_learn_from_a_crash(tmp_path):
    """A healthy flight whose accelerometers say that it lay on its side early on."""
    plain = MECHANISMS["plain"](3).record.select(list(GYROS + ATTITUDE))
    force = np.tile(UP, (len(plain), 1)) + 0.02 * np.random.default_rng(1).standard_normal((len(plain), 3))
    outcomes = []
    for lying in ((), (10.0, 18.0)):
        told = force.copy()
        if lying:
            told[(plain.time_s >= lying[0]) & (plain.time_s < lying[1])] = SIDE
        record = gb.Record(
            np.column_stack([plain.values, told]),
            channels=(*plain.channels, *ACCELEROMETERS),
            sample_period_s=plain.sample_period_s,
        )
        gb.write_log(record, tmp_path / "log.csv")
        watched = gb.watch_log(tmp_path / "log.csv", "auto", attitude="own")
        outcomes.append(watched.outcome)
    assert outcomes == [Outcome.HEALTHY, Outcome.HEALTHY]
    assert "lies on its side from 10" in str(watched.check.doubts[0])

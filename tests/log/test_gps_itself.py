"""A GPS whose velocity jumps, or parts from its place: named where no aircraft moves so."""

from dataclasses import replace

import numpy as np
import pytest

from gtmbench.detectors.excursion import Excursion
from gtmbench.intake.other_sensors import LostFix, SensorReadings
from gtmbench.log.judging.gps_itself import FIX, JUMP, PLACE, gps_alarms
from gtmbench.report.words.others import gps_lines
from gtmbench.report.words.verdict import gps_why
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY
from gtmbench.values.record import Record

JUMP_S = 70.0


def sensor(channels, time_s, values, *, is_late=False):
    return SensorReadings(
        name="GPS", channels=channels, columns=channels, time_s=time_s, values=values, is_late=is_late
    )


def turning(*spans):
    """Return a log in which the aircraft turns throughout, or in some spans."""
    time_s = np.arange(0.0, 100.0, 0.1)
    turns = np.any([(time_s >= begins) & (time_s < ends) for begins, ends in spans or [(0.0, 100.0)]], axis=0)
    rate = 20.0 * np.cos(time_s) * turns
    none = np.zeros_like(time_s)
    channels = ("p", "q", "r", "phi", "theta", "psi")
    values = np.column_stack([rate, none, none, 0.1 * np.cumsum(rate), none, none])
    return Record(values, channels=channels, sample_period_s=0.1)


def told(size, *, felt_g=1.1, rests_g=1.0, felt_s=0.0, every_s=0.2, excursions=(), turns=()):
    """Return the alarms of a GPS whose velocity jumps by a size, and what accelerometers read then or so much later."""
    time_s, force_s = JUMP_S + np.arange(-60.0, 30.0, every_s), np.arange(0.0, 100.0, 0.05)
    velocity = np.column_stack([5.0 * np.sin(0.2 * time_s), 0.0 * time_s, 0.0 * time_s])
    velocity[:, 0] += size * (time_s >= JUMP_S - 0.01)
    felt = np.abs(force_s - JUMP_S - felt_s) < 0.03
    force = np.column_stack([0.0 * force_s, 0.0 * force_s, np.where(felt, felt_g, rests_g)])
    sensors = [sensor(GPS_VELOCITY, time_s, velocity, is_late=True), sensor(ACCELEROMETERS, force_s, force)]
    return gps_alarms(sensors, [turning(*turns)], excursions)


@pytest.mark.parametrize("size", [8.0, -12.0])
def test_a_jump_that_nothing_felt_is_named(size):
    (alarm,) = told(size)
    assert (alarm.sensor, alarm.test, alarm.doubt) == ("gps", JUMP, "")
    assert alarm.time_s == pytest.approx(JUMP_S, abs=0.21)
    assert "the accelerometers read 1.1 g at most" in gps_why(alarm)
    assert gps_lines([alarm])[1].startswith("  failed: its velocity jumps by")


@pytest.mark.parametrize(
    ("within", "beyond"),
    [
        ({"size": 3.9, "every_s": 0.1}, {"size": 4.1, "every_s": 0.1}),
        ({"size": 4.9, "rests_g": 0.0, "felt_g": 0.1}, {"size": 5.1, "rests_g": 0.0, "felt_g": 0.1}),  # 25 m/s^2
        ({"size": 6.1}, {"size": 6.3}),  # half as much again as 1.1 g and gravity allow
        ({"size": 20.0, "every_s": 0.56}, {"size": 20.0, "every_s": 0.54}),
        ({"size": 12.0, "felt_g": 2.05}, {"size": 12.0, "felt_g": 1.95}),  # an impact, or a launch
        ({"size": 8.0, "felt_g": 3.0, "felt_s": -4.9}, {"size": 8.0, "felt_g": 3.0, "felt_s": -5.1}),
        ({"size": 8.0, "felt_g": 3.0, "felt_s": 0.4}, {"size": 8.0, "felt_g": 3.0, "felt_s": 0.6}),
    ],
    ids=["little", "slow", "may be felt", "seldom read", "felt", "felt before", "felt behind"],
)
def test_what_an_aircraft_may_do_is_no_failure(within, beyond):
    assert told(**within) == ()
    assert [alarm.test for alarm in told(**beyond)] == [JUMP]


CONTACT = "impact or touchdown"


@pytest.mark.parametrize(
    ("how", "doubt"),
    [
        ({"excursions": [Excursion(start_s=JUMP_S + 1.9, end_s=90.0, reason=CONTACT)]}, CONTACT),
        ({"excursions": [Excursion(start_s=JUMP_S + 2.1, end_s=90.0, reason=CONTACT)]}, ""),
        ({"excursions": [Excursion(start_s=50.0, end_s=JUMP_S - 1.9, reason=CONTACT)]}, CONTACT),
        ({"excursions": [Excursion(start_s=50.0, end_s=JUMP_S - 2.1, reason=CONTACT)]}, ""),
        ({"turns": [(0.0, 72.5)]}, "it begins, or is named, as the motion ends"),  # its last whole second is 71 to 72
        ({"turns": [(0.0, 74.0)]}, ""),
        ({"turns": [(78.0, 81.0), (95.0, 99.0)]}, ""),  # three seconds of motion within ten
        ({"turns": [(79.0, 84.0), (95.0, 99.0)]}, "it begins while nothing moves"),
    ],
)
def test_what_begins_beside_a_contact_or_without_motion_may_be_no_fault(how, doubt):
    (alarm,) = told(8.0, **how)
    assert alarm.doubt == doubt
    assert not doubt or gps_lines([alarm])[1].endswith(f"may be no fault: {doubt}")


def placed(wrong_m=lambda _: 0.0, *, off_m_s=0.0, late_s=0.0, pause=None, every_s=0.2):
    """Return the alarms of a GPS that flies an eight at 25 m/s, whose place or velocity is off from a time on."""
    time_s = np.arange(0.0, 100.0, every_s)
    if pause:
        time_s = time_s[(time_s < pause[0]) | (time_s > pause[1])]
    behind = time_s - JUMP_S
    places = np.column_stack([80.0 * np.sin(0.3 * time_s), 60.0 * np.sin(0.15 * time_s)])
    places += np.random.default_rng(4).standard_normal(places.shape)
    places[:, 0] += np.where(behind >= 0.0, wrong_m(behind), 0.0)
    of_s = time_s - late_s
    velocity = np.column_stack([24.0 * np.cos(0.3 * of_s), 9.0 * np.cos(0.15 * of_s), 0.0 * of_s])
    velocity[:, 1] += off_m_s * (behind >= 0.0)
    gps = replace(sensor(GPS_VELOCITY, time_s, velocity, is_late=True), places=places)
    return gps_alarms([gps], [turning()], ())


@pytest.mark.parametrize(
    ("how", "within_s"),
    [
        ({"wrong_m": lambda _: 30.0}, 0.5),
        ({"wrong_m": lambda _: -45.0, "late_s": 0.2}, 0.5),
        ({"wrong_m": lambda behind_s: 1.5 * np.minimum(behind_s, 20.0)}, 20.0),
        ({"wrong_m": lambda behind_s: 30.0 * np.random.default_rng(5).standard_normal(len(behind_s))}, 5.0),
        ({"off_m_s": 3.0}, 10.0),
        ({"off_m_s": -8.0}, 4.0),
    ],
)
def test_a_place_that_parts_from_its_velocity_is_named(how, within_s):
    (alarm,) = placed(**how)
    assert (alarm.sensor, alarm.test, alarm.doubt) == ("gps", PLACE, "")
    assert JUMP_S - 3.0 < alarm.onset_s < JUMP_S + 0.6 * within_s
    assert JUMP_S - 0.2 < alarm.time_s <= JUMP_S + within_s
    assert "its place moves otherwise than its velocity makes" in gps_why(alarm)


@pytest.mark.parametrize(
    "how",
    [
        {},
        {"late_s": 0.4},
        {"late_s": -0.4, "every_s": 1.0},
        {"wrong_m": lambda _: 8.0},  # another choice of satellites
        {"wrong_m": lambda behind_s: 0.4 * behind_s},
        {"off_m_s": 0.3},
        {"wrong_m": lambda _: 200.0, "pause": (60.0, 70.1)},  # what happened in between isn't known
    ],
)
def test_a_place_that_wanders_as_receivers_do_is_no_failure(how):
    assert placed(**how) == ()


def straight(wrong_m=lambda _: 0.0, *, faster=0.0, pause_s=0.2):
    """Return the same of a GPS without noise that flies straight on, and, from a pause on, faster."""
    time_s = np.r_[np.arange(40.0, JUMP_S, 0.2), np.arange(JUMP_S - 0.2 + pause_s, 100.0, 0.2)]
    behind_s = time_s - JUMP_S + 0.1
    off_m = np.where(behind_s > 0.0, wrong_m(behind_s - 0.1), 0.0)
    speed = 20.0 + faster * (behind_s > 0.0)
    steps = np.diff(time_s) * 0.5 * (speed[1:] + speed[:-1])
    none = np.zeros_like(time_s)
    gps = sensor(GPS_VELOCITY, time_s, np.column_stack([speed, none, none]), is_late=True)
    places = np.column_stack([np.r_[0.0, np.cumsum(steps)], off_m])
    return gps_alarms([replace(gps, places=places)], [turning()], ())


@pytest.mark.parametrize(
    ("within", "beyond"),
    [
        ({"wrong_m": lambda _: 19.9}, {"wrong_m": lambda _: 20.1}),
        ({"wrong_m": lambda behind_s: 0.99 * behind_s}, {"wrong_m": lambda behind_s: 1.02 * behind_s}),  # in 20 s
        ({"wrong_m": lambda _: 24.9, "faster": 10.0}, {"wrong_m": lambda _: 25.1, "faster": 10.0}),  # late by 0.5 s
        ({"wrong_m": lambda _: 90.0, "pause_s": 1.6}, {"wrong_m": lambda _: 90.0, "pause_s": 1.4}),
    ],
    ids=["step", "ramp", "late", "pause"],
)
def test_a_place_may_part_from_its_velocity_by_twenty_metres_in_twenty_seconds(within, beyond):
    assert straight(**within) == ()
    assert [alarm.test for alarm in straight(**beyond)] == [PLACE]


def test_a_place_is_wrong_since_a_quarter_of_what_it_parts_by():
    (alarm,) = straight(lambda behind_s: 2.01 * behind_s)
    assert (alarm.onset_s, alarm.time_s) == (
        pytest.approx(JUMP_S + 2.4, abs=0.11),
        pytest.approx(JUMP_S + 10.0, abs=0.11),
    )


@pytest.mark.parametrize(
    ("lasts_s", "turns", "is_told"), [(4.9, (), False), (5.1, (), True), (9.0, (0.0, 60.0), False)]
)
def test_a_fix_that_is_lost_for_five_seconds_while_the_aircraft_turns_is_a_failure(lasts_s, turns, is_told):
    gps = sensor(GPS_VELOCITY, np.arange(3.0), np.zeros((3, 3)), is_late=True)
    gps = replace(gps, lost=(LostFix(JUMP_S, JUMP_S + lasts_s, 9),))
    found = gps_alarms([gps], [turning(*([turns] if turns else []))], ())
    assert [(alarm.test, alarm.time_s, alarm.ended_s) for alarm in found] == (
        [(FIX, JUMP_S + 5.0, JUMP_S + lasts_s)] if is_told else []
    )

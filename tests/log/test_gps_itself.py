"""A GPS whose velocity jumps, or parts from its place: named where no aircraft moves so."""

from dataclasses import replace

import numpy as np
import pytest

from gtmbench.detectors.excursion import Excursion
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.log.judging.gps_itself import JUMP, PLACE, gps_alarms
from gtmbench.report.words.others import gps_lines
from gtmbench.report.words.verdict import gps_why
from gtmbench.values.channels import ACCELEROMETERS, GPS_VELOCITY
from gtmbench.values.record import Record

JUMP_S = 70.0


def sensor(channels, time_s, values, *, is_late=False):
    return SensorReadings(
        name="GPS", channels=channels, columns=channels, time_s=time_s, values=values, is_late=is_late
    )


def turning():
    """Return a log in which the aircraft turns throughout."""
    time_s = np.arange(0.0, 100.0, 0.1)
    angle = 20.0 * np.sin(time_s)
    rate = 20.0 * np.cos(time_s)
    none = np.zeros_like(time_s)
    channels = ("p", "q", "r", "phi", "theta", "psi")
    return Record(np.column_stack([rate, none, none, angle, none, none]), channels=channels, sample_period_s=0.1)


def told(size, *, felt_g=1.1, every_s=0.2, excursions=()):
    """Return the alarms of a GPS whose velocity jumps by a size, and what accelerometers read then."""
    time_s, force_s = np.arange(0.0, 100.0, every_s), np.arange(0.0, 100.0, 0.05)
    velocity = np.column_stack([5.0 * np.sin(0.2 * time_s), 0.0 * time_s, 0.0 * time_s])
    velocity[:, 0] += size * (time_s >= JUMP_S)
    force = np.column_stack([0.0 * force_s, 0.0 * force_s, np.where(np.abs(force_s - JUMP_S) < 0.3, felt_g, 1.0)])
    sensors = [sensor(GPS_VELOCITY, time_s, velocity, is_late=True), sensor(ACCELEROMETERS, force_s, force)]
    return gps_alarms(sensors, [turning()], excursions)


@pytest.mark.parametrize("size", [8.0, -12.0])
def test_a_jump_that_nothing_felt_is_named(size):
    (alarm,) = told(size)
    assert (alarm.sensor, alarm.test, alarm.doubt) == ("gps", JUMP, "")
    assert alarm.time_s == pytest.approx(JUMP_S, abs=0.21)
    assert "the accelerometers read 1.1 g at most" in gps_why(alarm)
    assert gps_lines([alarm])[1].startswith("  failed: its velocity jumps by")


def test_a_jump_beside_a_contact_with_the_ground_may_be_no_fault():
    landing = Excursion(start_s=JUMP_S - 1.0, end_s=JUMP_S + 1.0, reason="impact or touchdown")
    (alarm,) = told(8.0, excursions=[landing])
    assert alarm.doubt == "impact or touchdown"
    assert gps_lines([alarm])[1].endswith("may be no fault: impact or touchdown")


@pytest.mark.parametrize(
    "how",
    [
        {"size": 0.0},
        {"size": 3.5},
        {"size": 8.0, "felt_g": 2.5},  # an impact, or a launch
        {"size": 8.0, "every_s": 1.0},  # an aircraft may change its velocity so in a second
    ],
)
def test_what_an_aircraft_may_do_is_no_failure(how):
    assert told(**how) == ()


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

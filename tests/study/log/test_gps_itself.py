"""A GPS whose velocity jumps: named where no aircraft moves so and no accelerometer felt it."""

import numpy as np
import pytest

from gtmbench.detectors.excursion import Excursion
from gtmbench.intake.other_sensors import SensorReadings
from gtmbench.report.words.other_sensors import gps_lines, gps_why
from gtmbench.study.log.gps_itself import JUMP, gps_alarms
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

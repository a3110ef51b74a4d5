"""A fix that is lost at once, in logs of ArduPilot and PX4, and how it is told."""

import numpy as np
import pytest

from gtmbench.intake.other_sensors import lost_fixes
from gtmbench.log.watch import watch_log
from gtmbench.report.words.others import gps_lines
from gtmbench.report.words.verdict import verdict_text
from tests.helpers.autopilot_logs import ardupilot, at, imus, px4
from tests.helpers.night import by_day

DURATION_S, LOST_S = 130.0, (100.0, 118.0)


def gps_rows(satellites, *, lost_s=LOST_S):
    """Return time, fix, satellites, and a velocity, at 5 Hz; the receiver goes on sending."""
    time_s = np.arange(0.5, DURATION_S - 1.0, 0.2)
    is_lost = (time_s > lost_s[0]) & (time_s < lost_s[1])
    counts = np.where(is_lost, satellites(time_s - lost_s[0]), 11).astype(int)
    status = np.where(counts >= 4, 3, 0)
    course = np.mod(5.0 * time_s, 360.0)
    return time_s, status, counts, course


def at_once(_since_s):
    return 0


def one_by_one(since_s):
    return np.clip(11 - since_s, 0, 11)


def log_of(path, satellites, **how):
    time_s, status, counts, course = gps_rows(satellites, **how)
    rows = [
        (at(t), int(fix), int(count), 20.0, float(turned), 0.1)
        for t, fix, count, turned in zip(time_s, status, counts, course, strict=True)
    ]
    path.write_bytes(ardupilot(imus(1), more={"GPS": ("QBBfff", "TimeUS,Status,NSats,Spd,GCrs,VZ", rows)}))
    return watch_log(path, "auto", healthy=[(0.0, 60.0)])


def test_a_receiver_that_loses_all_satellites_at_once_in_flight_is_named(tmp_path):
    watched = log_of(tmp_path / "flight.bin", at_once)
    (lost,) = watched.failed_gps
    assert lost.onset_s == pytest.approx(LOST_S[0], abs=0.3)
    assert lost.ended_s == pytest.approx(LOST_S[1], abs=0.3)
    assert watched.outcome.name == "FAILED"
    assert [sensor for sensor, _ in watched.verdict.failed] == ["gps"]
    assert "it lost its 11 satellites at once" in verdict_text(watched)
    assert any("it lost its 11 satellites at once" in line for line in gps_lines(watched.gps))


@pytest.mark.parametrize(
    ("satellites", "lost_s"), by_day([(one_by_one, LOST_S), (at_once, (100.0, 103.0))]), ids=["one by one", "for 3 s"]
)
def test_a_hidden_sky_or_a_short_pause_is_no_failure(tmp_path, satellites, lost_s):
    watched = log_of(tmp_path / "flight.bin", satellites, lost_s=lost_s)
    assert watched.failed_gps == ()
    assert watched.outcome.name != "FAILED"


@pytest.mark.nightly
def test_a_px4_log_tells_it_likewise(tmp_path):
    time_s, status, counts, course = gps_rows(at_once)
    turned = np.radians(course)
    fields = ["float vel_n_m_s", "float vel_e_m_s", "float vel_d_m_s", "uint8_t fix_type", "uint8_t satellites_used"]
    velocity = np.column_stack([20.0 * np.cos(turned), 20.0 * np.sin(turned), 0.1 * np.cos(turned)]).tolist()
    rows = [
        (t, *own, int(fix), int(count))
        for t, own, fix, count in zip(time_s.tolist(), velocity, status, counts, strict=True)
    ]
    path = tmp_path / "flight.ulg"
    path.write_bytes(px4(imus(1)[0], more={"vehicle_gps_position": (fields, rows)}))
    assert watch_log(path, "auto", healthy=[(0.0, 60.0)]).failed_gps


def test_messages_without_a_time_or_a_fix_tell_nothing():
    time_s = np.array([0.0, np.nan, 2.0, 3.0])
    none = np.zeros(4)
    assert lost_fixes(time_s, none > 0, none) == ()
    (lost,) = lost_fixes(time_s, np.array([True, True, False, False]), np.array([9.0, 9.0, 0.0, 0.0]))
    assert lost == (0.0, 3.0, 9)

"""Gains of gyros against the attitude: what they bracket, what raises an alarm, and what never does."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import TOUCHDOWN
from gtmbench.study.log.gains import GAIN, gains
from gtmbench.study.log.self_check.motion import rates_from, terms_of
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.values.channels import ATTITUDE, GYROS

PERIOD_S, LENGTH_S = 0.05, 200.0
ONSET_S = 120.0
HEALTHY = [(0.0, 60.0)]


def turning(seed, *, noise=0.05, late_s=0.0):
    """Return a flight of small angles, by smooth rates of 1 deg/s, with noise: in deg/s, of angles a tenth in deg."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, LENGTH_S, PERIOD_S)
    pulsation, phase = 2.0 * np.pi * rng.uniform(0.05, 0.6, (12, 3)), rng.uniform(0.0, 2.0 * np.pi, (12, 3))
    amplitude = rng.standard_normal((12, 3)) / np.sqrt(6.0)
    arms = pulsation * time_s[:, np.newaxis, np.newaxis] + phase
    rates = (amplitude * np.cos(arms)).sum(axis=1)
    angles = (amplitude / pulsation * np.sin(arms - pulsation * late_s)).sum(axis=1)
    read = np.column_stack([rates, angles]) + rng.standard_normal((len(time_s), 6)) * ([noise] * 3 + [0.1 * noise] * 3)
    return gb.Record(read, channels=[*GYROS, *ATTITUDE], sample_period_s=PERIOD_S)


def manoeuvring(seed, *, noise=0.5, size=12.0):
    """Return a flight that banks and pitches by tens of degrees, as Euler angles turn."""
    smooth = turning(seed, noise=0.0).matrix(ATTITUDE) * size
    rates = terms_of(smooth, PERIOD_S) @ rates_from((1.0, 1.0, 1.0))
    read = np.column_stack([rates, smooth])
    read += np.random.default_rng(seed).standard_normal(read.shape) * ([noise] * 3 + [0.1 * noise] * 3)
    return gb.Record(read[1:-1], channels=[*GYROS, *ATTITUDE], sample_period_s=PERIOD_S)


def broken(record, fault_type, channel="p", **parameters):
    return gb.inject(record, fault_type(channel=channel, onset_s=ONSET_S, **parameters))


def said(record, **how):
    return gains([record], **{"healthy": HEALTHY, "is_driven": True, **how})


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.005, 0.15, 0.5])
def test_the_true_gain_lies_in_the_bracket_and_raises_nothing(seed, noise):
    found = said(turning(seed, noise=noise))
    known = np.isfinite(found.least)
    assert known.mean() > 0.3
    assert ((found.least[known] < 1.05) & (found.most[known] > 0.95)).mean() > 0.8
    assert np.nanmax(found.excess) < 1.0
    assert (found.least[known] <= found.most[known]).all()
    assert found.alarms == ()


@pytest.mark.parametrize("seed", range(3))
def test_more_noise_or_a_delay_than_where_identified_raises_nothing(seed):
    clean, noisy = turning(seed), turning(seed, noise=0.5)
    late = turning(seed, late_s=0.15)
    for other in (noisy, late):
        rows = (clean.time_s > ONSET_S)[:, np.newaxis]
        mixed = gb.Record(
            np.where(rows, other.values, clean.values), channels=clean.channels, sample_period_s=clean.sample_period_s
        )
        assert said(mixed).alarms == ()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("channel", GYROS)
def test_a_gyro_that_reads_too_little_is_named_where_it_drives_the_attitude(seed, channel):
    record = broken(manoeuvring(seed), gb.ScaleFactor, channel, factor=0.6)
    (alarm,) = said(record).alarms
    assert (alarm.test, alarm.sensor, alarm.last.kind) == (GAIN, channel, "scale_factor")
    assert alarm.last.parameters["factor"] == pytest.approx(
        0.6, abs=0.1
    )  # the window may hold some healthy seconds yet
    assert abs(alarm.onset_s - ONSET_S) < 10.0
    assert ONSET_S < alarm.time_s < ONSET_S + 25.0
    (alarm,) = said(record, is_driven=False).alarms
    assert alarm.sensor is None
    assert set(alarm.candidates) == {channel, ATTITUDE[GYROS.index(channel)]}
    assert alarm.accuses
    (alarm,) = said(record, names=False).alarms
    assert alarm.doubt.startswith(f"the gain of {channel} against the attitude is 0.")


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("channel", "factor"), [("phi", -1.0), ("theta", -1.0), ("psi", -1.0), ("theta", 1.7)])
def test_an_angle_that_reads_too_much_or_the_wrong_sign_has_no_gyro_named(seed, channel, factor):
    for flight in (manoeuvring(seed), manoeuvring(seed, noise=0.05, size=1.0)):
        turned = np.where(flight.time_s < ONSET_S, 1.0, factor)
        alarms = said(flight.replace(channel, flight[channel] * turned)).alarms
        assert alarms
        assert {alarm.sensor for alarm in alarms} == {None}


def test_where_nothing_turns_about_the_other_axes_the_angle_is_suspected_too():
    (alarm,) = said(broken(turning(1), gb.ScaleFactor, factor=0.6)).alarms
    assert (alarm.sensor, set(alarm.candidates)) == (None, {"p", "phi"})


def test_what_reads_too_much_is_a_doubt_for_another_gyro_may_drive_the_attitude():
    (alarm,) = said(broken(turning(1), gb.ScaleFactor, factor=1.5)).alarms
    assert alarm.doubt
    assert alarm.candidates == ("p", "phi")


def test_of_a_turned_sign_and_a_deadzone_the_kind_is_said_only_where_it_is_one():
    (alarm,) = said(broken(manoeuvring(2), gb.SignFlip)).alarms
    assert (alarm.sensor, alarm.last.kind) == ("p", "sign_flip")
    record = manoeuvring(2, noise=0.05)
    alarms = said(broken(record, gb.Deadzone, half_width=1.0 * float(np.std(record["p"])))).alarms
    assert [alarm.sensor for alarm in alarms] == ["p"]
    assert alarms[0].last.kind is None


def test_two_axes_that_change_together_name_nobody():
    record = broken(broken(turning(3), gb.ScaleFactor, "p", factor=0.6), gb.ScaleFactor, "q", factor=0.6)
    assert [alarm.sensor for alarm in said(record).alarms] == [None, None]


def test_a_fault_that_was_learnt_or_that_nobody_watches_raises_nothing():
    record = broken(turning(4), gb.ScaleFactor, factor=0.6)
    assert said(record, healthy=[(ONSET_S + 5.0, LENGTH_S)]).excess[-1, 0] < 1.0
    hidden = Excursion(start_s=ONSET_S, end_s=LENGTH_S, reason=TOUCHDOWN)
    assert said(record, excursions=[hidden]).alarms == ()
    assert said(record, healthy=[(0.0, 5.0)]) is None


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("degrees", [-3.0, 3.0])
def test_axes_that_arent_parallel_raise_nothing_where_yaw_and_roll_go_together_later(seed, degrees):
    clean = turning(seed)
    later = clean.time_s > ONSET_S
    yawing = np.where(later, 20.0 * np.cos(0.5 * clean.time_s), 0.0)
    rolling, period_s = 0.1 * yawing, clean.sample_period_s
    values = clean.values + np.column_stack(
        [rolling, 0.0 * yawing, yawing, np.cumsum(rolling) * period_s, 0.0 * yawing, np.cumsum(yawing) * period_s]
    )
    values[:, 0] += np.sin(np.deg2rad(degrees)) * values[:, 2]
    assert said(gb.Record(values, channels=clean.channels, sample_period_s=period_s)).alarms == ()


@pytest.mark.parametrize(("attitude", "names"), [("driven", None), ("own", None)])
def test_a_log_tells_of_a_gain_what_its_monitor_leaves_open(tmp_path, attitude, names):
    record = MECHANISMS["plain"](3).record.select([*GYROS, *ATTITUDE])
    noisy = record.values + np.random.default_rng(1).standard_normal(record.values.shape) * ([2.0] * 3 + [0.2] * 3)
    record = gb.Record(noisy, channels=record.channels, sample_period_s=record.sample_period_s)
    gb.write_log(gb.inject(record, gb.ScaleFactor(channel="p", onset_s=140.0, factor=0.6)), tmp_path / "log.csv")
    watched = gb.watch_log(tmp_path / "log.csv", "auto", attitude=attitude)
    assert {alarm.sensor for alarm in watched.gains.alarms} == {names}
    assert watched.outcome.name == "FAILED"
    told = [alarm for alarm in watched.alarms if alarm.accuses]
    assert all(alarm.sensor in ("p", None) and "p" in alarm.candidates for alarm in told)

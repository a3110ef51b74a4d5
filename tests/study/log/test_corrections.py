"""What references take back of turns: the part that it measures, whom it names, and what raises nothing."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import TOUCHDOWN
from gtmbench.study.log.bent import but_behind
from gtmbench.study.log.choices import _agree
from gtmbench.study.log.corrections import CORRECTED, WINDOWS, corrections
from gtmbench.values.channels import ATTITUDE, GYROS

PERIOD_S, LENGTH_S, ONSET_S = 0.1, 220.0, 130.0
HEALTHY = [(0.0, 90.0)]


def turning(seed, *, noise=0.1, late_s=0.0, circles_deg_s=0.0):
    """Return a flight of smooth turns by some deg/s, whose Euler angles are exact to the second order of small ones."""
    rng = np.random.default_rng(seed)
    time_s = np.arange(0.0, LENGTH_S, PERIOD_S)
    pulsation, phase = 2.0 * np.pi * rng.uniform(0.03, 0.4, (12, 3)), rng.uniform(0.0, 2.0 * np.pi, (12, 3))
    amplitude = 4.0 * rng.standard_normal((12, 3)) / np.sqrt(6.0)
    arms = pulsation * (time_s[:, np.newaxis, np.newaxis] - late_s) + phase
    angles = (amplitude / pulsation * np.sin(arms)).sum(axis=1)
    angles[:, 2] += circles_deg_s * time_s
    (phi, theta, _), slopes = np.deg2rad(angles).T, np.gradient(angles, PERIOD_S, axis=0).T
    p = slopes[0] - np.sin(theta) * slopes[2]
    q = np.cos(phi) * slopes[1] + np.sin(phi) * np.cos(theta) * slopes[2]
    r = -np.sin(phi) * slopes[1] + np.cos(phi) * np.cos(theta) * slopes[2]
    values = np.column_stack([p, q, r, angles])
    values[:, :3] += noise * rng.standard_normal((len(time_s), 3))
    return gb.Record(values, channels=[*GYROS, *ATTITUDE], sample_period_s=PERIOD_S)


def broken(record, *faults, time_constant_s=5.0):
    return gb.inject(record, list(faults), attitude=gb.AttitudeEstimator(time_constant_s=time_constant_s))


def scaled(channel, factor):
    return gb.ScaleFactor(channel=channel, onset_s=ONSET_S, factor=factor)


def said(record, **how):
    return corrections([record], **{"healthy": HEALTHY, **how})


def leaning(record, share, time_constant_s=5.0):
    """Return a record whose references take a share of every turn for none: x' = y + ((1 - share) angle - x) / tau."""
    values = record.values.copy()
    off = np.zeros(3)
    for row in range(1, len(values)):
        pulled = share * values[row, 3:] if row * PERIOD_S > ONSET_S else 0.0
        off = off - PERIOD_S / time_constant_s * (off + pulled)
        values[row, 3:] += off
    return gb.Record(values, channels=record.channels, sample_period_s=PERIOD_S)


@pytest.mark.parametrize("channel", GYROS)
@pytest.mark.parametrize("factor", [0.5, 0.6, -1.0])
def test_the_part_of_the_readings_that_is_wrong_is_measured_and_p_or_q_named(channel, factor):
    found = said(broken(turning(1), scaled(channel, factor)))
    axis = GYROS.index(channel)
    assert found.wrong[-1, -1, axis] == pytest.approx(1.0 - 1.0 / factor, abs=0.15 + 0.05 / abs(factor))
    assert np.abs(np.delete(found.wrong[-1, -1], axis)).max() < 0.3
    (alarm,) = found.alarms
    assert (alarm.test, alarm.source) == (CORRECTED, channel)
    assert alarm.sensor == (channel if channel != "r" else None)
    assert ONSET_S < alarm.time_s < ONSET_S + 65.0
    assert abs(alarm.onset_s - ONSET_S) < 20.0
    if channel == "r":
        assert alarm.doubt.startswith("the attitude is pulled back by ")
    elif factor < 0.0:
        assert alarm.last.kind == "sign_flip"
    else:
        assert alarm.last.kind == "scale_factor"
        assert alarm.last.parameters["factor"] == pytest.approx(factor, abs=0.15)


@pytest.mark.parametrize("time_constant_s", [2.0, 5.0, 12.0])
def test_a_turned_sign_is_named_whatever_the_estimators_time_constant(time_constant_s):
    alarms = said(broken(turning(2), scaled("q", -1.0), time_constant_s=time_constant_s)).alarms
    assert [alarm.sensor for alarm in alarms] == ["q"]


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("noise", [0.01, 0.3, 2.0])
def test_a_healthy_flight_raises_nothing(seed, noise):
    found = said(turning(seed, noise=noise))
    assert np.isfinite(found.wrong[0]).mean() > 0.9
    assert found.alarms == ()


@pytest.mark.parametrize("seed", range(3))
def test_noise_and_a_delay_that_come_later_raise_nothing(seed):
    clean, noisy, late = turning(seed), turning(seed, noise=1.5), turning(seed, late_s=0.1)
    later = (clean.time_s > ONSET_S)[:, np.newaxis]
    for values in (noisy.values, np.column_stack([clean.values[:, :3], late.values[:, 3:]])):
        mixed = np.where(later, values, clean.values)
        record = gb.Record(mixed, channels=clean.channels, sample_period_s=PERIOD_S)
        assert said(record).alarms == ()


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("share", [0.4, 1.0])
def test_references_that_take_turns_for_none_are_no_fault_of_a_gyro(seed, share):
    found = said(leaning(turning(seed), share))
    assert 0.5 * share < np.median(found.wrong[-1, -1]) < 1.5 * share
    assert found.alarms == ()


def test_a_gyro_that_reads_a_little_too_much_never_shows():
    assert said(broken(turning(1), scaled("p", 1.3))).alarms == ()


def test_two_gyros_that_fail_together_name_nobody():
    alarms = said(broken(turning(3), scaled("p", -1.0), scaled("r", -1.0))).alarms
    assert [(alarm.sensor, alarm.candidates) for alarm in alarms] == [(None, ("p", "phi")), (None, ("r", "psi"))]
    assert all(alarm.doubt.startswith("the attitude is pulled back by ") for alarm in alarms)


@pytest.mark.parametrize("channel", GYROS)
@pytest.mark.parametrize("factor", [0.6, 1.5, -1.0])
@pytest.mark.parametrize("is_alone", [True, False])
def test_a_gyro_by_which_the_attitude_doesnt_turn_isnt_named(channel, factor, is_alone):
    healthy = turning(1)
    bent = broken(healthy, scaled(channel, factor))  # another gyro failed, and drives the attitude
    record = bent.replace(channel, healthy[channel])
    assert not any(alarm.accuses for alarm in said(record, is_alone=is_alone).alarms)


def test_of_several_imus_the_one_is_named_that_the_attitude_follows_visibly():
    record = broken(turning(1), scaled("q", -1.0))
    assert [alarm.sensor for alarm in said(record, is_alone=False).alarms] == ["q"]
    hidden = record.replace("theta", record["theta"] + np.random.default_rng(1).standard_normal(len(record)))
    assert not any(alarm.accuses for alarm in said(hidden, is_alone=False).alarms)


def test_what_was_learnt_what_nobody_watches_and_too_little_raise_nothing():
    record = broken(turning(4), scaled("q", -1.0))
    assert said(record, healthy=[(ONSET_S, LENGTH_S)]).excess[-1, -1, 1] < 1.0
    hidden = Excursion(start_s=ONSET_S, end_s=LENGTH_S, reason=TOUCHDOWN)
    assert said(record, excursions=[hidden]).alarms == ()
    assert said(record, healthy=[(0.0, 8.0)]) is None
    short = turning(0).between(0.0, 18.0)
    assert corrections([short], healthy=[(0.0, 18.0)]).alarms == ()
    assert corrections([short.between(0.0, 3.0)], healthy=[(0.0, 3.0)]) is None


def test_nobody_is_named_behind_a_gyro_that_was_named():
    (first,) = said(broken(turning(1), scaled("q", -1.0))).alarms
    (other,) = said(broken(turning(1), scaled("p", -1.0))).alarms
    later = replace(other, time_s=first.time_s + 30.0)
    behind = but_behind([first, later], [first, later])
    assert behind[0] == first
    doubted = behind[1]
    assert (doubted.sensor, doubted.accuses) == (None, False)
    assert doubted.doubt.startswith("q failed before")


@pytest.mark.parametrize("circles_deg_s", [0.0, 6.0, 15.0])
@pytest.mark.parametrize("share", [0.2, 0.6])
def test_iron_that_comes_near_a_compass_accuses_nobody(share, circles_deg_s):
    """Iron of a share of the field turns a compass by heading: by atan2(-s sin(psi), 1 + s cos(psi))."""
    for seed in (3, 5):
        record = turning(seed, circles_deg_s=circles_deg_s)
        values = record.values.copy()
        heading = np.deg2rad(values[:, 5])
        iron = share * np.clip((record.time_s - ONSET_S) / 30.0, 0.0, 1.0)
        wrong = np.rad2deg(np.arctan2(-iron * np.sin(heading), 1.0 + iron * np.cos(heading)))
        off = 0.0
        for row in range(1, len(values)):  # the estimator's heading follows the compass in 5 s
            off += PERIOD_S / 5.0 * (wrong[row] - off)
            values[row, 5] += off
        bent = gb.Record(values, channels=record.channels, sample_period_s=PERIOD_S)
        assert {alarm.sensor for alarm in said(bent).alarms} <= {None}


def test_missing_samples_and_parts_of_a_log_are_left_out():
    record = broken(turning(1), scaled("q", -1.0))
    values = record.values.copy()
    values[np.random.default_rng(1).random(values.shape) < 0.01] = np.nan
    holed = gb.Record(values, channels=record.channels, sample_period_s=PERIOD_S)
    parts = [holed.between(0.0, 120.0), holed.between(140.0, 219.0)]
    assert [alarm.sensor for alarm in corrections(parts, healthy=HEALTHY).alarms] == ["q"]


def test_another_choice_of_what_is_healthy_agrees_by_a_doubt_within_its_windows():
    (named,) = said(broken(turning(1), scaled("q", -1.0))).alarms
    doubted = replace(named, judgements=(replace(named.last, sensor=None, candidates=("q", "theta"), doubt="small"),))
    assert _agree(named, doubted)
    assert not _agree(named, said(broken(turning(1), scaled("p", -1.0))).alarms[0])
    moved = gb.Alarm(number=0, time_s=300.0, onset_s=named.onset_s + WINDOWS[-1] + 1.0, source="q", test=CORRECTED)
    assert not _agree(named, moved)


def test_a_log_names_a_turned_sign_that_its_attitude_follows(tmp_path):
    truth = gb.fly(excitation="multisine+turbulence", duration_s=240.0, seed=5)
    flight = gb.decimate(gb.filtered_attitude(gb.measure(truth, noise="t2", seed=5), time_constant_s=5.0, seed=5), 10)
    fault = gb.SignFlip(channel="q", onset_s=150.0)
    gb.write_log(broken(flight, fault), tmp_path / "log.csv")
    gb.write_log(flight, tmp_path / "healthy.csv")
    watched = gb.watch_log(tmp_path / "log.csv", "auto", attitude="driven")
    assert {alarm.sensor for alarm in watched.corrections.alarms} == {"q"}
    assert {alarm.sensor for alarm in watched.alarms if alarm.accuses} == {"q"}
    healthy = gb.watch_log(tmp_path / "healthy.csv", "auto", attitude="driven")
    assert (healthy.outcome.name, healthy.corrections.alarms) == ("HEALTHY", ())
    assert gb.watch_log(tmp_path / "healthy.csv", "auto", attitude="own").corrections is None

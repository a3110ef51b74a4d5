"""Gyros that stand still: which are told, and what stands still for another reason."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.report.words.verdict import summary_lines, verdict_text
from gtmbench.study.log.frozen import frozen_gyros
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.values.channels import GYROS

PERIOD_S, HEALTHY = 0.05, [(0.0, 60.0)]
FROM, TO = 1600, 2000  # rows: 80 to 100 s


def moving(seed, *, size=5.0):
    noise = np.random.default_rng(seed).standard_normal((3000, 3))
    return size * np.cumsum(noise - 0.05 * np.cumsum(noise, axis=0) / np.arange(1, 3001)[:, np.newaxis], axis=0) / 30.0


def said(read, healthy=HEALTHY):
    return frozen_gyros([gb.Record(read, channels=GYROS, sample_period_s=PERIOD_S)], healthy)


def held(read, axes, last=TO):
    frozen = read.copy()
    frozen[FROM:last, axes] = frozen[FROM, axes]
    return frozen


@pytest.mark.parametrize("axis", range(3))
@pytest.mark.parametrize("grain", [0.0, 0.06])
def test_a_gyro_that_stands_still_alone_is_named(axis, grain):
    read = moving(axis)
    read = np.round(read / grain) * grain if grain else read
    (alarm,) = said(held(read, axis))
    assert (alarm.sensor, alarm.last.kind, alarm.doubt) == (GYROS[axis], None, "")
    assert alarm.last.parameters["value"] == read[FROM, axis]
    assert alarm.onset_s == pytest.approx(FROM * PERIOD_S, abs=2.0 * PERIOD_S)
    assert alarm.onset_s + 3.0 <= alarm.time_s < alarm.onset_s + 10.0
    assert alarm.ended_s == pytest.approx(TO * PERIOD_S, abs=2.0 * PERIOD_S)


def test_one_that_never_moves_again_is_found_and_doesnt_end():
    (alarm,) = said(held(moving(3), 1, last=3000))
    assert (alarm.ended_s, alarm.last.kind) == (None, "stuck")


@pytest.mark.parametrize("seed", range(3))
def test_readings_that_move_or_are_as_coarse_as_usual_raise_nothing(seed):
    read = moving(seed)
    assert said(read) == ()
    coarse = np.round(read / 20.0) * 20.0  # stands still for seconds, also where identified
    assert said(coarse) == ()


@pytest.mark.parametrize("value", [0.0, 0.0573])
def test_noise_within_a_count_at_rest_raises_nothing(value):
    """Telemetry in mrad/s: on the ground q stays within a count, while p and r step over one."""
    read = moving(4)
    read[FROM:TO] = 0.0573 * (np.random.default_rng(4).random((TO - FROM, 3)) < 0.5)
    read[FROM:TO, 1] = value
    assert said(read) == ()


def test_what_all_gyros_do_and_what_is_missing_or_short_raises_nothing():
    read = moving(5)
    assert said(held(read, [0, 1, 2])) == ()
    assert said(held(read, [0, 1])) == ()  # as on the ground of a simulator
    assert said(held(read, 0, last=FROM + round(2.5 / PERIOD_S))) == ()
    lost = read.copy()
    lost[FROM:TO, 2] = np.nan
    assert said(lost) == ()


def test_without_enough_to_learn_from_nothing_is_told():
    assert said(held(moving(6), 0), healthy=[(0.0, 10.0)]) == ()
    assert said(held(moving(6), 0), healthy=()) == ()


def test_interpolated_readings_count_as_still():
    frozen = held(moving(7), 2)
    frozen[FROM:TO, 2] *= 1.0 + 1e-15 * np.random.default_rng(1).standard_normal(TO - FROM)
    assert [alarm.sensor for alarm in said(frozen)] == ["r"]


def test_a_log_is_told_so_without_what_the_monitor_says(tmp_path):
    record = MECHANISMS["plain"](3).record.select([*GYROS, "phi", "theta", "psi"])
    gb.write_log(gb.inject(record, gb.Jam(channel="q", onset_s=140.0)), tmp_path / "log.csv")
    watched = gb.watch_log(tmp_path / "log.csv", "auto", attitude="driven")
    assert [alarm.sensor for alarm in watched.frozen] == ["q"]
    assert watched.outcome.name == "FAILED"
    assert "the pitch gyro (q) failed" in verdict_text(watched).lower()
    assert any("the reading of q stands at" in line.lower() for line in summary_lines(watched, width=400))

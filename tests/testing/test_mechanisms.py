"""Healthy logs, one for each mechanism: each does what it says, to a figure, and nothing else; two flights are enough.

Ranges are those of public autopilot logs, measured in 2026.
"""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.testing.mechanisms import CHANNELS, MECHANISMS, late_s
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GYROS
from tests.helpers.night import by_day


@pytest.fixture(params=[0, 1])
def seed(request):
    return request.param


@pytest.fixture(scope="module")
def made():
    return cache(lambda name, seed: MECHANISMS[name](seed))


def kinematic(record):
    """What the attitude says that gyros should read, and how far they are from it."""
    told = gb.derive(record, ["p_att", "q_att", "r_att"]).matrix(("p_att", "q_att", "r_att"))
    return told, record.matrix(GYROS) - told


def rms(values):
    return float(np.sqrt(np.nanmean(np.square(values))))


def rows(record, start_s, end_s):
    return (record.time_s >= start_s) & (record.time_s <= end_s)


def felt(record):
    return np.linalg.norm(record.matrix(ACCELEROMETERS), axis=1)


@pytest.mark.parametrize("name", by_day(MECHANISMS))
def test_it_is_a_log_as_autopilots_make_them(made, name, seed):
    log = made(name, seed)
    record = log.record
    assert record.channels == CHANNELS
    assert np.isfinite(record.values).all()
    assert 10.0 <= 1.0 / record.sample_period_s <= 50.0
    assert 59.0 <= record.end_s - record.start_s <= 200.0
    assert np.abs(record["theta"]).max() < 85.0
    assert all(record.start_s <= event.time_s <= record.end_s for event in log.events)
    assert all(record.start_s <= start_s <= end_s <= record.end_s for start_s, end_s in log.spans)


@pytest.mark.parametrize("name", by_day(MECHANISMS, 4))
def test_the_same_seed_is_the_same_log(made, name):
    first, again, other = made(name, 0), MECHANISMS[name](0), made(name, 1)
    assert np.array_equal(first.record.values, again.record.values)
    assert (first.events, first.spans) == (again.events, again.spans)
    assert not np.array_equal(first.record.values[:100], other.record.values[:100])


def test_the_attitude_follows_the_gyros_and_wanders(made, seed):
    record = made("plain", seed).record
    told, left = kinematic(record)
    assert rms(left) < 0.05 * rms(told)
    block = round(3.0 / record.sample_period_s)
    means = left[: len(left) // block * block].reshape(-1, block, 3)
    wander = np.nanstd(np.nanmean(means, axis=1), axis=0)
    assert (wander > 0.01).all()
    assert (wander < 0.4).all()


def test_a_touchdown_is_felt_and_the_attitude_doesnt_ring(made, seed):
    log = made("touchdown", seed)
    record, ((down_s, end_s),) = log.record, log.spans
    _, left = kinematic(record)
    about, before = rows(record, down_s - 0.05, end_s), rows(record, 1.0, down_s - 1.0)
    assert 1.4 < felt(record)[about].max() < 6.0
    assert 1.0 < np.nanmax(np.abs(left[about])) < 205.0
    assert np.nanmax(np.abs(left[about])) > 10.0 * rms(left[before])
    after = rows(record, end_s + 1.5, record.end_s)
    assert np.abs(record.matrix(GYROS)[after]).max() < 2.0
    assert felt(record)[after] == pytest.approx(1.0, abs=0.15)
    (event,) = log.events
    assert event.kind == "touchdown"
    assert event.time_s == pytest.approx(down_s + 2.0)


def test_an_impact_turns_the_aircraft_about_and_the_estimator_loses_it(made, seed):
    log = made("impact", seed)
    record, hit_s = log.record, log.spans[0][0]
    _, left = kinematic(record)
    about = rows(record, hit_s, hit_s + 1.0)
    assert 3.0 < felt(record)[about].max() < 22.0
    assert 200.0 < np.abs(record.matrix(GYROS)[about]).max() < 2000.0
    assert np.nanmax(np.abs(left[about])) > 50.0
    assert [event.kind for event in log.events] == ["failure", "touchdown", "disarm"]


def test_a_reset_is_a_step_of_the_attitude_as_large_as_the_log_says(made, seed):
    log = made("reset", seed)
    for event in log.events:
        before = np.searchsorted(log.record.time_s, event.time_s) - 1
        jump = np.diff(log.record.matrix(ATTITUDE)[before : before + 2], axis=0)[0]
        turned = 1.5 * np.abs(log.record.matrix(GYROS)[before : before + 2]).max() * log.record.sample_period_s
        told = float(event.text.split()[2])
        assert np.linalg.norm(jump) == pytest.approx(told, abs=turned + 0.1 + 0.05 * told)
        assert 0.1 <= told < 31.0
    assert len(log.events) == 5
    _, left = kinematic(log.record)
    quiet = np.ones(len(log.record), dtype=bool)
    for time_s, _ in log.spans:
        quiet &= ~rows(log.record, time_s - 0.3, time_s + 0.3)
    assert rms(left[quiet]) < 0.1 * np.nanmax(np.abs(left))


@pytest.mark.parametrize(("name", "least_hz", "most_hz"), [("held samples", 10, 20), ("hardly fresh", 2.5, 2.5)])
def test_held_readings_are_fresh_as_often_as_said(made, name, least_hz, most_hz, seed):
    record = made(name, seed).record
    changes = (np.diff(record.matrix(ATTITUDE), axis=0) != 0).all(axis=1)
    fresh_hz = changes.sum() / (record.end_s - record.start_s)
    assert 0.98 * least_hz <= fresh_hz <= 1.02 * most_hz
    assert (np.diff(record.matrix(GYROS), axis=0) != 0).all()


def test_a_late_attitude_is_as_late_as_said(made, seed):
    record, late = made("late attitude", seed).record, late_s(seed)
    told, _ = kinematic(record)
    lags_s = np.arange(0.0, 0.4, 0.01)
    inside = rows(record, 2.0, record.end_s - 2.0)

    def unlike(lag_s):
        earlier = np.interp(record.time_s - lag_s, record.time_s, record["p"])
        return rms((told[:, 0] - earlier)[inside])

    assert lags_s[np.argmin([unlike(lag_s) for lag_s in lags_s])] == pytest.approx(late, abs=0.02)
    assert 0.05 <= late <= 0.3


def test_vibration_is_three_times_as_strong_at_times_and_in_the_gyros_only(made, seed):
    record = made("vibration", seed).record
    block = round(3.0 / record.sample_period_s)
    _, left = kinematic(record)
    blocks = left[: len(left) // block * block].reshape(-1, block, 3)
    strength = np.sqrt(np.nanmean(np.square(blocks), axis=(1, 2)))
    assert 2.2 < strength.max() / strength.min() < 3.5
    calm = made("plain", seed).record
    ripple = [np.diff(each.matrix(ATTITUDE), 3, axis=0).std() for each in (record, calm)]
    assert ripple[0] == pytest.approx(ripple[1], rel=0.2)


def test_a_model_error_grows_with_motion_and_has_tails(made, seed):
    record = made("model error", seed).record
    told, left = kinematic(record)
    block = round(2.0 / record.sample_period_s)
    whole = len(left) // block * block
    error, motion = (
        np.sqrt(np.nanmean(np.square(values[:whole]).reshape(-1, block, 3).sum(axis=2), axis=1))
        for values in (left, told)
    )
    assert np.corrcoef(np.log(error), np.log(motion))[0, 1] > 0.6
    assert 0.05 < np.median((error / motion)[motion > np.quantile(motion, 0.8)]) < 0.15
    sizes = np.abs(left[np.isfinite(left)])
    assert np.quantile(sizes, 0.999) / (np.median(sizes) / 0.6745) > 5.0


def test_what_is_carried_about_turns_as_its_attitude_says_and_its_heading_comes_to_rest(made, seed):
    log = made("handling", seed)
    record, ((_, off_s),) = log.record, log.spans
    told, left = kinematic(record)
    held = rows(record, 3.0, off_s - 4.0)
    assert rms(told[held]) > 5.0
    assert rms(left[held][:, :2]) < 0.4 * rms(told[held][:, :2])
    assert felt(record)[held] == pytest.approx(1.0, abs=0.25)
    flying, carried = rows(record, off_s + 2.0, record.end_s), rows(record, 0.5, 5.0)
    assert np.abs(np.nanmean(left[carried][:, 2])) > 5.0 * np.abs(np.nanmean(left[flying][:, 2]))
    assert [event.kind for event in log.events] == ["arm", "takeoff"]

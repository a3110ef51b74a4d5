"""Slow faults: means find what estimators hide, accuse nobody in health, and find what they promise."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import Alarm, Judgement
from gtmbench.study.log.seconds import trailing_means
from gtmbench.study.log.slow_means import LEAST_DEG_S, SLOW, beyond, mean_error_deg_s, slow_means
from gtmbench.study.log.slow_sizes import slow_size
from tests.helpers.autopilot_logs import imus

HEALTHY = [(0.0, 90.0)]
ONSET_S, DURATION_S = 120.0, 240.0


@pytest.fixture(scope="module")
def flown():
    """Return healthy flights whose attitude the gyros drive, by their seeds."""
    return {seed: imus(1, seed=seed, duration_s=DURATION_S)[0] for seed in (1, 2, 3)}


def with_fault(fault, seed=1):
    return imus(1, faults=[(0, fault)], seed=seed, duration_s=DURATION_S)[0]


def compared(record, **how):
    return slow_means([record], healthy=HEALTHY, **{"is_driven": True, **how})


@pytest.mark.parametrize("seed", [1, 2, 3])
@pytest.mark.parametrize("is_driven", [True, False])
def test_a_healthy_flight_raises_nothing(flown, seed, is_driven):
    means = compared(flown[seed], is_driven=is_driven)
    assert means.alarms == ()
    assert means.watched_s > 0.95 * (DURATION_S - HEALTHY[0][1])


@pytest.mark.parametrize("channel", ["p", "q"])
@pytest.mark.parametrize("fault", [lambda name: gb.Bias(channel=name, onset_s=ONSET_S, size=-5.0)], ids=["bias"])
def test_what_would_turn_the_attitude_over_is_the_gyros(channel, fault):
    (alarm,) = compared(with_fault(fault(channel))).alarms
    assert (alarm.sensor, alarm.test, alarm.last.kind) == (channel, SLOW, "bias")
    assert ONSET_S - 3.0 <= alarm.onset_s <= alarm.time_s <= ONSET_S + 12.0
    assert alarm.last.time_s >= alarm.time_s
    assert alarm.last.parameters["size"] == pytest.approx(-5.0, abs=1.0)


@pytest.mark.parametrize(("channel", "angle"), [("p", "phi"), ("r", "psi")])
def test_less_is_a_doubt_that_names_nobody(channel, angle):
    (alarm,) = compared(with_fault(gb.Bias(channel=channel, onset_s=ONSET_S, size=0.9))).alarms
    assert (alarm.sensor, alarm.candidates) == (None, (channel, angle))
    assert alarm.doubt.startswith(f"the means of {channel} and of the attitude differ by 0.")


@pytest.mark.parametrize("channel", ["p", "q", "r"])
def test_a_drift_that_reaches_a_degree_a_second_is_found(channel):
    alarms = compared(with_fault(gb.Drift(channel=channel, onset_s=ONSET_S, slope=0.02))).alarms
    assert channel in {alarm.source for alarm in alarms}


def test_an_attitude_of_its_own_may_drift_so_none_of_the_two_is_named(flown):
    broken = gb.inject(flown[1], gb.Drift(channel="phi", onset_s=ONSET_S, slope=3.0))
    alarms = compared(broken, is_driven=False).alarms
    assert {alarm.source for alarm in alarms} == {"p"}
    assert all(alarm.sensor is None and alarm.candidates == ("p", "phi") for alarm in alarms)


def test_no_smaller_mean_error_raises_an_alarm_than_is_asked_for():
    record = with_fault(gb.Bias(channel="q", onset_s=ONSET_S, size=0.9))
    assert compared(record).alarms != ()
    assert compared(record, least_deg_s=1.5).alarms == ()


@pytest.mark.parametrize("channel", ["p", "q", "r"])
@pytest.mark.parametrize("seed", [1, 2])
def test_what_is_promised_is_found(flown, channel, seed):
    promised = slow_size(compared(flown[seed]), channel, "bias", 0.9)
    assert 0.3 <= promised.size < 1.5
    fault = gb.Bias(channel=channel, onset_s=ONSET_S, size=1.05 * promised.size)
    (first, *_) = compared(with_fault(fault, seed)).alarms
    assert first.source == channel
    assert first.time_s <= ONSET_S + promised.within_s


def test_nothing_is_promised_of_other_faults_or_sensors(flown):
    means = compared(flown[1])
    assert slow_size(means, "p", "scale_factor", 0.9) is None
    assert slow_size(means, "phi", "bias", 0.9) is None


def test_too_little_that_is_healthy_compares_nothing(flown):
    assert slow_means([flown[1]], healthy=[(0.0, 10.0)], is_driven=True) is None


@pytest.mark.parametrize("known", [1.0, 0.5])
def test_trailing_means_are_means(known):
    values = np.random.default_rng(1).standard_normal((40, 3))
    values[7] = np.nan
    for row in range(40):
        part = values[max(row - 4, 0) : row + 1]
        there = np.isfinite(part).sum(axis=0)
        enough = row >= 4 and (there >= known * 5).all()
        expected = np.nanmean(part, axis=0) if enough else np.full(3, np.nan)
        np.testing.assert_allclose(trailing_means(values, 5, known)[row], expected)


def alarm_of(sensor, *, doubt="", onset_s=100.0, kind="bias", **parameters):
    judged = Judgement(time_s=130.0, sensor=sensor, candidates=(sensor,), kind=kind, parameters=parameters, doubt=doubt)
    return Alarm(number=0, time_s=onset_s + 1.0, onset_s=onset_s, source=sensor, judgements=(judged,))


def test_what_is_named_already_isnt_told_again():
    means = compared(with_fault(gb.Bias(channel="p", onset_s=ONSET_S, size=5.0)))
    assert beyond([alarm_of("p", onset_s=ONSET_S)], means.alarms) == []
    assert len(beyond([alarm_of("p", onset_s=ONSET_S, doubt="motion")], means.alarms)) == 1
    assert len(beyond([alarm_of("q", onset_s=ONSET_S)], means.alarms)) == 1


@pytest.mark.parametrize(
    ("alarm", "off"),
    [
        (alarm_of("p", size=-0.05), 0.05),
        (alarm_of("p", kind="drift", slope=0.01, onset_s=100.0), 0.3),
        (alarm_of("phi", kind="drift", slope=-0.04), 0.04),
        (alarm_of("phi", size=2.0), None),
        (alarm_of("p", kind="scale_factor", factor=1.1), None),
    ],
)
def test_the_mean_error_of_what_was_judged(alarm, off):
    assert mean_error_deg_s(alarm) == pytest.approx(off)


def test_the_least_mean_error_is_a_tenth_of_a_degree_a_second():
    assert LEAST_DEG_S == 0.1

"""Air data as referees: they tell a gyro from its angle where they are as good as ever, and else nothing."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.isolation.case import WITNESSES
from gtmbench.detectors.isolation.referee import referees_of
from gtmbench.method.pseudo_inputs import derive
from tests.helpers import monitors
from tests.helpers.night import by_day

ONSET_S = 60.0
G, KT = 9.80665, 1852.0 / 3600.0
NOISE = {"alpha": 0.03, "beta": 0.03, "tas": 0.06, "nx": 0.001, "ny": 0.002, "nz": 0.007}


def flown(seed, samples=6000, period_s=0.02, gusts=None):
    """Return a made-up flight whose air data and accelerometers are those of its motion; `gusts` in deg, row by row."""
    truth = monitors.truth(samples, seed, period_s)
    radians = {name: np.deg2rad(truth[name]) for name in ("p", "q", "r", "phi", "theta", "alpha", "beta")}
    alpha, beta, phi, theta = (radians[name] for name in ("alpha", "beta", "phi", "theta"))
    speed = truth["tas"] * KT
    velocity = speed * np.array([np.cos(alpha) * np.cos(beta), np.sin(beta), np.sin(alpha) * np.cos(beta)])
    turning = np.array([radians[name] for name in "pqr"])
    gravity = G * np.array([-np.sin(theta), np.cos(theta) * np.sin(phi), np.cos(theta) * np.cos(phi)])
    force = np.gradient(velocity, period_s, axis=1) + np.cross(turning, velocity, axis=0) - gravity
    readings = {**{name: truth[name] for name in ("alpha", "beta", "tas")}}
    readings |= dict(zip(("nx", "ny", "nz"), force * np.array([[1.0], [1.0], [-1.0]]) / G, strict=True))
    if gusts is not None:
        readings["alpha"] = readings["alpha"] + gusts
        readings["beta"] = readings["beta"] + gusts[::-1]
    random = np.random.default_rng([seed, 7])
    sensed = monitors.record(samples, seed, period_s).select(["p", "q", "r", "phi", "theta", "psi"])
    air = [values + NOISE[name] * random.standard_normal(samples) for name, values in readings.items()]
    return gb.Record(
        np.column_stack([sensed.values, *air]), channels=[*sensed.channels, *readings], sample_period_s=period_s
    )


def without(record):
    return record.select([name for name in record.channels if name not in WITNESSES])


def last(watched):
    return watched.faults[0].judgements[-1]


@pytest.fixture(scope="module")
def monitor():
    return monitors.monitor("C")


@pytest.fixture(scope="module")
def healthy():
    return flown(seed=11)


# what air data say

AXES = {"p": "phi", "q": "theta", "r": "psi"}
MORE = {"p": 6.0, "q": 1.0, "r": 1.0}  # roll shows in air data by gravity alone
JUDGED = slice(3200, 5000)


def predicted(record):
    """Return virtual sensors of the gyros that are as good as the attitude is."""
    smooth = np.ones(9) / 9.0
    return {gyro: np.convolve(derive(record, [f"{gyro}_att"])[f"{gyro}_att"], smooth, mode="same") for gyro in AXES}


def referees(record, bank="C", since_s=0.0):
    before = record.between(since_s, ONSET_S)
    return referees_of(gb.load_bank(bank), before, predicted(before))


def off(record, size):
    """Return a wrong rate, and what it is of an angle."""
    since = record.time_s > ONSET_S
    rate = np.where(since, size * np.sin(2.0 * record.time_s), 0.0)
    return rate, np.cumsum(rate) * record.sample_period_s


@pytest.mark.parametrize("gyro", AXES)
def test_the_one_that_need_not_be_wrong_is_cleared(healthy, gyro):
    referee, angle, (rate, turned) = referees(healthy)[gyro], AXES[gyro], off(healthy, MORE[gyro])
    should = predicted(healthy)[gyro], healthy[angle]
    of_gyro = referee.objections(
        healthy.replace(gyro, healthy[gyro] + rate), {gyro: should[0], angle: should[1] + turned}, JUDGED
    )
    of_angle = referee.objections(
        healthy.replace(angle, healthy[angle] + turned), {gyro: should[0] + rate, angle: should[1]}, JUDGED
    )
    assert set(of_gyro) == {angle}
    assert set(of_angle) == {gyro}
    assert min(of_gyro[angle], of_angle[gyro]) > 100.0


@pytest.mark.parametrize("gyro", AXES)
def test_nothing_is_said_of_what_is_healthy_or_where_air_data_agree_with_neither(healthy, gyro):
    referee, angle, (rate, turned) = referees(healthy)[gyro], AXES[gyro], off(healthy, MORE[gyro])
    should = predicted(healthy)[gyro], healthy[angle]
    assert referee.objections(healthy, {gyro: should[0], angle: should[1]}, JUDGED) == {}
    gust = np.where(healthy.time_s > ONSET_S, 3.0 * np.sin(healthy.time_s), 0.0)
    blown = healthy.replace("alpha", healthy["alpha"] + gust).replace("beta", healthy["beta"] + gust)
    broken = blown.replace(gyro, blown[gyro] + rate)
    assert referee.objections(broken, {gyro: should[0], angle: should[1] + turned}, JUDGED) == {}
    assert referee.objections(broken, {gyro: should[0], angle: should[1] + turned}, slice(3200, 3250)) == {}


def test_there_are_none_without_air_data_nor_of_banks_that_stand_on_them(healthy):
    assert set(referees(healthy)) == set(AXES)
    assert referees(healthy, bank="B") == {}
    assert referees(without(healthy)) == {}
    assert referees(healthy.replace("beta", np.full(len(healthy), np.nan))) == {}
    assert referees(healthy, since_s=ONSET_S - 10.0) == {}
    still = gb.Record(np.ones((6000, 12)), channels=healthy.channels, sample_period_s=0.02)
    assert referees(still) == {}


# what a monitor says with them


@pytest.mark.parametrize(
    "fault",
    by_day(
        [
            gb.Bias(channel="p", onset_s=ONSET_S, size=1.0),
            gb.Drift(channel="phi", onset_s=ONSET_S, slope=1.0),
            gb.Bias(channel="q", onset_s=ONSET_S, size=1.0),
            gb.Drift(channel="theta", onset_s=ONSET_S, slope=1.0),
            gb.Bias(channel="r", onset_s=ONSET_S, size=1.0),
            gb.Drift(channel="psi", onset_s=ONSET_S, slope=1.0),
        ]
    ),
    ids=lambda fault: fault.channel,
)
def test_faults_that_are_physically_the_same_are_told_apart(monitor, healthy, fault):
    broken = gb.inject(healthy, fault)
    alone, refereed = last(monitor.watch(without(broken))), last(monitor.watch(broken))
    assert alone.sensor in (None, fault.channel)
    assert fault.channel in alone.candidates
    assert (refereed.sensor, refereed.kind) == (fault.channel, fault.kind)


def test_no_alarm_stands_on_them_and_air_data_that_read_nothing_are_none(monitor, healthy):
    broken = gb.inject(healthy, gb.ScaleFactor(channel="theta", onset_s=ONSET_S, factor=1.3))
    alone, refereed = monitor.watch(without(broken)), monitor.watch(broken)
    whens = [[(each.time_s, each.onset_s, each.source) for each in said.alarms] for said in (alone, refereed)]
    assert whens[0] == whens[1]
    silent = broken
    for name in WITNESSES:
        silent = silent.replace(name, np.full(len(silent), np.nan))
    assert repr(monitor.watch(silent).alarms) == repr(alone.alarms)


@pytest.mark.parametrize("channel", by_day(["q", "theta", "r", "psi"], 2, seed=78))
def test_a_gust_that_comes_with_the_fault_changes_no_verdict(monitor, channel):
    random = np.random.default_rng(5)
    gusts = np.convolve(random.standard_normal(6000), np.ones(25) / 25.0, mode="same") * 5.0
    blown = flown(seed=11, gusts=np.where(np.arange(6000) * 0.02 > ONSET_S, gusts, 0.0))
    broken = gb.inject(blown, gb.ScaleFactor(channel=channel, onset_s=ONSET_S, factor=1.3))
    refereed, alone = last(monitor.watch(broken)), last(monitor.watch(without(broken)))
    for name, interval in alone.intervals.items():  # more shapes are multiplied beside accelerometers
        assert refereed.intervals[name] == pytest.approx(interval, rel=1e-9)
    assert refereed.parameters == pytest.approx(alone.parameters, rel=1e-9)
    assert refereed == replace(alone, intervals=refereed.intervals, parameters=refereed.parameters)


@pytest.mark.parametrize("size", by_day([100, 1, 7]))
def test_a_stream_says_what_watch_says(monitor, healthy, size):
    broken = gb.inject(healthy, gb.Drift(channel="psi", onset_s=ONSET_S, slope=1.0))
    assert repr(monitors.streamed(monitor, broken, size).alarms) == repr(monitor.watch(broken).alarms)

"""An attitude that the gyros drive: what an estimator makes of a fault, how that shows, and who is named."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import savgol_filter

import gtmbench as gb
from gtmbench.detectors.bank.calibrated import residuals_of
from gtmbench.detectors.isolation.effects import CANDIDATES, Bend, undriven
from gtmbench.detectors.isolation.fitter import Fitter
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.detectors.monitor.superposition import Followed
from gtmbench.log.judging.certificate import certificate_of, kinds
from gtmbench.report.words.found import certificate_lines
from gtmbench.values.attitude_estimators import FASTEST_S, SLOWEST_S
from gtmbench.values.channels import ATTITUDE, GYROS
from tests.helpers import monitors
from tests.helpers.night import by_day

PERIOD_S, ONSET_S, REFERENCE_DEG = 0.02, 60.0, 0.3
SLOW = gb.AttitudeEstimator(time_constant_s=5.0)
LEARNING = gb.AttitudeEstimator(time_constant_s=4.0, bias_time_constant_s=16.0)
FAULTS = {
    "bias": lambda channel: gb.Bias(channel=channel, onset_s=ONSET_S, size=2.0),
    "drift": lambda channel: gb.Drift(channel=channel, onset_s=ONSET_S, slope=0.2),
    "jam": lambda channel: gb.Jam(channel=channel, onset_s=ONSET_S),
    "scale_factor": lambda channel: gb.ScaleFactor(channel=channel, onset_s=ONSET_S, factor=0.6),
    "sign_flip": lambda channel: gb.SignFlip(channel=channel, onset_s=ONSET_S),
}


def estimated(record, estimator, noise_deg=REFERENCE_DEG, seed=1):
    bias_s = estimator.bias_time_constant_s
    return gb.filtered_attitude(
        record,
        time_constant_s=estimator.time_constant_s,
        reference_noise_deg=noise_deg,
        bias_time_constant_s=bias_s if np.isfinite(bias_s) else None,
        seed=seed,
    )


@cache
def sensed(seed, samples=5000):
    """A record whose gyros are noisy, and whose attitude is true: an estimator's references."""
    noisy, true = monitors.record(samples, seed), monitors.truth(samples, seed)
    for name in ATTITUDE:
        noisy = noisy.replace(name, true[name])
    return noisy


@cache
def healthy(estimator=SLOW, seed=31):
    return estimated(sensed(seed), estimator, seed=seed)


@cache
def monitor():
    records = [estimated(sensed(seed), SLOW, seed=seed) for seed in range(1, 7)]
    return monitors.shared("driven", lambda: gb.calibrate(records, bank=gb.load_bank("C-filtered")))


@pytest.mark.parametrize("estimator", [SLOW, LEARNING])
@pytest.mark.parametrize("kind", FAULTS)
def test_a_record_that_is_bent_is_what_the_estimator_would_have_made_of_the_broken_gyro(kind, estimator):
    fault = FAULTS[kind]("q")
    made = estimated(gb.inject(sensed(31), fault), estimator, seed=31)
    bent = gb.inject(healthy(estimator), fault, attitude=estimator)
    off = np.abs(made.matrix([*GYROS, *ATTITUDE]) - bent.matrix([*GYROS, *ATTITUDE])).max()
    largest = np.abs(bent.matrix(ATTITUDE) - healthy(estimator).matrix(ATTITUDE)).max()
    assert off < (1e-9 if estimator is SLOW else 0.02 * largest)  # what it had learnt before of a bias isn't in the log


@pytest.mark.parametrize("estimator", by_day(CANDIDATES, 3, seed=78))
@pytest.mark.parametrize("channel", GYROS)
def test_a_bend_is_linear_in_small_changes_and_exact_to_second_order(channel, estimator):
    record = healthy().between(0.0, 40.0)
    change = np.where(np.arange(len(record)) >= 500, np.sin(np.arange(len(record)) / 30.0), 0.0)
    bend = Bend(estimator, record, 0, channel)

    def error(size):
        bent = estimator.bent(record, record.replace(channel, record[channel] + size * change))
        linear = bend.of(size * change[np.newaxis])
        return max(np.abs(linear[name][0] - (bent[name] - record[name])).max() for name in ATTITUDE)

    largest = max(np.abs(bend.of(change[np.newaxis])[name]).max() for name in ATTITUDE)
    assert error(0.1) < 0.01 * 0.1 * largest
    assert error(0.01) < 0.2 * error(0.1)


@pytest.mark.parametrize("estimator", [SLOW, LEARNING])
def test_what_references_contradict_gives_the_change_of_the_gyro_back(estimator):
    from scipy.signal import lfilter

    change = np.where(np.arange(4000) >= 200, 1.0 + np.sin(np.arange(4000) / 200.0), 0.0)
    angle = lfilter(*estimator.response(PERIOD_S), change)
    found = undriven(estimator, change - np.gradient(angle, PERIOD_S), PERIOD_S)
    assert np.abs(found - change)[260:-5].max() < 0.02


@pytest.mark.parametrize("estimator", [replace(SLOW, time_constant_s=tau) for tau in (FASTEST_S, SLOWEST_S)])
@pytest.mark.parametrize("channel", GYROS)
def test_the_residual_of_a_following_attitude_is_what_the_bank_makes_of_the_bent_record(channel, estimator):
    rows, fault = range(2500, 3500), gb.Bias(channel=channel, onset_s=2500 * PERIOD_S, size=0.5)
    following = Followed(monitor(), healthy(), channel, rows, estimator)
    was, reads = fault.onwards(healthy(), rows.stop)
    change = following.change(reads - was)
    bent = gb.inject(healthy(), fault, attitude=estimator)
    both = [residuals_of(monitor().bank, each, monitor().operators).raw[channel] for each in (healthy(), bent)]
    known = slice(following.begin, rows.stop - 20)  # the last rows look ahead
    exact = (both[1] - both[0])[known]
    assert np.abs(change[: len(exact)] - exact).max() < 0.01
    assert np.abs(exact).max() > 0.2


@cache
def watched():
    return monitor().watch(healthy(seed=32))


@cache
def certificate():
    return certificate_of(monitor(), [watched()])


@pytest.mark.nightly
def test_a_certificate_puts_its_faults_through_the_estimator_and_tells_the_worse():
    alone = certificate_of(replace(monitor(), bank=replace(monitor().bank, attitude_from_gyros=False)), [watched()])
    assert all(row.time_constant_s in (FASTEST_S, SLOWEST_S) for row in certificate().rows)
    assert all(row.time_constant_s is None for row in alone.rows)
    for row in certificate().rows:
        size, other = row.size or np.inf, alone.of(row.sensor, row.kind).size
        assert size > 1.2 * other  # an attitude that follows hides some of a fault
    assert "taken to follow" in certificate_lines(certificate())[-1]
    assert "taken to follow" not in " ".join(certificate_lines(alone))


@pytest.mark.parametrize("time_constant_s", by_day([SLOWEST_S, FASTEST_S], 0))
@pytest.mark.parametrize("sensor", by_day(GYROS))
def test_a_fault_that_the_attitude_follows_alarms_by_superposition_where_the_bent_record_does(sensor, time_constant_s):
    draw, said, alarmed = np.random.default_rng(3), [], []
    on = watched().monitor.superposition(watched(), sensor)
    estimator = replace(SLOW, time_constant_s=time_constant_s)
    for kind in kinds():
        size = certificate().of(sensor, kind.fault.kind).size
        for times in (0.1, 1.0, 2.0) if size is not None else ():
            onset_s = float(draw.uniform(50.0, 75.0))
            fault = kind.at(sensor, onset_s, times * size, is_turned=bool(draw.integers(2)))
            row = replace(on, estimator=estimator).alarm_row(fault, kind.within_s)
            bent = estimator.bent(watched().record, gb.inject(watched().record, fault))
            crossings = [each for each in bank_alarms(monitor(), bent) if each.output == sensor]
            said.append(row is not None)
            alarmed.append(any(onset_s <= each.time_s <= onset_s + kind.within_s + 1e-6 for each in crossings))
    differing = sum(one != other for one, other in zip(said, alarmed, strict=True))
    assert differing <= 1  # linear, about what was read
    assert 0 < sum(said) < len(said)


@pytest.mark.parametrize("estimator", by_day([replace(SLOW, time_constant_s=1.5), LEARNING]), ids=["1.5 s", "learns"])
@pytest.mark.parametrize("kind", by_day(["bias", "jam", "scale_factor"]))
@pytest.mark.parametrize("channel", by_day(GYROS))
def test_a_gyro_that_bends_the_attitude_is_named_or_suspected_and_no_other_is(channel, kind, estimator):
    record = gb.inject(healthy(estimator), FAULTS[kind](channel), attitude=estimator)
    alarms = [alarm for alarm in monitor().watch(record).faults if not alarm.has_passed]
    assert alarms
    assert {alarm.sensor for alarm in alarms} <= {channel, None}
    assert all(channel in alarm.candidates for alarm in alarms)


@pytest.mark.parametrize("counts_deg", by_day([0.0, 0.3]))
@pytest.mark.parametrize("factor", by_day([-1.0, 0.7, 1.5]))
@pytest.mark.parametrize("channel", by_day(ATTITUDE))
def test_an_angle_of_another_gain_or_sign_has_no_gyro_named(channel, factor, counts_deg):
    record = healthy()
    read = record[channel] * np.where(record.time_s < ONSET_S, 1.0, factor)
    read = np.round(read / counts_deg) * counts_deg if counts_deg else read
    for alarm in monitor().watch(record.replace(channel, read)).alarms:
        assert alarm.sensor not in GYROS


@pytest.mark.nightly
def test_most_of_them_are_named_none_wrongly_and_their_kinds_are_right():
    named = right = 0
    for kind, channel in ((kind, channel) for kind in FAULTS for channel in GYROS):
        record = gb.inject(healthy(), FAULTS[kind](channel), attitude=SLOW)
        alarms = [alarm for alarm in monitor().watch(record).faults if not alarm.has_passed]
        assert {alarm.sensor for alarm in alarms} <= {channel, None}
        named += alarms[0].sensor == channel
        right += alarms[0].last is not None and alarms[0].last.kind in (kind, "stuck" if kind == "jam" else kind)
    assert named >= 13
    assert right >= 11


@pytest.mark.nightly
def test_a_gain_and_a_time_constant_are_told_apart_though_the_onset_is_known_roughly():
    record = gb.inject(healthy(), FAULTS["scale_factor"]("p"), attitude=SLOW)
    alarm = next(alarm for alarm in monitor().watch(record).faults if alarm.last is not None)
    assert alarm.last.kind == "scale_factor"
    assert abs(alarm.last.parameters["factor"] - 0.6) < 0.03


@pytest.mark.parametrize("window", [1, 5, 21])
def test_noise_alone_makes_no_gain_of_a_driving_gyro_likely(window):
    """What is left of white noise once 1 - w H of it stays, over its density: a likelihood is largest at the truth."""
    rows, passed = 400, np.ones(1) if window == 1 else savgol_filter(np.eye(window)[window // 2], window, 3)
    smoothing = np.abs(np.fft.rfft(passed, 4096))
    fitter = object.__new__(Fitter)
    case = SimpleNamespace(smoothing=smoothing)
    there = np.full((1, rows), True)
    fitter.suspect = SimpleNamespace(channel="r", case=case, outputs=("r",), there=there, bend=SLOW)
    weights = np.array([-3.0, -0.5, 0.2, 0.5, 0.9, 1.9, 0.0])
    for weight, volume in zip(weights, fitter.volumes(weights), strict=True):
        left = rows * np.mean(np.square(1.0 - weight * smoothing))
        assert left - volume > rows or weight == volume == 0.0


def test_an_attitude_without_a_heading_is_bent_all_the_same():
    without = healthy().select([*GYROS, "phi", "theta"])
    fault = FAULTS["bias"]("q")
    bent = SLOW.bent(without, gb.inject(without, fault))
    whole = gb.inject(healthy(), fault, attitude=SLOW)
    assert np.abs(bent.matrix(["phi", "theta"]) - whole.matrix(["phi", "theta"])).max() < 1e-9
    with pytest.raises(gb.InputError, match=r"psi isn't there"):
        gb.inject(without, fault, attitude=SLOW)


def test_beyond_euler_angles_nothing_is_bent():
    level = gb.Record(np.zeros((5000, 6)), channels=[*GYROS, *ATTITUDE], sample_period_s=PERIOD_S)
    with pytest.raises(gb.InputError, match=r"theta reaches 85.* Euler angles end"):
        gb.inject(level, gb.Bias(channel="q", onset_s=ONSET_S, size=40.0), attitude=SLOW)

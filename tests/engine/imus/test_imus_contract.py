"""Several IMUs on the engine: who parts is named or suspected, never a healthy one; a mounting is told, not accused."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.imus.beside import with_imus
from gtmbench.engine.imus.imu import gyro_of
from gtmbench.engine.judged import judged
from gtmbench.engine.samples import Samples, flight_of
from gtmbench.log.judging.imus import imu_claims
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.timeline import State
from tests.helpers.autopilot_logs import STEP, imus
from tests.helpers.night import by_day

ONSET_S = 80.0
FAST = 4  # steps of 10 ms: gyros that are slower tell no factor
QUARTER = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])


def flown(records, turned=None, late_s=0.0, is_driven=True):
    """Return the flight of the first IMU, with the others beside it."""
    first, *others = records
    own = {name: Samples(first.time_s, first[name]) for name in (*GYROS, *ATTITUDE)}
    beside = {}
    for number, record in enumerate(others, 2):
        gyros = record.matrix(GYROS) @ (np.eye(3) if turned is None else turned)
        beside[f"IMU{number}"] = [Samples(record.time_s + late_s, column) for column in gyros.T]
    return with_imus(flight_of(own, is_driven=is_driven), beside)


def said(*faults, count=2, seed=1, driver=0, step=STEP, **how):
    return judged(flown(imus(count, faults=faults, seed=seed, driver=driver, step=step), **how))


def accused(found):
    """Return who failed, and who may have."""
    failed = {sensor for sensor, span in found.accused if span.state is State.FAILED}
    return failed, {sensor for sensor, span in found.accused if span.state is State.SUSPECTED}


def name_of(channel, number):
    return gyro_of(channel, f"IMU{number + 1}") if number else channel


@pytest.mark.parametrize("seed", by_day([1, 2, 3]))
@pytest.mark.parametrize("count", by_day([2, 3]))
def test_healthy_imus_accuse_nobody_and_are_clear(count, seed):
    found = said(count=count, seed=seed)
    assert accused(found) == (set(), set())
    told = imu_claims(found, ())
    assert told.lines == ()
    names = {gyro_of(gyro, f"IMU{number}") for gyro in GYROS for number in range(2, count + 1)}
    assert {sensor for sensor, span in told.claims if span.state is State.CLEAR} == names


@pytest.mark.parametrize("driver", by_day([0, 1]))
@pytest.mark.parametrize("liar", by_day([0, 1]))
@pytest.mark.parametrize("channel", by_day(GYROS))
@pytest.mark.parametrize("size", by_day([2.0, -10.0]))
def test_of_two_the_liar_is_named_or_suspected_whoever_drives_the_estimator(channel, liar, driver, size):
    found = said((liar, gb.Bias(channel=channel, onset_s=ONSET_S, size=size)), driver=driver)
    failed, suspected = accused(found)
    own = name_of(channel, liar)
    assert own in failed | suspected
    assert failed <= {own}
    assert suspected <= {name_of(channel, 0), name_of(channel, 1), "psi", *ATTITUDE}


@pytest.mark.parametrize(
    ("liar", "fault"),
    by_day(
        [
            (1, gb.SignFlip(channel="p", onset_s=ONSET_S)),  # bends the attitude, which shows about the other axes
            (1, gb.ScaleFactor(channel="q", onset_s=ONSET_S, factor=0.4)),  # bends it hardly, as gains do
            (0, gb.Bias(channel="p", onset_s=ONSET_S, size=-20.0)),  # turns it round and round: it agrees with its gyro
        ]
    ),
    ids=str,
)
def test_an_attitude_that_the_broken_one_of_two_bends_is_no_witness_of_the_healthy_one(liar, fault):
    failed, suspected = accused(said((liar, fault), driver=liar, step=FAST, seed=2))
    own = name_of(fault.channel, liar)
    assert failed <= {own}
    assert own in failed | suspected


def test_an_attitude_that_the_healthy_one_of_two_drives_names_the_other():
    fault = gb.SignFlip(channel="p", onset_s=ONSET_S)
    assert accused(said((0, fault), driver=1, step=FAST)) == ({"p"}, set())


FAULTS = {
    "bias": lambda channel: gb.Bias(channel=channel, onset_s=ONSET_S, size=1.0),
    "drift": lambda channel: gb.Drift(channel=channel, onset_s=ONSET_S, slope=0.1),
    "sign": lambda channel: gb.SignFlip(channel=channel, onset_s=ONSET_S),
    "scale": lambda channel: gb.ScaleFactor(channel=channel, onset_s=ONSET_S, factor=1.6),
    "stuck": lambda channel: gb.Jam(channel=channel, onset_s=ONSET_S),
    "noise": lambda channel: gb.Noise(channel=channel, onset_s=ONSET_S, deviation=5.0),
}


@pytest.mark.parametrize("liar", by_day([0, 2]))
@pytest.mark.parametrize("kind", by_day(FAULTS))
@pytest.mark.parametrize("channel", by_day(["p", "r"]))
def test_of_three_the_one_that_parts_from_both_is_named(channel, kind, liar):
    failed, suspected = accused(said((liar, FAULTS[kind](channel)), count=3, step=FAST))
    assert failed == {name_of(channel, liar)}
    assert suspected == set()


@pytest.mark.nightly
def test_of_three_of_which_two_fail_no_healthy_one_is_named():
    both = [(number, gb.Bias(channel="p", onset_s=ONSET_S, size=size)) for number, size in ((0, 2.0), (1, -2.0))]
    failed, suspected = accused(said(*both, count=3))
    assert failed | suspected
    assert failed <= {"p", gyro_of("p", "IMU2")}


@pytest.mark.parametrize("turned", by_day([QUARTER, QUARTER @ QUARTER, QUARTER[[2, 0, 1]]], 0))
def test_one_that_is_mounted_turned_along_the_axes_is_told_and_judged_by_its_own_names(turned):
    assert accused(said(turned=turned)) == (set(), set())
    found = said((1, gb.Bias(channel="q", onset_s=ONSET_S, size=3.0)), count=2, turned=turned)
    column = int(np.argmax(np.abs(turned[1])))  # of the IMU, which reads the aircraft's q
    own, sign = gyro_of(GYROS[column], "IMU2"), turned[1, column]
    told = imu_claims(found, found.accused)
    (line,) = [line for line in told.lines if "mounted" in line]
    assert line.startswith("IMU2 is mounted turned by ")
    failed, suspected = accused(found)
    assert own in failed | suspected
    assert failed <= {own}
    for alarm in found.alarms:
        assert own in alarm.candidates
    for name, span in found.accused:
        if name == own and span.state is State.FAILED and span.judgement.kind == "bias":
            assert np.sign(span.judgement.parameters["size"]) == sign
    clear = {name for name, span in told.claims if span.state is State.CLEAR and span.end_s > ONSET_S + 10.0}
    assert own not in clear
    assert clear


def test_one_that_is_mounted_askew_is_told_and_not_judged():
    half = np.sqrt(0.5)
    found = said(
        (1, gb.Bias(channel="q", onset_s=ONSET_S, size=3.0)),
        turned=np.array([[half, -half, 0.0], [half, half, 0.0], [0.0, 0.0, 1.0]]),
    )
    told = imu_claims(found, found.accused)
    assert any(line.startswith("IMU2 is mounted turned by 45 deg") for line in told.lines)
    assert accused(found) == (set(), set())
    assert {span.state for _, span in told.claims} == {State.NOT_JUDGED}


@pytest.mark.nightly
@pytest.mark.parametrize("factor", by_day([0.95, 1.03]))
def test_a_scale_that_lasts_is_told_and_accuses_nobody(factor):
    found = said(turned=factor * np.eye(3))
    assert accused(found) == (set(), set())
    more = "more" if factor > 1.0 else "less"
    lines = [line for line in imu_claims(found, found.accused).lines if f"% {more} of each turn" in line]
    assert len(lines) == 3
    assert not [line for line in imu_claims(said(), ()).lines if "of each turn" in line or " ms " in line]


def test_one_whose_axis_has_the_wrong_sign_is_told_and_not_judged():
    found = said(turned=np.diag([1.0, 1.0, -1.0]))
    told = imu_claims(found, found.accused)
    assert any("no mounting does" in line for line in told.lines)
    assert {span.state for _, span in told.claims} == {State.NOT_JUDGED}


@pytest.mark.nightly
def test_one_that_is_late_and_scaled_is_judged_none_the_worse():
    assert accused(said(late_s=0.01, turned=1.02 * np.eye(3))) == (set(), set())
    late = said((1, gb.Bias(channel="p", onset_s=ONSET_S, size=2.0)), late_s=0.01, turned=1.02 * np.eye(3))
    assert accused(late)[0] <= {gyro_of("p", "IMU2")}
    assert gyro_of("p", "IMU2") in set().union(*accused(late))


@pytest.mark.parametrize(("size", "is_told"), by_day([(8.0, True), (0.4, False)]))
def test_imus_that_part_by_more_than_their_motion_makes_need_no_such_motion_elsewhere(size, is_told):
    """The aircraft turns for some seconds behind the onset alone; a small difference may be that motion's."""
    records = imus(3, driver=0)
    calm = [_calmed(each) for each in records]
    calm[2] = gb.inject(calm[2], gb.Bias(channel="q", onset_s=ONSET_S, size=size))
    failed, _ = accused(judged(flown(calm)))
    assert failed == ({gyro_of("q", "IMU3")} if is_told else set())


def _calmed(record):
    """Return a record that hardly turns but for some seconds."""
    still, time_s = record.values.copy(), record.time_s
    still[(time_s < ONSET_S) | (time_s > ONSET_S + 7.0)] *= 0.02
    return gb.Record(still, channels=record.channels, sample_period_s=record.sample_period_s, start_s=record.start_s)

"""Early residuals: a pseudo output from the gyro, without look-ahead; they raise alarms, others diagnose."""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.bank import bank_of, bank_table, load_bank
from gtmbench.detectors.bank.calibrated import bank_residuals, residuals_of
from gtmbench.detectors.bank.calibration import identified
from gtmbench.detectors.monitor.scores import bank_alarms
from gtmbench.errors import InputError
from tests.helpers.monitors import monitor, record, streamed, truth
from tests.helpers.night import by_day

PERIOD_S = 0.02
ANGLES = ("phi", "theta", "psi")
EARLY = {"p_att": "p", "q_att": "q", "r_att": "r"}


def late(given, rows):
    """Return a record whose attitude comes so many samples late; the first rows are left out."""
    values = np.array(given.values[rows:])
    for name in ANGLES:
        values[:, given.channels.index(name)] = given[name][: len(given) - rows]
    return gb.Record(values, channels=given.channels, sample_period_s=given.sample_period_s)


@cache
def monitor_of_late(rows):
    return gb.calibrate([late(record(seed=seed), rows) for seed in range(1, 4)], bank=load_bank("C-early"))


def specs():
    return {spec.output: spec for spec in load_bank("C-early").residuals if spec.is_early}


@pytest.mark.parametrize("rows", range(5))
@pytest.mark.parametrize("output", EARLY)
def test_of_an_attitude_that_is_late_and_else_exact_the_lag_is_identified_and_nothing_is_left(output, rows):
    given = late(truth(4000), rows)
    operator, _ = identified([given], specs()[output], gb.LeastSquares())
    wanted = np.zeros(operator.causal_order + operator.noncausal_order + 1)
    wanted[operator.noncausal_order + rows] = 1.0
    left = residuals_of(load_bank("C-early"), given, {output: operator}, [output]).raw[output]
    # about its mean: those of a record's ends are in the offset
    assert np.nanstd(left) < 1e-4 * np.abs(given[EARLY[output]]).max()
    assert np.isfinite(left).sum() == len(given) - 1 - max(operator.causal_order, 1)
    # a slow motion leaves single parameters open, what they add up to and mean in time not
    lags = np.arange(len(wanted))
    np.testing.assert_allclose(operator.markov.sum(), 1.0, atol=1e-4)
    np.testing.assert_allclose(operator.markov[:, 0, 0] @ lags, wanted @ lags, atol=0.05)


@pytest.mark.parametrize("seed", range(5))
def test_an_early_residual_stands_on_nothing_after_its_look_ahead_of_one_sample(seed):
    used, given = monitor("C-early"), record(1500, seed=seed)
    random = np.random.default_rng(seed)
    row = int(random.integers(100, 1400))
    other = np.array(given.values)
    other[row:] += 100.0 * random.standard_normal(other[row:].shape)
    changed = gb.Record(other, channels=given.channels, sample_period_s=PERIOD_S)
    before, after = (bank_residuals(used, each).raw for each in (given, changed))
    for output in EARLY:
        ahead = round(used.look_ahead_of(output) / PERIOD_S)
        assert ahead == 1
        np.testing.assert_array_equal(before[output][: row - ahead], after[output][: row - ahead])
        assert before[output][row] != after[output][row]


@pytest.mark.nightly
def test_a_derivative_and_the_gyros_look_ahead_are_waited_for_at_once():
    table = bank_table(load_bank("C-early"))
    for block in table["residuals"]:
        if block["output"] in EARLY:
            block["look_ahead_s"] = 3 * PERIOD_S
    used = gb.calibrate([record(seed=seed) for seed in (1, 2, 3)], bank=bank_of("mine", table))
    assert {output: round(used.look_ahead_of(output) / PERIOD_S) for output in EARLY} == dict.fromkeys(EARLY, 3)
    broken = gb.inject(record(3000, seed=4), gb.Jam(channel="q", onset_s=40))
    assert streamed(used, broken, 1).alarms == used.watch(broken).alarms  # single samples have a path of their own


@pytest.mark.parametrize(
    "fault",
    by_day(
        [
            gb.Jam(channel="p", onset_s=40),
            gb.Bias(channel="q", onset_s=40, size=3),
            gb.SignFlip(channel="r", onset_s=40),
            gb.Bias(channel="phi", onset_s=40, size=1),
            gb.Stuck(channel="psi", onset_s=40, value=0.0),
        ]
    ),
    ids=lambda fault: f"{fault.kind} of {fault.channel}",
)
def test_the_first_alarm_comes_no_later_and_the_diagnosis_says_the_same(fault):
    broken = gb.inject(record(5000, seed=9), fault)
    plain, early = (monitor(bank).watch(broken) for bank in ("C", "C-early"))
    assert early.alarms[0].time_s <= plain.alarms[0].time_s
    assert early.alarms[0].time_s < fault.onset_s + 1.0
    said, before = early.faults[0].last, plain.faults[0].last
    assert (said.sensor, said.candidates, said.kind) == (before.sensor, before.candidates, before.kind)
    assert len(early.faults) == len(plain.faults)


@pytest.mark.parametrize("rows", by_day([0, 3]))
def test_healthy_records_raise_no_alarm_however_late_the_attitude(rows):
    for seed in range(20, 24):
        assert not bank_alarms(monitor_of_late(rows), late(record(seed=seed), rows))


@pytest.mark.parametrize("channel", by_day("pqr"))
def test_a_gyro_that_fails_is_found_though_the_attitude_is_late(channel):
    broken = gb.inject(late(record(5000, seed=9), 3), gb.Jam(channel=channel, onset_s=40))
    alarms = monitor_of_late(3).watch(broken).alarms
    assert 40.0 <= alarms[0].time_s < 41.0
    assert alarms[0].sensor == channel


def test_its_alarms_disarm_the_sensors_own_residual_too_so_that_one_fault_is_one_alarm():
    broken = gb.inject(record(5000, seed=9), gb.Jam(channel="p", onset_s=40))
    watch = monitor("C-early").watch(broken)
    (alarm,) = watch.alarms
    assert alarm.source == "p_att"
    assert alarm.candidates == ("p",)
    scores = watch.scores
    assert scores["p"].disarmed_s == scores["p_att"].disarmed_s == pytest.approx(alarm.time_s)
    assert not {"q", "r", "q_att", "r_att"} & set(watch.disarmed)


def test_an_early_residual_adds_no_channel_no_suspect_and_nothing_to_a_diagnosis():
    plain, early = load_bank("C"), load_bank("C-early")
    assert early.channels == plain.channels
    assert early.suspects == plain.suspects
    assert early.diagnostic == plain.residuals
    assert all(early.affects(name) == plain.affects(name) for name in plain.channels)


@pytest.mark.parametrize(
    ("blocks", "said"),
    [
        ([{"output": "p_att", "inputs": ["p"]}], "'p_att' isn't a sensor; give a measured channel, or beside it"),
        (
            [{"output": "p", "inputs": ["p_att"]}, {"output": "phi_rate", "inputs": ["p"]}],
            "table 2: output 'phi_rate' isn't a sensor",
        ),
        (
            [{"output": "p", "inputs": ["p_att"]}, {"output": "p_att", "inputs": ["p", "theta"]}],
            "'theta' holds 'theta' itself; it would predict itself",
        ),
        (
            [{"output": "p", "inputs": ["p_turn"]}, {"output": "p_att", "inputs": ["p"]}],
            "'p_att' alarms for faults of psi, which don't enter the residual of p",
        ),
        (
            [{"output": "q", "inputs": ["q_att"]}, {"output": "q_att", "inputs": ["q", "p_att"]}],
            "'p_att' holds 'phi' itself; it would predict itself",
        ),
    ],
)
def test_what_cannot_be_diagnosed_or_predicts_itself_is_refused(blocks, said):
    with pytest.raises(InputError, match=said):
        bank_of("mine", {"residuals": blocks})

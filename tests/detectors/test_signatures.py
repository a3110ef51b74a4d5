"""Signatures are worked out, not listed: the matrix against faults that are injected, the words against the bank."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.bank.bank import bank_of
from gtmbench.detectors.bank.calibrated import bank_residuals
from gtmbench.detectors.bank.detectability import slowest_drift, tolerated_shift
from gtmbench.detectors.statistics.whitening import White
from gtmbench.files.shipped import shipped_banks
from tests.helpers.monitors import monitor, record

BANKS = tuple(shipped_banks())


def bank(*residuals, **more):
    """Return a bank of (output, inputs) pairs."""
    blocks = [{"output": output, "inputs": list(inputs)} for output, *inputs in residuals]
    return bank_of("mine", {"residuals": blocks, **more})


def said(signatures, *words):
    """Return the blind spots that hold all the words."""
    return [line for line in signatures.blind_spots if all(word in line for word in words)]


@pytest.mark.parametrize("name", BANKS)
def test_the_pattern_is_what_injected_errors_do(name):
    signatures = gb.signatures(monitor(name))
    healthy = record(1500, seed=5)
    before = bank_residuals(monitor(name), healthy).raw
    ramp = np.linspace(0.0, 30.0, len(healthy))
    for channel in signatures.channels:
        for kind, error in (("level", np.full(len(healthy), 3.0)), ("slope", ramp)):
            after = bank_residuals(monitor(name), healthy.replace(channel, healthy[channel] + error)).raw
            for output, entry in zip(signatures.outputs, signatures.pattern[channel], strict=True):
                moved = np.nanmax(np.abs(after[output] - before[output])) > 1e-6
                assert moved == (entry != "" and not (kind == "level" and entry == "slope")), (channel, output, kind)


def test_bank_c_puts_one_gyro_into_every_residual():
    signatures = gb.signatures(gb.load_bank("C"))
    gyros = [[bool(entry) for entry in signatures.pattern[name]] for name in "pqr"]
    assert gyros == np.eye(3, dtype=bool).tolist()
    assert said(signatures, "phi, psi and theta enter the same residuals (p, q, r)")
    assert said(signatures, "Of psi only changes enter")
    assert not said(signatures, "Nothing predicts")


def test_the_table_is_the_matrix():
    table = gb.signatures(monitor("paper"), record(3000)).table()
    assert list(table.index) == ["r", "beta", "p", "q"]
    assert list(table.columns) == ["r", "jam in r"]
    assert (table["r"] == "level").all()


def test_strengths_are_the_jams_done_by_hand():
    healthy = record(3000, seed=4)
    signatures = gb.signatures(monitor("C"), healthy)
    half = len(healthy) // 2
    jammed = healthy.replace("psi", np.where(np.arange(len(healthy)) < half, healthy["psi"], healthy["psi"][half]))

    def rms(of):
        white = monitor("C").whiteners["r"].whiten(bank_residuals(monitor("C"), of).raw["r"])[half:]
        return np.sqrt(np.nanmean(white**2))

    assert signatures.strength[signatures.channels.index("psi"), 2] == pytest.approx(
        rms(jammed) / rms(healthy), rel=1e-12
    )


def test_strengths_are_one_where_nothing_enters_and_more_where_a_gyro_is_predicted():
    signatures = gb.signatures(monitor("C"), record(3000))
    for i, channel in enumerate(signatures.channels):
        for j, entry in enumerate(signatures.pattern[channel]):
            assert signatures.strength[i, j] > 0.0 if entry else signatures.strength[i, j] == 1.0
    assert (np.diag(signatures.strength[:3]) > 3.0).all()


def test_missing_samples_and_short_records_are_told():
    gappy = record(3000).replace("p", np.where(np.arange(3000) % 500, record(3000)["p"], np.nan))
    assert np.isfinite(gb.signatures(monitor("C"), gappy).strength).all()
    with pytest.raises(gb.InputError, match="second half leaves no residual of 'p'"):
        gb.signatures(monitor("C"), record(20))
    with pytest.raises(gb.InputError, match="strengths are measured with a monitor"):
        gb.signatures(gb.load_bank("C"), record(20))
    with pytest.raises(gb.InputError, match="a str has no signatures"):
        gb.signatures("C")


def test_what_nothing_predicts_is_said_of_any_bank():
    mine = bank(("r", "r_lat", "beta"), suspects=["r", "beta", "phi"])
    signatures = gb.signatures(mine)
    assert said(signatures, "Nothing predicts phi or beta") or said(signatures, "Nothing predicts beta or phi")
    assert said(signatures, "alpha, ny, tas and theta are no suspects", "rises in r")
    whole = gb.signatures(bank(("p", "p_att"), ("q", "q_att"), ("r", "r_att"), suspects=["p", "phi"]))
    assert not said(whole, "Nothing predicts")


def test_a_pattern_within_another_is_said():
    signatures = gb.signatures(bank(("p", "p_turn"), ("q", "q_turn"), suspects=["p", "q", "phi"]))
    assert said(signatures, "Until a fault of", "has risen in all of p and q, it looks like one of p or q")


@pytest.mark.parametrize(("statistic", "ignores"), [("glr", True), ("cusum", True), ("energy", False)])
def test_a_bias_since_turn_on_is_ignored_by_tests_with_a_baseline(statistic, ignores):
    signatures = gb.signatures(bank(("r", "p"), alarm={"statistic": statistic, "baseline_s": 90.0}))
    assert bool(said(signatures, "since turn-on", "90 s")) == ignores
    assert bool(said(signatures, "In the first 15 s")) == ignores


def test_a_channel_that_enters_by_its_derivative_alone_is_found():
    signatures = gb.signatures(bank(("r", "beta_rate", "p")))
    assert signatures.pattern == {"r": ("level",), "beta": ("slope",), "p": ("level",)}
    assert said(signatures, "Of beta only changes enter")


@pytest.mark.parametrize("output", ["p", "q", "r"])
def test_the_slowest_drift_is_where_a_noiseless_ramp_begins_to_cross(output):
    used = monitor("C")
    test, period_s = used.bank.statistic, used.sample_period_s
    slope = slowest_drift(used, output)
    time_s = np.arange(round((test.baseline_s + 60.0) / period_s)) * period_s

    def crosses(times):
        white = used.whiteners[output].whiten(times * slope * time_s)
        series = test.scores(white, White.steady(white), period_s, used.tolerances[output])
        means = [score for score in series if score.label.startswith("mean")]
        return any(np.nanmax(score.values) > used.thresholds[output][score.label] for score in means)

    assert not crosses(0.98)
    assert crosses(1.02)
    assert said(gb.signatures(used), f"{output} {slope:.2g} deg/s per s")


def test_the_tolerated_shift_is_in_the_sensors_unit():
    used = monitor("C")
    shift = tolerated_shift(used, "q")
    white = used.whiteners["q"].whiten(np.full(500, shift)) - used.whiteners["q"].whiten(np.zeros(500))
    assert white[-1] == pytest.approx(used.tolerances["q"].mean, abs=1e-12)


def test_windows_that_no_record_filled_are_told():
    few = gb.calibrate(record(1000), bank=gb.load_bank("C"))  # 20 s; the longest window holds 20.48
    never = [label for label, value in few.thresholds["p"].items() if np.isinf(value)]
    signatures = gb.signatures(few)
    assert never
    assert said(signatures, "too short for some tests")
    assert all(said(signatures, label) for label in never)

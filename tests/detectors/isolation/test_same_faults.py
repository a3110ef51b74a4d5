"""Faults that are physically the same: bank C's residuals hardly tell them apart while wings are level."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.isolation.diagnosis import SAME
from gtmbench.method.pseudo_inputs import derive

TS, ONSET_S = 0.01, 5.0
OMEGA = 2.0 * np.pi * 0.2


def rates_of(record):
    """The rates that an attitude gives, as bank C has them."""
    derived = derive(record, ["p_att", "q_att", "r_att"])
    return np.column_stack([derived[name] for name in ("p_att", "q_att", "r_att")])


def motion(bank_deg):
    """A gentle motion about a bank angle, with the rates that belong to it."""
    t = np.arange(0.0, 20.0, TS)
    angles = [bank_deg + 3.0 * np.sin(0.5 * t), 2.0 + 2.0 * np.cos(0.3 * t), 10.0 + np.sin(0.2 * t)]
    attitude = gb.Record(np.column_stack(angles), channels=["phi", "theta", "psi"], sample_period_s=TS)
    rates = rates_of(attitude)
    return gb.Record(
        np.column_stack([rates, *angles]), channels=["p", "q", "r", *attitude.channels], sample_period_s=TS
    )


def shown(record, fault):
    """What a fault adds to gyros less the attitude's rates, in deg/s, once it is there and away from the ends."""
    broken = gb.inject(record, fault)
    return (broken.values[:, :3] - rates_of(broken))[int(ONSET_S / TS) + 2 : -2]


# by the pair of kinds: the gyro's fault, and the angle's with the size that follows from it
PAIRS = {
    ("bias", "drift"): (
        gb.Bias(channel="r", onset_s=ONSET_S, size=0.5),
        gb.Drift(channel="psi", onset_s=ONSET_S, slope=-0.5),
    ),
    ("bias", "thermal_bias"): (  # which has hardly begun to settle
        gb.Bias(channel="r", onset_s=ONSET_S, size=0.5),
        gb.ThermalBias(channel="psi", onset_s=ONSET_S, size=-500.0, warming_s=1000.0),
    ),
    ("thermal_bias", "drift"): (  # which has settled
        gb.ThermalBias(channel="r", onset_s=ONSET_S, size=0.5, warming_s=0.005),
        gb.Drift(channel="psi", onset_s=ONSET_S, slope=-0.5),
    ),
    ("thermal_bias", "thermal_bias"): (
        gb.ThermalBias(channel="r", onset_s=ONSET_S, size=0.5, warming_s=0.005),
        gb.ThermalBias(channel="psi", onset_s=ONSET_S, size=-500.0, warming_s=1000.0),
    ),
    ("oscillation", "oscillation"): (
        gb.Oscillation(channel="p", onset_s=ONSET_S, amplitude=2.0 * OMEGA, frequency_hz=0.2, phase_deg=-90.0),
        gb.Oscillation(channel="phi", onset_s=ONSET_S, amplitude=2.0, frequency_hz=0.2),
    ),
}


def apart(record, pair):
    """How far two faults are from showing the same, as a share of what they show."""
    of_gyro, of_angle = (shown(record, fault) for fault in PAIRS[pair])
    return np.abs(of_gyro - of_angle).max() / np.abs(of_gyro).max()


@pytest.mark.parametrize("pair", sorted(SAME))
def test_they_show_the_same_near_wings_level(pair):
    assert apart(motion(0.0), pair) < np.sin(np.deg2rad(5.0))  # what attitudes of up to 5 deg leave


def test_a_bank_tells_a_bias_of_r_from_a_drift_of_psi():
    assert apart(motion(45.0), ("bias", "drift")) > 0.5

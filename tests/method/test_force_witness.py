"""Accelerometers between a gyro and its angle: they measure errors of p and q, with a GPS of r; healthy ones stay."""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.gps import Gps, with_gps
from gtmbench.errors import InputError
from gtmbench.method.force_witness import ForceWitness
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import ACCELEROMETERS, ATTITUDE, GPS_VELOCITY, GYROS

HEALTHY, ONSET_S, END_S = (0.0, 75.0), 80.0, 120.0


@cache
def flight(seed=1, *, gps=True):
    """Return a flight's readings at 10 Hz, with T2's noise."""
    truth = fly_once(duration_s=125.0, excitation="multisine+turbulence", seed=740_000 + seed)
    sensed = with_gps(gb.measure(truth, noise="t2", seed=seed), truth, Gps(rate_hz=5.0, delay_s=0.15), seed=seed)
    channels = (*GYROS, *ATTITUDE, *ACCELEROMETERS, *(GPS_VELOCITY if gps else ()))
    return gb.Record(sensed.matrix(channels)[::10], channels=channels, sample_period_s=0.1)


@cache
def witness(seed=1, *, gps=True):
    return ForceWitness(healthy=(flight(seed, gps=gps).between(*HEALTHY),))


def opinion(fault, gyro, claimed, seed=1, *, gps=True):
    broken = flight(seed, gps=gps) if fault is None else gb.inject(flight(seed, gps=gps), fault)
    return witness(seed, gps=gps).judge(broken, ONSET_S, END_S, gyro=gyro, error_deg_s=claimed)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("gyro", GYROS)
@pytest.mark.parametrize("size", [2.0, -5.0])
def test_an_error_of_a_gyro_is_measured_and_named_with_a_gps(seed, gyro, size):
    size *= 1.5 if gyro == "r" else 1.0  # which is accused by twice the bound
    told = opinion(gb.Bias(channel=gyro, onset_s=ONSET_S, size=size), gyro, 0.7 * size, seed)
    assert told.error_deg_s == pytest.approx(size, abs=told.bound_deg_s)
    assert told.sensor == gyro
    assert f"{gyro} reads {size:+.1g}"[:9] in told.reason


@pytest.mark.parametrize("gyro", GYROS)
def test_a_drift_is_measured_by_its_mean(gyro):
    told = opinion(gb.Drift(channel=gyro, onset_s=ONSET_S, slope=0.15), gyro, 2.0)
    assert told.sensor == gyro
    assert told.error_deg_s == pytest.approx(3.0, abs=told.bound_deg_s)


@pytest.mark.parametrize("seed", [1, 2])
@pytest.mark.parametrize("gyro", GYROS)
@pytest.mark.parametrize("gps", [True, False])
def test_a_healthy_gyro_is_never_accused_whatever_its_angle_turns(seed, gyro, gps):
    for claimed in (-20.0, -2.0, -0.5, 0.5, 2.0, 20.0):
        told = opinion(None, gyro, claimed, seed, gps=gps)
        assert told.sensor is None
        if gps or gyro != "r":  # which nothing shows without one
            assert abs(told.error_deg_s) < told.bound_deg_s


@pytest.mark.parametrize(("gyro", "asked"), [("p", "q"), ("q", "p"), ("p", "r"), ("q", "r"), ("r", "p")])
def test_another_gyros_error_isnt_laid_on_the_one_that_is_asked_about(gyro, asked):
    fault = gb.Bias(channel=gyro, onset_s=ONSET_S, size=3.0)
    for claimed in (-3.0, 3.0):
        assert opinion(fault, asked, claimed).sensor is None


def test_without_a_gps_r_hardly_shows():
    fault = gb.Bias(channel="r", onset_s=ONSET_S, size=1.0)
    assert not witness(gps=False).has_gps
    assert opinion(fault, "r", 0.7, gps=False).sensor is None
    bounds, with_it = witness(gps=False).bounds_deg_s(30.0), witness().bounds_deg_s(30.0)
    assert bounds["r"] > 2.0 * with_it["r"]


ACCELEROMETER_FAULTS = [
    gb.Bias(channel="ny", onset_s=ONSET_S + 15.0, size=0.5),
    gb.Bias(channel="nx", onset_s=ONSET_S + 20.0, size=-0.3),
    gb.Bias(channel="nz", onset_s=ONSET_S + 20.0, size=-0.5),
    gb.Drift(channel="ny", onset_s=ONSET_S, slope=0.02),
    gb.Drift(channel="nx", onset_s=ONSET_S, slope=-0.03),
    gb.Jam(channel="nz", onset_s=ONSET_S),
    gb.Noise(channel="ny", onset_s=ONSET_S, deviation=0.5),
    gb.ScaleFactor(channel="nz", onset_s=ONSET_S, factor=0.5),
]


@pytest.mark.parametrize("gps", [True, False])
@pytest.mark.parametrize("fault", ACCELEROMETER_FAULTS, ids=lambda fault: f"{fault.kind} of {fault.channel}")
def test_a_broken_accelerometer_accuses_no_gyro_whatever_the_attitude_follows(fault, gps):
    broken = gb.inject(flight(gps=gps), fault)
    for gyro in GYROS:
        for claimed in (-2.0, -0.7, 0.7, 2.0):
            assert witness(gps=gps).judge(broken, ONSET_S, END_S, gyro=gyro, error_deg_s=claimed).sensor is None


def test_an_error_that_the_attitude_doesnt_show_likewise_stays_open():
    fault = gb.Bias(channel="p", onset_s=ONSET_S, size=3.0)
    for claimed in (-3.0, 20.0):
        told = opinion(fault, "p", claimed)
        assert (told.sensor, "by the attitude" in told.reason) == (None, True)


def test_gaps_and_short_stretches_stay_open():
    record = flight()
    lost = record.replace("nx", np.where(record.time_s > ONSET_S, np.nan, record["nx"]))
    assert "gaps" in witness().judge(lost, ONSET_S, END_S, gyro="p", error_deg_s=2.0).reason
    assert "too short" in witness().judge(record, ONSET_S, ONSET_S + 8.0, gyro="p", error_deg_s=2.0).reason
    little = ForceWitness(healthy=(record.between(0.0, 12.0),))
    assert "healthy stretches" in little.judge(record, ONSET_S, END_S, gyro="p", error_deg_s=2.0).reason
    assert np.isnan(little.bounds_deg_s(30.0)["p"])


def test_what_cannot_be_learnt_from_is_said():
    with pytest.raises(InputError, match="no healthy record"):
        ForceWitness(healthy=())
    with pytest.raises(InputError, match="nx"):
        ForceWitness(healthy=(flight().select((*GYROS, *ATTITUDE)),))

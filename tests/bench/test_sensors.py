"""Sensors: the noise has the size it is said to have, and every channel draws its own."""

import numpy as np
import pytest

from gtmbench.bench.sensors import measure
from gtmbench.errors import InputError
from gtmbench.values.channels import COMMANDS, SENSORS
from gtmbench.values.record import Record

# NASA's own figures: gtm_design/config/NoiseParams_T2.m of GTM_DesignSim (LAR-17625-1), its MIDG unit
T2 = {
    "p": 0.5350,
    "q": 0.4737,
    "r": 0.3397,
    "alpha": 0.031,
    "beta": 0.033,
    "phi": 0.02,
    "theta": 0.02,
    "psi": 0.02,
    "nx": 0.0012,
    "ny": 0.0022,
    "nz": 0.0068,
    "tas": 0.06,
    "altitude": 2.36,
}
BY_RATIO = ("p", "q", "r", "beta")
LARGE = 100_000  # a standard deviation is known to 0.22 %


def flight(channels, samples=1000, offset=0.0):
    """Return a truth in which channel i is a sinusoid of amplitude i + 1."""
    time_s = np.arange(samples) * 0.01
    waves = [(i + 1) * np.sin((1.0 + 0.1 * i) * time_s) for i in range(len(channels))]
    return Record(np.column_stack(waves) + offset, channels=channels, sample_period_s=0.01, start_s=5.0)


def noise(truth, **settings):
    measured = measure(truth, **settings)
    return {name: measured[name] - truth[name] for name in measured.channels}


@pytest.mark.parametrize("settings", [{"snr": 50}, {"noise": "t2"}], ids=str)
def test_adding_a_channel_changes_no_other(settings):
    all_of_them = flight(SENSORS)
    few = measure(all_of_them.select(["beta", "p"]), seed=4, **settings)
    many = measure(all_of_them, seed=4, **settings)
    np.testing.assert_array_equal(few["p"], many["p"])
    np.testing.assert_array_equal(few["beta"], many["beta"])


def test_snr_is_rms_about_the_mean_over_the_standard_deviation():
    truth = flight(BY_RATIO, LARGE, offset=30.0)
    for name, added in noise(truth, snr=50, seed=1).items():
        rms = np.sqrt(np.mean((truth[name] - truth[name].mean()) ** 2))
        assert rms / np.std(added) == pytest.approx(50.0, rel=0.01)


@pytest.mark.parametrize(("settings", "by_ratio"), [({"noise": "t2"}, ()), ({"snr": 50}, BY_RATIO)])
def test_noise_without_a_ratio_has_nasas_figures(settings, by_ratio):
    for name, added in noise(flight(SENSORS, LARGE), seed=1, **settings).items():
        assert name in by_ratio or np.std(added) == pytest.approx(T2[name], rel=0.01), name


def test_noise_is_gaussian_white_and_independent_from_channel_to_channel():
    unit = np.array([added / np.std(added) for added in noise(flight(SENSORS, LARGE), noise="t2", seed=2).values()])
    bound = 5.0 / np.sqrt(LARGE)  # five standard errors
    assert np.abs(unit.mean(axis=1)).max() < bound
    assert np.abs(np.corrcoef(unit) - np.eye(len(unit))).max() < bound
    assert np.abs(np.mean(unit[:, 1:] * unit[:, :-1], axis=1)).max() < bound
    np.testing.assert_allclose(np.mean(np.abs(unit) < 1.0, axis=1), 0.6827, atol=0.01)


def test_the_same_seed_gives_the_same_bits_and_others_do_not():
    truth = flight(SENSORS)
    first, again, other = (measure(truth, snr=50, seed=seed) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.values, again.values)
    assert all(not np.any(first[name] == other[name]) for name in SENSORS)


def test_the_flight_and_its_times_stay_as_they_were():
    truth = flight(SENSORS)
    before = truth.values.copy()
    measured = measure(truth, noise="t2")
    np.testing.assert_array_equal(truth.values, before)
    np.testing.assert_array_equal(measured.time_s, truth.time_s)


def test_a_missing_sample_stays_missing_and_costs_no_other():
    values = flight(["p"]).values.copy()
    values[500] = np.nan
    measured = measure(Record(values, channels=["p"], sample_period_s=0.01), snr=50)["p"]
    assert np.flatnonzero(np.isnan(measured)).tolist() == [500]


def test_commands_come_only_when_asked_for_and_without_noise():
    truth = flight(["p", "elevator", "q", "throttle"])
    assert measure(truth, noise="t2").channels == ("p", "q")
    asked = measure(truth, noise="t2", commands=True)
    assert set(asked.channels) == {"p", "q", "elevator", "throttle"}
    for name in ("elevator", "throttle"):
        np.testing.assert_array_equal(asked[name], truth[name])


@pytest.mark.parametrize("commands", [False, True])
def test_where_the_aircraft_is_isnt_measured(commands):
    truth = flight([*SENSORS, "north", "east", *COMMANDS])
    measured = measure(truth, snr=50, commands=commands)
    assert set(measured.channels) == {*SENSORS, *(COMMANDS if commands else ())}


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({}, "give either snr"),
        ({"snr": 50, "noise": "t2"}, "and not both"),
        ({"noise": "t3"}, "no noise 't3'; there is t2"),
        ({"snr": 0}, "snr is 0"),
        ({"snr": -5}, "snr is -5"),
        ({"snr": np.nan}, "snr is nan"),
        ({"snr": 50, "seed": -1}, "seed is -1"),
    ],
)
def test_settings_that_cant_be_meant_are_refused(settings, message):
    with pytest.raises(InputError, match=message):
        measure(flight(["p"]), **settings)


def test_a_flight_without_a_sensor_is_refused():
    with pytest.raises(InputError):
        measure(flight(["north", "east"]), snr=50)

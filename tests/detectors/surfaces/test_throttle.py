"""The throttle: named where it fails, never where a sensor does that looks like one, and not watched without nx."""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.surfaces.equations import Engine, speeding
from gtmbench.log.judging.certificate import certificate_of
from gtmbench.values.channels import ACCELEROMETERS
from tests.detectors.surfaces.test_surface_detector import ONSET_S, monitor, said, sensed


@pytest.mark.nightly
def test_a_throttle_that_stands_still_cannot_be_seen_to_be_stuck():
    still = sensed(False, 832, gb.Jam(channel="throttle", onset_s=ONSET_S), duration_s=120.0)
    assert said(still) == []
    assert monitor().sizes(still)["throttle"].loss > 1.0


@pytest.mark.nightly
def test_thrust_is_identified_with_its_lag_and_its_bend():
    """The GTM's engine follows after 2.0 s in the mean; a percent is worth more thrust the more there is."""
    engine = monitor().answer.frame.engine
    assert engine.lags * engine.lag_s == pytest.approx(2.0, rel=0.35)
    assert 0.5 < engine.bend < 4.0
    assert Engine(lag_s=1.0).thrust(np.array([20.0, 40.0])).tolist() == [20.0, 40.0]


def test_the_airspeed_changes_as_accelerometers_and_vanes_tell():
    """Where the air is calm, integrated kinematics are the airspeed, whatever elevator and throttle do."""
    throttle = gb.ScaleFactor(channel="throttle", onset_s=5.0, factor=0.0)
    truth = gb.fly("gtm", "multisine", 25.0, 3, faults=throttle)
    told = speeding({name: truth[name] for name in ("alpha", "beta", "phi", "theta", *ACCELEROMETERS)})
    grown = np.cumsum(0.5 * (told[1:] + told[:-1])) * truth.sample_period_s
    assert np.ptp(truth["tas"]) > 5.0
    np.testing.assert_allclose(grown, truth["tas"][1:] - truth["tas"][0], atol=0.15)


@cache
def without_nx():
    flights = [sensed(True, 760 + i, duration_s=130.0, excitation="multisine+turbulence") for i in range(3)]
    return gb.find_detector("surfaces-no-nx").calibrate(flights)


@pytest.mark.nightly
def test_without_nx_the_throttle_is_not_watched_and_the_certificate_says_so():
    assert "nx" not in without_nx().channels
    assert without_nx().suspects == ("elevator", "aileron", "rudder")
    healthy = sensed(True, 833, duration_s=110.0)
    (note,) = certificate_of(without_nx(), [without_nx().watch(healthy)]).unwatched
    assert note == "throttle is not watched: nx, phi, theta would have to be read"
    assert certificate_of(monitor(), [monitor().watch(healthy)]).unwatched == ()


@pytest.mark.nightly
def test_a_throttles_sizes_are_in_percent(tmp_path):
    healthy = sensed(True, 834, duration_s=120.0)
    certificate = certificate_of(monitor(), [monitor().watch(healthy)])
    assert 1.0 < certificate.of("throttle", "bias").size < 40.0
    gb.save_monitor(monitor(), tmp_path / "monitor.json")
    again = gb.load_monitor(tmp_path / "monitor.json")
    assert [alarm.verdict for alarm in again.watch(healthy).alarms] == []
    assert again.sizes(healthy) == monitor().sizes(healthy)

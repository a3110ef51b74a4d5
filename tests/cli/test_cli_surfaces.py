"""The detector of surfaces on the command line, and the flights that it is calibrated on."""

import json

import numpy as np

import gtmbench as gb
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.values.channels import COMMANDS


def test_bank_shows_the_equations_of_the_detector_of_surfaces(cli):
    code, out, err = cli("list", "surfaces", "--json")
    assert (code, err) == (0, "")
    told = json.loads(out)
    assert list(told["equations"]) == ["change of p", "change of q", "change of r", "ny", "nz", "nx"]
    assert told["equations"]["change of q"]["surfaces in it"] == "elevator throttle"
    assert told["effects"] is None
    code, out, _ = cli("list", "surfaces-no-vanes")
    assert code == 0
    assert "surfaces-no-vanes has 3 equations, of change of p, change of q, change of r" in out


def test_every_other_flight_is_in_the_loop_for_a_detector_that_knows_commands():
    flights = CalibrationFlights(flights=2, duration_s=4.0, seed=7)
    detector = gb.find_detector("surfaces")
    open_loop, closed = flights.records(detector)
    measured = gb.measure(gb.fly("gtm", "multisine+turbulence", 4.0, 7), noise="t2", seed=7, commands=True)
    np.testing.assert_array_equal(open_loop.values, measured.select(detector.channels).values)
    flown = gb.fly_in_loop("gtm", "multisine+turbulence", 4.0, 8, sensors="ideal").readings(commands=True)
    np.testing.assert_array_equal(closed.values, flown.select(detector.channels).values)
    assert flights.provenance(detector)["in_the_loop"] == "every other flight"
    blind = gb.find_detector("C")
    assert "in_the_loop" not in flights.provenance(blind)
    assert not set(COMMANDS) & set(flights.records(blind)[1].channels)

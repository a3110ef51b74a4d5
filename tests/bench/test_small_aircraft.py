"""Small propellers: they turn at the speed that their power gives, trims hold, flights last, a message says why."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.engine import ACCELERATIONS, engine, propellers, set_condition, spin_up, wrong_speeds
from gtmbench.bench.equilibrium import trimmed_engine
from tests.helpers.night import by_day
from tests.helpers.small_uav import CP, CT, DIAMETER_M, POWER_W, write_uav

LEVEL = {"altitude": 1000.0, "tas": 35.0, "psi": 45.0, "beta": 0.0, "alpha": 3.0, "phi": 0.0, "theta": 3.0}
LEVEL |= dict.fromkeys(("elevator", "aileron", "rudder"), 0.0)


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    return gb.load_aircraft(write_uav(tmp_path_factory.mktemp("fleet")))


@pytest.fixture(scope="module")
def wing(tmp_path_factory):
    return gb.load_aircraft(write_uav(tmp_path_factory.mktemp("fleet"), rudder=False, blades_ixx_kg_m2=4e-5))


def test_a_survey_says_what_is_special_of_it(small, wing):
    assert (small.spin_up, wing.spin_up) == (True, True)
    assert (small.rudderless, wing.rudderless) == (False, True)
    assert small.steps_a_sample > wing.steps_a_sample
    gtm, cessna = gb.load_aircraft("gtm"), gb.load_aircraft("c172p")
    assert not any((gtm.spin_up, gtm.rudderless, cessna.spin_up, cessna.rudderless))
    assert gtm.steps_a_sample == cessna.steps_a_sample == 1


@pytest.mark.parametrize("throttle", [5.0, 30.0, 100.0])
def test_a_propeller_turns_as_fast_as_its_power_allows(small, throttle):
    """P = CP rho n^3 D^5 and T = CT rho n^2 D^4, in any order of conditions before."""
    fdm = engine(small)
    found = []
    for at in (throttle, 80.0, throttle):
        set_condition(fdm, small, LEVEL | {"throttle": at})
        found.append((fdm[propellers(fdm)[0]], fdm["propulsion/engine/thrust-lbs"]))
    density = fdm["atmosphere/rho-slugs_ft3"] * 515.3788
    turns = (POWER_W * throttle / 100.0 / (CP * density * DIAMETER_M**5)) ** (1.0 / 3.0)
    assert found[0][0] / 60.0 == pytest.approx(turns, rel=2e-3)
    assert found[0][1] * 4.448222 == pytest.approx(CT * density * turns**2 * DIAMETER_M**4, rel=4e-3)
    np.testing.assert_allclose(found[2], found[0], rtol=1e-10)
    assert wrong_speeds(fdm) == []


def test_turning_it_up_moves_nothing_else(small):
    fdm = engine(small)
    set_condition(fdm, small, LEVEL | {"throttle": 40.0})
    watched = ("velocities/u-fps", "velocities/w-fps", "attitude/theta-rad", "position/h-sl-ft", "velocities/p-rad_sec")
    before = [fdm[name] for name in watched]
    spin_up(fdm)
    np.testing.assert_allclose([fdm[name] for name in watched], before, rtol=1e-9, atol=1e-12)
    assert fdm.get_delta_t() == pytest.approx(0.01 / small.steps_a_sample)


@pytest.mark.parametrize("which", by_day(["small", "wing"]))
def test_it_trims_and_flies_five_minutes(which, request):
    craft = request.getfixturevalue(which)
    fdm, trim = trimmed_engine(craft)
    assert max(abs(fdm[each]) for each in ACCELERATIONS) < 1e-6
    assert trim.gamma_deg == pytest.approx(0.0, abs=1e-6)
    assert (trim.beta_deg != 0.0) == craft.rudderless
    calm = gb.fly(craft, gb.Excitation(), 20.0)
    assert np.abs(calm.matrix("pqr")).max() < 0.1
    flight = gb.fly(craft, "multisine+turbulence", 300.0)
    assert flight.end_s == 300.0
    assert gb.fly(craft, "multisine", 5.0, 2).values.tobytes() == gb.fly(craft, "multisine", 5.0, 2).values.tobytes()


def test_it_is_stepped_as_it_is_flown(small):
    simulation = gb.Simulation(small, "multisine", 3.0)
    for seed in (1, 2):
        simulation.reset(seed)
    while not simulation.is_over:
        simulation.step(list(simulation.trim.commands.values()))
    flight = simulation.flight(list(simulation.trim.commands.values()))
    assert flight.truth.values.tobytes() == gb.fly(small, "multisine", 3.0, 2).values.tobytes()


@pytest.mark.nightly
def test_a_trim_that_fails_says_what_is_wrong(tmp_path):
    heavy = write_uav(tmp_path, mass_kg=40.0)
    with pytest.raises(gb.TrimError, match=r"no trim for 'smallish'"):
        gb.trim(heavy)

"""Aircraft that lack something: gliders descend, wings have no yaw damper, engines settle before they fly."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench import tuning
from gtmbench.bench.engine import ACCELERATIONS
from gtmbench.bench.equilibrium import trimmed_engine
from gtmbench.bench.modes import STATES, linearised
from gtmbench.bench.tuning import similar_autopilot
from tests.helpers.small_uav import write_uav


@pytest.fixture(scope="module")
def glider(tmp_path_factory):
    return gb.load_aircraft(write_uav(tmp_path_factory.mktemp("fleet"), motor=False))


@pytest.fixture(scope="module")
def wing(tmp_path_factory):
    return gb.load_aircraft(write_uav(tmp_path_factory.mktemp("fleet"), rudder=False, blades_ixx_kg_m2=4e-5))


def test_a_glider_descends_by_its_glide_ratio(glider):
    """Without a motor the path is as steep as drag over lift."""
    fdm, trim = trimmed_engine(glider)
    assert glider.motorless
    assert max(abs(fdm[each]) for each in ACCELERATIONS) < 1e-6
    alpha = np.deg2rad(trim.alpha_deg)
    assert np.tan(np.deg2rad(-trim.gamma_deg)) == pytest.approx(
        (0.03 + 0.9 * alpha**2) / (0.25 + 4.8 * alpha), rel=1e-3
    )
    flight = gb.fly(glider, gb.Excitation(), 20.0)
    assert np.abs(flight.matrix("pqr")).max() < 0.1
    sunk_ft = flight["tas"][0] * 1.68781 * np.sin(np.deg2rad(-trim.gamma_deg)) * 20.0
    assert flight["altitude"][0] - flight["altitude"][-1] == pytest.approx(sunk_ft, rel=0.02)


def test_gains_of_what_has_no_motor_hold_neither_altitude_nor_speed(glider):
    gains = similar_autopilot(linearised(glider))
    assert gains.reads == ("p", "q", "r", "phi", "theta", "psi")
    flight = gb.fly_in_loop(glider, "turbulence", 30.0, autopilot=gains)
    assert flight.departed_s is None
    assert np.std(flight.truth["p"]) < np.std(gb.fly(glider, "turbulence", 30.0)["p"])


@pytest.mark.nightly
def test_a_wing_has_no_yaw_damper_and_is_told(wing, cli, monkeypatch):
    monkeypatch.setattr(tuning, "_TRIED_S", 10.0)
    monkeypatch.setattr(tuning, "_PROVED_S", 30.0)
    monkeypatch.setattr(tuning, "delay_margin_s", lambda *_: 0.0)
    code, said, err = cli("aircraft", str(wing.folder), "--autopilot")
    assert code == 0, err
    assert "no yaw damper: nothing answers the rudder" in said
    assert "r_to_rudder_s = 0.0" in said


def test_what_steers_by_yaw_gets_the_sign_of_the_roll_that_it_settles_at():
    """An aileron that yaws far more than it rolls rolls the other way in the end, through the dihedral."""
    linear = linearised("gtm")
    moved = linear.input_matrix.copy()
    p, r = STATES.index("p"), STATES.index("r")
    moved[p, 1], moved[r, 1] = 0.02, -1.0
    steered = replace(linear, input_matrix=moved)
    lateral = [STATES.index(name) for name in ("v", "p", "r", "phi")]
    settled = np.zeros(4)
    for _ in range(300):  # 3 s of 1 deg
        settled += 0.01 * (linear.state_matrix[np.ix_(lateral, lateral)] @ settled + moved[lateral, 1])
    gain = similar_autopilot(steered).phi_to_aileron
    assert np.sign(settled[3]) == -np.sign(moved[p, 1])  # the bank, away from where it rolled at first
    assert np.sign(gain) == -np.sign(settled[3])  # a bank to the right is steered against
    assert similar_autopilot(linear).phi_to_aileron > 0.0


def test_a_trim_is_searched_once_for_engines_that_settle():
    """A second flight takes what the first one found, with the same bits."""
    craft = gb.load_aircraft("c310")
    first, again = (gb.fly(craft, "multisine", 2.0, 3) for _ in range(2))
    assert first.values.tobytes() == again.values.tobytes()
    calm = gb.fly(craft, gb.Excitation(), 30.0)
    assert abs(calm["altitude"][-1] - calm["altitude"][0]) < 5.0


@pytest.mark.nightly
def test_an_engine_without_a_known_power_is_no_traceback():
    """The C-130's turboprops have no property power-hp, and their trim fails at first."""
    assert gb.trim("C130").throttle_percent > 0.0


def test_what_cannot_fly_level_is_refused():
    with pytest.raises(gb.TrimError, match=r"no trim for 'mk82'"):
        gb.trim("mk82")

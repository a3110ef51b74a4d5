"""Gains that are found: the GTM's by similarity, signs by trying, and an aircraft that they hold."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench import tuning
from gtmbench.bench.modes import linearised
from gtmbench.bench.tuning import OCTAVES, similar_autopilot


def test_the_gtm_is_similar_to_itself():
    """The hand-set gains come out, to what the constants are rounded to."""
    own, similar = vars(gb.load_aircraft("gtm").autopilot), vars(similar_autopilot(linearised("gtm")))
    for name, gain in own.items():
        assert similar[name] == pytest.approx(gain, rel=0.12), name


def test_signs_follow_the_surfaces():
    craft = gb.load_aircraft("gtm")
    turned = {name: replace(command, unit=-command.unit) for name, command in craft.commands.items()}
    swapped = replace(
        craft,
        commands=craft.commands | {"elevator": turned["elevator"], "rudder": turned["rudder"]},
        limits=craft.limits | {"elevator": (-20.0, 30.0)},
        guess=craft.guess | {"elevator": -2.7},
    )
    own, other = (similar_autopilot(linearised(each)) for each in (craft, swapped))
    assert other.q_to_elevator_s == pytest.approx(-own.q_to_elevator_s, rel=0.01)
    assert other.r_to_rudder_s == pytest.approx(-own.r_to_rudder_s, rel=0.01)
    assert other.p_to_aileron_s == pytest.approx(own.p_to_aileron_s, rel=0.01)
    assert gb.fly_in_loop(swapped, duration_s=20.0, autopilot=other).departed_s is None


def test_of_octaves_the_best_of_the_worst_neighbours_is_taken(monkeypatch):
    """A gain at whose double it falls isn't taken, though it does best itself."""
    own = gb.Autopilot(r_to_rudder_s=1.0)
    costs = dict(zip((2.0**octave for octave in OCTAVES), (9.0, 5.0, 3.0, 2.0, 1.0, np.inf), strict=True))
    monkeypatch.setattr(tuning, "_cost", lambda *given: costs[given[1].r_to_rudder_s])
    assert tuning._best(gb.load_aircraft("gtm"), own, "yaw").r_to_rudder_s == 0.5


@pytest.mark.nightly
def test_a_light_aircraft_is_held(monkeypatch):
    """The whole way, with short flights."""
    monkeypatch.setattr(tuning, "_TRIED_S", 20.0)
    monkeypatch.setattr(tuning, "_PROVED_S", 120.0)
    tuned = gb.find_autopilot("c172p")
    assert tuned.altitude_off_ft < 100.0
    assert tuned.tas_off_kt < 25.0
    assert tuned.bank_deg < 15.0
    flight = gb.fly_in_loop("c172p", duration_s=30.0, seed=5, autopilot=tuned.autopilot)
    open_loop = gb.fly("c172p", "turbulence", 30.0, seed=5)
    assert np.std(flight.truth["p"]) < np.std(open_loop["p"])


def test_what_cannot_be_held_is_one_line(monkeypatch):
    monkeypatch.setattr(tuning, "_flown", lambda *_, **__: None)
    with pytest.raises(gb.GtmbenchError, match="no gains are found that hold 'gtm' in moderate turbulence at 8000 ft"):
        gb.find_autopilot("gtm")


@pytest.mark.nightly
def test_the_command_writes_a_table_that_a_scenario_takes(cli, tmp_path, monkeypatch):
    monkeypatch.setattr(tuning, "AXES", {})
    monkeypatch.setattr(tuning, "_PROVED_S", 5.0)
    out = tmp_path / "gains.toml"
    code, said, _ = cli("aircraft", "A320", "--autopilot", "--out", str(out))
    assert code == 0
    assert out.read_text().rstrip() in said
    scenario = tmp_path / "airliner.toml"
    text = 'aircraft = "A320"\n' + out.read_text() + '[[faults]]\nkind = "jam"\nchannels = ["p"]\nonset_s = 300\n'
    scenario.write_text(text)
    assert gb.load_scenario(scenario).setup.autopilot == similar_autopilot(linearised("A320"))
    assert cli("aircraft", "A320", "--autopilot", "--out", str(out))[0] == 2  # exists

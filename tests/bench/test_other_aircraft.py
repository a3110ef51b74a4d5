"""JSBSim's own aircraft by name, and a user's: two small ones fly, everything that is known of the others is legal."""

import shutil
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench import equilibrium
from gtmbench.bench.aircraft import aircraft_of, facts_of
from gtmbench.bench.engine import ACCELERATIONS, engine
from gtmbench.bench.equilibrium import mistaken_units, trimmed_engine
from gtmbench.bench.excitation import Excitation, excitation
from gtmbench.bench.known_aircraft import jsbsim_aircraft, jsbsim_facts, load_aircraft
from gtmbench.values.channels import SURFACES
from tests.helpers.night import by_day

SMALL = ("c172p", "dr1")  # a piston engine; one that reads properties of another simulator
OUTPUT = '<output name="here.csv" type="CSV" rate="10"><rates>ON</rates></output>'
INPUT = '<input type="SOCKET" port="5139" protocol="TCP"/>'


@pytest.fixture
def copied(tmp_path):
    """Return a function that copies one of JSBSim's aircraft under a name, as a user would, and adds to its model."""

    def copy(source, name, added=""):
        folder = tmp_path / "fleet" / name
        shutil.copytree(jsbsim_aircraft()[source], folder)
        text = (folder / f"{source}.xml").read_text(encoding="utf-8", errors="replace")
        (folder / f"{source}.xml").unlink()
        (folder / f"{name}.xml").write_text(text.replace("</fdm_config>", f"{added}</fdm_config>"), encoding="utf-8")
        return folder

    return copy


@pytest.mark.parametrize("name", sorted(jsbsim_facts()))
def test_what_is_known_of_an_aircraft_is_legal_and_of_one_that_there_is(name):
    craft = load_aircraft(name)
    assert craft.folder == jsbsim_aircraft()[name]
    assert craft.without_io
    assert aircraft_of(craft.folder, facts_of(craft)) == craft
    low, high = zip(*craft.limits.values(), strict=True)
    assert all(bottom < top for bottom, top in zip(low, high, strict=True))
    assert set(craft.excitation) == set(SURFACES)
    for surface, factor in craft.excitation.items():  # doublets, 2 deg on the GTM, stay below full deflection
        assert 0.0 < 2.0 * factor < craft.limits[surface][1]


@pytest.mark.parametrize("name", SMALL)
def test_trim_stands_and_lasts(name):
    fdm, trim = trimmed_engine(load_aircraft(name))
    assert max(abs(fdm[each]) for each in ACCELERATIONS) < 1e-6
    calm = gb.fly(name, Excitation(), 10.0)
    assert np.abs(calm.matrix("pqr")).max() < 0.1  # deg/s
    assert calm["altitude"] == pytest.approx(trim.altitude_ft, abs=5.0)
    assert calm["alpha"] == pytest.approx(trim.alpha_deg, abs=0.1)


@pytest.mark.parametrize("name", SMALL)
def test_commands_move_the_aircraft_as_the_channel_table_says(name):
    """Elevator down pitches down, the right aileron down rolls left, the rudder to the left yaws left."""
    steps = {surface: np.where(np.arange(101) > 10, 1.0, 0.0) for surface in SURFACES}
    calm = gb.fly(name, Excitation(), 1.0)
    for surface, rate in {"elevator": "q", "aileron": "p", "rudder": "r"}.items():
        moved = gb.fly(name, Excitation(surfaces={surface: steps[surface]}), 1.0)
        assert moved[surface][-1] - moved[surface][0] == pytest.approx(1.0)
        assert moved[rate][60] - calm[rate][60] < -0.1, surface


@pytest.mark.parametrize("name", SMALL)
def test_the_same_flight_twice_and_scaled_to_the_aircraft(name):
    first, second = (gb.fly(name, "multisine+turbulence", 20.0, seed=3) for _ in range(2))
    assert (first.values == second.values).all()
    for rate in "pqr":
        assert 0.7 < np.std(first[rate]) < 15.0
    craft = load_aircraft(name)
    for surface, factor in craft.excitation.items():
        moved = first[surface] - gb.trim(name).commands[surface]
        gtm = excitation("multisine", first.time_s, 3).surfaces[surface]
        np.testing.assert_allclose(moved, factor * gtm, atol=1e-9)


def test_all_motors_get_the_throttle():
    fdm, trim = trimmed_engine(load_aircraft("B747"))
    thrust = [fdm[f"propulsion/engine[{motor}]/thrust-lbs"] for motor in range(4)]
    assert min(thrust) > 1000.0
    assert fdm["fcs/throttle-cmd-norm[3]"] == pytest.approx(trim.throttle_percent / 100.0)
    assert np.ptp(thrust) < 1e-3 * max(thrust)


def test_a_folder_without_facts_is_surveyed(copied):
    """A copy under another name, away from JSBSim's engines: what is found is what ships."""
    folder = copied("t6texan2", "trainer")
    found, known = load_aircraft(folder), load_aircraft("t6texan2")
    assert found.limits == known.limits
    assert found.commands == known.commands
    assert found.tas_kt == known.tas_kt
    assert gb.trim(folder).alpha_deg == pytest.approx(gb.trim("t6texan2").alpha_deg, abs=1e-6)
    assert found.excitation == pytest.approx(known.excitation, rel=0.02)
    began = time.monotonic()
    load_aircraft(folder)
    assert time.monotonic() - began < 0.1  # once


@pytest.mark.nightly
def test_an_aircraft_that_has_no_trim_says_why_and_takes_another_condition(cli):
    code, _, err = cli("aircraft", "weather-balloon")
    assert code == 2
    assert "flight path angle at its limit of 5" in err
    code, _, err = cli("aircraft", "p51d", "--tas", "350")
    assert code == 2
    assert "at 10000 ft and 350 kt" in err
    assert "acceleration (" in err


@pytest.mark.nightly
@pytest.mark.parametrize("section", by_day([OUTPUT, INPUT]))
def test_sections_that_reach_outside_are_refused_or_left_out(cli, copied, tmp_path, section):
    folder = copied("c172p", "mine", section)
    tag = section[1 : section.index(" ")]
    code, _, err = cli("aircraft", folder)
    assert code == 2
    assert f"has an <{tag}> section" in err
    assert "--without-io" in err
    before = sorted(tmp_path.rglob("*"))
    code, out, err = cli("aircraft", folder, "--without-io")
    assert code == 0
    assert f"without the <{tag}> of its model" in err
    assert "altitude = 5000.00 ft" in out
    assert sorted(tmp_path.rglob("*")) == before


def test_a_part_that_reaches_outside_is_refused_even_so(cli, copied):
    folder = copied("c172p", "mine", '<system file="told"/>')
    (folder / "told.xml").write_text(f'<system name="told">{OUTPUT}</system>')
    code, _, err = cli("aircraft", folder, "--without-io")
    assert code == 2
    assert "has an <output> section" in err


def test_jsbsims_own_fly_without_their_sockets_and_that_is_said(cli):
    code, out, err = cli("aircraft", "737")
    assert (code, err) == (0, "note: 737 flies without the <input> of its model, which would open ports or files\n")
    assert "altitude = 10000.00 ft" in out
    assert cli("aircraft", "737", "--json")[2] == ""


def test_facts_are_written_to_be_edited(cli, tmp_path):
    code, out, _ = cli("aircraft", "c172p", "--facts")
    assert (code, out) == (0, "Wrote my-c172p/aircraft.toml; edit it, then run: gtmbench aircraft my-c172p\n")
    mine, theirs = load_aircraft("my-c172p"), load_aircraft("c172p")
    assert replace(mine, without_io=True) == theirs
    path = tmp_path / "my-c172p/aircraft.toml"
    path.write_text(path.read_text().replace("tas_kt = 96.0", "tas_kt = 90.0"))
    assert gb.trim("my-c172p").tas_kt == pytest.approx(90.0)
    code, _, err = cli("aircraft", "c172p", "--facts")
    assert code == 2
    assert "exists" in err
    assert cli("aircraft", "gtm", "--facts", "--out", "copy")[0] == 0
    assert gb.trim("copy") == gb.trim("gtm")


@pytest.mark.nightly
def test_facts_of_a_folder_are_written_beside_its_model(cli, copied):
    folder = copied("c172p", "mine", OUTPUT)
    assert cli("aircraft", folder, "--facts")[0] == 2
    assert cli("aircraft", folder, "--facts", "--without-io")[0] == 0
    assert "model = " not in (folder / "aircraft.toml").read_text()
    assert gb.trim(folder).altitude_ft == 5000.0  # the file says that they are left out


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('model = "c172p"', 'model = "nowhere"', "no aircraft 'nowhere'"),
        ('model = "c172p"', "model = 5", "model is 5"),
        ("without_io = true", "without_io = 1", "without_io is 1; it must be true or false"),
        ("unit = 100.0", "unit = 0.0", "commands.throttle.unit is 0"),
        ("fcs/elevator-cmd-norm", "fcs/no-such", "no property 'fcs/no-such', which channel 'elevator' needs"),
        ("fcs/elevator-cmd-norm", "a b", "commands.elevator.property is 'a b'; it must be the name of a property"),
        ("fcs/elevator-cmd-norm", "a[-1]", "commands.elevator.property is 'a[-1]'"),
        ("gear/gear-cmd-norm", "//[", "properties is '//['; it must be the name of a property"),
        ("[excitation]\nelevator", "[excitation]\nflap", "unknown key 'flap' in [excitation]"),
        ("[limits]\nelevator", "[limits]\nflap", "lacks elevator"),
        ("[properties]", '[properties]\n"a/b" = "x"', "properties.a/b is 'x'"),
    ],
)
def test_facts_that_nobody_means_are_refused(cli, tmp_path, old, new, message):
    cli("aircraft", "c172p", "--facts")
    path = tmp_path / "my-c172p/aircraft.toml"
    assert old in path.read_text()
    path.write_text(path.read_text().replace(old, new))
    code, _, err = cli("aircraft", "my-c172p")
    assert code == 2
    assert message in err
    assert len(err.splitlines()) == 1


def test_a_condition_in_metres_or_metres_per_second_is_recognised(cli):
    with pytest.raises(gb.TrimError, match=r"110 m/s would trim: if that was meant, give 10000 ft and 213.823 kt"):
        gb.trim("A4", tas_kt=110.0)
    own = load_aircraft("gtm")
    assert mistaken_units(own, altitude_ft=8000.0, tas_kt=100.58) == ""
    code, _, err = cli("aircraft", "--tas", "51.7", "--altitude", "2438")
    assert code == 0  # the GTM flies as slowly as that
    assert err == (
        "note: 2438 m is gtm's own altitude; altitudes are in ft; 51.7 m/s is gtm's own speed; speeds are in kt\n"
    )


def test_where_the_search_fails_equilibriums():
    """The Cessna's actuators stick: no derivative of an acceleration by a command means anything."""
    craft = load_aircraft("c172x")
    fdm, trim = trimmed_engine(craft)
    assert max(abs(fdm[each]) for each in ACCELERATIONS) < 1e-3
    assert trim.elevator_deg != 0.0  # read back from the tab
    assert fdm["fcs/pitch-trim-cmd-norm"] == 0.0
    assert fdm["fcs/elevator-cmd-norm"] * craft.commands["elevator"].unit == pytest.approx(trim.elevator_deg)
    for _ in range(300):
        fdm.run()
    assert fdm["position/h-sl-ft"] == pytest.approx(trim.altitude_ft, abs=1.0)


def test_a_trim_that_takes_too_long_is_given_up(monkeypatch):
    monkeypatch.setattr(equilibrium, "_LONGEST_S", 0.05)
    with pytest.raises(gb.TrimError, match=r"no trim for 'c172x'"):
        gb.trim("c172x")


def test_jsbsims_files_stay_as_they_are():
    folder = jsbsim_aircraft()["737"]
    before = {path: path.stat().st_mtime_ns for path in Path(folder).rglob("*")}
    gb.fly("737", Excitation(), 0.1)
    assert {path: path.stat().st_mtime_ns for path in Path(folder).rglob("*")} == before


def test_a_user_may_set_what_a_model_begins_with(cli, tmp_path):
    cli("aircraft", "c172p", "--facts")
    path = tmp_path / "my-c172p/aircraft.toml"
    path.write_text(path.read_text() + '"fcs/flap-cmd-norm" = 0.5\n')
    craft = load_aircraft("my-c172p")
    assert engine(craft)["fcs/flap-cmd-norm"] == 0.5
    assert gb.trim("my-c172p").alpha_deg < gb.trim("c172p").alpha_deg - 1.0


def test_list_names_them_all(cli):
    _, out, _ = cli("list")
    assert f"{len(jsbsim_facts())} that come with JSBSim" in out
    _, out, _ = cli("list", "--all")
    assert all(name in out for name in jsbsim_aircraft())

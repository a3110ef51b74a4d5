"""A scenario and a campaign fly a controller by FILE.py:OBJECT, of a file that the user has imported, and no other."""

import json

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.imports import load_module
from tests.helpers.hostile import refused

PILOT = """
import gtmbench as gb

GTM = gb.load_aircraft("gtm")

class Pilot:
    def start(self, trim):
        self.engaged = GTM.autopilot.engage(trim, GTM.limits, 0.01)

    def command(self, readings, time_s):
        return self.engaged(readings)

def asleep(readings, time_s):
    return None

number = 3
"""
SCENARIO = """
excitation = "turbulence"
duration_s = 20.0
severity_reference_s = [2.0, 10.0]
{flown}

[operator]
causal_order = 5
noncausal_order = 5
identify_s = [2.0, 10.0]

[alarm]
window = 50
threshold_s = [5.0, 10.0]
watch_from_s = 2.0
healthy_records = 1

[[faults]]
kind = "bias"
channels = ["q"]
onset_s = 15.0
size = 20.0
"""

MANY = """
title = "many"
scenarios = ["{scenario}"]
detectors = ["dissertation"]
[axes]
seed = [1, 2]
"""


BARE = ("--out", "out", "--no-figures", "--no-recording")


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setattr("gtmbench.imports._brought", {})
    (tmp_path / "pilot.py").write_text(PILOT)
    (tmp_path / "own.toml").write_text(SCENARIO.format(flown='controller = "pilot.py:Pilot"'))
    (tmp_path / "ours.toml").write_text(SCENARIO.format(flown='sensors = "ideal"\n[autopilot]'))
    return tmp_path


@pytest.mark.nightly
def test_a_scenario_flies_it_as_it_flies_ours(folder):
    load_module(folder / "pilot.py")
    own, ours = (gb.run(folder / f"{name}.toml")[0] for name in ("own", "ours"))
    np.testing.assert_array_equal(own.record.values, ours.record.values)
    assert own.detected == ours.detected
    facts = gb.load_scenario(folder / "own.toml").setup.facts
    assert facts["controller"] == "pilot.py:Pilot"
    assert "controller" not in gb.load_scenario(folder / "ours.toml").setup.facts


@pytest.mark.parametrize(
    ("flown", "said"),
    [
        ('controller = "os:abort"', "isn't imported, and a file of data imports nothing by itself.*--import"),
        ('controller = "pilot.py:nobody"', "has no 'nobody'"),
        ('controller = "pilot.py:number"', "controller is 3; give a function"),
        ('controller = "pilot.py"', "names no object"),
        ("controller = 3", "controller is 3"),
        ('controller = "pilot.py:Pilot"\n[autopilot]', "only one can fly"),
        ('controller = "pilot.py:Pilot"\nsnr = 50', "noise"),
    ],
)
def test_what_a_scenario_may_not_say(folder, flown, said):
    load_module(folder / "pilot.py")
    path = folder / "wrong.toml"
    path.write_text(SCENARIO.format(flown=flown))
    with pytest.raises(gb.InputError, match=said):
        gb.load_scenario(path)


def test_the_command_line_imports_it(cli, folder):
    code, _, err = cli("run", folder / "own.toml", "--import", folder / "pilot.py", *BARE)
    assert code == 0, err
    assert json.loads((folder / "out" / "results.json").read_text())["setup"]["controller"] == "pilot.py:Pilot"


@pytest.mark.nightly
def test_a_campaign_flies_it_in_its_processes_and_a_failing_one_is_a_row(folder):
    (folder / "asleep.toml").write_text(SCENARIO.format(flown='controller = "pilot.py:asleep"'))
    load_module(folder / "pilot.py")
    rows = {}
    for name in ("own", "asleep"):
        campaign = folder / f"many_{name}.toml"
        campaign.write_text(MANY.format(scenario=folder / f"{name}.toml"))
        rows[name] = gb.campaign(campaign, out=folder / name, jobs=2 if name == "own" else 1)
    assert rows["own"]["closed_loop"].all()
    assert rows["own"]["error"].isna().all()
    assert rows["asleep"]["error"].str.contains("controller 'asleep' at 0 s: commands are None").all()


def test_fly_writes_what_a_failing_controller_has_flown(cli, folder):
    (folder / "late.py").write_text(
        "def late(readings, time_s):\n    return [2.7, 0, 0, 21] if time_s < 0.5 else [float('nan')] * 4\n"
    )
    err = refused(cli("fly", "--closed-loop", "--controller", "late.py:late", "--out", "late.csv"))
    assert "controller 'late' at 0.5 s: commands are [nan" in err
    assert "got the 0.5 s flown until then" in err
    assert gb.read_log(folder / "late.csv").end_s == 0.5


def test_a_controller_needs_a_closed_loop(cli, folder):
    assert "add --closed-loop" in refused(cli("fly", "--controller", "pilot.py:Pilot", "--out", str(folder / "a.csv")))
    assert not (folder / "a.csv").exists()


def test_run_flies_another_aircraft(cli, folder):
    code, _, err = cli("run", folder / "ours.toml", "--aircraft", "c172p", *BARE)
    assert code == 0, err
    setup = json.loads((folder / "out" / "results.json").read_text())["setup"]
    assert setup["aircraft"] == "c172p"
    assert setup["autopilot"] != gb.load_scenario(folder / "ours.toml").setup.facts["autopilot"]

"""Scenarios and campaigns on a sensor chain: what is flown, calibrated, told and refused."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.jobs.progress import counted, silent
from gtmbench.study.campaign.axes import flights
from gtmbench.study.flights import BROKEN, SEED_STEP, fly_setup
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.scenario import Setup, scenario_of, sensed_by
from tests.helpers.hostile import refused

GTM = gb.load_aircraft("gtm")
FLIP = {"kind": "sign_flip", "channels": ["r"], "onset_s": 4.0}
SHORT = {
    "duration_s": 8.0,
    "excitation": "turbulence",
    "severity_reference_s": [1.0, 3.0],
    "operator": {"identify_s": [1.0, 3.0]},
    "alarm": {"threshold_s": [3.0, 6.0], "watch_from_s": 1.0},
}


def scenario(**keys):
    return scenario_of("chained", SHORT | {"faults": [FLIP]} | keys)


def flown(setup):
    return fly_setup(setup, False, counted(silent, 2))


def test_a_chain_is_said_with_its_noise_and_ideal_sensors_go_without_saying():
    setup = scenario(sensors="chain").setup
    assert (setup.sensors, setup.snr, setup.noise) == ("chain", None, "t2")
    assert setup.facts["sensors"] == "chain"
    assert "sensors" not in Setup().facts
    assert set(setup.facts) - set(Setup().facts) == {"sensors"}


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"sensors": "chian"}, "there are ideal, chain; did you mean 'chain'"),
        ({"sensors": "chain", "snr": 50}, 'give noise = "t2"'),
        ({"sensors": "chain", "aircraft": "c172p"}, "'c172p' has no sensor chain"),
        ({"sensors": 3}, "sensors is 3"),
    ],
)
def test_sensors_that_cannot_be_meant_are_refused(keys, said):
    with pytest.raises(gb.InputError, match=said):
        scenario(**keys)


def test_in_the_loop_it_is_the_flight_on_the_chain_by_its_gains():
    given = scenario(sensors="chain", autopilot={})
    assert given.setup.autopilot == GTM.chain_autopilot
    assert scenario(autopilot={}).setup == given.setup  # where nobody says
    assert scenario(sensors="ideal", autopilot={}).setup.autopilot == GTM.autopilot
    seed = given.setup.seed + SEED_STEP * BROKEN
    alone = gb.fly_in_loop(duration_s=8.0, noise_seed=seed, sensors="chain")
    study = flown(given.setup)
    np.testing.assert_array_equal(study.sensed(BROKEN).values, alone.sensed.values)
    injection, unbroken = study.broken("chained", given.faults[0])
    flip = gb.SignFlip(channel="r", onset_s=4.0)
    broken = gb.fly_in_loop(duration_s=8.0, noise_seed=seed, sensors="chain", faults=flip)
    np.testing.assert_array_equal(injection.record.values, broken.sensed.values)
    np.testing.assert_allclose(unbroken["r"][400:], -injection.record["r"][400:], atol=1e-9)


def test_in_open_loop_all_records_are_read_through_the_chain():
    study = flown(scenario(sensors="chain").setup)
    seed = study.setup.seed + SEED_STEP
    measured = gb.measure(study.flight, noise="t2", seed=seed, sensors=GTM.chain)
    np.testing.assert_array_equal(study.sensed(1).values, measured.values)
    other = study.elsewhere("multisine", 6.0, 77, 1)
    expected = gb.measure(gb.fly("gtm", "multisine", 6.0, 77), noise="t2", seed=seed, sensors=GTM.chain)
    np.testing.assert_array_equal(other.values, expected.values)


def test_calibration_flights_are_on_the_chain_and_say_so():
    ideal, chained = (CalibrationFlights(flights=1, duration_s=3.0, sensors=each) for each in ("ideal", "chain"))
    assert chained.provenance()["sensors"] == "chain"
    assert "sensors" not in ideal.provenance()
    (record,) = chained.sensed(["p", "phi"])
    truth = gb.fly("gtm", chained.excitation, 3.0, chained.seed)
    expected = gb.measure(truth, noise="t2", seed=chained.seed, sensors=GTM.chain)
    np.testing.assert_array_equal(record["phi"], expected["phi"])


STATED = """
duration_s = 8.0
excitation = "turbulence"
severity_reference_s = [1.0, 3.0]
operator.identify_s = [1.0, 3.0]
alarm.threshold_s = [3.0, 6.0]
alarm.watch_from_s = 1.0
{sensors}
[[faults]]
kind = "sign_flip"
channels = ["r"]
onset_s = 4.0
"""


def test_a_run_takes_other_sensors_and_the_gains_for_them(cli, tmp_path):
    loop = scenario(autopilot={})
    assert sensed_by(loop, "ideal").setup == scenario(sensors="ideal", autopilot={}).setup
    assert sensed_by(sensed_by(loop, "ideal"), "chain").setup == loop.setup
    own = scenario(sensors="chain", autopilot={"q_to_elevator_s": 0.3})
    assert sensed_by(own, "ideal").setup.autopilot == own.setup.autopilot
    assert sensed_by(scenario(), "chain").setup == scenario(sensors="chain").setup
    assert "'chian'" in refused(cli("run", "jam", "--sensors", "chian", "--out", str(tmp_path / "out")))
    assert not (tmp_path / "out").exists()


def test_a_campaign_calibrates_on_the_sensors_of_its_flights(tmp_path):
    files = {name: tmp_path / f"{name}.toml" for name in ("ideal", "chain", "both")}
    for name in ("ideal", "chain"):
        files[name].write_text(STATED.format(sensors=f'sensors = "{name}"'))
        assert gb.load_campaign(files[name]).calibration.sensors == name
    files["both"].write_text(f"scenarios = ['{files['ideal']}', '{files['chain']}']\n")
    with pytest.raises(gb.InputError, match="sensors is chain and ideal in its scenarios"):
        gb.load_campaign(files["both"])


def test_an_axis_with_an_aircraft_without_a_chain_is_refused_before_it_flies():
    setup = scenario(sensors="chain").setup
    with pytest.raises(gb.InputError, match="'c172p' has no sensor chain"):
        list(flights(setup, {"aircraft": ["gtm", "c172p"]}))
    (closed,) = flights(setup, {"closed_loop": [True]})
    assert closed.autopilot == GTM.chain_autopilot
    assert replace(closed, autopilot=None) == setup

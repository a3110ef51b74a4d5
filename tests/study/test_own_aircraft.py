"""A user's own small aircraft wherever an aircraft's name is: rescues, campaigns, calibration."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.bench.aircraft import autopilot_table, commented
from gtmbench.bench.modes import linearised
from gtmbench.bench.survey import survey
from gtmbench.bench.tuning import similar_autopilot
from gtmbench.detectors.accommodation.without_sensor import Accommodate
from gtmbench.errors import EnvelopeError
from gtmbench.study import healthy_records
from gtmbench.study.healthy_records import CalibrationFlights
from gtmbench.study.run import fly_rescue
from tests.helpers.campaigns import TINY, table
from tests.helpers.hostile import refused
from tests.helpers.small_uav import write_uav


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A small UAV whose aircraft.toml has gains."""
    folder = write_uav(tmp_path_factory.mktemp("fleet"))
    gains = similar_autopilot(linearised(gb.load_aircraft(folder)))
    (folder / "aircraft.toml").write_text(commented(survey(folder)) + autopilot_table(vars(gains)))
    return folder


@pytest.fixture(scope="module")
def monitor(folder):
    flights = CalibrationFlights(flights=2, duration_s=60.0, aircraft=str(folder))
    recipe = gb.BankDetector(bank=gb.load_bank("C-early"))
    return recipe.calibrate(flights.records(recipe))


@pytest.mark.nightly
def test_it_is_rescued(folder, monitor):
    flip = gb.SignFlip(channel="r", onset_s=12.0)
    rescue = fly_rescue([flip], Accommodate(monitor), aircraft=folder, duration_s=12.9)
    unaided, rescued = (flight.truth for flight in rescue.flights.values())
    assert {event.channel for event in rescue.rescued.events} == {"r", "psi"}  # whom it takes out of the loop
    assert not rescue.unaided.events
    same = round(rescue.rescued.events[0].time_s / 0.01)
    assert unaided.values[:same].tobytes() == rescued.values[:same].tobytes()
    assert np.abs(rescued["r"]).max() < np.abs(unaided["r"]).max()


def test_without_gains_it_is_told_how_to_find_some(cli, tmp_path):
    bare = write_uav(tmp_path / "fleet")
    refused(cli("fly", "--rescue", "--aircraft", bare, "--detector", "none.json"))


@pytest.mark.nightly
def test_a_campaign_flies_it(folder, tmp_path):
    axes = f'aircraft = "{folder}"\nclosed_loop = true'
    rows = table(tmp_path, TINY.replace('seed = "1:8"', axes).replace('"multisine"', '"turbulence"\nnoise = "t2"'))
    assert rows["error"].isna().all()
    assert set(rows["aircraft"]) == {str(folder)}


@pytest.mark.nightly
def test_calibration_flies_in_the_loop_what_leaves_open_loop(monkeypatch, folder):
    def thrown(*_, **__):
        raise EnvelopeError("the excitation throws it out of its envelope")

    monkeypatch.setattr(healthy_records, "fly", thrown)
    flights = CalibrationFlights(flights=1, duration_s=5.0, aircraft=str(folder))
    record = flights.sensed(("p", "q", "r"))[0]
    flown = gb.fly_in_loop(folder, flights.excitation, 5.0, flights.seed).truth
    expected = gb.measure(flown, noise="t2", seed=flights.seed)
    assert record.values.tobytes() == expected.select(("p", "q", "r")).values.tobytes()
    with pytest.raises(EnvelopeError, match="find its gains by gtmbench aircraft NAME --autopilot"):
        CalibrationFlights(flights=1, duration_s=5.0, aircraft="C130").sensed(("p", "q", "r"))

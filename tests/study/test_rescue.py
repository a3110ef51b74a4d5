"""A departure beside its rescue: one command, one recording, one picture."""

import json

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.accommodation.without_sensor import Accommodate
from gtmbench.report.figures.rescue import moments, shown_flight
from gtmbench.study.run import fly_rescue
from tests.helpers.hostile import refused
from tests.helpers.rescuing import early_monitor


@pytest.fixture(scope="module")
def rescue():
    flip = gb.SignFlip(channel="r", onset_s=15.0)
    return fly_rescue([flip], Accommodate(early_monitor()), duration_s=19.0, sensors="ideal")


@pytest.mark.nightly
def test_both_flights_are_one_until_the_alarm(rescue):
    unaided, rescued = (flight.truth for flight in rescue.flights.values())
    first = min(event.time_s for event in rescue.rescued.events)
    same = round(first / 0.01)
    np.testing.assert_array_equal(unaided.values[:same], rescued.values[:same])
    assert rescue.unaided.departed_s is not None
    assert rescue.rescued.departed_s is None
    assert rescue.watch.alarm_s == pytest.approx(first)  # what is said of the record is what was acted on


@pytest.mark.nightly
def test_moments_are_told_from_the_onset_on(rescue):
    told = moments(rescue)
    assert told["unaided"][0][1] == "sign flip of r"
    assert told["unaided"][1][1] == f"departure, {rescue.unaided.departed_s - 15.0:.2f} s"
    assert told["rescued"][0][1].startswith("alarm: r is suspected, 0.")


@pytest.mark.nightly
def test_a_flight_that_ends_early_is_shown_as_far_as_it_was_flown():
    """The q gyro's flip leaves the envelope within half a second: that flight is much shorter than the rescued one."""
    rescue = fly_rescue(
        [gb.SignFlip(channel="q", onset_s=15.0)], Accommodate(early_monitor()), duration_s=19.0, sensors="ideal"
    )
    assert shown_flight(rescue, "unaided").end_s == rescue.unaided.truth.end_s < 17.0
    assert shown_flight(rescue, "rescued").end_s == 19.0
    assert shown_flight(rescue, "unaided").start_s == shown_flight(rescue, "rescued").start_s == 10.0


@pytest.mark.nightly
def test_one_command_writes_the_recording_and_the_picture(cli, tmp_path):
    gb.save_monitor(early_monitor(), tmp_path / "monitor.json")
    given = ("fly", "--rescue", "--detector", "monitor.json", "--figure", "rescue.png", "--json")
    code, out, _ = cli(*given)
    assert code == 0
    told = json.loads(out)["findings"]
    assert {event["flight"] for event in told if event["kind"] == "departure"} == {"unaided"}
    assert (tmp_path / "rescue.png").read_bytes().startswith(b"\x89PNG")
    table = gb.read_recording(tmp_path / "rescue.rrd")
    entities = set(table["entity"])
    assert {"/altitude/unaided", "/altitude/rescued", "/broken/r/read", "/broken/r/rescued"} <= entities
    assert cli(*given)[0] == 2  # both are there by now


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (("--out", "rescue.mp4"), "its name ends in .rrd"),
        (("--figure", "rescue.txt"), "its name ends in .png, .svg or .pdf"),
        (("--trial", "2"), "--trial is of --fault"),
        (("--fault", "in_the_loop", "--trial", "99"), "there is no trial 99 of in_the_loop"),
        (("--fault", "deadzone", "--trial", "1"), "give a figure in deg/s"),
        (("--aircraft", "Camel_", "--detector", "none.json"), "Camel_"),
    ],
)
def test_bad_input_is_one_line(cli, given, said):
    assert said in refused(cli("fly", "--rescue", *given))


def test_nothing_to_rescue_from_is_refused():
    with pytest.raises(gb.InputError, match="nothing breaks"):
        fly_rescue([], None)

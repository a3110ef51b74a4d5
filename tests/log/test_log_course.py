"""Sensors that no gyro enters in the verdict of a log, by default."""

import pytest

import gtmbench as gb
from gtmbench.report.words.verdict import verdict_text
from gtmbench.verdict.timeline import State
from tests.engine.course.test_course_contract import ONSET_S, SIZES, flown
from tests.helpers.night import by_day


def watched(record, folder):
    gb.write_log(record, folder / "log.csv")
    return gb.watch_log(folder / "log.csv", "auto")


@pytest.mark.nightly
def test_an_accelerometer_that_fails_is_in_the_first_line_with_its_size(tmp_path):
    told = watched(gb.inject(flown(), gb.Bias(channel="nz", onset_s=ONSET_S, size=SIZES["nz"])), tmp_path)
    assert int(told.outcome) == 1
    ((sensor, span),) = told.verdict.failed
    assert (sensor, round(span.judgement.parameters["size"], 1)) == ("nz", 0.2)
    assert verdict_text(told).startswith("The vertical accelerometer (nz) failed from ")


@pytest.mark.nightly
def test_one_of_two_that_nobody_asks_is_told_beside_the_all_clear(tmp_path):
    drifts = gb.Drift(channel="altitude", onset_s=ONSET_S, slope=SIZES["altitude"] / 30.0)
    told = watched(gb.inject(flown(), drifts), tmp_path)
    assert int(told.outcome) == 0
    assert verdict_text(told).startswith("No fault found in p, q, r, phi, theta, psi")
    assert "One of the pressure altitude (altitude) and GPS failed from" in verdict_text(told)
    assert told.timeline.at("altitude", 120.0).state is State.SUSPECTED


@pytest.mark.nightly
@pytest.mark.parametrize("seed", by_day([3, 4]))
def test_a_healthy_flight_accuses_no_other_sensor(tmp_path, seed):
    told = watched(flown(seed=seed), tmp_path)
    assert (told.verdict.failed, told.verdict.suspected) == ((), ())

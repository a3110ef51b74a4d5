"""A heading that is missing, reads one value, or begins late: watched without it; and where what is healthy begins."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.log.opening.records import flying_part
from gtmbench.log.opening.without_heading import no_heading, with_heading
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.verdict.timeline import State
from gtmbench.verdict.verdict import Outcome
from tests.helpers.autopilot_logs import truth
from tests.helpers.night import by_day

HEALTHY = [(0.0, 80.0)]


@pytest.fixture(scope="module")
def flown():
    return MECHANISMS["vibration"](3).record


def logged(record, folder, heading):
    """Write a log whose heading is as a function of its row's share and its text says."""
    gb.write_log(record, folder / "log.csv")
    header, *lines = (folder / "log.csv").read_text().splitlines()
    place = next(number for number, name in enumerate(header.split(",")) if name.startswith("psi"))
    rows = [line.split(",") for line in lines]
    for number, row in enumerate(rows):
        row[place] = heading(number / len(rows), row[place])
    (folder / "log.csv").write_text("\n".join([header, *map(",".join, rows)]) + "\n")
    return folder / "log.csv"


HEADINGS = {"zero": lambda _, __: "0", "late": lambda share, read: "" if share < 0.7 else read}
WHY = {"zero": "the heading never changes: psi reads 0 all the time", "late": "psi is missing in 70 % of the log"}


@pytest.mark.parametrize("name", by_day(HEADINGS))
def test_a_heading_of_no_use_leaves_p_and_q_watched_and_says_so(flown, name, tmp_path):
    watched = gb.watch_log(logged(flown, tmp_path, HEADINGS[name]), "auto", healthy=HEALTHY)
    assert watched.verdict.unjudged == ("r", "psi")  # which are asked, too
    assert watched.verdict.exit_code == 3
    for sensor in ("r", "psi"):
        (span,) = watched.timeline.sensors[sensor]
        assert (span.state, span.reason.startswith(WHY[name])) == (State.NOT_JUDGED, True)
    assert watched.reasons[0].endswith("so the log is watched without a heading")
    assert "psi" in watched.unwatched["r"]
    assert {row.sensor for row in watched.certificate.rows} == {"p", "q"}


@pytest.mark.nightly
def test_who_asks_for_the_others_alone_is_told_that_they_are_well(flown, tmp_path):
    log = logged(flown, tmp_path, HEADINGS["zero"])
    assert gb.watch_log(log, "auto", healthy=HEALTHY, judge="p,q,phi,theta").verdict.exit_code == 0


def test_without_a_heading_wrong_signs_are_still_told(flown, tmp_path):
    turned = flown.replace("p", -flown["p"])
    watched = gb.watch_log(logged(turned, tmp_path, HEADINGS["zero"]), "auto", healthy=HEALTHY)
    assert watched.outcome is Outcome.UNKNOWN
    assert "the sign of p is turned" in watched.reasons[0]


def test_a_heading_can_be_left_out_by_hand(flown, tmp_path):
    watched = gb.watch_log(logged(flown, tmp_path, lambda _, read: read), "auto", healthy=HEALTHY, mapping=["psi=none"])
    assert "psi" not in watched.log.channels
    assert "r" in watched.unwatched


def test_why_a_heading_is_of_no_use(flown, tmp_path):
    assert no_heading(gb.open_log(logged(flown, tmp_path, lambda _, read: read))) == ""
    still = gb.open_log(logged(flown, tmp_path, HEADINGS["zero"]))
    assert no_heading(still) == "the heading never changes: psi reads 0 all the time"
    late = gb.open_log(logged(flown, tmp_path, HEADINGS["late"]))
    assert no_heading(late) == "psi is missing in 70 % of the log"


def test_the_heading_that_r_makes_is_the_one_flown():
    flight = truth(30.0, 1)
    made = with_heading(flight.select([name for name in flight.channels if name != "psi"]))
    off = np.unwrap(flight["psi"] - made["psi"], period=360.0)
    assert float(np.ptp(off)) < 0.5


def test_standing_teaches_nothing(flown, tmp_path):
    standing_s = 0.4 * (flown.end_s - flown.start_s)
    values = np.where((flown.time_s < standing_s)[:, np.newaxis], flown.values[0], flown.values)
    values += 0.01 * np.random.default_rng(1).standard_normal(values.shape)
    record = gb.Record(values, channels=flown.channels, sample_period_s=flown.sample_period_s)
    gb.write_log(record, tmp_path / "log.csv")
    log = gb.open_log(tmp_path / "log.csv")
    start_s, end_s = flying_part(log, log.segments)
    assert start_s == pytest.approx(standing_s, abs=2.0)
    assert start_s + 40.0 < end_s < 0.8 * flown.end_s
    assert flying_part(log, ()) == (0.0, pytest.approx(0.4 * flown.end_s, abs=0.1))

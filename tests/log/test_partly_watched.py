"""Logs that can't be watched whole: p and q where the heading tells nothing of r, and a flight but for its crash."""

from dataclasses import replace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.excursion import Excursion
from gtmbench.detectors.monitor.regime import IMPACT
from gtmbench.log.self_check.refusal import SelfCheck, check_watched
from gtmbench.log.watch import watch_log
from gtmbench.report.words.verdict import verdict_text
from gtmbench.verdict.verdict import Outcome
from tests.helpers.autopilot_logs import ardupilot, imus
from tests.helpers.night import by_day
from tests.helpers.watching import cautious, sensed

DURATION_S = 200.0


def misled(*faults, seed=1):
    """Return a flight whose heading turns as it likes."""
    flown = imus(1, faults=[(0, fault) for fault in faults], seed=seed, duration_s=DURATION_S)[0]
    turned = np.cumsum(np.random.default_rng(seed).standard_normal(len(flown)))
    return flown.replace("psi", flown["psi"] + 40.0 * np.sin(0.6 * flown.time_s) + 0.1 * turned)


def watched(tmp_path, record):
    path = tmp_path / "flight.bin"
    path.write_bytes(ardupilot([record]))
    return watch_log(path, "auto")


@pytest.fixture(scope="module")
def healthy(tmp_path_factory):
    return watched(tmp_path_factory.mktemp("log"), misled())


@pytest.mark.nightly
def test_p_and_q_are_watched_where_only_r_is_unexplained_and_that_is_no_all_clear(healthy):
    assert healthy.outcome is Outcome.UNKNOWN
    assert healthy.alarms == ()
    assert not healthy.check.stops
    assert set(healthy.monitor.basis.predicts) == {"p", "q"}
    assert healthy.armed_hours * 3600.0 > 0.3 * DURATION_S
    why = "gyros and attitude don't show one motion, so r or the heading is wrong; p and q are watched without the "
    why += "heading"
    assert verdict_text(healthy) == f"Cannot tell for r and psi: {why}. p, q, phi, theta are clear."
    assert {span.reason for sensor in ("r", "psi") for span in healthy.timeline.sensors[sensor]} == {why}
    assert healthy.verdict.unjudged == ("r", "psi")
    assert healthy.unwatched["r"] in healthy.reasons


@pytest.mark.parametrize("channel", by_day(["p", "q"], 0))
def test_a_fault_of_p_or_q_is_found_there(tmp_path, channel):
    found = watched(tmp_path, misled(gb.Jam(channel=channel, onset_s=150.0)))
    assert found.outcome is Outcome.FAILED
    assert all(channel in alarm.candidates and alarm.sensor in (None, channel) for alarm in found.alarms)


@pytest.mark.nightly
@pytest.mark.parametrize("channel", by_day(["p", "q"]))
def test_a_log_in_which_more_than_r_is_unexplained_is_refused_as_before(tmp_path, channel):
    record = misled()
    shaken = 60.0 * np.sin(3.0 * record.time_s + 5.0 * np.sin(0.1 * record.time_s))
    refused = watched(tmp_path, record.replace(channel, record[channel] + shaken))
    assert refused.outcome is Outcome.UNKNOWN
    assert refused.check.stops
    assert refused.watches == ()


# ---- crashes ----


def tumbled(record, start_s, end_s):
    """Return a record in which the gyros turn wildly, and the attitude doesn't follow."""
    during = (record.time_s >= start_s) & (record.time_s < end_s)
    return record.replace("p", record["p"] + np.where(during, 300.0 * np.sin(record.time_s), 0.0))


class Remarkless:
    remarks = ()


def test_an_impact_after_which_it_flies_on_leaves_nothing_unexplained():
    """Tell so where no alarm tells of it."""
    monitor, rest = cautious(), sensed().between(60.01, sensed().end_s)
    about = Excursion(start_s=89.5, end_s=93.5, reason=IMPACT, is_hard=True)
    watches = [replace(monitor.watch(tumbled(rest, 90.0, 93.0), outside=[about]), alarms=())]
    as_told = check_watched(SelfCheck(), monitor, watches, Remarkless(), (), [about])
    assert as_told.doubts == ()
    unaware = check_watched(SelfCheck(), monitor, watches, Remarkless(), (), [])
    assert str(unaware.doubts[0]).startswith("in the part watched, ")

"""Contacts with the ground: what they raise isn't judged, and never clear; a crash, and what follows it."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.excursion import MOTION, Excursion
from gtmbench.detectors.monitor.regime import FAILURE, IMPACT, PUSHED, TOUCHDOWN, Regime
from gtmbench.log.judging.claims import of_alarm
from gtmbench.report.words.verdict import verdict_text
from gtmbench.verdict.timeline import State
from tests.helpers.night import by_day
from tests.helpers.watching import cautious, sensed


def rest(until_s=140.0):
    return sensed().between(60.01, min(until_s, sensed().end_s))


def bumped(record, start_s=100.0, end_s=103.0):
    """Return a record in which gyros ring, which the attitude doesn't follow."""
    during = (record.time_s >= start_s) & (record.time_s < end_s)
    for number, name in enumerate("pqr"):
        ringing = 15.0 * np.sin(2.0 * np.pi * (7.0 + number) * (record.time_s - start_s))
        record = record.replace(name, record[name] + np.where(during, ringing, 0.0))
    return record


def watched(record, about):
    return cautious().watch(record, outside=[about]).faults


@pytest.mark.parametrize("reason", by_day([IMPACT, TOUCHDOWN, PUSHED, MOTION, FAILURE], 2))
@pytest.mark.parametrize("is_hard", by_day([False, True]))
def test_what_a_contact_raises_is_never_clear_and_what_follows_its_end_is_not_excused(reason, is_hard):
    about = Excursion(start_s=99.5, end_s=103.5, reason=reason, is_hard=is_hard)
    claims = [claim for alarm in watched(bumped(rest()), about) for claim in of_alarm(alarm, 140.0, (), "", [about])]
    assert claims
    assert {span.state for _, span in claims} == {State.NOT_JUDGED}
    assert {span.reason for _, span in claims} == {reason}
    assert max(span.end_s for _, span in claims) <= 110.0


@pytest.mark.parametrize("is_hard", by_day([False, True]))
def test_a_fault_that_begins_with_a_contact_and_lasts_is_not_judged_to_the_end(is_hard):
    about = Excursion(start_s=99.5, end_s=103.0, reason=IMPACT, settles_s=np.inf, is_hard=is_hard)
    alarms = watched(gb.inject(rest(), gb.Bias(channel="q", onset_s=100.0, size=3.0)), about)
    spans = [span for alarm in alarms for name, span in of_alarm(alarm, 140.0, (), "", [about]) if name == "q"]
    assert {span.state for span in spans} == {State.NOT_JUDGED}
    assert max(span.end_s for span in spans) == 140.0


def test_accelerometers_alone_tell_of_no_contact_and_nothing_that_lasts_is_one():
    steady = sensed().between(0.0, 60.0)
    regime, turned = Regime.of([steady]), steady
    during = (steady.time_s > 30.0) & (steady.time_s < 30.5)
    pushed = steady.replace("nz", np.where(during, 8.0, steady["nz"]))
    (soft,) = [each for each in regime.excursions(pushed) if each.reason == PUSHED]
    for_long = steady.replace("nz", np.where(steady.time_s > 30.0, 8.0, steady["nz"]))
    assert {each.reason for each in regime.excursions(for_long)} <= {MOTION}
    rolling = np.where(during, 400.0, 0.0)
    angle = np.cumsum(rolling) * steady.sample_period_s
    turned = pushed.replace("p", steady["p"] + rolling).replace("phi", steady["phi"] + angle)
    hard = next(each for each in regime.excursions(turned) if each.start_s < 30.2 < each.end_s)
    assert (soft.is_hard, hard.is_hard, hard.reason) == (False, True, IMPACT)


@pytest.mark.nightly
@pytest.mark.parametrize("has_events", by_day([False, True]))
def test_a_crash_at_the_end_is_said_beside_what_was_judged_before_it(tmp_path, has_events):
    record = sensed() if has_events else bumped(sensed(), 136.0, 140.0)
    if not has_events:
        late = record.time_s > 135.9
        rolled = np.cumsum(np.where(late, 500.0, 0.0)) * record.sample_period_s
        record = record.replace("p", record["p"] + np.where(late, 500.0, 0.0)).replace("phi", record["phi"] + rolled)
        record = record.replace("nz", np.where(late, 9.0, record["nz"]))
    gb.write_log(record, tmp_path / "log.csv")
    said = gb.watch_log(tmp_path / "log.csv", "C", healthy=[(0, 60)])
    assert said.verdict.exit_code == 0
    assert verdict_text(said).startswith("No fault found in p, q, r, phi, theta, psi: ")
    for sensor in said.verdict.scope.sensors:
        assert said.timeline.at(sensor, 100.0).state is State.CLEAR
        end = said.timeline.at(sensor, 139.0)
        if has_events:
            assert end.state in (State.CLEAR, State.NOT_JUDGED)
            assert end.reason != IMPACT
        else:
            assert (end.state, end.reason) == (State.NOT_JUDGED, IMPACT)
            assert end.start_s == pytest.approx(135.4, abs=0.1)

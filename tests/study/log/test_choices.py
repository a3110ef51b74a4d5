"""Where nobody says what is healthy, a sensor is accused only if another choice of it accuses, too."""

import pytest

import gtmbench as gb
from gtmbench.study.log import choices
from gtmbench.testing.mechanisms import MECHANISMS
from gtmbench.verdict.verdict import Outcome

ONSET_S = 140.0


@pytest.fixture(scope="module")
def broken(tmp_path_factory):
    """Return a log whose q is biased from an onset on: what only a monitor that was learnt tells."""
    path = tmp_path_factory.mktemp("choices") / "log.csv"
    record = MECHANISMS["plain"](3).record.select(["p", "q", "r", "phi", "theta", "psi"])
    gb.write_log(gb.inject(record, gb.Bias(channel="q", onset_s=ONSET_S, size=8.0)), path)
    return path


def accused(watched):
    return {alarm.sensor for alarm in watched.alarms if alarm.sensor is not None and not alarm.doubt}


def test_who_fails_by_both_choices_is_accused(broken):
    watched = gb.watch_log(broken, "auto", attitude="own")
    assert (watched.outcome, accused(watched)) == (Outcome.FAILED, {"q"})
    assert watched.is_assumed_healthy


def test_whom_the_other_choice_clears_is_doubted_and_both_choices_are_said(broken, monkeypatch):
    def too_little(*_):
        raise gb.InputError("too little")

    monkeypatch.setattr(choices, "learnt", too_little)
    watched = gb.watch_log(broken, "auto", attitude="own")
    assert (watched.outcome, accused(watched)) == (Outcome.UNKNOWN, set())
    doubts = [alarm.doubt for alarm in watched.alarms if alarm.doubt]
    assert any("s are taken as healthy, not if 0 to" in doubt for doubt in doubts)
    assert accused(gb.watch_log(broken, "auto", healthy=[(0.0, 80.0)], attitude="own")) == {"q"}

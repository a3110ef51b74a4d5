"""A name that an earlier look gave isn't replaced by another: one of both was wrong, and nobody knows which."""

from dataclasses import replace

import pytest

import gtmbench as gb
from gtmbench.detectors.monitor.open_fault_review import _consistent_with_earlier

ALARM = gb.Alarm(number=0, time_s=81.0, onset_s=80.0, source="q", test="mean")
R = gb.Judgement(time_s=101.0, sensor="r", candidates=("r",), kind="bias")
Q = gb.Judgement(time_s=141.0, sensor="q", candidates=("q",), kind="random_walk")
OPEN = gb.Judgement(time_s=83.0, sensor=None, candidates=("q", "r"))
BOTH = replace(Q, sensor=None, candidates=("q", "phi"), together=(Q, replace(Q, sensor="phi", candidates=("phi",))))


def after(*before, now):
    return _consistent_with_earlier(now, replace(ALARM, judgements=before))


@pytest.mark.parametrize("now", [Q, BOTH])
def test_another_name_leaves_both(now):
    said = after(OPEN, R, now=now)
    assert said.failed == ()
    assert set(said.candidates) == {*now.candidates, "r"}
    assert said.reason == "earlier looks named another sensor"


@pytest.mark.parametrize(
    ("before", "now"),
    [((OPEN,), Q), ((R,), R), ((R,), OPEN), ((Q,), BOTH), ((R.naming_nobody("motion"),), Q)],
    ids=["first name", "same name", "no name", "one of several", "a doubtful name"],
)
def test_all_else_stays(before, now):
    assert after(*before, now=now) is now

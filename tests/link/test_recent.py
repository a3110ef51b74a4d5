"""The last two minutes of a link, judged by the engine: what comes too slowly for a monitor is told, once."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.link import closing as module
from gtmbench.link.closing import Recent
from tests.helpers import monitors

SLOW = gb.Drift(channel="r", onset_s=150.0, slope=0.03)


@pytest.fixture(scope="module")
def flown():
    return monitors.record(15_000, seed=5)  # 300 s


def said(record, *, piece=500):
    last = Recent(is_driven=False, is_assumed=False)
    parts = [record.part(range(k, min(k + piece, len(record)))) for k in range(0, len(record), piece)]
    return [alarm for part in parts for alarm in last.push(part)]


@pytest.mark.nightly
def test_a_slow_drift_is_told_once_while_it_flies(flown):
    (alarm,) = said(gb.inject(flown, SLOW))
    assert (alarm.sensor, alarm.accuses) == ("r", True)
    assert abs(alarm.onset_s - SLOW.onset_s) < 20.0
    assert alarm.onset_s < alarm.time_s < 240.0


@pytest.mark.nightly
def test_nothing_is_told_of_a_healthy_flight_or_of_rows_without_an_attitude(flown):
    assert said(flown) == []
    assert said(gb.inject(flown, SLOW).select(("p", "q", "r"))) == []
    assert said(flown.replace("psi", np.full(len(flown), np.nan))) == []


@pytest.mark.nightly
def test_the_same_is_told_however_rows_are_cut(flown):
    broken = gb.inject(flown, SLOW)
    one, other = (said(broken, piece=piece) for piece in (50, 250))
    assert [(each.sensor, each.time_s) for each in one] == [(each.sensor, each.time_s) for each in other]


def test_the_work_is_bounded_however_long_it_flies(flown, monkeypatch):
    """No more than two minutes are judged, and no sooner than ten seconds after the last time."""
    lengths = []

    def counted(flight):
        lengths.append(len(flight) * flight.blocks.period_s)
        return type("Nobody", (), {"alarms": ()})

    monkeypatch.setattr(module, "judged", counted)
    said(flown)
    assert 110.0 < max(lengths) < 135.0
    assert len(lengths) <= 300.0 / 10.0

"""The study of what a verdict promises: which fault is put, what of a timeline is a breach, what is counted."""

import re
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import gtmbench as gb
import verdict_promises as study
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import SensorSpan, Sizes, State, laid_out
from gtmbench.verdict.verdict import verdict_of
from studies.conduct import Campaign

SIZES = Sizes(error=0.5, within_s=60.0, factors=(0.64, 1.44), noise=2.0)
END_S = 90.0


def timeline(*claims, sensor="q", others=()):
    clear = SensorSpan(start_s=0.0, end_s=END_S, state=State.CLEAR, sizes=SIZES)
    names = {name: [clear] for name in study.CHANNELS}
    return laid_out((0.0, END_S), names | {sensor: list(claims)} | dict(others), motion_s=[(0.0, END_S)])


def span(start_s, end_s, state, sizes=None):
    return SensorSpan(start_s=start_s, end_s=end_s, state=state, sizes=sizes)


CLEAR = span(0.0, END_S, State.CLEAR, SIZES)
HEALTHY = timeline(CLEAR)


@pytest.mark.parametrize(
    ("kind", "times", "draw", "expected"),
    [
        ("bias", 1.0, 1, gb.Bias(channel="q", onset_s=20.0, size=0.5)),
        ("bias", 1.5, 0, gb.Bias(channel="q", onset_s=20.0, size=-0.75)),
        ("drift", 1.5, 1, gb.Drift(channel="q", onset_s=20.0, slope=0.05)),
        ("factor", 1.0, 0, gb.ScaleFactor(channel="q", onset_s=20.0, factor=0.64)),
        ("factor", 1.5, 0, gb.ScaleFactor(channel="q", onset_s=20.0, factor=0.512)),
        ("factor", 1.5, 1, gb.ScaleFactor(channel="q", onset_s=20.0, factor=1.728)),
        ("sign", 1.0, 0, gb.SignFlip(channel="q", onset_s=20.0)),
        ("stuck", 1.0, 0, gb.Jam(channel="q", onset_s=20.0)),
        ("noise", 1.5, 7, gb.Noise(channel="q", onset_s=20.0, deviation=3.0, seed=7)),
    ],
)
def test_a_fault_has_the_size_that_is_promised(kind, times, draw, expected):
    fault = study.fault_at(kind, "q", 20.0, times, SIZES, draw).fault
    assert type(fault) is type(expected)
    for name in ("size", "slope", "factor", "deviation", "seed"):
        assert getattr(fault, name, None) == pytest.approx(getattr(expected, name, None))


@pytest.mark.parametrize("kind", ["factor", "sign", "stuck", "noise"])
def test_what_isnt_promised_isnt_put(kind):
    assert study.fault_at(kind, "q", 20.0, 1.0, Sizes(error=0.5, within_s=60.0), 0) is None


def told(kind, broken, times=1.0):
    put = study.fault_at(kind, "q", 20.0, times, SIZES, 0)
    return study.told_of(put, broken, HEALTHY)


@pytest.mark.parametrize("kind", study.PUT)
def test_a_fault_that_is_called_clear_is_a_breach(kind):
    row = told(kind, HEALTHY)
    assert row["clear"]
    assert row["breach"]
    assert row["breach_s"] == pytest.approx(15.0 if kind == "drift" else 29.5)  # a drift has to reach its size
    assert not row["failed"] | row["suspected"] | row["not judged"]


@pytest.mark.parametrize("kind", study.PUT)
def test_a_larger_size_that_is_stated_there_is_no_breach(kind):
    loud = Sizes(error=1.1, within_s=60.0, factors=(-1.5, 3.0), noise=3.5)
    row = told(kind, timeline(span(0.0, END_S, State.CLEAR, loud)))
    assert row["clear"]
    assert not row["breach"]


def test_what_is_clear_before_it_failed_is_a_breach_that_lasts():
    row = told("bias", timeline(span(0.0, 23.0, State.CLEAR, SIZES), span(23.0, END_S, State.FAILED)))
    assert (row["breach"], row["failed"]) == (True, True)
    assert row["breach_s"] == pytest.approx(2.5)


def test_states_are_told_apart():
    assert told("bias", timeline(span(20.0, END_S, State.SUSPECTED)))["suspected"]
    assert told("bias", timeline())["not judged"]
    with_other = timeline(span(20.0, END_S, State.FAILED), others={"theta": [span(25.0, END_S, State.FAILED)]})
    assert told("bias", with_other)["wrong"] == "theta"


def test_a_broken_gyro_enters_the_estimator_and_a_broken_angle_doesnt():
    log = study.Log(5, 20.0, 25, "multisine", "white", "filter 5 s")
    truth = gb.fly("gtm", "multisine", 20.0, 5)
    clean = study.logged(log, truth)
    gyro = study.logged(log, truth, gb.Bias(channel="p", onset_s=10.0, size=5.0))
    angle = study.logged(log, truth, gb.Bias(channel="phi", onset_s=10.0, size=5.0))
    assert clean.sample_period_s == pytest.approx(0.04)
    assert gyro["p"][-1] - clean["p"][-1] == pytest.approx(5.0)
    assert gyro["phi"][-1] - clean["phi"][-1] > 10.0
    assert np.array_equal(angle["p"], clean["p"])
    assert angle["phi"][-1] - clean["phi"][-1] == pytest.approx(5.0)


@pytest.fixture
def blind(monkeypatch):
    """Watch by a detector that calls everything clear, whatever it reads, but for what stands still."""

    def watched_by(_detector, log, record):
        stands = [name for name in study.GYROS if np.ptp(record[name][-20:]) == 0.0]
        spans = {name: [span(0.0, log.duration_s, State.CLEAR, SIZES)] for name in study.CHANNELS}
        spans |= {name: [span(0.0, log.duration_s, State.FAILED)] for name in stands}
        line = laid_out((0.0, log.duration_s), spans, motion_s=[(0.0, log.duration_s)])
        certificate = SimpleNamespace(of=lambda _, kind: SimpleNamespace(size=0.4) if kind == "bias" else None)
        verdict = verdict_of(line, Scope(sensors=study.GYROS))
        return SimpleNamespace(timeline=line, verdict=verdict, certificate=certificate)

    monkeypatch.setattr(study, "watched_by", watched_by)


def conducted(*only, quick=False, **given):
    size = {"seed": 3, "draws": 18, "healthy": 2, "faults": 8, "kept": None} | given
    return study.conduct(Campaign(quick, 1, lambda *_: None, SimpleNamespace(only=only, **size)))


@pytest.mark.usefixtures("blind")
def test_a_blind_detector_breaks_every_promise(tmp_path):
    found = conducted("promises")
    assert found.missed
    found.write(tmp_path)
    rows = study.put_in(pd.read_csv(tmp_path / "rows.csv"))
    sized = rows[~rows["kind"].isin(["stuck"])]
    assert len(sized)
    left_s = np.minimum(30.0, sized["duration_s"] - sized["onset_s"])
    assert (sized["breach"] == (left_s > np.where(sized["kind"] == "drift", 15.0, 0.5))).mean() > 0.95
    assert rows[rows["kind"] == "stuck"]["failed"].all()
    assert "| stuck " in found.text
    assert "Breaches:" in found.text


@pytest.mark.usefixtures("blind")
def test_healthy_logs_and_the_catalogue_are_counted(tmp_path):
    found = conducted("healthy", "catalogue")
    assert not found.missed  # 0.5 over 0.4 is 1.25
    found.write(tmp_path)
    rows = pd.read_csv(tmp_path / "rows.csv")
    assert rows["part"].value_counts().to_dict() == {"catalogue": 16, "healthy": 4}
    assert rows[rows["part"] == "healthy"]["over p"].tolist() == pytest.approx([1.25] * 4)
    assert re.search(r"\| stated size over certificate, median +\| 1.25 ", found.text)

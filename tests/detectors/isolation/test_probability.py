"""How probable judgements are: more with time and margin, never certain, and a name only with 99 %."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.detectors.alarm import MOST_PROBABLE
from gtmbench.detectors.isolation import probability
from gtmbench.detectors.isolation.fits import interval, intervals_of
from gtmbench.detectors.isolation.probability import NAMES, Odds
from tests.helpers import monitors

ODDS = [probability.NAMED, probability.SUSPECTED, probability.TOGETHER, probability.KIND, probability.KIND_HELD]


@pytest.mark.parametrize("odds", ODDS)
def test_time_and_margin_make_it_more_probable_but_never_certain(odds):
    seconds, margins = np.meshgrid(np.linspace(0.0, 60.0, 30), [-500.0, -20.0, 0.0, 5.0, 100.0, math.inf])
    found = odds.probabilities(seconds, margins)
    assert (np.diff(found, axis=0) >= 0.0).all()
    assert (np.diff(found, axis=1) >= 0.0).all()
    assert 0.0 < found.min() < found.max() <= MOST_PROBABLE


def test_odds_are_those_of_the_formula():
    found = Odds(0.3, 0.7, 1.1).probabilities(np.array([2.0]), np.array([-30.0]))[0]
    assert math.log(found / (1.0 - found)) == pytest.approx(0.3 + 0.7 * math.log(21.0) - 1.1 * math.log(4.0))


@pytest.fixture(scope="module")
def alarms():
    """Return what is said of faults of which some take time."""
    faults = [
        gb.Bias(channel="p", onset_s=60.0, size=0.8),
        gb.ScaleFactor(channel="r", onset_s=60.0, factor=1.4),
        gb.Lag(channel="theta", onset_s=60.0, lag_s=0.1),
        gb.Jam(channel="q", onset_s=60.0),
        gb.Swap(channel="p", onset_s=60.0, other="q"),
    ]
    healthy = monitors.record(6000, seed=11)
    return [monitors.monitor("C").watch(gb.inject(healthy, fault)).faults[0] for fault in faults]


def test_who_is_named_has_99_percent_and_who_is_accused_has_a_probability(alarms):
    judged = [each for alarm in alarms for each in alarm.judgements[1:] if each.candidates and not each.doubt]
    assert any(each.sensor for each in judged)
    for each in judged:
        assert each.probability is not None
        assert each.sensor is None or each.probability >= NAMES
        assert (each.kind_probability is None) == (each.kind in (None, "unknown"))


def test_a_name_below_that_becomes_a_choice_of_whom_explains_nearly_as_much(alarms, monkeypatch):
    named = alarms[0].last
    monkeypatch.setattr(probability, "NAMES", 1.0)
    fault = gb.Bias(channel="p", onset_s=60.0, size=0.8)
    alarm = monitors.monitor("C").watch(gb.inject(monitors.record(6000, seed=11), fault)).faults[0]
    assert named.sensor == "p"
    assert all(judged.sensor is None for judged in alarm.judgements[1:])
    assert {"p", "phi"} <= set(alarm.candidates)


def test_intervals_are_about_the_value_and_a_bound_has_one_side():
    low, high = interval(3.0, 0.5)
    assert high - 3.0 == pytest.approx(3.0 - low)
    assert high - 3.0 == pytest.approx(1.96 * 1.3 * 0.5)
    assert interval(1.0, math.inf) == (1.0, math.inf)
    assert interval(0.01, -math.inf) == (0.0, 0.01)


def test_a_parameter_at_the_end_of_its_search_is_told_as_a_bound():
    late = gb.inject(monitors.record(6000, seed=11), gb.Delay(channel="p", onset_s=60.0, delay_s=1.8))
    kinds = {judged.kind: judged for judged in monitors.monitor("C").watch(late).faults[0].judgements}
    bounds = [each.intervals for each in kinds.values() if math.inf in sum(each.intervals.values(), ())]
    values = [each.parameters for each in kinds.values() if "delay_s" in each.parameters or "lag_s" in each.parameters]
    assert bounds or not values  # it is not within a second late: nobody says by how much


def test_errors_that_nobody_knows_have_no_interval_and_a_walks_is_twice_as_wide():
    parameters, errors = {"slope": 1.0, "onset_s": 3.0}, {"slope": 0.1, "onset_s": math.nan}
    bias, walk = (
        intervals_of(SimpleNamespace(kind=kind, parameters=parameters, errors=lambda: errors))
        for kind in ("bias", "random_walk")
    )
    assert set(bias) == {"slope"}
    assert np.ptp(walk["slope"]) == pytest.approx(2.0 * np.ptp(bias["slope"]))


def test_a_doubted_judgement_accuses_nobody_and_has_no_probability():
    judged = gb.Judgement(time_s=1.0, sensor=None, candidates=("p",), doubt="the noise changed")
    assert probability.with_probability(None, (), judged) is judged
    nothing = replace(judged, candidates=(), doubt="")
    assert probability.with_probability(None, (), nothing) is nothing

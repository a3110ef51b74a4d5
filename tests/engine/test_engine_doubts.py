"""Rules under which a finding names nobody, one by one: each has a finding that it stops and one that it lets pass."""

from dataclasses import replace

import numpy as np
import pytest

from gtmbench.engine.doubts import _bears_out, with_doubts
from gtmbench.engine.explanation import Explanation
from gtmbench.engine.finding import Side
from tests.engine.conftest import DURATION_S, frozen, model_of, nothing
from tests.helpers.turning import from_on, motion, with_error


def alone(model, one):
    (found,) = with_doubts(model, [one])
    return found


def names(model, *found):
    return [each.named for each in with_doubts(model, found)]


# what nothing speaks against ---------------------------------------------------------------------


@pytest.mark.parametrize("name", ["p bias", "q bias", "r bias (7 s)", "p drift", "q scale", "r noise", "q deadzone"])
def test_a_finding_that_stays_and_shows_in_its_own_axis_names_its_sensor(model, finding, name):
    found = alone(model, finding(name, size=0.5))
    assert found.named == name[0]
    assert (found.doubt, found.others) == ("", ())


@pytest.mark.parametrize(
    ("name", "rest", "why"),
    [
        ("q noise", {"end_s": 66.0}, "it lasts 6 s"),
        ("q bias", {"own_axis": 8.0, "shown": 60.0}, "q's own axis hardly shows it"),
        ("q scale", {"size": 1.0}, "q and the attitude show no one motion"),
        ("q bias", {"side": Side.OPEN}, "q is off before or after it"),
        ("q drift", {"size": 0.015}, "q drifts by 2.1 deg/s, as an estimator does that learns its offset"),
        ("q bias", {"onset_s": 5.0, "shows_s": 107.0}, "it shows after 102 s, and 5 s are known before it"),
    ],
)
def test_one_rule_is_enough_to_name_nobody(model, finding, name, rest, why):
    found = alone(model, finding(name, **rest))
    assert (found.named, found.doubt) == (None, why)


def test_a_rule_that_asks_for_others_or_for_fast_gyros_is_enough_too(model, finding):
    (gyro, angle) = with_doubts(model, [finding("q bias"), finding("theta scale", size=0.4, evidence=60.0)])
    assert gyro.doubt == "theta seems to fail with it, and one may be what the other leaves"
    assert "q seems to fail with it" in angle.doubt
    (near, _) = with_doubts(model, [finding("q bias", size=0.5), finding("p bias", 61.0, size=10.0)])
    assert near.doubt.endswith("p is off so far that it shows about this axis, too")
    seldom = replace(model, flight=replace(model.flight, gyro_step_s=0.15))
    assert (
        alone(seldom, finding("q scale", size=0.5)).doubt == "gyros are sampled every 0.15 s, too seldom for a factor"
    )
    assert alone(model, finding("q bias", end_s=80.0)).others == ("references",)


def test_nothing_found_leaves_nothing_to_doubt(model):
    assert with_doubts(model, []) == ()


def test_a_finding_that_is_left_with_two_suspects_or_a_healthy_cause_names_nobody(model, finding):
    assert names(model, finding(("q bias", "p bias"))) == [None]
    assert names(model, finding(("q bias", "references lean of pitch"))) == [None]
    assert names(model, finding(("q bias", "q bias (7 s)", "q drift"))) == ["q"]


def test_doubts_change_nothing_but_the_doubts(model, finding):
    one = finding(("q bias", "q drift"), end_s=66.0)
    found = alone(model, one)
    assert found.doubt
    assert replace(found, doubt="", others=()).__dict__ == one.__dict__


# one fault, one finding --------------------------------------------------------------------------


def test_findings_of_one_suspect_that_follow_each_other_are_one_faults(model, finding):
    first, then = finding(end_s=100.0, evidence=40.0, own_axis=30.0, shown=35.0), finding("q drift", 120.0)
    (found,) = with_doubts(model, [then, first])
    assert (found.onset_s, found.end_s, found.first, found.last) == (60.0, DURATION_S, first.first, then.last)
    assert found.best.kind == "drift"  # the strongest says what it is
    assert found.onset_range_s == first.onset_range_s
    assert (found.evidence, found.own_axis, found.shown) == (140.0, 120.0, 130.0)
    assert found.named == "q"


def test_findings_of_two_suspects_that_follow_each_other_are_two_faults(model, finding):
    assert names(model, finding(end_s=100.0), finding("p bias", 110.0)) == ["q", "p"]
    both = finding(("q bias", "p bias"), end_s=100.0), finding("q bias", 110.0)
    assert names(model, *both) == [None, "q"]


def test_three_findings_in_a_row_are_one_faults(model, finding):
    parts = [finding(onset_s=onset_s, end_s=onset_s + 30.0) for onset_s in (40.0, 90.0, 140.0)]
    (found,) = with_doubts(model, parts)
    assert (found.onset_s, found.end_s, found.evidence) == (40.0, 170.0, 300.0)


# at once -----------------------------------------------------------------------------------------


def test_all_gyros_at_once_are_the_attitudes_or_the_loggers(model, finding):
    three = [finding(f"{gyro} bias", 60.0 + late) for gyro, late in (("p", 0.0), ("q", 1.0), ("r", 2.0))]
    assert names(model, *three) == [None, None, None]
    assert all("references" in each.others for each in with_doubts(model, three))
    assert names(model, *three[:2]) == ["p", "q"]
    three[2] = replace(three[2], onset_s=70.0)
    assert names(model, *three) == ["p", "q", "r"]


def test_noise_of_two_gyros_at_once_is_what_shakes_the_aircraft(model, finding):
    assert names(model, finding("p noise"), finding("r noise", 61.0)) == [None, None]
    assert names(model, finding("p noise"), finding("r noise", 90.0)) == ["p", "r"]
    assert names(model, finding("p noise"), finding("r bias", 61.0)) == ["p", "r"]


def test_a_gyro_that_stands_still_is_named_whatever_the_others_do(model, finding):
    stuck = frozen("q", 60.0, 65.0)
    assert names(model, stuck) == ["q"]
    assert names(model, stuck, finding("p bias"), finding("r bias")) == ["q", "p", "r"]


# what passes -------------------------------------------------------------------------------------


def test_what_passes_is_told_on_the_logs_own_clock(finding):
    own = model_of(motion(DURATION_S, seed=5, start_s=1000.0))
    shifted = {"onset_s": 1020.0, "end_s": 1200.0, "first": 19, "last": 200}
    assert alone(own, finding(**shifted, side=Side.BEFORE)).named is None
    assert alone(own, finding(**{**shifted, "onset_s": 1060.0, "end_s": 1080.0, "first": 59, "last": 80})).named is None
    assert alone(own, finding(**{**shifted, "onset_s": 1060.0, "first": 59})).named == "q"


# what is cancelled -------------------------------------------------------------------------------


def test_a_healthy_cause_as_strong_on_the_same_axis_cancels(model, finding):
    leans = finding("references lean of pitch", 70.0, evidence=60.0)
    found = {each.best.suspect: each for each in with_doubts(model, [finding("q bias"), leans])}
    assert found["q"].others == ("references",)
    assert found["q"].named is None
    assert found["references"].doubt == ""


# what an accusation needs ------------------------------------------------------------------------


def test_a_gyro_that_has_nothing_to_do_with_the_attitude_explains_itself_whatever_the_gain(finding):
    record = motion(DURATION_S, seed=5)
    own = np.convolve(np.random.default_rng(3).standard_normal(len(record)), np.ones(20), "same") * 3.0
    apart = model_of(record.replace("q", own))
    assert "no one motion" in alone(apart, finding("q scale", size=0.4)).doubt
    assert alone(apart, finding("p scale", size=0.4)).named == "p"


@pytest.fixture(scope="module")
def stormy():
    """A log that moves ten times as much in its last 50 s."""
    record = motion(DURATION_S, seed=5, large_deg=(2.0, 1.5, 4.0))
    loud = motion(DURATION_S, seed=5, large_deg=(20.0, 15.0, 40.0))
    late = record.time_s > 150.0
    for name in record.channels:
        record = record.replace(name, np.where(late, loud[name], record[name]))
    return model_of(record)


def test_nothing_is_judged_in_motion_that_the_rest_of_the_log_has_not_seen(stormy, finding):
    found = alone(stormy, finding(onset_s=150.0))
    assert found.named is None
    assert "moves more" in found.doubt
    assert alone(stormy, finding(onset_s=60.0, end_s=120.0)).named == "q"
    assert alone(stormy, finding(onset_s=60.0)).named == "q"  # mostly as calm as before


def test_both_sides_are_asked_where_either_may_be_the_broken_one(stormy, finding):
    calm = {"onset_s": 30.0, "end_s": 150.0}
    assert alone(stormy, finding(**calm, side=Side.AFTER)).named == "q"
    rest = {"onset_s": 2.0, "end_s": 150.0}  # without it only the storm is left
    assert alone(stormy, finding(**rest, side=Side.AFTER)).named == "q"
    assert "moves more" in alone(stormy, finding(**rest, side=Side.OPEN)).doubt


def test_a_finding_in_which_nothing_is_known_names_nobody(finding):
    record = motion(DURATION_S, seed=5)
    blank = model_of(record.replace("phi", np.where(record.time_s > 150.0, np.nan, record["phi"])))
    assert alone(blank, finding(onset_s=155.0)).named is None
    assert alone(blank, finding(onset_s=60.0)).named == "q"


def test_no_other_axis_is_judged_while_a_gyro_bends_the_attitude_far(model, finding):
    """A bias of 6 deg/s through an estimator of 7 s ends up 42 deg off."""
    bends = finding("p bias (7 s)", 40.0, size=6.0)
    found = {each.best.suspect: each for each in with_doubts(model, [bends, finding("q bias", 80.0)])}
    assert found["p"].named == "p"
    assert found["q"].named is None
    assert "bends the attitude by 4" in found["q"].doubt


# healthy causes ----------------------------------------------------------------------------------


def test_a_healthy_cause_is_not_doubted_and_names_nobody(model, finding):
    for onset_s, end_s in ((60.0, 66.0), (60.0, DURATION_S)):
        found = alone(model, finding("references lean of pitch", onset_s, end_s, own_axis=0.0))
        assert (found.named, found.doubt, found.is_healthy) == (None, "", True)


def test_reasons_are_told_one_after_another(model, finding):
    found = alone(model, finding("q noise", 60.0, 66.0))
    both = alone(model, finding("q bias", 60.0, 66.0, own_axis=1.0))
    assert len(both.doubt.split("; ")) > len(found.doubt.split("; ")) == 1


def test_a_real_bias_is_found_without_a_doubt_by_its_own_model(finding):
    own = model_of(with_error(motion(DURATION_S, seed=5), "q", from_on(60.0, 3.0)))
    assert alone(own, finding(size=3.0)).named == "q"


# which side, and what estimators learn -----------------------------------------------------------


def test_beside_an_angle_that_may_follow_the_gyros_nobody_is_named(model, finding):
    both = finding(("r bias", "psi drift"))
    assert alone(model, both).doubt == "psi may follow the gyros"
    own = replace(model, flight=replace(model.flight, is_driven=False))
    assert alone(own, both).doubt == ""
    assert alone(own, both).suspects == ("r", "psi")


def test_of_two_gyros_behind_one_estimator_neither_is_named_that_the_other_bends(model, finding):
    """A slow drift that seems to stand alone, and the scale of another gyro behind an estimator of 16 s, later."""
    drifts, scaled = finding("p drift", 50.0, size=0.3), finding("r scale (16 s)", 120.0, size=1.5)
    found = {each.best.suspect: each for each in with_doubts(model, [drifts, scaled])}
    assert found["r"].doubt.startswith("p bends the attitude by ")
    assert alone(model, scaled).named == "r"


def test_what_bends_the_attitude_by_the_fastest_estimator_bends_it_by_any(model, finding):
    """A drift that ends up 30 deg/s off, by an estimator that nobody can tell, and a small bias of another gyro."""
    both = [finding("q drift", 40.0, size=0.2), finding("r bias", 120.0, size=2.0)]
    told = {each.best.suspect: each for each in with_doubts(model, both)}
    assert (told["q"].named, told["r"].named) == ("q", None)
    assert told["r"].doubt.startswith("q bends the attitude by ")
    own = replace(model, flight=replace(model.flight, is_driven=False))
    assert [each.named for each in with_doubts(own, both)] == ["q", "r"]


# gains that further IMUs show -------------------------------------------------------------------------------------


@pytest.mark.parametrize("sensor", ["q", "q of IMU2"])
@pytest.mark.parametrize("gain", [-1.0, 0.4])
def test_shares_of_turns_bear_out_a_gain_that_changes_them_by_half_of_what_it_does(finding, sensor, gain):
    """A gyro that reads f = 1 / (1 - k) of its turns: beside it a healthy one reads 1 / f of that, and it f of hers."""
    gyro = (Explanation(suspect=sensor, kind="scale", effect=nothing), 0.0)
    told = finding(size=gain, ranked=(gyro,))
    reads = 1.0 / (1.0 - gain)
    does = (1.0 / reads if sensor == "q" else reads) - 1.0
    assert _bears_out(told, (does, does))
    assert _bears_out(told, (0.55 * does, 0.55 * does))
    assert not _bears_out(told, (0.45 * does, 0.45 * does))
    assert not _bears_out(told, (-does, -does))
    assert not _bears_out(told, (-0.01, does) if does > 0.0 else (does, 0.01))  # it may be none

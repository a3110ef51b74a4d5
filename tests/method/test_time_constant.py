"""The time constant of an attitude's estimator, found from a log: where accelerometers tell it, and nowhere else."""

from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.log.breaking.bent_attitude import following_in_log
from gtmbench.method import driven_attitude
from gtmbench.method.driven_attitude import _blocks, _regressed, accelerometers_tilt, time_constant_of
from gtmbench.testing.shared_flights import fly_once
from gtmbench.values.channels import ATTITUDE
from tests.helpers.night import by_day


@cache
def flight():
    truth = fly_once(excitation="doublets+turbulence", duration_s=130.0, seed=7)
    return truth, gb.measure(truth, noise="t2", seed=7)


def estimated(tau, *, by_accelerometers=1.0, angles=("phi", "theta"), bias=0.0, **learning):
    """Return readings with an attitude of an estimator; by which share accelerometers tell which of its references."""
    truth, sensed = flight()
    tilt = dict(zip(("phi", "theta"), accelerometers_tilt(sensed), strict=True))
    references = sensed
    for name in ATTITUDE:
        share = by_accelerometers if name in angles else 0.0
        references = references.replace(name, truth[name] + share * (tilt.get(name, truth[name]) - truth[name]))
    return gb.filtered_attitude(
        references.replace("p", references["p"] + bias), time_constant_s=tau, seed=7, **learning
    )


@pytest.mark.parametrize("bias", [0.0, 0.5])
@pytest.mark.parametrize("tau", by_day([1.0, 20.0, 5.0], 2))
def test_a_filter_that_accelerometers_correct_is_identified_whatever_the_gyros_bias(tau, bias):
    found = time_constant_of([estimated(tau, bias=bias)])
    assert abs(found.time_constant_s - tau) < 0.05 * tau
    assert found.deviation_s < 0.05 * tau


@pytest.mark.parametrize("share", [0.0, 0.5])
@pytest.mark.parametrize("tau", by_day([5.0, 1.0, 20.0]))
def test_nothing_is_said_where_something_else_corrects_it_or_corrects_it_too(tau, share):
    """Accelerometers that have half of the weight explain nearly all of it by twice the time constant."""
    assert time_constant_of([estimated(tau, by_accelerometers=share)]) is None


@pytest.mark.parametrize("angle", ["phi", "theta"])
def test_one_axis_is_no_proof(angle):
    assert time_constant_of([estimated(5.0, angles=(angle,))]) is None


def test_an_estimator_that_learns_the_gyros_bias_has_a_time_constant_too():
    found = time_constant_of([estimated(5.0, bias=0.5, bias_time_constant_s=25.0)])
    assert abs(found.time_constant_s - 5.0) < 0.5
    assert found.deviation_s > 0.5  # for the bias that it learns looks like another reference


def test_gaps_and_records_beside_it_change_little():
    driven = estimated(5.0)
    parts = [driven.between(0.0, 61.3), driven.between(66.0, 129.0), driven.select(["p", "q", "r"])]
    holed = driven.replace("phi", np.where(np.abs(driven.time_s - 50.0) < 0.1, np.nan, driven["phi"]))
    for records in (parts, [holed]):
        assert abs(time_constant_of(records).time_constant_s - 5.0) < 0.2


def test_three_blocks_of_twenty_seconds_are_enough_and_two_are_not():
    driven = estimated(5.0)
    assert time_constant_of([driven.between(0.0, 61.0)]).time_constant_s == pytest.approx(5.0, rel=0.1)
    assert time_constant_of([driven.between(0.0, 59.0)]) is None
    roll, pitch = next(_blocks(driven))
    assert roll.shape == pitch.shape == (3, 40)  # of means over half a second


@pytest.mark.parametrize("period_s", [4.0, 5.0, 50.0])
def test_five_samples_a_block_are_the_fewest(period_s):
    driven = estimated(5.0)
    rare = gb.Record(driven.values[:400], channels=driven.channels, sample_period_s=period_s)
    assert any(_blocks(rare)) == (period_s == 4.0)
    assert time_constant_of([rare]) is None


@pytest.mark.parametrize("channel", ["nx", "ny"])
def test_it_is_no_surer_than_by_the_axis_that_shows_it_worse(channel):
    driven = estimated(5.0)
    noise = 0.002 * np.convolve(np.random.default_rng(3).standard_normal(len(driven) + 99), np.ones(100), "valid")
    assert time_constant_of([driven.replace(channel, driven[channel] + noise)]).deviation_s > 0.07 * 5.0


@pytest.mark.parametrize(("pitch", "is_told"), [(5.0 * 1.25, True), (4.0 * 1.81, True), (4.0 * 1.83, False)])
def test_axes_may_differ_by_twice_what_a_deviation_of_three_tenths_is(pitch, is_told, monkeypatch):
    axes = iter([(4.0, 0.0), (pitch, 0.0)])
    monkeypatch.setattr(driven_attitude, "_regressed", lambda _: next(axes))
    found = time_constant_of([estimated(5.0)])
    assert (found is not None) == is_told
    if is_told:
        assert found.time_constant_s == pytest.approx(np.sqrt(4.0 * pitch))
        assert found.deviation_s == pytest.approx(0.5 * np.log(pitch / 4.0) * found.time_constant_s)


U, V = np.tile([[1.0, 1.0, -1.0, -1.0], [1.0, -1.0, -1.0, 1.0]], 5)  # of one power, and nothing in common


@pytest.mark.parametrize(
    ("pulls", "error"),
    [
        ([0.2 * U, 0.2 * U], 0.0),
        ([0.2 * U + 0.1 * V, 0.2 * U + 0.1 * V], 0.5),  # half of it by the integral
        ([0.3 * U, 0.1 * U], 0.5),  # blocks that differ by half
    ],
    ids=["exact", "something else pulls", "blocks differ"],
)
def test_an_axis_is_as_sure_as_its_blocks_agree_and_nothing_else_pulls(pulls, error):
    tau, found = _regressed(np.array([[pull, U, V] for pull in pulls]))
    incoherence = np.sqrt(1.0 + error**2) - 1.0
    assert found == pytest.approx(np.hypot(error, incoherence), abs=1e-9)
    assert tau == pytest.approx(5.0 / np.sqrt(1.0 + error**2))


def test_nothing_is_said_of_an_attitude_of_its_own_of_too_little_and_without_accelerometers():
    own = flight()[1]
    driven = estimated(5.0)
    assert time_constant_of([own]) is None
    assert time_constant_of([driven.between(0.0, 20.0)]) is None
    assert time_constant_of([driven.select(["p", "q", "r", "phi", "theta", "psi"])]) is None
    assert time_constant_of([]) is None


def test_a_log_that_shows_it_is_bent_by_it(tmp_path):
    gb.write_log(estimated(3.0), tmp_path / "log.csv")
    following = following_in_log(tmp_path / "log.csv", ["q"], attitude="follows")
    assert abs(following.estimator.time_constant_s - 3.0) < 0.15
    assert "the log's own, +-" in following.time_constant
    assert following_in_log(tmp_path / "log.csv", ["q"], attitude="own").estimator is None
    assert following_in_log(tmp_path / "log.csv", ["nz"]).estimator is None

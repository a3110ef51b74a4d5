"""Two simulated flights, from samples to claims: what fails is named, dated and sized, and nothing is clear falsely."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.blocks import blocks_of
from gtmbench.engine.finding import Side
from gtmbench.engine.judged import judged
from gtmbench.values.channels import GYROS
from gtmbench.verdict.timeline import State, laid_out
from tests.engine.engine_flights import flight_from
from tests.helpers.night import by_day

DURATION_S, SIZE = 120.0, 2.0
ESTIMATOR = gb.AttitudeEstimator(time_constant_s=5.0)


@cache
def flown(seed):
    """Return a healthy record of the aircraft in turbulence."""
    truth = gb.fly("gtm", "multisine+turbulence", DURATION_S, seed=seed)
    return gb.measure(truth, noise="t2", seed=seed)


@cache
def said(seed, *faults, is_through=False):
    """Return what the engine says of a flight with faults, in gyros alone or in an attitude that follows them, too."""
    record = flown(seed)
    broken = gb.inject(record, list(faults)) if faults else record
    return judged(flight_from(ESTIMATOR.bent(record, broken) if is_through else broken))


def bias(gyro, onset_s, size=SIZE):
    return gb.Bias(channel=gyro, onset_s=onset_s, size=size)


def timeline_of(found, first_s=0.0, last_s=DURATION_S):
    return laid_out((first_s, last_s), found.claims)


def names_of(found):
    return [each.named for each in found.found]


def share_clear(found, gyro, below=np.inf, span_s=(0.0, DURATION_S)):
    """Return in which share of a span a gyro is clear, up to errors below a size."""
    clear = timeline_of(found, *span_s).of(gyro, State.CLEAR)
    return sum(each.duration_s for each in clear if each.sizes.error < below) / (span_s[1] - span_s[0])


def assert_not_clear_falsely(found, gyro, onset_s, size, behind_s=5.0):
    """Hold that no all-clear denies an error that is there."""
    for span in timeline_of(found).of(gyro, State.CLEAR):
        assert span.end_s <= onset_s + behind_s or span.sizes.error >= size, span


# healthy -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", by_day([1, 2]))
def test_on_a_healthy_flight_nothing_is_found_and_the_gyros_are_clear(seed):
    found = said(seed)
    assert found.found == ()
    for gyro in GYROS:
        assert share_clear(found, gyro, below=2.0) >= 0.8
        assert not timeline_of(found).of(gyro, State.FAILED, State.SUSPECTED)


def test_what_is_clear_says_up_to_which_size_and_when_it_would_have_been_found():
    for gyro in GYROS:
        for span in said(1).claims[gyro]:
            if span.state is State.CLEAR:
                assert 0.1 < span.sizes.error < 20.0
                assert span.sizes.within_s == 60.0
                low, high = span.sizes.factors or (0.0, np.inf)
                assert low < 1.0 < high
            else:
                assert span.reason
        assert timeline_of(said(1)).at(gyro, 118.0).state is State.NOT_JUDGED  # nothing is promised of the last seconds


def test_another_clock_tells_the_same():
    record = flown(1)
    later = gb.Record(
        record.matrix(record.channels), channels=record.channels, sample_period_s=record.sample_period_s, start_s=1000.0
    )
    found, expected = judged(flight_from(later)), said(1)
    assert found.found == ()
    for gyro in GYROS:
        for own, same in zip(found.claims[gyro], expected.claims[gyro], strict=True):
            assert own.state is same.state
            assert own.start_s - 1000.0 == pytest.approx(same.start_s, abs=1e-6)
            assert own.end_s - 1000.0 == pytest.approx(same.end_s, abs=1e-6)
            if own.sizes is not None:
                assert own.sizes.error == pytest.approx(same.sizes.error, rel=1e-6)


# one fault ---------------------------------------------------------------------------------------

ALONE = ((1, "p", 8.0), (1, "q", 50.0), (1, "r", 95.0), (2, "q", 8.0), (2, "r", 50.0), (2, "p", 95.0))
THROUGH = ((1, "r", 8.0), (1, "p", 50.0), (1, "q", 95.0))


def assert_named(found, gyro, onset_s, kind):
    assert names_of(found) == [gyro], [(each.suspects, each.doubt) for each in found.found]
    (own,) = found.found
    assert own.onset_s == pytest.approx(onset_s, abs=3.0)
    assert own.onset_range_s[0] - 1.0 <= onset_s <= own.onset_range_s[1] + 1.0
    assert own.end_s == pytest.approx(DURATION_S, abs=3.0)
    assert own.best.kind == kind
    assert own.side is Side.AFTER
    assert own.interval[0] <= own.size <= own.interval[1]
    timeline = timeline_of(found)
    assert timeline.at(gyro, min(onset_s + 15.0, 110.0)).state is State.FAILED
    for other in set(GYROS) - {gyro}:
        assert not timeline.of(other, State.FAILED, State.SUSPECTED)
    return own


@pytest.mark.parametrize(("seed", "gyro", "onset_s"), by_day(ALONE))
def test_a_bias_of_a_gyro_alone_is_named_dated_and_sized(seed, gyro, onset_s):
    found = said(seed, bias(gyro, onset_s))
    own = assert_named(found, gyro, onset_s, "bias")
    assert own.size == pytest.approx(SIZE, rel=0.2)
    assert own.interval[0] < SIZE < own.interval[1]
    assert_not_clear_falsely(found, gyro, onset_s, SIZE)
    for other in set(GYROS) - {gyro}:
        assert share_clear(found, other, below=2.5) >= 0.7


@pytest.mark.parametrize(("seed", "gyro", "onset_s"), by_day(THROUGH))
def test_a_bias_that_an_estimator_follows_is_named_and_dated(seed, gyro, onset_s):
    found = said(seed, bias(gyro, onset_s), is_through=True)
    own = assert_named(found, gyro, onset_s, "bias")
    assert own.best.fades_s > 0.0
    assert own.size == pytest.approx(SIZE, rel=0.4)
    assert_not_clear_falsely(found, gyro, onset_s, SIZE)


OTHERS = {
    "drift": (1, gb.Drift(channel="q", onset_s=50.0, slope=0.2), 0.2),
    "scale": (2, gb.ScaleFactor(channel="r", onset_s=60.0, factor=0.6), 1.0 - 1.0 / 0.6),
    "sign": (1, gb.SignFlip(channel="p", onset_s=30.0), 2.0),
}


@pytest.mark.parametrize("name", by_day(["drift", "sign", "scale"], 2))
def test_what_grows_or_is_in_proportion_is_named_dated_and_sized(name):
    seed, fault, size = OTHERS[name]
    found = said(seed, fault)
    own = assert_named(found, fault.channel, fault.onset_s, "scale" if name == "sign" else name)
    assert own.size == pytest.approx(size, rel=0.2)
    assert timeline_of(found).at(fault.channel, fault.onset_s + 8.0).state is not State.CLEAR


def test_a_gyro_that_stands_still_is_named_at_what_it_reads():
    fault = gb.Jam(channel="q", onset_s=50.0)
    found = said(1, fault)
    own = assert_named(found, "q", 50.0, "stuck")
    assert own.size == pytest.approx(gb.inject(flown(1), fault)["q"][-1])
    assert timeline_of(found).at("q", 55.0).state is State.FAILED


def test_a_gyro_of_which_nothing_is_known_any_more_is_not_clear():
    found = said(1, gb.Jam(channel="q", onset_s=50.0))
    for gyro in ("p", "r"):
        for span in timeline_of(found).of(gyro, State.CLEAR):
            assert span.sizes.error < 500.0, span


# several, and what is no fault --------------------------------------------------------------------


def test_two_faults_of_two_gyros_are_both_named():
    found = said(1, bias("q", 40.0), bias("p", 80.0, -3.0))
    assert names_of(found) == ["q", "p"]
    first, second = found.found
    assert (first.onset_s, second.onset_s) == (pytest.approx(40.0, abs=3.0), pytest.approx(80.0, abs=3.0))
    assert (first.size, second.size) == (pytest.approx(2.0, rel=0.2), pytest.approx(-3.0, rel=0.2))
    timeline = timeline_of(found)
    assert timeline.at("q", 60.0).state is timeline.at("p", 100.0).state is State.FAILED
    assert timeline.at("p", 60.0).state is not State.FAILED
    assert not timeline.of("r", State.FAILED, State.SUSPECTED)


def test_a_bias_that_ends_is_named_until_it_does():
    found = said(1, bias("q", 30.0), bias("q", 70.0, -SIZE))
    assert set(names_of(found)) == {"q"}
    assert found.found[0].onset_s == pytest.approx(30.0, abs=3.0)
    assert found.found[-1].end_s == pytest.approx(70.0, abs=3.0)
    timeline = timeline_of(found)
    assert timeline.at("q", 50.0).state is State.FAILED
    assert timeline.at("q", 90.0).state is not State.FAILED


def test_a_bias_that_was_there_before_the_log_and_ends_is_on_the_side_before():
    found = said(1, bias("q", 0.0, 5.0), bias("q", 60.0, -5.0))
    assert names_of(found) == ["q"]
    assert found.found[0].side is Side.BEFORE
    assert found.found[0].onset_s == pytest.approx(60.0, abs=3.0)
    timeline = timeline_of(found)
    for time_s in (1.0, 20.0, 55.0):
        assert timeline.at("q", time_s).state is State.FAILED
    for time_s in (66.0, 90.0, 115.0):
        assert timeline.at("q", time_s).state is not State.FAILED


@pytest.mark.nightly
def test_all_gyros_at_once_name_nobody():
    found = said(1, *(bias(gyro, 50.0) for gyro in GYROS))
    assert found.found
    assert set(names_of(found)) == {None}
    timeline = timeline_of(found)
    for gyro in GYROS:
        assert not timeline.of(gyro, State.FAILED)
        assert timeline.at(gyro, 80.0).state is not State.CLEAR
        assert_not_clear_falsely(found, gyro, 50.0, SIZE)


# logs that are hard to read -----------------------------------------------------------------------


@cache
def with_gap(*faults):
    """Return what is said of a log without the samples from 60 to 70 s."""
    record = gb.inject(flown(1), list(faults)) if faults else flown(1)
    rows = [round(time_s / record.sample_period_s) for time_s in (60.0, 70.0)]
    blocks = blocks_of([record.part(range(rows[0] + 1)), record.part(range(rows[1], len(record)))])
    whole = flight_from(record)
    missing = np.isnan(blocks.gyros).any(axis=1)
    return judged(
        replace(
            whole,
            blocks=blocks,
            forces=np.where(missing[:, np.newaxis], np.nan, whole.forces),
            shaking=np.where(missing, np.nan, whole.shaking),
        )
    )


def test_beside_a_gap_nobody_is_accused_and_all_is_clear():
    found = with_gap()
    assert found.found == ()
    for gyro in GYROS:
        timeline = timeline_of(found)
        assert timeline.at(gyro, 30.0).state is timeline.at(gyro, 80.0).state is State.CLEAR
        assert share_clear(found, gyro, below=2.5) >= 0.7


def test_a_fault_behind_a_gap_is_named():
    found = with_gap(bias("r", 85.0))
    assert names_of(found) == ["r"]
    assert found.found[0].onset_s == pytest.approx(85.0, abs=3.0)
    assert_not_clear_falsely(found, "r", 85.0, SIZE)


def test_accelerometers_are_not_needed():
    record = flown(1)
    healthy = judged(flight_from(record, has_forces=False))
    assert healthy.found == ()
    assert all(share_clear(healthy, gyro, below=2.0) >= 0.8 for gyro in GYROS)
    found = judged(flight_from(gb.inject(record, bias("p", 50.0)), has_forces=False))
    assert names_of(found) == ["p"]
    assert found.found[0].size == pytest.approx(SIZE, rel=0.2)


@pytest.mark.parametrize(("duration_s", "gyros"), [(20.0, "r"), (8.0, "pqr"), (2.0, "pqr")])
def test_a_short_log_names_nobody_and_clears_nothing_falsely(duration_s, gyros):
    record = flown(1)
    short = record.part(range(round(duration_s / record.sample_period_s) + 1))
    healthy = judged(flight_from(short))
    assert healthy.found == ()
    for gyro in gyros:
        found = judged(flight_from(gb.inject(short, bias(gyro, 0.5 * duration_s, 4.0))))
        assert set(names_of(found)) <= {None, gyro}
        for span in timeline_of(found, 0.0, duration_s).of(gyro, State.CLEAR):
            assert span.end_s <= 0.5 * duration_s + 1.0 or span.sizes.error >= 4.0


def test_a_flight_of_which_nothing_is_known_says_nothing():
    flight = flight_from(flown(1).part(range(6001)))
    nothing = np.full((len(flight), 3), np.nan)
    found = judged(replace(flight, blocks=replace(flight.blocks, gyros=nothing, rough=nothing)))
    assert found.found == ()
    assert all(share_clear(found, gyro, span_s=(0.0, 60.0)) == 0.0 for gyro in GYROS)


@pytest.mark.nightly
def test_the_same_flight_is_judged_the_same():
    record = gb.inject(flown(1).part(range(4001)), bias("q", 20.0, 4.0))
    first, again = judged(flight_from(record)), judged(flight_from(record))
    assert [(each.onset_s, each.size, each.evidence, each.suspects) for each in first.found] == [
        (each.onset_s, each.size, each.evidence, each.suspects) for each in again.found
    ]
    assert names_of(first) == ["q"]
    for gyro in GYROS:
        assert [(span.start_s, span.state, span.sizes) for span in first.claims[gyro]] == [
            (span.start_s, span.state, span.sizes) for span in again.claims[gyro]
        ]


def test_a_gyro_that_no_healthy_one_is_like_throughout_the_log_is_not_clear():
    record = flown(1)
    timeline = timeline_of(judged(flight_from(gb.inject(record, bias("q", 0.0, 9.0)))))
    assert not timeline.of("q", State.CLEAR)
    assert any("throughout" in span.reason for span in timeline.sensors["q"])
    for other in ("p", "r"):
        assert not timeline.of(other, State.FAILED, State.SUSPECTED)


# noise -------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("seed", "deviation"), by_day([(1, 0.9), (2, 2.0), (1, 1.6), (2, 1.2)], 2))
def test_what_shakes_all_gyros_from_some_time_on_is_nobodys_fault(seed, deviation):
    noise = [gb.Noise(channel=gyro, onset_s=60.0, deviation=deviation, seed=i) for i, gyro in enumerate(GYROS)]
    found = said(seed, *noise)
    assert not any(timeline_of(found).of(gyro, State.FAILED, State.SUSPECTED) for gyro in GYROS)


@pytest.mark.parametrize(("gyro", "deviation"), by_day([("p", 2.5), ("r", 1.0)]))
def test_a_gyro_that_gets_noisy_alone_is_named(gyro, deviation):
    found = said(2, gb.Noise(channel=gyro, onset_s=60.0, deviation=deviation, seed=5))
    assert names_of(found) == [gyro]


@pytest.mark.parametrize("read_from_s", by_day([0.0, 90.0]))
def test_a_frame_that_shakes_about_one_axis_is_no_gyros_noise(read_from_s):
    flight = flight_from(gb.inject(flown(2), gb.Noise(channel="p", onset_s=60.0, deviation=2.5, seed=5)))
    at_rest = 0.01 * np.random.default_rng(3).exponential(size=(len(flight), 3))
    at_rest[flight.time_s < read_from_s] = np.nan
    assert names_of(judged(replace(flight, felt_rough=at_rest))) == ["p"]
    shaken = np.where((flight.time_s > 60.0)[:, np.newaxis] & [False, False, True], 3.0, 1.0) * at_rest
    [found] = judged(replace(flight, felt_rough=shaken)).found
    # what they read elsewhere has to be known
    assert found.accuses == (read_from_s > 60.0)

"""What to fly next: motions that can be flown, for sensors that are open alone, the cheapest that does."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.engine.judged import judged
from gtmbench.history.next_motion import motions, next_motions
from gtmbench.log.opening.engine_flight import flight_of_records
from gtmbench.values.channels import ATTITUDE, GYROS
from gtmbench.verdict.scope import Scope
from gtmbench.verdict.timeline import laid_out
from gtmbench.verdict.verdict import verdict_of


def short(seconds=16.0, noise=0.2):
    """Return a flight that is too short to clear a gyro."""
    random = np.random.default_rng(3)
    time_s = np.arange(0.0, seconds, 0.05)
    phi = 10.0 * np.sin(time_s)
    angles = np.column_stack([phi, 0.0 * phi, 0.0 * phi]) + 0.02 * random.standard_normal((len(time_s), 3))
    gyros = np.column_stack([10.0 * np.cos(time_s), 0.0 * phi, 0.0 * phi]) + noise * random.standard_normal(
        (len(phi), 3)
    )
    record = gb.Record(np.column_stack([gyros, angles]), channels=[*GYROS, *ATTITUDE], sample_period_s=0.05)
    return flight_of_records([record], is_driven=False, is_assumed=False)


def verdict(flight, **asked):
    span_s = (flight.blocks.start_s, flight.blocks.end_s)
    return verdict_of(laid_out(span_s, judged(flight).claims, motion_s=[span_s]), Scope(**asked))


def test_a_short_log_is_told_how_long_to_fly():
    flight = short()
    open_ = verdict(flight, sensors=GYROS)
    assert set(open_.unjudged) == {*GYROS}
    (told,) = next_motions(flight, open_)
    assert set(told.sizes) == {*GYROS}
    assert max(told.sizes.values()) < 5.0
    assert "let p, q, r be judged to" in told.text


@pytest.mark.nightly
def test_nothing_is_named_where_nothing_is_open_or_no_motion_would_do():
    flight = short()
    assert next_motions(flight, verdict(flight, sensors=())) == ()
    assert next_motions(flight, verdict(flight, sensors=GYROS, error_deg_s=1e-3)) == ()


@pytest.mark.nightly
def test_a_factor_wants_the_gyros_own_axis_to_move():
    flight = short()
    for told in next_motions(flight, verdict(flight, sensors=GYROS, factor=0.6)):
        roll, pitch, _ = told.motion.axes
        assert not {"p"} & told.sizes.keys() or roll
        assert not {"q"} & told.sizes.keys() or pitch


@pytest.mark.parametrize("motion", list(motions()), ids=lambda motion: motion.text)
def test_motions_can_be_flown(motion):
    angles = motion.angles(np.arange(0.0, motion.duration_s, 0.1))
    assert np.isfinite(angles).all()
    assert np.abs(angles[:, :2]).max() < 60.0
    assert np.abs(np.diff(angles, axis=0)).max() <= 1.01 * 0.1 * motion.rate_deg_s

"""Threshold and alarms against their definitions, window by window."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gtmbench.errors import InputError
from gtmbench.method.residual import WindowedNorm, alarms, threshold

TS, WINDOW, LOOK_AHEAD_S = 0.1, 4, 0.3
LATER_S = 0.7  # (w + d) Ts: an E(k) is known so much after k Ts


def norm(values, start_s=0.0):
    time_s = start_s + np.arange(len(values)) * TS
    return WindowedNorm(
        values=np.array(values, dtype=float),
        time_s=time_s,
        window=WINDOW,
        look_ahead_s=LOOK_AHEAD_S,
        sample_period_s=TS,
    )


def by_definition(values, limit, first):
    """Return the windows that raise an alarm and the first window that arms, from window `first` on."""
    raised, armed = [], None
    for k in range(first, len(values)):
        if math.isnan(values[k]):
            continue
        if values[k] <= limit:
            armed = k if armed is None else armed
        elif armed is not None:
            known_before = [v for v in values[first:k] if not math.isnan(v)]
            if known_before[-1] <= limit:
                raised.append(k)
    return raised, armed


# 1.0 is the threshold itself: not above it
levels = st.lists(st.sampled_from([0.5, 1.0, 1.0 + 1e-9, 3.0, np.nan]), min_size=0, max_size=40)


@given(values=levels, first=st.integers(0, 12))
def test_an_alarm_is_a_window_above_after_one_that_was_not(values, first):
    raised, armed = by_definition(values, 1.0, first)
    result = alarms(norm(values), 1.0, start_s=first * TS)
    np.testing.assert_allclose(result.time_s, np.array(raised) * TS + LATER_S, rtol=0, atol=1e-9)
    assert math.isnan(result.armed_s) if armed is None else result.armed_s == pytest.approx(armed * TS + LATER_S)
    whole, _ = by_definition(values, 1.0, 0)  # without a start every window is watched
    assert len(alarms(norm(values, start_s=-50.0), 1.0).time_s) == len(whole)


def test_a_norm_too_large_to_be_written_is_above_every_threshold():
    """A sensor that reads 1e200 makes a norm of inf: no reason to look away."""
    assert alarms(norm([0, np.inf, 0]), 1.0).time_s == pytest.approx([0.1 + LATER_S])


def test_alarms_say_which_part_of_a_delay_is_the_methods():
    result = alarms(norm([0, 2]), 1.5)
    assert (result.threshold, result.look_ahead_s) == (1.5, LOOK_AHEAD_S)
    assert result.window_s == pytest.approx((WINDOW + 1) * TS)


def test_alarms_cant_be_changed():
    with pytest.raises(ValueError, match="read-only"):
        alarms(norm([0, 2]), 1.0).time_s[0] = 0.0


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_a_threshold_that_isnt_positive_is_refused(limit):
    with pytest.raises(InputError, match="must be a finite number greater than 0"):
        alarms(norm([0, 2]), limit)


@pytest.mark.parametrize("clock", [0.0, 25.0, 1e5, 1.7e9])
def test_both_ends_of_the_span_count_for_the_threshold(clock):
    healthy = norm([9, 5, 1, 2, 1, 7, 9], start_s=clock)
    time_s = healthy.time_s
    assert threshold(healthy, start_s=time_s[1], end_s=time_s[4], factor=2.0) == 10.0
    assert threshold(healthy, start_s=time_s[2], end_s=time_s[5], factor=2.0) == 14.0
    assert threshold(healthy, start_s=time_s[2], end_s=time_s[4], factor=2.0) == 4.0


@pytest.mark.parametrize("clock", [0.0, 25.0, 1e5, 1.7e9])
def test_the_window_at_the_start_is_watched(clock):
    watched = norm([0, 0, 0, 3, 3], start_s=clock)
    assert len(alarms(watched, 1.0, start_s=watched.time_s[2]).time_s) == 1
    assert len(alarms(watched, 1.0, start_s=watched.time_s[3]).time_s) == 0


@given(
    values=st.lists(st.floats(0.0, 1e6), min_size=1, max_size=30),
    ends=st.lists(st.integers(0, 29), min_size=2, max_size=2).map(sorted),
    factor=st.floats(0.1, 10.0),
)
def test_the_threshold_is_a_multiple_of_the_greatest_norm_within_the_span(values, ends, factor):
    first, last = ends
    inside = [value for k, value in enumerate(values) if first <= k <= last]
    span = {"start_s": first * TS, "end_s": last * TS}
    if inside:
        assert threshold(norm(values), factor=factor, **span) == factor * max(inside)
    else:
        with pytest.raises(InputError, match="no complete window begins in"):
            threshold(norm(values), factor=factor, **span)


def test_missing_windows_dont_count_for_the_threshold():
    assert threshold(norm([np.nan, 2, np.nan, 1]), start_s=0.0, end_s=1.0, factor=1.0) == 2.0
    with pytest.raises(InputError, match=r"no complete window begins in 0\.\.1 s"):
        threshold(norm([np.nan, np.nan]), start_s=0.0, end_s=1.0)


@pytest.mark.parametrize("factor", [0.0, -1.0, np.nan])
def test_a_factor_that_isnt_positive_is_refused(factor):
    with pytest.raises(InputError, match="factor is"):
        threshold(norm([1, 2]), start_s=0.0, end_s=1.0, factor=factor)

"""What makes each kind of fault what it is: properties of its own, beside the contract of `test_faults`."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.faults.distortions import drawn, followed, lagged, rate_limited
from gtmbench.faults.fault import inject, periods
from gtmbench.faults.kinds.additive import Bias, Drift, GSensitivity, Noise, Oscillation, RandomWalk, Spikes
from gtmbench.faults.kinds.replacing import Delay, Dropout, Hardover, Jam, Stale, Stuck, Swap
from gtmbench.faults.kinds.shaping import (
    Deadzone,
    Hysteresis,
    Lag,
    Misalignment,
    Quantisation,
    RateSaturation,
    Saturation,
    ScaleFactor,
    SignFlip,
)
from gtmbench.values.record import Record

PERIOD_S = 0.01
START_S, ONSET_S, DURATION_S = 3.0, 4.2, 1.3
ACTIVE = slice(120, 250)  # the samples of that onset and duration
WHERE = {"channel": "q", "onset_s": ONSET_S}


def flight(samples=400, *, missing=()):
    rng = np.random.default_rng(5)
    time_s = np.arange(samples) * PERIOD_S
    waves = 2.0 * np.sin(3.0 * time_s[:, np.newaxis] + [0.0, 1.0, 2.0, 0.5])
    waves[:, :3] += 0.1 * rng.standard_normal((samples, 3))
    waves[list(missing), 1] = np.nan
    return record(waves)


def record(waves):
    return Record(waves, channels=["p", "q", "r", "nz"], sample_period_s=PERIOD_S, start_s=START_S)


def still(samples=400):
    return record(np.zeros((samples, 4)))


def read(fault, given=None):
    """Return what the broken channel reads from the onset on."""
    return inject(flight() if given is None else given, fault)["q"][ACTIVE.start :]


def healthy(given=None):
    return (flight() if given is None else given)["q"][ACTIVE.start :]


@pytest.mark.parametrize("cls", [Deadzone, Saturation, RateSaturation, Hysteresis, Noise, Spikes, RandomWalk])
def test_a_width_or_limit_is_not_negative(cls):
    item = cls.parameters()[0]
    more = {"rate_hz": 1.0} if cls is Spikes else {}
    with pytest.raises(InputError, match=f"{cls.kind}: {item.name} is -0.1; it must be a finite number, 0 or more"):
        cls(**WHERE, **{item.name: -0.1}, **more)


@pytest.mark.parametrize(
    ("cls", "least"), [(Lag, "greater than 0"), (Stale, "greater than 0"), (Quantisation, ", 1e-09 or more")]
)
def test_a_step_or_a_lag_is_positive(cls, least):
    (item,) = cls.parameters()
    with pytest.raises(InputError, match=f"{item.name} is 0.0; it must be a finite number ?{least}"):
        cls(**WHERE, **{item.name: 0.0})


@pytest.mark.parametrize("sample_s", [0.01, 0.2])
def test_a_period_is_over_up_to_a_thousandth_of_a_sample_before_its_end(sample_s):
    ends_s = sample_s * np.arange(1.0, 40.0)
    np.testing.assert_array_equal(periods(ends_s - 1.1e-3 * sample_s, sample_s, sample_s), np.arange(0.0, 39.0))
    np.testing.assert_array_equal(periods(ends_s - 0.9e-3 * sample_s, sample_s, sample_s), np.arange(1.0, 40.0))


SWING = {"amplitude": 0.5, "frequency_hz": 4.0, "phase_deg": 30.0}
FORMULAS = [  # of the channel and the seconds since the onset
    (Bias, {"size": -0.7}, lambda y, _: y - 0.7),
    (Drift, {"slope": -3.0}, lambda y, t: y - 3.0 * t),
    (gb.ThermalBias, {"size": -2.0, "warming_s": 0.5}, lambda y, t: y - 2.0 * (1.0 - np.exp(-t / 0.5))),
    (Oscillation, SWING, lambda y, t: y + 0.5 * np.sin(8.0 * np.pi * t + np.pi / 6.0)),
    (Oscillation, {**SWING, "replaces": True}, lambda _, t: 0.5 * np.sin(8.0 * np.pi * t + np.pi / 6.0)),
    (GSensitivity, {"axis": "nz", "coefficient": 0.2}, lambda y, _: y + 0.2 * flight()["nz"][ACTIVE.start :]),
    (ScaleFactor, {"factor": 0.8}, lambda y, _: 0.8 * y),
    (gb.ScaleDrift, {"rate": 0.25}, lambda y, t: y * (1.0 + 0.25 * t)),
    (Misalignment, {"axis": "r", "angle_deg": 90.0}, lambda *_: flight()["r"][ACTIVE.start :]),
    (Deadzone, {"half_width": 0.8}, lambda y, _: np.sign(y) * np.maximum(np.abs(y) - 0.8, 0.0)),
    (Saturation, {"limit": 1.1}, lambda y, _: np.clip(y, -1.1, 1.1)),
    (Quantisation, {"quantum": 0.25}, lambda y, _: np.rint(4.0 * y) / 4.0),
    (Stuck, {"value": -3.5}, lambda y, _: np.full(len(y), -3.5)),
    (Stuck, {}, lambda y, _: np.zeros(len(y))),
]


@pytest.mark.parametrize("onset_s", [ONSET_S, 4.1949])
@pytest.mark.parametrize(("cls", "figures", "formula"), FORMULAS)
def test_what_a_kind_reads_is_what_its_formula_says(cls, figures, formula, onset_s):
    broken = read(cls(channel="q", onset_s=onset_s, **figures))
    np.testing.assert_allclose(broken, formula(healthy(), flight().time_s[ACTIVE.start :] - onset_s), atol=1e-12)


def test_what_leaks_in_is_missing_where_it_was():
    spoiled = flight().values.copy()
    spoiled[150, 3] = np.nan
    leak = inject(record(spoiled), GSensitivity(**WHERE, axis="nz", coefficient=0.2))
    assert np.flatnonzero(np.isnan(leak["q"])).tolist() == [150]


# what is added


def test_a_random_walk_spreads_as_the_root_of_time():
    """A thousand seeds; the spread of a chi square of as many is within 7 % of its mean by three deviations."""
    walks = np.array([read(RandomWalk(**WHERE, gain=0.3, seed=seed), still()) for seed in range(1000)])
    assert not walks[:, 0].any()
    for row in (1, 100, 250):
        assert np.mean(walks[:, row] ** 2) == pytest.approx(0.3**2 * row * PERIOD_S, rel=3 * np.sqrt(2 / 1000))
    later = np.corrcoef(walks[:, 100], walks[:, 200] - walks[:, 100])[0, 1]
    assert abs(later) < 0.1  # independent steps


def test_noise_is_white_and_of_its_deviation():
    """Correlations at 50 lags of ten seeds are together a chi square of 500, within four of its deviations."""
    added = np.array([read(Noise(**WHERE, deviation=0.4, seed=seed), still(20_120)) for seed in range(10)])
    assert added.std() == pytest.approx(0.4, rel=4 / np.sqrt(2 * added.size))
    assert abs(added.mean()) < 4 * 0.4 / np.sqrt(added.size)
    correlations = [np.sum(added[:, lag:] * added[:, :-lag], axis=1) / 0.4**2 for lag in range(1, 51)]
    assert np.mean(np.square(correlations)) / 20_000 == pytest.approx(1.0, abs=4 * np.sqrt(2 / 500))


def test_the_numbers_of_a_seed_and_a_name_are_those_of_every_earlier_release():
    """Frozen flights are broken by them: a generator for each 1024, of the seed, their place and the name's bytes."""
    first, second = (np.random.default_rng([7, place, *b"noise of p"]).random(1024) for place in (0, 1))
    places = np.arange(1000.0, 1100.0)
    np.testing.assert_array_equal(drawn("random", 7, "noise of p", places), [*first[1000:], *second[:76]])


def test_spikes_are_of_one_size_both_ways_and_as_many_as_told():
    added = read(Spikes(**WHERE, size=3.0, rate_hz=5.0), still(20_120))
    assert set(added) == {-3.0, 0.0, 3.0}
    up, down = (added == 3.0).sum(), (added == -3.0).sum()
    assert up + down == pytest.approx(1000, abs=3 * np.sqrt(1000))
    assert up - down == pytest.approx(0, abs=3 * np.sqrt(1000))
    every = read(Spikes(**WHERE, size=3.0, rate_hz=1e6), still())
    assert (np.abs(every) == 3.0).all()
    assert not read(Spikes(**WHERE, size=3.0, rate_hz=0.0), still()).any()


def test_what_a_gyro_is_sensitive_to_is_in_g():
    with pytest.raises(InputError, match="axis is 'alpha', which is in deg; it must be a channel in g"):
        GSensitivity(**WHERE, axis="alpha", coefficient=0.1)


# how the signal is shaped


def test_a_flipped_sign_flipped_again_is_none():
    given = flight()
    flip = SignFlip(**WHERE)
    assert np.corrcoef(read(flip), healthy())[0, 1] == pytest.approx(-1.0)
    np.testing.assert_array_equal(inject(given, [flip, flip]).values, given.values)


@given(angle_deg=st.floats(-180.0, 180.0))
def test_a_misalignment_turned_back_by_its_partner_is_a_rotation(angle_deg):
    """Both axes turned alike keep the length of the vector, whatever the angle."""
    given = flight()
    q = Misalignment(**WHERE, axis="r", angle_deg=angle_deg).array(given)
    r = Misalignment(channel="r", onset_s=ONSET_S, axis="q", angle_deg=-angle_deg).array(given)
    np.testing.assert_allclose(q**2 + r**2, given["q"] ** 2 + given["r"] ** 2, rtol=1e-12)


def test_an_axis_is_one_of_the_same_unit_and_turned_by_half_a_turn_at_most():
    for side in (-1.0, 1.0):
        Misalignment(**WHERE, axis="r", angle_deg=side * 180.0)
        with pytest.raises(InputError, match=r"angle_deg is -?180\.1; it must be .*at most 180"):
            Misalignment(**WHERE, axis="r", angle_deg=side * 180.1)
    with pytest.raises(InputError, match="misalignment: axis is 'nz', which is in g; it must be a channel in deg/s"):
        Misalignment(**WHERE, axis="nz", angle_deg=3.0)


@pytest.mark.parametrize(
    "fault",
    [
        Deadzone(**WHERE, half_width=0.8),
        Saturation(**WHERE, limit=1.1),
        RateSaturation(**WHERE, rate_limit=6.0),
        Hysteresis(**WHERE, width=1.0),
        Quantisation(**WHERE, quantum=0.3),
        Lag(**WHERE, lag_s=0.1),
        Delay(**WHERE, delay_s=0.035),
        Stale(**WHERE, hold_s=0.05),
        SignFlip(**WHERE),
        Jam(**WHERE),
    ],
    ids=lambda fault: fault.kind,
)
def test_what_breaks_alike_on_both_sides_is_odd(fault):
    np.testing.assert_array_equal(read(fault, record(-flight().values)), -read(fault))


@pytest.mark.parametrize("missing", [(), (180, 181, 182)], ids=str)
def test_a_rate_saturation_starts_from_the_last_healthy_sample_and_bounds_every_step(missing):
    broken = inject(flight(missing=missing), RateSaturation(**WHERE, rate_limit=6.0))["q"]
    known = np.delete(broken, missing)  # a gap is passed over: it is no leave to jump
    assert np.abs(np.diff(known[ACTIVE.start - 1 :])).max() == pytest.approx(6.0 * PERIOD_S, abs=1e-12)


def test_a_signal_slower_than_the_limit_passes_a_rate_saturation_bit_for_bit():
    """Scoring counts altered samples: rounding would count as a fault."""
    given = flight()
    fastest = np.abs(np.diff(given["q"])).max() / PERIOD_S
    broken = inject(given, RateSaturation(**WHERE, rate_limit=1.01 * fastest))["q"]
    np.testing.assert_array_equal(broken, given["q"])


def one_by_one(values, step, start):
    """The rate limit as it is written: every sample looked at."""
    at, limited = start, []
    for y in values.tolist():
        move = y - at
        if -step <= move <= step:
            at = y
        elif move == move:
            at = at + step if move > 0.0 else at - step
        elif y == y:
            at = y
        else:
            limited.append(y)
            continue
        limited.append(at)
    return np.array(limited), at


readings = st.one_of(st.floats(-3.0, 3.0), st.sampled_from([0.0, 0.5, 1.0, -0.0]), st.just(np.nan))


@pytest.mark.parametrize("step", [0.0, 0.3, 9.0])
def test_many_readings_are_followed_as_each_is_alone(step):
    at, y = np.meshgrid(np.linspace(-3.0, 3.0, 13), [-2.0, -0.1, 0.0, 0.4, 3.0])
    alone = [followed(*each, step) for each in zip(at.ravel().tolist(), y.ravel().tolist(), strict=True)]
    np.testing.assert_allclose(followed(at, y, step).ravel(), alone, atol=1e-15)


@given(
    values=npst.arrays(float, st.integers(0, 60), elements=readings),
    step=st.sampled_from([0.0, 0.01, 0.3, 0.5, 1.0, 9.0]),
    start=readings,
)
def test_a_rate_limit_that_skips_what_is_followed_gives_the_same_bits(values, step, start):
    limited, at = rate_limited(values, step, start)
    wanted, end = one_by_one(values, step, start)
    np.testing.assert_array_equal(limited.view(np.int64), wanted.view(np.int64))
    np.testing.assert_array_equal(at, end)


def test_a_rate_saturation_of_0_and_a_jam_are_the_same():
    np.testing.assert_array_equal(read(RateSaturation(**WHERE, rate_limit=0.0)), read(Jam(**WHERE)))


def test_a_hysteresis_stays_within_its_play_and_moves_only_at_its_edges():
    y, broken = healthy(), read(Hysteresis(**WHERE, width=1.0))
    assert np.abs(broken - y).max() <= 0.5 + 1e-12
    moved = np.flatnonzero(np.diff(broken)) + 1
    assert 20 < len(moved) < 200
    np.testing.assert_allclose(np.abs(broken[moved] - y[moved]), 0.5, atol=1e-12)
    assert (np.sign(np.diff(broken))[moved - 1] == np.sign(y[moved] - broken[moved])).all()  # it is drawn along


def test_backlash_is_passed_through_twice_between_the_extremes():
    """Up and down again it goes other ways, half a width to each side."""
    ramp = np.concatenate([np.linspace(-3.0, 3.0, 200), np.linspace(3.0, -3.0, 200)])
    waves = np.tile(ramp[:, np.newaxis], (1, 4))
    broken = inject(record(waves), Hysteresis(channel="q", onset_s=START_S, width=1.0))["q"]
    np.testing.assert_allclose(broken[50:200], ramp[50:200] - 0.5)
    np.testing.assert_allclose(broken[250:], ramp[250:] + 0.5)


def test_a_lag_turns_a_step_into_an_exponential_of_its_time_constant():
    """Held long enough, the deviation from the new value falls by e in lag_s, and it ends where the signal stands."""
    waves = np.zeros((2000, 4))
    waves[ACTIVE.start :] = 3.0
    broken = read(Lag(**WHERE, lag_s=0.2), record(waves))
    left = 3.0 - broken
    np.testing.assert_allclose(left[21:100] / left[1:80], np.exp(-0.2 / 0.2), rtol=1e-9)
    assert abs(left[-1]) < 1e-9
    held = np.full((400, 4), 1.7)
    np.testing.assert_array_equal(read(Lag(**WHERE, lag_s=0.2), record(held)), 1.7)
    np.testing.assert_array_equal(lagged(held[:, 0], 0.2, PERIOD_S)[0], 1.7)


def test_a_lag_shrinks_and_shifts_a_sine_as_its_transfer_function_says():
    omega, lag_s, samples = 2.0 * np.pi * 2.0, 0.1, 2000
    time_s = np.arange(samples) * PERIOD_S
    waves = np.tile(np.sin(omega * time_s)[:, np.newaxis], (1, 4))
    broken = inject(record(waves), Lag(channel="q", onset_s=START_S, lag_s=lag_s))["q"]
    basis = np.column_stack([np.sin(omega * time_s), np.cos(omega * time_s)])[1000:]
    (sine, cosine), *_ = np.linalg.lstsq(basis, broken[1000:])
    assert sine + 1j * cosine == pytest.approx(1.0 / (1.0 + 1j * omega * lag_s), rel=2e-3)


# what takes its place


def test_a_dropout_reads_nothing_while_it_lasts():
    broken = inject(flight(), Dropout(**WHERE, duration_s=DURATION_S))["q"]
    assert np.flatnonzero(np.isnan(broken)).tolist() == list(range(ACTIVE.start, ACTIVE.stop))


def test_a_jam_stays_at_the_last_healthy_sample():
    given = flight()
    jam = Jam(**WHERE, duration_s=DURATION_S)
    assert set(inject(given, jam)["q"][ACTIVE]) == {given["q"][ACTIVE.start - 1]}
    at_the_start = inject(given, Jam(channel="q", onset_s=START_S))["q"]
    assert set(at_the_start) == {given["q"][0]}


@pytest.mark.parametrize("limit", [-250.0, 250.0])
def test_a_hardover_runs_to_its_stop_at_its_rate_and_stays(limit):
    last = flight()["q"][ACTIVE.start - 1]
    broken = read(Hardover(**WHERE, limit=limit, rate_limit=200.0))
    steps = np.diff(broken, prepend=last)
    assert np.abs(steps).max() == pytest.approx(200.0 * PERIOD_S)
    arrived = int(np.argmax(broken == limit))
    assert arrived * PERIOD_S == pytest.approx(abs(limit - last) / 200.0, abs=PERIOD_S)
    assert (np.sign(steps[:arrived]) == np.sign(limit)).all()
    assert set(broken[arrived:]) == {limit} == set(read(Hardover(**WHERE, limit=limit)))


@pytest.mark.parametrize(("hold_s", "every"), [(0.05, 5), (0.01, 1), (0.004, 1), (0.07, 7)])
def test_stale_readings_are_fresh_once_every_hold_and_never_older(hold_s, every):
    y, broken = healthy(), read(Stale(**WHERE, hold_s=hold_s))
    np.testing.assert_array_equal(broken[::every], y[::every])
    np.testing.assert_array_equal(broken, np.repeat(y[::every], every)[: len(y)])


def test_a_hold_that_is_no_whole_number_of_samples_is_kept_in_the_mean():
    broken = read(Stale(**WHERE, hold_s=0.025))
    assert (np.diff(broken) != 0.0).sum() == pytest.approx(len(broken) / 2.5, abs=1)


def test_a_delay_shifts_and_nothing_that_came_on_time_comes_again():
    given = flight()
    y, broken = given["q"], read(Delay(**WHERE, delay_s=0.3))
    np.testing.assert_array_equal(broken[30:], y[ACTIVE.start : -30])
    assert set(broken[:29]) == {y[ACTIVE.start - 1]}


def test_a_delay_of_half_a_sample_lies_half_way_and_none_is_none():
    given = flight()
    y = given["q"]
    half = read(Delay(**WHERE, delay_s=0.025))
    np.testing.assert_allclose(half[3:], 0.5 * (y[ACTIVE.start : -3] + y[ACTIVE.start + 1 : -2]), atol=1e-12)
    np.testing.assert_array_equal(read(Delay(**WHERE, delay_s=0.0)), healthy())


def test_what_is_missing_is_missing_when_it_should_have_arrived():
    broken = inject(flight(missing=(200,)), Delay(**WHERE, delay_s=0.3))["q"]
    assert np.flatnonzero(np.isnan(broken)).tolist() == [230]


def test_swapped_channels_read_each_other_and_swapping_again_undoes_it():
    given = flight(missing=(150,))
    swap = Swap(**WHERE, other="r")
    after = inject(given, swap)
    np.testing.assert_array_equal(after["q"][ACTIVE.start :], given["r"][ACTIVE.start :])
    np.testing.assert_array_equal(after["r"][ACTIVE.start :], given["q"][ACTIVE.start :])
    np.testing.assert_array_equal(inject(after, swap).values, given.values)
    other = Swap(channel="r", onset_s=ONSET_S, other="q")
    np.testing.assert_array_equal(inject(given, other).values, after.values)


def test_a_swap_streams_channel_by_channel():
    given = flight()
    swap = Swap(**WHERE, other="r", duration_s=DURATION_S, ramp_s=0.4)
    after = inject(given, swap)
    assert swap.changes == ("q", "r")
    for part in swap.parts:
        step = part.stream(PERIOD_S)
        both = given.matrix(part.reads)
        said = [step(time_s, row) for time_s, row in zip(given.time_s, both, strict=True)]
        np.testing.assert_array_equal(said, after[part.channel])


def test_what_one_channel_loses_to_a_swap_that_comes_in_the_other_gains():
    given = flight()
    after = inject(given, Swap(**WHERE, other="r", ramp_s=1.0))
    np.testing.assert_allclose(after["q"] + after["r"], given["q"] + given["r"], atol=1e-12)


@pytest.mark.parametrize("onset_s", [2.0, -4.0])
def test_a_clock_that_slips_reads_the_signal_of_its_own_time_and_nothing_before_the_first_reading(onset_s):
    record = flat(np.arange(900) * 0.01)  # reads its own time
    broken = gb.ClockSlip(channel="p", onset_s=onset_s, slip=0.3).array(record)
    own_s = record.time_s - 0.3 * np.maximum(record.time_s - onset_s, 0.0)
    np.testing.assert_allclose(broken, np.maximum(own_s, 0.0), atol=1e-9)


def flat(values):
    return gb.Record(values, channels=["p"], sample_period_s=0.01)


def test_spells_and_pauses_by_chance_last_as_long_as_they_should_on_average():
    times = gb.Intermittent(period_s=2.0, duty=0.3, seed=5, by_chance=True)
    time_s = np.arange(4_000_000) * 0.01
    on = times.is_on(time_s)
    changes = np.flatnonzero(np.diff(on.astype(int)))
    lasts_s = np.diff(changes) * 0.01
    spells_s, pauses_s = lasts_s[1::2], lasts_s[::2]
    assert on[0]
    assert np.mean(on) == pytest.approx(0.3, abs=0.01)
    for lasts, mean in ((spells_s, 0.6), (pauses_s, 1.4)):
        assert np.mean(lasts) == pytest.approx(mean, rel=0.03)
        assert np.std(lasts) == pytest.approx(mean, rel=0.05)  # exponential: as its mean
    some = range(0, 30_000, 7)
    assert [times.is_on(float(time_s[row])) for row in some] == on[list(some)].tolist()


def test_by_chance_there_is_no_jitter():
    with pytest.raises(gb.InputError, match=r"jitter is 0\.2"):
        gb.Intermittent(period_s=2.0, duty=0.3, jitter=0.2, by_chance=True)


@pytest.mark.parametrize(
    ("text", "kind", "named"),
    [
        ("px4_off:q", "dropout", {}),
        ("px4_stuck:q", "jam", {}),
        ("px4_slow:q", "stale", {"hold_s": 0.1}),
        ("px4_slow:q:hold_s=0.4", "stale", {"hold_s": 0.4}),
        ("px4_delayed:q", "delay", {"delay_s": 0.5}),
        ("px4_garbage:q", "noise", {"deviation": 500.0}),
        ("px4_wrong:q:size=5", "bias", {"size": 5.0}),
    ],
)
def test_a_failure_may_be_called_as_px4_does(text, kind, named):
    fault = gb.fault(text, onset_s=3.0)
    assert (fault.kind, fault.channel, fault.severities) == (kind, "q", named)


def test_what_px4_leaves_open_is_asked_for():
    with pytest.raises(gb.InputError, match="a bias needs size"):
        gb.fault("px4_wrong:q", onset_s=3.0)


def test_a_word_that_px4_doesnt_have_is_answered_with_those_that_it_has():
    with pytest.raises(gb.InputError, match=r"fault 'px4_slo:q': PX4 has no such failure; .*px4_slow.*mean"):
        gb.fault("px4_slo:q", onset_s=3.0)


def test_px4s_intermittent_failure_lasts_a_second_on_average_and_half_of_the_time():
    """Spells of an exponential law scatter as much as they last; beginnings, a Poisson process, as their root."""
    on = gb.fault("px4_intermittent:p", onset_s=0.0).active(np.arange(0.0, 4000.0, 0.01))
    begins, ends = (np.flatnonzero(np.diff(on.astype(int)) == change) for change in (1, -1))
    lasted_s = 0.01 * (ends[1:] - begins[: len(ends) - 1])
    assert on.mean() == pytest.approx(0.5, abs=0.05)
    assert (lasted_s.mean(), lasted_s.std()) == pytest.approx((1.0, 1.0), abs=0.1)

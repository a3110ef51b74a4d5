"""Recursive identification gives, at any time, what the batch gives for the samples so far."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gtmbench as gb
from gtmbench.errors import InputError, RankWarning

NAMES = ["p", "q", "r", "beta"]
TS = 0.01


def flight(samples=600, seed=1, offset=0.0, start_s=0.0):
    rng = np.random.default_rng(seed)
    u = np.cumsum(rng.standard_normal((samples, 2)), axis=0) * 0.1 + rng.standard_normal((samples, 2))
    y = np.roll(u, 1, axis=0) @ [[0.5, 1.0], [-2.0, 0.3]] + np.roll(u, -1, axis=0) + rng.standard_normal((samples, 2))
    return gb.Record(np.column_stack([u, y]) + offset, channels=NAMES, sample_period_s=TS, start_s=start_s)


def orders(r=3, d=2):
    return {"inputs": NAMES[:2], "outputs": NAMES[2:], "causal_order": r, "noncausal_order": d}


def part(record, start, stop):
    start_s = record.start_s + start * record.sample_period_s
    return gb.Record(record.values[start:stop], channels=NAMES, sample_period_s=TS, start_s=start_s)


def running(pieces, r=3, d=2, **options):
    online = gb.RecursiveIdentification(**orders(r, d), **options)
    for piece in pieces:
        online.push(piece)
    return online.operator()


def assert_same(fit, other, rtol=1e-9):
    scale = np.abs(other.markov).max()
    np.testing.assert_allclose(fit.markov, other.markov, rtol=0, atol=rtol * scale)
    for name in ("input_means", "output_means", "input_rms", "rms_residual", "noise_variance", "standard_error"):
        np.testing.assert_allclose(getattr(fit, name), getattr(other, name), rtol=1e-7, err_msg=name)
    assert (fit.samples, fit.rank, fit.inputs, fit.outputs) == (other.samples, other.rank, other.inputs, other.outputs)
    assert fit.condition == pytest.approx(other.condition, rel=1e-6)


@given(cuts=st.lists(st.integers(0, 600), max_size=8), r=st.integers(0, 4), d=st.integers(0, 4))
def test_without_forgetting_it_is_the_batch_answer_however_the_record_is_cut(cuts, r, d):
    record = flight(offset=1e6)
    edges = [0, *sorted(cuts), 600]
    pieces = [part(record, start, stop) for start, stop in pairwise(edges)]
    assert_same(running(pieces, r, d), gb.identify(record, **orders(r, d)))


def test_sample_by_sample_is_the_batch_answer_at_every_time_it_is_asked():
    record = flight(250)
    online = gb.RecursiveIdentification(**orders())
    for k in range(250):
        online.push(part(record, k, k + 1))
        if k in (40, 63, 64, 65, 200, 249):
            assert_same(online.operator(), gb.identify(part(record, 0, k + 1), **orders()))


@pytest.mark.parametrize("forgetting", [0.999, 0.99, 0.95])
def test_forgetting_is_a_weight_of_lambda_to_the_age(forgetting):
    record = flight()
    weights = forgetting ** np.arange(len(record) - 1, -1, -1)
    pieces = [part(record, k, k + 37) for k in range(0, 600, 37)]
    assert_same(running(pieces, forgetting=forgetting), gb.identify(record, weights=weights, **orders()), rtol=1e-8)


def test_it_follows_an_operator_that_changes():
    """What it remembers is 2,000 samples later worth nothing: 0.99^2000; then it errs as its standard errors say."""
    record, other = flight(2000, seed=1), flight(2000, seed=2)
    changed = gb.Record(other.values * [1, 1, 3, 3], channels=NAMES, sample_period_s=TS, start_s=20.0)
    now = running([record, changed], forgetting=0.99)
    truth = np.zeros((6, 2, 2))  # lags -2..3
    truth[1], truth[3] = 3.0 * np.eye(2), 3.0 * np.array([[0.5, -2.0], [1.0, 0.3]])
    assert (np.abs(now.markov - truth) < 4.0 * now.standard_error).all()
    assert now.standard_error.max() < 0.5


@pytest.mark.parametrize("chunk", [1, 10])
def test_stamps_that_are_rounded_make_no_gap(chunk):
    record = flight()
    online = gb.RecursiveIdentification(**orders())
    for k in range(0, 600, chunk):
        start_s = round(k / 60.0, 3)  # 60 Hz, stamped in milliseconds
        online.push(gb.Record(record.values[k : k + chunk], channels=NAMES, sample_period_s=1 / 60, start_s=start_s))
    whole = gb.Record(record.values, channels=NAMES, sample_period_s=1 / 60)
    assert_same(online.operator(), gb.identify(whole, **orders()))


def test_samples_that_are_pushed_twice_are_refused():
    record = flight()
    online = gb.RecursiveIdentification(**orders())
    online.push(part(record, 0, 300))
    with pytest.raises(InputError, match=r"begins at 2\.5 s, but 3 s is next; leave out what came before"):
        online.push(part(record, 250, 600))
    online.push(part(record, 300, 600))
    assert_same(online.operator(), gb.identify(record, **orders()))


@pytest.mark.parametrize("step", [1e4, 1e6])
@pytest.mark.parametrize("forgetting", [1.0, 0.98])
def test_spikes_and_steps_long_ago_cost_no_digits_of_the_moments(step, forgetting):
    """Against two passes over all samples; what rounding leaves is that of the data, 1e-16 of the step."""
    record = flight(3000)
    values = record.values + 0.0
    values[0] += step
    values[:1000] += step
    broken = gb.Record(values, channels=NAMES, sample_period_s=TS)
    now = running([broken], forgetting=forgetting)
    weights = forgetting ** np.arange(2999.0, -1.0, -1.0)
    centre = np.average(values, axis=0, weights=weights)
    rms = np.sqrt(np.average((values - centre) ** 2, axis=0, weights=weights))
    np.testing.assert_allclose(now.input_rms, rms[:2], rtol=1e-9)
    np.testing.assert_allclose(now.input_means, centre[:2], rtol=0, atol=1e-9 * rms.max())
    batch = gb.identify(broken, weights=weights, **orders())
    np.testing.assert_allclose(batch.input_rms, rms[:2], rtol=1e-9)


def test_a_memory_shorter_than_the_parameters_is_refused():
    with pytest.raises(InputError, match=r"forgetting 0\.5 remembers 2 samples for 12 Markov parameters; choose"):
        gb.RecursiveIdentification(**orders(), forgetting=0.5)
    gb.RecursiveIdentification(inputs=["a", "b"], outputs=["y"], causal_order=0, noncausal_order=0, forgetting=0.5)


def test_only_least_squares_recurs():
    with pytest.raises(InputError, match=r"recursion is for gtmbench\.LeastSquares"):
        gb.RecursiveIdentification(**orders(), estimator=gb.PredictionError())


def test_a_gap_begins_a_new_stretch():
    record = flight()
    before, after = part(record, 0, 200), part(record, 260, 600)
    assert_same(running([before, after]), gb.identify([before, after], **orders()))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
def test_a_missing_sample_is_left_out_as_by_a_weight_of_0(bad):
    record = flight()
    values = record.values.copy()
    values[[5, 100, 101, 350], [0, 1, 2, 3]] = bad
    holed = gb.Record(values, channels=NAMES, sample_period_s=TS)
    weights = np.isfinite(values).all(axis=1).astype(float)
    assert_same(
        running([part(holed, k, k + 23) for k in range(0, 600, 23)]), gb.identify(holed, weights=weights, **orders())
    )


def test_a_ridge_is_the_batch_ridge():
    record = flight()
    ridge = gb.LeastSquares(ridge={"p": 0.5, "q": 2.0})
    operator = running([part(record, 0, 300), part(record, 300, 600)], estimator=ridge)
    np.testing.assert_allclose(operator.markov, gb.identify(record, estimator=ridge, **orders()).markov, atol=1e-9)


def test_sinusoids_warn_as_in_the_batch():
    angle = np.arange(600) * 0.1
    waves = np.column_stack([np.sin(angle + phase) for phase in (0.0, 1.0, 2.0, 3.0)])
    with pytest.warns(RankWarning, match=r"'p' \(2 of its 6 lags\)"):
        running([gb.Record(waves, channels=NAMES, sample_period_s=TS)])


def test_its_memory_and_the_cost_of_a_push_stay_what_they_were():
    online = gb.RecursiveIdentification(**orders(20, 20))
    record = flight(40_000)

    def cost(start):
        tracemalloc.start()
        for k in range(start, start + 640):
            online.push(part(record, k, k + 1))
        now, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        return now, peak

    first = cost(0)
    online.push(part(record, 640, 30_000))
    later = cost(30_000)
    assert later[0] <= first[0] + 20_000
    assert later[1] <= first[1] * 1.1


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"forgetting": 0.0}, "forgetting is 0.0"),
        ({"forgetting": 1.01}, "forgetting is 1.01; it must be a finite number greater than 0, at most 1"),
        ({"inputs": []}, "at least one pseudo input"),
        ({"outputs": ["p"]}, "'p' is both"),
        ({"causal_order": -1}, "causal_order is -1"),
    ],
)
def test_what_cant_be_meant_is_refused(options, message):
    with pytest.raises(InputError, match=message):
        gb.RecursiveIdentification(**{**orders(), **options})


def test_a_push_that_is_refused_changes_nothing():
    record = flight()
    online = gb.RecursiveIdentification(**orders())
    online.push(part(record, 0, 300))
    with pytest.raises(InputError, match="no channel 'beta'"):
        online.push(part(record, 300, 400).select(["p", "q", "r"]))
    with pytest.raises(InputError, match=r"sampled every 0\.02 s, those before every 0\.01 s"):
        online.push(gb.Record(record.values, channels=NAMES, sample_period_s=0.02, start_s=3.0))
    online.push(part(record, 300, 600))
    assert_same(online.operator(), gb.identify(record, **orders()))


def test_too_few_samples_are_refused_with_their_number():
    online = gb.RecursiveIdentification(**orders())
    with pytest.raises(InputError, match="0 samples of p, q give 0 equations for 12 Markov parameters and a constant"):
        online.operator()
    eighteen = flight(18)
    online.push(part(eighteen, 0, 17))
    with pytest.raises(
        InputError,
        match=r"^17 samples of p, q give 12 equations for 12 Markov .* and a constant of .* at least 18 samples",
    ):
        online.operator()
    online.push(part(eighteen, 17, 18))
    assert online.operator().samples == 13

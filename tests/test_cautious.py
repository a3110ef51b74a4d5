"""Cautious identification: data speak where there is motion, the prior elsewhere; units and gaps don't matter."""

import numpy as np
import pytest
from scipy.signal import butter, sosfiltfilt

import gtmbench as gb
from gtmbench.errors import InputError
from gtmbench.detectors.bank.bank import ResidualSpec
from gtmbench.detectors.bank.cautious import identify_cautiously
from gtmbench.detectors.bank.doubt import slow

PERIOD_S = 0.04


def spec(output="p", inputs=("p_att",), look_s=0.08):
    return ResidualSpec(output=output, inputs=tuple(inputs), look_back_s=look_s, look_ahead_s=look_s)


def wander(samples, columns, seed, band=0.06):
    """Return slow random motion of RMS 1, up to `band` of the sample rate."""
    raw = np.random.default_rng(seed).standard_normal((samples + 400, columns))
    found = sosfiltfilt(butter(4, 2.0 * band, output="sos"), raw, axis=0)[200:-200]
    return found / found.std(axis=0)


def made(theta, u, names, output="p", noise=0.0, seed=5, start_s=0.0):
    """Return a record with u and y(k) = theta' phi(k) + noise; theta of shape (lags, inputs), lag -d first, d = r."""
    half = len(theta) // 2
    padded = np.pad(u, ((half, half), (0, 0)), mode="edge")
    y = sum(padded[2 * half - j : len(padded) - j] @ theta[j] for j in range(len(theta)))
    y = y + noise * np.random.default_rng(seed).standard_normal(len(y))
    return gb.Record(np.column_stack([y, u]), channels=[output, *names], sample_period_s=PERIOD_S, start_s=start_s)


def predicts(found, record, output="p"):
    return found.operator.predict(record)[:, 0], record[output]


PLANT = np.array([[0.1, -0.3], [0.4, 0.2], [0.9, 0.5], [0.3, -0.1], [-0.2, 0.0]])


def test_much_rich_motion_gives_what_least_squares_give_and_the_plant():
    by = spec(output="r", inputs=("p", "beta"))
    record = made(PLANT, wander(20_000, 2, seed=1), ["p", "beta"], output="r", noise=0.1)
    found = identify_cautiously([record], by)
    plain = gb.identify(record, inputs=["p", "beta"], outputs=["r"], causal_order=2, noncausal_order=2)
    fresh = made(PLANT, wander(3000, 2, seed=2), ["p", "beta"], output="r")
    predicted, truth = predicts(found, fresh, "r")
    there = slice(2, -2)
    assert np.std((predicted - truth)[there]) < 0.02 * np.std(truth)
    assert np.std((predicted - plain.predict(fresh)[:, 0])[there]) < 0.02 * np.std(truth)
    for i in range(2):  # gains at rest, over their standard error
        ones = np.zeros(10)
        ones[i::2] = 1.0
        deviation = np.linalg.norm(ones @ found.root)
        assert abs(found.operator.markov[:, 0, i].sum() - PLANT[:, i].sum()) < 4.0 * deviation < 0.1


def test_parameters_drawn_from_the_prior_lie_as_far_off_as_the_covariance_says():
    squares, variances = [], []
    for seed in range(40):
        random = np.random.default_rng(100 + seed)
        theta = np.array([0.0, 0.0, 1.0, 0.0, 0.0]) + 0.005 * random.standard_normal(5)
        theta[2] += 0.01 * random.standard_normal()
        theta += 0.05 * random.standard_normal() / PERIOD_S * np.array([0.0, 0.5, 0.0, -0.5, 0.0])
        record = made(theta[:, np.newaxis], 3.0 * wander(800, 1, seed), ["p_att"], noise=0.05, seed=seed)
        found = identify_cautiously([record], spec())
        variances.append(found.variance)
        squares.append(np.square(np.linalg.solve(found.root, found.operator.markov[:, 0, 0] - theta)))
    assert np.mean(squares) == pytest.approx(1.0, abs=0.3)
    slow_share = np.mean(np.square(slow(np.random.default_rng(1).standard_normal((20_000, 1)))))
    assert np.median(variances) == pytest.approx(slow_share * 0.05**2, rel=0.2)


@pytest.mark.parametrize("size", [0.001, 0.1, 10.0])
def test_a_sensor_at_rest_keeps_its_gain_however_noisy_its_attitude_is(size):
    noise = np.random.default_rng(3).standard_normal((800, 2)) * [0.1, size]
    found = identify_cautiously([gb.Record(noise, channels=["p", "p_att"], sample_period_s=PERIOD_S)], spec())
    markov = found.operator.markov[:, 0, 0]
    np.testing.assert_allclose(markov[[0, 2, 4]], [0.0, 1.0, 0.0], atol=0.002)
    assert markov.sum() == pytest.approx(1.0, abs=0.002)
    assert abs(markov[1] - markov[3]) * PERIOD_S < 0.01  # of a second: a delay nearly as it was, of 0.05 s
    assert np.linalg.norm(np.ones(5) @ found.root) > 0.8 * np.hypot(0.01, np.sqrt(5) * 0.005)


@pytest.mark.parametrize("size", [1.5, 5.0])
def test_noise_of_the_attitude_in_motion_shrinks_a_gain_less_than_least_squares_do(size):
    motion = 3.0 * wander(3000, 1, seed=4, band=0.03)
    clean = made(np.array([[0.0], [0.0], [1.01], [0.0], [0.0]]), motion, ["p_att"], noise=0.05)
    noise = size * np.random.default_rng(6).standard_normal(len(clean))
    noisy = clean.replace("p_att", clean["p_att"] + noise)
    plain = gb.identify(noisy, inputs=["p_att"], outputs=["p"], causal_order=2, noncausal_order=2).markov.sum()
    shrunk = identify_cautiously([noisy], spec()).operator.markov.sum()
    assert 0.0 < 1.01 - shrunk < 0.6 * (1.01 - plain)


MIXED = spec(inputs=("p_att", "ny", "beta"))
NAMES = ["p_att", "ny", "beta"]
MIX = np.column_stack([[0.0, 0.02, 0.99, -0.02, 0.0], [0.1, 0.2, 0.3, 0.1, 0.0], [0.0, 0.0, -0.4, 0.1, 0.1]])


def mixed(samples=1500, seed=7, names=None, **figures):
    return made(MIX, wander(samples, 3, seed) * [2.0, 1.0, 0.5], names or NAMES, noise=0.05, seed=seed, **figures)


def same(one, other, scale=1.0):
    np.testing.assert_allclose(one.operator.markov * scale, other.operator.markov, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(np.abs(one.variance), other.variance, rtol=1e-6)
    size = np.ravel(np.broadcast_to(scale, one.operator.markov.shape))
    covariance = size[:, np.newaxis] * (one.root @ one.root.T) * size
    np.testing.assert_allclose(covariance, other.root @ other.root.T, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("factor", [1e-4, 1e3, 1e6])
@pytest.mark.parametrize("channel", ["ny", "beta"])
def test_units_of_a_free_input_change_its_parameters_and_nothing_else(channel, factor):
    record = mixed()
    scaled = record.replace(channel, record[channel] * factor)
    scale = [factor if name == channel else 1.0 for name in NAMES]
    same(identify_cautiously([scaled], MIXED), identify_cautiously([record], MIXED), scale)


@pytest.mark.parametrize("factor", [1e-3, 1e4])
def test_units_of_a_free_operators_output_scale_all_of_it(factor):
    free = spec(output="r", inputs=("p", "beta"))
    record = made(PLANT, wander(1500, 2, seed=1), ["p", "beta"], output="r", noise=0.1)
    found = identify_cautiously([record], free)
    scaled = identify_cautiously([record.replace("r", factor * record["r"])], free)
    np.testing.assert_allclose(scaled.operator.markov, factor * found.operator.markov, rtol=1e-6, atol=1e-9 * factor)
    np.testing.assert_allclose(scaled.root @ scaled.root.T, factor**2 * (found.root @ found.root.T), rtol=1e-5)


def test_the_order_of_records_and_the_time_they_begin_at_dont_matter():
    records = [mixed(600, seed) for seed in (1, 2, 3)]
    found = identify_cautiously(records, MIXED)
    same(identify_cautiously(records[::-1], MIXED), found)
    same(identify_cautiously([mixed(600, seed, start_s=1.6e9) for seed in (1, 2, 3)], MIXED), found)


def test_mean_offsets_go_into_the_means_alone():
    record = mixed()
    shifted = record
    for channel, offset in {"p": 7.0, "p_att": -40.0, "ny": 3.0}.items():
        shifted = shifted.replace(channel, record[channel] + offset)
    found, other = (identify_cautiously([one], MIXED) for one in (record, shifted))
    same(other, found)
    np.testing.assert_allclose(other.operator.input_means - found.operator.input_means, [-40.0, 3.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(predicts(other, shifted)[0], predicts(found, record)[0] + 7.0, atol=1e-5)


def test_the_order_of_inputs_doesnt_matter():
    record, turned = mixed(), [2, 0, 1]
    found = identify_cautiously([record], MIXED)
    other = identify_cautiously([record], spec(inputs=[NAMES[i] for i in turned]))
    np.testing.assert_allclose(other.operator.markov, found.operator.markov[:, :, turned], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("channel", ["p", "p_att", "ny"])
@pytest.mark.parametrize("rows", [slice(700, 1500), slice(0, 800), slice(500, 900)])
def test_missing_samples_are_as_if_the_record_had_ended_there(channel, rows):
    record = mixed()
    values = np.array(record[channel])
    values[rows] = np.nan
    time_s = record.time_s
    spans = [(0, rows.start), (rows.stop, 1500)]
    parts = [record.between(time_s[a], time_s[b - 1]) for a, b in spans if b > a]
    found, cut = identify_cautiously([record.replace(channel, values)], MIXED), identify_cautiously(parts, MIXED)
    off = np.linalg.solve(cut.root, (found.operator.markov - cut.operator.markov).ravel())
    assert np.abs(off).max() < 0.5  # deviations: only the filter's ends differ
    np.testing.assert_allclose(found.operator.input_means, cut.operator.input_means, atol=1e-9)
    np.testing.assert_allclose(found.operator.output_means, cut.operator.output_means, atol=1e-9)


def test_what_stands_in_a_missing_row_isnt_used():
    record = mixed()
    one, other = np.array(record["p"]), np.array(record["p"])
    one[300:320], other[300:320] = np.nan, np.inf
    same(*(identify_cautiously([record.replace("p", values)], MIXED) for values in (one, other)))


def test_a_part_in_which_a_channel_rests_keeps_the_prior_of_the_whole():
    still = mixed().replace("ny", np.full(1500, 2.0))
    with pytest.raises(InputError, match="channel 'ny' is constant over the healthy record"):
        identify_cautiously([still], MIXED)
    whole = identify_cautiously([mixed()], MIXED)
    part = identify_cautiously([still], MIXED, rms=whole.rms)
    assert np.abs(part.operator.markov[:, 0, 1]).max() < 1e-9
    expected = 3.0 * whole.rms[3] / whole.rms[1] / np.sqrt(15)
    np.testing.assert_allclose(np.linalg.norm(part.root, axis=1)[1::3], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (mixed(4), "4 samples hold too few windows of 5 without a missing one for the residual of p"),
        (mixed(40), "40 samples hold too few windows"),
        (mixed().replace("p", np.full(1500, 3.0)), "channel 'p' is constant"),
        (mixed().replace("p_att", np.full(1500, np.nan)), "1500 samples hold too few windows"),
    ],
    ids=["shorter than a window", "few windows", "output at rest", "nothing there"],
)
def test_what_cant_be_identified_is_refused_in_words(record, words):
    with pytest.raises(InputError, match=words):
        identify_cautiously([record], MIXED)

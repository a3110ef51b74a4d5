"""Bayesian estimation: data speak where there is motion, the prior elsewhere; units and gaps don't matter."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import null_space
from scipy.signal import butter, firwin, sosfiltfilt

from gtmbench.detectors.bank.bank import ResidualSpec
from gtmbench.detectors.bank.calibration import identified
from gtmbench.errors import InputError
from gtmbench.method.estimators import bayesian, kinematic
from gtmbench.method.estimators.bayesian import Bayesian
from gtmbench.method.estimators.kinematic import Expected, _moments, _pinned, _raw, _slowed, fit
from gtmbench.method.identify import identify
from gtmbench.method.regression.equations import Equations, _taps, about_means, fir, regressors, slow, solved
from gtmbench.values.record import Record

PERIOD_S = 0.04


def found_on(records, by, scale=None):
    """Return an operator of a bank's residual, F of its covariance F F', its noise variance and the prior's scale."""
    operator, scale = identified(records, by, Bayesian(), scale=scale)
    root, (variance,) = operator.covariance_root(by.output), operator.noise_variance
    return SimpleNamespace(operator=operator, root=root, variance=variance, scale=scale)


def spec(output="p", inputs=("p_att",), look_s=0.08):
    return ResidualSpec(output=output, inputs=tuple(inputs), look_back_s=look_s, look_ahead_s=look_s)


def wander(samples, columns, seed, band=0.06):
    """Return slow random motion of RMS 1, up to `band` of the sample rate."""
    raw = np.random.default_rng(seed).standard_normal((samples + 400, columns))
    motion = sosfiltfilt(butter(4, 2.0 * band, output="sos"), raw, axis=0)[200:-200]
    return motion / motion.std(axis=0)


def made(theta, u, names, output="p", noise=0.0, seed=5, start_s=0.0):
    """Return a record with u and y(k) = theta' phi(k) + noise; theta of shape (lags, inputs), lag -d first, d = r."""
    half = len(theta) // 2
    padded = np.pad(u, ((half, half), (0, 0)), mode="edge")
    y = sum(padded[2 * half - j : len(padded) - j] @ theta[j] for j in range(len(theta)))
    y = y + noise * np.random.default_rng(seed).standard_normal(len(y))
    return Record(np.column_stack([y, u]), channels=[output, *names], sample_period_s=PERIOD_S, start_s=start_s)


def predicts(fit, record, output="p"):
    return fit.operator.predict(record)[:, 0], record[output]


PLANT = np.array([[0.1, -0.3], [0.4, 0.2], [0.9, 0.5], [0.3, -0.1], [-0.2, 0.0]])


def test_much_rich_motion_gives_what_least_squares_give_and_the_plant():
    by = spec(output="r", inputs=("p", "beta"))
    record = made(PLANT, wander(20_000, 2, seed=1), ["p", "beta"], output="r", noise=0.1)
    fit = found_on([record], by)
    plain = identify(record, inputs=["p", "beta"], outputs=["r"], causal_order=2, noncausal_order=2)
    fresh = made(PLANT, wander(3000, 2, seed=2), ["p", "beta"], output="r")
    predicted, truth = predicts(fit, fresh, "r")
    there = slice(2, -2)
    assert np.std((predicted - truth)[there]) < 0.02 * np.std(truth)
    assert np.std((predicted - plain.predict(fresh)[:, 0])[there]) < 0.02 * np.std(truth)
    for i in range(2):  # gains at rest, over their standard error
        ones = np.zeros(10)
        ones[i::2] = 1.0
        deviation = np.linalg.norm(ones @ fit.root)
        assert abs(fit.operator.markov[:, 0, i].sum() - PLANT[:, i].sum()) < 4.0 * deviation < 0.1


def moments(markov):
    """Return gain, delay (samples) and second moment about it of a kinematic operator, lag -d first, d = r."""
    lag = np.arange(len(markov)) - len(markov) // 2
    gain = markov.sum()
    delay = lag @ markov / gain
    return np.array([gain, delay, (lag - delay) ** 2 @ markov / gain])


def reading(gain=1.0, delay_s=0.0, samples=3000, band=0.03, noise=(0.05, 0.0), seed=4):
    """Return a gyro and its attitude's rate, which comes late: the same slow motion, each with noise of its own."""
    fine, shift = 100, round(delay_s / PERIOD_S * 100)
    motion = 3.0 * wander((samples + 20) * fine, 1, seed, band=band / fine)[:, 0]
    places = (np.arange(samples) + 10) * fine
    own = np.random.default_rng(seed).standard_normal((samples, 2)) * noise
    values = np.column_stack([gain * motion[places - shift], motion[places]]) + own
    return Record(values, channels=["p", "p_att"], sample_period_s=PERIOD_S)


def test_a_delay_lies_as_far_off_as_its_deviation_says():
    squares = []
    lag = np.arange(-2, 3)
    for seed in range(30):
        delay_s = 0.02 * np.random.default_rng(seed).standard_normal()
        fit = found_on([reading(delay_s=delay_s, samples=600, seed=seed, noise=(0.3, 0.3))], spec())
        gain, delay, bend = moments(fit.operator.markov[:, 0, 0])
        assert gain == pytest.approx(1.0, abs=1e-9)
        assert bend == pytest.approx(-1.0 / 3.0, abs=1e-9)  # of a central difference, undone
        squares.append((delay - delay_s / PERIOD_S) ** 2 / np.sum((lag @ fit.root) ** 2))
    assert 0.5 < np.mean(squares) < 1.6


@pytest.mark.parametrize("size", [0.001, 0.1, 10.0])
def test_a_sensor_at_rest_keeps_its_gain_however_noisy_its_attitude_is(size):
    noise = np.random.default_rng(3).standard_normal((800, 2)) * [0.1, size]
    fit = found_on([Record(noise, channels=["p", "p_att"], sample_period_s=PERIOD_S)], spec())
    markov = fit.operator.markov[:, 0, 0]
    gain, delay, _ = moments(markov)
    assert gain == pytest.approx(1.0, abs=1e-9)
    assert abs(delay) * PERIOD_S < 0.01  # of a second: as it was, of 0.05 s
    assert np.linalg.norm(np.ones(5) @ fit.root) > 0.8 * 0.01


def test_what_nothing_moves_is_smoothed_as_far_as_smooth_motion_allows():
    noise = np.random.default_rng(3).standard_normal((4000, 2)) * [0.1, 1.0]
    record = Record(noise, channels=["p", "p_att"], sample_period_s=PERIOD_S)
    markov = found_on([record], spec(look_s=0.2)).operator.markov[:, 0, 0]
    lag = np.arange(-5, 6)
    among = np.vander(lag, 3, increasing=True).T
    least = np.linalg.pinv(among) @ [1.0, 0.0, -1.0 / 3.0]  # of white noise: the shortest with these moments
    np.testing.assert_allclose(markov, least, atol=0.05)
    assert np.sum(markov**2) < 0.25


@pytest.mark.parametrize("gain", [0.97, 1.03])
def test_a_gain_that_the_records_contradict_is_theirs(gain):
    fit = found_on([reading(gain=gain, noise=(0.05, 0.05))], spec())
    deviation = np.linalg.norm(np.ones(5) @ fit.root)
    assert abs(fit.operator.markov.sum() - gain) < 4.0 * deviation < 0.01


@pytest.mark.parametrize("delay_s", [-0.06, 0.0, 0.013, 0.04, 0.07])
def test_fast_motion_leaves_nothing_however_late_the_attitude_is(delay_s):
    """What is left of faster and larger motion than was flown is what five parameters can't hold, and no more."""
    fit = found_on([reading(delay_s=delay_s, noise=(0.05, 0.3))], spec())
    faster = reading(delay_s=delay_s, band=0.04, noise=(0.0, 0.0), seed=11)
    left = faster["p"] - fit.operator.predict(faster)[:, 0]
    assert np.nanstd(left) < 0.012 * np.std(faster["p"])


@pytest.mark.parametrize(("offsets", "factors"), [([0.0, 0.0], [1.0, 3.0]), ([5.0, -20.0], [0.2, 1.0])])
def test_neither_scale_nor_means_change_what_physics_fixes(offsets, factors):
    record = reading(noise=(0.05, 0.3))
    fit = found_on([record], spec())
    shifted = Record(record.values + offsets, channels=record.channels, sample_period_s=PERIOD_S)
    same(found_on([shifted], spec(), scale=fit.scale * factors), fit)
    among = found_on([mixed()], MIXED)
    same(found_on([mixed()], MIXED, scale=among.scale * [factors[0], 1.0, 1.0, 1.0]), among)


def test_the_variance_of_what_physics_fixes_is_that_of_the_sensors_noise():
    assert found_on([reading(noise=(0.3, 0.0))], spec()).variance == pytest.approx(0.3**2, rel=0.1)


@pytest.mark.parametrize("late", [0.4, -0.3, 1.4])
def test_a_delay_between_samples_is_no_bend(late):
    """However tightly the second moment about it is known; and of what stands still all is as it was before."""
    lag, expected = np.arange(-2.0, 3.0), Expected(curvature=0.0, gain=0.01, delay=1.25, bend=0.01)
    draw, place = np.random.default_rng(1), np.arange(3000.0)
    waves = [(w, draw.uniform(0.0, 6.0)) for w in (0.012, 0.02, 0.036, 0.052)]
    here, there = (sum(np.sin(w * (place - s) + phase) for w, phase in waves) for s in (0.0, late))
    y = (there + 0.01 * draw.standard_normal(3000))[2:-2]
    mean, covariance, contradicted = _moments(
        [Equations(u=here[:, np.newaxis], y=y, weights=np.ones(2996))], lag, expected, 5.0
    )
    assert contradicted == []
    np.testing.assert_allclose(mean, [1.0, late, 0.0], atol=4.0 * np.sqrt(covariance[1, 1]))
    assert covariance[1, 1] < 0.01**2
    still = Equations(u=np.zeros((3000, 1)), y=y, weights=np.ones(2996))
    mean, covariance, _ = _moments([still], lag, replace(expected, curvature=-1.0 / 3.0, bend=0.3), 5.0)
    np.testing.assert_allclose(mean, [1.0, 0.0, -1.0 / 3.0], atol=1e-4)
    np.testing.assert_allclose(covariance, np.diag([0.01, 1.25, 0.3]) ** 2, atol=2e-4)
    _, covariance, _ = fit([still], constant=False, lags=5, ahead=2, sample_period_s=PERIOD_S, expected=expected)
    others = null_space(np.vander(lag, 3, increasing=True).T)  # each by 0.3, of which five in a row say what one does
    np.testing.assert_allclose(others.T @ covariance @ others, 0.3**2 / 5.0 * np.eye(2), atol=1e-6)


def test_moments_that_physics_does_not_fix_are_as_sure_as_what_they_are_made_of():
    """Gain, delay and second moment about it, (g, b/g, c/g - (b/g)^2), by their derivatives."""

    def made_of(step):
        gain, first, second = np.array([1.0, 0.0, 0.0]) + step
        return np.array([gain, first / gain, second / gain - (first / gain) ** 2])

    step, root = np.array([0.3, 0.2, 0.5]), 1e-3 * np.random.default_rng(1).standard_normal((3, 3))
    expected = Expected(curvature=-9.0, gain=1.0, delay=1.0, bend=1.0)
    mean, covariance, contradicted = _pinned(step, root @ root.T, 0, np.arange(-2.0, 3.0), expected)
    slope = np.array([(made_of(step + each) - made_of(step - each)) / 2e-6 for each in 1e-6 * np.eye(3)]).T
    assert contradicted == [2, 0]
    np.testing.assert_allclose(mean, made_of(step))
    np.testing.assert_allclose(covariance, slope @ root @ root.T @ slope.T, rtol=1e-4, atol=1e-12)
    mean, derived = _raw(made_of(step))
    np.testing.assert_allclose(mean, np.array([1.0, 0.0, 0.0]) + step)  # and back again
    np.testing.assert_allclose(derived @ slope, np.eye(3), atol=1e-5)


def test_three_lags_are_enough_for_a_delay():
    fit = found_on([reading(delay_s=0.013, noise=(0.05, 0.3))], spec(look_s=PERIOD_S))
    expected = [1.0, 0.013 / PERIOD_S, -1.0 / 3.0]
    assert moments(fit.operator.markov[:, 0, 0]) == pytest.approx(expected, abs=0.05)


@pytest.mark.parametrize("lags", [1, 2])
@pytest.mark.parametrize("gain", [1.0, 1.05])
def test_of_fewer_than_three_lags_the_gain_alone_is_found(lags, gain):
    by = ResidualSpec(output="p", inputs=("p_att",), look_back_s=(lags - 1) * PERIOD_S, look_ahead_s=0.0)
    fit = found_on([reading(gain=gain, noise=(0.05, 0.0))], by)
    markov, deviation = fit.operator.markov[:, 0, 0], np.linalg.norm(np.ones(lags) @ fit.root)
    assert len(markov) == lags
    if gain == 1.0:  # physics, unless the records contradict it
        assert markov.sum() == pytest.approx(1.0, abs=1e-9)
    else:
        assert markov.sum() == pytest.approx(gain, abs=4.0 * deviation)
        assert deviation < 0.005


@pytest.mark.parametrize("noise", [(1.5, 0.0), (0.0, 1.5), (0.0, 3.0), (3.0, 3.0)])
def test_noise_is_laid_to_the_reading_that_holds_it(noise):
    """An input without noise isn't freed of any, one that holds half or all of it of no more than that."""
    fit = found_on([reading(noise=noise, samples=20_000, band=0.06)], spec())
    assert fit.operator.markov.sum() == pytest.approx(1.0, abs=1e-9)


def test_what_is_expected_of_an_attitudes_filter_is_its_delay_and_the_square_of_three_tenths_of_it(monkeypatch):
    """In samples; laying readings on a clock adds a fifth of a sample squared to the second moment."""
    told = []
    monkeypatch.setattr(
        bayesian, "fit", lambda *_, expected, **others: told.append(expected) or fit(*_, expected=expected, **others)
    )
    found_on([reading()], spec())
    (expected,) = told
    assert (expected.curvature, expected.gain, expected.delay) == (-1.0 / 3.0, 0.01, pytest.approx(1.25))
    assert expected.bend == pytest.approx(0.2 + 0.375**2)


def test_a_gain_alone_is_that_of_the_records_where_they_contradict_physics_by_four_deviations():
    expected = Expected(curvature=0.0, gain=1.0, delay=1.0, bend=1.0)
    for off, found in ((0.039, 1.0), (-0.041, 0.959), (0.041, 1.041)):
        mean, covariance, contradicted = _pinned(np.array([off]), np.array([[1e-4]]), 0, np.zeros(1), expected)
        assert (mean.tolist(), contradicted) == ([pytest.approx(found)], [0] * (found != 1.0))
        assert covariance.tolist() == [[1e-4]]


MIXED = spec(inputs=("p_att", "ny", "beta"))
NAMES = ["p_att", "ny", "beta"]
MIX = np.column_stack([[0.0, 0.02, 0.99, -0.02, 0.0], [0.1, 0.2, 0.3, 0.1, 0.0], [0.0, 0.0, -0.4, 0.1, 0.1]])


def mixed(samples=1500, seed=7, names=None, **figures):
    return made(MIX, wander(samples, 3, seed) * [2.0, 1.0, 0.5], names or NAMES, noise=0.05, seed=seed, **figures)


def same(fit, other, scale=1.0):
    np.testing.assert_allclose(fit.operator.markov * scale, other.operator.markov, rtol=1e-6, atol=1e-7)
    np.testing.assert_allclose(np.abs(fit.variance), other.variance, rtol=1e-6)
    size = np.ravel(np.broadcast_to(scale, fit.operator.markov.shape))
    covariance = size[:, np.newaxis] * (fit.root @ fit.root.T) * size
    np.testing.assert_allclose(covariance, other.root @ other.root.T, rtol=1e-4, atol=1e-9)


@pytest.mark.parametrize("factor", [1e-4, 1e3, 1e6])
@pytest.mark.parametrize("channel", ["ny", "beta"])
def test_units_of_a_free_input_change_its_parameters_and_nothing_else(channel, factor):
    record = mixed()
    scaled = record.replace(channel, record[channel] * factor)
    scale = [factor if name == channel else 1.0 for name in NAMES]
    same(found_on([scaled], MIXED), found_on([record], MIXED), scale)


@pytest.mark.parametrize("factor", [1e-3, 1e4])
def test_units_of_a_free_operators_output_scale_all_of_it(factor):
    free = spec(output="r", inputs=("p", "beta"))
    record = made(PLANT, wander(1500, 2, seed=1), ["p", "beta"], output="r", noise=0.1)
    fit = found_on([record], free)
    scaled = found_on([record.replace("r", factor * record["r"])], free)
    np.testing.assert_allclose(scaled.operator.markov, factor * fit.operator.markov, rtol=1e-6, atol=1e-9 * factor)
    np.testing.assert_allclose(scaled.root @ scaled.root.T, factor**2 * (fit.root @ fit.root.T), rtol=1e-5)


def test_the_order_of_records_and_the_time_they_begin_at_dont_matter():
    records = [mixed(600, seed) for seed in (1, 2, 3)]
    fit = found_on(records, MIXED)
    same(found_on(records[::-1], MIXED), fit)
    same(found_on([mixed(600, seed, start_s=1.6e9) for seed in (1, 2, 3)], MIXED), fit)


def test_mean_offsets_go_into_the_means_alone():
    record = mixed()
    shifted = record
    for channel, offset in {"p": 7.0, "p_att": -40.0, "ny": 3.0}.items():
        shifted = shifted.replace(channel, record[channel] + offset)
    fit, other = (found_on([given], MIXED) for given in (record, shifted))
    same(other, fit)
    np.testing.assert_allclose(other.operator.input_means - fit.operator.input_means, [-40.0, 3.0, 0.0], atol=1e-9)
    np.testing.assert_allclose(predicts(other, shifted)[0], predicts(fit, record)[0] + 7.0, atol=1e-5)


def test_the_order_of_inputs_doesnt_matter():
    record, turned = mixed(), [2, 0, 1]
    fit = found_on([record], MIXED)
    other = found_on([record], spec(inputs=[NAMES[i] for i in turned]))
    np.testing.assert_allclose(other.operator.markov, fit.operator.markov[:, :, turned], rtol=1e-6, atol=1e-8)


@pytest.mark.parametrize("channel", ["p", "p_att", "ny"])
@pytest.mark.parametrize("rows", [slice(700, 1500), slice(0, 800), slice(500, 900)])
def test_missing_samples_are_as_if_the_record_had_ended_there(channel, rows):
    record = mixed()
    values = np.array(record[channel])
    values[rows] = np.nan
    time_s = record.time_s
    spans = [(0, rows.start), (rows.stop, 1500)]
    parts = [record.between(time_s[a], time_s[b - 1]) for a, b in spans if b > a]
    gappy, cut = found_on([record.replace(channel, values)], MIXED), found_on(parts, MIXED)
    off = np.linalg.solve(cut.root, (gappy.operator.markov - cut.operator.markov).ravel())
    assert np.abs(off).max() < 0.5  # deviations: only the filter's ends differ
    np.testing.assert_allclose(gappy.operator.input_means, cut.operator.input_means, atol=1e-9)
    # the constant is estimated from the same rows, so the ends move it, too, by less than a tenth of its deviation
    moved, deviation = gappy.operator.constant - cut.operator.constant, cut.operator.rms_residual
    assert np.abs(moved).max() < 0.1 * deviation[0] / np.sqrt(cut.operator.samples)


def test_what_stands_in_a_missing_row_isnt_used():
    record = mixed()
    nan, other = np.array(record["p"]), np.array(record["p"])
    nan[300:320], other[300:320] = np.nan, np.inf
    same(*(found_on([record.replace("p", values)], MIXED) for values in (nan, other)))


def test_a_part_in_which_a_channel_rests_keeps_the_prior_of_the_whole():
    still = mixed().replace("ny", np.full(1500, 2.0))
    with pytest.raises(InputError, match=r"channel 'ny' is constant \(2\) over the record"):
        found_on([still], MIXED)
    whole = found_on([mixed()], MIXED)
    part = found_on([still], MIXED, scale=whole.scale)
    assert np.abs(part.operator.markov[:, 0, 1]).max() < 1e-9
    expected = 3.0 * whole.scale[3] / whole.scale[1] / np.sqrt(15)
    np.testing.assert_allclose(np.linalg.norm(part.root, axis=1)[1::3], expected, rtol=1e-6)
    own = found_on([mixed().replace("p_att", np.full(1500, 2.0))], MIXED, scale=whole.scale)
    delay = 0.5 * 0.05 / PERIOD_S  # of the input that the output reads: each lag, their sum, and a central difference
    expected = [0.005, np.hypot(0.005, delay), np.hypot(0.005, 0.01), np.hypot(0.005, delay), 0.005]
    np.testing.assert_allclose(np.linalg.norm(own.root, axis=1)[::3], expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("record", "words"),
    [
        (mixed(4), "4 samples are too few for windows of 5 without a missing one of p"),
        (mixed(40), "40 samples are too few for windows"),
        (mixed().replace("p", np.full(1500, 3.0)), "channel 'p' is constant"),
        (mixed().replace("p_att", np.full(1500, np.nan)), "1500 samples are too few for windows"),
    ],
    ids=["shorter than a window", "few windows", "output at rest", "nothing there"],
)
def test_what_cant_be_identified_is_refused_in_words(record, words):
    with pytest.raises(InputError, match=words):
        found_on([record], MIXED)


# as an estimator of its own


def by_estimator(records, outputs=("p",), inputs=NAMES, weights=None, **prior):
    orders = {"causal_order": 2, "noncausal_order": 2}
    return identify(records, inputs=inputs, outputs=outputs, estimator=Bayesian(**prior), weights=weights, **orders)


def alike(operator, other, rtol=1e-7):
    np.testing.assert_allclose(operator.markov, other.markov, rtol=rtol, atol=1e-9)
    for output in operator.outputs:
        expected = other.covariance(output)
        np.testing.assert_allclose(operator.covariance(output), expected, rtol=rtol, atol=1e-9 * expected.max())


def test_identify_gives_what_a_bank_gets_of_records_without_gaps():
    records = [mixed(600, seed) for seed in (1, 2)]
    operator = by_estimator(records)
    alike(operator, found_on(records, MIXED).operator)
    assert operator.estimator == "Bayesian(gain=0.01, delay_s=0.05, tap=0.005, free=3.0)"
    np.testing.assert_allclose(
        operator.standard_error**2, np.einsum("lili->li", operator.covariance("p"))[:, np.newaxis]
    )


def test_each_output_has_its_own_posterior():
    record = mixed()
    both = record.replace("p", record["p"])
    r = 3.0 * record["p"] + np.random.default_rng(1).standard_normal(len(record))
    both = Record(np.column_stack([record.values, r]), channels=[*record.channels, "r"], sample_period_s=PERIOD_S)
    together = by_estimator(both, ["p", "r"])
    for o, name in enumerate(["p", "r"]):
        alone = by_estimator(both, [name])
        np.testing.assert_allclose(together.markov[:, o], alone.markov[:, 0], rtol=1e-9, atol=1e-12)
        np.testing.assert_allclose(together.covariance(name), alone.covariance(name), rtol=1e-9)


def test_samples_of_weight_0_are_never_looked_at_and_others_count_as_often_as_they_weigh():
    record, weights = mixed(), np.ones(1500)
    weights[400:450] = 0.0
    holed = record.replace("ny", np.where(weights > 0.0, record["ny"], np.nan))
    time_s = record.time_s
    pieces = [record.between(time_s[0], time_s[399]), record.between(time_s[450], time_s[-1])]
    alike(by_estimator(holed, weights=weights), by_estimator(pieces))
    alike(by_estimator(record, weights=2.0 * np.ones(1500)), by_estimator([record, record]))


def test_a_loose_prior_leaves_least_squares_on_slow_motion_and_a_tight_one_the_prior():
    record = mixed(6000)
    tight = by_estimator(record, gain=0.0, delay_s=0.0, tap=1e-9, free=1e-9)
    np.testing.assert_allclose(tight.markov[:, 0].ravel(), np.eye(1, 15, 6)[0], atol=1e-6)
    loose = by_estimator(record, outputs=["ny"], inputs=["p", "beta"], free=1e6)
    motion = slow(record.matrix(["p", "beta", "ny"]) - record.matrix(["p", "beta", "ny"]).mean(axis=0))
    phi = np.column_stack([motion[2 - i : 5998 - i, :2] for i in range(-2, 3)])
    theta = np.linalg.lstsq(phi, motion[2:-2, 2], rcond=None)[0]
    residual, expected = motion[2:-2, 2] - phi @ theta, motion[2:-2, 2] - phi @ loose.markov[:, 0].ravel()
    assert np.std(expected) == pytest.approx(np.std(residual), rel=1e-4)


def test_equations_are_solved_in_any_unit_and_written_out_some_rows_at_a_time():
    draw, units = np.random.default_rng(1), np.array([1e-6, 1.0, 1e6])
    phi = draw.random((50, 3)) * units
    theta = np.array([1.0, -2.0, 3.0]) / units
    np.testing.assert_allclose(solved(phi.T @ phi, phi.T @ phi @ theta) * units, [1.0, -2.0, 3.0], rtol=1e-5)
    assert solved(np.diag([4.0, 0.0]), np.array([8.0, 0.0])).tolist() == pytest.approx([2.0, 0.0])
    u = draw.random((9000, 2))
    long = Equations(u=u, y=np.zeros(8998), weights=np.ones(8998))
    parts = [found for _, found in long.windows(3)]
    np.testing.assert_array_equal(np.concatenate(parts), regressors(u, 3))


def test_half_of_what_moves_at_three_hertz_is_slow():
    time_s = 0.01 * np.arange(400)
    wave = np.sin(2.0 * np.pi * 3.0 * time_s)
    given = Equations(u=wave[:, np.newaxis], y=wave, weights=np.ones(400))
    left = _slowed(given, round(kinematic._SLOW_S / 0.01))
    assert np.abs(left.y).max() == pytest.approx(0.5, abs=0.07)
    np.testing.assert_allclose(left.u[:, 0], left.y)


def test_equations_about_their_means_are_those_of_all_pieces_together():
    draw = np.random.default_rng(1)
    pieces = [Equations(u=draw.random((8, 2)), y=draw.random(6), weights=draw.random(6)) for _ in range(2)]
    centred, means, y = about_means(pieces, 3)
    weights = np.concatenate([piece.weights for piece in pieces])
    phi = np.concatenate([regressors(piece.u, 3) for piece in pieces])
    targets = np.concatenate([piece.y for piece in pieces])
    np.testing.assert_allclose(means, np.average(phi, axis=0, weights=weights))
    assert y == pytest.approx(np.average(targets, weights=weights))
    np.testing.assert_allclose(np.concatenate([piece.y for piece in centred]), targets - y)


def test_slow_motion_is_what_a_window_of_eleven_samples_passes_below_a_tenth_of_the_sample_rate():
    taps = firwin(11, 0.2, window=("kaiser", 5.0))
    np.testing.assert_allclose(_taps.__wrapped__(), taps, atol=1e-15)
    np.testing.assert_allclose(slow(np.eye(1, 41, 20).T)[15:26, 0], taps, atol=1e-15)
    assert slow(np.ones((5, 2))).tolist() == [[1.0, 1.0]] * 5  # too few to be smoothed
    assert fir(np.ones((2, 3)), np.ones(3)).shape == (0, 3)


@pytest.mark.parametrize(
    ("figures", "words"),
    [
        ({"gain": -0.1}, r"gain is -0.1; it must be a finite number"),
        ({"tap": 0.0}, r"tap is 0.0?; it must be a finite number"),
        ({"free": np.nan}, r"free is nan"),
        ({"delay_s": "much"}, r"delay_s is 'much'"),
    ],
)
def test_a_prior_that_isnt_one_is_refused(figures, words):
    with pytest.raises(InputError, match=words):
        Bayesian(**figures)

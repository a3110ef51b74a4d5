"""Identification: the operator that made the data is found again, whatever clock, offset or unit they come in."""

from dataclasses import replace

import numpy as np
import pytest

from gtmbench.errors import InputError, RankWarning
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.identify import identify
from gtmbench.method.problem import check_parameters
from gtmbench.method.residual import residual
from gtmbench.values.record import Record

ORDERS = [(0, 0), (3, 2), (5, 0), (0, 4), (1, 6)]  # r, d
INPUTS, OUTPUTS = ["p", "q"], ["r", "beta"]


def plant(r, d, *, samples=400, seed=0, noise=0.0):
    """Return Markov parameters and a record that obeys them: y(k) = sum over i = -d..r of H_i u(k-i)."""
    rng = np.random.default_rng([seed, r, d])
    markov = rng.standard_normal((r + d + 1, 2, 2))
    u = rng.standard_normal((samples + r + d, 2))
    # np.roll(u, i)[k] is u(k - i); where the ends wrap around is cut off
    y = sum(np.roll(u, i, axis=0) @ markov[i + d].T for i in range(-d, r + 1))
    y += noise * rng.standard_normal(y.shape)
    both = np.column_stack([u, y])[r : len(u) - d]
    return markov, Record(both, channels=[*INPUTS, *OUTPUTS], sample_period_s=0.01)


def identified(record, r, d, inputs=INPUTS, outputs=OUTPUTS):
    return identify(record, inputs=inputs, outputs=outputs, causal_order=r, noncausal_order=d)


def changed(record, scale=1.0, offset=0.0, start_s=0.0):
    """Return the record in other units, about another zero, on another clock."""
    return Record(record.values * scale + offset, channels=record.channels, sample_period_s=0.01, start_s=start_s)


@pytest.mark.parametrize(("r", "d"), ORDERS)
@pytest.mark.parametrize("samples", [60, 400, 4000])
def test_the_operator_that_made_the_data_is_found_again(r, d, samples):
    markov, record = plant(r, d, samples=samples)
    operator = identified(record, r, d)
    np.testing.assert_allclose(operator.markov, markov, rtol=0, atol=1e-9)
    assert operator.rms_residual.max() < 1e-9


@pytest.mark.parametrize(("r", "d"), ORDERS)
def test_orders_larger_than_needed_give_zeros_at_the_lags_in_excess(r, d):
    markov, record = plant(r, d)
    expected = np.pad(markov, ((2, 3), (0, 0), (0, 0)))
    np.testing.assert_allclose(identified(record, r + 3, d + 2).markov, expected, rtol=0, atol=1e-9)


def test_the_rows_and_columns_follow_the_names_given():
    markov, record = plant(3, 2)
    operator = identified(record, 3, 2, INPUTS[::-1], OUTPUTS[::-1])
    np.testing.assert_allclose(operator.markov, markov[:, ::-1, ::-1], rtol=0, atol=1e-9)
    assert operator.name == "[q p] -> beta r"
    assert operator.look_ahead_s == pytest.approx(0.02)
    assert operator.samples == 400 - 5


def test_another_clock_gives_the_same_bits():
    _, record = plant(3, 2, noise=0.3)
    np.testing.assert_array_equal(
        identified(record, 3, 2).markov, identified(changed(record, start_s=1e6), 3, 2).markov
    )


def test_units_of_inputs_and_outputs_scale_the_parameters_and_the_predictions():
    _, record = plant(3, 2, noise=0.3)
    scales = np.array([1e6, 1e-6, 1e6, 1e-3])
    scaled = changed(record, scale=scales)
    operator, other = identified(record, 3, 2), identified(scaled, 3, 2)
    expected = operator.markov * scales[2:, np.newaxis] / scales[:2]
    np.testing.assert_allclose(other.markov / expected, 1.0, rtol=0, atol=1e-9)
    np.testing.assert_allclose(other.predict(scaled) / scales[2:], operator.predict(record), rtol=0, atol=1e-9)
    assert other.condition == pytest.approx(operator.condition)


def test_a_condition_is_that_of_the_root_however_small_it_is():
    operator = identified(plant(3, 2, noise=0.3)[1], 3, 2)
    assert replace(operator, root=np.diag([8.0, 2.0, 1.0])[np.newaxis]).condition == pytest.approx(8.0)
    assert replace(operator, root=1e-6 * operator.root).condition == pytest.approx(operator.condition)
    assert replace(operator, root=np.zeros_like(operator.root)).condition == np.inf


@pytest.mark.parametrize("lacking", ["root", "input_rms", "noise_variance"])
def test_an_operator_that_wasnt_identified_has_no_covariance(lacking):
    operator = identified(plant(3, 2, noise=0.3)[1], 3, 2)
    assert np.isfinite(operator.covariance("r")).all()
    assert np.isnan(replace(operator, **{lacking: None}).covariance("r")).all()


def test_one_equation_more_than_unknowns_tells_of_the_noise():
    """About a straight line three points leave one degree of freedom, and two none."""
    u, y = np.array([-1.0, 0.0, 1.0]), np.array([0.0, 3.0, 0.0])
    for rows, variance in ((3, 6.0), (2, np.nan)):  # 3 less the mean 1 is 2 off, the ends 1 each
        given = Record(np.column_stack([u, y])[:rows], channels=["p", "r"], sample_period_s=1.0)
        found = identified(given, 0, 0, ["p"], ["r"]).noise_variance[0]
        assert found == pytest.approx(variance, nan_ok=True)


def test_ten_thousand_parameters_are_the_most():
    check_parameters(5000, 2)
    with pytest.raises(InputError, match="10001 lags of 1 inputs are 10001 Markov parameters"):
        check_parameters(10_001, 1)


def sinusoids(periods=10):
    """Return four sinusoids of one frequency: two sinusoids make all of them."""
    angle = 2.0 * np.pi * np.arange(120 * periods) / 120
    waves = [a * np.sin(angle + phase) for a, phase in ((1.0, 0.0), (2.0, 0.7), (0.3, 1.9), (1.5, 3.0))]
    return Record(np.column_stack(waves), channels=["p", "q", "beta", "r"], sample_period_s=0.1)


def test_noise_free_sinusoids_warn_and_predict_all_the_same():
    with pytest.warns(RankWarning, match="determines 2 of the 33 Markov parameters"):
        operator = identified(sinusoids(), 5, 5, ["p", "q", "beta"], ["r"])
    assert operator.rank == 2
    assert operator.condition > 1e10
    assert operator.rms_residual[0] < 1e-9
    # and on a like record that was not identified on
    assert np.nanmax(np.abs(residual(operator, sinusoids(3)).values)) < 1e-9


def test_a_full_rank_is_reported_without_a_warning():
    _, record = plant(3, 2, noise=0.1)
    operator = identified(record, 3, 2)
    assert operator.rank == operator.markov[:, 0, :].size == 12
    assert 1.0 <= operator.condition < 10.0


def test_ten_samples_are_refused_with_the_numbers_of_the_design():
    short = Record(
        np.random.default_rng(1).standard_normal((10, 4)), channels=["p", "q", "beta", "r"], sample_period_s=1
    )
    message = (
        "10 samples of p, q, beta give 0 equations for 303 Markov parameters and a constant of 'r'; "
        "record at least 404 samples or lower the orders"
    )
    with pytest.raises(InputError) as refused:
        identified(short, 50, 50, ["p", "q", "beta"], ["r"])
    assert str(refused.value) == message


@pytest.mark.filterwarnings("ignore::gtmbench.errors.RankWarning")
def test_the_least_number_of_samples_is_the_one_that_is_asked_for():
    values = np.random.default_rng(1).standard_normal((404, 4))
    enough, short = (Record(part, channels=["p", "q", "beta", "r"], sample_period_s=1) for part in (values, values[1:]))
    assert identified(enough, 50, 50, ["p", "q", "beta"], ["r"]).samples == 304
    with pytest.raises(InputError, match=r"403 samples .* give 303 equations"):
        identified(short, 50, 50, ["p", "q", "beta"], ["r"])


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("channel", [*INPUTS, *OUTPUTS])
def test_missing_samples_are_refused_by_channel_and_time(bad, channel):
    _, record = plant(3, 2)
    holed = record[channel].copy()
    holed[[150, 151]] = bad
    with pytest.raises(InputError, match=f"channel '{channel}' has 2 missing samples, the first at 1.5 s"):
        identified(record.replace(channel, holed), 3, 2)


@pytest.mark.parametrize("channel", [*INPUTS, *OUTPUTS])
def test_a_constant_channel_is_refused(channel):
    _, record = plant(3, 2)
    with pytest.raises(InputError, match=f"channel '{channel}' is constant"):
        identified(record.replace(channel, np.full(len(record), 0.1)), 3, 2)


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"inputs": ["p", "alpha"]}, "no channel 'alpha' in this record; it has p, q, r, beta"),
        ({"outputs": ["alpha"]}, "no channel 'alpha'"),
        ({"inputs": ["p", "r"]}, "'r' is both pseudo input and pseudo output"),
        ({"inputs": []}, "at least one pseudo input"),
        ({"outputs": []}, "at least one pseudo input and one pseudo output"),
        ({"causal_order": -1}, "causal_order is -1; it must be a whole number, 0 or more"),
        ({"noncausal_order": -1}, "noncausal_order is -1"),
        ({"causal_order": 2.0}, "causal_order is 2.0"),
        ({"noncausal_order": 2.5}, "noncausal_order is 2.5"),
        ({"causal_order": True}, "causal_order is True"),
        ({"weights": []}, "weights of shape"),
        ({"weights": "ab"}, "weights hold a str; give numbers"),
        ({"weights": {}}, "weights hold a dict"),
        ({"weights": -np.ones(400)}, "weights must be 0 or numbers from 1e-100 to 1e100"),
        ({"weights": np.full(400, 0.9e-100)}, "weights must be 0 or numbers from 1e-100"),
        ({"weights": np.full(400, 1.1e100)}, "weights must be 0 or numbers from 1e-100 to 1e100"),
        ({"weights": 1j * np.ones(400)}, "weights hold a ndarray; give numbers"),
        ({"estimator": LeastSquares}, "give an object, such as"),
        ({"estimator": "LS"}, "estimator is 'LS'; give an object"),
        ({"inputs": 3}, "inputs holds 3; give names of channels"),
        ({"inputs": ["p", "p"]}, "'p' is given twice in inputs"),
    ],
    ids=range(21),
)
def test_what_cant_be_identified_is_refused(asked, message):
    _, record = plant(3, 2)
    legal = {"inputs": INPUTS, "outputs": OUTPUTS, "causal_order": 3, "noncausal_order": 2}
    with pytest.raises(InputError, match=message) as refused:
        identify(record, **{**legal, **asked})
    assert "\n" not in str(refused.value)


def test_records_of_two_sample_periods_are_refused():
    _, record = plant(3, 2)
    slower = Record(record.values, channels=record.channels, sample_period_s=0.02)
    for records in ([record, slower], [slower, record, record]):
        with pytest.raises(InputError, match=r"every 0\.01, 0\.02 s; one operator has one sample period"):
            identified(records, 3, 2)


@pytest.mark.parametrize("records", [None, 3, np.ones((5, 2)), [None], "p", []], ids=range(6))
def test_what_isnt_a_record_is_refused(records):
    with pytest.raises(InputError, match=r"was given for a Record; wrap it|no record given"):
        identify(records, inputs=INPUTS, outputs=OUTPUTS, causal_order=3, noncausal_order=2)

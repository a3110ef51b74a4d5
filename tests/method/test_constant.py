"""The constant of an operator: an unknown of its own, the means of the records, or none, as the source prints it."""

import numpy as np
import pytest

import gtmbench as gb
from gtmbench.errors import InputError
from tests.helpers.oracles import lagged, siso

R, D = 3, 2
NAMES = {"inputs": ["u", "v"], "outputs": ["y", "z"]}
ORDERS = {**NAMES, "causal_order": R, "noncausal_order": D}
ESTIMATORS = [
    gb.LeastSquares(),
    gb.LeastSquares(ridge=0.1),
    gb.LeastSquares(truncate=0.1),
    gb.InstrumentalVariables(instruments=("c", "e"), past=4),
    gb.PredictionError(noise_order=2),
    gb.TotalLeastSquares(noise=0.1),
    gb.Bayesian(),
]


def kind(estimator):
    return type(estimator).__name__


def wandering(seed=1, samples=300, offset=0.0):
    """Return a short record whose ends lie far from its mean, and so do the means over its equations."""
    rng = np.random.default_rng(seed)
    u = rng.standard_normal((samples, 2)) + np.linspace(-4.0, 9.0, samples)[:, None] ** 2 * [0.1, 0.05]
    y = np.roll(u, 2, axis=0) @ [[1.0, -0.5], [0.3, 2.0]] + 0.5 * rng.standard_normal((samples, 2)) + [30.0, -7.0]
    c = u + 0.3 * rng.standard_normal((samples, 2))
    return gb.Record(np.column_stack([u, y, c]) + offset, channels=["u", "v", "y", "z", "c", "e"], sample_period_s=0.01)


def equations(record):
    return lagged(record.matrix(NAMES["inputs"]), R, D), record.matrix(NAMES["outputs"])[R : len(record) - D]


@pytest.mark.parametrize("constant", ["estimated", "none"])
def test_least_squares_are_those_of_lstsq_with_a_column_of_ones_or_without(constant):
    record = wandering()
    phi, y = equations(record)
    phi = np.column_stack([phi, np.ones(len(phi))]) if constant == "estimated" else phi
    theta, squares, _, _ = np.linalg.lstsq(phi, y)
    operator = gb.identify(record, constant=constant, **ORDERS)
    np.testing.assert_allclose(operator.markov.transpose(0, 2, 1).reshape(-1, 2), theta[:12], rtol=0, atol=1e-11)
    np.testing.assert_allclose(operator.rms_residual, np.sqrt(squares / len(phi)), rtol=1e-10)
    left = gb.residual(operator, record).values[R:-D]
    np.testing.assert_allclose(left, y - phi @ theta, rtol=0, atol=1e-10)
    variance = squares / (len(phi) - phi.shape[1])
    deviations = np.sqrt(np.diag(np.linalg.inv(phi.T @ phi))[:12, None] * variance)
    stated = operator.standard_error.transpose(0, 2, 1).reshape(-1, 2)
    np.testing.assert_allclose(stated, deviations, rtol=1e-9)
    np.testing.assert_allclose(operator.constant, theta[12] if constant == "estimated" else 0.0, rtol=0, atol=1e-9)


@pytest.mark.parametrize("estimator", ESTIMATORS[:-1], ids=kind)  # the equations of the last are of slow motion
def test_the_residual_has_no_mean_whatever_estimates_the_operator(estimator):
    record = wandering()
    left = gb.residual(gb.identify(record, estimator=estimator, **ORDERS), record).values
    ahead = {"InstrumentalVariables": R + 4}.get(kind(estimator), R)
    np.testing.assert_allclose(left[ahead:-D].mean(axis=0), 0.0, atol=1e-10)


@pytest.mark.parametrize("constant", ["estimated", "records"])
@pytest.mark.parametrize("estimator", ESTIMATORS, ids=kind)
def test_an_offset_moves_the_constant_alone(estimator, constant):
    plain, offset = (
        gb.identify(wandering(offset=offset), estimator=estimator, constant=constant, **ORDERS)
        for offset in (0.0, np.array([5.0, -3.0, 100.0, 7.0, 2.0, -2.0]))
    )
    np.testing.assert_allclose(offset.markov, plain.markov, rtol=0, atol=1e-9 * np.abs(plain.markov).max())
    np.testing.assert_allclose(offset.output_means - plain.output_means, [100.0, 7.0], rtol=0, atol=1e-8)
    np.testing.assert_allclose(offset.input_means - plain.input_means, [5.0, -3.0], rtol=0, atol=1e-10)


@pytest.mark.parametrize("estimator", ESTIMATORS, ids=kind)
def test_means_of_the_records_are_those_of_their_samples(estimator):
    record = wandering()
    operator = gb.identify(record, estimator=estimator, constant="records", **ORDERS)
    means = record.values.mean(axis=0)
    np.testing.assert_allclose([*operator.input_means, *operator.output_means], means[:4], rtol=1e-12)
    centred = gb.Record(record.values - means, channels=record.channels, sample_period_s=0.01)
    other = gb.identify(centred, estimator=estimator, constant="records", **ORDERS)
    np.testing.assert_allclose(operator.markov, other.markov, rtol=0, atol=1e-9 * np.abs(other.markov).max())


@pytest.mark.parametrize("estimator", ESTIMATORS[:-1], ids=kind)
def test_without_a_constant_nothing_is_predicted_of_nothing(estimator):
    operator = gb.identify(wandering(), estimator=estimator, constant="none", **ORDERS)
    nothing = gb.Record(np.zeros((20, 2)), channels=["u", "v"], sample_period_s=0.01)
    assert not operator.predict(nothing)[R:-D].any()


def test_an_errors_in_variables_estimate_has_a_column_without_errors():
    """Mixed least squares and total least squares, by the closed form of one direction: Golub and Van Loan."""
    record = wandering(samples=2000)
    phi, y = equations(record)
    both = np.column_stack([phi, y[:, 0]])
    both = both - both.mean(axis=0)
    direction = np.linalg.svd(both)[2][-1]
    found = siso(record, gb.TotalLeastSquares(noise=1.0, rank=12), R, D, NAMES["inputs"], ["y"])
    np.testing.assert_allclose(found.markov[:, 0].ravel(), -direction[:-1] / direction[-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize("constant", ["estimated", "records", "none"])
@pytest.mark.parametrize("forgetting", [1.0, 0.995])
def test_recursion_and_the_batch_treat_it_alike(constant, forgetting):
    record = wandering(offset=20.0)
    running = gb.RecursiveIdentification(**ORDERS, forgetting=forgetting, constant=constant)
    for start in range(0, 300, 37):
        end = min(start + 37, 300) - 1
        running.push(record.between(record.time_s[start], record.time_s[end]))
    weights = forgetting ** np.arange(299.0, -1.0, -1.0)
    batch, now = gb.identify(record, weights=weights, constant=constant, **ORDERS), running.operator()
    np.testing.assert_allclose(now.markov, batch.markov, rtol=0, atol=1e-9)
    for name in ("output_means", "rms_residual", "standard_error"):
        np.testing.assert_allclose(getattr(now, name), getattr(batch, name), rtol=1e-7, err_msg=name)


@pytest.mark.parametrize("constant", ["estimated", "records", "none"])
def test_nested_orders_keep_it_and_judge_other_records_by_it(constant):
    record, other = wandering(), wandering(seed=2, offset=3.0)
    orders = {"causal_orders": [1, R], "noncausal_orders": [D]}
    choice = gb.select_orders(record, **NAMES, **orders, validation=other, constant=constant)
    row = choice.table.iloc[-1]
    operator = gb.identify(record, constant=constant, **ORDERS)
    np.testing.assert_allclose([row["rms_y"], row["rms_z"]], operator.rms_residual, rtol=1e-9)
    left = gb.residual(operator, other).values[R:-D]
    held_out = np.sqrt(np.mean(left**2, axis=0))
    np.testing.assert_allclose([row["heldout_y"], row["heldout_z"]], held_out, rtol=1e-9)
    inputs = gb.select_inputs(record, candidates=["u", "v"], outputs=["y", "z"], causal_order=R, noncausal_order=D,
                              constant=constant)  # fmt: skip
    np.testing.assert_allclose(inputs.table[["rms_y", "rms_z"]].iloc[-1], operator.rms_residual, rtol=1e-9)


def test_its_kind_is_checked():
    with pytest.raises(InputError, match="constant is 'mean'; it is 'estimated', 'records' or 'none'"):
        gb.identify(wandering(), constant="mean", **ORDERS)
    with pytest.raises(InputError, match="constant is None"):
        gb.RecursiveIdentification(**ORDERS, constant=None)

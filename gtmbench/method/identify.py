"""Identification: records in, a transmissibility operator out, by any estimator (sections 3.6 and 4.3)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence

import numpy as np

from gtmbench.errors import ConvergenceWarning, InputError, RankWarning
from gtmbench.jobs.threads import on_one_thread
from gtmbench.method.estimators.least_squares import LeastSquares
from gtmbench.method.problem import (
    Constant,
    Estimate,
    Estimator,
    Problem,
    Records,
    Weights,
    operator_names,
    pose_problem,
)
from gtmbench.method.regression.triangle import rounding
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.values.record import FloatArray, frozen


@on_one_thread
def identify(
    records: Records,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    causal_order: int,
    noncausal_order: int,
    estimator: Estimator | None = None,
    weights: Weights = None,
    constant: Constant = "estimated",
) -> Transmissibility:
    """Identify the operator from inputs to outputs, equations (4.8) and (4.9), or as another estimator defines it.

    theta = argmin of the sum over k = r..l-d of ||y_o(k) - c - sum over i = -d..r of H_i y_i(k-i)||^2. The printed
    equations have no constant c, so they hold for signals about a trim that is known exactly.

    Parameters
    ----------
    records : Record or sequence of Record
        Healthy measurements, for example ``record.between(25, 200)``; several flights, or the parts between gaps.
    inputs, outputs : sequence of str
        Pseudo inputs and pseudo outputs.
    causal_order, noncausal_order : int
        r and d, samples into the past and into the future; 0 is allowed.
    estimator : Estimator, optional
        By default `LeastSquares`; or `Bayesian`, `InstrumentalVariables`, `PredictionError`, `TotalLeastSquares`.
    weights : array_like, shape (samples,), optional
        Factors of the squares in the sum, one a sample, 0 or more (with several records a list, one array each, None
        for all 1). A sample of weight 0 isn't used at all, so it may be missing. A sample of weight 2 counts twice, for
        standard errors, too: scale weights of 1/variance to a mean of 1.
    constant : str
        "estimated": c is one more unknown of every output, one for all records. "records": the means of the records,
        over k = 0..l, are removed instead; the ends, which have no equation, then bias the parameters of short records.
        "none": c = 0, as printed.

    Raises
    ------
    InputError
        If channels are missing, constant, hold NaN, or the records are too short.

    Warns
    -----
    RankWarning
        If the data don't determine the Markov parameters (noise-free sinusoids don't), naming the channels.
    ConvergenceWarning
        If a noise model hasn't settled.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> y = 2.0 * u + np.roll(u, -1)  # y(k) = 2 u(k) + u(k+1)
    >>> record = gb.Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=0.01)
    >>> operator = gb.identify(record, inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=1)
    >>> operator.markov[:, 0, 0].round(9) + 0.0
    array([1., 2., 0.])
    """
    method = LeastSquares() if estimator is None else estimator
    if isinstance(method, type) or not callable(getattr(method, "estimate", None)):
        raise InputError(f"estimator is {method!r}; give an object, such as gtmbench.LeastSquares()")
    u, y = operator_names(inputs, outputs)
    problem = pose_problem(
        records,
        u,
        y,
        causal_order,
        noncausal_order,
        instruments=method.instruments,
        weights=weights,
        constant=constant,
    )
    return operator_of(problem, method.estimate(problem), method)


def operator_of(problem: Problem, estimate: Estimate, estimator: Estimator) -> Transmissibility:
    """Return the operator in the channels' units; warn where it isn't determined or the search hasn't ended."""
    if estimate.rank < problem.parameters and not estimate.rank_chosen:
        _warn_of_rank(problem, estimate)
    if estimate.noise_model is not None and not estimate.noise_model.converged:
        turns = len(estimate.noise_model.criterion)
        warnings.warn(
            f"the noise model hasn't settled after {turns} iterations; allow more, or lower its order",
            ConvergenceWarning,
            stacklevel=3,
        )
    # the problem is centred and scaled to RMS 1, its rows run from lag -d to r: here units come back, and H_r first
    skipped, split = len(problem.instruments), len(problem.instruments) + len(problem.inputs)
    rms, output_rms = problem.scale[skipped:split], problem.scale[split:]
    scaled = estimate.coefficients.reshape(problem.lags, len(rms), len(output_rms))[::-1]
    root = estimate.root.view()  # no copy: it is as large as the Gram matrix
    root.setflags(write=False)
    return Transmissibility(
        markov=frozen(scaled.transpose(0, 2, 1) * (output_rms[:, np.newaxis] / rms)),
        inputs=problem.inputs,
        outputs=problem.outputs,
        causal_order=problem.causal_order,
        noncausal_order=problem.noncausal_order,
        input_means=frozen(problem.centre[skipped:split]),
        output_means=frozen(problem.centre[split:] + estimate.constant * output_rms),
        input_rms=frozen(rms),
        rank=estimate.rank,
        samples=estimate.equations,
        rms_residual=frozen(estimate.rms_residual * output_rms),
        noise_variance=frozen(estimate.noise_variance * output_rms**2),
        root=root,
        sample_period_s=problem.sample_period_s,
        estimator=repr(estimator),
        solver=estimate.solver,
        noise_model=estimate.noise_model,
        sensor_noise=estimate.sensor_noise,
    )


def _warn_of_rank(problem: Problem, estimate: Estimate) -> None:
    what, limit = "record determines", ""
    if problem.instruments:
        what, limit = f"instruments {', '.join(problem.instruments)} determine", ", as far as they see it,"
    warnings.warn(
        f"the {what} {estimate.rank} of the {problem.parameters} Markov parameters of an output: "
        f"{cause(estimate.root[0], problem.inputs, estimate.equations)}{limit}; the smallest ones that fit were taken. "
        "Predictions on like records hold; don't read the parameters",
        RankWarning,
        stacklevel=4,
    )


def cause(root: FloatArray, channels: Sequence[str], equations: int) -> str:
    """Return which channels leave Markov parameters undetermined, and how.

    `root`, shape (lags channels,): R of the regressor, columns lag by lag, channel by channel within.

    >>> u = np.random.default_rng(1).standard_normal((500, 3))
    >>> u[:, 2] = u[:, 0] + u[:, 1]
    >>> cause(np.linalg.qr(u, mode="r"), ["p", "q", "s"], 500)
    "'s' follows from p, q"
    """
    size, count = len(root), len(channels)
    lags = size // count
    by_channel = root.reshape(size, lags, count)
    tolerance = rounding(equations, size) * float(np.linalg.norm(root, 2))

    def rank(numbers: Sequence[int]) -> int:
        return int(np.linalg.matrix_rank(by_channel[:, :, numbers].reshape(size, -1), tolerance))

    alone = [(name, rank([i])) for i, name in enumerate(channels)]
    poor = [f"'{name}' ({determined} of its {lags} lags)" for name, determined in alone if determined < lags]
    if poor:
        return f"too few frequencies in {', '.join(poor)}"
    for last in range(1, count):
        if rank(range(last + 1)) < (last + 1) * lags:
            pairs = [channels[i] for i in range(last) if rank([i, last]) < 2 * lags]
            return f"'{channels[last]}' follows from {', '.join(pairs or channels[:last])}"
    return "the channels hardly move apart"

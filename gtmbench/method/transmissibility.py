"""The transmissibility operator: a noncausal FIR model from some sensors to others (section 4.2)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from gtmbench.errors import InputError
from gtmbench.method.filters import NoiseModel, filtered
from gtmbench.values.channels import unit_of
from gtmbench.values.notebook import card, figure
from gtmbench.values.record import FloatArray, Record


@dataclass(frozen=True, kw_only=True, eq=False)
class Transmissibility:
    """An identified operator T(q) = sum over i = -d..r of H_i q^-i, equation (4.2).

    Attributes
    ----------
    markov : shape (lags, outputs, inputs)
        H_i for i = -d..r, in this order; units: those of the output over those of the input.
    inputs, outputs : tuple of str
        Pseudo inputs and pseudo outputs.
    causal_order, noncausal_order : int
        r and d.
    input_means, output_means : shape (inputs,), shape (outputs,)
        What is subtracted from the inputs, their means over the records, and the output that is predicted there.
    input_rms : shape (inputs,)
        RMS values of the identification record about these means.
    rank : int
        Of the regressor; below ``markov[:, 0, :].size`` the data don't determine the Markov parameters.
    samples : int
        Equations, one a sample k = r..l-d of every record.
    rms_residual : shape (outputs,)
        Root mean square of the identification residual, in the outputs' units.
    noise_variance : shape (outputs,)
        Variance of the white noise for `covariance`; NaN if the estimator's theory gives none.
    root : shape (outputs or 1, parameters, parameters)
        S, every input scaled to an RMS of 1, columns from lag r to -d: (S'S)^-1 is the covariance for unit noise.
    sample_period_s : float
        Ts, in seconds.
    estimator, solver : str
        The estimator; "cholesky" (of the Gram matrix) or "householder" (orthogonal, on the equations).
    noise_model : NoiseModel, optional
        The noise model of the prediction-error method.
    sensor_noise : shape (inputs + outputs,), optional
        Standard deviations used by total least squares, in the channels' units.

    Examples
    --------
    >>> import numpy as np
    >>> import gtmbench as gb
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> y = 2.0 * u + 0.5 * np.roll(u, 1)
    >>> record = gb.Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=0.01)
    >>> operator = gb.identify(record, inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=0)
    >>> operator.name, operator.lags.tolist()
    ('[u] -> y', [0, 1])
    >>> operator.markov[:, 0, 0].round(6).tolist()  # H_0 and H_1
    [2.0, 0.5]
    >>> np.allclose(operator.predict(record)[1:, 0], y[1:])
    True
    """

    markov: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    causal_order: int
    noncausal_order: int
    input_means: FloatArray
    output_means: FloatArray
    rank: int
    samples: int
    rms_residual: FloatArray
    sample_period_s: float
    input_rms: FloatArray | None = None
    noise_variance: FloatArray | None = None
    root: FloatArray | None = field(default=None, repr=False)
    estimator: str = "LeastSquares()"
    solver: str = "cholesky"
    noise_model: NoiseModel | None = None
    sensor_noise: FloatArray | None = None

    def __post_init__(self) -> None:
        shape = (len(self.lags), len(self.outputs), len(self.inputs))
        if np.shape(self.markov) != shape:
            raise InputError(f"markov has shape {np.shape(self.markov)}; {self.name} with these orders has {shape}")

    def __repr__(self) -> str:
        return (
            f"Transmissibility({self.name}, lags {-self.noncausal_order}..{self.causal_order}, rank {self.rank} of "
            f"{len(self.lags) * len(self.inputs)}, condition {self.condition:.3g})"
        )

    def _repr_html_(self) -> str:
        facts = {
            "lags": f"-{self.noncausal_order} to {self.causal_order} samples of {self.sample_period_s:g} s",
            "equations": f"{self.samples}, rank {self.rank} of {len(self.lags) * len(self.inputs)}",
            "condition": figure(self.condition, ".3g"),
            "found by": f"{self.estimator}, {self.solver}",
            "residual's RMS": ", ".join(
                f"{name} {figure(float(rms))} {unit_of(name)}".rstrip()
                for name, rms in zip(self.outputs, self.rms_residual, strict=True)
            ),
        }
        rows = [self._pair(o, i) for o in range(len(self.outputs)) for i in range(len(self.inputs))]
        columns = ("from", "to", "greatest H_i", "at lag i", "sum of H_i")
        return card(f"Transmissibility operator {self.name}", facts, columns=columns, rows=rows)

    def _pair(self, output: int, i: int) -> tuple[object, ...]:
        """Say how one input enters one output: the Markov parameter that is greatest, its lag, the sum of all."""
        parameters = self.markov[:, output, i]
        peak = int(np.argmax(np.abs(parameters)))
        greatest, total = figure(float(parameters[peak])), figure(float(parameters.sum()))
        return self.inputs[i], self.outputs[output], greatest, int(self.lags[peak]), total

    @property
    def lags(self) -> np.ndarray[tuple[int], np.dtype[np.int_]]:
        """The lags i = -d..r of `markov`."""
        return np.arange(-self.noncausal_order, self.causal_order + 1)

    @property
    def constant(self) -> FloatArray:
        """What the operator adds to the sum of H_i y_i(k-i), shape (outputs,), in the outputs' units."""
        return np.asarray(self.output_means - self.markov.sum(axis=0) @ self.input_means)

    @property
    def look_ahead_s(self) -> float:
        """The latency of its prediction: d Ts, in seconds."""
        return self.noncausal_order * self.sample_period_s

    @property
    def name(self) -> str:
        """Its name: ``[p q beta] -> r``."""
        return f"[{' '.join(self.inputs)}] -> {' '.join(self.outputs)}"

    @cached_property
    def condition(self) -> float:
        """Condition number of the equations solved, every input scaled to an RMS of 1; the greatest of the outputs.

        NaN for an operator that wasn't identified.
        """
        if self.root is None:
            return float("nan")
        singular = np.linalg.svd(self.root, compute_uv=False)
        return float((singular[:, 0] / singular[:, -1]).max()) if singular[:, -1].min() > 0 else float("inf")

    @cached_property
    def standard_error(self) -> FloatArray:
        """Standard deviations of `markov`, same shape and units; NaN where the theory or the data give none."""
        errors = np.full(self.markov.shape, np.nan)
        for o in range(len(self.outputs)):
            deviation = np.sqrt(np.sum(self._factor(o) ** 2, axis=1))
            errors[:, o] = deviation.reshape(len(self.lags), len(self.inputs))[::-1]
        return errors

    def covariance(self, output: str) -> FloatArray:
        """Return the covariance of one output's Markov parameters, shape (lags, inputs, lags, inputs).

        noise variance times (Phi' Phi)^-1 for least squares (Phi projected by the instruments, or filtered by the noise
        model; a ridge counts as equations). It assumes a white residual; `PredictionError` makes it white. For
        `Bayesian` it is the covariance of the parameters given the records.

        Raises
        ------
        InputError
            If there is no such output.
        """
        root = self.covariance_root(output)
        return np.asarray((root @ root.T).reshape((len(self.lags), len(self.inputs)) * 2))

    def covariance_root(self, output: str) -> FloatArray:
        """Return F, shape (parameters, parameters), with F F' the covariance; rows from lag -d to r, input by input.

        Raises
        ------
        InputError
            If there is no such output.
        """
        if output not in self.outputs:
            raise InputError(f"'{output}' isn't a pseudo output of {self.name}; it has {', '.join(self.outputs)}")
        factor = self._factor(self.outputs.index(output))
        return factor.reshape(len(self.lags), len(self.inputs), -1)[::-1].reshape(factor.shape)

    def _factor(self, output: int) -> FloatArray:
        """Return F, rows from lag r to -d, with F F' the covariance of an output's parameters in their units."""
        from scipy.linalg import lapack

        size = len(self.lags) * len(self.inputs)
        if self.root is None or self.input_rms is None or self.noise_variance is None or self.rank < size:
            return np.full((size, size), np.nan)
        inverse, _ = lapack.dtrtri(self.root[min(output, len(self.root) - 1)])
        scale = np.sqrt(self.noise_variance[output]) / np.tile(self.input_rms, len(self.lags))
        return np.asarray(inverse * scale[:, np.newaxis])

    def predict(self, record: Record) -> FloatArray:
        """Return the one-step prediction, shape (samples, outputs), in the outputs' units.

        y_o(k|theta) = sum over i = -d..r of H_i y_i(k - i), equation (4.4), and the constant, for k = r..l-d; NaN at
        the other samples and wherever a sample k - i is missing.

        Raises
        ------
        InputError
            If the record lacks an input or has another sample period.
        """
        record.check_period(self.sample_period_s, f"the operator {self.name} was identified at")
        return self.predicted([record[name] for name in self.inputs])

    def predicted(self, channels: Sequence[FloatArray]) -> FloatArray:
        """Return the result of `predict` for these channels, one an input, of shape (samples,)."""
        r, d, samples = self.causal_order, self.noncausal_order, len(channels[0])
        predicted = np.full((samples, len(self.outputs)), np.nan)
        # the first complete window, samples 0..r+d, predicts sample r: there lag -d is the newest
        filtered(channels, self.markov, self.input_means, out=predicted[r : max(samples - d, r)])
        predicted += self.output_means
        return predicted

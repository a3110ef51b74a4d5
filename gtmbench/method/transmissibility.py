"""The transmissibility operator: a noncausal FIR model from some sensors to others (section 4.2)."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from gtmbench.checks import whole
from gtmbench.errors import InputError, RankWarning
from gtmbench.method.convolution import filtered
from gtmbench.method.least_squares import solve
from gtmbench.record import FloatArray, Record, frozen

_LARGEST_REGRESSOR_GB = 4.0  # the solver needs about three times as much


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
        Means of the identification record; the operator works on what is left without them.
    rank : int
        Of the regressor; below ``markov[:, 0, :].size`` the data don't determine the Markov parameters.
    condition : float
        Condition number of the regressor, every input scaled to an RMS of 1.
    samples : int
        Equations, one a sample k = r..l-d.
    rms_residual : shape (outputs,)
        Root mean square of the identification residual, in the outputs' units.
    sample_period_s : float
        Ts, in seconds.
    """

    markov: FloatArray
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    causal_order: int
    noncausal_order: int
    input_means: FloatArray
    output_means: FloatArray
    rank: int
    condition: float
    samples: int
    rms_residual: FloatArray
    sample_period_s: float

    def __repr__(self) -> str:
        return (
            f"Transmissibility({self.name}, lags {-self.noncausal_order}..{self.causal_order}, rank {self.rank} of "
            f"{len(self.lags) * len(self.inputs)}, condition {self.condition:.3g})"
        )

    @property
    def lags(self) -> np.ndarray[tuple[int], np.dtype[np.int_]]:
        """The lags i = -d..r of `markov`."""
        return np.arange(-self.noncausal_order, self.causal_order + 1)

    @property
    def look_ahead_s(self) -> float:
        """How long after a sample its prediction exists: d Ts, in seconds."""
        return self.noncausal_order * self.sample_period_s

    @property
    def name(self) -> str:
        """How it is written: ``[p q beta] -> r``."""
        return f"[{' '.join(self.inputs)}] -> {' '.join(self.outputs)}"

    def predict(self, record: Record) -> FloatArray:
        """Return the one-step prediction, shape (samples, outputs), in the outputs' units.

        y_o(k|theta) = sum over i = -d..r of H_i y_i(k - i), equation (4.4), for k = r..l-d; NaN at the other samples
        and wherever a sample k - i is missing.

        Raises
        ------
        InputError
            Where the record lacks an input or has another sample period.
        """
        self._check(record)
        channels = [record[name] for name in self.inputs]
        r, d = self.causal_order, self.noncausal_order
        predicted = np.full((len(record), len(self.outputs)), np.nan)
        # the first complete window, samples 0..r+d, predicts sample r: there lag -d is the newest
        filtered(channels, self.markov, self.input_means, out=predicted[r : max(len(record) - d, r)])
        predicted += self.output_means
        return predicted

    def _check(self, record: Record) -> None:
        if abs(record.sample_period_s - self.sample_period_s) > 1e-6 * self.sample_period_s:
            raise InputError(
                f"the record is sampled every {record.sample_period_s:g} s, the operator {self.name} was identified at "
                f"{self.sample_period_s:g} s; resample the record or identify anew"
            )


def identify(
    record: Record,
    *,
    inputs: Sequence[str],
    outputs: Sequence[str],
    causal_order: int,
    noncausal_order: int,
) -> Transmissibility:
    """Identify the operator from inputs to outputs by least squares, equations (4.8) and (4.9).

    theta = argmin of the sum over k = r..l-d of ||y_o(k) - sum over i = -d..r of H_i y_i(k-i)||^2, the means of the
    record removed. (Means over k = 0..l, not over the equations: the ends cost a bias that falls with the length.)

    Parameters
    ----------
    record : Record
        Healthy measurements, for example ``record.between(25, 200)``.
    inputs, outputs : sequence of str
        Pseudo inputs and pseudo outputs.
    causal_order, noncausal_order : int
        r and d, samples into the past and into the future; 0 is allowed.

    Raises
    ------
    InputError
        Where channels are missing, constant, hold NaN, or the record is too short.

    Warns
    -----
    RankWarning
        Where the data don't determine the Markov parameters (noise-free sinusoids don't).

    Examples
    --------
    >>> u = np.random.default_rng(1).standard_normal(500)
    >>> y = 2.0 * u + np.roll(u, -1)  # y(k) = 2 u(k) + u(k+1)
    >>> record = Record(np.column_stack([u, y]), channels=["u", "y"], sample_period_s=0.01)
    >>> identify(record, inputs=["u"], outputs=["y"], causal_order=1, noncausal_order=1).markov[:, 0, 0].round(9) + 0.0
    array([1., 2., 0.])
    """
    inputs, outputs = _names(inputs), _names(outputs)
    _check_channels(record, inputs, outputs)
    causal_order = whole("causal_order", causal_order)
    noncausal_order = whole("noncausal_order", noncausal_order)
    _check_length(record, inputs, outputs, causal_order, noncausal_order)
    u, y = record.matrix(inputs), record.matrix(outputs)
    input_means, output_means = u.mean(axis=0), y.mean(axis=0)
    solution = solve(u - input_means, y - output_means, causal_order, noncausal_order)
    parameters = (causal_order + noncausal_order + 1) * len(inputs)
    if solution.rank < parameters:
        warnings.warn(
            f"the record determines {solution.rank} of the {parameters} Markov parameters of an output; the smallest "
            "ones that fit were taken. Predictions on like records hold; don't read the parameters",
            RankWarning,
            stacklevel=2,
        )
    found = Transmissibility(
        markov=frozen(solution.coefficients.transpose(0, 2, 1)),
        inputs=inputs,
        outputs=outputs,
        causal_order=causal_order,
        noncausal_order=noncausal_order,
        input_means=frozen(input_means),
        output_means=frozen(output_means),
        rank=solution.rank,
        condition=solution.condition,
        samples=len(record) - causal_order - noncausal_order,
        rms_residual=frozen(np.full(len(outputs), np.nan)),
        sample_period_s=record.sample_period_s,
    )
    left = record.matrix(outputs) - found.predict(record)
    return replace(found, rms_residual=frozen(np.sqrt(np.nanmean(left**2, axis=0))))


def _names(names: Sequence[str]) -> tuple[str, ...]:
    return (names,) if isinstance(names, str) else tuple(names)


def _check_channels(record: Record, inputs: tuple[str, ...], outputs: tuple[str, ...]) -> None:
    if not inputs or not outputs:
        raise InputError("an operator needs at least one pseudo input and one pseudo output")
    twice = [name for names in (inputs, outputs) for name in names if names.count(name) > 1]
    if twice:
        raise InputError(f"'{twice[0]}' is given twice; name every pseudo input and pseudo output once")
    both = [name for name in outputs if name in inputs]
    if both:
        raise InputError(f"'{both[0]}' is both pseudo input and pseudo output; it would predict itself")
    for name in (*inputs, *outputs):
        values = record[name]
        missing = ~np.isfinite(values)
        if missing.any():
            first = int(np.flatnonzero(missing)[0])
            raise InputError(
                f"channel '{name}' has {int(missing.sum())} missing samples, the first at {record.time_s[first]:g} s; "
                "identify on a stretch without, with record.between"
            )
        if len(values) and np.ptp(values) == 0:
            raise InputError(
                f"channel '{name}' is constant ({values[0]:g}) over the record: nothing can be identified from or for "
                "it; leave it out or choose another stretch"
            )


def _check_length(
    record: Record, inputs: tuple[str, ...], outputs: tuple[str, ...], causal_order: int, noncausal_order: int
) -> None:
    lags = causal_order + noncausal_order + 1
    parameters = lags * len(inputs)
    equations = max(len(record) - lags + 1, 0)
    if equations < parameters:
        raise InputError(
            f"{len(record)} samples of {', '.join(inputs)} give {equations} equations for {parameters} Markov "
            f"parameters of '{outputs[0]}'; record at least {parameters + lags - 1} samples or lower the orders"
        )
    gigabytes = equations * parameters * 8 / 1e9
    if gigabytes > _LARGEST_REGRESSOR_GB:
        raise InputError(
            f"{equations} equations for {parameters} Markov parameters take {gigabytes:.0f} GB; identify on a shorter "
            "stretch or lower the orders"
        )

"""Cautious identification: what a few seconds or minutes of flight say of an operator, and what they leave open.

Least squares on such records fits their one manoeuvre, and takes an input at rest, which is noise, for a sensor without
gain. Here theta ~ N(theta_0, K) before the data: a pseudo input that reproduces the sensor (p_att for p) does so but
for gain, delay and small change; other inputs do at most what the output's own size allows. Data then speak where
they hold more motion than noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from gtmbench.detectors.bank.bank import ResidualSpec
from gtmbench.errors import InputError
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, derive
from gtmbench.method.regression.slow import regressors, slow
from gtmbench.method.transmissibility import Transmissibility
from gtmbench.record import FloatArray, Record, frozen

_GAIN = 0.01  # deviation of a gyro's gain
_DELAY_S = 0.05  # of the delay between two sensors
_TAP = 0.005  # of each Markov parameter beside
_FREE = 3.0  # of an input's contribution, over the output's RMS
_ALIKE = 5.0  # so many equations in a row say what one does: slow motion has a tenth of the band
_CHUNK = 4096
_ITERATIONS = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Cautious:
    """An operator and the root F of the covariance F F' of its Markov parameters.

    `variance` is that of the slow residual, `rms` that of inputs and output, in this order.
    """

    operator: Transmissibility
    root: FloatArray = field(repr=False)
    variance: float
    rms: FloatArray


def identify_cautiously(records: Sequence[Record], spec: ResidualSpec, *, rms: FloatArray | None = None) -> Cautious:
    """Identify one residual of a bank: the mean of theta given the records, and its covariance.

    H = K^-1 + S / s^2, theta = theta_0 + H^-1 S G^-1 Phi'(y - Phi theta_0) / s^2, on slow motion; G = Phi'Phi, and S is
    what of G isn't noise of the input that reproduces the sensor: the residual's own Gram matrix is taken off, for
    noise that an input holds is no evidence for its gain. s^2 is the residual's variance.

    Parameters
    ----------
    records : sequence of Record
        Healthy, with the channels that the residual needs.
    spec : ResidualSpec
    rms : shape (inputs + 1,), optional
        Of the flight that the records are a part of: in a part, a channel may be at rest.

    Raises
    ------
    InputError
        Where no complete window of samples is there, or a channel is constant.
    """
    period_s = records[0].sample_period_s
    causal, noncausal = round(spec.look_back_s / period_s), round(spec.look_ahead_s / period_s)
    lags, inputs = causal + noncausal + 1, len(spec.inputs)
    u = [derive(record, spec.inputs).matrix(spec.inputs) for record in records]
    y = [record[spec.output] for record in records]
    both = [np.column_stack(pair) for pair in zip(u, y, strict=True)]
    (*means, mean), own_rms = _moments(np.concatenate(both))
    pieces = [_Piece.of(ui - means, yi - mean, causal, lags) for ui, yi in zip(u, y, strict=True) if len(yi) >= lags]
    count = sum(int(piece.whole.sum()) for piece in pieces) / _ALIKE
    if count < 10.0:
        raise InputError(
            f"{sum(map(len, records))} samples hold too few windows of {lags} without a missing one for the residual "
            f"of {spec.output}; give a longer record, or a bank that looks back and ahead less"
        )
    if rms is None:
        _check_motion([*spec.inputs, spec.output], own_rms)
    *input_rms, output_rms = own_rms if rms is None else rms
    own = next((i for i, name in enumerate(spec.inputs) if _reproduces(name, spec.output)), None)
    scale = output_rms / np.asarray(input_rms)
    before, precision = _prior(own, inputs, causal, noncausal, period_s, scale)
    products = sum((piece.products(before, lags) for piece in pieces), np.zeros((lags * inputs + 1,) * 2))
    gram, right, power = products[:-1, :-1], products[:-1, -1], float(products[-1, -1])
    least = 1e-12 * output_rms**2
    theta, variance = before, max(power / count, least)
    for _ in range(_ITERATIONS):
        noise = np.zeros_like(gram)
        if own is not None:
            noise[own::inputs, own::inputs] = count * _noise(pieces, theta, lags)
        signal, share = (gram, right) if own is None else _signal(gram, right, noise)
        hessian = precision + signal / variance
        step = np.linalg.solve(hessian, share / variance)
        theta = before + step
        used = float(np.trace(np.linalg.solve(hessian, signal / variance)))
        left = power - 2.0 * float(step @ right) + float(step @ gram @ step)
        variance = max(left / max(count - used, count / 10.0), least)
    root = np.linalg.inv(np.linalg.cholesky(hessian)).T
    operator = Transmissibility(
        markov=frozen(theta.reshape(lags, 1, inputs)),
        inputs=spec.inputs,
        outputs=(spec.output,),
        causal_order=causal,
        noncausal_order=noncausal,
        input_means=frozen(means),
        output_means=frozen([mean]),
        rank=lags * inputs,
        samples=sum(int(piece.whole.sum()) for piece in pieces),
        rms_residual=frozen([np.sqrt(variance)]),
        sample_period_s=period_s,
        estimator="cautious",
        solver="cholesky",
    )
    return Cautious(
        operator=operator,
        root=frozen(np.ascontiguousarray(root)),
        variance=variance,
        rms=frozen([*input_rms, output_rms]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Piece:
    """A record's slow motion u and y(k), and at which windows of u nothing is missing."""

    u: FloatArray
    y: FloatArray
    whole: np.ndarray[Any, np.dtype[np.bool_]]

    @classmethod
    def of(cls, u: FloatArray, y: FloatArray, causal_order: int, lags: int) -> _Piece:
        complete = len(y) - lags + 1
        there = np.isfinite(u).all(axis=1) & np.isfinite(y)
        slow_y = slow(y[:, np.newaxis])[causal_order : causal_order + complete, 0]
        whole = np.asarray(np.lib.stride_tricks.sliding_window_view(there, lags).all(axis=1))
        return cls(u=slow(u), y=slow_y, whole=whole)

    def windows(self, lags: int) -> Iterator[tuple[slice, FloatArray]]:
        """Yield phi(k), some rows at a time."""
        for start in range(0, len(self.y), _CHUNK):
            yield slice(start, start + _CHUNK), regressors(self.u[start : start + _CHUNK + lags - 1], lags)

    def residual(self, theta: FloatArray, lags: int) -> FloatArray:
        """Return y(k) - phi(k)' theta."""
        return np.concatenate([self.y[rows] - phi @ theta for rows, phi in self.windows(lags)])

    def products(self, theta: FloatArray, lags: int) -> FloatArray:
        """Return [Phi e]'[Phi e], e the residual of theta, over the windows that are whole."""
        total = np.zeros((len(theta) + 1,) * 2)
        for rows, phi in self.windows(lags):
            both = np.column_stack([phi, self.y[rows] - phi @ theta])[self.whole[rows]]
            total += both.T @ both / _ALIKE
        return total


def _moments(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means and RMS values about them, over the rows where nothing is missing; RMS 0 where nothing moves."""
    there = values[np.isfinite(values).all(axis=1)]
    if not len(there):
        return np.zeros(values.shape[1]), np.zeros(values.shape[1])
    return there.mean(axis=0), np.where(np.ptp(there, axis=0) > 0.0, there.std(axis=0), 0.0)


def _check_motion(names: Sequence[str], rms: FloatArray) -> None:
    """Refuse a channel that doesn't move."""
    for name, one in zip(names, rms.tolist(), strict=True):
        if not one > 0.0:
            raise InputError(
                f"channel '{name}' is constant over the healthy record: nothing can be identified from or for it; "
                "leave it out or choose another stretch"
            )


def _reproduces(name: str, output: str) -> bool:
    return name in PSEUDO_INPUTS and PSEUDO_INPUTS[name].reproduces == output


def _prior(
    own: int | None, inputs: int, causal_order: int, noncausal_order: int, period_s: float, scale: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return theta_0 and K^-1; `own` is the input that reproduces the sensor, `scale` the output's RMS over inputs'."""
    lags = causal_order + noncausal_order + 1
    mean, covariance = np.zeros(lags * inputs), np.zeros((lags * inputs, lags * inputs))
    for i in range(inputs):
        places = np.arange(lags) * inputs + i  # lag -d to r
        if i != own:
            covariance[places, places] = np.square(_FREE * scale[i]) / (lags * inputs)
            continue
        mean[places[noncausal_order]] = 1.0
        covariance[places, places] = _TAP**2
        covariance[places[noncausal_order], places[noncausal_order]] += _GAIN**2
        if causal_order and noncausal_order:
            delay = np.zeros(lags * inputs)  # of a second: a central difference
            delay[places[[noncausal_order - 1, noncausal_order + 1]]] = np.array([0.5, -0.5]) / period_s
            covariance += _DELAY_S**2 * np.outer(delay, delay)
    return mean, np.asarray(np.linalg.inv(covariance), dtype=np.float64)


def _noise(pieces: Sequence[_Piece], theta: FloatArray, lags: int) -> FloatArray:
    """Return the residual's autocovariance, shape (lags, lags), from what isn't missing."""
    from scipy.linalg import toeplitz

    sums, counts = np.zeros(lags), np.zeros(lags)
    for piece in pieces:
        there = piece.whole.astype(np.float64)
        residual = np.where(piece.whole, piece.residual(theta, lags), 0.0)
        for lag in range(min(lags, len(residual))):
            sums[lag] += residual[lag:] @ residual[: len(residual) - lag]
            counts[lag] += there[lag:] @ there[: len(there) - lag]
    return np.asarray(toeplitz(sums / np.maximum(counts, 1.0)))


def _signal(gram: FloatArray, right: FloatArray, noise: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return S, and S G^-1 of the right side: what of the equations is motion rather than noise, whatever the units."""
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0.0, size, 1.0)
    unit = gram / np.outer(size, size)
    values, vectors = np.linalg.eigh(unit - noise / np.outer(size, size))
    signal = (vectors * np.maximum(values, 0.0)) @ vectors.T
    solved = np.linalg.solve(unit + 1e-9 * len(unit) * np.eye(len(unit)), right / size)
    return signal * np.outer(size, size), size * (signal @ solved)

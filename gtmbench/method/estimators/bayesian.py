"""Bayesian estimation: what a few seconds or minutes of flight say of an operator, and what they leave open.

Least squares on such records fits their one manoeuvre, and takes an input at rest, which is noise, for a sensor without
gain. Here theta ~ N(theta_0, K) before the data: a pseudo input that reproduces the sensor (p_att for p) does so but
for gain, delay and small change; other inputs do at most what the output's own size allows. Data then speak where
they hold more motion than noise.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import ClassVar

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.method.problem import Estimate, Problem
from gtmbench.method.pseudo_inputs import reproduces
from gtmbench.method.regression.slow import regressors, slow
from gtmbench.method.regression.stretches import Stretch
from gtmbench.record import FloatArray

_ALIKE = 5.0  # so many equations in a row say what one does: slow motion has a tenth of the band
_LEAST = 10.0  # equations that say something of their own
_LEAST_VARIANCE = 1e-12  # of the residual, over the output's
_CHUNK = 4096
_ITERATIONS = 4


@dataclass(frozen=True, kw_only=True)
class Bayesian:
    """The mean of theta given the records, and its covariance, under a prior of what sensors do.

    H = K^-1 + S / s^2, theta = theta_0 + H^-1 S G^-1 Phi'(y - Phi theta_0) / s^2, on slow motion; G = Phi'Phi, and S is
    what of G isn't noise of the input that reproduces the sensor: the residual's own Gram matrix is taken off, for
    noise that an input holds is no evidence for its gain. s^2 is the residual's variance; H^-1 is the covariance.

    Beside least squares: equations that follow each other say the same of slow motion, so that five count as one, and
    the prior's deviations are of the problem's scale, the RMS values of inputs and output.

    Attributes
    ----------
    gain : float
        Deviation of the gain of an input that reproduces the output, from 1.
    delay_s : float
        Deviation of the delay between these two, from 0.
    tap : float
        Deviation of each of its Markov parameters beside.
    free : float
        Deviation of what all other inputs contribute, each over the output's RMS, from 0.

    Examples
    --------
    The gain of a sensor at rest, from noise alone:

    >>> import numpy as np
    >>> import gtmbench as gb
    >>> noise = np.random.default_rng(1).standard_normal((750, 2))
    >>> record = gb.Record(0.1 * noise, channels=["p", "p_att"], sample_period_s=0.04)
    >>> names = {"inputs": ["p_att"], "outputs": ["p"], "causal_order": 2, "noncausal_order": 2}
    >>> operator = gb.identify(record, estimator=gb.Bayesian(), **names)
    >>> operator.markov.sum().round(2), np.sqrt(operator.covariance("p").sum()).round(3)  # and its deviation
    (np.float64(1.0), np.float64(0.015))
    >>> bool(abs(gb.identify(record, **names).markov.sum()) < 0.3)  # least squares
    True
    """

    instruments: ClassVar[tuple[str, ...]] = ()

    gain: float = 0.01
    delay_s: float = 0.05
    tap: float = 0.005
    free: float = 3.0

    def __post_init__(self) -> None:
        number("gain", self.gain, 0.0)
        number("delay_s", self.delay_s, 0.0)
        number("tap", self.tap, 0.0, above=True)
        number("free", self.free, 0.0, above=True)

    def estimate(self, problem: Problem) -> Estimate:
        """Return the mean and the covariance of the Markov parameters; samples of weight 0 bridge a gap, no more.

        Raises
        ------
        InputError
            Where there are too few complete windows of samples.
        """
        inputs = len(problem.inputs)
        blocks = [stretch.read(0, len(stretch)).T for stretch in problem.stretches if len(stretch) >= problem.lags]
        weights = [_weights(stretch, problem) for stretch in problem.stretches if len(stretch) >= problem.lags]
        equations = sum(int(np.count_nonzero(of)) for of in weights)
        if sum(float(of.sum()) for of in weights) < _ALIKE * _LEAST:
            raise InputError(
                f"{sum(map(len, problem.stretches))} samples hold too few windows of {problem.lags} without a missing "
                f"one for {', '.join(problem.outputs)}; give a longer record, or look back and ahead less"
            )
        motion = [slow(block) for block in blocks]
        rows = slice(problem.causal_order, -problem.noncausal_order or None)
        posteriors = []
        for o in range(inputs, inputs + len(problem.outputs)):
            pieces = [
                _Piece(u=each[:, :inputs], y=each[rows, o], weights=of)
                for each, of in zip(motion, weights, strict=True)
            ]
            posteriors.append(self._posterior(problem, problem.outputs[o - inputs], pieces))
        variance = np.array([posterior.variance for posterior in posteriors])
        return Estimate(
            coefficients=np.column_stack([_turned(posterior.theta, inputs) for posterior in posteriors]),
            root=np.stack([_root(posterior, inputs) for posterior in posteriors]),
            noise_variance=variance,
            rms_residual=np.sqrt(variance),
            equations=equations,
            rank=problem.parameters,
            solver="cholesky",
        )

    def _posterior(self, problem: Problem, output: str, pieces: Sequence[_Piece]) -> _Posterior:
        inputs, lags = len(problem.inputs), problem.lags
        own = next((i for i, name in enumerate(problem.inputs) if reproduces(name, output)), None)
        before, precision = self._prior(problem, output, own)
        products = sum((piece.products(before, lags) for piece in pieces), np.zeros((lags * inputs + 1,) * 2))
        gram, right, power = products[:-1, :-1], products[:-1, -1], float(products[-1, -1])
        count = sum(float(piece.weights.sum()) for piece in pieces) / _ALIKE
        theta, variance = before, max(power / count, _LEAST_VARIANCE)
        for _ in range(_ITERATIONS):
            noise = np.zeros_like(gram)
            if own is not None:
                unit = _unit(problem, problem.inputs[own], output)
                noise[own::inputs, own::inputs] = count * _noise(pieces, theta, lags) / unit**2
            signal, share = (gram, right) if own is None else _signal(gram, right, noise)
            hessian = precision + signal / variance
            step = np.linalg.solve(hessian, share / variance)
            theta = before + step
            used = float(np.trace(np.linalg.solve(hessian, signal / variance)))
            left = power - 2.0 * float(step @ right) + float(step @ gram @ step)
            variance = max(left / max(count - used, count / 10.0), _LEAST_VARIANCE)
        return _Posterior(theta=theta, hessian=hessian, variance=variance)

    def _prior(self, problem: Problem, output: str, own: int | None) -> tuple[FloatArray, FloatArray]:
        """Return theta_0 and K^-1 in the problem's scale; `own` is the input that reproduces the output."""
        inputs, lags, now = len(problem.inputs), problem.lags, problem.noncausal_order
        mean, covariance = np.zeros(lags * inputs), np.zeros((lags * inputs, lags * inputs))
        for i, name in enumerate(problem.inputs):
            places = np.arange(lags) * inputs + i  # lag -d to r
            if i != own:
                covariance[places, places] = self.free**2 / (lags * inputs)
                continue
            unit = _unit(problem, name, output)
            mean[places[now]] = unit
            covariance[places, places] = (self.tap * unit) ** 2
            covariance[places[now], places[now]] += (self.gain * unit) ** 2
            if problem.causal_order and problem.noncausal_order:
                delay = np.zeros(lags * inputs)  # of a second: a central difference
                delay[places[[now - 1, now + 1]]] = np.array([0.5, -0.5]) * unit / problem.sample_period_s
                covariance += self.delay_s**2 * np.outer(delay, delay)
        return mean, np.asarray(np.linalg.inv(covariance), dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Posterior:
    """theta, lag -d to r and input by input within, the inverse H of its covariance, and the residual's variance."""

    theta: FloatArray
    hessian: FloatArray = field(repr=False)
    variance: float


@dataclass(frozen=True, kw_only=True, eq=False)
class _Piece:
    """Slow motion u of a stretch; y(k) and the weight of every window of u, 0 where a sample is missing."""

    u: FloatArray
    y: FloatArray
    weights: FloatArray

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
            whole = self.weights[rows] > 0.0
            both = np.column_stack([phi, self.y[rows] - phi @ theta])[whole]
            total += both.T @ (both * self.weights[rows][whole, np.newaxis]) / _ALIKE
        return total


def _weights(stretch: Stretch, problem: Problem) -> FloatArray:
    """Return the weight of each window's equation: that of its sample k, 0 where any of its samples has 0."""
    complete = len(stretch) - problem.lags + 1
    if stretch.weights is None:
        return np.ones(complete)
    there = np.lib.stride_tricks.sliding_window_view(stretch.weights > 0.0, problem.lags).all(axis=1)
    return np.where(there, stretch.weights[problem.causal_order :][:complete], 0.0)


def _unit(problem: Problem, name: str, output: str) -> float:
    """Return the parameter, in the problem's scale, of an input that passes unchanged."""
    scale = dict(zip(problem.channels, problem.scale.tolist(), strict=True))
    return float(scale[name] / scale[output])


def _turned(values: FloatArray, inputs: int) -> FloatArray:
    """Return rows from lag -d to r as from lag r to -d, or the other way round."""
    return values.reshape(-1, inputs, *values.shape[1:])[::-1].reshape(values.shape)


def _root(posterior: _Posterior, inputs: int) -> FloatArray:
    """Return the triangle S, columns from lag r to -d, with (S'S)^-1 times the variance the covariance."""
    turned = _turned(_turned(posterior.hessian, inputs).T, inputs)
    return np.asarray(np.linalg.cholesky(turned).T * np.sqrt(posterior.variance))


def _noise(pieces: Sequence[_Piece], theta: FloatArray, lags: int) -> FloatArray:
    """Return the residual's autocovariance, shape (lags, lags), from what isn't missing."""
    from scipy.linalg import toeplitz

    sums, counts = np.zeros(lags), np.zeros(lags)
    for piece in pieces:
        there = (piece.weights > 0.0).astype(np.float64)
        residual = there * piece.residual(theta, lags)
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

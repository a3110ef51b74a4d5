"""Bayesian estimation: what a few seconds or minutes of flight say of an operator, and what they leave open.

Least squares on such records fits their one manoeuvre, and takes an input at rest, which is noise, for a sensor without
gain. Here theta ~ N(theta_0, K) before the data: a pseudo input that reproduces the sensor (p_att for p) does so but
for gain, delay and small change; other inputs do at most what the output's own size allows. Data then speak where
they hold more motion than noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np

from gtmbench.checks import number
from gtmbench.errors import InputError
from gtmbench.method.estimators.kinematic import LEAST_VARIANCE, Expected, fit
from gtmbench.method.problem import Estimate, Problem
from gtmbench.method.pseudo_inputs import PSEUDO_INPUTS, kinematic, reproduces
from gtmbench.method.regression.equations import (
    ALIKE,
    Equations,
    about_means,
    autocovariance,
    signal_of,
    slow,
    solved,
    weights_of,
)
from gtmbench.values.record import FloatArray

_LEAST = 10.0  # equations that say something of their own
_BEND = 0.3  # of the delay that an attitude's filter may have: the root of the second moment that it may add
_ROUGH = 0.2  # samples squared: what laying samples on a clock adds to it
_ITERATIONS = 4  # of fits, and of the noise that they are weighted by


@dataclass(frozen=True, kw_only=True)
class Bayesian:
    """The mean of theta given the records, and its covariance, under a prior from kinematics.

    H = K^-1 + S / s^2, theta = theta_0 + H^-1 S G^-1 Phi'(y - Phi theta_0) / s^2, on slow motion. G = Phi'Phi, and S is
    G without the noise of the input that reproduces the sensor: the residual's own Gram matrix is subtracted, because
    noise of an input is no evidence for its gain. s^2 is the residual's variance; H^-1 is the covariance.

    It differs from least squares in two ways. Consecutive equations carry the same information on slow motion, so five
    count as one. The prior's deviations scale with the problem, the RMS values of inputs and output. Of the constant
    nothing is known before.

    For an operator between readings of the same motion (p_att and p alone, either way) physics fixes more. Its gain at
    0 Hz is 1 and its curvature that of a central difference, unless the records decisively contradict that. Its delay
    is estimated, and the rest passes the least noise (`kinematic`).

    Attributes
    ----------
    gain : float
        Deviation of the gain of an input that reproduces the output, from 1.
    delay_s : float
        Deviation of the delay between these two, from 0.
    tap : float
        Deviation of each of its further Markov parameters.
    free : float
        Deviation from 0 of the contributions of all other inputs, each over the output's RMS.

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
    (np.float64(1.0), np.float64(0.01))
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
        """Return the mean and the covariance of the Markov parameters; samples of weight 0 only bridge a gap.

        Raises
        ------
        InputError
            If there are too few complete windows of samples.
        """
        inputs = len(problem.inputs)
        blocks = [stretch.read(0, len(stretch)).T for stretch in problem.stretches if len(stretch) >= problem.lags]
        weights = [
            weights_of(stretch, problem.causal_order, problem.lags)
            for stretch in problem.stretches
            if len(stretch) >= problem.lags
        ]
        rows = slice(problem.causal_order, -problem.noncausal_order or None)
        equations = sum(int(np.count_nonzero(of)) for of in weights)
        if sum(float(of.sum()) for of in weights) < ALIKE * _LEAST:
            raise InputError(
                f"{sum(map(len, problem.stretches))} samples are too few for windows of {problem.lags} without a "
                f"missing one of {', '.join(problem.outputs)}; give a longer record, or look back and ahead less"
            )
        # the prior holds for motion: fast noise is smoothed away first, of inputs and outputs alike
        motion = [slow(block) for block in blocks]
        posteriors = []
        for o, output in enumerate(problem.outputs, start=inputs):
            # one sensor beside another of the same motion: its moments are physics', found from the samples as read
            physical = inputs == 1 and kinematic(problem.inputs[0], output)
            pieces = [
                Equations(u=each[:, :inputs], y=each[rows, o], weights=of)
                for each, of in zip(blocks if physical else motion, weights, strict=True)
            ]
            means, mean = np.zeros(problem.parameters), 0.0
            if problem.with_constant:
                pieces, means, mean = about_means(pieces, problem.lags)
            found = (self._kinematic if physical else self._posterior)(problem, output, pieces)
            posteriors.append(replace(found, constant=mean - float(means @ found.theta)))
        variance = np.array([posterior.variance for posterior in posteriors])
        return Estimate(
            coefficients=np.column_stack([_turned(posterior.theta, inputs) for posterior in posteriors]),
            root=np.stack([_root(posterior, inputs) for posterior in posteriors]),
            noise_variance=variance,
            rms_residual=np.sqrt(variance),
            equations=equations,
            rank=problem.parameters,
            solver="cholesky",
            constant=np.array([posterior.constant for posterior in posteriors]),
        )

    def _posterior(self, problem: Problem, output: str, pieces: Sequence[Equations]) -> _Posterior:
        inputs, lags = len(problem.inputs), problem.lags
        own = next((i for i, name in enumerate(problem.inputs) if reproduces(name, output)), None)
        before, precision = self._prior(problem, output, own)
        products = sum((piece.products(before, lags) for piece in pieces), np.zeros((lags * inputs + 1,) * 2))
        gram, right, power = products[:-1, :-1], products[:-1, -1], float(products[-1, -1])
        count = sum(float(piece.weights.sum()) for piece in pieces) / ALIKE
        # G^-1 Phi'(y - Phi theta_0): what the data alone would add; S takes of it what is motion
        alone = None if own is None else solved(gram, right)
        theta, variance = before, max(power / count, LEAST_VARIANCE)
        # S and s^2 need theta's residual, and theta needs both: four turns settle s^2 to 1e-9 (a minute of the GTM)
        for _ in range(_ITERATIONS):
            signal, share = gram, right
            if own is not None and alone is not None:
                unit = _unit(problem, problem.inputs[own], output)
                noise = np.zeros_like(gram)
                noise[own::inputs, own::inputs] = count * autocovariance(pieces, theta, lags) / unit**2
                signal = signal_of(gram, noise)
                share = signal @ alone
            hessian = precision + signal / variance
            covariance = _inverse(hessian)
            # theta - theta_0 = H^-1 S G^-1 Phi'(y - Phi theta_0) / s^2
            step = covariance @ share / variance
            theta = before + step
            # trace(H^-1 S) / s^2: how many parameters the data, not the prior, determine
            used = float(np.vdot(covariance, signal)) / variance
            left = power - 2.0 * float(step @ right) + float(step @ gram @ step)
            variance = max(left / max(count - used, count / 10.0), LEAST_VARIANCE)
        return _Posterior(theta=theta, hessian=hessian, variance=variance)

    def _kinematic(self, problem: Problem, output: str, samples: Sequence[Equations]) -> _Posterior:
        """Return the posterior of an operator that physics fixes but for lag and noise."""
        (name,) = problem.inputs
        unit = _unit(problem, name, output)
        curvature = -1.0 / 3.0 if name in PSEUDO_INPUTS else 1.0 / 3.0
        h, covariance, variance = fit(
            [replace(each, u=each.u * unit, means=each.means * unit) for each in samples],
            constant=problem.with_constant,
            lags=problem.lags,
            ahead=problem.noncausal_order,
            sample_period_s=problem.sample_period_s,
            expected=Expected(
                curvature=curvature,
                gain=self.gain,
                delay=self.delay_s / problem.sample_period_s,
                bend=_ROUGH + (_BEND * self.delay_s / problem.sample_period_s) ** 2,
            ),
        )
        inverse = np.linalg.inv(covariance) / unit**2
        return _Posterior(theta=h * unit, hessian=(inverse + inverse.T) / 2.0, variance=variance)

    def _prior(self, problem: Problem, output: str, own: int | None) -> tuple[FloatArray, FloatArray]:
        """Return theta_0 and K^-1 in the problem's scale; `own` is the input that reproduces the output."""
        inputs, lags, now = len(problem.inputs), problem.lags, problem.noncausal_order
        mean, covariance = np.zeros(lags * inputs), np.zeros((lags * inputs, lags * inputs))
        for i, name in enumerate(problem.inputs):
            places = np.arange(lags) * inputs + i  # lag -d to r
            # nothing is known of an input's lags but how much the output holds in all: free^2, shared evenly
            if i != own:
                covariance[places, places] = self.free**2 / (lags * inputs)
                continue
            unit = _unit(problem, name, output)
            # theta_0: the sensor is this input, now; every lag may differ by `tap`, their sum by `gain`
            mean[places[now]] = unit
            covariance[places, places] = (self.tap * unit) ** 2
            covariance[places[now], places[now]] += (self.gain * unit) ** 2
            # a delay of s seconds adds -s du/dt, and a central difference of u is du/dt: one more direction
            if problem.causal_order and problem.noncausal_order:
                delay = np.zeros(lags * inputs)  # of a second: a central difference
                delay[places[[now - 1, now + 1]]] = np.array([0.5, -0.5]) * unit / problem.sample_period_s
                covariance += self.delay_s**2 * np.outer(delay, delay)
        return mean, np.asarray(np.linalg.inv(covariance), dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Posterior:
    """theta, lag -d to r and input by input within, the inverse H of its covariance, the residual's variance, and c."""

    theta: FloatArray
    hessian: FloatArray = field(repr=False)
    variance: float
    constant: float = 0.0


def _inverse(hessian: FloatArray) -> FloatArray:
    """Return the inverse of a symmetric matrix that is positive definite: a third of the work of any other."""
    from scipy.linalg import lapack

    factor, _ = lapack.dpotrf(hessian)
    upper, _ = lapack.dpotri(factor)
    return np.asarray(upper + np.triu(upper, 1).T)


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

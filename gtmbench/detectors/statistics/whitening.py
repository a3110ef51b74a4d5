"""Whitening: a residual's own autoregressive model, so that each of its samples counts once."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from gtmbench.errors import InputError
from gtmbench.method.filters import autocovariance, innovations, yule_walker
from gtmbench.values.record import FloatArray, frozen

LOUD = 4.0  # deviations: normal noise of 100 Hz has one beyond in 160 s


@dataclass(frozen=True, kw_only=True, eq=False)
class Whitener:
    """w(k) = sum over i = 0..n of a_i (e(k-i) - mean) / deviation: white, of variance 1."""

    coefficients: FloatArray  # shape (n + 1,): a_0 = 1, a_1, ..., a_n
    # mean, deviation: of the residual, and of its innovations; in the output's unit
    mean: float
    deviation: float
    # deviations that one sample counts for, in tests: the noise's tail may be heavier than a Gaussian one
    most: float = math.inf
    # those that one beyond twice `most` counts for: in noise with a Gaussian tail it isn't noise
    loudest: float = math.inf
    # unsteady, slow: as `White` has them
    unsteady: float = 0.0
    slow: float = 0.0

    @property
    def order(self) -> int:
        """How many samples before k it looks at."""
        return len(self.coefficients) - 1

    def whiten(self, residual: FloatArray) -> FloatArray:
        """Return w(k), row for row; NaN where a residual it needs is missing.

        >>> Whitener(coefficients=np.array([1.0, -0.5]), mean=0.0, deviation=2.0).whiten(np.array([2.0, 3.0, 1.5]))
        array([nan,  1.,  0.])
        """
        centred = residual - self.mean
        centred /= self.deviation
        return innovations(centred, self.coefficients)

    def power(self, frequency: FloatArray) -> FloatArray:
        """Return the spectrum of the residual at some frequencies, in radians a sample: deviation^2 / |A(w)|^2.

        >>> Whitener(coefficients=np.array([1.0, -0.5]), mean=0.0, deviation=2.0).power(np.array([0.0]))
        array([16.])
        """
        turns = np.exp(-1j * np.outer(frequency, np.arange(len(self.coefficients))))
        return np.asarray(self.deviation**2 / np.square(np.abs(turns @ self.coefficients)))


def loud_in(sizes: FloatArray) -> FloatArray:
    """Return 1 where a sample is beyond `LOUD` deviations, otherwise 0."""
    return np.asarray(np.abs(sizes) > LOUD, dtype=np.float64)


@dataclass(frozen=True, kw_only=True, eq=False)
class White:
    """A whitened residual, and how steady the noise is that it is measured by."""

    # shape (rows,): white, of variance 1 while all is well, and clipped; NaN where a residual that it needs is missing
    values: FloatArray = field(repr=False)
    # shape (rows,): sigma^2: the variance of the logarithm of the noise's power, beyond chance; 0 of noise that is
    # known
    unsteady: FloatArray = field(repr=False)
    # shape (rows,): the variance of a mean that no averaging takes away; 0 where the noise is as white as it should be
    slow: FloatArray = field(repr=False)
    # shape (rows,): 1 where a sample was beyond `LOUD` deviations before it was clipped, otherwise 0
    loud: FloatArray = field(repr=False)

    @classmethod
    def steady(cls, values: FloatArray) -> White:
        """Return one of noise that is known."""
        nothing = np.broadcast_to(0.0, len(values))
        return cls(values=values, unsteady=nothing, slow=nothing, loud=loud_in(values))

    def __len__(self) -> int:
        return len(self.values)

    def between(self, rows: slice) -> White:
        """Return some rows."""
        of = {name: values[rows] for name, values in vars(self).items()}
        return White(**of)

    @staticmethod
    def joined(parts: Sequence[White]) -> White:
        """Return parts that follow each other as one."""
        names = ("values", "unsteady", "slow", "loud")
        return White(
            **{name: np.concatenate([getattr(part, name) for part in parts] or [np.zeros(0)]) for name in names}
        )


def fit_whitener(residuals: Sequence[FloatArray], *, order: int) -> Whitener:
    """Fit an autoregressive model to healthy residuals by the Yule-Walker equations.

    Their autocovariance is averaged over all stretches without missing samples; Toeplitz equations give a stable model.

    InputError where fewer than 10 (order + 1) samples are there, or the residual is constant.

    >>> from scipy.signal import lfilter
    >>> coloured = lfilter([1.0], [1.0, -0.9], np.random.default_rng(1).standard_normal(20_000))
    >>> fit_whitener([coloured], order=1).coefficients.round(1)
    array([ 1. , -0.9])
    """
    there = [residual[np.isfinite(residual)] for residual in residuals]
    count = sum(map(len, there))
    if count < 10 * (order + 1):
        raise InputError(
            f"{count} samples of residual are too few for a whitening filter of {order} coefficients; give at least "
            f"{10 * (order + 1)}"
        )
    mean = sum(float(values.sum()) for values in there) / count
    # each record about its own mean: a bias since turn-on is another in every flight, and no noise
    centred = [residual - values.mean() for residual, values in zip(residuals, there, strict=True) if len(values)]
    stretches = [part for residual in centred for part in _whole(residual)]
    covariance = autocovariance(stretches, order) / count
    if not covariance[0] > (1e-12 * mean) ** 2:
        raise InputError("a residual is the same at every sample, so it has no noise to judge by; check the channels")
    taps, variance = yule_walker(covariance)
    return Whitener(coefficients=frozen(taps), mean=mean, deviation=float(np.sqrt(variance)))


def _whole(residual: FloatArray) -> list[FloatArray]:
    """Return the stretches between missing samples."""
    there = np.isfinite(residual)
    ends = np.flatnonzero(np.diff(there)) + 1
    return [part for part in np.split(residual, ends) if len(part) and np.isfinite(part[0])]
